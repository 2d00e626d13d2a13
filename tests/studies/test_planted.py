"""Faults planted in real counts: by what they should, where they should, and scored as they should."""

import gzip
import json
from copy import copy

import numpy as np
import pytest
import xarray as xr
from studies.kit.page import filled
from studies.kit.results import DOCS, RESULTS, read
from studies.planted import __main__ as study
from studies.planted import document, faults, files

from gaugeblock.core.errors import InputError

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def base(xray_data):
    return files.bases(None)["ngc7793_pn"]


@pytest.fixture(scope="module")
def whole(base):
    return files.read_tables(base)


@pytest.fixture
def tables(whole):
    return copy(whole)


def response(base):
    from gaugeblock.simulators.xray import Response

    return Response.from_ogip(base.files["rmf"], base.files["arf"], exposure=1.0)


def test_rows_are_folded_as_the_response_says(base, whole):
    """Against astropy's view of the dense matrix: every row's sum and mean channel."""
    from astropy.io import fits

    with fits.open(base.files["rmf"]) as file:
        sums = [np.asarray(row).sum() for row in file["MATRIX"].data["MATRIX"]]
    rng = np.random.default_rng(1)
    for at in rng.integers(0, len(sums), 12):
        photons = np.eye(1, len(sums), at)[0]
        assert files.folded(whole.rows, photons, len(whole.counts)).sum() == pytest.approx(sums[at], rel=1e-5)


def test_a_line_is_counts_at_its_energy(base, tables):
    from astropy.io import fits

    with fits.open(base.files["rmf"]) as file:
        channels = file["EBOUNDS"].data
        centre = (channels["E_MIN"] + channels["E_MAX"]) / 2
    before = tables.counts.copy()
    said = faults.line(tables, np.random.default_rng(4))
    added = tables.counts - before
    assert added.sum() == pytest.approx(said["size"], abs=5 * np.sqrt(said["size"]))
    assert np.median(np.repeat(centre, added)) == pytest.approx(said["energy"], rel=0.03)
    assert base.band[0] < said["energy"] < base.band[1]


def test_an_energy_scale_moves_energies_and_leaves_the_area_a_function_of_energy(whole, tables):
    said = faults.gain(tables, np.random.default_rng(2))
    assert tables.energies == pytest.approx(whole.energies * said["size"])
    assert 0.92 < said["size"] < 1.09
    assert abs(np.log(said["size"])) > 0.039
    area = np.interp(2.0, tables.energies.mean(axis=1), tables.area)
    assert area == pytest.approx(np.interp(2.0, whole.energies.mean(axis=1), whole.area), rel=0.01)
    assert np.array_equal(tables.counts, whole.counts)


def test_an_area_is_wrong_over_a_part_of_the_band(whole, tables):
    said = faults.area(tables, np.random.default_rng(3))
    ratio = tables.area / whole.area - 1
    middle = whole.energies.mean(axis=1)
    assert ratio[np.abs(middle - said["energy"]) < 0.4] == pytest.approx(said["size"])
    assert np.all(ratio[np.abs(middle - said["energy"]) > 1.2] == 0)
    assert np.array_equal(tables.counts, whole.counts)


def test_a_background_is_the_regions_own_counts(whole, tables):
    said = faults.background(tables, np.random.default_rng(3))
    assert np.array_equal(tables.counts - whole.counts, whole.background)
    assert said["size"] == pytest.approx(whole.background.sum() / tables.counts.sum())


