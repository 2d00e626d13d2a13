"""An experiment whose flows are trained several times: one table of all, and pieces of each apart."""

import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from studies.paper.experiment import Experiment, Setting, made, pieces_of
from studies.paper.numbers import as_table, measurements, together

SCATTER = {"": 0.0, "-seed101": 1.0, "-seed202": 5.0}


@pytest.fixture
def experiment(monkeypatch):
    monkeypatch.setattr("studies.paper.experiment.weights_of", lambda name: f"sha of {name}")

    def run(sizes, pieces, seed):
        drawn = pieces.one("draw", lambda rng: {"x": np.array(rng.random())}, seed)["x"]
        value = sizes["level"] + SCATTER[sizes["training"]]
        return as_table({"a": (value, 3.0 + SCATTER[sizes["training"]]), "b": float(drawn)}).assign(
            kept=float(value)
        )

    return Experiment(
        name="line_bias",
        says="s",
        sizes={Setting.FULL: {"level": 10.0}, Setting.TWIN: {"level": 20.0}},
        run=run,
        measured=lambda table: measurements(table, {}),
        flows=("cut",),
        retrained=("faint", "bright"),
        trainings=tuple(SCATTER),
    )


def test_numbers_are_means_over_trainings_and_kept_one_by_one(experiment, tmp_path):
    table = made(experiment, Setting.FULL, tmp_path, seed=1)
    assert table["number"].values[0] == pytest.approx(12.0)
    assert table["standard_error"].values[0] == pytest.approx(np.sqrt((3**2 + 4**2 + 8**2) / 3))
    assert table["trained"].sel(training="-seed202").values[0] == 15.0
    assert table["training"].values.tolist() == ["first", "-seed101", "-seed202"]
    # What is no number of a claim is the first's; spectra and draws are the same for every training.
    assert float(table["kept"]) == 10.0
    assert np.ptp(table["trained"].values[:, 1]) == 0.0
    found = experiment.measured(table)["a"]
    assert (found.parts["value"], found.trainings) == (12.0, 3)


def test_a_twin_takes_the_first_two(experiment, tmp_path):
    table = made(experiment, Setting.TWIN, tmp_path, seed=1)
    assert table["trained"].values[:, 0].tolist() == [20.0, 21.0]


def test_pieces_of_every_training_lie_apart(experiment, tmp_path):
    made(experiment, Setting.FULL, tmp_path, seed=1)
    assert len(list(tmp_path.iterdir())) == 3
    key = pieces_of(experiment, {"level": 10.0, "training": "-seed101"}, tmp_path, seed=1).key
    assert key["flows"] == {"cut": "sha of cut"}
    assert key["training"] == {
        "faint-seed101": "sha of faint-seed101",
        "bright-seed101": "sha of bright-seed101",
    }
    assert key["sizes"] == {"level": 10.0}


def test_what_no_training_decides_is_made_once_and_its_time_counted_once(experiment, tmp_path):
    asked = []

    def run(sizes, pieces, seed):
        def draw(seconds, rng):
            asked.append(sizes["training"])
            end = time.process_time() + seconds
            while time.process_time() < end:
                pass
            return {"x": np.array(rng.random())}

        shared = pieces.without("training").one("drawn", partial(draw, 0.4), seed)["x"]
        own = pieces.one("drawn", partial(draw, 0.0), seed)["x"]
        return as_table({"shared": float(shared), "own": float(own)})

    table = made(replace(experiment, run=run), Setting.FULL, tmp_path, seed=1)
    assert asked == ["", "", "-seed101", "-seed202"]
    assert [len(list(folder.glob("*.npz"))) for folder in tmp_path.iterdir()] == [1] * 4
    assert 0.4 <= table.attrs["cpu_seconds"] < 0.7
    again = made(replace(experiment, run=run), Setting.FULL, tmp_path, seed=1)
    assert len(asked) == 4
    assert again.attrs["cpu_seconds"] == table.attrs["cpu_seconds"]


def test_one_table_stays_as_it_is():
    table = as_table({"a": 1.0})
    assert together({"": table}) is table
    assert measurements(table, {})["a"].trainings == 1
