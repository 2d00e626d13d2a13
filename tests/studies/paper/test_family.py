"""How many cells should lie outside: simulated families, and what each source of scatter does to them."""

import numpy as np
import pytest
from studies.paper import Measured, claims, judge
from studies.paper.family import error_of, families, holm
from studies.paper.trainings import is_paired, scatter


@pytest.fixture(scope="module")
def cells():
    """Those whose networks were trained several times."""
    every = [entry for entry in claims().values() if entry.id.startswith("grid.")]
    return [cell for cell in every if scatter(cell, "value") is not None]


def replications(cells, number, *, wider=1.0):
    """Other measurements of all cells, independent, with the errors that their margins are judged by."""
    rng = np.random.default_rng(5)
    for _ in range(number):
        drawn = []
        for cell in cells:
            error = cell.error["value"]
            spectra = 0.0 if is_paired(cell) and not cell.known else error * (1.0 if cell.known else 2**0.5)
            spread = wider * np.hypot(spectra, scatter(cell, "value").error(1))
            centre = cell.known.get("value", cell.value)
            drawn.append(judge(cell, Measured(centre + spread * rng.normal(), error)))
        yield families(drawn)


def test_faithful_replications_have_as_many_outside_as_expected(cells):
    """24 times three: the mean excess is within 5 of its errors, p small as rarely as it says."""
    found = [entry for every in replications(cells, 24) for entry in every]
    assert len(found) == 72
    excess = np.array([entry.misses - entry.expected for entry in found])
    assert abs(excess.mean()) < 5 * excess.std() / np.sqrt(len(excess))
    assert sum(entry.p < 0.05 for entry in found) <= 10


def test_replications_with_twice_the_scatter_are_found(cells):
    (found,) = replications(cells, 1, wider=3.0)
    assert all(entry.adjusted < 0.05 for entry in found)
    assert all(entry.adjusted >= entry.p for entry in found)


def test_families_are_of_a_response_and_level_and_know_their_paired_cells(cells):
    found = families([judge(cell, Measured(cell.value, 0.03)) for cell in cells])
    assert [(entry.name, entry.cells, entry.paired) for entry in found] == [
        ("pn faint", 48, 0), ("pn medium", 48, 39), ("pn bright", 48, 48),
    ]  # fmt: skip
    other = claims()["grid.nicer.bright.B1.2e-05.D1"]
    assert families([judge(other, Measured(other.value, 0.03))]) == ()


def test_means_of_more_trainings_miss_less(cells):
    """Against one published training: ours scatters as s sqrt(2), a mean of nine as 1.05 s."""
    one, nine = (
        families([judge(cell, Measured(cell.value, 0.03, trainings=number)) for cell in cells])
        for number in (1, 9)
    )
    assert all(few.expected > many.expected for few, many in zip(one, nine, strict=True))


def test_flows_that_see_the_gain_miss_too_much(cells):
    medium = [cell for cell in cells if cell.id.startswith("grid.pn.medium.")]
    seen = [
        judge(cell, Measured(0.95 if cell.id.split(".")[3] in ("B4", "B3") else cell.value, 0.03))
        for cell in medium
    ]
    (found,) = families(seen)
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


def test_a_cell_has_the_error_of_spectra_that_its_difference_has():
    """None where spectra are in common, ours alone where the truth is known, else that of both."""
    errors = [
        error_of(judge(claims()[name], Measured(0.5, 0.03)))
        for name in ("grid.pn.bright.B1.2e-05.D1", "grid.pn.bright.B4.3.D1", "grid.nicer.bright.B1.2e-05.D1")
    ]
    both = np.hypot(0.03, claims()["grid.nicer.bright.B1.2e-05.D1"].error["value"])
    assert errors == pytest.approx([0.0, 0.03, both])
