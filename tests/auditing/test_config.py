from pathlib import Path
from typing import Any

import pytest

from gaugeblock.auditing.config import AuditConfig, TrialsTable, as_policy, as_trials_table, read_config
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.errors import InputError
from gaugeblock.validate import read_policy


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


def test_every_path_that_exists_beside_the_file_is_meant_from_there(tmp_path: Path) -> None:
    """Of every key that is one, of bases within bases, of builders, sources and words of a command."""
    folder = tmp_path / "there"
    (folder / "a folder").mkdir(parents=True)
    for name in ("a", "run.py"):
        (folder / name).write_text("")
    file = folder / "audit.toml"
    file.write_text(
        """
[simulator]
name = "a"
pha = "a"
rmf = "none"
arf = "a folder"
priors = "a"
level = "a"
[trials]
observation = "a"
[estimator]
name = "stranger"
path = "a"
python = "a"
diagnosis = "a"
device = "a"
builder = "run.py:a"
command = ["python", "run.py", 3, "a folder", "none"]
[estimator.options]
source = "run.py"
other = "a"
[estimator.base]
name = "npe"
path = "a folder"
command = "run.py 'a folder' -v"
builder = "a"
"""
    )
    config = read_config(file)
    a, run, inner = str(folder / "a"), str(folder / "run.py"), str(folder / "a folder")
    assert config.simulator.table == {
        "name": "a", "pha": a, "rmf": "none", "arf": inner, "priors": a, "level": "a"
    }  # fmt: skip
    assert config.trials.observation == a
    assert config.estimator.table == {
        **{"name": "stranger", "path": a, "python": a, "diagnosis": a, "device": "a", "builder": f"{run}:a"},
        "command": ["python", run, "3", "a folder", "none"],
        "options": {"source": run, "other": "a"},
        "base": {"name": "npe", "path": inner, "command": [run, "a folder", "-v"], "builder": "a"},
    }


def test_modules_are_known_where_there_was_a_file(tmp_path: Path) -> None:
    file = tmp_path / "audit.toml"
    file.write_text("")
    typed = {"estimator.name": "mine.deep:draw"}
    assert read_config(file, settings=typed, allow_modules=["other"]).modules == {"mine.deep", "other"}
    assert read_config(file).modules == frozenset()
    assert read_config(None, settings=typed, allow_modules=["other"]).modules is None
    assert AuditConfig.build({}).modules is None


def test_what_has_no_say_and_who_says_so(tmp_path: Path) -> None:
    for name in ("simulator", "estimator", "trials"):
        with pytest.raises(InputError) as caught:
            read_config(None, settings={f"{name}.name": "a"}, draws_given=True)
        assert str(caught.value) == (
            f"command line: {name} has no say where draws are given; only policy, validators and summaries do"
        )
    file = tmp_path / "audit.toml"
    file.write_text("[estimator]\ntrust = 1\n")
    with pytest.raises(InputError, match=rf"^{file}: estimator.trust cannot be said by a file"):
        read_config(file)


@pytest.mark.parametrize(
    ("least", "below"),
    [
        ({"number": 10}, "number"),
        ({"draws": 2}, "draws"),
        ({"block": 1}, "block"),
        ({"importance_number": 0}, "importance_number"),
        ({"importance_draws": 10}, "importance_draws"),
        ({"joint_number": 0}, "joint_number"),
        ({"joint_draws": 2}, "joint_draws"),
        ({"seed": 0}, "seed"),
    ],
)
def test_the_least_of_each_number(least: dict[str, int], below: str) -> None:
    assert getattr(as_trials_table(least), below) == least[below]
    with pytest.raises(InputError, match=rf"^trials: {below} = {least[below] - 1} cannot be"):
        as_trials_table({below: least[below] - 1})


def test_a_plan_is_the_table_with_no_more_than_there_is() -> None:
    table = TrialsTable(number=150, draws=80, block=7, importance_draws=33, seed=5, anytime=True)
    assert table.plan() == Plan(
        number=150, draws=80, block=7, importance_number=150, importance_draws=33, joint_number=150,
        joint_draws=80, seed=5,
    )  # fmt: skip
    whole = {"number": 20, "draws": 20, "importance_number": 20, "joint_number": 20, "joint_draws": 20}
    plan = as_trials_table(whole).plan()
    assert (plan.importance_number, plan.joint_number, plan.joint_draws) == (20, 20, 20)


@pytest.mark.parametrize(("number", "likelihoods"), [(900, 900), (4000, 1000), (4003, 1000), (10_000, 2500)])
def test_likelihoods_are_evaluated_of_more_trials_where_there_are_more(number: int, likelihoods: int) -> None:
    assert as_trials_table(number).plan().joint_number == likelihoods
    assert as_trials_table({"number": number, "joint_number": 7}).plan().joint_number == 7
    assert as_trials_table({"number": number, "joint_number": 0}).plan().joint_number == 0


def test_trials_in_every_form() -> None:
    table = TrialsTable(number=50, block=5)
    over = as_trials_table(table, draws=7, seed=3)
    assert (over.number, over.block, over.draws, over.seed) == (50, 5, 7, 3)
    assert over.model_fields_set == {"number", "block", "draws", "seed"}
    assert as_trials_table(table) == table
    assert as_trials_table({"number": 30, "seed": 9}, seed=0).seed == 0
    assert as_trials_table(30).number == 30
    assert as_trials_table().number == 4000
    with pytest.raises(InputError, match="trials: number = 3 cannot be"):
        as_trials_table(3)


def test_policies_in_every_form(tmp_path: Path) -> None:
    strict = read_policy("strict")
    assert as_policy(strict) is strict
    assert as_policy("strict") == strict
    (tmp_path / "p.toml").write_text("error_budget = 0.02\n")
    table: dict[str, Any] = {"base": {"base": tmp_path / "p.toml", "tolerance": {"bias": 0.3}}}
    made = as_policy({**table, "tolerance": {"coverage": 0.2}})
    assert (made.error_budget, made.tolerance.bias, made.tolerance.coverage) == (0.02, 0.3, 0.2)
    assert table["base"]["base"] == tmp_path / "p.toml"
    with pytest.raises(InputError) as caught:
        as_policy(3, where="it")  # type: ignore[arg-type]
    assert str(caught.value) == "it cannot be a int: give default or strict, a TOML file, a table or a Policy"
