import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("sbi")

from gaugeblock.estimators.npe import TrainingConfig, read_config


def test_defaults_and_options(tmp_path):
    path = tmp_path / "train.toml"
    path.write_text('[simulator]\nname = "xray"\nlevel = "medium"\n[training]\nsteps = 7\n')
    config = read_config(path, overrides={"training.seed": 3, "network.bins": 4})
    assert config.simulator.options == {"level": "medium"}
    assert (config.training.steps, config.training.seed, config.network.bins) == (7, 3, 4)
    assert config.network.kind == "default"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[simulator\n", "is not TOML"),
        ("", "simulator is missing"),
        ("[simulator]\nlevel = 1\n", "simulator.name is missing"),
        ('[simulator]\nname = "a"\n[trainig]\n', "unknown key trainig; there are simulator, network"),
        (
            '[simulator]\nname = "a"\n[training]\nstep = 5\n',
            "unknown key training.step; there are simulations",
        ),
        (
            '[simulator]\nname = "a"\n[training]\nsteps = -5\n',
            "steps = -5 cannot be: .*greater than 0",
        ),
        (
            '[simulator]\nname = "a"\n[training]\nsteps = "many"\n',
            "steps = .many. cannot be: .*integer",
        ),
        ('[simulator]\nname = "a"\n[training]\nlearning_rate = nan\n', "training.learning_rate"),
        (
            '[simulator]\nname = "a"\n[training]\nvalidation = 0.9\n',
            "validation = 0.9 cannot be: .*than 0.5",
        ),
        (
            '[simulator]\nname = "a"\n[training]\nsimulations = 50\n',
            "batch 1024 is larger than simulations 50",
        ),
        ('[simulator]\nname = "a"\n[network]\nkind = "huge"\n', "network.kind = 'huge' cannot be"),
    ],
)
def test_a_bad_file_gives_one_line(tmp_path, text, message):
    path = tmp_path / "train.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_config(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_file_gives_one_line(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: cannot be read .No such file"):
        read_config(tmp_path / "none.toml")


def test_a_bad_override_gives_one_line():
    config = TrainingConfig.build({"simulator": {"name": "a"}})
    with pytest.raises(InputError, match=r"unknown key training\.speed"):
        config.replace({"training.speed": 1})
    with pytest.raises(InputError, match="name is a value, not a table"):
        config.replace({"simulator.name.deeper": 1})
