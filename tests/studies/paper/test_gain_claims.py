"""Pairs with a gain: common noise, summaries of known draws, and claims of known biases and widths."""

import numpy as np
import pytest
from scipy import stats
from studies.kit.resume import Pieces
from studies.paper.experiment import committed
from studies.paper.experiments.gain_claims import CURVE, claims_of
from studies.paper.experiments.gain_marginalised import LEVELS, RECIPES, measured, on_pairs
from studies.paper.experiments.gain_pairs import GAIN_RANGE, KINDS, MEMBERS, GainPairs, summaries
from studies.paper.judge import Agreement, judge
from studies.paper.numbers import as_table, by_claim
from studies.paper.paper_flow import TRAININGS, VARIANTS, record_of
from studies.paper.registry import claims
from studies.paper.trainings import by_training


class Normal:
    """Draws around the first channel's count: the photon index with sd 0.3; a gain like its prior."""

    def sample(self, x, n, rng):
        theta = np.ones((len(x), n, 6))
        theta[..., 1] = x[:, :1] + 0.3 * rng.standard_normal((1, n))
        theta[..., 2] = 10.0 ** x[:, 1:2]
        theta[..., 5] = rng.uniform(*GAIN_RANGE, (1, n))
        return theta


def test_summaries_of_known_draws():
    x = np.array([[2.0, -3.0], [1.5, -2.0]])
    found = summaries(Normal(), {"clean": x, "shifted": x + 0.1}, draws=20_000, seed=4)
    np.testing.assert_allclose(found["clean-alpha"], x[:, 0], atol=0.02)
    np.testing.assert_allclose(found["clean-alpha-sd"], 0.3, atol=0.01)
    np.testing.assert_allclose(found["clean-alpha-high"] - x[:, 0], 0.3 * stats.norm.ppf(0.95), atol=0.03)
    np.testing.assert_allclose(found["clean-norm"], x[:, 1])
    np.testing.assert_allclose(found["clean-gain-low"], 0.955, atol=0.002)
    # Members see the same noise: what differs is the spectra alone.
    np.testing.assert_allclose(found["shifted-alpha"] - found["clean-alpha"], 0.1)


def pairs(rng, number, *, bias, norm, gain_low=0.955):
    """Pairs whose flows are calibrated, but that the free one is a tenth wider."""
    theta = rng.uniform(1.0, 3.0, (number, 5))
    made = {"theta": theta}
    for kind, wide in zip(KINDS, (1.0, 1.1), strict=True):
        noise = 0.3 * rng.standard_normal(number)
        for member in MEMBERS:
            shift = (member == "shifted") * (bias + 0.05 * rng.standard_normal(number))
            middle = theta[:, 1] + noise + shift
            made |= {
                f"{kind}-{member}-alpha": middle,
                f"{kind}-{member}-alpha-sd": np.full(number, 0.3 * wide),
                f"{kind}-{member}-alpha-low": middle - 0.3 * wide * stats.norm.ppf(0.95),
                f"{kind}-{member}-alpha-high": middle + 0.3 * wide * stats.norm.ppf(0.95),
                f"{kind}-{member}-norm": noise + (member == "shifted") * norm,
            }
    for member in MEMBERS:
        made |= {
            f"marginalised-{member}-gain-low": np.full(number, gain_low),
            f"marginalised-{member}-gain-high": np.full(number, 1.045),
        }
    return made


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(0)
    runs = {f"medium-{k}": pairs(rng, 600, bias=0.02, norm=0.01) for k in range(3)}
    runs |= {f"bright-{k}": pairs(rng, 600, bias=0.03, norm=0.005) for k in range(3)}
    for run in ("bright-0",):
        runs[run]["marginalised-shifted-gain-low"][:60] = 1.001
    runs |= {
        f"{level}-exact": {
            f"exact-{member}-{name}": runs[f"{level}-0"][f"fixed-{member}-{name}"][:50]
            for member in MEMBERS
            for name in ("alpha", "alpha-sd", "norm")
        }
        for level in ("medium", "bright")
    }
    runs |= {
        f"curve {name}": pairs(rng, 300, bias=0.007 * per_cent, norm=0.0) for name, per_cent in CURVE.items()
    }
    return as_table(claims_of(runs, 3, rng) | {"gm.train": {"simulations": 50_000.0, "epochs": 130.0}})


