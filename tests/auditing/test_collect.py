import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.collect import collect, fingerprint
from gaugeblock.auditing.identity import identity
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.workplace import discard
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import importance_trials, main_trials
from gaugeblock.validate.trials import group_trials

PLAN = Plan(
    number=60,
    draws=12,
    block=20,
    importance_number=10,
    importance_draws=30,
    joint_number=20,
    joint_draws=8,
    seed=5,
)


@pytest.fixture
def simulator() -> Any:
    return build_simulator("linear_gaussian", parameters=2, data=3)


class Answers:
    """An estimator that says what it is told."""

    def __init__(self, answer: Any):
        self.answer = answer

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        return self.answer(np.asarray(x), n, rng)


class Described(Answers):
    """Says what it is, so that its chunks are known again."""

    def describe(self) -> dict[str, Any]:
        return {"answers": "as told"}


def test_trials_hold_what_the_plan_says(simulator: Any, tmp_path: Path) -> None:
    tree = collect(simulator, Exact(simulator), PLAN, tmp_path)
    main, importance = main_trials(tree), importance_trials(tree)
    assert dict(main.sizes) == {"trial": 60, "draw": 12, "parameter": 2, "channel": 3}
    assert importance is not None
    assert (importance.sizes["trial"], importance.sizes["draw"]) == (10, 30)
    assert np.array_equal(importance["theta_true"], main["theta_true"][:10])
    exact = importance["log_q"] + simulator.log_evidence(main["x"].values[:10])[:, None]
    assert np.allclose(importance["log_likelihood"] + importance["log_prior"], exact, atol=1e-9)


# The ways in which people draw their noise, of x | theta ~ N(theta, 0.3^2) or counts, three channels.
SIMULATIONS: dict[str, Callable[[Any, np.random.Generator], Any]] = {
    "normal": lambda theta, rng: rng.normal(theta @ MIX, 0.3),
    "uniform": lambda theta, rng: theta @ MIX + 0.3 * np.sqrt(12) * (rng.uniform(size=(len(theta), 3)) - 0.5),
    "gamma": lambda theta, rng: theta @ MIX + 0.3 * (rng.gamma(1.0, size=(len(theta), 3)) - 1),
    "multivariate": lambda theta, rng: (
        theta @ MIX + rng.multivariate_normal(np.zeros(3), 0.09 * np.eye(3), size=len(theta))
    ),
    "binomial": lambda theta, rng: rng.binomial(200, _logistic(theta @ MIX)),
    "binomial of many": lambda theta, rng: rng.binomial(
        np.full((len(theta), 3), 20), _logistic(theta[:, :1])
    ),
    "loop of shocks": lambda theta, rng: [row @ MIX + 0.3 * rng.standard_normal(3) for row in theta],
    "one shock for all": lambda theta, rng: theta @ MIX + 0.3 * rng.standard_normal(3),
    "bounds": lambda theta, rng: rng.integers(0, [1, 1000, 1_000_000], (len(theta), 3)) + 0 * theta[:, :1],
    "foreign seed": lambda theta, rng: (
        theta @ MIX + 0.3 * np.random.default_rng(rng.integers(2**31)).standard_normal((len(theta), 3))
    ),
    "loop": lambda theta, rng: np.stack([rng.normal(row @ MIX, 0.3) for row in theta]),
    "shuffled": lambda theta, rng: np.take_along_axis(
        rng.normal(theta @ MIX, 0.3), rng.permuted(np.tile(np.arange(3), (len(theta), 1)), axis=1), axis=1
    ),
    "choice": lambda theta, rng: theta @ MIX + rng.choice([-0.3, 0.3], (len(theta), 3)),
}
MIX = np.array([[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]])


def _logistic(z: Any) -> Any:
    return 1 / (1 + np.exp(-z))


class Own:
    """A simulator as people write it."""

    def __init__(self, simulator: Any, simulate: Any):
        self.prior, self._simulate = simulator.prior, simulate

    def simulate(self, theta: Any, rng: Any) -> Any:
        assert type(rng) is np.random.Generator
        return self._simulate(theta, rng)


def plain(x: Any, n: int, rng: Any) -> Any:
    """Draws as people write them: a loop over data, and numbers that belong to none of them."""
    assert type(rng) is np.random.Generator
    return np.stack([rng.normal(row[:2], rng.uniform(0.5, 1.0), (n, 2)) for row in np.asarray(x)])


