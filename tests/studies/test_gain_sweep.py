"""Gains of less than a per cent: which spectra are drawn, and what the page says of them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("jaxspec")
from studies.gain import sweep
from studies.gain.pools import GainPool
from studies.gain.sweep import MARKERS, SIZES, SPECTRA, WORDS, pools, shown, swept
from studies.gain.table import FIELDS
from studies.kit.results import DOCS, RESULTS, read_groups

SEED = 5
ALL = {label: spectrum for one in SPECTRA.values() for label, spectrum in one.items()}


@pytest.mark.parametrize("label", ALL)
def test_every_size_has_spectra_of_its_response(label):
    planned = pools(ALL[label])
    response = "nicer" if label == "nicer" else "epic-pn"
    assert len(planned) == 9
    clean = planned["bright_clean_small"]
    assert clean.number == 4000
    for pool in planned.values():
        assert (pool.spectrum.response, pool.spectrum.integration, pool.small) == (response, "exact", True)
        assert pool.number == (2000 if pool.hidden else 4000)
    assert sorted({round(pool.value - 1, 6) for pool in planned.values() if pool.hidden}) == sorted(SIZES)


@pytest.mark.usefixtures("xray_data")
def test_nicer_has_its_own_channels_and_the_same_sources():
    ours = [pools(ALL[label], part=0.01)["bright_clean_small"] for label in ("epic-pn", "nicer")]
    theta, counts = zip(*(pool.draw(0, SEED) for pool in ours), strict=True)
    np.testing.assert_array_equal(*theta)
    assert [part.shape[1] for part in counts] == [102, 970]


def test_a_table_of_every_response(monkeypatch):
    """With scores that are said: a catalogue is all of a pool, and the null is of the clean one."""
    seen = []

    def score(pool, _pieces, *, seed):
        seen.append((pool.name, pool.number, seed))
        return pool

    monkeypatch.setattr(sweep, "scored", score)
    monkeypatch.setattr(sweep, "summary", lambda done, planned, wanted, **options: (done, wanted, options))
    done, wanted, options = swept(ALL["nicer"], None, seed=3, part=0.01, number=7)
    assert options == {"number": 7, "seed": 3}
    assert {name for name, _, _ in seen} == set(done)
    assert all(isinstance(pool, GainPool) and pool.spectrum.response == "nicer" for pool in done.values())
    assert [case.size for case in wanted] == [20] * 8
    assert all(case.known(done) for case in wanted)


def made(z):
    """A response's table with one case, of these z by statistic."""
    values = {
        **{name: (("case", "statistic"), np.zeros((1, 3))) for name in FIELDS},
        "z": (("case", "statistic"), np.array([z])),
        "null_mean": (("case", "statistic"), np.array([[0.5, 0.0, -1.0]])),
        "amplitude": (("case", "statistic"), np.array([[0.0, 0.0, 0.0031]])),
        "standard_error": (("case", "statistic"), np.array([[0.0, 0.0, 0.0004]])),
        "null_mean_error": (("case", "statistic"), np.full((1, 3), 0.7)),
        "truth": (("case", "statistic"), np.full((1, 3), 0.003)),
    }
    coords = {"case": ["2000 bright, gain slope +0.3%"], "statistic": ["alone", "offset", "offset and area"]}
    return xr.Dataset(values, coords)


def test_the_command_keeps_and_tells_every_response(monkeypatch, tmp_path, capsys):
    asked = []

    def table(spectrum, _pieces, *, seed, part, number):
        label = next(label for label, one in ALL.items() if one == spectrum)
        asked.append((label, seed, part, number))
        return made((10.5, 0.0, 3.0) if label == "nicer" else (4.5, 0.0, 1.0))

    monkeypatch.setattr(sweep, "swept", table)
    given = ["--share", "0.5", "--catalogues", "9", "--generator-seed", "5", "--out", str(tmp_path)]
    assert sweep.main(given) == 0
    assert asked == [("epic-pn", 5, 0.5, 9), ("nicer", 5, 0.5, 9)]
    printed = capsys.readouterr().out
    assert printed.splitlines()[2:6] == [
        "| EPIC-pn | gain slope | none | +0.5 ± 0.7 | -1.0 ± 0.7 |  |",
        "| EPIC-pn | gain slope | +0.3 | +4.5 | +1.0 | +0.31 ± 0.04 |",
        "| NICER | gain slope | none | +0.5 ± 0.7 | -1.0 ± 0.7 |  |",
        "| NICER | gain slope | +0.3 | +10.5 | +3.0 | +0.31 ± 0.04 |",
    ]
    assert sweep.main([*given, "--background"]) == 0
    assert asked[2:] == [("epic-pn-background", 5, 0.5, 9)]
    beside = capsys.readouterr().out
    assert "| EPIC-pn, background | gain slope | +0.3 | +4.5 | +1.0 | +0.31 ± 0.04 |" in beside
    assert (
        "`python -m studies gain-sweep --share 0.5 --catalogues 9 --generator-seed 5 --background`" in beside
    )
    page = tmp_path / "gain.md"
    page.write_text("<!-- sweep --><!-- /sweep -->\n<!-- background --><!-- /background -->\n")
    assert sweep.main(["--page", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert printed.strip() in page.read_text().partition("<!-- background -->")[0]
    assert beside.strip() in page.read_text().partition("<!-- background -->")[2]


@pytest.mark.parametrize("name", [name for name in SPECTRA if (RESULTS / f"{name}.nc").exists()])
def test_the_page_says_what_was_measured(name):
    tables = read_groups(RESULTS / f"{name}.nc")
    assert set(tables) == {"", *SPECTRA[name]}
    page = (DOCS / "gain.md").read_text(encoding="utf-8")
    assert f"<!-- {MARKERS[name]} -->\n{shown(tables)}\n" in page
    for label in SPECTRA[name]:
        assert label in WORDS
        assert tables[label].sizes["case"] == 8
        assert (tables[label]["null_catalogues"] == 400).all()
