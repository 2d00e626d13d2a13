"""What an estimator that nobody vouches for is asked, in what order, and what that leaves of a trial."""

from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.stats import kstest

from gaugeblock.auditing.audit import audit, audit_configured
from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.auditing.observation import trials_around
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.watch import Watch
from gaugeblock.auditing.workplace import CHUNKS, discard
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

    @property
    def phases(self) -> list[str]:
        """What it was asked, without repetition; each question comes in many calls."""
        return [word for word, _ in groupby(what for what, _ in self.asked)]


def test_every_draw_is_in_before_any_density_is_asked_for(simulator: Any, tmp_path: Path) -> None:
    one = Recorder(simulator)
    collect(simulator, one, PLAN, tmp_path)
    assert one.phases == ["sample", "end", "log_prob"]
    # Three blocks of 20 trials and one for importance sampling, in each of them one twice.
    rows = [len(points) for what, points in one.asked if what == "log_prob"]
    assert sum(rows) == 4 * (20 + 1)
    assert len(set(rows)) > 1


def test_truths_and_data_are_those_of_an_estimator_that_is_trusted(simulator: Any, tmp_path: Path) -> None:
    """Draws are other ones, as they are asked for in other calls; densities are theirs, row by row."""
    trusted = collect(simulator, Exact(simulator), PLAN, tmp_path / "a")
    apart = collect(simulator, Recorder(simulator), PLAN, tmp_path / "b")
    for of in (main_trials, importance_trials):
        first, second = of(trusted), of(apart)
        assert first is not None
        assert second is not None
        assert first.sizes == second.sizes
        assert first.attrs == second.attrs
        xr.testing.assert_identical(first["theta_true"], second["theta_true"])
    main, other = main_trials(apart), importance_trials(apart)
    exact = Exact(simulator).log_prob(main["draws"].values, main["x"].values)
    np.testing.assert_allclose(main["log_q"].values, exact, rtol=1e-10)
    # What an exact density leaves of likelihood and prior is the evidence, one of each trial.
    assert other is not None
    evidence = (other["log_likelihood"] + other["log_prior"] - other["log_q"]).values
    np.testing.assert_allclose(evidence, evidence[:, :1] + np.zeros(evidence.shape), rtol=1e-9)


def test_the_truth_is_anywhere_among_the_draws(simulator: Any, tmp_path: Path) -> None:
    one = Recorder(simulator)
    plan = replace(PLAN, number=2000, block=500, importance_number=0)
    theta = main_trials(collect(simulator, one, plan, tmp_path))["theta_true"].values
    points = np.concatenate([asked for what, asked in one.asked if what == "log_prob"])
    known = {truth.tobytes() for truth in theta}
    found = np.array([[point.tobytes() in known for point in row] for row in points])
    assert (found.sum(axis=1) == 1).all()
    # One in sixteen is asked about twice, and has its truth in the same place.
    truths, first = np.unique(points[found], axis=0, return_index=True)
    assert len(truths) == 2000
    # Uniform over the 13 places; the seed is fixed, and another fails in one of a thousand.
    place = (found.argmax(axis=1)[first] + np.random.default_rng(1).random(2000)) / 13
    assert kstest(place, "uniform").pvalue > 1e-3


def test_without_densities_none_is_asked_for(simulator: Any, tmp_path: Path) -> None:
    class DrawsOnly(Recorder):
        log_prob = None  # type: ignore[assignment]

    one = DrawsOnly(simulator)
    tree = collect(simulator, one, PLAN, tmp_path)
    assert one.phases == ["sample", "end"]
    assert "log_q" not in main_trials(tree)
    assert importance_trials(tree) is None


@pytest.mark.parametrize("share", [0.01, 0.3, 0.5, 0.6, 0.8, 0.95])
def test_stopped_in_any_phase_it_ends_in_the_same_bits(simulator: Any, tmp_path: Path, share: float) -> None:
    once, again = Recorder(simulator), Recorder(simulator)
    whole = collect(simulator, once, PLAN, tmp_path / "a")
    stop = int(share * len(once.asked))
    with pytest.raises(InputError, match="stopped"):
        collect(simulator, Recorder(simulator, stop), PLAN, tmp_path / "b")
    resumed = collect(simulator, again, PLAN, tmp_path / "b")
    # What was finished is not asked for again; of four blocks one is not.
    assert 0.7 * (1 - share) < len(again.asked) / len(once.asked) < min(1 - share + 0.25, 1.01)
    for of in (main_trials, importance_trials):
        xr.testing.assert_identical(of(whole), of(resumed))


def test_a_density_of_the_wrong_shape_is_named(simulator: Any, tmp_path: Path) -> None:
    class Wrong(Recorder):
        def log_prob(self, theta: Any, x: Any) -> Any:
            return np.zeros(3)

    with pytest.raises(InputError, match=r"log_q of shape \(3,\) for (\d+) trials; expected \(\1, 13\)"):
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
    assert one.phases == ["sample", "end", "log_prob"]


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


def test_after_an_audit_it_has_forgotten_what_it_was_asked_last(simulator: Any) -> None:
    one = Recorder(simulator)
    table = {"number": 20, "draws": 12, "block": 20, "importance_number": 0, "joint_number": 0, "seed": 3}
    audit(one, simulator, trials=table, validators=("draws",), progress=False)
    assert one.phases == ["sample", "end", "log_prob", "end"]
