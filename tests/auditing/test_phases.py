"""What an estimator that nobody vouches for is asked, in what order, and what that leaves of a trial."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.stats import kstest

from gaugeblock.auditing.audit import CHUNKS, audit_configured
from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.auditing.observation import trials_around
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.watch import Watch
from gaugeblock.auditing.workplace import discard
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import importance_trials, main_trials, read_policy

PLAN = Plan(
    number=60, draws=12, block=20, importance_number=10, importance_draws=30, joint_number=20, joint_draws=8,
    seed=5,
)  # fmt: skip


@pytest.fixture
def simulator() -> Any:
    return build_simulator("linear_gaussian", parameters=2, data=3)


class Recorder:
    """The exact posterior, unvouched for; it remembers what it was asked, and can be made to stop."""

    untrusted = True

    def __init__(self, simulator: Any, stop_after: int = 10**9):
        self.exact, self.stop_after = Exact(simulator), stop_after
        self.asked: list[tuple[str, Any]] = []

    def _note(self, what: str, points: Any = None) -> None:
        if len(self.asked) >= self.stop_after:
            raise InputError("stopped")
        self.asked.append((what, points))

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        self._note("sample")
        return self.exact.sample(x, n, rng)

    def log_prob(self, theta: Any, x: Any) -> Any:
        self._note("log_prob", theta)
        return self.exact.log_prob(theta, x)

    def end_phase(self) -> None:
        self.asked.append(("end", None))

    def describe(self) -> dict[str, Any]:
        return {"estimator": "recorder"}


def test_every_draw_is_in_before_any_density_is_asked_for(simulator: Any, tmp_path: Path) -> None:
    one = Recorder(simulator)
    collect(simulator, one, PLAN, tmp_path)
    words = [what for what, _ in one.asked]
    assert words == ["sample"] * 4 + ["end"] + ["log_prob"] * 4


def test_the_trials_are_those_of_an_estimator_that_is_trusted(simulator: Any, tmp_path: Path) -> None:
    trusted = collect(simulator, Exact(simulator), PLAN, tmp_path / "a")
    apart = collect(simulator, Recorder(simulator), PLAN, tmp_path / "b")
    for of in (main_trials, importance_trials):
        first, second = of(trusted), of(apart)
        assert first is not None
        assert second is not None
        xr.testing.assert_allclose(first, second, rtol=1e-10)
        assert first.attrs == second.attrs


def test_the_truth_is_anywhere_among_the_draws(simulator: Any, tmp_path: Path) -> None:
    one = Recorder(simulator)
    plan = replace(PLAN, number=2000, block=500, importance_number=0)
    theta = main_trials(collect(simulator, one, plan, tmp_path))["theta_true"].values
    points = np.concatenate([asked for what, asked in one.asked if what == "log_prob"])
    found = (points == theta[:, None]).all(axis=2)
    assert (found.sum(axis=1) == 1).all()
    # Uniform over the 13 places; the seed is fixed, and another fails in one of a thousand.
    place = (found.argmax(axis=1) + np.random.default_rng(1).random(2000)) / 13
    assert kstest(place, "uniform").pvalue > 1e-3


def test_without_densities_none_is_asked_for(simulator: Any, tmp_path: Path) -> None:
    class DrawsOnly(Recorder):
        log_prob = None  # type: ignore[assignment]

    one = DrawsOnly(simulator)
    tree = collect(simulator, one, PLAN, tmp_path)
    assert [what for what, _ in one.asked] == ["sample"] * 3 + ["end"]
    assert "log_q" not in main_trials(tree)
    assert importance_trials(tree) is None


@pytest.mark.parametrize("stop", [1, 3, 4, 5, 6, 8])
def test_stopped_in_any_phase_it_ends_in_the_same_bits(simulator: Any, tmp_path: Path, stop: int) -> None:
    whole = collect(simulator, Recorder(simulator), PLAN, tmp_path / "a")
    with pytest.raises(InputError, match="stopped"):
        collect(simulator, Recorder(simulator, stop), PLAN, tmp_path / "b")
    again = Recorder(simulator)
    resumed = collect(simulator, again, PLAN, tmp_path / "b")
    assert 0 < len(again.asked) < 9
    for of in (main_trials, importance_trials):
        xr.testing.assert_identical(of(whole), of(resumed))


def test_a_density_of_the_wrong_shape_is_named(simulator: Any, tmp_path: Path) -> None:
    class Wrong(Recorder):
        def log_prob(self, theta: Any, x: Any) -> Any:
            return np.zeros(3)

    with pytest.raises(InputError, match=r"log_q of shape \(3,\) for 20 trials; expected \(20, 13\)"):
        collect(simulator, Wrong(simulator), PLAN, tmp_path)


def test_stopped_early_it_asks_for_densities_of_the_trials_that_there_are(
    simulator: Any, tmp_path: Path
) -> None:
    class NoNumbers(Recorder):
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            return super().sample(x, n, rng) * np.nan

    one = NoNumbers(simulator)
    watch = Watch(read_policy("default"), PLAN.seed)
    tree = collect(simulator, one, replace(PLAN, importance_number=0), tmp_path, watch=watch)
    assert main_trials(tree).sizes["trial"] == 20
    assert [what for what, _ in one.asked] == ["sample", "end", "log_prob"]


def test_around_an_observation_it_is_said_who_chose_the_truths(simulator: Any) -> None:
    made = trials_around(simulator, Recorder(simulator), np.zeros(3), number=10, draws=20, seed=1)
    assert "foresee the truths" in made.attrs["caveat"]
    assert "caveat" not in trials_around(simulator, Exact(simulator), np.zeros(3), number=9, seed=1).attrs


def test_the_seed_is_of_nobodys_choice_and_kept_for_its_owner(tmp_path: Path) -> None:
    one, folder = "f" * 16, tmp_path / "chunks"
    seed = kept_seed(folder, one)
    assert seed == kept_seed(folder, one)
    assert len({kept_seed(folder, f"{number:016x}") for number in range(20)} | {seed}) == 21
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in folder.iterdir())
    (folder / f"{one}.seed").write_text("")
    assert kept_seed(folder, one) != seed
    discard(folder)
    assert not folder.exists()


MADE = """
import numpy as np
from gaugeblock.estimators.exact import Exact
class Unvouched(Exact):
    untrusted = True
    closed = 0
    def close(self):
        Unvouched.closed += 1
"""


@pytest.mark.parametrize("seed", [None, 7])
def test_an_audit_takes_a_seed_of_its_own_and_records_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int | None
) -> None:
    (tmp_path / f"unvouched_{seed}.py").write_text(MADE)
    monkeypatch.chdir(tmp_path)
    trials = {"number": 20, "draws": 10, "importance_number": 0, "joint_number": 0}
    config = AuditConfig.build(
        {
            "simulator": {"name": "linear_gaussian", "parameters": 2, "data": 3},
            "estimator": {"name": f"unvouched_{seed}:Unvouched"},
            "trials": trials if seed is None else {**trials, "seed": seed},
            "validators": ["draws"],
        }
    )
    first, second = (audit_configured(config, tmp_path / name) for name in "ab")
    seeds = [result.verdict.provenance["seed"] for result in (first, second)]
    assert len(set(seeds)) == (2 if seed is None else 1)
    assert seeds[0] == seed or seed is None
    assert not (tmp_path / "a" / CHUNKS).exists()
    import sys

    assert sys.modules[f"unvouched_{seed}"].Unvouched.closed == 2
