"""What the study's outputs have beside its text, by posteriors that are exact or wrong in a known way."""

from types import SimpleNamespace

import numpy as np
import pytest
from studies.paper.beyond import beside_its_text
from studies.paper.experiments import outputs
from studies.paper.experiments.line_bias import line_errors
from studies.paper.experiments.outputs import in_its_outputs

NOISE = 0.05
LOW, HIGH = np.full(5, 0.1), np.full(5, 2.5)


class Shrunk:
    """Posteriors of theta + noise on a flat prior, as wide as `share` says; they reach beyond the box."""

    box = LOW, HIGH

    def __init__(self, share=1.0, noise=NOISE):
        self.sd = share * noise

    def raw(self, x, n, rng):
        noise = rng.standard_normal((len(x), n, 5))
        log_q = -0.5 * (noise**2).sum(axis=-1) - 5 * np.log(self.sd)
        return x[:, None] + self.sd * noise, log_q

    def sample(self, x, n, rng):
        return self.raw(x, n, rng)[0]

    def inside(self, theta):
        return ((theta >= LOW) & (theta <= HIGH)).all(axis=-1)


@pytest.fixture(params=[NOISE])
def simulated(request, monkeypatch):
    """Five parameters, flat but for the logarithms of both norms, and their values with noise for data."""
    sd = request.param

    def fresh(simulator, number, seed):
        rng = np.random.default_rng(seed)
        theta = rng.uniform(LOW, HIGH, size=(number, 5))
        for norm in (2, 4):
            theta[:, norm] = LOW[norm] * (HIGH[norm] / LOW[norm]) ** rng.random(number)
        return theta, theta + sd * rng.normal(size=theta.shape)

    def likelihood(theta, x):
        return -0.5 * (((x[:, None] - theta) / sd) ** 2).sum(axis=-1)

    monkeypatch.setattr(outputs, "fresh", fresh)
    monkeypatch.setattr(outputs, "simulator_of", lambda level: None)
    monkeypatch.setattr(outputs, "WeightLevel", lambda level: SimpleNamespace(log_likelihood=likelihood))


SIZES = {"ranks": 400, "draws": 200, "refined": 1000, "weighted": 1000, "recovery": 2000}


def test_classifiers_and_tarp_see_what_is_too_narrow(simulated):
    exact, narrow = (
        outputs.by_ranks(Shrunk(share), "bright", SIZES, np.random.default_rng(1)) for share in (1.0, 0.2)
    )
    told = {name: [found[f"c2st_ranks/{name}"] for found in (exact, narrow)] for name in outputs.NAMES}
    # A forest tells whole ranks from numbers that are not, of exact posteriors too.
    whole = float(exact["c2st_ranks/whole"])
    assert whole > 0.6
    assert all(abs(first - whole) < 0.06 for first, _ in told.values())
    assert all(second > whole + 0.05 for _, second in told.values())
    assert exact["c2st_prior/value"] == pytest.approx(0.5, abs=0.05)
    # Draws that are too narrow call the truth far away too often: more is claimed than is held.
    assert abs(exact["tarp/area"]) < 2.0
    assert narrow["tarp/p"] < exact["tarp/p"]
    again = outputs.by_ranks(Shrunk(), "bright", SIZES, np.random.default_rng(1))
    assert {name: float(value) for name, value in again.items()} == {
        name: float(value) for name, value in exact.items()
    }


def test_weights_mend_a_width_under_the_prior_that_was_simulated_from(simulated):
    """Twice as wide as it should be: weights make it right; 1,000 spectra leave an exact one 0.01."""
    found = outputs.by_weights(Shrunk(2.0), "bright", SIZES, np.random.default_rng(1))
    assert found["refined/raw"] > 0.05
    assert found["refined/simulated"] < 0.015
    # Of normal weights of half the width; the other prior is nearly flat over so narrow posteriors.
    assert found["refined/effective"] == pytest.approx((np.sqrt(7.0) / 4.0) ** 5, rel=0.25)


@pytest.mark.parametrize("simulated", [0.3], indirect=True)
def test_the_other_prior_moves_what_it_weighs(simulated):
    """Where posteriors are a good part of the prior, one uniform in the norms puts two of five too high."""
    sizes = {**SIZES, "refined": 2000, "weighted": 3000}
    found = outputs.by_weights(Shrunk(noise=0.3), "bright", sizes, np.random.default_rng(2))
    assert found["refined/simulated"] < 0.015
    assert found["refined/refined"] > 0.02


def test_weights_add_up_to_one_and_are_equal_where_nothing_is_inside():
    weight = outputs.normalised(np.array([[0.0, np.log(3.0), -np.inf], [-np.inf] * 3]))
    np.testing.assert_allclose(weight, [[0.25, 0.75, 0.0], [1 / 3] * 3])


def test_recovery_and_joint_intervals_of_exact_posteriors(simulated):
    found = outputs.by_recovery(Shrunk(), "bright", SIZES, np.random.default_rng(1))
    assert found["joint/value"] == pytest.approx(0.9**5, abs=0.04)
    theta = outputs.fresh(None, SIZES["recovery"], 1)[0]
    share = theta[:, 0].var()
    assert found["recovery/nh"] == pytest.approx(np.sqrt(share / (share + NOISE**2)), abs=0.002)


def test_medians_are_clipped_and_not_rejected(xray_data):
    """Every draw far beyond the box: the median is the box's end, and the error that less the truth."""
    box = (np.array([0.0, 1.5, 0.0, 0.0, 0.0]), np.array([9.0, 2.0, 9.0, 9.0, 9.0]))
    far = SimpleNamespace(box=box, raw=lambda x, n, rng: (np.full((len(x), n, 5), 99.0), None))
    errors = line_errors(far, "medium", {"line": 7, "draws": 3}, np.random.default_rng(1))
    from studies.paper.grid_populations import cell_seed

    from gaugeblock.simulators.xray import published

    np.testing.assert_allclose(errors, 2.0 - published.theta(100, cell_seed("B1", 3e-4))[:7, 1])


def test_the_studys_outputs_are_all_held_against_ours():
    from studies.paper.experiment import committed
    from studies.paper.numbers import by_claim

    its, ours = in_its_outputs(), by_claim(committed("outputs"))
    assert set(its) == set(ours)
    assert all(set(parts) <= set(ours[key]) for key, parts in its.items())
    assert its["bright/refined"]["effective"] == pytest.approx(0.0091, abs=1e-4)
    assert its["medium/line 0.0003"] == {"mean": 0.095, "median": 0.098}


def test_the_page_has_them_with_the_scatter_between_trainings():
    from studies.paper.experiment import committed
    from studies.paper.numbers import by_claim

    table = committed("outputs")
    _, said, rows = beside_its_text({"outputs": table})
    assert f"mean of ours over {table.sizes['training']} trainings" in said
    place = next(
        i
        for i, (claim, part) in enumerate(zip(table["claim"].values, table["part"].values, strict=True))
        if (claim, part) == ("bright/joint", "value")
    )
    mean, sd = table["trained"].values[:, place].mean(), table["trained"].values[:, place].std(ddof=1)
    assert by_claim(table)["bright/joint"]["value"] == pytest.approx(mean)
    assert f"0.4, {mean:.3g} ± {sd:.2g} |" in rows
    assert beside_its_text({}) == []
