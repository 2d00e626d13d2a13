"""Whatever package the draws come from, the Trials are the same to the bit, and so is the verdict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

import gaugeblock
from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, judge, read_policy, run_validators, trials_tree


def bayesflow(drawn) -> xr.Dataset:
    samples = {"mu": drawn.draws[..., :1], "tau": drawn.draws[..., 1:]}
    simulations = {"mu": drawn.theta[:, :1], "tau": drawn.theta[:, 1:], "y": drawn.x}
    return gaugeblock.trials_from_bayesflow(samples, simulations, x="y")


def numpyro_stacked(drawn) -> xr.Dataset:
    samples = {"mu": drawn.chains[..., 0], "tau": drawn.chains[..., 1:]}
    truths = {"mu": drawn.theta[:, 0], "tau": drawn.theta[:, 1:], "y": drawn.x}
    return gaugeblock.trials_from_numpyro(samples, truths, x="y", autocorrelated=False)


class Run:
    """As an MCMC that was run."""

    def __init__(self, chains: np.ndarray):
        self.chains = chains

    def get_samples(self, group_by_chain: bool = False) -> dict[str, np.ndarray]:
        assert group_by_chain
        return {"mu": self.chains[..., 0], "tau": self.chains[..., 1:]}


def numpyro_runs(drawn) -> xr.Dataset:
    truths = [{"mu": theta[0], "tau": theta[1:]} for theta in drawn.theta]
    runs = [Run(chains) for chains in drawn.chains]
    return gaugeblock.trials_from_numpyro(runs, truths, x=drawn.x, autocorrelated=False)


def groups(drawn) -> dict[str, xr.Dataset]:
    """ArviZ's groups, with the prior as one chain, as ArviZ draws it."""
    chains = drawn.chains
    return {
        "posterior": xr.Dataset(
            {
                "mu": (("trial", "chain", "draw"), chains[..., 0]),
                "tau": (("k", "trial", "chain", "draw"), np.moveaxis(chains[..., 1:], -1, 0)),
            }
        ),
        "prior": xr.Dataset(
            {
                "mu": (("chain", "draw"), drawn.theta[None, :, 0]),
                "tau": (("chain", "draw", "k"), drawn.theta[None, :, 1:]),
            }
        ),
        "prior_predictive": xr.Dataset({"y": (("chain", "draw", "channel"), drawn.x[None])}),
    }


def arviz(drawn) -> xr.Dataset:
    return gaugeblock.trials_from_arviz(xr.DataTree.from_dict(groups(drawn)), autocorrelated=False)


def arviz_list(drawn) -> xr.Dataset:
    """Fits and truths as simuk keeps them."""
    posterior = groups(drawn)["posterior"]
    fits = [posterior.isel(trial=number).stack(sample=("chain", "draw")) for number in range(len(drawn.x))]
    truths = groups(drawn)["prior"].stack(sample=("chain", "draw"))
    trials = gaugeblock.trials_from_arviz(fits, truths, x=drawn.x)
    assert trials.attrs.pop("autocorrelated") == 1
    return trials


ROUTES = [bayesflow, numpyro_stacked, numpyro_runs, arviz, arviz_list]


@pytest.mark.parametrize("route", ROUTES)
def test_every_route_gives_the_direct_trials_to_the_bit(route: Callable, drawn) -> None:
    xr.testing.assert_identical(route(drawn), drawn.direct)


def test_chains_are_marked_and_thinned(drawn) -> None:
    """Each draw repeated four times, as a sticky chain does: a quarter of them counts."""
    sticky = np.repeat(drawn.draws, 4, axis=1).reshape(len(drawn.draws), 2, -1, 3)
    truths = {"theta": drawn.theta}
    trials = gaugeblock.trials_from_numpyro({"theta": sticky}, truths)
    assert trials.attrs["autocorrelated"] == 1
    findings, not_checked = run_validators(trials_tree(trials), seed=1, select=["sbc"])
    assert any("draws depend on their order" in said for f in findings for said in f.caveats)
    assert any("50 are needed" in item.why for item in not_checked) == (drawn.draws.shape[1] < 50)


@pytest.mark.parametrize("route", [bayesflow, arviz])
def test_a_posterior_half_as_wide_fails_by_every_route(route: Callable, narrow) -> None:
    findings, not_checked = run_validators(trials_tree(route(narrow)), seed=1, select=["sbc", "coverage"])
    verdict = judge(findings, not_checked, read_policy("default"), seed=1)
    assert verdict.outcome is Outcome.FAIL
    failed = {gate.id for gate in verdict.gates if gate.outcome is Outcome.FAIL}
    assert {"sbc.log_width[mu]", "sbc.log_width[tau[1]]", "coverage.central"} <= failed


ONES = np.ones((5, 8, 2))
TRUE = {"a": np.ones((5, 2))}


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: gaugeblock.trials_from_bayesflow({"b": ONES}, TRUE), "no truths of b"),
        (
            lambda: gaugeblock.trials_from_bayesflow({"a": ONES}, TRUE, names=["c"]),
            "no draws of c; there are a",
        ),
        (
            lambda: gaugeblock.trials_from_bayesflow({"a": ONES.swapaxes(0, 1)}, TRUE),
            r"look like \(draw, trial, ...\): exchange their first two axes",
        ),
        (
            lambda: gaugeblock.trials_from_bayesflow({"a": ONES[:4]}, TRUE),
            "draws of 4 trials and truths of 5",
        ),
        (lambda: gaugeblock.trials_from_bayesflow(ONES, TRUE), "expected the dictionary of arrays"),
        (lambda: gaugeblock.trials_from_bayesflow({"a": ONES}, TRUE, x="y"), "no data 'y' among the simul"),
        (
            lambda: gaugeblock.trials_from_bayesflow({"a": ONES}, TRUE, x=np.ones((4, 2))),
            "must be the 5 trials",
        ),
        (lambda: gaugeblock.trials_from_bayesflow({"a": ONES.astype(str)}, TRUE), "must hold real numbers"),
        (lambda: gaugeblock.trials_from_numpyro(Run(ONES), TRUE), "one MCMC is one trial"),
        (
            lambda: gaugeblock.trials_from_numpyro({"a": np.ones((5, 8, 2))}, {"a": np.ones(5)}),
            "8 chains of 2 draws",
        ),
        (
            lambda: gaugeblock.trials_from_numpyro([{"a": np.ones(8)}, {"a": np.ones(9)}], {"a": np.ones(2)}),
            r"trial 1 has shape \(9,\), trial 0 \(8,\)",
        ),
        (
            lambda: gaugeblock.trials_from_numpyro([{"a": np.ones(8)}, {}], {"a": np.ones(2)}),
            "trial 1 has none",
        ),
        (lambda: gaugeblock.trials_from_arviz(3), "got int; expected a DataTree"),
        (lambda: gaugeblock.trials_from_arviz([]), "the list of fits is empty"),
    ],
)
def test_what_does_not_fit_is_one_line(call: Callable, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_only_what_is_exported_is_there() -> None:
    assert all(callable(getattr(gaugeblock, name)) for name in gaugeblock.__all__ if name != "__version__")
    with pytest.raises(AttributeError, match="no attribute 'trials_from_stan'"):
        gaugeblock.trials_from_stan  # noqa: B018