def test_every_claim_is_measured_with_the_parts_it_needs(found):
    numbers = by_claim(found)
    needed = {name: claim for name, claim in claims().items() if claim.by == "gain_marginalised"}
    assert set(numbers) == set(needed)
    for name, claim in needed.items():
        assert set(claim.needs) <= set(numbers[name]), name


def test_what_is_said_of_every_claim(found):
    said = measured(found)
    mine = {name: claim for name, claim in claims().items() if claim.by == "gain_marginalised"}
    assert set(said) == set(mine)
    judged = {name: judge(claim, said[name]) for name, claim in mine.items()}
    assert judged["gm.train"].verdict is Agreement.AGREES
    assert judged["gm.bias.fixed.medium"].verdict is Agreement.AGREES
    assert judged["gm.g.width"].verdict is Agreement.AGREES
    assert judged["gm.KPL.bias.fixed"].verdict is Agreement.REPORTED


def test_biases_come_out_with_their_errors(found):
    numbers, errors = by_claim(found), by_claim(found, "standard_error")
    for claim, expected in (
        ("gm.bias.fixed.medium", 0.02),
        ("gm.bias.marg.medium", 0.02),
        ("gm.bias.bright", 0.03),
    ):
        error = errors[claim]["value"]
        assert error == pytest.approx(0.05 / np.sqrt(1800), rel=0.1)
        assert numbers[claim]["value"] == pytest.approx(expected, abs=4 * error)
    assert numbers["gm.bias.fixed.medium"]["less exact"] == 0.0
    fixed = numbers["gm.bias.fixed.medium"]
    assert fixed["over its error"] == pytest.approx(fixed["value"] / errors["gm.bias.fixed.medium"]["value"])
    assert errors["gm.bias.fixed.medium"]["over its error"] == 1.0
    assert numbers["gm.bias.sigma.medium"]["most"] == pytest.approx(0.02 / 0.3, abs=0.02)
    line, error = (table["gm.bias.lin.3pc"]["value"] for table in (numbers, errors))
    assert line == pytest.approx(0.021, abs=4 * error)
    assert error < 0.003
    assert numbers["gm.KPL.bias.fixed"]["value"] == pytest.approx(0.005)
    assert numbers["gm.KPL.bias.fixed"]["natural"] == pytest.approx(0.005 * np.log(10.0))


def test_widths_and_coverage(found):
    numbers, errors = by_claim(found), by_claim(found, "standard_error")
    assert numbers["gm.width.ratio.mean"] == {"least": pytest.approx(1.1), "most": pytest.approx(1.1)}
    assert numbers["gm.width.ratio.med90"]["most"] == pytest.approx(10.0)
    # 90 per cent, and what a tenth more holds; the bias takes little.
    wide = 2.0 * stats.norm.cdf(1.1 * stats.norm.ppf(0.95)) - 1.0
    assert numbers["gm.cov90"]["least"] == pytest.approx(0.9, abs=0.03)
    assert numbers["gm.cov90"]["most"] == pytest.approx(wide, abs=0.03)
    assert errors["gm.cov90"]["least"] == pytest.approx(0.007, abs=0.001)


def test_gains_that_exclude_one_are_counted(found):
    numbers = by_claim(found)
    assert numbers["gm.g.exclude"]["value"] == 60
    assert numbers["gm.g.exclude"]["share"] == pytest.approx(60 / 3600)
    assert numbers["gm.g.exclude"]["bright"] == pytest.approx(60 / 1800)
    assert numbers["gm.g.width"]["most"] == pytest.approx(1.0)
    # Nine tenths of the prior lie in its central 90 per cent.
    assert numbers["gm.g.width"]["most of all"] == pytest.approx(0.9)


