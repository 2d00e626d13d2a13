"""The gain study on a small scale: its table of spectra, pools, catalogues, schemes, and its document."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from gaugeblock.simulators import Effect

pytest.importorskip("jaxspec")
from studies.gain import amplitudes, schemes
from studies.gain import document as page
from studies.gain.models import EXACT, JAXSPEC, SETS, TabulatedShared, free, table
from studies.gain.pools import CHUNK, TEMPLATES, GainPool, pools, scored
from studies.gain.table import FIELDS, GainCase, cases, catalogues, orthogonal, row_of, spread, summary
from studies.gain.whole import profiled, sources_of
from studies.kit.results import DOCS, RESULTS, read
from studies.kit.resume import Pieces

from gaugeblock.simulators.xray import reference

pytestmark = pytest.mark.usefixtures("xray_data")

SEED = 3
SMALL = [GainPool("bright", "", 0.0, 120), GainPool("bright", "gain_slope", 1.03, 60)]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two small pools, scored twice: the second time from disk."""
    pieces = Pieces(tmp_path_factory.mktemp("pools"), {"seed": SEED})
    first = {pool.name: scored(pool, pieces, seed=SEED) for pool in SMALL}
    again = {pool.name: scored(pool, pieces, seed=SEED) for pool in SMALL}
    for name, pool in first.items():
        np.testing.assert_array_equal(again[name].scores.score, pool.scores.score)
    return first


@pytest.mark.parametrize(
    ("name", "values", "effect"),
    [
        ("", (), None),
        ("gain_slope", (1.03,), Effect("gain_slope", {"slope": 1.03})),
    ],
)
def test_the_table_agrees_with_the_simulator(name, values, effect):
    simulator = reference(level="bright")
    if effect is not None:
        simulator = simulator.with_effect(effect)
    theta = simulator.prior.sample(50, np.random.default_rng(0))
    made = table(JAXSPEC, name, *values)
    np.testing.assert_allclose(made.expected(theta), simulator.expected(theta), rtol=2e-5)
    exact = simulator.jacobian(theta[:5])
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(made.jacobian(theta[:5]) - exact) / size).max() < 1e-4
    assert made.prior.names == free(JAXSPEC).prior.names


def test_a_shift_stands_out_and_its_absence_does_not(made):
    rows = np.arange(60)
    for chosen in SETS:
        hidden = orthogonal(made["bright_gain_slope_1.03"], "gain_slope", chosen, rows)
        clean = orthogonal(made["bright_clean"], "gain_slope", chosen, rows)
        assert hidden["z"] > 5
        assert abs(clean["z"]) < 4
        assert hidden["amplitude"] == pytest.approx(0.03, abs=0.012)
    alone, beside = (
        orthogonal(made["bright_clean"], "gain_slope", chosen, rows)
        for chosen in ("alone", "offset and area")
    )
    assert beside["standard_error"] > 1.5 * alone["standard_error"]


def test_the_profile_reads_the_amplitude():
    found = profiled(SMALL[1], "gain_slope", 60, SEED, 0)
    assert found["converged"]
    assert abs(found["value"] - found["truth"]) < 4 * found["standard_error"]
    assert found["gain"] > 20


