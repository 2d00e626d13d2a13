"""A posterior of sbi, pickled (`pickle.dump`) or saved with `torch.save`; any release from 0.18 on.

Loads DirectPosterior (NPE), MCMCPosterior and RejectionPosterior (of NLE and NRE), VIPosterior, ensembles and
score-based posteriors, and pickled inference objects, whose posterior is then built. Draws are batched where
the release and the sampler can. The log density is offered where it is normalised: for DirectPosterior it is
corrected for the mass outside the prior, as sbi documents it (`norm_posterior`).

options: `source`, a script whose classes the pickle needs; `correction_draws` (default 10000), draws behind
that correction, for each x; `sample`, further keyword arguments of sbi's own `sample_batched` or `sample`;
`parameters`, names in the posterior's order.

Imports numpy, torch and sbi, and whatever the pickle names.
"""

import inspect
import pickle
import random
import warnings

import numpy as np

# As many draws go through the network at a time.
AT_ONCE = 100_000
# As many chains of MCMC run side by side.
CHAINS_AT_ONCE = 4_000


def load(path, options):
    """The posterior of the file as a model."""
    return Posterior(ready(unpickled(path, options)), options)


def unpickled(path, options):
    """The object in a file of pickle or torch.save."""
    import torch
    from stranger_files import explained, lend

    if options.get("source"):
        lend(options["source"])
    try:
        with open(path, "rb") as file:
            if file.read(2) == b"PK":
                return torch.load(path, map_location="cpu", weights_only=False)
            file.seek(0)
            return pickle.load(file)
    except (AttributeError, ModuleNotFoundError) as error:
        raise explained(error) from error


def ready(found):
    """A posterior, out of itself or of the inference object that can build it."""
    if not hasattr(found, "sample") and callable(getattr(found, "build_posterior", None)):
        found = found.build_posterior()
    if not callable(getattr(found, "sample", None)) or not hasattr(found, "potential"):
        raise ValueError(f"the file holds a {type(found).__name__}, not a posterior of sbi")
    return found


PATIENCE = 600.0


class Posterior:
    """Draws and, where they are normalised, densities of a posterior of sbi, in double precision."""

    def __init__(self, posterior, options):
        self.posterior, self.options = posterior, options
        self.kind = type(posterior).__name__
        # Seconds that one call of sbi's may take to find draws inside the prior, of which there may be none.
        self.patience = PATIENCE
        self.correction = int(options.get("correction_draws", 10_000))
        # An attribute only where it works: what a model can do is read off what it has.
        if normalised(posterior):
            self.log_prob = self._log_prob

    def describe(self):
        """Library, versions, and whether draws come from Markov chains."""
        import sbi
        import torch

        return {
            "library": "sbi " + self.kind,
            "versions": {"sbi": sbi.__version__, "torch": torch.__version__},
            "parameters": self.options.get("parameters"),
            "autocorrelated": self.chains() > 0,
        }

    def sample(self, x, n, seed):
        """Draws ``(batch, n, parameter)``."""
        import torch

        torch.manual_seed(seed)
        # sbi's slice sampler takes its numbers from these.
        np.random.seed(seed % 2**32)  # noqa: NPY002
        random.seed(seed)
        data = self._tensor(x)
        more = {"show_progress_bars": False, **self.options.get("sample", {})}
        if "max_sampling_time" in inspect.signature(self.posterior.sample).parameters:
            more.setdefault("max_sampling_time", self.patience)
        draws = []
        with warnings.catch_warnings():
            # How sbi divides its work is nothing that a reader could act on.
            warnings.filterwarnings("ignore", message="Capping max_sampling_batch_size|Note that for batched")
            try:
                for part in torch.split(data, self.at_once(n)) if self._batched() else ():
                    draws.append(self.posterior.sample_batched((n,), x=part, **more).transpose(0, 1))
            except NotImplementedError:
                pass  # some of sbi's posteriors have the method only to say that they cannot
            if not draws:
                draws = [self.posterior.sample((n,), x=row[None], **more)[None] for row in data]
        return double(torch.cat(draws))

    def _log_prob(self, theta, x):
        """Normalised log density ``(batch, n)``; theta is ``(batch, n, parameter)``."""
        import torch

        torch.manual_seed(0)
        points, data = self._tensor(theta), self._tensor(x)
        more = {}
        if corrects(self.posterior):
            # The correction is one where no draw can fall outside the prior.
            more["norm_posterior"] = bounded(self.posterior.prior)
            if more["norm_posterior"]:
                more["leakage_correction_params"] = {"num_rejection_samples": self.correction}
        if not (hasattr(self.posterior, "log_prob_batched") and corrects(self.posterior)):
            rows = [self.posterior.log_prob(p, x=d[None], **more) for p, d in zip(points, data)]
            return double(torch.stack([row.detach() for row in rows]))
        number = max(1, AT_ONCE // max(points.shape[1], self.correction if more["norm_posterior"] else 1))
        parts = []
        for some, their in zip(torch.split(points, number), torch.split(data, number)):
            parts.append(self.posterior.log_prob_batched(some.transpose(0, 1), x=their, **more).T)
        return double(torch.cat(parts))

    def chains(self):
        """Markov chains for each x; 0 where draws are independent."""
        return int(getattr(self.posterior, "num_chains", 1) or 1) if "MCMC" in self.kind else 0

    def at_once(self, n):
        """How many x one call of sbi's samples, n draws for each."""
        if not self._batched():
            return 1
        chains = self.chains()
        return max(1, min(AT_ONCE // n, CHAINS_AT_ONCE // chains) if chains else AT_ONCE // n)

    def _batched(self):
        """Whether one call may hold several x: the method is there, and works for this sampler."""
        if not hasattr(self.posterior, "sample_batched") or self.kind.startswith(("Rejection", "Importance")):
            return False
        method = self.options.get("sample", {}).get("method", getattr(self.posterior, "method", None))
        return not self.chains() or method == "slice_np_vectorized"

    def _tensor(self, values):
        """In the single precision of sbi's networks, where the posterior is."""
        import torch

        device = getattr(self.posterior, "_device", None)
        return torch.as_tensor(np.asarray(values), dtype=torch.float32, device=device)


def corrects(posterior):
    """Whether its density is a network's, cut at the prior's bounds."""
    return any(kind.__name__ == "DirectPosterior" for kind in type(posterior).__mro__)


def normalised(posterior):
    """Whether its log density integrates to one: those of MCMC and rejection know a potential only."""
    if type(posterior).__name__ == "EnsemblePosterior":
        return all(corrects(member) for member in posterior.posteriors)
    return corrects(posterior) or type(posterior).__name__ == "VectorFieldPosterior"


def bounded(prior):
    """Whether the prior is zero somewhere, as far as it says."""
    from torch.distributions import constraints

    try:
        support = prior.support
    except (AttributeError, NotImplementedError):
        return True
    while isinstance(support, constraints.independent):
        support = support.base_constraint
    return support not in (constraints.real, constraints.real_vector)


def double(values):
    """A tensor as numpy, in double precision."""
    return values.detach().cpu().numpy().astype(np.float64)
