"""Mutants: what operators change and leave alone, the draw, and that tests are asked as they say."""

import resource
import subprocess
from pathlib import Path

import pytest
from studies.kit.commit import committed
from studies.kit.results import read_groups, write
from studies.mutants.__main__ import equivalents, main, table
from studies.mutants.bench import bench
from studies.mutants.document import counts, draw_table
from studies.mutants.operators import mutations
from studies.mutants.places import ROOMS, Mutant, Tree, drawn, found_again
from studies.mutants.reached import EVERY, FEW, aimed, reaching, statements
from studies.mutants.reached import table as traced_table
from studies.mutants.server import SLOW

from gaugeblock.core.errors import InputError

CHANGES = [
    ("variance for sd", "x.std(axis=0)", "(x.var(axis=0))"),
    ("variance for sd", "np.sqrt(x)", "(x)"),
    ("variance for sd", "x ** 2", "(x)"),
    ("correction dropped", "x / (n - 1)", "x / ((n))"),
    ("correction dropped", "np.var(x, ddof=1)", "np.var(x, ddof=0)"),
    ("wrong tail", "law.sf(x)", "(law.cdf(x))"),
    ("wrong tail", "x < y", "(x > y)"),
    ("boundary", "x < y", "(x <= y)"),
    ("boundary", "np.searchsorted(x, y, side='left')", "np.searchsorted(x, y, side='right')"),
    ("unsorted", "np.sort(x)", "(x)"),
    ("unsorted", "sorted(x)", "list(x)"),
    ("wrong axis", "x.mean(axis=1)", "x.mean(axis=0)"),
    ("stream reused", "generator(seed, 'noise', number)", "generator(seed, 'noise', 0)"),
    ("stream reused", "rng.spawn(3)", "([rng] * (3))"),
    ("swapped", "law(x, y, z=1)", "law(y, x, z=1)"),
    ("swapped", "np.where(a, x, y)", "np.where(a, y, x)"),
    ("weight dropped", "np.average(x, weights=w)", "np.average(x, weights=None)"),
    ("weight dropped", "x * weight", "(x)"),
    ("quantile turned", "np.quantile(x, q)", "np.quantile(x, 1 - (q))"),
    ("quantile turned", "law.ppf(q)", "law.ppf(1 - (q))"),
    ("log dropped", "np.log(x)", "(x)"),
    ("sum for mean", "x.mean()", "(x.sum())"),
    ("max for min", "np.maximum(x, 0.0)", "(np.minimum(x, 0.0))"),
    ("off by one", "x[1:]", "x[2:]"),
    ("off by one", "x[-1]", "x[(1)]"),
    ("off by one", "range(n)", "range((n) - 1)"),
    ("arithmetic", "x + y", "((x) - (y))"),
    ("sign dropped", "-x", "(x)"),
    ("boolean", "x and y", "((x) or (y))"),
    ("constant", "0.5 * x", "0.75 * x"),
    ("condition", "x if c else y", "((y) if (c) else (x))"),
]

SILENT = '''
"""Text."""
LIMIT = 3 + 4

def f(x: Annotated[int, 1 + 1] = 5 - 1, *, y=f(-1)) -> Literal[1]:
    """One, 1 + 1."""
    if x < 1:
        raise InputError(f"{x - 1} is too few")
    assert x > 1, str(-x)
    warn(x + 1)
    z = f"{x - 1:.3f}"
    w = zip(*x, strict=True)
'''


@pytest.mark.parametrize(("operator", "before", "after"), CHANGES)
def test_each_operator_makes_the_change_that_it_is_named_for(operator, before, after):
    source = f"def f(x):\n    found = {before}\n".encode()
    made = [m.applied(source).decode() for m in mutations(source) if m.operator == operator]
    assert f"def f(x):\n    found = {after}\n" in made