def test_thinned_counts_are_of_a_shorter_observation(base, whole, tables):
    share, control = files.thinned(tables, np.random.default_rng(5))
    assert base.kept[0] < share < base.kept[1]
    for left, all_of_it in ((tables.counts, whole.counts), (tables.background, whole.background)):
        assert np.all(left <= all_of_it)
        assert left.sum() == pytest.approx(share * all_of_it.sum(), abs=5 * np.sqrt(all_of_it.sum() / 4))
    # What is planted afterwards is not in the control, which is otherwise the same.
    assert np.array_equal(control.counts, tables.counts)
    assert np.array_equal(control.background, tables.background)
    names = ("counts", "background", "area", "energies")
    before = [getattr(control, name).copy() for name in names]
    for plant in (faults.line, faults.gain, faults.area, faults.background):
        plant(tables, np.random.default_rng(1))
    for kept, name in zip(before, names, strict=True):
        assert np.array_equal(kept, getattr(control, name))


def test_a_background_that_is_withheld_is_about_half(whole, tables):
    share, control = files.thinned(tables, np.random.default_rng(5), withheld=True)
    assert np.array_equal(tables.background, whole.background)
    # The control's background is told, as long as its source was observed.
    assert np.array_equal(control.counts, tables.counts)
    left, number = control.background.sum(), whole.background.sum()
    assert left == pytest.approx(share * number, abs=5 * np.sqrt(number / 4))
    said = faults.background(tables, np.random.default_rng(6))
    assert 0.37 < said["size"] < 0.63


