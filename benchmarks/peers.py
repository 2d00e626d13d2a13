"""What peers and gaugeblock take for the same, side by side in one run: python -m benchmarks.peers

A row a task: CPU seconds of each (of all its threads; set OMP_NUM_THREADS=1), the best of equal repeats,
taken in turns after one of each that counts for nothing (imports, compilation), and their ratio: below 1 the
peer is faster. Every peer is asked in its fastest documented way. `tox -e bench` installs them. Rows that are
in the JSON file already are not measured again; `--page` draws the figure and fills docs/peers.md with what
is there.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.kept import arguments, keep_row, processors, stored
from studies.kit import page, plots

os.environ.setdefault("KERAS_BACKEND", "torch")
HERE = Path(__file__).resolve().parent
FITTED = 4
"""Spectra whose posteriors are sampled: jaxspec takes half a minute for each."""
Task = tuple[str, str, Callable[[], Any], Callable[[], Any], int]


class Given:
    """A posterior whose draws ``(draw, trial, parameter)`` are already there."""

    def __init__(self, draws: Any):
        self.draws = draws

    def sample_batched(self, shape: Any, x: Any, show_progress_bars: bool) -> Any:  # noqa: ARG002
        return self.draws


def sbc_ranks(rng: np.random.Generator) -> Task:
    import torch
    from sbi.diagnostics import run_sbc

    from gaugeblock.validate.ranks import randomised_ranks

    truth, draws = rng.normal(size=(1000, 5)), rng.normal(size=(1000, 1000, 5))
    theta = torch.as_tensor(truth, dtype=torch.float32)
    given = Given(torch.as_tensor(draws, dtype=torch.float32).transpose(0, 1).contiguous())
    return (
        "SBC ranks, 1,000 trials x 1,000 draws x 5",
        "sbi",
        lambda: run_sbc(theta, theta, given, num_posterior_samples=1000, show_progress_bar=False),
        lambda: randomised_ranks(truth, draws, rng),
        3,
    )


def ecdf_band(rng: np.random.Generator) -> Task:
    from arviz_stats.ecdf_utils import ecdf_pit

    from gaugeblock.validate.marginal.uniformity import adjusted_gamma, band, ecdf_test

    values = rng.random(10_000)

    def ours() -> Any:
        for cached in (band, adjusted_gamma):
            cached.cache_clear()
        return ecdf_test(values)

    return "simultaneous ECDF band, n = 10,000", "arviz-stats", lambda: ecdf_pit(values, 0.95, 1000), ours, 1


def gamma_null(rng: np.random.Generator) -> Task:
    from bayesflow.diagnostics.metrics.calibration_log_gamma import gamma_discrepancy, gamma_null_distribution

    from gaugeblock.validate.marginal.discrete_ranks import gamma_statistic
    from gaugeblock.validate.marginal.uniformity import adjusted_gamma, band

    ranks = rng.integers(0, 1001, 1000)

    def theirs() -> bool:
        return gamma_discrepancy(ranks, 1000) < np.quantile(gamma_null_distribution(1000, 1000, 1000), 0.05)

    def ours() -> bool:
        for cached in (band, adjusted_gamma):
            cached.cache_clear()
        return gamma_statistic((ranks + 0.5) / 1001, 1001) < adjusted_gamma(1000, 1001, 0.95)

    return "SBC gamma and its threshold, 1,000 trials x 1,000 draws", "bayesflow", theirs, ours, 1


def mmd_null(rng: np.random.Generator) -> Task:
    import torch
    from sbi.diagnostics import calc_misspecification_mmd

    from gaugeblock.validate.detectors.kernels import mmd

    observed, simulated = rng.normal(size=(100, 5)), rng.normal(size=(1000, 5))
    there, here = (torch.as_tensor(a, dtype=torch.float32) for a in (observed, simulated))
    return (
        "MMD with 1,000 permutations, 100 against 1,000",
        "sbi",
        lambda: calc_misspecification_mmd(there, here, n_shuffle=1000),
        lambda: mmd(observed, simulated, rng=rng, permutations=1000),
        1,
    )


def psis(rng: np.random.Generator) -> Task:
    from arviz_stats.base import array_stats

    from gaugeblock.validate.joint.psis import pareto_khat

    weight = rng.normal(size=(1000, 500)) * rng.uniform(0.3, 3, size=(1000, 1))
    return (
        "PSIS k-hat, 1,000 trials x 500 draws",
        "arviz-stats",
        lambda: [array_stats.psislw(-row)[1] for row in weight],
        lambda: pareto_khat(weight),
        3,
    )


def expected_coverage(rng: np.random.Generator) -> Task:
    """Both from draws: densities are what costs. Ours takes them from the flow, once, and ranks them."""
    import torch
    from sbi.diagnostics import run_sbc
    from sbi.inference import DirectPosterior
    from sbi.neural_nets import posterior_nn
    from sbi.utils import BoxUniform

    from gaugeblock.validate.ranks import randomised_pit

    torch.manual_seed(0)
    prior = BoxUniform(-torch.ones(2), torch.ones(2))
    theta = 0.1 * prior.sample((200,))
    x = theta + 0.1 * torch.randn(200, 2)
    posterior = DirectPosterior(posterior_nn("nsf")(theta, x), prior)
    trials, draws = 20, 1000
    theta, x = theta[:trials], x[:trials]
    sampled = posterior.sample_batched((draws,), x=x, show_progress_bars=False)

    def theirs() -> Any:
        return run_sbc(
            theta, x, Given(sampled), num_posterior_samples=draws, reduce_fns=posterior.log_prob,
            show_progress_bar=False,
        )  # fmt: skip

    def ours() -> Any:
        pooled = torch.cat([theta[None], sampled])
        with torch.no_grad():
            log_q = posterior.posterior_estimator.log_prob(pooled, condition=x).numpy()
        return randomised_pit(log_q[0][:, None], log_q[1:].T[:, :, None], rng)

    return "expected coverage by density, 20 trials x 1,000 draws", "sbi", theirs, ours, 1


def thread_errors(rng: np.random.Generator) -> Task:
    from nestcheck.error_analysis import run_std_bootstrap
    from nestcheck.estimators import logz
    from nestcheck.ns_run_utils import dict_given_run_array

    from gaugeblock.validate.evidence.bootstrap import thread_bootstrap
    from gaugeblock.validate.evidence.perfect_runs import perfect_run

    run = perfect_run(lambda v: -50 * np.exp(v / 2), live_points=400, depth=14, rng=rng)
    value = run.log_likelihood
    last = np.array([value[run.thread == k].max() for k in range(len(run.start))])
    samples = np.column_stack([value, run.thread, -np.isin(value, last).astype(float), value])
    held = dict_given_run_array(samples, np.column_stack([run.start, last]))
    return (
        f"thread bootstrap of a log evidence, {len(value):,} points, 200 resamples",
        "nestcheck",
        lambda: run_std_bootstrap(held, [logz], n_simulate=200),
        lambda: thread_bootstrap(run, rng=rng, replicates=200),
        1,
    )


def c2st(rng: np.random.Generator) -> Task:
    import torch
    from sbi.utils.metrics import c2st as theirs

    from gaugeblock.validate.learned.two_sample import classifier_two_sample

    one, other = rng.normal(size=(2000, 5)), rng.normal(0.1, 1, size=(2000, 5))
    there = [torch.as_tensor(sample, dtype=torch.float32) for sample in (one, other)]
    return (
        "C2ST by a network, 2,000 against 2,000 points of 5; ours with a p-value",
        "sbi",
        lambda: theirs(*there, classifier="mlp"),
        lambda: classifier_two_sample(one, other, rng=rng),
        2,
    )


def tarp(rng: np.random.Generator) -> Task:
    from tarp import get_tarp_coverage

    from gaugeblock.validate.joint.pool import make_pool
    from gaugeblock.validate.joint.tarp import distance_pit

    truth, draws = rng.normal(size=(1000, 5)), rng.normal(size=(1000, 250, 5))
    there = np.ascontiguousarray(draws.transpose(1, 0, 2))
    references = rng.uniform(-3, 3, size=(1000, 1, 5))
    return (
        "TARP, 1,000 trials x 250 draws x 5",
        "tarp",
        lambda: get_tarp_coverage(there, truth, norm=True),
        lambda: distance_pit(make_pool(truth, draws), references, rng),
        5,
    )


def joint_coverage(rng: np.random.Generator) -> Task:
    """Ours: TARP about eight references, projections and their gaps, each with intervals."""
    from pted import pted_coverage_test

    from gaugeblock.validate import make_trials, run_validators, trials_tree

    truth, draws = rng.normal(size=(500, 5)), rng.normal(size=(500, 250, 5))
    there = np.ascontiguousarray(draws.transpose(1, 0, 2))
    tree = trials_tree(make_trials(truth, draws, [f"p{k}" for k in range(5)]))
    return (
        "joint coverage, 500 trials x 250 draws x 5",
        "pted",
        lambda: pted_coverage_test(truth, there, permutations=200),
        lambda: run_validators(tree, seed=1, select=("joint",)),
        2,
    )


@cache
def shipped() -> tuple[Any, Any, Any]:
    """The shipped flow, sbi's estimator of the same weights, and 200 spectra."""
    import torch
    from sbi.neural_nets import posterior_nn

    import gaugeblock as gb
    from gaugeblock.simulators.xray import reference

    spectrum = reference()
    theta = spectrum.prior.sample(200, np.random.default_rng(2))
    x = np.asarray(spectrum.simulate(theta, np.random.default_rng(3)), dtype=float)
    flow = gb.load("shipped:epic-pn-medium")
    table, (*_, embedding) = flow.record["network"], flow.network.children()
    build = posterior_nn(
        "zuko_nsf", num_transforms=table["transforms"], hidden_features=list(table["hidden"]),
        num_bins=table["bins"], embedding_net=embedding, z_score_theta="none", z_score_x="none",
    )  # fmt: skip
    theirs = build(torch.randn(2, 5), torch.as_tensor(x[:2]))
    theirs.load_state_dict(flow.network.state_dict())
    return flow, theirs.eval(), x