def test_members_of_a_pair_share_theta_and_noise(xray_data):
    pytest.importorskip("jaxspec")
    rng = np.random.default_rng(1)
    theta, counts = GainPairs("medium").drawn(40, 3.0, rng)
    clean, shifted = (counts[member] for member in MEMBERS)
    expected = GainPairs("medium").simulator.expected(theta)
    assert np.abs(clean - expected).max() < 6 * np.sqrt(expected.max())
    noise = np.sqrt(expected.sum())
    # Independent members would differ by 1.4 noise; these by what the gain does.
    assert np.sqrt(((shifted - clean) ** 2).sum()) < 0.7 * noise
    assert not np.array_equal(clean, shifted)


class Scaled:
    """A photon index so many times a function of the data, and a gain like its prior."""

    def __init__(self, scale):
        self.scale = scale

    def sample(self, x, n, rng):
        theta = np.ones((len(x), n, 6))
        theta[..., 1] = self.scale * x[:, :1].astype(float) + 1e-3 * rng.standard_normal((1, n))
        theta[..., 5] = rng.uniform(*GAIN_RANGE, (1, n))
        return theta


def biases(folder, name, scales):
    """Means of shifts, by claim and part."""
    sizes = {"pairs": 60, "seeds": 1, "draws": 20, "exact": 2, "curve": 60}
    flows = {of: Scaled(scale) for of, scale in zip(RECIPES, scales, strict=True)}
    found = on_pairs(flows, sizes, Pieces(folder, {"scales": list(scales)}, name=name), 5)
    return {(claim, part): np.array(found[claim][part]) for claim, part in GROWS}


GROWS = {
    ("gm.bias.fixed.medium", "value"): 2.0,
    ("gm.bias.marg.medium", "value"): 3.0,
    ("gm.bias.bright", "value"): 5.0,
    ("gm.bias.bright", "marginalised"): 7.0,
    ("gm.bias.lin.3pc", "down 3"): 2.0,
    ("gm.bias.lin.3pc", "up 1"): 2.0,
}
"""How many times as large numbers are, of flows by level and kind that see 2, 3, 5 and 7 times as much."""


def test_every_flow_is_asked_of_its_own_level_and_kind(xray_data, tmp_path):
    """Of flows that see more of the same: what each number is of grows with its own."""
    pytest.importorskip("jaxspec")
    assert list(RECIPES) == [(level, kind) for level in LEVELS for kind in KINDS]
    one, more = (biases(tmp_path, "one", scales) for scales in ((1.0,) * 4, (2.0, 3.0, 5.0, 7.0)))
    for place, times in GROWS.items():
        assert one[place][0] != 0.0
        np.testing.assert_allclose(more[place], times * one[place], rtol=1e-9)
    # A gain to the other side shifts to the other side.
    assert one["gm.bias.lin.3pc", "down 3"][0] * one["gm.bias.fixed.medium", "value"][0] < 0.0
    # Another experiment sees the same pairs.
    for place, value in biases(tmp_path, "other", (1.0,) * 4).items():
        np.testing.assert_array_equal(value, one[place])


def test_recipes_are_of_their_level_and_have_a_gain_or_not():
    for (level, kind), name in RECIPES.items():
        variant = VARIANTS[name]
        assert (variant.response, variant.level, variant.gain) == ("epic-pn", level, kind == "marginalised")


def test_how_the_network_was_trained_is_off_its_records():
    records = [record_of(f"epic-pn-medium-gain{end}") for end in TRAININGS]
    train = claims()["gm.train"]
    assert by_training(train, "epochs").tolist() == [record["epochs"] for record in records]
    assert by_training(train, "simulations").tolist() == [50_000] * len(records)


def test_what_flows_of_our_own_give_stands_beside_every_number():
    ours = by_claim(committed("gain_ours"))
    said = measured(committed("gain_marginalised"))
    one, two = ours["gm.bias.fixed.medium"]["value"], ours["gm.cov90"]
    told = said["gm.bias.fixed.medium"].note
    assert told.startswith("less exact posteriors' of the same spectra ")
    assert f"; flows of our own give {one:.4g}, over its error " in told
    assert said["gm.cov90"].note == (
        f"flows of our own give least {two['least']:.4g}, most {two['most']:.4g}"
    )
    assert set(said) - set(ours) == {"gm.train"}