@pytest.mark.parametrize(("block", "number"), [(1, 12), (7, 30), (200, 410)])
@pytest.mark.parametrize("name", SIMULATIONS)
def test_every_way_to_draw_gives_right_data_and_a_longer_run_begins_with_a_shorter_one(
    simulator: Any, name: str, block: int, number: int, tmp_path: Path
) -> None:
    own, short = Own(simulator, SIMULATIONS[name]), replace(PLAN, number=10, block=block)
    first = main_trials(collect(own, Answers(plain), short, tmp_path))
    longer = main_trials(collect(own, Answers(plain), replace(short, number=number), tmp_path))
    xr.testing.assert_identical(first, longer.isel(trial=slice(10)))
    theta, x = longer["theta_true"].values, longer["x"].values
    assert x.shape == (number, 3)
    assert len(np.unique(longer["draws"].values)) == longer["draws"].size
    if name == "bounds":
        assert x[:, 0].max() == 0
        assert 500 < x[:, 1].max() < 1000 < 500_000 < x[:, 2].max() < 1_000_000
        return
    mean, sd = theta @ MIX, np.full((number, 3), 0.3)
    if name.startswith("binomial"):
        mean = _logistic(theta[:, :1] if "many" in name else mean)
        count = 20 if "many" in name else 200
        mean, sd = count * mean, np.sqrt(count * mean * (1 - mean))
    if name == "shuffled":
        mean, x = mean.sum(axis=1, keepdims=True), x.sum(axis=1, keepdims=True)
        sd = np.full((number, 1), 0.3 * np.sqrt(3))
    z = (x - mean) / sd
    # Data belong to their own theta: 4.5 standard errors of a mean, and of a mean square (kurtosis 9 at
    # most). One shock for all of a block is as many shocks as there are blocks.
    if name == "one shock for all":
        assert np.ptp(z[: min(block, number)], axis=0).max() < 1e-9
        return
    assert abs(z.mean()) < 4.5 / np.sqrt(z.size)
    assert abs((z**2).mean() - 1) < 4.5 * np.sqrt(8 / z.size)


def test_blocks_have_noise_of_their_own(simulator: Any, tmp_path: Path) -> None:
    own = Own(simulator, SIMULATIONS["one shock for all"])
    main = main_trials(collect(own, Answers(plain), PLAN, tmp_path))
    shock = main["x"].values - main["theta_true"].values @ MIX
    assert [len(np.unique(shock[:, k].round(9))) for k in range(3)] == [3, 3, 3]


def test_the_last_block_is_seen_whole_and_cut(simulator: Any, tmp_path: Path) -> None:
    seen: list[int] = []
    exact = Exact(simulator)

    def counted(x: Any, n: int, rng: Any) -> Any:
        seen.append(len(x))
        return exact.sample(x, n, rng)

    plan = replace(PLAN, number=30)
    tree = collect(simulator, Answers(counted), plan, tmp_path)
    assert seen == [20, 20]
    assert main_trials(tree).sizes["trial"] == 30
    assert main_trials(tree)["trial"].values.tolist() == list(range(30))


@pytest.mark.parametrize(
    ("block", "shorter", "longer"),
    [(1, (5, 2, 4), (12, 6, 9)), *((block, (23, 10, 20), (60, 33, 45)) for block in (7, 20, 200))],
)
def test_a_shorter_run_is_the_beginning_of_a_longer_one(
    simulator: Any, block: int, shorter: tuple[int, ...], longer: tuple[int, ...], tmp_path: Path
) -> None:
    """Of all groups, bit for bit, whatever the groups' own numbers."""
    names = ("number", "importance_number", "joint_number")
    short, long = (
        collect(
            simulator,
            Exact(simulator),
            replace(PLAN, block=block, **dict(zip(names, numbers, strict=True))),
            tmp_path,
        )
        for numbers in (shorter, longer)
    )
    xr.testing.assert_identical(main_trials(short), main_trials(long).isel(trial=slice(shorter[0])))
    for group, number in zip(("importance", "joint"), shorter[1:], strict=True):
        one, other = (group_trials(tree, group) for tree in (short, long))
        assert one is not None
        assert other is not None
        assert one.sizes["trial"] == number
        xr.testing.assert_identical(one, other.isel(trial=slice(number)))


def test_another_seed_gives_other_trials_and_never_the_stored_ones(simulator: Any, tmp_path: Path) -> None:
    first = collect(simulator, Exact(simulator), PLAN, tmp_path)
    second = collect(simulator, Exact(simulator), replace(PLAN, seed=6), tmp_path)
    assert not np.array_equal(main_trials(first)["theta_true"], main_trials(second)["theta_true"])


def test_stored_chunks_are_used_and_damaged_ones_made_anew(simulator: Any, tmp_path: Path) -> None:
    calls: list[int] = []
    exact = Exact(simulator)

    def counted(x: Any, n: int, rng: Any) -> Any:
        calls.append(len(x))
        return exact.sample(x, n, rng)

    first = collect(simulator, Described(counted), PLAN, tmp_path)
    chunks = sorted(tmp_path.glob("*/trials-*.nc"))
    assert len(calls) == len(chunks) == 3
    chunks[1].write_bytes(chunks[1].read_bytes()[:1000])
    second = collect(simulator, Described(counted), PLAN, tmp_path)
    assert len(calls) == 4
    xr.testing.assert_identical(main_trials(first), main_trials(second))