def flow_draws(rng: np.random.Generator) -> Task:
    import torch

    flow, estimator, x = shipped()
    data = torch.as_tensor(x)

    def theirs() -> Any:
        with torch.inference_mode():
            return estimator.sample_and_log_prob(torch.Size([250]), condition=data)

    what = "draws of the shipped flow and their densities, 200 spectra x 250"
    return what, "sbi", theirs, lambda: flow.sample_and_log_prob(x, 250, rng), 2


def flow_density(rng: np.random.Generator) -> Task:
    import torch

    flow, estimator, x = shipped()
    data, theta = torch.as_tensor(x), flow.sample(x, 250, rng)
    there = torch.as_tensor(rng.normal(size=(250, 200, 5)), dtype=torch.float32)

    def theirs() -> Any:
        with torch.inference_mode():
            return estimator.log_prob(there, condition=data)

    what = "densities of the shipped flow, 200 spectra x 250"
    return what, "sbi", theirs, lambda: flow.log_prob(theta, x), 3


@cache
def spectra() -> tuple[Any, Any, Any, dict[str, Any]]:
    """The reference spectrum, jaxspec's model and observation of it, and a thousand parameters."""
    import jax
    from jaxspec.data.util import load_example_obsconf
    from jaxspec.model.additive import Blackbodyrad, Powerlaw
    from jaxspec.model.multiplicative import Tbabs

    from gaugeblock.simulators.xray import reference

    spectrum = reference()
    theta = spectrum.prior.sample(1000, np.random.default_rng(4))
    with jax.enable_x64(True):
        model = Tbabs() * (Powerlaw() + Blackbodyrad())
        return spectrum, model, load_example_obsconf("NGC7793_ULX4_PN"), theta


