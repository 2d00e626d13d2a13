"""A network trained with sbi, saved without the posterior around it, and the prior that a builder makes.

The file holds the network itself, by `pickle.dump` or `torch.save`, or its state dict. The builder returns
the prior, or, for a state dict, the pair (prior, network as before training). What the network estimates is
said by options["kind"]: "posterior" (NPE, the default), "likelihood" (NLE) or "ratio" (NRE); for the last two
options["sampler"] holds keyword arguments of sbi's MCMCPosterior.

Further options are those of `sbi_posterior`. Imports numpy, torch and sbi, and whatever the pickle names.
"""

import os
import sys


def load(path, options):
    """The posterior around the network of the file as a model."""
    sys.path.append(os.path.dirname(os.path.abspath(__file__)))
    from sbi_posterior import Posterior
    from stranger_files import build

    made = build(options, "the prior, or (prior, network) for a state dict")
    prior, skeleton = made if isinstance(made, tuple) else (made, None)
    network = trained(path, options, skeleton)
    return Posterior(posterior(network, prior, options), options)


def trained(path, options, skeleton):
    """The network of the file; of a state dict, the builder's with these weights."""
    from sbi_posterior import unpickled

    if skeleton is None:
        network = unpickled(path, options)
        if isinstance(network, dict):
            raise ValueError("the file holds a state dict: the builder must return (prior, network)")
    else:
        import torch

        skeleton.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        network = skeleton
    return network.eval()


def posterior(network, prior, options):
    """What sbi would build from this network."""
    from sbi.inference import DirectPosterior, MCMCPosterior

    kind = options.get("kind", "posterior")
    if kind == "posterior":
        return DirectPosterior(network, prior)
    if kind not in ("likelihood", "ratio"):
        raise ValueError(f"options.kind is {kind!r}; there are posterior, likelihood, ratio")
    from sbi import inference

    built = getattr(inference, kind + "_estimator_based_potential")
    potential, transform = built(network, prior, None)
    return MCMCPosterior(potential, proposal=prior, theta_transform=transform, **options.get("sampler", {}))
