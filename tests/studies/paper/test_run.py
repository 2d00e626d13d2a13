"""From names to files and an exit code."""

import numpy as np
import pytest
import xarray as xr
from studies.paper import Measured, Setting, Untestable, claims, from_committed, judge, reproduce
from studies.paper.document import DOCS, adopt, document
from studies.paper.family import family
from studies.paper.page import page
from studies.paper.run import Reproduction, as_dataset, needed

from gaugeblock.core.errors import InputError


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    reproduce(["published"], folder, seed=3)
    return folder


def test_all_files_are_written(out):
    text = (out / "reproduction.md").read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert "**42 agree, 0 differ" in text
    with xr.open_datatree(out / "reproduction.nc", engine="netcdf4") as stored:
        assert set(stored.children) == {"published", "claims"}
        verdicts = stored["claims"].to_dataset().load()
    assert set(verdicts["verdict"].values.tolist()) == {"agrees"}
    assert set(verdicts["claim"].values.tolist()) == {
        name for name, claim in claims().items() if claim.by == "published"
    }
    for line in text.splitlines():
        if line.startswith("!["):
            assert (out / line.partition("(")[2].rstrip(")")).exists()


def test_only_what_measures_the_claims_that_are_asked_for_is_run(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.paper.run.EXPERIMENTS", ("published", "counts"))
    names = {"gm.quad": claims()["gm.quad"], "tb.sigma": claims()["tb.sigma"]}
    assert needed(names) == ("published",)
    result = reproduce(["gm.quad", "tb.sigma"], tmp_path, seed=3)
    assert [item.verdict.value for item in result.judgements] == ["not measured yet", "agrees"]
    assert result.exit_code == 3


def test_an_unknown_name_runs_nothing(tmp_path):
    with pytest.raises(InputError, match="neither a claim nor an experiment"):
        reproduce(["gm.quad", "nothing"], tmp_path, seed=3)
    assert not list(tmp_path.iterdir())


def judged(*found):
    chosen = [claims()["ns.n"], claims()["gm.quad"], claims()["tb.sigma"]]
    return tuple(judge(claim, item) for claim, item in zip(chosen, found, strict=True))


@pytest.mark.parametrize(
    ("found", "code"),
    [
        ((Measured(76), Measured(0.017), Untestable("why")), 0),
        ((Measured(76), Measured(0.017), None), 3),
        ((Measured(75), Measured(0.017), None), 1),
        ((Measured(75, because="one spectrum was drawn twice"), Measured(0.017), Untestable("why")), 0),
        ((Measured(76), Measured(0.0181, 0.001), Untestable("why")), 0),
    ],
)
def test_exit_codes(found, code):
    assert Reproduction({}, judged(*found), None).exit_code == code


def test_too_many_misses_are_a_finding_of_their_own():
    cells = [claim for claim in claims().values() if claim.id.startswith("grid.pn.")]
    # Each by 2.9 combined standard errors: none alone has to be explained.
    far = [
        judge(cell, Measured(cell.parts["value"] + 2.9 * cell.error["value"] * 2**0.5, cell.error["value"]))
        for cell in cells
    ]
    assert not any(item.unexplained for item in far)
    assert Reproduction({}, tuple(far), family(far)).exit_code == 1


def test_the_page_says_every_verdict_and_reason():
    three = judged(Measured(75), Measured(0.017), Untestable("seeds are not published"))
    text = page({}, three, None, {})
    assert "**1 agree, 1 differ (1 of them beyond 3 standard errors and unexplained), 1 cannot" in text
    assert "cannot be tested: seeds are not published" in text
    assert "unexplained" in text


def test_the_page_has_every_claim_once():
    every = tuple(judge(claim, None) for claim in claims().values())
    text = page({}, every, None, {})
    for name in claims():
        assert name.startswith("grid.") or text.count(f"`{name}`") == 1, name
    assert text.count("| medium | B4 |") == 8  # four strengths on two responses
    assert "0.757" in text


def test_verdicts_as_a_table_have_every_part():
    table = as_dataset(judged(Measured(75), Measured(0.017), Untestable("why", {"value": 0.2})))
    row = table.isel(row=(table["claim"] == "ns.n").values)
    assert (row["measured"].item(), row["published"].item(), row["verdict"].item()) == (75, 76, "differs")
    sigma = table.isel(row=(table["claim"] == "tb.sigma").values)
    assert sigma["part"].values.tolist() == ["median", "min", "max", "value"]
    assert np.isnan(sigma["measured"].values[:3]).all()


def test_only_full_runs_become_results(out, tmp_path):
    assert adopt(out, tmp_path) == ["published"]
    assert [path.name for path in tmp_path.iterdir()] == ["published.nc"]
    reproduce(["published"], tmp_path / "twin", seed=3, setting=Setting.TWIN)
    with pytest.raises(InputError, match="no full run"):
        adopt(tmp_path / "twin", tmp_path)
    with pytest.raises(InputError, match="no such file"):
        adopt(tmp_path / "nothing", tmp_path)


def test_the_document_says_what_the_results_say(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "figures").mkdir()
    document(tmp_path)
    assert (tmp_path / "reproduction.md").read_text() == (DOCS / "reproduction.md").read_text()


def test_what_is_committed_has_no_unexplained_difference():
    assert from_committed(()).exit_code in (0, 3)