def xray_simulation(rng: np.random.Generator) -> Task:
    import jax
    from jaxspec.data.util import fakeit_for_multiple_parameters

    spectrum, model, observation, theta = spectra()
    given = dict(zip(spectrum.prior.names, theta.T, strict=True))

    def theirs() -> Any:
        with jax.enable_x64(True):
            return np.asarray(fakeit_for_multiple_parameters(observation, model, given))

    return (
        "1,000 spectra simulated, EPIC-pn; jaxspec compiles at each call",
        "jaxspec",
        theirs,
        lambda: spectrum.simulate(theta, rng),
        3,
    )


def xray_likelihood(rng: np.random.Generator) -> Task:
    """jaxspec's log likelihood compiled once over a batch, as its samplers run it."""
    import jax
    import numpyro.distributions as dist
    from jaxspec.fit import BayesianModel

    spectrum, model, observation, theta = spectra()
    names = [f"spectrum.{name}" for name in spectrum.prior.names]
    given = dict(zip(names, theta.T, strict=True))
    with jax.enable_x64(True):
        prior = {name: dist.Uniform(0.0, 1e3) for name in names}
        compiled = jax.jit(BayesianModel(model, prior, observation).log_likelihood_per_obs)
    x = np.asarray(spectrum.simulate(theta[:1], rng))[0]

    def theirs() -> Any:
        with jax.enable_x64(True):
            return jax.block_until_ready(compiled(given))

    return (
        "1,000 log likelihoods of one spectrum, EPIC-pn",
        "jaxspec",
        theirs,
        lambda: spectrum.log_likelihood(theta, x),
        5,
    )


