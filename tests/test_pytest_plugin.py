"""The plugin in runs of its own: verdicts as outcomes of tests, settings, reports, what it leaves alone."""

import json
import os
import re
import sys
import textwrap
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from gaugeblock.audit import audit_objects
from gaugeblock.config import TrialsTable
from gaugeblock.estimators.exact import Exact
from gaugeblock.pytest_plugin import CalibrationError, CalibrationFailed, CalibrationInconclusive
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import read_policy

pytest_plugins = "pytester"

# Seeds are fixed, so nothing here changes from run to run; another seed would fail an exact estimator's PASS
# in fewer than one of a hundred.
TOY = """
import numpy as np
import pytest
from gaugeblock.estimators.exact import Exact
from gaugeblock.pytest_plugin import CalibrationError, CalibrationFailed, CalibrationInconclusive
from gaugeblock.simulators import build_simulator

TOLERANCE = {"bias": 0.2, "log_width": 0.2, "coverage": 0.1}
pytestmark = pytest.mark.calibration(
    trials=1000, draws=30, validators=("draws", "sbc", "coverage"), policy={"tolerance": TOLERANCE}
)
# Ten trials are enough to see that draws are finite, and that they are not; what else they show is reported.
QUICK = {
    "trials": 10, "draws": 10, "validators": ("draws", "sbc"), "policy": {"required": ["draws.finite"]}
}
SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=2)
EXACT = Exact(SIMULATOR)

class Draws:
    def __init__(self, change):
        self.change = change
    def sample(self, x, n, rng):
        return self.change(EXACT.sample(x, n, rng))

def narrowed(draws):
    center = draws.mean(axis=1, keepdims=True)
    return center + 0.6 * (draws - center)
NARROW = Draws(narrowed)
BROKEN = Draws(lambda draws: np.where(draws > 0, draws, np.nan))
"""


@pytest.fixture(scope="module", autouse=True)
def _imported(tmp_path_factory):
    """Everything an audit imports: what a run within this process imports anew, it imports at every run."""
    simulator = build_simulator("linear_gaussian", parameters=1, data=1)
    plan = TrialsTable(number=10, draws=10).plan()
    policy, folder = read_policy("default"), tmp_path_factory.mktemp("audit")
    audit_objects(
        simulator, Exact(simulator), plan, folder, policy=policy, select=("draws", "sbc", "coverage")
    )


@pytest.fixture(autouse=True)
def _lean(pytester, monkeypatch):
    """Without the plugin of hypothesis, which a run within this process would load again each time."""
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p no:hypothesispytest")


@pytest.fixture
def toy(pytester):
    """Write a test file that begins with the toys above and return its path."""

    def write(tests, name="test_flow"):
        return pytester.makepyfile(**{name: TOY + textwrap.dedent(tests)})

    return write


def properties(file, test):
    case = next(case for case in ElementTree.parse(file).iter("testcase") if case.get("name") == test)
    return {item.get("name"): item.get("value") for item in case.iter("property")}


def test_a_pass_returns_the_audit_and_says_what_it_would_have_seen(pytester, toy):
    toy("""
    def test_flow(calibration_gate):
        audit = calibration_gate(EXACT, SIMULATOR)
        assert audit.verdict.outcome == "PASS"
        assert {finding.id for finding in audit.findings} >= {"sbc.bias[theta_1]", "coverage.central"}
    """)
    result = pytester.runpytest_inprocess("-W", "error", "--strict-markers", "--junitxml=junit.xml")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(
        [
            "*= calibration =*",
            "PASS test_flow.py::test_flow: 1,000 trials x 30 draws, seed 20260611, policy default, changed",
            "*smallest fault blocked with 90% power:",
            "*sbc.bias *posterior sd",
            "*sbc.log_width *width ratio",
            "*coverage.central *fraction of trials",
        ]
    )
    said = properties(pytester.path / "junit.xml", "test_flow")
    assert said["calibration.verdict"] == "PASS"
    assert (said["calibration.trials"], said["calibration.seed"]) == ("1000", "20260611")
    assert said["calibration.worst_gate.verdict"] == "PASS"
    assert re.fullmatch("[0-9a-f]{64}", said["calibration.policy_sha256"])
    sizes = {key: float(value) for key, value in said.items() if "smallest_detectable" in key}
    # A mean of 1,000 errors is known to 1/sqrt(1000) sd, and nothing below the tolerance of 0.2 is blocked.
    assert 0.2 < sizes["calibration.smallest_detectable.sbc.bias"] < 0.2 + 5 / np.sqrt(1000)


