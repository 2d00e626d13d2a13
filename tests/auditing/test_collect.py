import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.collect import collect, discard, fingerprint
from gaugeblock.auditing.identity import identity
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import importance_trials, main_trials

PLAN = Plan(
    number=60,
    draws=12,
    chunk=20,
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


def test_chunks_do_not_change_the_trials(simulator: Any, tmp_path: Path) -> None:
    whole = collect(simulator, Exact(simulator), replace(PLAN, chunk=60), tmp_path / "a")
    parts = collect(simulator, Exact(simulator), replace(PLAN, chunk=7), tmp_path / "b")
    xr.testing.assert_allclose(main_trials(whole), main_trials(parts), rtol=1e-12)
    assert np.array_equal(main_trials(whole)["theta_true"], main_trials(parts)["theta_true"])


def test_a_shorter_run_is_the_beginning_of_a_longer_one(simulator: Any, tmp_path: Path) -> None:
    short = collect(simulator, Exact(simulator), replace(PLAN, number=20), tmp_path)
    long = collect(simulator, Exact(simulator), PLAN, tmp_path)
    assert np.array_equal(main_trials(short)["draws"], main_trials(long)["draws"][:20])


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
        fingerprint(simulator, Exact(simulator), replace(PLAN, chunk=21)),
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
