"""The study of spectra in which nothing is hidden: what is counted, what the page says of it."""

import numpy as np
import pytest

pytest.importorskip("jaxspec")
from studies.kit.page import filled
from studies.kit.results import DOCS, RESULTS, read
from studies.nulls import __main__ as nulls

pytestmark = pytest.mark.usefixtures("xray_data")


def test_a_run_counts_alarms_names_and_what_stopped(tmp_path, monkeypatch, capsys):
    """Nine of ten agree; one in ten alarms, with a name that is certain; NICER stops."""
    asked = []

    def search(case, counts, files, rng, seed):
        asked.append((case, counts))
        alarm = seed == 3
        said = [{"effect": "pileup", "alike": ["pileup"], "certain": True, "probability": 0.9}] * alarm
        if case.instrument == "NICER":
            return {
                "error": "InputError: no",
                "p_global": np.nan,
                "named": "",
                "said": [],
                "bins": 0,
                "statistic": np.nan,
            }
        return {"error": "", "p_global": 0.001 if alarm else 0.5, "named": "pileup" if alarm else "",
                "said": said, "bins": 10, "statistic": 9.0}  # fmt: skip

    monkeypatch.setattr(nulls, "search", search)
    arguments = ["--each", "10", "--generator-seed", "4", "--out", str(tmp_path)]
    assert nulls.main(arguments) == 0
    table = read(tmp_path / "nulls.nc")
    assert table.sizes["row"] == 40
    for stratum, (low, high) in enumerate(zip(nulls.EDGES, nulls.EDGES[1:], strict=False)):
        counts = table["counts"].values[table["stratum"].values == stratum]
        assert len(counts) == 10
        assert np.all((counts >= low) & (counts < high))
    stopped = table["instrument"].values == "NICER"
    alarms = (table["number"].values == 3) & ~stopped
    assert 0 < stopped.sum() < 40
    np.testing.assert_array_equal(table["error"].values != "", stopped)
    np.testing.assert_array_equal(table["certain"].values, alarms)
    shown = capsys.readouterr().out
    assert shown.count("InputError: no") == stopped.sum()
    last = next(line for line in shown.splitlines() if line.startswith("| all |"))
    assert last.split("|")[2].strip() == str(40 - stopped.sum())
    assert last.split("|")[3].split()[0] == str(alarms.sum())
    # Nothing is searched again.
    before = len(asked)
    assert nulls.main(arguments) == 0
    assert len(asked) == before == 40
    # Nor is it where a table is there and the work behind it is not: what it lacks is added to it.
    again = ["--generator-seed", "4", "--out", str(tmp_path / "both")]
    assert nulls.main([*again, "--each", "6", "--work", str(tmp_path / "lost")]) == 0
    assert nulls.main([*again, "--each", "10", "--work", str(tmp_path / "then"), "--add"]) == 0
    assert len(asked) == 80
    both = read(tmp_path / "both" / "nulls.nc")
    assert both.drop_vars("seconds").drop_attrs().identical(table.drop_vars("seconds").drop_attrs())
    assert both.attrs["command"].endswith(
        "--each 6 && python -m studies nulls --generator-seed 4 --each 10 --add"
    )
    assert nulls.main([*again, "--each", "10", "--add"]) == 2
    assert "has 10 cases in a stratum already" in capsys.readouterr().err
    other = ["--generator-seed", "5", "--out", str(tmp_path / "both"), "--each", "12", "--add"]
    assert nulls.main(other) == 2
    assert "--add: generator_seed is 5, and in the table that is there 4;" in capsys.readouterr().err
    assert len(asked) == 80


def test_the_page_is_of_the_stored_table():
    stored = DOCS.parent / "studies" / "results" / "nulls.nc"
    if not stored.exists():
        pytest.skip("studies/results/nulls.nc is not there")
    page = (DOCS / "measured.md").read_text(encoding="utf-8")
    assert filled(page, {"measured nulls": nulls.shown(read(stored))}) == page


def test_what_the_page_says_by_hand_is_counted():
    said = " ".join((DOCS / "measured.md").read_text(encoding="utf-8").split())
    now, before, first = (
        read(RESULTS / f"{name}.nc") for name in ("nulls", "nulls-747956d", "nulls-a453d66")
    )
    alarms = [
        int((now["p_global"].values[now["stratum"].values == at] < nulls.LEVEL).sum()) for at in range(4)
    ]
    # Of each 250 at most 1.9%, of all at most 1% certain.
    assert now.sizes["row"] == 4 * nulls.EACH
    assert max(alarms) <= 0.019 * nulls.EACH
    assert int(now["certain"].sum()) == 1
    assert f"**Of 1,000 spectra {sum(alarms)} have such a p**" in said
    assert "{}, {}, {} and {} in the four ranges of counts, and in one".format(*alarms) in said
    earlier = [int((one["p_global"] < nulls.LEVEL).sum()) for one in (before, first)]
    assert f"a p below 0.01 in {earlier[0]} of {before.sizes['row']} spectra" in said
    assert f"and {first.sizes['row']} spectra at a453d66" in said
    assert earlier[1] == 1
    assert not before["certain"].any()
    assert not first["certain"].any()
    lined = now["model"].values == "tbabs*(powerlaw+gauss)"
    assert f"Of the {lined.sum()} spectra of `tbabs*(powerlaw+gauss)` below" in said
    assert not (now["p_global"].values[lined] < nulls.LEVEL).any()
    assert not (now["named"].values[lined] != "").any()