def test_a_fail_is_a_table_without_a_traceback(pytester, toy):
    toy("""
    def test_flow(calibration_gate):
        calibration_gate(NARROW, SIMULATOR)
    """)
    result = pytester.runpytest_inprocess("--junitxml=junit.xml")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "FAIL: * gates failed by more than chance explains: *sbc.log_width*theta_1*",
            "1,000 trials x 30 draws, seed *",
            "gate * verdict * statistic * interval * tolerance",
            "sbc.log_width*theta_*  FAIL     -0.4*  -0.* to -0.*  +-0.2",
            "    theta_*: posteriors are 0.* times as wide as they should be*",
            "Report: *report.html",
            "FAILED test_flow.py::test_flow - CalibrationFailed: FAIL: *",
        ]
    )
    whole = result.stdout.str()
    assert "Traceback" not in whole
    assert "pytest_gate.py" not in whole
    assert "= calibration =" not in whole
    assert whole.isascii()
    report = re.search("^Report: (.*)$", whole, re.MULTILINE)[1]
    assert os.path.exists(report)
    case = ElementTree.parse(pytester.path / "junit.xml").find(".//testcase")
    assert case.find("failure").get("message").startswith("CalibrationFailed: FAIL")
    said = properties(pytester.path / "junit.xml", "test_flow")
    assert said["calibration.verdict"] == said["calibration.worst_gate.verdict"] == "FAIL"


UNDECIDED = """
@pytest.mark.calibration(trials=50)
def test_flow(calibration_gate):
    calibration_gate(EXACT, SIMULATOR)
"""


def test_inconclusive_is_a_failure_of_its_own_kind(pytester, toy):
    toy(UNDECIDED)
    result = pytester.runpytest_inprocess("--junitxml=junit.xml")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "INCONCLUSIVE: * required gates could not be decided: *About * trials would settle it*",
            "sbc.* INCONCLUSIVE *",
            "FAILED test_flow.py::test_flow - CalibrationInconclusive: INCONCLUSIVE: *",
        ]
    )
    assert properties(pytester.path / "junit.xml", "test_flow")["calibration.verdict"] == "INCONCLUSIVE"


@pytest.mark.parametrize(("choice", "outcome"), [("skip", "skipped"), ("xfail", "xfailed")])
def test_inconclusive_may_pass_without_passing_in_silence(choice, outcome, pytester, toy):
    toy(UNDECIDED)
    result = pytester.runpytest_inprocess("--calibration-inconclusive", choice)
    result.assert_outcomes(**{outcome: 1})
    result.stdout.fnmatch_lines(["*= calibration =*", "INCONCLUSIVE test_flow.py::test_flow: 50 trials*"])


def test_what_stops_a_test_can_be_told_apart(pytester, toy):
    toy("""
    def test_flow(calibration_gate):
        with pytest.raises(CalibrationFailed) as stopped:
            calibration_gate(NARROW, SIMULATOR)
        assert stopped.value.audit.verdict.outcome == "FAIL"
        with pytest.raises(CalibrationInconclusive) as stopped:
            calibration_gate(EXACT, SIMULATOR, trials=20)
        assert stopped.value.audit.verdict.outcome == "INCONCLUSIVE"
        with pytest.raises(CalibrationError, match="without sample"):
            calibration_gate(object(), SIMULATOR)
    """)
    pytester.runpytest_inprocess().assert_outcomes(passed=1)
    kinds = (CalibrationError, CalibrationFailed, CalibrationInconclusive)
    assert not [a for a in kinds for b in kinds if a is not b and issubclass(a, b)]