def test_statements_and_answers_are_dropped():
    source = b"def f(x):\n    x.sort()\n    x += 1\n    return x\n"
    made = {m.applied(source) for m in mutations(source)}
    assert b"def f(x):\n    pass\n    x += 1\n    return x\n" in made
    assert b"def f(x):\n    x.sort()\n    pass\n    return x\n" in made
    assert b"def f(x):\n    x.sort()\n    x += 1\n    return None\n" in made


def test_what_computes_nothing_is_left_alone():
    assert mutations(SILENT.encode()) == []


def test_text_of_more_bytes_than_letters_moves_nothing():
    source = "def f(x):\n    a = 'µµ'; return 'µ', x - 1\n".encode()
    assert "def f(x):\n    a = 'µµ'; return 'µ', (x)\n".encode() in {
        m.applied(source) for m in mutations(source)
    }


@pytest.fixture(scope="module")
def toy(tmp_path_factory):
    """A repository with one module and two files of tests, of which one has a test that always fails.

    Packages that take seconds to import are empty in it, and no plugins are loaded but one that is asked for.
    """
    root = tmp_path_factory.mktemp("toy")
    files = {
        "src/gaugeblock/__init__.py": "",
        "src/gaugeblock/testing/plugin.py": "",
        "validate/__init__.py": "",
        "validate/spread.py": "def spread(x, n):\n    return sum(v * v for v in x) / (n - 1)\n\n\n"
        "def size(x):\n    return abs(len(x))\n",
        "validate/other.py": "from gaugeblock.validate.spread import spread\n\n\n"
        "def twice(x):\n    return 2 * spread(x, 3)\n",
        "tests/validate/test_spread.py": "from gaugeblock.validate.spread import size, spread\n\n\n"
        "def test_always_fails():\n    assert spread([1.0, 2.0], 2) < 0\n\n\n"
        "def test_spread():\n    assert spread([1.0, 2.0], 2) == 5\n\n\n"
        "def test_size():\n    assert size([1, 2]) == 2\n",
        "tests/validate/test_other.py": "from gaugeblock.validate.other import twice\n\n\n"
        "def test_twice():\n    assert twice([1.0, 2.0]) == 5\n",
        "tests/validate/test_unconcerned.py": "def test_nothing():\n    assert True\n",
        **{f"src/{slow.partition('.')[0]}.py": "" for slow in SLOW if slow != "numpy"},
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    (root / "src/gaugeblock/validate").symlink_to("../../validate")
    git = ["git", "-C", str(root), "-c", "user.name=t", "-c", "user.email=t@example.org"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "toy"]):
        subprocess.run([*git, *command], check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
        patch.setenv("PYTEST_ADDOPTS", "-p pytest_timeout")
        yield root


def mutant(toy, change):
    """The mutant of spread.py that has this line."""
    tree = Tree(toy)
    path = toy / "validate/spread.py"
    source = path.read_bytes()
    (found,) = [m for m in mutations(source) if change.encode() in m.applied(source)]
    return Mutant(
        "validate", "validate/spread.py", found, "", "", (tree.looking("gaugeblock.validate.spread"),)
    )


def test_tests_are_asked_nearest_first(toy):
    looking = Tree(toy).looking("gaugeblock.validate.spread")
    assert looking == ("tests/validate/test_spread.py", "tests/validate/test_other.py")
    assert Tree(toy).looking("gaugeblock.validate.other") == ("tests/validate/test_other.py",)


def test_a_mutant_is_noticed_by_a_test_that_passes_without_it(toy):
    at = bench(toy, committed(toy, "HEAD"))
    before = (toy / "validate/spread.py").read_text()
    noticed = at.judged(mutant(toy, "/ ((n))"), 60)
    assert noticed["outcome"] == "noticed"
    assert noticed["by"] == "tests/validate/test_spread.py::test_spread"
    survived = at.judged(mutant(toy, "return (len(x))"), 60)
    assert survived["outcome"] == "survived"
    assert survived["passed"] == 3
    # What was changed is as it was, in the copy, and nothing else was ever touched.
    assert (at.copy / "validate/spread.py").read_text() == before == (toy / "validate/spread.py").read_text()


BRANCHES = """
LIMIT = (
    1 + 2
)

class Shape:
    side = 3

    def area(self, x):
        match x:
            case 1:
                total = sum(
                    [x,
                     x],
                )
            case _:
                try:
                    total = -x
                except ValueError:
                    total = 0
        if (total
                > 3):
            return total
        return 2 * total

def other(x):
    return 2 * x
"""


def test_statements_are_whole_without_their_blocks_and_keep_their_names_where_they_move():
    lines = BRANCHES.splitlines()
    named = statements("a.py", BRANCHES.encode())
    parts: dict[str, list[str]] = {}
    for line, name in named.items():
        parts.setdefault(name, []).append(lines[line - 1].strip())
    assert sorted(parts.values()) == sorted(
        [
            ["match x:"], ["total = sum(", "[x,", "x],", ")"], ["try:"], ["total = -x"],
            ["except ValueError:"], ["total = 0"], ["if (total", "> 3):"], ["return total"],
            ["return 2 * total"], ["return 2 * x"],
        ]
    )  # fmt: skip
    moved = statements("a.py", f"import math\n\n{BRANCHES}".encode())
    assert moved == {line + 2: name for line, name in named.items()}
    assert not set(named.values()) & set(statements("b.py", BRANCHES.encode()).values())
    # The same words in another function are another statement.
    renamed = statements("a.py", BRANCHES.replace("def other", "def another").encode())
    assert len(set(renamed.values()) ^ set(named.values())) == 2


REACHING = """
import subprocess, sys
import pytest
from gaugeblock.validate.spread import size, spread

@pytest.fixture(scope="module")
def three():
    return size([1, 2, 3])

@pytest.mark.parametrize("n", range(20))
def test_spread(n, three):
    assert spread([1.0], 2 + n) * (1 + n) == 1

def test_spread_of_two():
    assert spread([1.0, 2.0], 2) == 5

def test_outside():
    script = "from gaugeblock.validate.spread import spread; print(spread([2.0], 2))"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "4.0\\n"
"""


@pytest.fixture(scope="module")
def reached(toy, tmp_path_factory):
    """The toy with a further file of tests, and what the tests of each reach."""
    root = tmp_path_factory.mktemp("reached") / "toy"
    subprocess.run(["git", "clone", "-q", str(toy), str(root)], check=True)
    (root / "tests/validate/test_reaching.py").write_text(REACHING)
    git = ["git", "-C", str(root), "-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "more"], check=True)
    at = bench(root, committed(root, "HEAD"))
    return at, {file: at.traced(file) for file in Tree(root).tests}


def test_what_reaches_a_statement_is_told_by_test_process_and_fixture(reached):
    at, tables = reached
    path = at.copy / "validate/spread.py"
    spread, size = list(dict.fromkeys(statements("validate/spread.py", path.read_bytes()).values()))
    tests = reaching(spread, tables)
    by_file = {test.file.split("/")[-1]: set() for test in tests}
    for test in tests:
        by_file[test.file.split("/")[-1]].add(test.name.split("::")[-1])
    assert by_file["test_spread.py"] == {"test_spread", "test_always_fails"}
    assert by_file["test_other.py"] == {"test_twice"}
    # The cheapest alone, of which one with a process is none.
    assert len(by_file["test_reaching.py"]) == FEW
    assert len(tables["tests/validate/test_reaching.py"]["tests"]) == 1 + 22
    everything = tables["tests/validate/test_reaching.py"]
    assert everything["tests"][-1] == "tests/validate/test_reaching.py::test_outside"
    assert everything["seconds"][-1] > 0.01
    assert {test.name.split("::")[-1] for test in reaching(size, tables)} == {"test_size", EVERY}


def test_what_a_process_reaches_is_reached_by_its_test(reached, monkeypatch):
    monkeypatch.setattr("studies.mutants.reached.FEW", 40)
    at, _ = reached
    path = at.copy / "validate/spread.py"
    spread = next(iter(statements("validate/spread.py", path.read_bytes()).values()))
    names = {
        test.name.split("::")[-1]
        for test in reaching(spread, {"": at.traced("tests/validate/test_reaching.py")})
    }
    assert names == {"test_outside", "test_spread_of_two", *(f"test_spread[{n}]" for n in range(20))}


def test_what_a_process_had_not_written_when_it_was_killed_is_left_out(reached, tmp_path):
    at, _ = reached
    (tmp_path / "trace.half").write_bytes(b"SQLite format 3\0" + bytes(50))
    assert len(traced_table(at.copy, [tmp_path / "trace.half"], {"a": 1.0})["statements"]) == 0


def test_what_reaches_a_change_is_asked_first_and_its_files_then(reached):
    at, tables = reached
    source = (at.copy / "validate/spread.py").read_bytes()
    size = aimed(mutant(at.copy, "return (len(x))"), source, tables, 60)
    assert size.tests[0] == ("tests/validate/test_spread.py::test_size",)
    assert set(size.tests[1]) == {"tests/validate/test_spread.py", "tests/validate/test_reaching.py"}
    spread = aimed(mutant(at.copy, "/ ((n))"), source, tables, 60)
    files = [name.split("::")[0].split("/")[-1] for name in spread.tests[0]]
    assert files[0] == "test_spread.py"
    assert set(files) == {"test_spread.py", "test_other.py", "test_reaching.py"}
    assert at.judged(spread, 60)["by"] == "tests/validate/test_spread.py::test_spread"
    # Asked in one round and in the next, a test is run once; one whose name begins like another's is run too.
    survived = at.judged(size, 60)
    assert (survived["outcome"], survived["passed"]) == ("survived", 2 + 22)
    # What nothing is known to reach is looked for by imports.
    unknown = mutant(at.copy, "/ ((n))")
    assert aimed(unknown, source, {}, 60) is unknown


def test_time_that_is_up_is_no_answer(toy):
    at = bench(toy, committed(toy, "HEAD"))
    endless = at.copy / "tests" / "test_endless.py"
    endless.write_text("def test_endless():\n    while True:\n        pass\n")
    assert at.run(("tests/test_endless.py",), 1.0)["outcome"] == "time was up"


def test_a_session_may_raise_its_limit_and_says_at_once_that_files_differ(toy):
    at = bench(toy, committed(toy, "HEAD"))
    (at.copy / "tests" / "test_limit.py").write_text(
        "import resource\n\n\ndef test_limit():\n    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]\n"
        "    resource.setrlimit(resource.RLIMIT_CPU, (hard, hard))\n"
        f"    assert hard == {resource.getrlimit(resource.RLIMIT_CPU)[1]}\n"
    )
    assert at.run(("tests/test_limit.py",), 60)["outcome"] == "survived"
    (at.copy / "tests" / "test_large.py").write_text(
        "import random\n\n\ndef test_large():\n"
        "    assert random.Random(1).randbytes(10**6) == random.Random(2).randbytes(10**6)\n"
    )
    said = at.run(("tests/test_large.py",), 60)
    assert (said["outcome"], said["by"]) == ("noticed", "tests/test_large.py::test_large")
    assert said["seconds"] < 10


def test_tests_that_cannot_begin_notice_nothing(toy):
    with pytest.raises(InputError, match="cannot begin"):
        bench(toy, committed(toy, "HEAD")).begins(("tests/test_that_is_not_there.py",), 60)


def test_a_run_is_kept_and_goes_on(toy, tmp_path, capsys, monkeypatch):
    arguments = ["--repository", str(toy), "--out", str(tmp_path), "--seconds", "60"]
    assert main([*arguments, "--number", "5"]) == 0
    first = read_groups(tmp_path / "mutants.nc")["first"]
    assert counts(first)["validate"][0] == len(first["mutant"]) == 1
    assert sum(counts(first)["validate"][1:]) == 1
    asked = []
    judged = type(bench(toy, committed(toy, "HEAD"))).judged
    monkeypatch.setattr(
        "studies.mutants.bench.Bench.judged", lambda self, *given: asked.append(1) or judged(self, *given)
    )
    assert main([*arguments, "--number", "10"]) == 0
    longer = read_groups(tmp_path / "mutants.nc")["first"]
    assert longer["change"].values.tolist()[:1] == first["change"].values.tolist()
    assert len(asked) == 1 == len(longer["mutant"]) - 1
    assert main([*arguments, "--number", "10", "--so-far", "--draw", "second"]) == 0
    groups = read_groups(tmp_path / "mutants.nc")
    assert groups["second"].sizes["mutant"] == 0
    assert groups["first"].identical(longer)


def test_what_a_draw_left_is_made_once_more_where_its_line_still_stands(toy, tmp_path, capsys):
    root, out = tmp_path / "toy", tmp_path / "out"
    subprocess.run(["git", "clone", "-q", str(toy), str(root)], check=True)
    tree, line = Tree(root), "    return abs(len(x))\n"
    row = {"room": "validate", "before": line.strip(), "change": "abs(len(x)) -> (len(x))"}
    (left,) = found_again(tree, [{**row, "place": "validate/spread.py:6"}])
    said = {"by": "", "seconds": 1.0}
    first = table(
        {"a": {**said, "outcome": "survived"}, "b": {**said, "outcome": "noticed"}}, {"a": left, "b": left}
    )
    out.mkdir()
    write({"first": first.assign_attrs(commit="before")}, out / "mutants.nc")
    # The line moves, and one that reads alike stands further down.
    path = root / "validate/spread.py"
    path.write_text("LIMIT = 1\n\n\n" + path.read_text() + f"\n\ndef again(x):\n{line}")
    assert found_again(tree, [{**row, "place": "validate/spread.py:6"}])[0].mutation.line == 9
    assert found_again(tree, [{**row, "place": "validate/spread.py:12"}])[0].mutation.line == 13
    gone = [
        {**row, "place": "validate/none.py:6"},
        {**row, "place": "validate/spread.py:6", "change": "0 -> 1"},
    ]
    assert found_again(tree, gone) == []
    git = ["git", "-C", str(root), "-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run([*git, "commit", "-q", "-a", "-m", "moved"], check=True)

    arguments = ["--repository", str(root), "--out", str(out), "--seconds", "60", "--again"]
    assert main(arguments) == 0
    again = read_groups(out / "mutants.nc")["first draw again"]
    assert again["change"].values.tolist() == [row["change"]]
    assert again["outcome"].values.tolist() == ["survived"]
    assert (again.attrs["left"], again.attrs["drawn"]) == (1, 1)
    assert again.attrs["commit"] == committed(root, "HEAD")
    assert "of 1 changes that it left unnoticed 1 can still be made, 1 were" in draw_table(again, "first")
    assert main([*arguments, "--draw", "third"]) == 2
    assert "no draw 'third' in mutants.nc; it has first, first draw again" in capsys.readouterr().err


def test_the_draw_is_of_equally_many_a_room_and_no_line_twice(toy):
    tree, rooms = Tree(toy), {"a": ("validate",), "b": ("validate",)}
    made = drawn(tree, 4, "seed", rooms=rooms)
    assert [m.room for m in made] == ["a", "b"] * 2
    assert made == drawn(tree, 4, "seed", rooms=rooms)
    lines = [(m.file, m.mutation.line) for m in drawn(tree, 100, "seed", rooms={"a": ("validate",)})]
    assert len(lines) == len(set(lines)) == 3
    assert len({drawn(tree, 1, seed, rooms={"a": ("validate",)})[0] for seed in range(20)}) > 1


def test_every_room_is_there_and_every_equivalent_has_a_reason():
    root = Tree(Path(__file__).resolve().parents[2])
    for folders in ROOMS.values():
        assert root.files(*folders)
    for (file, before, change), reason in equivalents().items():
        assert before in (root.root / file).read_text(), f"{file}: there is no line {before}"
        assert " -> " in change
        assert reason
