"""The plugin in runs of its own: verdicts as outcomes of tests, reports, what it leaves alone."""

import os
import re
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from gaugeblock.testing.plugin import CalibrationError, CalibrationFailed, CalibrationInconclusive

pytest_plugins = "pytester"


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
            "*sbc.bias *half-widths",
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


def test_controls_say_what_would_have_been_seen_in_place_of_formulas(pytester, toy):
    toy("""
    def test_flow(calibration_gate):
        calibration_gate(EXACT, SIMULATOR, validators=["draws", "sbc", "coverage", "controls"])
    """)
    result = pytester.runpytest_inprocess("-W", "error", "--junitxml=junit.xml")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(
        [
            "*This audit would have caught, 90% of the time and on these shapes:",
            "*a bias of 0.* half-widths (in any parameter; least visible in theta_*)",
            "*widths 0.* or 1.* times what they should be *",
            "*smallest fault blocked with 90% power:",
            "*coverage.central *fraction of trials",
        ]
    )
    assert "sbc.bias" not in result.stdout.str()
    said = properties(pytester.path / "junit.xml", "test_flow")
    formula = float(said["calibration.smallest_detectable.sbc.bias"])
    assert float(said["calibration.caught.bias"]) == pytest.approx(formula, rel=0.15)


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
            "    theta_*: central * intervals are 0.* times as wide as they should be*",
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
            "INCONCLUSIVE: * required gates could not be decided: * trials would settle it*",
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
        # Workers are processes of their own anyhow.
        run = pytester.runpytest_subprocess if "-n" in arguments else pytester.runpytest_inprocess
        result = run("--calibration-out", name, *arguments)
        result.assert_outcomes(passed=2, failed=1)
        # The section is printed once, in one order, and counts no test twice.
        shown = [line for line in result.stdout.lines if line.startswith("PASS test_flow.py")]
        assert [re.search(r"\[(\d)\]", line)[1] for line in shown] == ["1", "2"]
        result.stdout.fnmatch_lines(
            ["FAIL: * draws.finite. *", "*= calibration =*", "*blocked with 90% power:"]
        )
        files = sorted((pytester.path / name).glob("*/verdict.json"))
        found[name] = {file.parent.name: file.read_bytes() for file in files}
        assert len(found[name]) == 3
    assert found["serial"] == found["workers"] == found["reversed"]
    assert properties(pytester.path / "junit.xml", "test_flow[1]")["calibration.seed"] == "1"


def test_a_stranger_cannot_foresee_the_seed(pytester, toy):
    """An object that calls itself untrusted stands for one in a sandbox; a seed that is given is taken.

    The system's entropy is played by three numbers, so that no chance decides what their audits say.
    """
    toy("""
    @pytest.fixture(autouse=True, scope="module")
    def entropy():
        drawn = iter((11, 12, 13))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("secrets.randbits", lambda bits: next(drawn))
            yield

    class Theirs(Draws):
        untrusted = True
        closed = False
        def close(self):
            self.closed = True

    def seed(audit):
        return audit.verdict.provenance["seed"]

    def test_made_by_name(calibration_gate, monkeypatch):
        made = Theirs(lambda draws: draws)
        maker = "gaugeblock.auditing.estimator_from.build_estimator"
        monkeypatch.setattr(maker, lambda name, simulator: made)
        assert seed(calibration_gate("theirs", SIMULATOR, **QUICK)) == 11
        assert made.closed

    def test_flow(calibration_gate):
        theirs = Theirs(lambda draws: draws)
        assert [seed(calibration_gate(theirs, SIMULATOR, **QUICK)) for _ in range(2)] == [12, 13]
        assert seed(calibration_gate(theirs, SIMULATOR, seed=7, **QUICK)) == 7
        assert not theirs.closed
    """)
    result = pytester.runpytest_inprocess("--junitxml=junit.xml")
    result.assert_outcomes(passed=2)
    said = properties(pytester.path / "junit.xml", "test_flow")
    seeds = [said[f"calibration{again}.seed"] for again in ("", ".2", ".3")]
    assert seeds == ["12", "13", "7"]
    for number in seeds:
        result.stdout.fnmatch_lines([f"*10 trials x 10 draws, seed {number}, policy default, changed"])


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
    result.stdout.fnmatch_lines(
        ["OURS gaugeblock gaugeblock.testing gaugeblock.testing.outcomes gaugeblock.testing.plugin"]
    )


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
    assert found.load() is sys.modules["gaugeblock.testing.plugin"]