def test_the_call_goes_before_the_marker_the_command_line_the_ini_file_and_the_defaults(pytester, toy):
    pytester.makeini(
        "[pytest]\ncalibration_trials = 11\ncalibration_draws = 12\ncalibration_seed = 1\n"
        "calibration_policy = rules/ours.toml\n"
    )
    pytester.mkdir("rules").joinpath("ours.toml").write_text("error_budget = 0.01\n[tolerance]\nbias = 0.3\n")
    pytester.makepyfile("""
    import pytest
    from gaugeblock.pytest_plugin import CalibrationInconclusive

    def record(gate, **given):
        with pytest.raises(CalibrationInconclusive) as stopped:
            gate("exact", {"name": "linear_gaussian", "parameters": 1}, validators="sbc", **given)
        return stopped.value.audit.verdict.provenance

    def seen(gate, **given):
        trials = record(gate, **given)["trials"]
        return trials["number"], trials["draws"], trials["seed"]

    def test_ini_and_command_line(calibration_gate):
        assert seen(calibration_gate) == (11, 13, 2)

    @pytest.mark.calibration(seed=3)
    class TestMarked:
        def test_marker(self, calibration_gate):
            assert seen(calibration_gate) == (11, 13, 3)

        @pytest.mark.calibration(seed=4, draws=14)
        def test_closest_marker(self, calibration_gate):
            assert seen(calibration_gate) == (11, 14, 4)

        @pytest.mark.calibration(seed=4)
        def test_call(self, calibration_gate):
            assert seen(calibration_gate, seed=5, trials=15) == (15, 13, 5)
            assert seen(calibration_gate) == (11, 13, 4)  # the call's own settings end with it

    def test_policies(calibration_gate):
        assert record(calibration_gate)["policy"]["tolerance"]["bias"] == 0.3
        assert record(calibration_gate, policy="strict")["policy"]["tolerance"]["bias"] == 0.03
        table = {"base": "strict", "tolerance": {"coverage": 0.2}}
        tolerance = record(calibration_gate, policy=table)["policy"]["tolerance"]
        assert (tolerance["bias"], tolerance["coverage"]) == (0.03, 0.2)
    """)
    result = pytester.runpytest_inprocess("--calibration-draws=13", "--calibration-seed", "2")
    result.assert_outcomes(passed=5)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("pyproject.toml", "[tool.pytest.ini_options]\ncalibration_trials = 11\n"),
        ("pytest.toml", "[pytest]\ncalibration_trials = 11\n"),
    ],
)
def test_numbers_in_toml_are_numbers(file, content, pytester, toy):
    if file == "pytest.toml" and pytest.version_tuple < (9, 0):
        pytest.skip("this pytest reads no pytest.toml")
    (pytester.path / file).write_text(content)
    toy("""
    pytestmark = []
    def test_flow(calibration_gate):
        with pytest.raises(CalibrationInconclusive) as stopped:
            calibration_gate(EXACT, SIMULATOR, validators="draws")
        assert stopped.value.audit.verdict.provenance["trials"]["number"] == 11
    """)
    pytester.runpytest_inprocess().assert_outcomes(passed=1)


def test_workers_and_order_change_nothing(pytester, toy):
    toy(
        """
        @pytest.mark.parametrize("seed", [1, 2])
        def test_flow(seed, calibration_gate):
            calibration_gate(EXACT, SIMULATOR, seed=seed, **QUICK)

        def test_bad(calibration_gate):
            calibration_gate(BROKEN, SIMULATOR, **QUICK)
        """
    )
    runs = {
        "serial": (),
        "workers": ("-n", "2", "--junitxml=junit.xml"),
        "reversed": ("test_flow.py::test_bad", "test_flow.py::test_flow[2]", "test_flow.py::test_flow[1]"),
    }
    found = {}
    for name, arguments in runs.items():
        result = pytester.runpytest_subprocess("--calibration-out", name, *arguments)
        result.assert_outcomes(passed=2, failed=1)
        # The section is printed once, in one order, and counts no test twice.
        shown = [line for line in result.stdout.lines if line.startswith("PASS test_flow.py")]
        assert [re.search(r"\[(\d)\]", line)[1] for line in shown] == ["1", "2"]
        result.stdout.fnmatch_lines(
            ["FAIL: * draws.finite.", "*= calibration =*", "*blocked with 90% power:"]
        )
        files = sorted((pytester.path / name).glob("*/verdict.json"))
        found[name] = {file.parent.name: file.read_bytes() for file in files}
        assert len(found[name]) == 3
    assert found["serial"] == found["workers"] == found["reversed"]
    assert properties(pytester.path / "junit.xml", "test_flow[1]")["calibration.seed"] == "1"


def test_files_go_where_they_are_wanted(pytester, toy, monkeypatch):
    toy("""
    @pytest.mark.parametrize("name", ["a b", "a/b"])
    def test_flow(name, calibration_gate, tmp_path):
        calibration_gate(EXACT, SIMULATOR, **QUICK)
        calibration_gate(EXACT, SIMULATOR, **QUICK)
        calibration_gate(EXACT, SIMULATOR, out=tmp_path / "own", **QUICK)
        assert (tmp_path / "own" / "report.html").exists()

    def test_temporary(calibration_gate, tmp_path):
        calibration_gate(EXACT, SIMULATOR, **QUICK)
        assert not list(tmp_path.iterdir())
    """)
    elsewhere = pytester.mkdir("elsewhere")
    pytester.makeini("[pytest]\ncalibration_out = kept\n")
    monkeypatch.chdir(elsewhere)
    assert pytester.runpytest_inprocess("..", "-k", "test_flow and not temporary").ret == 0
    kept = sorted(path.name for path in (pytester.path / "kept").iterdir())
    assert len(kept) == 4
    assert all(re.fullmatch(r"test_flow\.py\.test_flow-a-b-[0-9a-f]{6}(-2)?", name) for name in kept)
    assert pytester.runpytest_inprocess("..", "--calibration-out", "here", "-k", "temporary").ret == 0
    folder = elsewhere / "here" / "test_flow.py.test_temporary"
    assert json.loads((folder / "verdict.json").read_text())["verdict"] == "PASS"
    title = (folder / "summary.md").read_text().splitlines()[0]
    assert "Exact on LinearGaussian" in title


