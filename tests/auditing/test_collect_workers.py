"""Blocks filled by other processes: the same bits, whoever made them, in whatever order, however often."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any, ClassVar

import pytest
import xarray as xr

import gaugeblock as gb
from gaugeblock.auditing.collect import collect, collect_part
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.workplace import discard
from gaugeblock.core import processors
from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import opened
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator

PLAN = Plan(
    number=70,
    draws=12,
    block=10,
    importance_number=25,
    importance_draws=30,
    joint_number=40,
    joint_draws=8,
    seed=5,
)
SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=3)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes under a scheduler, as `dask scheduler` and `dask worker` would be."""
    distributed = pytest.importorskip("distributed")
    import cloudpickle

    # Estimators of this file, which workers cannot import.
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as local:
        yield local


@pytest.fixture(scope="module")
def dask(cluster: Any) -> Iterator[Executor]:
    with opened(scheduler=cluster.scheduler_address) as (executor, line):
        assert line.startswith("2 workers at tcp://127.0.0.1:")
        assert "dashboard: http://127.0.0.1:" in line
        assert executor is not None
        yield executor


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    return collected(tmp_path_factory.mktemp("alone"))


def collected(folder: Path, estimator: Any = None, plan: Plan = PLAN, **how: Any) -> xr.DataTree:
    return collect(SIMULATOR, estimator or Exact(SIMULATOR), plan, folder, **how)