def xray_posterior(rng: np.random.Generator) -> Task:
    """NUTS with as many steps of each: 500 to warm up, and every second of 2,000 kept."""
    import jax
    import numpyro.distributions as dist
    from jaxspec.fit import MCMCFitter

    from gaugeblock.estimators.nuts import Nuts

    spectrum, model, observation, theta = spectra()
    kinds = {"Uniform": dist.Uniform, "LogUniform": dist.LogUniform}
    prior = {
        f"spectrum.{name}": kinds[type(one).__name__](one.low, one.high)
        for name, one in spectrum.prior.marginals.items()
    }
    x = np.asarray(spectrum.simulate(np.repeat(theta[:1], FITTED, axis=0), rng))
    estimator = Nuts(spectrum, warmup=500, thinning=2)

    def theirs() -> None:
        with jax.enable_x64(True):
            for key in range(FITTED):
                MCMCFitter(model, prior, observation).fit(
                    key, num_chains=1, num_warmup=500, num_samples=2000,
                    mcmc_kwargs={"thinning": 2, "progress_bar": False},
                )  # fmt: skip

    return (
        f"posteriors of {FITTED} spectra, EPIC-pn, by NUTS; jaxspec compiles for each",
        "jaxspec",
        theirs,
        lambda: estimator.sample(x, 1000, rng),
        1,
    )


def whole_audit(rng: np.random.Generator) -> Task:
    """The flow of a user: what sbi's own checks take, and what the default audit does beyond them."""
    import torch
    from sbi.diagnostics import check_sbc, check_tarp, run_sbc, run_tarp
    from sbi.inference import NPE

    import gaugeblock as gb

    torch.manual_seed(0)
    prior = torch.distributions.MultivariateNormal(torch.zeros(3), torch.eye(3))  # nothing to leak from

    def simulate(theta: Any, rng: np.random.Generator) -> Any:
        return np.repeat(theta, 2, axis=1) + 0.3 * rng.normal(size=(len(theta), 6))

    theta = prior.sample((3000,))
    x = torch.as_tensor(simulate(theta.numpy(), rng), dtype=torch.float32)
    trainer = NPE(prior, show_progress_bars=False)
    with torch.enable_grad():  # BayesFlow switches gradients off for the whole process
        trainer.append_simulations(theta, x).train(max_num_epochs=20, training_batch_size=200)
    posterior = trainer.build_posterior()
    number, draws = 200, 250
    truth = prior.sample((number,))
    data = torch.as_tensor(simulate(truth.numpy(), rng), dtype=torch.float32)

    def theirs() -> None:
        settings = {"num_posterior_samples": draws, "show_progress_bar": False}
        ranks, averages = run_sbc(truth, data, posterior, **settings)
        check_sbc(ranks, truth, averages, num_posterior_samples=draws)
        check_tarp(*run_tarp(truth, data, posterior, **settings))
        run_sbc(truth, data, posterior, reduce_fns=posterior.log_prob, **settings)

    def ours() -> None:
        trials = {"number": number, "draws": draws, "importance_number": 0, "joint_number": 0}
        gb.audit(posterior, simulate, prior=prior, trials=trials, seed=1, progress=False)

    return (
        "SBC, TARP and expected coverage of a flow, 200 trials x 250 draws; ours the whole default audit",
        "sbi",
        theirs,
        ours,
        1,
    )


