"""Thinned copies of a measured spectrum: where every count goes, and what a planted gain does to them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("jaxspec")
from studies.gain import thinned
from studies.gain.pools import CHUNK
from studies.gain.thinned import ThinnedPool, divided, moved, observation, planned, recorded
from studies.kit.results import DOCS, RESULTS, read, read_groups

from gaugeblock.core.errors import InputError

pytestmark = pytest.mark.usefixtures("xray_data")

SEED = 5


@pytest.fixture(scope="module")
def pools():
    return planned(part=0.01)


def off(here, there, ratio):
    """By how many errors means of copies differ from a ratio times the clean ones', by bin; their rms."""
    means = [pool.draw(0, SEED)[1].mean(axis=0) for pool in (here, there)]
    pulls = (means[0] - ratio * means[1]) / np.sqrt((means[0] + ratio**2 * means[1]) / CHUNK)
    return float(np.sqrt(np.mean(pulls**2)))


@pytest.fixture(scope="module")
def edges():
    return observation().simulator.response.fine_channels


def test_every_recorded_count_lies_in_one_lot_at_most(pools):
    lots = pools["bright_clean"].lots
    parts = divided(lots, SEED)
    assert list(parts) == list(pools) == [name for name, _ in lots]
    assert (sum(parts.values()) <= recorded()).all()
    for name, share in lots:
        wanted = share * recorded().sum()
        assert parts[name].sum() == pytest.approx(wanted, abs=5 * np.sqrt(wanted))
    again = divided(lots, SEED + 1)
    assert not np.array_equal(again["bright_clean"], parts["bright_clean"])


def test_more_than_was_recorded_is_refused():
    with pytest.raises(
        InputError, match=r"nicer_unbinned.pha: too few counts; 1.20 times as many are needed"
    ):
        divided((("one", 0.6), ("other", 0.6)), SEED)


def test_the_whole_study_finds_room():
    total = sum(share for _, share in planned()["bright_clean"].lots)
    assert 0.8 < total < 1.0


def test_copies_hold_the_counts_of_their_lot(pools):
    pool, response = pools["bright_clean"], observation().simulator.response
    copies = np.concatenate([pool.draw(chunk, SEED)[1] for chunk in range(3)])
    assert len(copies) == pool.copies == 3 * CHUNK
    assert pool.number == 25
    held = response.grouping @ divided(pool.lots, SEED)[pool.name]
    np.testing.assert_array_equal(copies.sum(axis=0), held)
    assert copies.sum(axis=1).mean() == pytest.approx(1e4, rel=0.002)
    # Poisson: the variance between copies is the mean, bin by bin.
    ratio = copies.var(axis=0, ddof=1) / copies.mean(axis=0)
    assert ratio.mean() == pytest.approx(1.0, abs=5 * np.sqrt(2 / 1500 / len(ratio)))
    medium = pools["medium_clean"].draw(0, SEED)[1]
    assert medium.sum(axis=1).mean() == pytest.approx(1e3, rel=0.01)
    np.testing.assert_array_equal(pool.again(np.zeros((7, 5)), SEED, None), copies[2 * CHUNK :][:7])


def test_pools_of_the_same_counts_are_thinned_otherwise(pools, monkeypatch):
    same = dict.fromkeys(pools, np.full(len(recorded()), 3000))
    monkeypatch.setattr(thinned, "divided", lambda *_: same)
    one, other = (pools[f"{level}_clean"].draw(0, SEED + 1)[1] for level in ("bright", "medium"))
    assert one.shape == other.shape
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("value", [1.03, 0.97])
def test_a_slope_moves_the_counts(pools, edges, value):
    """Against every count drawn at an energy of its own and put where that is, times the factor."""
    rng = np.random.default_rng(1)
    counts = rng.binomial(recorded(), 0.01)
    channel = np.repeat(np.arange(len(counts)), counts)
    energy = edges[channel, 0] + np.diff(edges, axis=1)[channel, 0] * rng.random(len(channel))
    wanted = np.histogram(value * energy, np.append(edges[:, 0], edges[-1, 1]))[0]
    found = moved(counts, edges, value, rng)
    pull = (found - wanted) / np.sqrt(np.maximum(found + wanted, 1))
    assert np.abs(pull).max() < 5
    assert found.sum() == pytest.approx(wanted.sum(), abs=5 * np.sqrt(counts.sum() - wanted.sum() + 1))
    np.testing.assert_array_equal(moved(counts, edges, 1.0, rng), counts)
    # In the copies: the clean ones' mean, moved, is theirs.
    pool, clean = pools[f"bright_gain_slope_{value:g}"], pools["bright_clean"]
    whole = observation()
    ratio = whole.simulator.response.grouping @ moved(recorded(), edges, value, rng) / whole.counts[0]
    assert off(pool, clean, ratio) == pytest.approx(1.0, abs=0.25)
    assert off(pool, clean, 1.0) > 3