class Backwards(Executor):
    """Does last what was asked for first."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Any]] = []

    def submit(self, call: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, lambda: call(*args, **kwargs)))
        if len(self.waiting) % 2 == 0:
            self.work()
        return future

    def work(self) -> None:
        while self.waiting:
            future, call = self.waiting.pop()
            future.set_result(call())


def test_the_bits_are_those_of_one_process(dask: Executor, alone: xr.DataTree, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    tree = collected(tmp_path, executor=dask, progress=lambda *said: seen.append(said))
    xr.testing.assert_identical(tree, alone)
    assert [said for said in seen if said[0] == "trials"] == [("trials", 10 * k, 70) for k in range(8)]
    assert seen[-1] == ("joint likelihood", 40, 40)
    made = {path.name for path in tmp_path.glob("*/*")}
    assert {"trials-00000060.nc", "importance-sampling-00000020.nc", "processor.json"} <= made
    assert not [name for name in made if "pickle" in name]
    discard(tmp_path)
    assert not tmp_path.exists()


def test_neither_order_nor_who_made_what_matters(
    alone: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = replace(PLAN, number=80, importance_number=40, joint_number=40)  # pairs of blocks
    tree = collected(tmp_path / "back", plan=plan, executor=Backwards())
    xr.testing.assert_identical(tree, collected(tmp_path / "on", plan=plan))
    for part in ((2, 3), (3, 3), (1, 3)):
        collect_part(SIMULATOR, Exact(SIMULATOR), PLAN, tmp_path / "parts", part)
    # Nothing is left to do.
    monkeypatch.setattr(Exact, "sample", None)
    monkeypatch.setattr(Exact, "sample_and_log_prob", None, raising=False)
    xr.testing.assert_identical(collected(tmp_path / "parts"), alone)


class Slowly(Executor):
    """Does last what was asked for first, one thing after the other, while others go on."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Any]] = []

    def submit(self, call: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.waiting.append((Future(), lambda: call(*args, **kwargs)))
        if len(self.waiting) == PLAN.number // PLAN.block:
            Thread(target=self._work).start()
        return self.waiting[-1][0]

    def _work(self) -> None:
        for future, call in reversed(self.waiting):
            call()
            future.set_result(None)
            time.sleep(0.02)


def test_a_block_is_looked_at_once_it_is_there_and_in_its_turn(tmp_path: Path) -> None:
    class Seeing:
        trials: ClassVar[list[int]] = []

        def see(self, block: xr.Dataset) -> bool:
            self.trials += block["trial"].values.tolist()
            return False

    plan = replace(PLAN, importance_number=0, joint_number=0)
    watch: Any = Seeing()
    collected(tmp_path, plan=plan, executor=Slowly(), watch=watch)
    assert watch.trials == list(range(70))


class Mortal(Exact):
    """Kills its process the first time that it is asked, anywhere."""

    def __init__(self, simulator: Any, mark: Path):
        super().__init__(simulator)
        self.mark = mark

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        try:
            self.mark.touch(exist_ok=False)
        except FileExistsError:
            return super().sample(x, n, rng)
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # sockets of the worker that is killed
def test_a_worker_that_is_killed_changes_nothing(dask: Executor, alone: xr.DataTree, tmp_path: Path) -> None:
    tree = collected(tmp_path, Mortal(SIMULATOR, tmp_path / "killed"), executor=dask)
    assert (tmp_path / "killed").exists()
    xr.testing.assert_identical(tree, alone)


def test_a_process_that_is_killed_is_one_line_and_the_next_run_goes_on(
    alone: xr.DataTree, tmp_path: Path
) -> None:
    pytest.importorskip("cloudpickle").register_pickle_by_value(sys.modules[__name__])
    mortal = Mortal(SIMULATOR, tmp_path / "killed")
    with opened(workers=2) as (executor, _), pytest.raises(InputError, match="a worker could not go on"):
        collected(tmp_path, mortal, executor=executor)
    xr.testing.assert_identical(collected(tmp_path, mortal), alone)


def test_late_duplicates_change_nothing(dask: Executor, alone: xr.DataTree, tmp_path: Path) -> None:
    """Two runs at once on the same folder: every block may be made twice, and written after it was read."""
    with ThreadPoolExecutor(2) as both:
        trees = [both.submit(collected, tmp_path, executor=dask) for _ in range(2)]
        for tree in trees:
            xr.testing.assert_identical(tree.result(), alone)


def test_what_an_estimator_does_wrong_is_said_of_its_trials(dask: Executor, tmp_path: Path) -> None:
    class Wrong(Exact):
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            raise ValueError("no such thing")

    with pytest.raises(InputError, match=r"^the estimator failed on trials \d+ to \d+: ValueError: no such"):
        collected(tmp_path, Wrong(SIMULATOR), executor=dask)


def test_workers_with_other_versions_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import gaugeblock.auditing.filling as module

    monkeypatch.setattr(module, "_versions_here", lambda: {"numpy": "1.0"})
    with pytest.raises(InputError, match=r"other versions .*numpy 1.0, not 2.*install the same there"):
        collected(tmp_path)


def test_other_processors_are_refused_or_known_as_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = Exact(SIMULATOR)
    collect_part(SIMULATOR, exact, PLAN, tmp_path, (1, 2))
    here = processors.processor()
    monkeypatch.setattr(processors, "processor", lambda: "Chip B")
    with pytest.raises(InputError, match=r"is Chip B, which may round otherwise"):
        collect_part(SIMULATOR, exact, PLAN, tmp_path, (2, 2))
    collect_part(SIMULATOR, exact, PLAN, tmp_path, (2, 2), allow_mixed=True)
    with pytest.raises(InputError, match="and on Chip B"):
        collected(tmp_path)
    collected(tmp_path, allow_mixed=True)
    assert processors.kinds(next(tmp_path.glob("*/")), mixed=True) == [here, "Chip B"]


def test_another_device_of_the_estimator_is_another_processor(tmp_path: Path) -> None:
    exact = Exact(SIMULATOR)
    collect_part(SIMULATOR, exact, PLAN, tmp_path, (1, 2))
    vars(exact)["device"] = "mps:0"
    with pytest.raises(InputError, match=r"\(cpu\), and \S+ is .*torch on mps:0\), which"):
        collect_part(SIMULATOR, exact, PLAN, tmp_path, (2, 2))


def test_parts_of_another_plan_are_refused_by_name(tmp_path: Path) -> None:
    exact = Exact(SIMULATOR)
    assert collect_part(SIMULATOR, exact, PLAN, tmp_path, (2, 4)) == 2 + 1 + 1
    for plan, said in (
        (replace(PLAN, draws=13), "draws 12 there, 13 here"),
        (replace(PLAN, seed=6), "seed 5 there, 6 here"),
    ):
        with pytest.raises(InputError, match=f"parts of another plan \\({said}\\)"):
            collect_part(SIMULATOR, exact, plan, tmp_path, (1, 4))
        with pytest.raises(InputError, match=said):
            collected(tmp_path, plan=plan)
    other = build_simulator("linear_gaussian", parameters=2, data=3, noise=0.25)
    with pytest.raises(InputError, match=r"\(another simulator or estimator\)"):
        collect_part(other, Exact(other), PLAN, tmp_path, (1, 4))
    (tmp_path / "parts.json").write_text("[]")
    with pytest.raises(InputError, match="its record is damaged"):
        collect_part(SIMULATOR, exact, PLAN, tmp_path, (1, 4))


def test_parts_of_what_cannot_be_known_again_are_refused(tmp_path: Path) -> None:
    class Opaque(Exact):
        def __reduce__(self) -> Any:
            raise TypeError

        describe = None

    with pytest.raises(InputError, match="cannot be told from another's"):
        collect_part(SIMULATOR, Opaque(SIMULATOR), PLAN, tmp_path, (1, 2))


def test_a_whole_audit_through_any_executor(dask: Executor, tmp_path: Path) -> None:
    """Findings, verdict and reports too, where it stops early as well; and the record names the processor."""
    quick: dict[str, Any] = {"validators": ["sbc"], "progress": False}
    trials = {"number": 60, "block": 20, "importance_number": 20, "joint_number": 40, "draws": 20}
    engines = {"one": None, "many": dask, "threads": ThreadPoolExecutor(2)}
    for name, executor in engines.items():
        quick["executor"] = executor
        result = gb.audit(Exact(SIMULATOR), SIMULATOR, trials=trials, out=tmp_path / name, **quick)
        assert result.verdict.provenance["processors"] == [processors.processor()]
        assert result.verdict.provenance["equal_bits"] is True
        assert not (tmp_path / name / ".chunks").exists()
    for file in ("trials.nc", "verdict.json", "findings.nc", "report.html"):
        assert len({(tmp_path / name / file).read_bytes() for name in engines}) == 1, file


def test_an_audit_that_stops_early_stops_at_the_same_trial(dask: Executor, tmp_path: Path) -> None:
    biased = Shifted(SIMULATOR)
    how: dict[str, Any] = {
        "trials": {"number": 600, "block": 20, "anytime": True, "draws": 20},
    }
    how |= {"validators": ["sbc"], "progress": False}
    one = gb.audit(biased, SIMULATOR, **how)
    many = gb.audit(biased, SIMULATOR, out=tmp_path / "many", executor=dask, **how)
    assert one.trials.sizes["trial"] == many.trials.sizes["trial"] < 600
    xr.testing.assert_identical(one.trials, many.trials)


class Shifted(Exact):
    """Two half-widths beside the truth."""

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        return super().sample(x, n, rng) + 2.0


def test_an_estimator_nobody_vouches_for_answers_one_process(tmp_path: Path) -> None:
    class Stranger(Exact):
        untrusted = True

    with ThreadPoolExecutor(1) as threads, pytest.raises(InputError, match="answers one process alone"):
        gb.audit(Stranger(SIMULATOR), SIMULATOR, executor=threads)


class Hungry(Exact):
    """Fills the disk of its process: no file of it may grow any more. Its workers are of no further use."""

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
        return super().sample(x, n, rng)


# The last that asks these workers.
def test_a_full_disk_is_one_line(dask: Executor, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write \S+/trials-\d+.nc: .*disk may be full"):
        collected(tmp_path, Hungry(SIMULATOR), executor=dask)
    # Another worker may be in the middle of a file that has no name yet.
    assert not list(tmp_path.glob("*/[!.]*.nc"))
