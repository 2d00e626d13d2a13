"""How many cells should lie outside: simulated families, and what each source of scatter does to them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from studies.paper import Measured, claims, judge
from studies.paper.experiment import committed
from studies.paper.family import FAMILIES, families, holm, of_spectra, of_trainings
from studies.paper.judge import seen_of
from studies.paper.trainings import by_training, scatter

LEVELS = ("faint", "medium", "bright")


@pytest.fixture(scope="module")
def cells():
    """Those on EPIC-pn, whose networks were trained several times."""
    return [claim for claim in claims().values() if claim.id.startswith("grid.pn.")]


@pytest.fixture(scope="module")
def seen(cells):
    """As the judge sees them, four trainings of ours as published."""
    return [
        seen_of(
            cell,
            cell.rules[0].margins(cell.parts)[0],
            Measured(cell.value, cell.error["value"], trainings=4),
        )
        for cell in cells
    ]


def replications(cells, seen, number, *, wider=1.0):
    """Other measurements of all cells, independent, with the errors that their margins are judged by."""
    rng = np.random.default_rng(5)
    for _ in range(number):
        drawn = []
        for cell, one in zip(cells, seen, strict=True):
            # The true scatter is not what is known of it: a normal number, wider as its estimate may be off.
            trained = one.scatter.error(4, published=one.around) / np.sqrt(
                rng.chisquare(one.scatter.df) / one.scatter.df
            )
            spread = wider * np.sqrt(one.ours**2 + one.fixed**2 + trained**2)
            centre = cell.known.get("value", cell.value)
            error = cell.error["value"]
            drawn.append(judge(cell, Measured(centre + spread * rng.normal(), error, trainings=4)))
        yield families(drawn)


def test_faithful_replications_have_as_many_outside_as_expected(cells, seen):
    """24 times three: the mean excess is within 4 of its errors, p small as rarely as it says."""
    found = [entry for every in replications(cells, seen, 24) for entry in every]
    assert len(found) == 72
    excess = np.array([entry.misses - entry.expected for entry in found])
    assert abs(excess.mean()) < 4 * excess.std() / np.sqrt(len(excess))
    # One in ten thousand.
    assert sum(entry.p < 0.05 for entry in found) <= stats.binom.ppf(1 - 1e-4, 72, 0.05)


def test_replications_with_thrice_the_scatter_are_found(cells, seen):
    (found,) = replications(cells, seen, 1, wider=3.0)
    assert all(entry.adjusted < 0.05 for entry in found)
    assert all(entry.adjusted >= entry.p for entry in found)


def test_families_are_of_a_response_and_level(cells):
    others = [claim for claim in claims().values() if claim.id.startswith("grid.nicer.")]
    found = families([judge(cell, Measured(cell.value, 0.03)) for cell in cells + others])
    assert [(entry.name, entry.cells, entry.paired) for entry in found] == [
        ("pn faint", 48, 0), ("pn medium", 48, 27), ("pn bright", 48, 36),
        ("nicer faint", 45, 0), ("nicer medium", 36, 0), ("nicer bright", 36, 0),
    ]  # fmt: skip


def test_a_network_moves_all_cells_at_once_as_the_kept_trainings_do(cells, seen):
    """The correlation of any two cells is theirs over the four trainings, as far as 2,000 draws tell."""
    some = [place for place, cell in enumerate(cells) if ".bright." in cell.id][::5]
    chosen = [replace(seen[i], scatter=replace(seen[i].scatter, df=1e9)) for i in some]
    moved = of_trainings(tuple(cells[i] for i in some), chosen, np.random.default_rng(1))
    assert moved.shape == (FAMILIES, len(some))
    kept = np.corrcoef([by_training(cells[i]) for i in some])
    np.testing.assert_allclose(np.corrcoef(moved.T), kept, atol=0.12)
    width = [one.scatter.error(4, published=one.around) for one in chosen]
    np.testing.assert_allclose(moved.std(axis=0), width, rtol=0.08)


def test_how_wide_a_network_moves_a_cell_is_itself_uncertain(cells, seen):
    """A t law: of five degrees of freedom 10% lie beyond 2.02 standard deviations, of a normal 4.4%."""
    moved = of_trainings(tuple(cells), seen, np.random.default_rng(2))
    known = np.array([one.scatter.error(4, published=one.around) for one in seen])
    df = np.array([one.scatter.df for one in seen])
    assert np.mean(np.abs(moved / known) > stats.t.ppf(0.95, df)) == pytest.approx(0.1, abs=0.01)


def test_spectra_move_all_cells_at_once_as_bootstrap_replicates_do(cells):
    """As far as 2,000 draws of 500 tell; a detector's cells share clean spectra, two sets share none."""
    some = [cell for cell in cells if cell.id.startswith("grid.pn.faint.")]
    drawn = of_spectra(some, np.random.default_rng(3))
    assert drawn.shape == (2, FAMILIES, 48)
    np.testing.assert_allclose(drawn.std(axis=1, ddof=1), 1.0, atol=0.07)
    np.testing.assert_allclose(drawn.mean(axis=1), 0.0, atol=0.09)
    table = committed("detection").sel(response="epic-pn", level="faint")
    kept = table["replicates"].stack(cell=("family", "strength", "detector")).values
    assert kept.shape == (500, 48)
    np.testing.assert_allclose(np.corrcoef(drawn[0].T), np.corrcoef(kept.T), atol=0.09)
    names = [cell.id for cell in some]
    same = [names.index(f"grid.pn.faint.B4.{strength}.D1") for strength in ("0.5", "1", "3")]
    np.testing.assert_allclose(
        np.corrcoef(drawn[1].T)[np.ix_(same, same)][np.triu_indices(3, 1)], 1 / 3, atol=0.15
    )
    across = np.corrcoef(drawn[0].T, drawn[1].T)[:48, 48:]
    assert np.abs(across).max() < 0.1


