"""The learning curve: of the smaller model, each training in its own place, told by the same spectra."""

import numpy as np
import pytest
import xarray as xr
from studies.kit.resume import Pieces
from studies.paper.beyond import beyond, learning_curve
from studies.paper.experiments.learning_curve import IN_ITS_OUTPUTS, run, variant_of

pytest.importorskip("sbi")
pytest.importorskip("jaxspec")

from studies.paper.paper_flow.simulations import simulations

PARAMETERS = ("tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm")
SIZES = {"spectra": [300, 500], "seeds": [7, 8], "cap": 6, "test": 4000, "draws": 31}


def test_it_learns_from_the_smaller_model(xray_data):
    theta, counts = simulations(variant_of(4000, 5, 1))
    assert (theta.shape, counts.shape) == ((4000, 3), (4000, 102))
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(theta[:, 0], rng.uniform(0.1, 0.3, 4000))
    np.testing.assert_array_equal(theta[:, 1], rng.uniform(0.5, 2.5, 4000))
    np.testing.assert_allclose(theta[:, 2], 10 ** rng.uniform(-4, -2, 4000))
    # Medium counts; a power law has the larger ones where its norm is larger.
    assert np.median(counts.sum(axis=1)) == pytest.approx(1000, rel=0.05)
    assert np.corrcoef(np.log(theta[:, 2]), np.log(counts.sum(axis=1) + 1))[0, 1] > 0.8
    other = simulations(variant_of(4000, 6, 1))
    assert (other[0] != theta).all()


def test_a_training_is_the_studys_with_fewer_summaries(xray_data, tmp_path):
    from studies.paper.paper_flow import paper_flow
    from studies.paper.paper_flow.__main__ import train

    variant = variant_of(400, 5, 1)
    train({"learned": variant}, tmp_path, work=tmp_path / "work")
    flow = paper_flow("learned", tmp_path)
    assert flow.record["variant"] == {**variant.describe(), "base": True}
    assert flow.prior.names == PARAMETERS
    assert flow.embed(np.ones((2, 102))).shape == (2, 16)


def test_points_lie_where_they_belong(xray_data, tmp_path, monkeypatch):
    """Pretended trainings: medians are the counts with a noise that grows with the seed and fewer spectra."""
    made, seen = {}, []

    def train(names, folder, *, work):
        (variant,) = names.values()
        assert (variant.cap, variant.torch_seed) == (6, variant.data_seed)
        made[str(folder)] = variant

    class Flow:
        def __init__(self, variant):
            self.variant = variant
            size = variant.simulations
            self.record = {"validation": [-1.0, -float(size), *[-2.0] * (variant.data_seed - 6)]}

        def raw(self, x, n, rng):
            seen.append(np.asarray(x))
            total = np.log(x.sum(axis=1) + 1.0)
            noise = 30.0 / self.variant.simulations * (self.variant.data_seed - 6)
            center = (total + noise * 10 * rng.normal(size=len(x)))[:, None] * np.array([1.0, -1.0, 2.0])
            # One draw of each is far off: a median, and no mean, is what is held against the truth.
            draws = np.repeat(center[:, None], n, axis=1)
            draws[:, 0] = 1e9 * rng.normal(size=center.shape)
            return draws, None

    monkeypatch.setattr("studies.paper.paper_flow.__main__.train", train)
    monkeypatch.setattr(
        "studies.paper.experiments.learning_curve.paper_flow", lambda _name, folder: Flow(made[str(folder)])
    )
    table = run(SIZES, Pieces(tmp_path, {"a": 1}), 3)
    assert table["spectra"].values.tolist() == [300, 500]
    assert table["training"].values.tolist() == [7, 8]
    assert table["epochs"].values.tolist() == [[3, 4], [3, 4]]
    assert table["loss"].values.tolist() == [[-300, -300], [-500, -500]]
    norm = table["r"].sel(parameter="powerlaw_1.norm").values
    assert 0.3 < norm[0, 1] < norm[0, 0] - 0.02 < norm[1, 0] - 0.02
    assert norm[0, 1] < norm[1, 1] < norm[1, 0]
    assert all((x == seen[0]).all() for x in seen)
    assert len(seen) == 4
    assert seen[0].shape == (4000, 102)


def test_the_page_has_each_point_beside_the_studys():
    sizes = '{"cap": 120, "test": 2000}'
    values = np.array([[1.0, 2.0, 3.0]] * 3)
    table = xr.Dataset(
        {
            "epochs": (("spectra", "training"), 60 + values),
            "loss": (("spectra", "training"), -12 - values),
            "r": (("spectra", "training", "parameter"), 0.9 + 0.01 * values[..., None] + np.zeros(3)),
        },
        coords={"spectra": list(IN_ITS_OUTPUTS), "training": [1, 2, 3], "parameter": list(PARAMETERS)},
        attrs={"sizes": sizes},
    )
    title, said, rows = learning_curve({"learning_curve": table})
    assert "3 on spectra of their own" in said
    assert "at most 120 epochs" in said
    assert "200 spectra there and of 2,000\nhere" in said
    assert "| 25,000 | 121, 62 ± 1 | -12.41, -14.00 ± 1.00 | 0.810, 0.920 ± 0.010 |" in rows
    assert rows.count("\n") == 4
    assert title in beyond({"learning_curve": table})
    assert learning_curve({}) == []
    with pytest.raises(KeyError):
        learning_curve({"learning_curve": table.assign_coords(spectra=[1, 2, 3])})


def test_what_the_study_has_is_a_training_each():
    mean = {spectra: np.mean(its["r"]) for spectra, its in IN_ITS_OUTPUTS.items()}
    assert mean[10_000] == pytest.approx(0.7011, abs=1e-3)
    assert mean[25_000] == pytest.approx(0.9328, abs=1e-3)
    assert mean[50_000] == pytest.approx(0.9274, abs=1e-3)
