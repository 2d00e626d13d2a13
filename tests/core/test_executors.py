"""Any executor does what this process would do, and what can go wrong on the way is one line."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info

from gaugeblock.core import executors
from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.core.executors import Packer, each, opened, parse_part


def square(folder: Path, number: int) -> None:
    """A task, of built-in functions alone where it goes to other processes."""
    (folder / str(number)).write_text(f"{number**2} {os.getpid()}")


def told(source: str) -> Any:
    """Work that other processes can load without this file: Python, with the task as `task`."""
    return partial(_run, source)


# Sent by value, as what is defined in a notebook is.
_run: Any = eval("lambda source, task: exec(source, {'task': task})")


@pytest.fixture(scope="module")
def pool() -> Iterator[Executor]:
    with opened(workers=2) as (executor, line):
        assert line == "2 workers"
        assert executor is not None
        yield executor


def test_without_an_executor_tasks_are_done_here_and_in_order(tmp_path: Path) -> None:
    with opened() as (executor, line):
        assert (executor, line) == (None, "")
        assert os.environ["NPROC"] == "1"
    assert list(each(partial(square, tmp_path), range(5), folder=tmp_path)) == [0, 1, 2, 3, 4]
    assert (tmp_path / "3").read_text() == f"9 {os.getpid()}"


def test_ending_early_leaves_the_rest(tmp_path: Path) -> None:
    doing = each(partial(square, tmp_path), range(5), folder=tmp_path)
    assert next(doing) == 0
    doing.close()
    assert {path.name for path in tmp_path.iterdir()} == {"0"}


def test_processes_do_all_of_it_on_one_thread_and_leave_nothing(pool: Executor, tmp_path: Path) -> None:
    pytest.importorskip("cloudpickle")
    work = told(
        "import os, numpy, pathlib, threadpoolctl as t;"
        f"pathlib.Path({str(tmp_path)!r}, str(task)).write_text("
        'f\'{os.getpid()} {max(i["num_threads"] for i in t.threadpool_info())} {os.environ["NPROC"]}\')'
    )
    assert sorted(each(work, range(6), folder=tmp_path, executor=pool)) == list(range(6))
    said = [path.read_text().split() for path in sorted(tmp_path.iterdir())]
    assert len(said) == 6
    assert str(os.getpid()) not in {pid for pid, _, _ in said}
    assert {(threads, cores) for _, threads, cores in said} == {("1", "1")}
    assert os.environ.get("NPROC") == "1"  # inherited; given back when the pool is closed


def test_one_thread_here_too_and_only_as_long_as_it_lasts(tmp_path: Path) -> None:
    from threadpoolctl import threadpool_limits

    seen = []

    def look(task: int) -> None:
        seen.append({pool["num_threads"] for pool in threadpool_info()})

    with threadpool_limits(2):
        list(each(look, [0], folder=tmp_path))
        assert seen == [{1}]
        assert {pool["num_threads"] for pool in threadpool_info()} == {2}


def test_a_process_of_several_threads_does_one_task_at_a_time(tmp_path: Path) -> None:
    busy: list[int] = []

    class Alone:
        def __call__(self, task: int) -> None:
            busy.append(task)
            time.sleep(0.01)
            assert busy == [task], "two at a time"
            assert {pool["num_threads"] for pool in threadpool_info()} == {1}
            busy.clear()

    with ThreadPoolExecutor(4) as threads, pytest.MonkeyPatch.context() as patch:
        patch.setattr(executors, "_received", lambda path, sha256: Alone())
        assert sorted(each(print, range(8), folder=tmp_path, executor=threads)) == list(range(8))


def test_work_is_read_once_by_a_process(tmp_path: Path) -> None:
    work = partial(square, tmp_path)
    with ThreadPoolExecutor(2) as threads, executors._sent(work, tmp_path) as sent:
        assert list(threads.map(sent, [1])) == [None]
        sent.path.write_bytes(b"no longer read")
        list(threads.map(sent, range(2, 9)))
    assert {path.name for path in tmp_path.iterdir()} == set("12345678")
    # Of the last work alone: what it holds may be large.
    (tmp_path / "other").mkdir()
    work = partial(square, tmp_path / "other")
    with ThreadPoolExecutor(1) as threads, executors._sent(work, tmp_path) as other:
        list(threads.map(other, [9]))
        assert other.sha256 != sent.sha256
        assert list(executors._LATEST) == [other.sha256]


def test_work_that_was_changed_on_its_way_is_not_loaded(tmp_path: Path) -> None:
    with executors._sent(partial(square, tmp_path, 0), tmp_path) as sent:
        sent.path.write_bytes(b"cos\nsystem\n(S'touch harm'\ntR.")
        with pytest.raises(InputError, match=r"sent-\w+.pickle: is not what was written"):
            sent(1)


def test_a_folder_that_a_worker_does_not_see_is_named(tmp_path: Path) -> None:
    with executors._sent(partial(square, tmp_path, 1), tmp_path) as sent:
        pass
    with pytest.raises(InputError, match=r"cannot read .*every worker must see the folder"):
        sent(1)


def test_large_parts_of_tasks_are_loaded_once_and_stay(tmp_path: Path) -> None:
    part = bytearray(b"large")
    packer = Packer(tmp_path, lambda value: isinstance(value, bytearray | list))
    first, second = packer.pack((1, part), turn=0).task(), packer.pack((2, [part]), turn=0).task()
    assert (first, second) == ((1, part), (2, [part]))
    assert second[1][0] is first[1] is not part
    assert packer.pack(part, turn=0).task() is first[1]
    assert len(list(tmp_path.glob("kept-*.pickle"))) == 2
    # Of another folder, another run: nothing of this one stays.
    (tmp_path / "other").mkdir()
    Packer(tmp_path / "other", lambda value: isinstance(value, set)).pack({1}, turn=0).task()
    assert packer.pack(part, turn=0).task() is not first[1]


def test_parts_that_nobody_has_used_for_three_turns_are_forgotten(tmp_path: Path) -> None:
    """One that is held by another is used with it."""
    inner, other = bytearray(b"inner"), bytearray(b"other")
    outer = [inner]
    packer = Packer(tmp_path, lambda value: isinstance(value, bytearray | list))
    first = packer.pack((outer, other), turn=5).task()
    for turn in (6, 7, 8):
        assert packer.pack(outer, turn=turn).task() is first[0]
    assert packer.pack(other, turn=8).task() is first[1]
    packer.pack(outer, turn=11).task()
    assert packer.pack(other, turn=11).task() is first[1]
    packer.pack(outer, turn=15).task()
    assert packer.pack(inner, turn=15).task() is first[0][0]
    assert packer.pack(other, turn=15).task() is not first[1]


def test_a_part_that_was_changed_on_its_way_is_not_loaded(tmp_path: Path) -> None:
    packed = Packer(tmp_path, lambda value: isinstance(value, set)).pack({3}, turn=0)
    next(tmp_path.iterdir()).write_bytes(b"cos\nsystem\n(S'touch harm'\ntR.")
    with pytest.raises(InputError, match=r"kept-\w+.pickle: is not what was written"):
        packed.task()


def test_what_cannot_be_sent_is_told(tmp_path: Path) -> None:
    class Opaque:
        def __call__(self, task: int) -> None: ...
        def __reduce__(self) -> Any:
            raise TypeError("holds a socket")

    with (
        ThreadPoolExecutor(1) as threads,
        pytest.raises(InputError, match=r"cannot be sent to other processes \(holds a socket\)"),
    ):
        list(each(Opaque(), [1], folder=tmp_path, executor=threads))


def test_what_workers_do_not_have_is_named(pool: Executor, tmp_path: Path) -> None:
    class Elsewhere:
        def __call__(self, task: int) -> None: ...
        def __reduce__(self) -> Any:
            return exec, ("import nowhere_to_be_found",)

    with pytest.raises(InputError, match=r"cannot load what is audited .*nowhere_to_be_found"):
        list(each(Elsewhere(), [1], folder=tmp_path, executor=pool))


def test_what_gaugeblock_says_in_a_process_is_said_here(pool: Executor, tmp_path: Path) -> None:
    pytest.importorskip("cloudpickle")
    work = told("from gaugeblock.core.errors import InputError; raise InputError('too many of them')")
    with pytest.raises(InputError, match=r"^too many of them$"):
        list(each(work, range(3), folder=tmp_path, executor=pool))
    with pytest.raises(InputError, match=r"a worker could not go on .*ZeroDivisionError"):
        list(each(told("1 / 0"), range(3), folder=tmp_path, executor=pool))
    assert not list(tmp_path.iterdir())


def test_a_process_that_is_killed_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("cloudpickle")
    work = told("import os; os.kill(os.getpid(), 9)")
    with (
        opened(workers=2) as (executor, _),
        pytest.raises(InputError, match=r"a worker could not go on .*BrokenProcessPool.* goes on where"),
    ):
        list(each(work, range(3), folder=tmp_path, executor=executor))


ORPHANS = """
import sys, os, time
from functools import partial
from pathlib import Path
from gaugeblock.core.executors import each, opened
if __name__ == "__main__":
    work = partial(exec, "import os, time; open(str(os.getpid()), 'w').close(); time.sleep(60)")
    with opened(workers=2) as (executor, _):
        list(each(work, [{}, {}], folder=Path.cwd(), executor=executor))
