"""Groups of discovery.nc: what stands in which column, on arrays made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery import Sources
from gaugeblock.discovery.arrays import channel_arrays, held_out_arrays, scan_arrays, window_arrays
from gaugeblock.discovery.engine import Look
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.locate.windows import WindowScan
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.segments import Segment

PARTS = (
    Segment("pn", 0, 2, np.array([[2.0, 1.0], [3.0, 2.0]])),
    Segment("sky", 2, 5, np.array([[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]), unit="channel", role="background"),
)


def sources(power_law, parts, number):
    class Parts(power_law):
        def segments(self):
            return parts

    return Sources.of(Parts(), np.ones((number, 5)))


def test_channels_say_where_they_are_and_of_what(power_law):
    told = {
        name: values.tolist() for name, (_, values) in channel_arrays(sources(power_law, PARTS, 1)).items()
    }
    assert told == {
        "energy_lo": [1.0, 2.0, 0.0, 1.0, 2.0],
        "energy_hi": [2.0, 3.0, 1.0, 2.0, 3.0],
        "segment": ["pn", "pn", "sky", "sky", "sky"],
        "unit": ["keV", "keV", "channel", "channel", "channel"],
        "role": ["source", "source", "background", "background", "background"],
    }
    added = channel_arrays(sources(power_law, PARTS, 1200))["segment"][1]
    assert added.tolist() == ["sum of 1,200 sources"] * 2 + ["sky"] * 3
    # Instruments side by side keep their names.
    both = (PARTS[0], replace(PARTS[1], role="source"))
    assert channel_arrays(sources(power_law, both, 2))["segment"][1].tolist() == ["pn"] * 2 + ["sky"] * 3


def test_windows_are_of_the_segment_that_they_begin_in(power_law):
    found = WindowScan(
        low=np.array([1.0, 1.5]), high=np.array([3.0, 2.5]), start=np.array([3, 0]), stop=np.array([5, 1]),
        z=np.array([5.0, -4.0]), excess=np.array([30.0, -20.0]), p_global=np.array([0.001, 0.004]),
        p_overall=0.01, strongest=np.arange(5.0), null_maximum=np.array([3.0, 2.0, 4.0]),
    )  # fmt: skip
    made = window_arrays(found, channel_arrays(sources(power_law, PARTS, 1)))
    assert made["segment"].values.tolist() == ["sky", "pn"]
    assert made["unit"].values.tolist() == ["channel", "keV"]
    for name, values in (("energy_lo", found.low), ("energy_hi", found.high), ("z", found.z)):
        np.testing.assert_array_equal(made[name], values)
    np.testing.assert_array_equal(made["excess"], found.excess)
    np.testing.assert_array_equal(made["p_global"], found.p_global)
    np.testing.assert_array_equal(made["strongest"], found.strongest)
    np.testing.assert_array_equal(made["channel_lo"], [1.0, 2.0, 0.0, 1.0, 2.0])
    np.testing.assert_array_equal(made["channel_hi"], [2.0, 3.0, 1.0, 2.0, 3.0])
    assert (made.attrs["p_global"], made.attrs["replicates"]) == (0.01, 3)


def effect(name, energies=(), units=None, **scanned):
    return LibraryEffect(
        name=name, parameters=dict.fromkeys(["size", *scanned], Uniform(-9.0, 9.0)), amplitude="size",
        neutral=0.0, step=0.1, cause="", typical="", scanned=scanned, energies=energies, units=units or {},
    )  # fmt: skip


def test_a_scan_is_told_along_energies_and_without_what_is_not_scanned():
    """By energy where one is scanned, else by what is scanned first; nodes in the order of the templates."""
    entries = {
        "line": effect("line", ("energy",), {"energy": "keV"}, width=[0.1], energy=[1.0, 2.0]),
        "tilt": effect("tilt"),
        "bump": effect("bump", width=[3.0, 5.0], energy=[4.0]),
    }
    owner = np.array(["bump", "line", "tilt", "line", "bump"])
    z = np.array([5.0, 1.0, 2.0, 3.0, 4.0])
    seen = Look(
        entries=entries, owner=owner, node=np.array([1, 1, 0, 0, 0]), z=z, amplitude=z, kept=z,
        smallest_detectable=z, null=np.arange(21.0), state=None,
    )  # fmt: skip
    made = scan_arrays(seen)
    columns = [made[name].values.tolist() for name in ("effect", "parameter", "value", "unit", "z")]
    rows = list(zip(*columns, strict=True))
    assert rows == [
        ("line", "energy", 2.0, "keV", 1.0), ("line", "energy", 1.0, "keV", 3.0),
        ("bump", "width", 5.0, "", 5.0), ("bump", "width", 3.0, "", 4.0),
    ]  # fmt: skip
    assert made.attrs["threshold"] == pytest.approx(19.0)


@pytest.mark.parametrize("pieces", [20, 21])
def test_scores_of_models_and_no_more_than_twenty_pieces_one_by_one(pieces):
    rng = np.random.default_rng(1)
    names, kinds = ("before", "dip", "line"), ("before", "named", "rival")
    score, gaps = rng.normal(size=(3, pieces)), rng.normal(size=(3, pieces))
    scored = HeldOut(names, kinds, score, np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]), gaps)
    made = held_out_arrays(scored, "in folds", "mean square")
    assert (made["model"].values.tolist(), made["kind"].values.tolist()) == (list(names), list(kinds))
    np.testing.assert_allclose(made["deviance"], gaps.mean(axis=1))
    np.testing.assert_allclose(made["deviance_error"], np.sqrt(gaps.var(axis=1, ddof=1) / pieces))
    np.testing.assert_allclose(made["log_score"], score.sum(axis=1) - score[0].sum(), atol=1e-12)
    assert made["log_score_error"].values.tolist() == [0.0, 3.0, 6.0]
    assert made.attrs == {"scheme": "in folds", "measure": "mean square"}
    assert ("before" in made, "after" in made) == (pieces == 20, pieces == 20)
    if pieces == 20:
        np.testing.assert_array_equal(made["before"], gaps[0])
        np.testing.assert_array_equal(made["after"], gaps[1])
        alone = HeldOut(names[:1], kinds[:1], score[:1], np.zeros((1, 1)), gaps[:1])
        assert "after" not in held_out_arrays(alone, "in folds", "mean square")