def test_intervals_of_many_catalogues_are_counted(monkeypatch, tmp_path):
    """With profiles that are said: by case three of four, none, all, all; pulls twice as wide in one."""
    seen = []

    def profile(pool, name, size, seed, catalogue):
        assert (pool.hidden, pool.spectrum, pool.number, size, seed) == (name, EXACT, 4 * 7, 7, 5)
        seen.append((pool.name, catalogue))
        truth = pool.value - 1.0
        pull = {"published_gain_1.03": 2.0, "published_gain_0.97": 9.0}.get(pool.name[7:], 1.0)
        value = truth + 0.001 * pull * (-1.0, 1.0, -1.0, 1.0)[catalogue]
        reach = 0.0 if pull == 9.0 or (pull == 2.0 and catalogue == 3) else 0.005
        return {
            "truth": truth, "value": value, "standard_error": 0.0005, "sandwich_error": 0.001,
            "low": value - reach, "high": value + reach,
        }  # fmt: skip

    monkeypatch.setattr(amplitudes, "profiled", profile)
    given = ["--catalogues", "4", "--sources", "7", "--generator-seed", "5", "--out", str(tmp_path)]
    assert amplitudes.main(given) == 0
    assert len(set(seen)) == len(seen) == 16
    made = read(tmp_path / "gain-amplitudes.nc")
    assert made.sizes == {"case": 4, "catalogue": 4}
    said = amplitudes.shown(made)
    first, second, third, _, every = said.splitlines()[2:7]
    assert first.startswith("| published gain +3% | +3.00 ± 0.12 | 0.10 | 2.31 | 3 of 4 (")
    assert second.startswith("| published gain -3% | -3.00 ± 0.52 | 0.10 | 10.39 | 0 of 4 (")
    assert third.startswith("| gain slope +3% | +3.00 ± 0.06 | 0.10 | 1.15 | 4 of 4 (")
    assert every.startswith("| all |  |  |  | 11 of 16 (41% to 89%) |")
    (tmp_path / "gain.md").write_text("<!-- amplitudes --><!-- /amplitudes -->")
    assert amplitudes.main(["--page", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert said in (tmp_path / "gain.md").read_text()


def test_spectra_are_the_same_whoever_draws_them():
    pool = SMALL[1]
    sources = sources_of(pool, 20, SEED, catalogue=1)
    np.testing.assert_array_equal(sources.counts, pool.draw(0, SEED)[1][20:40])
    assert not np.array_equal(pool.draw(0, SEED)[1], pool.draw(0, SEED + 1)[1])


def test_clean_spectra_of_the_same_sources_are_had_again():
    pool = SMALL[1]
    theta, counts = pool.draw(0, SEED)
    again = pool.again(theta[:40], SEED, np.random.default_rng(1))
    expected = reference(level="bright").expected(theta[:40])
    pulls = (again - expected).sum(axis=1) / np.sqrt(expected.sum(axis=1))
    assert again.shape == (40, counts.shape[1])
    assert (pulls**2).sum() == pytest.approx(40, abs=5 * np.sqrt(80))
    assert not np.array_equal(again, counts[:40])


def test_paired_evidence_is_what_counts_do_not_carry():
    """Differences of 1.5 nats at equal counts, beside 40 for every unit of the log ratio of counts."""
    rng = np.random.default_rng(4)
    partner, counts = rng.poisson(50.0, (2, 200, 30)).astype(float)
    ratio = np.log(counts.sum(axis=1) / partner.sum(axis=1))
    noise = 2 * rng.normal(size=200)
    seen, clean = (
        schemes.Read(np.empty(0), np.empty(0), np.empty(0), evidence)
        for evidence in (np.append(7.0 + 1.5 + 40 * ratio + noise, np.zeros(9)), np.full(200, 7.0))
    )
    value, low, high = schemes._paired(partner, counts, seen, clean)
    assert value == pytest.approx(1.5, abs=8 / np.sqrt(200))
    assert high == -low == pytest.approx(2 * 1.96 / np.sqrt(200), rel=0.2)


def test_a_pool_with_a_flow_is_read_by_it(monkeypatch):
    asked = []
    for name in ("_by_flow", "_by_fit"):
        monkeypatch.setattr(schemes, name, lambda *_, name=name: asked.append(name))
    for level in ("medium", "bright"):
        schemes.read(np.zeros((1, 3)), GainPool(level, "", 0.0, 10), np.random.default_rng(0))
    assert asked == ["_by_flow", "_by_fit"]
    assert [GainPool(level, "", 0.0, 1).flow for level in ("medium", "bright")] == [
        "shipped:epic-pn-medium",
        "",
    ]


def test_a_null_of_resampled_catalogues_is_widened_by_what_they_share():
    """Of 4,000 numbers means of 1,000, drawn without replacement: as told, fresh ones scatter by more."""
    rng = np.random.default_rng(2)
    values = rng.normal(size=4000)
    means = [values[rows].mean() for rows in catalogues(1000, 4000, 2000, rng)]
    assert spread(np.std(means) * np.sqrt(1000), 0.25) == pytest.approx(values.std(), rel=0.06)
    assert np.std(means) * np.sqrt(1000) < 0.93 * values.std()
    few = [values[:400][rows].mean() for rows in catalogues(300, 400, 2000, rng)]
    assert spread(np.std(few) * np.sqrt(300), 0.75) == pytest.approx(values[:400].std(), rel=0.1)


def test_seen_is_what_lies_beyond_three_of_the_widened_sd():
    """A null of mean 1 and sd 0.6, of catalogues that are 0.36 of their pool: three sd are 2.25."""
    null = {"z": 1 + 0.6 * np.array([-1.0, 1.0]) / np.sqrt(2)}
    found = {name: np.zeros(4) for name in FIELDS} | {"z": np.array([-1.3, 3.1, 3.3, 2.0])}
    row = row_of(GainCase("bright", "gain_slope", 1.03, 36), "alone", null, found, 100)
    assert row["null_sd"] == pytest.approx(0.6)
    assert row["power"] == 0.5


def test_catalogues_are_disjoint_first():
    rows = catalogues(10, 35, 6, np.random.default_rng(0))
    assert len(rows) == 6
    assert len(set(np.concatenate(rows[:3]).tolist())) == 30
    assert all(len(set(row.tolist())) == 10 for row in rows)


def test_every_case_has_its_pools():
    planned = pools()
    for case in cases():
        assert case.pool(planned).value == case.value
        assert case.clean(planned).hidden == ""
        assert case.pool(planned).number % CHUNK == 0
        assert case.pool(planned).number >= case.size
    assert sum(case.small for case in cases()) == 4
    assert len(set(planned)) == 15


def test_templates_are_changes_by_unit_amplitude():
    shared = TabulatedShared("gain_slope", 0.01)
    theta = shared.base.prior.sample(4, np.random.default_rng(1))
    one = np.ones(4)
    template = shared.templates(theta, shared.neutral, one, 0 * one)[:, 0]
    change = table(JAXSPEC, "gain_slope", 1.005).expected(theta) - shared.base.expected(theta)
    assert np.abs(template * 0.005 - change).max() < 0.1 * np.abs(change).max()


def test_the_summary_has_a_row_a_case(made):
    planned = {pool.name: pool for pool in SMALL}
    found = summary(made, planned, cases(0.04), number=20, seed=1)
    assert found["statistic"].values.tolist() == list(SETS)
    assert found["case"].values.tolist() == ["20 bright, gain slope +3.0%"]
    assert (found["null_catalogues"] == 20).all()
    assert float(found["z"].sel(statistic="alone").squeeze()) > 4
    assert TEMPLATES == ("published_gain", "gain_slope")


def test_the_document_says_what_the_results_say(tmp_path):
    (tmp_path / "gain.md").write_text((DOCS / "gain.md").read_text(encoding="utf-8"), encoding="utf-8")
    page.document(RESULTS / "gain.nc", tmp_path)
    assert (tmp_path / "gain.md").read_text() == (DOCS / "gain.md").read_text()
    assert (tmp_path / "figures" / "gain.svg").read_text() == (DOCS / "figures" / "gain.svg").read_text()


def test_what_is_promised_holds():
    with xr.open_dataset(RESULTS / "gain.nc", engine="netcdf4") as stored:
        sums = stored.load()
    alone = sums.sel(statistic="alone")
    assert (sums["null_catalogues"].isel(statistic=0) >= 200).all()
    # The sd of 400 resampled catalogues: within three of its standard errors, pools being finite.
    assert (np.abs(alone["null_sd"] - 1) < 0.2).all()
    assert (np.abs(alone["null_mean"]) < 3 * alone["null_mean_error"]).all()
    large = [case for case in sums["case"].values.tolist() if "3.0%" in case]
    assert (np.abs(alone["z_mean"].sel(case=large)) > 3.5).all()
    assert (np.sign(alone["z_mean"]) == np.sign(alone["truth"])).all()
    with xr.open_dataset(RESULTS / "gain.nc", group="headline", engine="netcdf4") as stored:
        table = stored.load()
    assert {"scheme", "case"} == set(table.dims)
    assert (table["threshold"] > table["null_low"]).where(np.isfinite(table["value"]), True).all()


def test_sources_that_a_small_gain_takes_have_the_errors_that_they_must():
    """Errors that fall as the root of the number: 1% of 100 sources is 0.06% of 27,778."""
    number = np.array([100, 1_000, 50_000])
    limits = xr.Dataset({"beside": ("number", 0.01 * np.sqrt(100 / number))}, coords={"number": number})
    assert page.sources_needed(limits) == pytest.approx(100 * (0.01 / 0.0006) ** 2)


def test_the_page_has_the_intervals_that_were_counted():
    made = read(RESULTS / "gain-amplitudes.nc")
    assert made.sizes == {"case": 4, "catalogue": 50}
    assert (made["converged"] == 1).all()
    assert amplitudes.shown(made) in (DOCS / "gain.md").read_text()
    inside = (made["low"] < made["truth"]) & (made["truth"] < made["high"])
    assert 0.85 < inside.mean() < 0.95
