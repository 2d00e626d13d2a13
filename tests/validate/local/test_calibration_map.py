from __future__ import annotations

import numpy as np

from gaugeblock.validate.local.calibration_map import calibration_map
from gaugeblock.validate.local.trees import Condition, Region

RNG = np.random.default_rng(0)
VALUES = RNG.normal(size=(1000, 3))
GAP = RNG.normal(size=1000)
LEFT, RIGHT = (Region(((Condition(2, 0.5, above),),)) for above in (False, True))
WORST = Region(((Condition(2, 0.5, True), Condition(0, -1.0, False)),))
OTHER = Region(((Condition(2, 0.5, False), Condition(1, 0.0, True)),))
NAMES = ("u", "v", "w")


def test_cells_are_means_of_the_trials_in_them():
    made = calibration_map((LEFT, RIGHT, OTHER, WORST), 3, VALUES, NAMES, GAP)
    assert sorted(made["map_feature"].values.tolist()) == ["u", "w"]
    across = made["map_feature"].values.tolist().index("w") == 0
    right, low = VALUES[:, 2] > 0.5, VALUES[:, 0] <= -1.0
    cell = made.isel(map_x=1, map_y=0) if across else made.isel(map_x=0, map_y=1)
    assert int(cell["map_n"]) == np.count_nonzero(right & low)
    np.testing.assert_allclose(float(cell["map_gap"]), GAP[right & low].mean())
    assert float(cell["map_worst"]) == 1
    assert made["map_worst"].values.sum() == 1
    assert int(made["map_n"].sum()) == 1000
    edge, cut = ("map_x_edge", "map_x_cut") if across else ("map_y_edge", "map_y_cut")
    np.testing.assert_allclose(made[edge].values, [0, np.mean(~right), 1])
    assert made[cut].values.tolist() == [0.5]


def test_one_feature_alone_is_a_strip():
    made = calibration_map((LEFT, RIGHT), 1, VALUES, NAMES, GAP)
    assert made["map_feature"].values.tolist() == ["w", ""]
    assert made["map_gap"].shape == (1, 2)
    assert made["map_worst"].values.tolist() == [[0.0, 1.0]]


def test_cuts_are_in_order_whatever_the_regions_say_first():
    cuts = [0.9, -1.3, 0.2, 1.7, -0.4, 0.0, 2.5, -2.2]
    regions = tuple(Region(((Condition(2, cut, True),),)) for cut in cuts)
    made = calibration_map(regions, 0, VALUES, NAMES, GAP)
    assert made["map_x_cut"].values.tolist() == sorted(cuts)
    number, _ = np.histogram(VALUES[:, 2], [-np.inf, *sorted(cuts), np.inf])
    assert made["map_n"].values[0].tolist() == number.tolist()
    share = np.cumsum(number) / 1000
    np.testing.assert_allclose(made["map_x_edge"].values, [0, *share])


def test_the_worst_region_decides_and_then_the_commonest_feature():
    """Feature 1 is in the worst region alone, 2 in three others, 0 in two; cells without a trial are 0."""
    regions = (
        Region(((Condition(0, 0.3, True),),)), Region(((Condition(2, 0.0, True),),)),
        Region(((Condition(1, -0.2, True),),)), Region(((Condition(2, 9.0, True),),)),
        Region(((Condition(0, 0.1, False), Condition(2, 0.5, True)),)),
    )  # fmt: skip
    made = calibration_map(regions, 2, VALUES, NAMES, GAP)
    assert made["map_feature"].values.tolist() == ["v", "w"]
    assert made["map_x_cut"].values.tolist() == [-0.2]
    assert made["map_y_cut"].values.tolist() == [0.0, 0.5, 9.0]
    assert made["map_gap"].shape == (4, 2)
    assert made["map_n"].values[3].tolist() == made["map_gap"].values[3].tolist() == [0.0, 0.0]
    for row, (low, high) in enumerate([(-np.inf, 0.0), (0.0, 0.5), (0.5, 9.0)]):
        for column in range(2):
            here = (VALUES[:, 2] > low) & (VALUES[:, 2] <= high) & ((VALUES[:, 1] > -0.2) == column)
            assert made["map_n"].values[row, column] == here.sum()
            np.testing.assert_allclose(made["map_gap"].values[row, column], GAP[here].mean())
            assert made["map_worst"].values[row, column] == column