def test_the_fingerprint_follows_everything_that_decides_the_bits(simulator: Any) -> None:
    other = build_simulator("linear_gaussian", parameters=2, data=3, noise=0.25)
    keys = {
        fingerprint(simulator, Exact(simulator), PLAN),
        fingerprint(other, Exact(other), PLAN),
        fingerprint(simulator, Answers(None), PLAN),
        fingerprint(simulator, Exact(simulator), replace(PLAN, draws=13)),
        fingerprint(simulator, Exact(simulator), replace(PLAN, block=21)),
    }
    assert len(keys) == 5
    assert len(identity(Answers(None))["source_sha256"]) == 64


def test_two_estimators_of_one_class_never_share_chunks(simulator: Any) -> None:
    """The published resume keys ignored what had changed, and mixed the draws of two networks."""
    weights = [np.zeros(3), np.ones(3), np.ones(3)]
    zero, one, again = (fingerprint(simulator, Answers(array), PLAN) for array in weights)
    assert zero != one == again
    opaque = Answers(lambda x: x)
    assert fingerprint(simulator, opaque, PLAN) != fingerprint(simulator, opaque, PLAN)


def test_discard_leaves_nothing(simulator: Any, tmp_path: Path) -> None:
    folder = tmp_path / "chunks"
    collect(simulator, Exact(simulator), PLAN, folder)
    discard(folder)
    assert not folder.exists()


def test_draws_of_the_wrong_shape_are_the_estimators_fault(simulator: Any, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"draws of shape \(20, 12, 3\) for 20 trials; expected \(20, 12, 2\)"
    ):
        collect(simulator, Answers(lambda x, n, rng: np.zeros((len(x), n, 3))), PLAN, tmp_path)


def test_an_estimator_that_raises_is_named(simulator: Any, tmp_path: Path) -> None:
    def fails(x: Any, n: int, rng: Any) -> Any:
        raise ValueError("no such thing")

    with pytest.raises(InputError, match="the estimator failed on trials 0 to 19: ValueError: no such thing"):
        collect(simulator, Answers(fails), PLAN, tmp_path)


def test_draws_that_are_not_finite_are_kept_to_be_judged(simulator: Any, tmp_path: Path) -> None:
    def gives_nan(x: Any, n: int, rng: Any) -> Any:
        draws = rng.standard_normal((len(x), n, 2))
        draws[0, 0, 0] = np.nan
        return draws

    tree = collect(simulator, Answers(gives_nan), PLAN, tmp_path)
    assert int(np.isnan(main_trials(tree)["draws"]).sum()) == 3


def test_data_that_are_not_finite_are_bad_input(simulator: Any, tmp_path: Path) -> None:
    class Broken:
        prior = simulator.prior

        def simulate(self, theta: Any, rng: Any) -> Any:
            x = np.zeros((len(theta), 3))
            x[4] = np.inf
            return x

    with pytest.raises(InputError, match="the simulator gave NaN or infinite data for trial 4"):
        collect(Broken(), Exact(simulator), PLAN, tmp_path)


KILLED = """
import os, signal, sys
from pathlib import Path
from gaugeblock.auditing.collect import collect
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from {module} import PLAN
simulator = build_simulator("linear_gaussian", parameters=2, data=3)
def die(what, done, total):
    if done >= 40:
        os.kill(os.getpid(), signal.SIGKILL)
collect(simulator, Exact(simulator), PLAN, Path(sys.argv[1]), progress=die)
"""


def test_killed_in_the_middle_and_run_again_gives_the_same_bits(simulator: Any, tmp_path: Path) -> None:
    undisturbed = collect(simulator, Exact(simulator), PLAN, tmp_path / "a")
    script = KILLED.replace(
        "from {module} import PLAN", f"from gaugeblock.auditing.samples import Plan\nPLAN = {PLAN!r}"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "b")], check=False, env={**os.environ}, timeout=120
    )
    assert done.returncode == -signal.SIGKILL
    assert len(list((tmp_path / "b").glob("*/trials-*.nc"))) == 2
    resumed = collect(simulator, Exact(simulator), PLAN, tmp_path / "b")
    xr.testing.assert_identical(main_trials(undisturbed), main_trials(resumed))
    first, second = importance_trials(undisturbed), importance_trials(resumed)
    assert first is not None
    assert second is not None
    xr.testing.assert_identical(first, second)
