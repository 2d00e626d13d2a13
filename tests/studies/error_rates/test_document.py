"""docs/error-rates.md says what the stored results say, and its figures can be drawn from them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.error_rates import regions, shapes
from studies.error_rates.__main__ import main, parts
from studies.error_rates.anytime import summarise
from studies.error_rates.document import FIGURE, PAGES, TABLES, blocks, document, percent
from studies.error_rates.edges import ANY, LEARNED
from studies.error_rates.forecasts import AFTER, BEFORE, EDGED, WITHIN
from studies.error_rates.summary import indicators, indicators_where_asked, p_values
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
        **dict.fromkeys(("shortcut", "edge-gates", "edges", "looks"), indicators({"bias": verdict})),
        "regions": indicators_where_asked(
            {
                f"Cauchy, {trials:,}": [
                    {f"{said} at {one:g}": float(said == "PASS") for one in each for said in ("FAIL", "PASS")}
                ]
                for trials, each in regions.SIZES.items()
            }
        ),
        "caught": indicators(
            {
                "Cauchy": [
                    dict.fromkeys(("bias", "width", "loss"), 1.0) | {"region": 0.0 if k < 3 else np.nan}
                    for k in range(8)
                ]
            }
        ),
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
        "blind-spots": indicators_where_asked(
            {
                "nothing": [{"FAIL": 0.0, "sbc.bias": 0.0, "draws.finite": 0.0, "joint.tarp": 0.0}] * 10,
                "much": [{"FAIL": 1.0, "sbc.bias": float(k == 0), "models": 1.0} for k in range(9)]
                + [{"FAIL": 0.0, "sbc.bias": 0.0, "models": 0.0}],
                "something": [
                    {"FAIL": 1.0, "sbc.bias": float(k < 2), "models": float(k < 8)} for k in range(10)
                ],
            }
        ),
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
    without = {
        "planned",
        "shortcut",
        "edge-gates",
        "edges",
        "looks",
        "forecasts",
        "retraining",
        "intervals",
        *SHAPES,
    }
    without |= {"blind-spots", "regions", "caught"}
    assert set(FIGURE) == set(NAMES) - without


def test_tables_stand_where_the_document_wants_them(tables):
    text = whole()
    for name in [*NAMES, "wrong-verdicts"]:
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
    never, always = "0.0% (0.0 to 97.5)", "100.0% (2.5 to 100.0)"
    everywhere = f"| Cauchy, 10,000 |  |  | {never} | {always} | {never} | {always} |"
    assert everywhere in once
    always, never = "100.0% (63.1 to 100.0) of 8", "0.0% (0.0 to 70.8) of 3"
    assert f"| Cauchy | {always} | {always} | {never} | {always} |" in once
    assert "| nothing | 0.0% (0.0 to 30.8) |  |  | `joint.tarp`, `sbc.bias` |" in once
    assert "| much | 90.0% (55.5 to 99.7) | `models` (9) |  | `sbc.bias` (1) |" in once
    assert "| something | 100.0% (69.2 to 100.0) |  | `models` (8), `sbc.bias` (2) |  |" in once
    assert "All of 10 are a rate of 69.2% or more, none one of 30.8% or less" in once
    assert "| width 0.5 | 100.0% (29.2 to 100.0) | 0.0% (0.0 to 70.8) | 9, 9, 9 |" in once
    assert (
        "40 replicates of each. Made by `python -m studies error-rates gate`, 0.1 s of CPU a replicate."
        in once
    )


def whole():
    """All pages that the study fills, one after another."""
    return "\n".join((DOCS / name).read_text(encoding="utf-8") for name in PAGES)


def test_limits_of_wrong_verdicts_are_of_all_edges_and_of_nothing_else():
    def counted(number, **cases):
        return indicators(
            {
                case: [{"FAIL": float(k < fail), "PASS": float(k < passed)} for k in range(number)]
                for case, (fail, passed) in cases.items()
            }
        ).assign_attrs(says="", seconds_per_replicate=1.0)

    known = {
        "gate": counted(100, exact=(0, 100), bias=(1, 6)),
        "looks": counted(1000, normal=(10, 51), **{"normal, looks not counted": (150, 200)}),
        "shortcut": counted(1000, ess=(3, 77)),
        "anytime": counted(1000, bias=(0, 50), exact=(0, 1000)).assign(
            trials=(("case", "quantile"), np.full((2, 3), np.nan))
        ),
        "curves": counted(1000, ess=(900, 900)),
    }
    low, high = (100 * end for end in stats.binomtest(77, 1000).proportion_ci(method="exact"))
    few = [100 * end for end in stats.binomtest(6, 100).proportion_ci(method="exact")]
    assert blocks(known)["wrong-verdicts"] == (
        "Of 8 rates on an edge none is refuted (77 of 1,000 are not). "
        "Measured above 5%: 2 of 6 rates of 1,000 replicates; the largest upper limit is "
        f"{high:.1f}%: PASS of ess (`shortcut`), 7.7% ({low:.1f} to {high:.1f}). "
        "Measured above 5%: 1 of 2 rates of 100 replicates; the largest upper limit is "
        f"{few[1]:.1f}%: PASS of bias (`gate`), 6.0% ({few[0]:.1f} to {few[1]:.1f})."
    )
    known["shortcut"] = counted(1000, ess=(78, 0))
    assert "Of 8 rates on an edge 1 is refuted" in blocks(known)["wrong-verdicts"]


def test_rates_beyond_the_band_are_counted():
    """1,000 replicates: 64 rejections lie within it, 65 above; 37 within, 36 below."""
    p = {n: [{"t": 0.01}] * n + [{"t": 0.5}] * (1000 - n) for n in (64, 65, 37, 36, 66)}
    table = p_values({str(n): values for n, values in p.items()})
    said = blocks({"size": table.assign_attrs(says="", seconds_per_replicate=1.0)})["size"]
    chance = 5 * stats.binom(1000, 0.05).sf(64)
    assert f"Of these 5 rates 2 lie above that, where chance puts {chance:.1f} of as many exact tests" in said
    assert said.partition(", and ")[2].startswith("1 below.")


def test_a_table_that_knows_its_code_says_of_which_commit_it_is(tables):
    known = tables["gate"].assign_attrs(commit=f"{'0' * 40}, {'f' * 40}-dirty", code="1")
    assert "error-rates gate` at 0000000, fffffff-dirty, 0.1 s" in blocks({"gate": known})["gate"]
    assert "error-rates gate`, 0.1 s" in blocks(tables)["gate"]


def test_a_rate_that_was_not_measured_is_left_out():
    table = indicators({"a": [{"inside": np.nan, "FAIL": 1.0}]})
    assert percent(table, case="a", thing="inside") == ""


def test_figures_are_drawn_and_small(tables, tmp_path):
    pytest.importorskip("matplotlib")
    for name in PAGES:
        (tmp_path / name).write_text("<!-- gate -->\n<!-- /gate -->\n", encoding="utf-8")
    document(tables, tmp_path)
    figures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert figures == sorted(f"error-rates-{name}.svg" for name in FIGURE)
    assert all(path.stat().st_size < 200_000 for path in (tmp_path / "figures").iterdir())
    assert "| bias |" in (tmp_path / "error-rates.md").read_text(encoding="utf-8")


def test_the_command_reports_what_is_stored(tables, tmp_path):
    pytest.importorskip("matplotlib")
    tables["gate"].to_netcdf(tmp_path / "gate.nc", engine="netcdf4")
    for name in PAGES:
        (tmp_path / name).write_text("<!-- gate -->\n<!-- /gate -->\n", encoding="utf-8")
    assert main(["--report", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["error-rates-gate.svg"]


def test_the_document_says_what_the_results_say():
    known = stored(NAMES)
    if not known:
        pytest.skip("the study has not been run; python -m studies error-rates --all --report")
    text = whole()
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
    for name in {"gate", "shortcut", "edge-gates", "edges", "anytime"} & known.keys():
        edge = known[name].sel(thing=["FAIL", "PASS"])
        sound = [case for case in ("exact",) if case in edge["case"]]
        gross = [case for case in edge["case"].values if str(case).startswith(("width", "shift"))]
        too_many = edge["count"] > stats.binom.ppf(1 - 1e-4, edge["replicates"], 0.05)
        assert not too_many.drop_sel(case=[*sound, *gross]).any(), name
        assert not too_many.sel(case=sound, thing="FAIL").any(), name
        assert not too_many.sel(case=gross, thing="PASS").any(), name
    cells, most = 0, 0
    for name in SHAPES:
        found = known[name]
        too_many = found["count"] > stats.binom.ppf(1 - 1e-4, found["replicates"], 0.05)
        assert not too_many.sel(thing="FAIL").any(), name
        assert (found["replicates"] == 1000).all(), name
        cells, most = cells + found.sizes["case"], max(most, int(found["count"].sel(thing="FAIL").max()))
    text = (DOCS / "error-rates.md").read_text(encoding="utf-8")
    assert f"as many replicates in each of {cells} cells, and at most {most} FAILs" in text
    edge = known["edge-gates"]["count"]
    local = edge.sel(case=[case for case in edge["case"].values if str(case).startswith("local")])
    learned, passed = (local.sel(thing=thing).values for thing in (LEARNED, ANY))
    said = f"learned, which it was in {learned.min()} to {learned.max()} of 1,000; else all regions that were"
    assert f"{said} learned are within tolerance, and with them up to {passed.max()} of 1,000 PASS" in text
    of_all = xr.concat([known["shapes-large"], known["wide-large"]], "case", join="outer", fill_value=0)
    promised = known["planned"]["promised"].sel(size="large", quantile=0.5)
    for case in promised["case"].values[promised.values >= 0.9]:
        assert float(of_all["high"].sel(case=case, thing="PASS")) >= 0.9, case
        assert float(of_all["rate"].sel(case=case, thing="PASS")) > 0.98, case
    assert int((promised >= 0.9).sum()) == 12
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