def test_files_hold_what_was_planted_and_nothing_else_is_changed(base, tables, tmp_path):
    from astropy.io import fits

    from gaugeblock.auditing.discovering import read_measured

    faults.gain(tables, np.random.default_rng(2))
    paths = files.written(tables, 0.5, tmp_path)
    with fits.open(paths["pha"]) as new, fits.open(base.files["pha"]) as old:
        assert np.array_equal(new["SPECTRUM"].data["COUNTS"], tables.counts)
        assert new["SPECTRUM"].header["EXPOSURE"] == old["SPECTRUM"].header["EXPOSURE"] / 2
        assert np.array_equal(new["SPECTRUM"].data["GROUPING"], old["SPECTRUM"].data["GROUPING"])
    content = base.files["rmf"].read_bytes()
    old_bytes = np.frombuffer(gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content, np.uint8)
    new_bytes = np.frombuffer(paths["rmf"].read_bytes(), np.uint8)
    changed = int((old_bytes != new_bytes).sum())
    with fits.open(paths["rmf"]) as new:
        low = np.asarray(new["MATRIX"].data["ENERG_LO"], dtype=float)
        assert low == pytest.approx(tables.energies[:, 0], rel=1e-6)
        assert 0 < changed <= 2 * 8 * len(low)
    (group,) = read_measured(
        paths["pha"], rmf=paths["rmf"], arf=paths["arf"], background=(str(paths["background"]),),
        redshift=0.0, seed=1, progress=lambda *_: None, model=base.model, priors=None, band=base.band,
        regroup="ungrouped",
    )  # fmt: skip
    # What docs/measured.md says of this observation in this band.
    assert group.counts[0, : group.counts.shape[1] // 2].sum() == 10_091


def found(*statements, named, alike=(), certain=True):
    known = {
        "energy": {"value": 2.0, "low": 1.9, "high": 2.1},
        "slope": {"value": 1.05, "low": 1.03, "high": 1.07},
        "norm": {"value": 2e-5, "low": 1e-5, "high": 3e-5},
    }  # fmt: skip
    fit = {"statistic": 120.0, "bins": 100, "parameters": {"tbabs_1.nh": {"value": 0.5}}}
    return {
        "named": named, "indistinguishable": list(alike), "disagreement": {"p_global": 0.002},
        "fit": {"before": fit},
        "candidates": [
            {"effect": "gain_slope", "parameters": {"slope": 1.01}},
            {"effect": "emission_line", "parameters": {"norm": 1e-6}},
        ],
        "statements": [
            {"effect": effect, "certain": certain, "probability": 0.95, "parameters": known}
            for effect in statements
        ],
    }  # fmt: skip


def doubted(said):
    """The same statements, none of them certain."""
    return {**said, "statements": [{**one, "certain": False} for one in said["statements"]]}


class Canned:
    """A discovery that says what it is told to."""

    def __init__(self, said):
        self.said = said

    def to_json(self):
        return self.said


@pytest.mark.parametrize(
    ("fault", "said", "right"),
    [
        ("background", found("background", named="background", alike=["background"]), True),
        ("background", found("background", "emission_line", named="background", alike=["background"]), False),
        ("background", found("background", "unnamed", named="background", alike=["background"]), False),
        ("background", found("emission_line", named="emission_line", alike=["background"]), False),
        ("background", found(named=None), False),
        ("emission_line", found("emission_line", named="emission_line", alike=["emission_line"]), True),
    ],
)
def test_a_case_is_right_if_the_headline_is_and_nothing_else_is_certain(
    base, monkeypatch, fault, said, right
):
    asked = []

    def discover(_pha, **options):
        asked.append(options)
        return Canned(said)

    monkeypatch.setattr("gaugeblock.discover", discover, raising=False)
    if fault == "emission_line":
        there = faults.Fault(1, lambda *_: {"size": 1.0, "energy": 2.02, "flux": 1.0})
        monkeypatch.setattr(study, "FAULTS", {fault: there})
    both = study.case(base, fault, 0, 1)
    row = both["planted"]
    assert row["right"] is right
    assert (asked[0]["background"] == ("none",)) is (fault == "background")
    assert asked[1]["background"] != ("none",)
    assert row["before"]["bins"] == 100
    # The control of the same search is right if that says nothing.
    assert both["control"]["right"] is (said["named"] is None)
    # What holds the answer, certain or not, is right as a statement, unless something else is certain.
    assert row["stated"] is right
    monkeypatch.setattr("gaugeblock.discover", lambda *_, **__: Canned(doubted(said)), raising=False)
    doubtful = study.case(base, fault, 0, 1)["planted"]
    assert doubtful["right"] is False
    assert doubtful["stated"] is (fault in [one["effect"] for one in said["statements"]])
    if fault == "emission_line":
        elsewhere = faults.Fault(1, lambda *_: {"size": 1.0, "energy": 2.2, "flux": 1.0})
        monkeypatch.setattr("gaugeblock.discover", discover, raising=False)
        monkeypatch.setattr(study, "FAULTS", {fault: elsewhere})
        assert study.case(base, fault, 0, 1)["planted"]["right"] is False


@pytest.mark.parametrize(
    ("said", "right"),
    [
        (found(named=None), True),
        (found("emission_line", named="emission_line", alike=["emission_line"]), False),
        (found("unnamed", named="unnamed"), False),
    ],
)
def test_a_control_is_right_if_nothing_is_named(base, monkeypatch, said, right):
    monkeypatch.setattr("gaugeblock.discover", lambda *_, **__: Canned(said), raising=False)
    assert study.case(base, "gain_slope", 0, 1)["control"]["right"] is right


def test_an_amplitude_is_held_against_what_the_control_lacks(base, whole, monkeypatch):
    """A line's in photons before the absorber that the control's fit has; of a control asked for it alone."""
    from astropy.io import fits

    asked, said = [], found("emission_line", named="emission_line", alike=["emission_line"])
    column = said["fit"]["before"]["parameters"]["tbabs_1.nh"]

    def discover(_pha, **options):
        asked.append(options)
        return Canned(said)

    monkeypatch.setattr("gaugeblock.discover", discover, raising=False)
    row = study.case(base, "emission_line", 0, 1)["planted"]
    at = row["planted"]["energy"]
    assert [one.get("only") for one in asked] == [None, None, ("emission_line",)]
    assert asked[2]["energy"] == pytest.approx(at)
    assert row["without"] == 1e-6
    with fits.open(base.files["pha"]) as file:
        seconds = file["SPECTRUM"].header["EXPOSURE"]
    # Counts of the line, were there no absorber, over the exposure, the area and the matrix around it.
    share = row["counts"] / whole.counts.sum()
    middle = whole.energies.mean(axis=1)
    rows = np.array([sum(part.sum() for _, part in one) for one in whole.rows])
    area = np.interp(at, middle, whole.area * rows)
    absorbed = row["planted"]["size"] / (share * seconds * area)
    assert 1.0 < row["amplitude"] / absorbed < np.exp(0.5 * 30.0 * at**-2.5)
    sent = []
    for column["value"] in (10.0, 20.0):
        sent.append(study.case(base, "emission_line", 0, 1)["planted"]["amplitude"] / row["amplitude"])
    # An optical depth is proportional to the column, and falls with energy to the power of some -2.5.
    depth = np.log(sent) / [9.5, 19.5]
    assert depth[0] == pytest.approx(depth[1])
    assert 1.0 < depth[0] * at**2.5 < 4.0
    gain = study.case(base, "gain_slope", 0, 1)["planted"]
    assert (gain["without"], gain["amplitude"]) == (1.01, gain["planted"]["size"])
    assert "amplitude" not in study.case(base, "effective_area", 0, 1)["planted"]


def test_intervals_hold_what_was_planted_as_it_is_and_less_what_the_control_has():
    nan = np.nan
    made = xr.Dataset(
        {
            name: ("row", values)
            for name, values in {
                "fault": ["gain_slope"] * 3 + ["emission_line"] * 2 + ["control", "background"],
                "amplitude": [1.05, 1.05, 1.05, 1e-5, 1e-5, nan, nan],
                "without": [1.0, 1.02, 1.02, 0.0, 5e-6, nan, nan],
                "amplitude_lo": [1.04, 1.04, 1.06, 0.5e-5, 0.5e-5, nan, 0.0],
                "amplitude_hi": [1.06, 1.06, 1.08, 1.4e-5, 1.4e-5, nan, 1.0],
                "energy": [nan] * 3 + [2.0, 3.0, nan, nan],
                "energy_lo": [nan] * 3 + [1.9, nan, nan, nan],
                "energy_hi": [nan] * 3 + [2.1, nan, nan, nan],
            }.items()
        }
    )
    assert document.intervals(made) == [
        ("emission_line, norm", 2, 2), ("less what the control has", 1, 2), ("emission_line, energy", 1, 1),
        ("gain_slope, slope", 2, 3), ("less what the control has", 2, 3),
    ]  # fmt: skip


def test_every_fault_is_planted_as_often_in_every_spectrum(tmp_path, monkeypatch):
    asked = []

    def made(_, wanted):
        for one in wanted.values():
            one()
        raise InputError("enough")

    monkeypatch.setattr(study.Pieces, "made", made)
    monkeypatch.setattr(study, "case", lambda base, fault, number, seed: asked.append((base.name, fault)))
    assert study.main(["--generator-seed", "3", "--out", str(tmp_path)]) == 2
    for name in files.bases(None):
        times = {fault: asked.count((name, fault)) for fault in faults.FAULTS}
        assert times == {"emission_line": 3, "gain_slope": 2, "effective_area": 2, "background": 1}


def test_the_command_keeps_figures_alone_and_makes_a_page(tmp_path, monkeypatch):
    """With searches that say what they are told: of three spectra three controls and as many withheld."""
    monkeypatch.setattr("gaugeblock.discover", lambda *_, **__: Canned(found(named=None)), raising=False)
    for part in (study, document):
        monkeypatch.setattr(part, "FAULTS", {"background": faults.FAULTS["background"]})
    assert study.main(["--each", "1", "--generator-seed", "3", "--out", str(tmp_path)]) == 0
    made = read(tmp_path / "planted.nc")
    assert made.sizes["row"] == 6
    assert made["right"].values.tolist() == [False, True] * 3
    assert made["beneath"].values.tolist() == ["background"] * 6
    said = document.shown(made)
    assert "| `background` | 0 of 3 (0% to 71%) | 0 of 3 (0% to 71%) | nothing 3 |" in said
    assert "| control | 3 of 3 (29% to 100%) | - | - |" in said
    assert "emission_line, norm: 0 of 0 (0% to 100%)" in said
    sets = np.array(["pileup background", "", "background_line", "", "background", ""])
    held = document.shown(made.assign(set=("row", sets)))
    assert "| `background` | 0 of 3 (0% to 71%) | 2 of 3 (9% to 99%) | nothing 3 |" in held
    assert "| all that is planted | 0 of 3 (0% to 71%) | 2 of 3 (9% to 99%) |" in held
    # C of 120 for 100 bins is not strong, of 150 is.
    assert "25 nats or more in the best fit | 0 of 0" in said
    loud = made.assign(statistic=made["bins"] + np.array([50.0, 99.0, 49.0, 99.0, 60.0, 99.0]))
    assert "25 nats or more in the best fit | 0 of 2 (0% to 84%) | 0 of 2" in document.shown(loud)
    (tmp_path / "measured.md").write_text("<!-- measured planted --><!-- /measured planted -->")
    assert study.main(["--page", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert said in (tmp_path / "measured.md").read_text()
    assert filled("<!-- a --><!-- /a -->", {"a": said}).count("all that is planted") == 1


def test_earlier_sets_are_shown_as_they_were():
    """Without controls of the same counts, and with controls by themselves."""
    page = (DOCS / "measured.md").read_text(encoding="utf-8")
    kept = [name for name in document.SETS if (RESULTS / f"{name}.nc").exists()]
    assert set(kept) >= {"planted-first", "planted-second", "planted-third"}
    for name in kept:
        assert document.shown(read(RESULTS / f"{name}.nc")) in page


def test_headlines_of_all_cases_are_counted_together():
    """Of two known strong cases one is right, the other has a wrong name beside it; of five that are planted
    three are strong, of which two are right; one of two controls has something certain.
    """
    known = {"kind": "line", "right": True, "certain": ["emission_line"], "beside": [], "rejected": False}
    rows = {
        "a": known,
        "b": {**known, "right": False, "beside": ["pileup"]},
        "c": {**known, "kind": "weak", "certain": []},
    }
    columns = {
        "fault": [
            *("emission_line", "gain_slope", "background", "emission_line", "gain_slope"),
            *("control", "control"),
        ],
        "right": [True, False, True, True, False, True, True],
        "certain": ["emission_line", "gain_slope pileup", "background", "emission_line", "", "unnamed", ""],
        "statistic": [150.0, 150.0, 150.0, 149.0, 120.0, 500.0, 100.0],
        "bins": [100] * 7,
    }  # fmt: skip
    made = xr.Dataset({name: ("row", values) for name, values in columns.items()})
    lines = document.headlines({"known": rows}, {"planted": made}).splitlines()
    assert lines[2:] == [
        "| known | 1 of 2 (1% to 99%) | 1 of 1 (3% to 100%) | 1 of 3 (1% to 91%) |",
        "| planted | 2 of 3 (9% to 99%) | 1 of 2 (1% to 99%) | 2 of 7 (4% to 71%) |",
        "| together | 3 of 5 (15% to 95%) | 2 of 3 (9% to 99%) | 3 of 10 (7% to 65%) |",
    ]


def test_the_page_has_the_headlines_of_what_is_kept():
    known = {}
    for name, called in (("measured", "12 with known answers"), ("measured-others", "21 others, run once")):
        known[called] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))["cases"]
    sets = [read(RESULTS / f"{name}.nc") for name in document.ALIKE if (RESULTS / f"{name}.nc").exists()]
    called = {f"planted, measured commit {made.attrs['commit'][:7]}": made for made in sets}
    assert document.headlines(known, called) in (DOCS / "measured.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_strong_line_in_real_counts_is_named(base):
    row = study.case(base, "emission_line", 0, 5)
    assert row["planted"]["named"] == "emission_line"
    assert row["control"]["named"] is None
