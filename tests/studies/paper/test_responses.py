"""The figure that holds two responses side by side: what it draws of the study, and of the responses."""

import numpy as np
import pytest
from studies.paper import claims
from studies.paper.experiment import committed

pytest.importorskip("matplotlib")
pytest.importorskip("jaxspec")


@pytest.fixture(scope="module")
def axes():
    from studies.kit import plots
    from studies.paper.detection_figures import responses_figure

    pyplot = plots.pyplot()
    figure = responses_figure(pyplot, {n: committed(n) for n in ("setup", "detection", "detection_nicer")})
    yield figure.axes
    pyplot.close(figure)


def drawn(axis, face):
    """What is drawn in filled or in open symbols, by colour and style of the line."""
    lines = [line for line in axis.lines if line.get_marker() == "o"]
    return {
        (line.get_color(), line.get_linestyle()): np.asarray(line.get_ydata())
        for line in lines
        if (line.get_markerfacecolor() == "white") == (face == "open")
    }


def test_the_best_published_cells_are_those_of_the_studys_table(axes):
    """Its table of the best of both detectors on EPIC-pn, to two digits; 0.96 of the line on NICER."""
    from studies.kit.plots import BLUE, ORANGE

    published = drawn(axes[0], "open")
    assert len(published) == 4
    np.testing.assert_allclose(published[BLUE, "-"], [0.76, 0.97, 0.97], atol=0.0051)
    np.testing.assert_allclose(published[ORANGE, "-"], [0.58, 0.51, 0.51], atol=0.0051)
    assert published[BLUE, "--"][-1] == pytest.approx(0.96, abs=0.0051)
    assert published[ORANGE, "--"].max() <= claims()["det.B4.nicer36"].parts["max"] + 1e-9


def test_our_best_cells_are_means_over_trainings(axes):
    from studies.kit.plots import BLUE
    from studies.paper.numbers import by_claim

    numbers = by_claim(committed("detection"))
    bright = [
        numbers[name]["value"]
        for name in numbers
        if name.startswith("grid.pn.bright.B1.") and name.endswith((".D1", ".D2"))
    ]
    assert len(bright) == 8
    ours = drawn(axes[0], "filled")
    assert len(ours) == 4
    assert ours[BLUE, "-"][-1] == max(bright)


@pytest.mark.parametrize(("response", "name"), [("epic-pn", "detection"), ("nicer", "detection_nicer")])
def test_cells_are_drawn_with_the_errors_of_their_claims(response, name):
    from studies.paper.detection_claims import cells
    from studies.paper.detection_figures import our_aucs
    from studies.paper.numbers import by_claim

    table = committed(name)
    values, errors = our_aucs(response, {name: table})
    numbers, spreads = by_claim(table), by_claim(table, "standard_error")
    for claim, place in cells(response):
        if claim in numbers:
            assert (values[place], errors[place]) == (numbers[claim]["value"], spreads[claim]["value"])
    assert 0 < errors.min() <= errors.max() < 0.06


def test_areas_are_those_of_the_facts(axes):
    """By an interpolation of its own, 6.4 keV between bins of 50 eV; the curves cross where it is said."""
    from studies.paper.numbers import by_claim

    table = committed("setup")
    facts = by_claim(table)
    pn, nicer = (np.asarray(line.get_ydata()) for line in axes[1].lines[:2])
    energy = np.asarray(axes[1].lines[0].get_xdata())
    assert (energy[0], energy[-1], len(energy)) == (pytest.approx(0.325), pytest.approx(9.975), 194)
    assert np.interp(6.4, energy, nicer) == pytest.approx(facts["det.nicer.area"]["6.4 keV"], rel=0.01)
    assert nicer.max() == pytest.approx(facts["det.nicer.area"]["peak"], rel=0.02)
    above = (energy > 4.0) & (energy < 9.0)
    assert (pn[above] > nicer[above]).all()
    assert (pn[energy < 3.0] < nicer[energy < 3.0]).mean() > 0.95
    assert 3.7 < facts["det.areacross"]["value"] < 3.9