def test_the_published_form_changes_bins_as_the_response_would(pools):
    """The same exposure, with the response's energies multiplied: by the simulator's own effect."""
    from gaugeblock.simulators import Effect

    pool, clean = pools["bright_published_gain_1.03"], pools["bright_clean"]
    simulator, theta = observation().simulator, thinned.best_fit()
    with_gain = simulator.with_effect(Effect("published_gain", {"factor": 1.03}))
    ratio = with_gain.expected(theta) / simulator.expected(theta)
    assert off(pool, clean, ratio) == pytest.approx(1.0, abs=0.25)
    assert off(pool, clean, 1.0) > 2


def test_the_model_describes_a_copy_and_not_the_whole(pools):
    told = thinned.described(pools["bright_clean"], SEED)
    assert int(told["counts"]) == observation().counts.sum() == 85_563_601
    assert float(told["of_copies"].mean()) == pytest.approx(1.0, abs=0.03)
    assert float(told["deviance"]) > 10
    assert told.sizes["copy"] == CHUNK


def test_no_flow_is_asked_about_spectra_that_it_was_not_trained_on():
    assert ThinnedPool("medium", "", 0.0, 10).flow == ""


def test_the_command_keeps_what_it_says(monkeypatch, tmp_path, capsys):
    stored = read_groups(RESULTS / "gain-thinned.nc")
    seen = {}

    def study(pools, pieces, **options):
        seen.update(options, pools=pools)
        return {"": stored[""].drop_attrs(), "schemes": stored["schemes"], "profiles": xr.Dataset()}

    monkeypatch.setattr(thinned, "study", study)
    given = ["--share", "0.01", "--generator-seed", "5", "--out", str(tmp_path)]
    assert thinned.main(given) == 0
    assert (seen["seed"], seen["share"], seen["profiles"], len(seen["pools"])) == (5, 0.01, 0, 10)
    printed = capsys.readouterr().out
    (tmp_path / "gain.md").write_text(
        "".join(f"<!-- {n} --><!-- /{n} -->\n" for n in ("thinned", "thinned schemes", "thinned catalogues"))
    )
    assert thinned.main(["--page", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    page = (tmp_path / "gain.md").read_text()
    for said in printed.split("\n\n"):
        assert said.strip() in page
    assert "--share 0.01" in printed


def test_the_page_says_what_was_measured():
    groups = {name: read(RESULTS / "gain-thinned.nc", name) for name in ("", "schemes", "described")}
    page = (DOCS / "gain.md").read_text(encoding="utf-8")
    for said in thinned.shown(groups).values():
        assert said in page
    assert groups[""].sizes["case"] == 8
    assert (groups[""]["null_catalogues"] == 400).all()


def test_what_is_read_off_the_table_is_in_it():
    """Looked up again in the page's own rows."""
    page = (DOCS / "gain.md").read_text(encoding="utf-8")
    part = page.partition("<!-- thinned catalogues -->")[2].partition("<!-- /thinned catalogues -->")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if "|" in line
    ]
    free = [row for row in rows if "bright" in row[0] and row[1] == "offset and area"]
    assert len(free) == 4
    said = " ".join(part.split())
    for row in free:
        mean = row[2].partition("(")[2].rstrip(")")
        assert f"{mean} ({row[0].partition(', ')[2]})" in said
    steps = ", ".join(f"{float(row[-2]):+.1f}" for row in free)
    assert f"(one step) {steps} where" in said
    for form in ("published gain", "gain slope"):
        alone, beside = (
            next(row for row in rows if form in row[0] and "bright" in row[0] and row[1] == name)[3].split()[
                0
            ]
            for name in ("alone", "offset and area")
        )
        assert f"{form} is {float(alone):+.1f} alone and {float(beside):+.1f} beside" in said
