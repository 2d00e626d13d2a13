import json
import shutil

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.linear_gaussian import LinearGaussian

pytest.importorskip("sbi")

from gaugeblock.estimators.npe import load, reference_model_path


@pytest.fixture
def folder(tmp_path, counts_folder):
    return shutil.copytree(counts_folder, tmp_path / "model")


def test_a_loaded_flow_gives_the_same_bits(counts_flow, counts_folder, counts):
    x = counts.simulate(counts.prior.sample(4, np.random.default_rng(1)), np.random.default_rng(2))
    first = counts_flow.sample_and_log_prob(x, 20, np.random.default_rng(3))
    again = load(counts_folder).sample_and_log_prob(x, 20, np.random.default_rng(3))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_the_folder_holds_weights_and_a_description_and_no_pickle(counts_folder):
    names = {path.name for path in counts_folder.iterdir()}
    assert {"model.safetensors", "model.json"} <= names <= {"model.safetensors", "model.json", "training.png"}
    description = json.loads((counts_folder / "model.json").read_text())
    assert description["parameters"] == ["slope", "norm"]
    assert description["features"] == "counts"
    assert description["training"]["seed"] == 1
    assert description["fresh_noise"] is True
    assert description["versions"]["sbi"]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda p: (p / "model.safetensors").unlink(), "model.safetensors: cannot be read .No such file"),
        (lambda p: (p / "model.json").unlink(), "model.json: cannot be read .No such file"),
        (lambda p: (p / "model.json").write_text('{"format": 1'), "not valid JSON"),
        (lambda p: (p / "model.json").write_text("[1, 2]"), "no description of a trained flow"),
        (lambda p: cut(p / "model.safetensors"), "sha256 differs"),
        (lambda p: flip(p / "model.safetensors"), "sha256 differs"),
        (lambda p: edit(p, format=99), "format 99"),
        (lambda p: edit(p, network={"transforms": 5}), "do not fit together"),
        (lambda p: edit(p, network={"layers": 5}), "do not fit together"),
        (lambda p: edit(p, data_shape=[10_000_001]), r"data of shape \(10000001,\)"),
        (lambda p: edit(p, data_shape=[3200, 3200]), r"data of shape \(3200, 3200\)"),
        (lambda p: edit(p, data_shape=[8, -1]), r"data of shape \(8, -1\)"),
        (lambda p: network(p, embedding=[200, 200]), "larger than its weights"),
        (lambda p: network(p, embedding_output=2000), "larger than its weights"),
        (lambda p: network(p, hidden=[200, 200]), "larger than its weights"),
        (lambda p: network(p, bins=2000), "larger than its weights"),
        (lambda p: network(p, transforms=1000), "larger than its weights"),
        (lambda p: network(p, kind="laplace", emulator=[200, 200]), "larger than its weights"),
        (lambda p: edit(p, prior={"slope": {"distribution": "cauchy"}}), "do not fit together"),
        (lambda p: edit(p, exposures=[1.0]), "do not fit together"),
        (lambda p: edit(p, exposures=[1.0, "x"]), "do not fit together"),
        (lambda p: edit(p, exposures=None), "do not fit together"),
        (lambda p: edit(p, exposures=[1.0, 2.0]), "do not fit together"),
        (lambda p: (edit(p, data_shape=[]), network(p, kind="laplace")), "do not fit together"),
    ],
)
def test_a_damaged_folder_gives_one_line(folder, damage, message):
    damage(folder)
    with pytest.raises(InputError, match=message) as caught:
        load(folder)
    assert "\n" not in str(caught.value)


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def flip(path):
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(bytes(content))


def edit(folder, **changes):
    path = folder / "model.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def network(folder, **changes):
    edit(folder, network={**json.loads((folder / "model.json").read_text())["network"], **changes})


def test_an_emulator_is_large_only_where_there_is_one(folder):
    network(folder, emulator=[200, 200])
    assert load(folder).record["network"]["emulator"] == [200, 200]


def test_another_prior_is_refused(counts_folder, make_counts):
    with pytest.raises(InputError, match=r"trained under the prior Uniform\(low=1.0, high=3.0\) of slope"):
        load(counts_folder, make_counts(high=4.0))


def test_other_parameters_are_refused(counts_folder):
    with pytest.raises(InputError, match="trained for the parameters slope, norm"):
        load(counts_folder, LinearGaussian(parameters=2))


def test_other_data_are_refused(counts_folder, make_counts):
    other = make_counts()
    other.data_shape = (9,)
    with pytest.raises(InputError, match=r"data of shape \(8,\), but the simulator makes \(9,\)"):
        load(counts_folder, other)


def test_an_unknown_shipped_flow_gives_one_line():
    with pytest.raises(InputError, match="no shipped flow 'epic-pn-huge'"):
        reference_model_path("epic-pn-huge")
