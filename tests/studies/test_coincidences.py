"""Lines at energies of nothing: as strong as they say, where they say, and counted as they are called."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import sparse

pytest.importorskip("jaxspec")
from studies import coincidences
from studies.hidden.instrument import response
from studies.kit.results import DOCS, RESULTS, read, write
from studies.nulls import spectra

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def tool(xray_data):
    files = spectra.instruments(None)["EPIC-pn"]
    return response(files.rmf, files.arf)


def test_a_line_wins_as_many_nats_as_were_asked_for_where_it_was_put(tool):
    inside = (tool.edges[:-1] >= 0.5) & (tool.edges[1:] <= 8.0)
    mean = np.where(inside, 40.0, 1e-3)
    for nats in (40.0, 200.0):
        line = coincidences.planted(4.2, nats, tool, mean, inside)
        assert not line[~inside].any()
        with_it, at = (mean + line)[inside], tool.centres[inside]
        won = (with_it * np.log(with_it / mean[inside]) - line[inside]).sum()
        assert won == pytest.approx(nats, rel=1e-6)
        assert at[np.argmax(line[inside])] == pytest.approx(4.2, abs=0.05)


@pytest.mark.parametrize("energy", [5.3265, 6.03, 7.4498])
def test_a_line_falls_between_no_bins(tool, energy):
    """Of a detector whose energy bins are 40 eV wide, and one with the counts of the EPIC-pn."""
    wide = replace(
        tool,
        energies=np.arange(3.02, 10.0, 0.04)[:, None] + np.array([-0.01, 0.01]),
        redistribution=sparse.csr_array(np.eye(len(tool.edges) - 1)[:, 600 : 600 + 175]),
    )
    inside = np.ones(len(tool.edges) - 1, dtype=bool)
    line = coincidences.planted(energy, 80.0, wide, np.full(len(inside), 40.0), inside)
    assert np.flatnonzero(line).tolist() == [600 + round((energy - 3.02) / 0.04)]


def test_a_spectrum_with_a_line_has_its_counts_besides():
    drawn = spectra.Case("EPIC-pn", "tbabs*powerlaw", (0.5, 8.0), "none", background=False)
    files = spectra.instruments(None)["EPIC-pn"]
    own = response(files.rmf, files.arf)
    more = lambda mean, inside: np.where(inside, 1000.0, 0.0)  # noqa: E731
    plain, with_it = (
        spectra.spectrum(drawn, 2e4, own, np.random.default_rng(2), line=line)["counts"].astype(float)
        for line in (None, more)
    )
    inside = (own.edges[:-1] >= 0.5) & (own.edges[1:] <= 8.0)
    assert with_it[inside].mean() - plain[inside].mean() == pytest.approx(1000.0, rel=0.02)
    assert with_it[~inside].sum() == pytest.approx(plain[~inside].sum(), abs=300.0)


def statement(value, names=(), certain=True):
    known = [{"name": name, "chance": chance} for name, chance in names]
    return {
        "certain": certain, "effect": "emission_line", "identification": known,
        "parameters": {"energy": {"value": value, "low": value - 0.01, "high": value + 0.02}},
    }  # fmt: skip


def test_what_is_said_of_it_is_whether_it_was_found_and_every_name():
    there = coincidences.said([statement(3.05), statement(6.4, [("Fe K alpha", 0.004)])], 3.0)
    assert there == {"found": True, "width": pytest.approx(0.03), "names": "Fe K alpha", "chance": 0.004}
    away = coincidences.said([statement(3.2), statement(3.0, certain=False)], 3.0)
    assert not away["found"]
    assert away["names"] == ""
    assert np.isnan(away["chance"])


@pytest.fixture(name="four")
def four_fixture():
    return xr.Dataset(
        {
            "instrument": ("row", ["EPIC-pn", "EPIC-pn", "NICER", "NICER"]),
            "found": ("row", [True, True, True, False]),
            "names": ("row", ["", "Fe K alpha", "", "S K alpha"]),
        },
        attrs={"commit": "c", "command": "python -m studies coincidences"},
    )


def test_the_table_counts_certain_lines_without_a_name(four):
    pn, nicer, both = coincidences.shown(four).splitlines()[2:5]
    assert "1 of 2 (1.3% to 98.7%) | Fe K alpha" in pn
    assert "| 2 | 1 of 1 (2.5% to 100.0%) | - |" in nicer
    assert "| 4 | 2 of 3 (9.4% to 99.2%) | Fe K alpha |" in both


def test_the_page_is_made_of_what_is_stored(four, tmp_path):
    write({"": four}, tmp_path / "coincidences.nc")
    (tmp_path / "measured.md").write_text("<!-- measured coincidences --><!-- /measured coincidences -->")
    assert coincidences.main(["--page", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert coincidences.shown(four) in (tmp_path / "measured.md").read_text()


def test_the_page_has_the_committed_table():
    made = read(RESULTS / "coincidences.nc")
    assert coincidences.shown(made) in (DOCS / "measured.md").read_text(encoding="utf-8")
    assert made.sizes["row"] == coincidences.NUMBER


def test_one_case_runs_from_files_to_names():
    """The study, small: one line in a spectrum of a few thousand counts, among lines alone."""
    found = coincidences.case(0, 7, None, counts=(2e3, 3e3), only=("emission_line",))
    assert found["instrument"] in spectra.instruments(None)
    assert 40.0 < found["nats"] < 200.0
    assert 2e3 < found["counts"] < 3e3
    assert 0.3 < found["energy"] < 10.0
    assert found["found"] == bool(np.isfinite(found["width"]))
    # Of such lines one in a hundred has a name, by coincidence.
    assert found["names"] == ""