def test_replicates_that_are_kept_have_the_errors_of_their_cells():
    for name in ("detection", "detection_nicer"):
        table = committed(name)
        found = table["replicates"].values.std(axis=1, ddof=1)
        np.testing.assert_allclose(found, table["auc_error"].values, rtol=1e-3)
        assert found.shape[1:] == (3, 4, 4, 3)


def test_spectra_alone_make_fewer_miss_and_none_of_those_in_common(cells):
    """On faint ones 5 in 100 of 36 cells, and of B4 what 0.08 leaves of an error of 0.03."""
    found = {
        entry.name: entry for entry in families([judge(cell, Measured(cell.value, 0.03)) for cell in cells])
    }
    assert all(0.0 <= entry.bare < entry.expected for entry in found.values())
    gain = 12 * 2 * stats.norm.sf(0.08 / 0.03)
    # Two errors of 0.03 and about 0.035, against 2 sqrt(2) of the second.
    other = sum(
        2 * stats.norm.sf(cell.rules[0].distance / np.hypot(0.03, cell.error["value"]))
        for cell in cells
        if cell.id.startswith("grid.pn.faint") and not cell.known
    )
    assert found["pn faint"].bare == pytest.approx(gain + other, rel=0.15)
    assert found["pn bright"].bare == pytest.approx(gain, rel=0.3)


def test_means_of_more_trainings_miss_less(cells):
    """Against one published training: ours scatters as s sqrt(2), a mean of nine as 1.05 s."""
    one, nine = (
        families([judge(cell, Measured(cell.value, 0.03, trainings=number)) for cell in cells])
        for number in (2, 9)
    )
    assert all(few.expected > many.expected for few, many in zip(one, nine, strict=True))


def test_flows_that_see_the_gain_miss_too_much(cells):
    medium = [cell for cell in cells if cell.id.startswith("grid.pn.medium.")]
    told = [
        judge(cell, Measured(0.95 if cell.id.split(".")[3] in ("B4", "B3") else cell.value, 0.03))
        for cell in medium
    ]
    (found,) = families(told)
    assert found.misses >= 20
    assert found.adjusted < 0.01


def test_holm_multiplies_the_smallest_p_by_the_number_of_families(cells):
    drawn = [
        judge(cell, Measured(0.95 if cell.id.startswith("grid.pn.faint") else cell.value, 0.03))
        for cell in cells
    ]
    found = {entry.name: entry for entry in families(drawn)}
    assert found["pn faint"].adjusted == pytest.approx(3 * found["pn faint"].p)


def test_only_measured_cells_are_counted(cells):
    assert families([judge(claims()["ns.n"], Measured(76)), judge(cells[0], None)]) == ()


def test_holm_steps_down_and_never_falls():
    np.testing.assert_allclose(holm(np.array([0.5, 0.01, 0.02, 0.021])), [0.5, 0.04, 0.06, 0.06])
    np.testing.assert_allclose(holm(np.array([0.9, 0.8])), [1.0, 1.0])


def test_a_cell_counts_the_spectra_that_its_difference_has():
    """None where spectra are in common, ours alone where the truth is known, else those of both."""
    names = ("grid.pn.bright.B1.2e-05.D1", "grid.pn.bright.B4.3.D1", "grid.nicer.bright.B1.2e-05.D1")
    found = []
    for name in names:
        cell = claims()[name]
        (margin,) = cell.rules[0].margins(cell.parts)
        one = seen_of(cell, margin, Measured(0.5, 0.03))
        assert one.scatter == scatter(cell, "value", error=0.03)
        found.append(np.hypot(one.ours, one.fixed))
    both = np.hypot(0.03, claims()[names[2]].error["value"])
    assert found == pytest.approx([0.0, 0.03, both])