def test_a_retrained_object_never_meets_the_draws_of_the_old_one(pytester, toy, monkeypatch):
    # An audit that was cut short leaves chunks behind; they say nothing of what the object's weights were.
    toy("""
    import os

    def test_flow(calibration_gate):
        retrained = "RETRAINED" in os.environ
        def change(draws):
            change.calls += 1
            if not retrained and change.calls == 2:
                raise RuntimeError("killed")
            return draws if retrained else draws * np.nan
        change.calls = 0
        calibration_gate(Draws(change), SIMULATOR, **{**QUICK, "trials": 210})
    """)
    pytester.runpytest_inprocess("--calibration-out", "kept").assert_outcomes(failed=1)
    assert list((pytester.path / "kept").rglob("*.nc"))
    monkeypatch.setenv("RETRAINED", "1")
    pytester.runpytest_inprocess("--calibration-out", "kept").assert_outcomes(passed=1)


def test_tests_with_a_gate_can_be_left_out(pytester, toy):
    toy("""
    pytestmark = []
    def test_gate(calibration_gate):
        raise AssertionError
    def test_other():
        pass
    """)
    result = pytester.runpytest_inprocess("-m", "not calibration", "--strict-markers")
    result.assert_outcomes(passed=1, deselected=1)
    assert "= calibration =" not in result.stdout.str()


BAD = {
    "calibration_gate(EXACT, SIMULATOR, policy='nowhere.toml')": "nowhere.toml: cannot be read",
    "calibration_gate(EXACT, SIMULATOR, policy={'tolerance': {'bais': 1}})": "unknown key tolerance.bais",
    "calibration_gate(EXACT, SIMULATOR, policy=3)": "policy=... cannot be a int",
    "calibration_gate(EXACT, SIMULATOR, trials=3)": "number = 3 cannot be",
    "calibration_gate(EXACT, SIMULATOR, draws='many')": "'many' cannot be: it must be a whole number",
    "calibration_gate(EXACT, SIMULATOR, seed=-1)": "seed = -1 cannot be",
    "calibration_gate(EXACT, SIMULATOR, validators=['sbs'])": "unknown validator sbs",
    "calibration_gate(EXACT, SIMULATOR, validators=5)": "must be names of validators, got 5",
    "calibration_gate(SIMULATOR, EXACT)": "the order is calibration_gate(estimator, simulator)",
    "calibration_gate(Exact, SIMULATOR)": "the estimator is the class Exact itself",
    "calibration_gate('nonsense', SIMULATOR)": "no estimator 'nonsense'",
    "calibration_gate(EXACT, 'nowhere:thing')": "cannot import nowhere",
    "calibration_gate({'path': 'trained'}, SIMULATOR)": "the estimator's table needs a name",
    "calibration_gate(Draws(lambda d: d[:, 1:]), SIMULATOR)": "estimator gave draws of shape (200, 29, 2)",
    "calibration_gate(Draws(lambda d: d.nonsense), SIMULATOR)": "AttributeError: 'numpy.ndarray' object",
}


def test_what_cannot_be_used_is_one_line_and_an_error_of_the_test(pytester, toy):
    toy("".join(f"def test_{n}(calibration_gate):\n    {call}\n" for n, call in enumerate(BAD)))
    result = pytester.runpytest_inprocess("-n", "0", "--tb=short")
    result.assert_outcomes(failed=len(BAD))
    whole = result.stdout.str()
    assert "INTERNALERROR" not in whole
    assert "Traceback" not in whole
    for n, complaint in enumerate(BAD.values()):
        said = re.search(rf"^_+ test_{n} _+\n(.*)\n", whole, re.MULTILINE)[1]
        assert said.startswith("calibration_gate: ")
        assert complaint in said
    # Where a user's own code raised, the line of it follows.
    assert re.search(r"^  .*test_flow\.py:\d+: in <lambda>: calibration_gate\(", whole, re.MULTILINE)


