from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, judge, make_policy, make_trials, read_policy, run_validators
from gaugeblock.validate.policy import covers


def test_shipped_policies():
    default, strict = read_policy("default"), read_policy("strict")
    assert default.error_budget == 0.05
    assert default.requires("sbc.bias[tbabs_1.nh]")
    assert not default.requires("importance.ess")
    assert strict.requires("importance.ess")
    for name in ("bias", "log_width", "coverage", "joint", "local"):
        assert strict.tolerated(name) < default.tolerated(name)
    assert strict.tolerated("ess") > default.tolerated("ess")
    assert default.tolerated("") is None
    assert default.tolerated("model_fields") is None


def test_regions_can_be_tolerated_to_be_as_wrong_as_can_be():
    """No truth lies within its draws: 0.95 are missing, at most 4.2 in units of a twentieth."""
    rng = np.random.default_rng(1)
    trials = make_trials(np.full((400, 1), 99.0), rng.normal(size=(400, 60, 1)), x=rng.normal(size=(400, 2)))
    found, left = run_validators(trials, seed=1, select=["local"])
    for local, failed in ((0.21, True), (3.0, True), (4.3, False)):
        policy = make_policy({"tolerance": {"local": local}}, source="test")
        gates = {gate.id: gate.outcome for gate in judge(found, left, policy, seed=1).gates}
        assert (gates["local.coverage[theta_1]"] is Outcome.FAIL) == failed


def test_a_file_overrides_the_default(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('error_budget = 0.01\nrequired = ["coverage"]\n[tolerance]\nbias = 0.2\n')
    policy = read_policy(path)
    assert (policy.error_budget, policy.required, policy.tolerance.bias) == (0.01, ("coverage",), 0.2)
    assert policy.tolerance.coverage == read_policy("default").tolerance.coverage


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("error_budgett = 0.1", "unknown key error_budgett; there are error_budget, required"),
        ("[tolerance]\nwidth = 0.1", "unknown key tolerance.width; there are bias, log_width"),
        ("[planning]\npwer = 0.1", "unknown key planning.pwer; there are power"),
        ("error_budget = 0", "error_budget = 0 cannot be: input should be greater than 0"),
        ("error_budget = 0.9", "error_budget = 0.9 cannot be"),
        ("error_budget = nan", "error_budget = nan cannot be"),
        ("error_budget = 'five'", "error_budget = 'five' cannot be"),
        ("tolerance = 0.1", "tolerance = 0.1 cannot be"),
        ("[tolerance]\nbias = -0.1", "tolerance.bias = -0.1 cannot be"),
        ("[tolerance]\ncoverage = 1.5", "tolerance.coverage = 1.5 cannot be"),
        ("[tolerance]\nless = 1", "unknown key tolerance.less"),
        ("[tolerance]\ness = 1.0", "tolerance.ess = 1.0 cannot be"),
        ("required = []", "required = .* cannot be"),
        ("required = 'sbc'", "required = 'sbc' cannot be"),
        ("required = ['']", "required.0 = '' cannot be"),
        ("[planning]\npower = 1.0", "planning.power = 1.0 cannot be"),
        ("error_budget = ", "is not TOML"),
        ("[tolerance\n", "is not TOML"),
    ],
)
def test_bad_policies_are_one_line_naming_key_and_file(tmp_path, text, said):
    path = tmp_path / "policy.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_policy(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_and_unreadable_files(tmp_path):
    with pytest.raises(InputError, match=r"lenient: cannot be read .* the name default or strict"):
        read_policy("lenient")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_policy(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="cannot be read"):
        read_policy(tmp_path)


def test_plain_data_names_its_source():
    with pytest.raises(InputError, match=r"^audit\.toml, table policy: unknown key toleranc"):
        make_policy({"toleranc": {}}, source="audit.toml, table policy")


def test_required_entries_name_whole_words():
    assert covers("sbc", "sbc.bias[a]")
    assert covers("sbc.bias", "sbc.bias[a]")
    assert not covers("sb", "sbc.bias[a]")
    assert not covers("sbc.bias[a]", "sbc.bias[ab]")
    assert not covers("sbc.bias[a]", "sbc.bias")