MADE = (
    *(sbc_ranks, ecdf_band, gamma_null, mmd_null, psis, expected_coverage, thread_errors),
    *(c2st, tarp, joint_coverage, flow_draws, flow_density),
    *(xray_simulation, xray_likelihood, xray_posterior, whole_audit),
)
TASKS = {make.__name__: make for make in MADE}
PEERS = ("sbi", "arviz-stats", "bayesflow", "nestcheck", "tarp", "pted", "jaxspec")


def seconds(function: Callable[[], Any]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    function()
    return time.process_time() - start


def row(make: Callable[[np.random.Generator], Task]) -> dict[str, Any]:
    """A task, the peer's name, and CPU seconds of both."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        what, peer, theirs, ours, times = make(np.random.default_rng(1))
        # What is imported or compiled on a first call is nobody's cost.
        theirs(), ours()
        taken = [(seconds(theirs), seconds(ours)) for _ in range(times)]
    there, here = (float(f"{min(column):.3g}") for column in zip(*taken, strict=True))
    return {"what": what, "peer": peer, "peer_s": there, "gaugeblock_s": here}


def compared(tasks: Mapping[str, Callable[[np.random.Generator], Task]], path: Path) -> None:
    """Measure each task that the file lacks, and keep it at once."""
    found = stored(path)
    rows = found.setdefault("rows", {})
    for name, make in tasks.items():
        if name not in rows:
            found["peers"] = {peer: version(peer) for peer in PEERS}
            keep_row(found, name, row(make), path, "tox -e bench")
            sys.stderr.write(f"{name}: {rows[name]}\n")


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/peers.md."""
    cells = [
        [one["what"], one["peer"], f"{one['peer_s']:.3g}", f"{one['gaugeblock_s']:.3g}", f"{ratio(one):.3g}"]
        for one in in_order(found)
    ]
    table = page.table(["task", "peer", "peer (CPU s)", "gaugeblock (CPU s)", "ratio"], cells)
    versions = ", ".join(f"{name} {number}" for name, number in found["peers"].items())
    return f"{table}\n\nPeers: {versions}. {processors(found['rows'])}"


def in_order(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows in the order of the tasks."""
    return [found["rows"][name] for name in TASKS if name in found["rows"]]


def ratio(one: Mapping[str, Any]) -> float:
    """How many times as long the peer takes."""
    return float(one["peer_s"] / one["gaugeblock_s"])


def figure(found: Mapping[str, Any]) -> Any:
    """How many times as long each peer takes, on a logarithmic axis; left of 1 the peer is faster."""
    rows = in_order(found)[::-1]
    figure, axes = plots.pyplot().subplots(figsize=(8.5, 0.3 * len(rows) + 0.8), layout="constrained")
    colours = [plots.BLUE if ratio(one) >= 1 else plots.ORANGE for one in rows]
    axes.barh(range(len(rows)), [ratio(one) - 1 for one in rows], left=1, color=colours, height=0.6)
    for place, one in enumerate(rows):
        ahead = ratio(one) >= 1
        axes.annotate(
            f"{ratio(one):.3g}", (ratio(one), place), (3 if ahead else -3, 0),
            textcoords="offset points", va="center", ha="left" if ahead else "right", fontsize=7,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.margins(x=0.12)
    axes.axvline(1, color="black", lw=0.8)
    axes.set_yticks(range(len(rows)), [f"{one['what'].partition(';')[0]} ({one['peer']})" for one in rows])
    axes.tick_params(axis="y", labelsize=7)
    axes.set_xlabel("CPU seconds of the peer over ours")
    return figure


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or make the page."""
    chosen = arguments(__doc__, "tasks", TASKS, HERE / "peers.json").parse_args(words)
    if not chosen.page:
        compared({name: TASKS[name] for name in chosen.tasks}, chosen.out)
        return 0
    found = stored(chosen.out)
    plots.draw({"peers": lambda: figure(found)}, chosen.docs / "figures")
    page.fill(chosen.docs / "peers.md", {"peers": shown(found)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
