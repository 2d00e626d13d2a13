from pathlib import Path

import pytest

from gaugeblock.auditing.config import AuditConfig, read_config
from gaugeblock.core.errors import InputError


def test_nothing_means_the_shipped_flow_on_epic_pn() -> None:
    config = read_config(None)
    assert (config.simulator.name, config.simulator.options["level"]) == ("xray", "medium")
    assert config.estimator.options == {"path": "shipped:epic-pn-medium"}
    assert (config.trials.number, config.trials.draws) == (4000, 250)
    assert (config.trials.importance_number, config.trials.importance_draws) == (200, 500)


def test_one_option_of_the_reference_case_can_be_exchanged() -> None:
    config = read_config(None, settings={"simulator.level": "bright"})
    assert config.simulator.options == {"response": "epic-pn", "level": "bright"}


def test_another_simulator_inherits_no_options() -> None:
    config = read_config(None, settings={"simulator.name": "two_moons"})
    assert config.simulator.options == {}


def test_a_spectrum_of_ones_own_excludes_the_built_in_response() -> None:
    config = read_config(None, settings={"simulator.rmf": "my.rmf", "simulator.exposure": 1000})
    assert config.simulator.options == {"rmf": "my.rmf", "exposure": 1000}


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "gate.toml").write_text("error_budget = 0.01\n")
    file = tmp_path / "audit.toml"
    file.write_text('[estimator]\nname = "npe"\npath = "model"\n[policy]\nbase = "gate.toml"\n')
    config = read_config(file)
    assert config.estimator.options["path"] == str(tmp_path / "model")
    assert config.read_policy().error_budget == 0.01


def test_policy_keys_stand_over_their_base() -> None:
    config = AuditConfig.build({"policy": {"base": "strict", "tolerance": {"bias": 0.2}}})
    assert config.read_policy().tolerance.bias == 0.2
    assert config.read_policy().tolerance.log_width == 0.05


def test_the_plan_never_asks_for_more_trials_or_draws_than_there_are() -> None:
    plan = AuditConfig.build({"trials": {"number": 50, "draws": 60}}).trials.plan()
    assert (plan.importance_number, plan.joint_number, plan.joint_draws) == (50, 50, 60)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[simulator", "is not TOML"),
        ("[simulat]", "unknown key simulat; there are simulator"),
        ("[trials]\nnumer = 3", "unknown key trials.numer; there are number"),
        ("[trials]\nchunk = 3", "trials: chunk is no longer a key; its name is block"),
        ("[trials]\nnumber = -3", "trials.number = -3 cannot be"),
        ("[trials]\nnumber = 20\nimportance_number = 50", "importance_number 50 is more than number 20"),
        ("[trials]\ndraws = 20\njoint_draws = 50", "joint_draws 50 is more than draws 20"),
        ("simulator = 3", "simulator = 3 cannot be: it must be a table"),
        ("[policy]\nerror_budget = 2.0", "error_budget = 2.0"),
        ("[policy.tolerance]\nbais = 0.1", "unknown key tolerance.bais"),
        ('[policy]\nbase = "lenient"', "lenient"),
        ('validators = ["sbs"]', "unknown validator sbs"),
        ("[estimator]\nname = 3", "estimator.name"),
    ],
)
def test_an_impossible_file_gets_one_line_that_names_it(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / "audit.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        read_config(file)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_one_that_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read"):
        read_config(tmp_path / "nowhere.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_config(tmp_path / "b.toml")


def test_where_draws_are_given_only_policy_and_validators_have_a_say(tmp_path: Path) -> None:
    file = tmp_path / "audit.toml"
    file.write_text('validators = ["coverage"]\n[policy.tolerance]\ncoverage = 0.02\n')
    config = read_config(file, draws_given=True)
    assert config.read_policy().tolerance.coverage == 0.02
    assert config.validators == ("coverage",)
    with pytest.raises(InputError, match="trials has no say where draws are given"):
        read_config(file, settings={"trials.number": 20}, draws_given=True)
