"""What comes with a line: seen, missing, or beyond these counts, each with what it would have taken."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery import Sources, discover_source
from gaugeblock.discovery.result import Estimate
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import Follower, Known, LibraryEffect, Stage

RATIO = 0.3
BETA, EDGE = Follower("toy beta", "line", 4.7, ratio=RATIO), Follower("toy edge", "edge", 3.8)
OTHER = Stage("toy X", 3.01, (Follower("toy edge", "edge", 4.1),))
ALPHA = Known("toy alpha", 3.0, 0, family=(Stage("toy I", 3.0, (BETA, EDGE)), OTHER))
FAR = Estimate(99.0)
KNOWN = (ALPHA, Known("toy beta", 4.7, 1), Known("other", 1.7, 0))


def searched(power_law, counts, ratio, depth=0.0, factor=1.01, seed=None, known=KNOWN, redshift=0.0):
    """A line of `counts` at 3 keV times a factor, what comes with it, and the first statement."""
    simulator, factor = power_law(), factor / (1.0 + redshift)
    for name, fixed in (
        ("line", {"energy": 3.0 * factor, "counts": counts}),
        ("line", {"energy": 4.7 * factor, "counts": ratio * counts}),
        ("edge", {"energy": 3.8 * factor, "depth": depth}),
    ):
        simulator = simulator.with_effect(Effect(name, fixed))
    mean = simulator.expected(np.array([10.0 * counts, 1.5]))
    made = np.round(mean) if seed is None else np.random.default_rng(seed).poisson(mean)
    plain = power_law()
    own = {
        key: entry if key == "edge" else type(entry)(**{**vars(entry), "known": known})
        for key, entry in plain.effect_library(np.array([[10.0 * counts, 1.5]])).items()
        if key in ("line", "edge")
    }
    sources = Sources.of(plain, made[None].astype(float), redshift=np.array([redshift]))
    return discover_source(sources, effects=own, only=("line", "edge"), replicates=399)


def alpha(found, at=3.0):
    """The statement of the line at 3 keV, or where a redshift has it."""
    return min(found.statements, key=lambda one: abs(one.parameters.get("energy", FAR).value - at))


def of(found, name, at=3.0):
    (said,) = [one for one in alpha(found, at).family.followers if one.name == name]
    return said


def test_a_follower_is_seen_at_its_ratio_also_where_the_search_found_it_as_a_line_of_its_own(power_law):
    found = searched(power_law, 20_000.0, RATIO)
    assert found.named_all.count("line") == 2
    said = of(found, "toy beta")
    assert said.seen
    assert said.ratio == pytest.approx(RATIO, abs=2.0 * said.error)
    assert said.expected == RATIO
    assert said.power == pytest.approx(RATIO / said.error)
    # Where the line says that it is: all of them are moved by one factor.
    assert said.energy_kev == pytest.approx(1.01 * 4.7, abs=0.01)
    assert "toy beta is there" in alpha(found).text
    assert alpha(found).family.stages == ("toy I",)


def test_the_error_of_a_ratio_is_what_it_scatters_by(power_law):
    drawn = [searched(power_law, 3_000.0, RATIO, seed=seed) for seed in range(12)]
    said = [of(one, "toy beta") for one in drawn if alpha(one).family]
    assert len(said) >= 10
    z = [(one.ratio - RATIO) / one.error for one in said]
    # Of a normal of unit width: the mean square of ten to twelve lies there with 99.9%.
    assert 0.2 < np.mean(np.square(z)) < 2.9
    assert abs(np.mean(z)) < 1.1


def test_that_it_does_not_follow_is_said_only_where_it_would_have_stood_out(power_law):
    many = searched(power_law, 20_000.0, 0.0)
    said = of(many, "toy beta")
    assert said.seen is False
    assert said.power > 5.0
    # An ionisation that has none fits better, and is said; the one that has does not any more.
    assert alpha(many).family.stages == ("toy X",)
    assert "toy beta does not follow (" in alpha(many).text
    assert f"{RATIO:g} of it would stand out by {said.power:.2g} standard errors" in alpha(many).text
    less = Stage("toy I", 3.0, (replace(BETA, ratio=0.1), EDGE))
    faint = Known("toy alpha", 3.0, 0, family=(less, OTHER))
    few = searched(power_law, 900.0, 0.0, known=(faint,))
    said = of(few, "toy beta")
    assert said.seen is None
    assert said.power < 3.0
    assert "whether toy beta follows these data cannot tell" in alpha(few).text
    assert alpha(few).family.stages == ("toy I", "toy X")


def test_a_line_and_its_follower_have_names_by_the_two_of_them_and_a_factor(power_law):
    found = searched(power_law, 20_000.0, RATIO)
    first = alpha(found)
    (second,) = [one for one in found.statements[:2] if one is not first]
    assert [one.name for one in first.identification] == ["toy alpha"]
    assert [one.name for one in second.identification] == ["toy beta"]
    assert first.identification[0].chance == second.identification[0].chance <= 0.01
    assert first.shifted == second.shifted
    assert first.shifted.low < 1.01 < first.shifted.high
    assert first.shifted.causes == ("gain", "motion")
    # Only what is there by no line of the search has no name by it.
    chance = first.family.chance
    assert 0.0 < chance < 0.2
    assert first.identification[0].chance == pytest.approx(first.within_gain[0].chance * chance)
    assert "a gain slope or a motion of -29" in first.text


def test_an_edge_that_comes_with_it_has_its_depth(power_law):
    said = of(searched(power_law, 20_000.0, RATIO, depth=0.2, redshift=0.29), "toy edge", 3.0 / 1.29)
    assert said.seen
    assert said.energy_kev == pytest.approx(1.01 * 3.8 / 1.29, rel=2e-3)
    # To first order, near an energy that was scanned.
    assert said.ratio == pytest.approx(0.2, abs=0.02)
    assert said.expected is None
    assert said.power is None
    none = of(searched(power_law, 20_000.0, RATIO), "toy edge")
    assert none.seen is None
    assert abs(none.ratio) < 3.0 * none.error


def test_without_a_family_nothing_is_said(power_law):
    found = searched(power_law, 20_000.0, RATIO, factor=1.1)
    assert alpha(found).family is None
    assert alpha(found).shifted is None


def test_a_follower_is_as_broad_as_its_line_and_itself(power_law):
    class Broad(power_law):
        """With lines that have a width."""

        def expected(self, theta):
            values, mean, at = np.asarray(theta, dtype=float), super().expected(theta), 2
            for _ in self.effects:
                energy, sigma, counts = np.moveaxis(values[..., at : at + 3, None], -2, 0)
                at += 3
                bell = np.exp(-0.5 * ((CENTRES - energy) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
                mean = mean + counts * bell * WIDTHS
            return mean

        def with_effect(self, effect):
            made = super().with_effect(effect)
            return Broad(made.effects, made.prior)

    (edges,) = [part.edges for part in power_law().segments()]
    CENTRES, WIDTHS = np.sqrt(edges.prod(axis=1)), np.diff(edges, axis=1)[:, 0]
    shoulder = Follower("toy shoulder", "broad", 4.4, width=0.3)
    known = (Known("toy alpha", 3.0, 0, family=(Stage("toy I", 3.0, (shoulder,)),)),)
    entry = LibraryEffect(
        name="broad", amplitude="counts", step=2000.0, cause="", typical="", known=known,
        energies=("energy", "sigma"),
        parameters={"energy": Uniform(0.6, 7.5), "sigma": Uniform(0.01, 1.0), "counts": Uniform(0.0, 1e6)},
        scanned={"energy": np.geomspace(0.7, 7.0, 36), "sigma": np.array([0.2])},
    )  # fmt: skip
    sigma = np.hypot(0.2 * 4.4 / 3.0, 0.3)
    simulator = Broad().with_effect(entry.effect()).with_effect(entry.effect())
    mean = simulator.expected(np.array([1e5, 1.5, 3.0, 0.2, 3e4, 4.4, sigma, 0.2 * 3e4]))
    found = discover_source(
        Sources.of(Broad(), np.round(mean)[None]), effects={"broad": entry}, only=("broad",), replicates=399
    )
    said = of(found, "toy shoulder")
    assert said.energy_kev == pytest.approx(4.4, rel=1e-3)
    assert said.ratio == pytest.approx(0.2, abs=0.3 * said.error)
