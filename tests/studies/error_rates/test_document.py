"""docs/error-rates.md says what the stored results say, and its figures can be drawn from them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.error_rates import shapes
from studies.error_rates.__main__ import main, parts
from studies.error_rates.anytime import summarise
from studies.error_rates.document import FIGURE, TABLES, blocks, document, percent
from studies.error_rates.forecasts import AFTER, BEFORE, EDGED, WITHIN
from studies.error_rates.summary import indicators, p_values
from studies.kit.page import filled
from studies.kit.results import DOCS, RESULTS, stored

NAMES = list(parts(RESULTS, 1))


ANY_OF = {f"any of {number}": 0.0 for number in (1, 2, 5, 10, 20)}
SHAPES = [f"{kind}-{size}" for size in shapes.SIZES for kind in shapes.KINDS]


@pytest.fixture(scope="module")
def tables():
    """Small tables of every part, as a run would store them."""
    rng = np.random.default_rng(1)
    verdict = [{"FAIL": 1.0, "PASS": 0.0, "inside": 1.0, "fail: sbc.bias": 1.0}, {"PASS": 1.0, "inside": 0.0}]
    unsettled = [
        {"FAIL": 0.0, "PASS": 0.0, "open: sbc.log_width": 1.0, "open: sbc.bias": float(k < 3)}
        for k in range(10)
    ]
    uniform = [{"sbc.bias[a]": p, "local": 1 - p} for p in rng.random(40)]
    zoo = {"exact": {"trials": 1000, "policy": "default"}, "narrow": {"trials": 4000, "policy": "strict"}}
    made = {
        "size": p_values({"linear_gaussian": uniform, "alone": [{"mmd": 0.5}] * 40}),
        "gate": indicators({"exact": verdict, "bias": verdict}),
        "intervals": indicators({"exact": [{"inside": 1.0}]}),
        **dict.fromkeys(("shortcut", "edges", "looks"), indicators({"bias": verdict})),
        "forecasts": indicators({"normal": [dict.fromkeys((WITHIN, BEFORE, AFTER, EDGED), 1.0)]}),
        "retraining": indicators({"on the edge": [{"released": 1.0, **ANY_OF}]}),
        **dict.fromkeys(SHAPES, indicators({"Cauchy": unsettled, "chain": unsettled})),
        "planned": shapes.medians(
            {
                "Cauchy": [{"medium": 0.01 * k, "large": 0.1 * k} for k in range(11)],
                "chain": [{"medium": np.nan, "large": np.nan}] * 11,
            }
        ),
        "power": indicators({"exact": verdict, "narrow": verdict}),
        "curves": indicators({f"narrow @ {n}": verdict for n in (100, 200)}),
        "anytime": summarise(
            {"bias": [{"trials": np.nan, "PASS": 0.0}], "width 0.5": [{"trials": 9.0, "FAIL": 1.0}] * 3}
        ),
    }
    said = {
        "says": "a study",
        "command": "python studies/run.py gate",
        "seconds_per_replicate": 0.1,
        "seed": 1,
    }
    return {
        name: table.assign_attrs({**said, "settings": json.dumps({"zoo": zoo})})
        for name, table in made.items()
    }


def test_every_part_has_a_table(tables):
    assert set(tables) == {*TABLES, *SHAPES} == set(NAMES)
    without = {"planned", "shortcut", "edges", "looks", "forecasts", "retraining", "intervals", *SHAPES}
    assert set(FIGURE) == set(NAMES) - without


def test_tables_stand_where_the_document_wants_them(tables):
    text = (DOCS / "error-rates.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert text.count(f"<!-- {name} -->") == text.count(f"<!-- /{name} -->") == 1
    made = blocks(tables)
    once = filled(text, made)
    assert filled(once, made) == once
    assert "| exact | default | 1,000 | 50.0% (1.3 to 98.7) | 50.0% (1.3 to 98.7) | `sbc.bias` |" in once
    assert f"| on the edge |{5 * ' 0.0% (0.0 to 97.5) |'} 100.0% (2.5 to 100.0) |" in once
    none = "0.0% (0.0 to 30.8) | 0.0% (0.0 to 30.8)"
    for promised in ("", "5% (1 to 9) | ", "50% (10 to 90) | "):
        assert once.count(f"| Cauchy | {none} | {promised}`sbc.log_width` |") == 2
    assert once.count(f"| chain | {none} | nothing | `sbc.log_width` |") == 4
    assert "| `mmd` |  | 0.0% (0.0 to 8.8) |" in once
    assert "| width 0.5 | 100.0% (29.2 to 100.0) | 0.0% (0.0 to 70.8) | 9, 9, 9 |" in once
    assert (
        "40 replicates of each. Made by `python -m studies error-rates gate`, 0.1 s of CPU a replicate."
        in once
    )


def test_a_rate_that_was_not_measured_is_left_out():
    table = indicators({"a": [{"inside": np.nan, "FAIL": 1.0}]})
    assert percent(table, case="a", thing="inside") == ""


def test_figures_are_drawn_and_small(tables, tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "error-rates.md").write_text("<!-- gate -->\n<!-- /gate -->\n", encoding="utf-8")
    document(tables, tmp_path)
    figures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert figures == sorted(f"error-rates-{name}.svg" for name in FIGURE)
    assert all(path.stat().st_size < 200_000 for path in (tmp_path / "figures").iterdir())
    assert "| bias |" in (tmp_path / "error-rates.md").read_text(encoding="utf-8")


def test_the_command_reports_what_is_stored(tables, tmp_path):
    pytest.importorskip("matplotlib")
    tables["gate"].to_netcdf(tmp_path / "gate.nc", engine="netcdf4")
    (tmp_path / "error-rates.md").write_text("<!-- gate -->\n<!-- /gate -->\n", encoding="utf-8")
    assert main(["--report", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["error-rates-gate.svg"]


def test_the_document_says_what_the_results_say():
    known = stored(NAMES)
    if not known:
        pytest.skip("the study has not been run; python -m studies error-rates --all --report")
    text = (DOCS / "error-rates.md").read_text(encoding="utf-8")
    assert filled(text, blocks(known)) == text
    assert set(known) == set(NAMES)
    for name in FIGURE:
        assert 0 < (DOCS / "figures" / f"error-rates-{name}.svg").stat().st_size < 200_000


def test_the_results_keep_the_promises():
    """What the document promises, on the stored counts.

    Wrong verdicts: no more than the 0.9999 binomial quantile of 5%, 77 in 1,000 and 583 in 10,000; intervals
    and powers: every 95% interval lies wholly above the promise.
    """
    known = stored(NAMES)
    if not known:
        pytest.skip("the study has not been run; python -m studies error-rates --all --report")
    for name in ("gate", "shortcut", "edges", "anytime"):
        edge = known[name].sel(thing=["FAIL", "PASS"])
        sound = [case for case in ("exact",) if case in edge["case"]]
        gross = [case for case in edge["case"].values if str(case).startswith(("width", "shift"))]
        too_many = edge["count"] > stats.binom.ppf(1 - 1e-4, edge["replicates"], 0.05)
        assert not too_many.drop_sel(case=[*sound, *gross]).any(), name
        assert not too_many.sel(case=sound, thing="FAIL").any(), name
        assert not too_many.sel(case=gross, thing="PASS").any(), name
    for name in SHAPES:
        found = known[name]
        too_many = found["count"] > stats.binom.ppf(1 - 1e-4, found["replicates"], 0.05)
        assert not too_many.sel(thing="FAIL").any(), name
    of_all = xr.concat([known["shapes-large"], known["wide-large"]], "case", join="outer", fill_value=0)
    promised = known["planned"]["promised"].sel(size="large", quantile=0.5)
    for case in promised["case"].values[promised.values >= 0.9]:
        assert float(of_all["high"].sel(case=case, thing="PASS")) >= 0.9, case
        assert float(of_all["rate"].sel(case=case, thing="PASS")) >= 0.85, case
    assert int((promised >= 0.9).sum()) >= 10
    assert int(known["curves"]["replicates"].min()) >= 200
    assert int(known["intervals"]["replicates"].min()) >= 1000
    assert float(known["intervals"]["low"].min()) >= 0.95
    power = known["power"]
    assert int(power["replicates"].min()) >= 200
    assert float(power["low"].sel(thing="FAIL").drop_sel(case="exact").min()) >= 0.9
    assert float(power["high"].sel(thing="PASS").drop_sel(case="exact").max()) <= 0.05
    assert float(power["low"].sel(thing="PASS", case="exact")) >= 0.9
    # 1e-4 for each of some 100 p-values: none is rejected too often at any level.
    size = known["size"]
    assert not too_often(size).any()


def too_often(size: xr.Dataset) -> xr.DataArray:
    most = stats.binom.ppf(1 - 1e-4, size["replicates"].values[:, None], size["level"].values)
    return size["rejected"] > most


def test_too_many_rejections_are_noticed():
    uniform = (np.arange(1000) + 0.5) / 1000
    fine = p_values({"a": [{"t": p} for p in uniform]})
    assert not too_often(fine).any()
    assert too_often(p_values({"a": [{"t": p} for p in uniform**1.5]})).any()
