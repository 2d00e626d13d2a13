"""Settings of the plugin, from the call to the defaults; where files go; what cannot be used."""

import json
import re

import pytest

pytest_plugins = "pytester"


def test_the_call_goes_before_the_marker_the_command_line_the_ini_file_and_the_defaults(pytester, toy):
    pytester.makeini(
        "[pytest]\ncalibration_trials = 11\ncalibration_draws = 12\ncalibration_seed = 1\n"
        "calibration_policy = rules/ours.toml\n"
    )
    pytester.mkdir("rules").joinpath("ours.toml").write_text("error_budget = 0.01\n[tolerance]\nbias = 0.3\n")
    pytester.makepyfile("""
    import pytest
    from gaugeblock.testing.plugin import CalibrationFailed, CalibrationInconclusive
    from gaugeblock.validate import read_policy

    STRICT = read_policy("strict").tolerance.bias

    def record(gate, **given):
        with pytest.raises((CalibrationInconclusive, CalibrationFailed)) as stopped:
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
        assert record(calibration_gate, policy="strict")["policy"]["tolerance"]["bias"] == STRICT
        table = {"base": "strict", "tolerance": {"coverage": 0.2}}
        tolerance = record(calibration_gate, policy=table)["policy"]["tolerance"]
        assert (tolerance["bias"], tolerance["coverage"]) == (STRICT, 0.2)
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


def test_a_ledger_counts_the_gates_before(pytester, toy, monkeypatch):
    toy("""
    @pytest.mark.parametrize("seed", [1, 2])
    def test_flow(calibration_gate, seed):
        audited = calibration_gate(EXACT, SIMULATOR, **{**QUICK, "seed": seed})
        assert audited.verdict.provenance["ledger"]["earlier"] == seed - 1
    """)
    pytester.makeini("[pytest]\ncalibration_ledger = audits.json\n")
    pytester.runpytest_inprocess("-p", "no:randomly").assert_outcomes(passed=2)
    assert len(json.loads((pytester.path / "audits.json").read_text())["audits"]) == 2


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


BAD = {
    "calibration_gate(EXACT, SIMULATOR, policy='nowhere.toml')": "nowhere.toml: cannot be read",
    "calibration_gate(EXACT, SIMULATOR, policy={'tolerance': {'bais': 1}})": "unknown key tolerance.bais",
    "calibration_gate(EXACT, SIMULATOR, policy=3)": "policy=... cannot be a int",
    "calibration_gate(EXACT, SIMULATOR, trials=3)": "number = 3 cannot be",
    "calibration_gate(EXACT, SIMULATOR, draws='many')": "'many' cannot be: it must be a whole number",
    "calibration_gate(EXACT, SIMULATOR, seed=-1)": "seed = -1 cannot be",
    "calibration_gate(EXACT, SIMULATOR, validators=['sbs'])": "unknown validator sbs",
    "calibration_gate(EXACT, SIMULATOR, validators=5)": "must be names of validators, got 5",
    "calibration_gate(SIMULATOR, EXACT)": "which simulates; the order is (estimator, simulator)",
    "calibration_gate(object, SIMULATOR)": "the estimator is a object without sample",
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
