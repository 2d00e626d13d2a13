"""`gaugeblock.check`: what it says, of which it is right, and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import gaugeblock as gb
from gaugeblock.auditing.checking import check
from gaugeblock.auditing.identity import versions
from gaugeblock.estimators import build_estimator
from gaugeblock.reports.check import check_lines
from gaugeblock.reports.check.effect_code import effect_code
from gaugeblock.simulators import build_simulator
from gaugeblock.simulators.segments import Segment
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.planted import possible

PRIOR = gb.Prior({"level": gb.Normal(0.0, 3.0), "slope": gb.Normal(0.0, 1.0)})
TIMES = np.linspace(-1.0, 1.0, 24)
SMALL = {"trials": 199, "simulations": 1000}


def line(theta, rng):
    """A line with noise."""
    theta = np.asarray(theta)
    return theta[:, :1] + theta[:, 1:] * TIMES + 0.3 * rng.standard_normal((len(theta), 24))


def made(seed, number=1):
    rng = np.random.default_rng(seed)
    x = line(PRIOR.sample(number, rng), rng)
    return x[0] if number == 1 else x


class Fit:
    """The exact posterior of the line, and a feature."""

    def sample(self, x, n, rng):
        design = np.stack([np.ones(24), TIMES], axis=1)
        precision = design.T @ design / 0.09 + np.diag([1 / 9.0, 1.0])
        mean = np.linalg.solve(precision, design.T @ np.asarray(x).T / 0.09).T
        root = np.linalg.cholesky(np.linalg.inv(precision))
        return mean[:, None] + rng.standard_normal((len(x), n, 2)) @ root.T

    def embed(self, x):
        return np.asarray(x).mean(axis=1, keepdims=True)


@pytest.fixture(scope="module")
def outlier():
    x = made(3)
    x[9] += 3.0
    return x


@pytest.fixture(scope="module")
def failed(outlier):
    return check(line, outlier, Fit(), prior=PRIOR, axes=["time"], coordinates=TIMES, seed=1, **SMALL)


def test_what_the_simulator_made_passes_and_says_what_it_would_have_seen():
    result = check(line, made(1), prior=PRIOR, seed=2, **SMALL)
    assert result.outcome == "PASS"
    assert result.passed
    ladder = {seen.kind: seen.smallest for seen in result.answer.ladder}
    assert set(ladder) == {"shift", "scale", "noise", "outliers", "component"}
    assert ladder["noise"] <= 0.3
    assert "90% power" in result.lines[1]
    assert not result.answer.effects


def test_a_pass_needs_the_power_to_have_seen_what_is_stated():
    result = check(line, made(1), prior=PRIOR, seed=2, sees={"noise": 0.01}, **SMALL)
    assert result.outcome == "INCONCLUSIVE"
    assert "a PASS needs noise of 0.01" in repr(result)


def test_an_outlier_fails_is_placed_and_named(failed):
    assert failed.outcome == "FAIL"
    assert failed.p_value == pytest.approx(1 / 200)
    first = failed.answer.where.places[0]
    assert (first.coordinate, first.name) == (9, f"time {TIMES[9]:.4g}")
    assert first.p_value == pytest.approx(1 / 200)
    assert first.expected[0] < first.expected[1] < first.expected[2] < first.observed
    assert first.expected[1] == pytest.approx(first.observed - 3.0, abs=1.0)
    assert failed.named == "outliers"
    assert "after fitting: largest" in failed.to_frame().index
    assert "features: distance" in failed.to_frame().index
    # Views that say most come first, and places are what the user calls them.
    rows = [(view.p_adjusted, view.p_value) for view in failed.answer.views]
    assert rows == sorted(rows)
    assert all(alone <= adjusted for adjusted, alone in rows)
    assert failed.answer.positions == tuple(TIMES)
    assert (failed.answer.fresh, failed.answer.learned, failed.answer.observations) == (199, 1000, 1)
    assert set(failed.answer.codes) == set(possible((24,), ladder=False))
    assert not failed.answer.has_effects
    record = failed.provenance
    assert (record["command"], record["seed"], record["versions"]) == ("", 1, versions())
    assert record["trials"] == {"trials": 199, "simulations": 1000, "draws": 24}
    assert (record["simulator"]["name"], record["estimator"]["name"]) == ("line", "Fit")
    assert set(record["sha256"]) == {"simulator", "estimator"}


def test_without_an_estimator_no_posterior_moves(outlier):
    result = check(line, outlier, prior=PRIOR, seed=1, level=1 / 200, **SMALL)
    assert result.outcome == "FAIL"
    assert result.p_value == result.answer.level  # at most this is a FAIL, with all that is said of one
    assert result.answer.moved == ()
    assert result.named == "outliers"
    assert dict(result.answer.not_checked).keys() == {"after fitting"}


def test_where_else_it_might_be_is_said_while_it_is_in_doubt(failed):
    place = failed.answer.where.places[0]
    assert place.departure > 5
    assert "instead" not in repr(failed)
    where = failed.answer.where
    doubtful = replace(where, places=(replace(place, departure=4.0), *where.places[1:]))
    said = check_lines(replace(failed.answer, where=doubtful))[2]
    rest = [one.name for one in where.places if not one.astray and one.family == "data"]
    assert said.endswith(f"; it might be {rest[0]} or {rest[1]} instead")


def test_the_posterior_moves_back_without_what_disagrees(outlier, failed):
    clean = outlier.copy()
    clean[9] -= 3.0
    wanted = Fit().sample(clean[None], 4000, np.random.default_rng(1))[0].mean(axis=0)
    there = Fit().sample(outlier[None], 4000, np.random.default_rng(1))[0]
    for moved, mean, now, sd in zip(
        failed.answer.moved, wanted, there.mean(axis=0), there.std(axis=0), strict=True
    ):
        assert moved.before == pytest.approx((now, sd), abs=0.01)
        assert moved.after[1] == pytest.approx(sd, abs=0.01)
        assert abs(moved.after[0] - mean) < abs(moved.before[0] - mean) + 0.02
        assert moved.after[0] == pytest.approx(mean, abs=0.08)
    assert failed.answer.moved[0].shift < -0.5


def test_the_split_along_parameters_is_that_of_least_squares(failed):
    """An outlier of 3 in one of 24 readings with noise of 0.3: by the textbook."""
    design = np.stack([np.ones(24), TIMES])
    posterior = np.linalg.inv(design @ design.T / 0.09 + np.diag([1 / 9.0, 1.0]))
    size = failed.answer.where.observed[9] - failed.answer.where.expected[0][9]
    moved = posterior @ design[:, 9] * size / 0.09
    pulls = failed.answer.along.pulls
    for i, name in enumerate(("level", "slope")):
        assert pulls[name] == pytest.approx(moved[i] / posterior[i, i] ** 0.5, abs=0.5)
    assert failed.answer.along.share < 0.15
    for one in failed.answer.moved:
        assert pulls[one.parameter] == pytest.approx(-one.shift, abs=0.6)
    content = failed.to_json()["along_parameters"]
    assert content["pulls"] == pulls
    assert f"{failed.answer.along.share:.0%} of the disagreement lies along" in repr(failed)


def test_what_is_left_after_fitting_sees_what_a_wide_prior_hides():
    """A bump of the noise's size, far below the prior's spread."""
    found = []
    for seed in range(8):
        x = made(40 + seed) + 1.1 * np.exp(-0.5 * ((TIMES - 0.2) / 0.15) ** 2)
        result = check(line, x, Fit(), prior=PRIOR, seed=seed, views=["after fitting: runs"], **SMALL)
        found.append(result.p_value)
    assert np.median(found) <= 0.05


def test_false_alarms_of_whole_checks():
    """Fresh views, fresh simulations and a fresh observation each time: 120 checks, rejections at 10%."""

    def small(theta, rng):
        return np.round(np.exp(theta[:, :1]) * rng.standard_cauchy((len(theta), 3)))  # heavy, discrete

    prior = gb.Prior({"size": gb.Normal(0.0, 1.0)})
    p = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        x = small(prior.sample(1, rng), rng)[0]
        views = ["distance", "neighbours", "largest"]
        p.append(check(small, x, prior=prior, seed=seed, trials=99, simulations=198, views=views).p_value)
    rejected = int(np.count_nonzero(np.array(p) <= 0.1))
    assert stats.binomtest(rejected, 120, 0.1).pvalue > 1e-3


def test_what_a_check_made_it_ends_and_what_it_was_given_it_does_not():
    class Closing(Fit):
        closed = 0

        def close(self):
            Closing.closed += 1

    few = {"prior": PRIOR, "seed": 1, "trials": 99, "simulations": 198, "draws": 4, "views": ["distance"]}
    check(line, made(1), Closing(), **few)
    assert Closing.closed == 0
    check(line, made(1), Closing, **few)
    assert Closing.closed == 1


def test_views_are_learned_on_other_simulations_than_those_that_are_ranked(monkeypatch):
    seen = {}
    from gaugeblock.auditing import checking

    class Kept(checking.Predictive):
        def pairs(self, number):
            theta, seen[self.purpose] = super().pairs(number)
            assert len(theta) == len(seen[self.purpose]) == number
            return theta, seen[self.purpose]

    monkeypatch.setattr(checking, "Predictive", Kept)
    check(line, made(1), prior=PRIOR, seed=2, **SMALL)
    assert set(seen) == {"learned", "ranked", "planted"}
    for one, other in (("learned", "ranked"), ("learned", "planted"), ("ranked", "planted")):
        assert not np.isin(seen[one][:, 0], seen[other][:, 0]).any()
    assert {purpose: len(x) for purpose, x in seen.items()} == {
        "learned": 1000,
        "ranked": 199,
        "planted": 200,
    }
    # Several observations need others enough to stand in for them.
    check(line, made(1, 42), prior=PRIOR, seed=2, trials=99, simulations=198, views=["distance"])
    assert {purpose: len(x) for purpose, x in seen.items()} == {"learned": 198, "ranked": 420, "planted": 210}


@pytest.mark.parametrize(
    ("parts", "given", "axes", "positions"),
    [
        ([("day", 6)], {}, ("day",), (0.5, 2.0, 4.5, 8.0, 12.5, 18.0)),
        ([("day", 6)], {"axes": ["hour"]}, ("hour",), ()),
        ([("day", 6)], {"coordinates": range(6)}, None, (0, 1, 2, 3, 4, 5)),
        ([("day", 6)], {"coordinates": list("abcdef")}, None, ()),
        ([("day", 3), ("day", 6)], {}, None, ()),
        ([("day", 5)], {}, None, ()),
        ([], {}, None, ()),
    ],
)
def test_places_are_called_as_the_simulator_does_where_its_data_are_one_part(parts, given, axes, positions):
    class Parted:
        prior = gb.Prior({"level": gb.Normal(0.0, 1.0)})

        def simulate(self, theta, rng):
            return rng.normal(theta, 1.0, (len(theta), 6))

        def segments(self):
            edges = np.array([[0, 1], [1, 3], [3, 6], [6, 10], [10, 15], [15, 21]], dtype=float)
            return tuple(
                Segment(f"part {k}", 0, stop, edges[:stop], unit) for k, (unit, stop) in enumerate(parts)
            )

    few = {"seed": 1, "trials": 99, "simulations": 198, "views": ["distance"]}
    found = check(Parted(), np.zeros(6), **few, **given).answer
    assert found.axes == (axes or Coordinates.of((6,)).axes)
    assert found.positions == pytest.approx(positions)


def test_several_observations_and_a_shift_that_all_share():
    x = made(5, number=30)
    assert check(line, x, prior=PRIOR, seed=3, **SMALL).outcome != "FAIL"
    result = check(line, x + 0.25 * (np.arange(24) == 7), prior=PRIOR, seed=3, **SMALL)
    assert result.outcome == "FAIL"
    assert result.answer.observations == 30
    assert result.answer.where.places[0].coordinate == 7
    assert "shared shift" in result.to_frame().index


def test_images_and_counts_and_numbers():
    def image(theta, rng):
        grid = np.hypot(*np.meshgrid(np.arange(8) - 3.5, np.arange(10) - 4.5, indexing="ij"))
        return rng.poisson(np.exp(np.asarray(theta)[:, :1, None]) * np.exp(-grid / 3))

    prior = gb.Prior({"log_rate": gb.Normal(3.0, 0.5)})
    rng = np.random.default_rng(6)
    x = image(prior.sample(1, rng), rng)[0]
    x[1, 8] += 40
    result = check(image, x, prior=prior, seed=4, **SMALL)
    assert result.outcome == "FAIL"
    assert result.answer.where.places[0].name == "row 1, column 8"
    assert (result.answer.where.expected >= 0).all()
    assert "<svg" in result._repr_html_() or "FAIL" in result._repr_html_()

    def number(theta, rng):
        return np.asarray(theta)[:, 0] + rng.standard_normal(len(theta))

    wide = gb.Prior({"m": gb.Normal(0.0, 1.0)})
    assert check(number, 40.0, prior=wide, seed=5, **SMALL).outcome == "FAIL"
    alone = check(number, 0.3, prior=wide, seed=5, **SMALL)
    assert alone.outcome == "INCONCLUSIVE"  # noise of one spread hides in a single number


def test_a_channel_that_never_varies():
    def dead(theta, rng):
        x = line(theta, rng)
        x[:, 4] = 0.0
        return x

    x = made(7)
    x[4] = 0.0
    assert check(dead, x, prior=PRIOR, seed=6, **SMALL).outcome == "PASS"
    x[4] = 0.01
    result = check(dead, x, prior=PRIOR, seed=6, **SMALL)
    assert result.outcome == "FAIL"
    assert result.answer.where.places[0].coordinate == 4


def test_views_and_summaries_of_ones_own():
    x = made(9)
    x[::2] += 1.0
    own = {"zigzag": lambda d: (d * (-1) ** np.arange(24)).sum(axis=1)}
    result = check(line, x, prior=PRIOR, seed=7, views=own, **SMALL)
    assert result.answer.views[0].name == "zigzag" or result.to_frame().loc["zigzag", "p_value"] <= 0.05
    # Low is as odd as high.
    spread = {"spread": lambda d: np.log(d.std(axis=1) + 1e-3)}
    flat = check(line, np.full(24, 1.0), prior=PRIOR, seed=7, views=spread, **SMALL)
    assert flat.to_frame().loc["spread", "p_value"] <= 0.05
    summed = check(
        line, x, prior=PRIOR, seed=7, summaries=lambda d: d.reshape(-1, 12, 2).mean(axis=2), **SMALL
    )
    assert "summaries: distance" in summed.to_frame().index


REFUSED = {
    "NaN": ({"x": np.where(np.arange(24) == 3, np.nan, 0.0)}, "1 of 24 numbers are NaN"),
    "shape": ({"x": np.zeros(23)}, r"shape \(23,\)"),
    "view": ({"views": ["nonsense"]}, "no nonsense; for these data there are distance"),
    "sees": ({"sees": {"wobble": 1.0}}, "wobble; for these data there are shift"),
    "few": ({"trials": 10}, "trials >= 99"),
    "function": ({"views": {"mine": lambda d: d}}, "24 numbers for a data set"),
    "broken": ({"views": {"mine": lambda d: 1 / 0}}, "mine failed on data of shape"),
    "axes": ({"axes": ["row", "column"]}, "2 names for data with 1 axes"),
    "labels": ({"coordinates": [1, 2]}, "2 labels for data of shape"),
    "none": ({"x": None}, "give the observation"),
}


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_what_cannot_be_used_is_said_in_one_line(name):
    given, said = REFUSED[name]
    with pytest.raises(gb.InputError, match=said) as caught:
        check(line, **{"x": made(1), "prior": PRIOR, **SMALL, **given})
    assert "\n" not in str(caught.value)


def test_estimators_that_stray_outside_the_prior_or_give_nan_are_survived():
    class Wild:
        def sample(self, x, n, rng):
            draws = 50.0 * rng.standard_normal((len(x), n, 1))
            draws[:, 0] = np.nan
            return draws

    def positive(theta, rng):
        assert (theta > 0).all()
        return rng.normal(theta, 1.0, (len(theta), 6))

    prior = gb.Prior({"rate": gb.Uniform(0.0, 3.0)})
    assert check(positive, np.ones(6), Wild(), prior=prior, seed=1, **SMALL).p_value > 0


def test_files_are_what_the_result_says(failed, tmp_path):
    failed.save(tmp_path)
    content = json.loads((tmp_path / "check.json").read_text())
    assert content["verdict"] == "FAIL"
    assert content["where"][0]["coordinate"] == 9
    assert content["p_value"] == failed.p_value
    page = (tmp_path / "report.html").read_text()
    assert "time 17" not in page
    assert 'class="astray"' in page
    # Rings, not discs: a rule for circles takes their filling away.
    assert "svg :is(path, circle, rect).astray:not(.line, .points) { fill: none;" in page
    assert "The lines that turn the best guess into an Effect" in page
    assert len(repr(failed)) < 2000
    assert "FAIL" in failed._repr_html_()
    with pytest.raises(gb.InputError, match="neither true nor false"):
        bool(failed)


@pytest.mark.parametrize("what", ["where", "views", "would_see"])
def test_pictures(failed, what):
    pytest.importorskip("matplotlib")
    assert failed.plot(what).get_title() == "FAIL, p = 0.005"
    with pytest.raises(gb.InputError, match="no picture"):
        failed.plot("what")


@pytest.mark.parametrize("name", sorted(possible((24,), ladder=False)))
def test_the_lines_of_the_page_run(name, monkeypatch):
    """Up to the search itself: the effect changes data, at 0 not at all."""
    codes = {key: one.code for key, one in possible((24,), ladder=False).items()}
    text = effect_code(name, codes)
    monkeypatch.setattr(gb, "discover", lambda simulator, x, *, prior, effects: effects[0])
    space = {"simulator": line, "x": made(1), "prior": PRIOR}
    exec(text.replace("gb.discover", "gb.discover"), space)
    effect = space["found"]
    theta, rng = PRIOR.sample(4, np.random.default_rng(1)), np.random.default_rng
    space["rng"] = rng(3)
    none = effect.kind(line, theta, {"a": np.zeros(4)}, rng(2))
    some = effect.kind(line, theta, {"a": np.full(4, 0.5)}, rng(2))
    assert np.allclose(none, line(theta, rng(2)))
    assert not np.allclose(some, none)


def test_the_same_seed_gives_the_same_answer_by_name_or_by_object():
    simulator = build_simulator("linear_gaussian")
    x = simulator.simulate(simulator.prior.sample(1, np.random.default_rng(1)), np.random.default_rng(2))[0]
    one = gb.check("linear_gaussian", x, "exact", seed=5, **SMALL)
    other = gb.check(simulator, x, build_estimator("exact", simulator), seed=5, **SMALL)
    assert one.answer.to_json() == other.answer.to_json()
    assert one.p_value != gb.check(simulator, x, seed=6, **SMALL).p_value