"""


def test_processes_do_not_outlive_who_began_them(tmp_path: Path) -> None:
    (tmp_path / "begin.py").write_text(ORPHANS)
    began = subprocess.Popen([sys.executable, "begin.py"], cwd=tmp_path)
    deadline = time.monotonic() + 60
    while len(pids := [int(path.name) for path in tmp_path.iterdir() if path.name.isdigit()]) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    began.send_signal(signal.SIGKILL)
    began.wait()
    while any(Path(f"/proc/{pid}").exists() and _alive(pid) for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0/4", "counted from 1 to 4"),
        ("5/4", "counted from 1"),
        ("1/0", "counted"),
        ("two", "must be i/N"),
    ],
)
def test_a_part_that_is_none(text: str, said: str) -> None:
    with pytest.raises(InputError, match=f"--part {text}: .*{said}"):
        parse_part(text)
    assert parse_part("4/4") == (4, 4)


def test_processes_end_with_the_block() -> None:
    with opened(workers=2) as (executor, _):
        assert executor is not None
    with pytest.raises(RuntimeError, match="after shutdown"):
        executor.submit(print)


def test_workers_that_cannot_be() -> None:
    with pytest.raises(InputError, match="--workers 0: must be 1 or more"), opened(workers=0):
        pass
    with pytest.raises(InputError, match="give one of them"), opened(workers=2, scheduler="tcp://x:1"):
        pass


def test_without_dask_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(MissingExtraError, match=r"gaugeblock\[distributed\]"),
        opened(scheduler="tcp://127.0.0.1:8786"),
    ):
        pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere://there"])
def test_a_scheduler_that_does_not_answer_is_named(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "PATIENCE", 0.5)
    with (
        pytest.raises(InputError, match=f"--scheduler {address}: no scheduler answers"),
        opened(scheduler=address),
    ):
        pass


def test_what_processes_inherit_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, *_ = executors.SINGLE
    monkeypatch.setenv(first, "7")
    monkeypatch.delenv(second, raising=False)
    with opened() as (executor, line):
        assert (executor, line) == (None, "")
        assert [os.environ[name] for name in executors.SINGLE] == ["1"] * len(executors.SINGLE)
    assert os.environ[first] == "7"
    assert second not in os.environ


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0/4", "--part 0/4: parts are counted from 1 to 4"),
        ("5/4", "--part 5/4: parts are counted from 1 to 4"),
        ("1/0", "--part 1/0: parts are counted from 1 to 0"),
        ("1-4", "--part 1-4: must be i/N, as in --part 3/8"),
        ("1/4/2", "--part 1/4/2: must be i/N, as in --part 3/8"),
        ("1/1234567890", "--part 1/1234567890: must be i/N, as in --part 3/8"),
    ],
)
def test_parts_that_are_none_are_told(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_part(text)
    assert str(caught.value) == said
    assert parse_part(" 1/123456789 ") == (1, 123456789)


def test_the_order_of_tasks_is_kept_here_and_all_of_them_are_done_there(tmp_path: Path) -> None:
    done: list[int] = []
    assert list(each(done.append, iter([3, 1, 2]), folder=tmp_path)) == done == [3, 1, 2]
    assert list(each(done.append, [], folder=tmp_path)) == []
    with ThreadPoolExecutor(1) as threads:
        assert sorted(each(partial(square, tmp_path), [4, 5], folder=tmp_path, executor=threads)) == [4, 5]
        assert sorted(path.name for path in tmp_path.iterdir()) == ["4", "5"]


def test_what_has_not_begun_when_it_ends_is_not_done(tmp_path: Path) -> None:
    futures: list[Future[Any]] = []

    class Lazy(Executor):
        """Does the first of its tasks alone."""

        def submit(self, *given: Any) -> Future[Any]:  # type: ignore[override]
            futures.append(Future())
            if len(futures) == 1:
                futures[0].set_result(None)
            return futures[-1]

    begun = each(partial(square, tmp_path), [7, 8, 9], folder=tmp_path, executor=Lazy())
    assert next(begun) == 7
    assert [path.name[:5] for path in tmp_path.iterdir()] == ["sent-"]
    begun.close()
    assert [future.cancelled() for future in futures] == [False, True, True]
    assert list(tmp_path.iterdir()) == []


def test_what_was_sent_may_be_gone_when_it_ends(tmp_path: Path) -> None:
    """Somebody may clear the folder meanwhile."""
    with ThreadPoolExecutor(1) as executor:
        gone = [file.unlink() or 0 for _ in each(partial(square, tmp_path), range(2), folder=tmp_path,
                executor=executor) for file in tmp_path.glob("sent-*")]  # fmt: skip
    assert gone == [0]
    assert {path.name for path in tmp_path.iterdir()} == {"0", "1"}