@pytest.mark.parametrize(
    ("ini", "arguments", "marker", "complaint"),
    [
        (
            "",
            ["--calibration-policy", "nowhere.toml"],
            "",
            "--calibration-policy: nowhere.toml: cannot be read",
        ),
        ("", ["--calibration-trials", "1"], "", "--calibration-trials: number = 1 cannot be"),
        ("calibration_trials = many", [], "", "many"),
        ("calibration_inconclusive = pass", [], "", "'pass' cannot be: there are fail, skip, xfail"),
        ("", [], "bias=1", "unknown key bias; there are trials"),
        ("", [], "1000", "takes keywords only"),
        ("", [], "policy='nowhere.toml'", "@pytest.mark.calibration(policy=...): nowhere.toml"),
    ],
)
def test_bad_settings_are_an_error_before_the_test(ini, arguments, marker, complaint, pytester, toy):
    pytester.makeini(f"[pytest]\n{ini}\n")
    toy(f"""
    pytestmark = []
    {"@pytest.mark.calibration(" + marker + ")" if marker else ""}
    def test_flow(calibration_gate):
        raise AssertionError("must not get here")
    """)
    result = pytester.runpytest_inprocess(*arguments)
    result.assert_outcomes(errors=1)
    said = [line for line in result.stdout.lines if line.startswith("calibration_gate: ")]
    assert len(said) == 1
    assert complaint in said[0]


def test_a_bad_option_ends_the_run_before_it_begins(pytester, toy):
    toy("def test_flow(calibration_gate): pass")
    result = pytester.runpytest_inprocess("--calibration-trials=many")
    assert result.ret == pytest.ExitCode.USAGE_ERROR


def test_warnings_of_the_audited_code_are_shown_and_decide_nothing(pytester, toy):
    toy("""
    import warnings

    def noisy(draws):
        warnings.warn("a noisy estimator")
        warnings.warn("nobody asked", DeprecationWarning)
        return draws

    def test_flow(calibration_gate):
        before = list(warnings.filters), np.geterr(), np.random.get_state()[1].tolist()
        calibration_gate(Draws(noisy), SIMULATOR, **QUICK)
        assert before == (list(warnings.filters), np.geterr(), np.random.get_state()[1].tolist())
        with pytest.raises(UserWarning):
            warnings.warn("an error again")
    """)
    result = pytester.runpytest_inprocess("-W", "error", "-W", "ignore::DeprecationWarning")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(["*UserWarning: a noisy estimator"])
    assert "nobody asked" not in result.stdout.str()


def test_a_run_without_gates_loads_nothing(pytester):
    pytester.makeconftest("""
    import sys

    def pytest_unconfigure():
        print("LOADED", *sorted({name.split(".")[0] for name in sys.modules}))
        print("OURS", *sorted(name for name in sys.modules if name.startswith("gaugeblock")))
    """)
    pytester.makepyfile("def test_nothing(): pass")
    result = pytester.runpytest_subprocess("-p", "no:jaxtyping", "-s")
    result.assert_outcomes(passed=1)
    loaded = set(next(line for line in result.stdout.lines if line.startswith("LOADED")).split())
    assert not loaded & {"numpy", "scipy", "xarray", "netCDF4", "pydantic", "typer", "jinja2", "torch", "jax"}
    result.stdout.fnmatch_lines(["OURS gaugeblock gaugeblock.pytest_plugin"])


def test_a_gate_needs_no_extra(pytester, toy, monkeypatch):
    pytester.makepyfile(
        refuse="""
    import sys
    EXTRAS = {"torch", "sbi", "jax", "jaxspec", "sklearn", "matplotlib", "ultranest", "astropy", "numpyro"}
    class Refuse:
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[0] in EXTRAS:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    sys.meta_path.insert(0, Refuse())
    """
    )
    toy("""
    pytestmark = []
    def test_flow(calibration_gate):
        calibration_gate(EXACT, SIMULATOR, trials=20, draws=20, policy=QUICK["policy"])
    def test_missing(calibration_gate):
        calibration_gate({"name": "npe", "path": "."}, SIMULATOR)
    """)
    sys_path = os.pathsep.join([str(pytester.path), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", sys_path)
    result = pytester.runpytest_subprocess("-p", "refuse", "-p", "no:jaxtyping", "-W", "error")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["calibration_gate: *pip install 'gaugeblock?sbi?'*"])


def test_the_plugin_is_found_without_being_asked_for():
    from importlib.metadata import entry_points

    (found,) = (entry for entry in entry_points(group="pytest11") if entry.name == "gaugeblock")
    assert found.load() is sys.modules["gaugeblock.pytest_plugin"]
