import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from tests.reports.parsed import Page

from gaugeblock.core.errors import InputError
from gaugeblock.reports.discovery import discovery_html, write_discovery
from gaugeblock.reports.discovery.schema import GROUPS


def well_formed(page):
    assert page.astray == []
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {a["href"].removeprefix("#") for tag, a in page.tags if tag == "a"} <= set(ids)
    assert not re.search(r"\b(nan|None|NaN|inf)\b", page.text)


def test_every_ending_is_a_whole_page(tree, ending):
    _, summary = ending
    well_formed(Page(discovery_html(tree, summary)))


def test_the_story_is_told_in_order(catalogue, summary):
    page = Page(discovery_html(catalogue, summary))
    well_formed(page)
    assert page.sections == [
        "spectrum", "where", "what", "fit", "held-out", "amplitude", "catalogue", "evidence", "causes",
        "not-checked", "provenance",
    ]  # fmt: skip
    for said in (
        "emission line", "Atoms shine.", "6.08–6.72 keV", "+36.5 ± 7.1", "82.0%", "the gap shrinks in 3 of 3",
        "1.18e−4", "9e−5 to 1.5e−4", "log e-value 30.2", "+28.30", "ten times as wide",
        "the file names no frame time",
        "abababab", "fixed to the detector", "src", "Influence of single sources", "0.002",
    ):  # fmt: skip
        assert said in page.text, said


@pytest.mark.parametrize(
    "gone", sorted(set(GROUPS) - {"catalogue", "shape", "candidates", "scan", "moments", "null"})
)
def test_without_a_group_its_section_is_left_out_and_the_page_says_why(tree, summary, gone):
    del tree[gone]
    page = Page(discovery_html(tree, summary))
    well_formed(page)
    assert f"no group {gone}" in page.text


def test_without_any_group_the_summary_still_speaks(summary):
    page = Page(discovery_html(xr.DataTree(), summary))
    well_formed(page)
    assert {"what", "amplitude", "evidence", "not-checked"} <= set(page.sections)
    assert not {"spectrum", "where", "held-out"} & set(page.sections)


def test_an_empty_summary_is_no_error():
    well_formed(Page(discovery_html(xr.DataTree(), {})))


def test_a_single_source_misses_no_catalogue_and_a_name_no_shape(tree, summary):
    page = Page(discovery_html(tree, summary))
    assert "catalogue" not in page.sections
    assert "no group catalogue" not in page.text
    assert "shape" not in page.sections


def test_empty_groups_are_no_errors(tree, ending):
    for name, dimension in (("windows", "window"), ("scan", "node"), ("held_out", "fold")):
        tree[name] = xr.DataTree(tree[name].to_dataset().isel({dimension: []}))
    page = Page(discovery_html(tree, ending[1]))
    well_formed(page)
    assert "no range stands out" in page.text


def test_other_units_are_not_called_energies(make_tree, summary):
    text = Page(discovery_html(make_tree(unit="day"), summary)).text
    assert "counts / day" in text
    assert "energy (day)" not in text


def test_a_variable_along_the_wrong_dimension_is_said(tree, summary):
    spectrum = tree["spectrum"].to_dataset()
    spectrum["before"] = ("bin", spectrum["before"].values)
    tree["spectrum"] = xr.DataTree(spectrum)
    with pytest.raises(InputError, match="spectrum/before must lie along channel"):
        discovery_html(tree, summary)


def test_background_and_channel_numbers_have_their_own_axes(make_tree, summary):
    page = Page(discovery_html(make_tree(background=True), summary))
    assert "pn background (background region)" in page.text
    summary["disagreement"]["regions"][0] |= {"lo": 114.0, "hi": 126.0, "unit": "channel"}
    page = Page(discovery_html(make_tree(unit="channel"), summary))
    assert "channels 114–126" in page.text
    assert "counts / channel" in page.text
    assert "keV" not in "".join(page.text.split("What it could be")[0])


def test_what_every_claim_on_a_catalogue_comes_with(catalogue, summary):
    summary["catalogue"] = {"n": 500, "z": 10.1, "z_beside_nuisances": 4.2, "effective_sources": 317.0}
    summary["amplitude"][0]["beside_nuisances"] = {
        "value": 1.1e-4, "interval": [0.5e-4, 1.7e-4], "nuisances": ["gain_offset (sd 0.01)"],
    }  # fmt: skip
    text = Page(discovery_html(catalogue, summary)).text
    for said in ("Z beside shared nuisances", "4.2", "317", "beside gain_offset (sd 0.01)", "5e−5 to 1.7e−4"):
        assert said in text


def test_errors_foreseen_for_more_sources_are_not_told_as_measured(catalogue, summary):
    data = catalogue["catalogue"].to_dataset()
    data["amplitude"] = ("size", np.full(6, 1.03))
    catalogue["catalogue"] = xr.DataTree(data)
    summary["data"]["n_sources"] = 100
    text = Page(discovery_html(catalogue, summary)).text
    assert "what more sources would bring" in text
    assert "this catalogue" in text
    assert "from 500 sources" not in text


def test_hostile_words_are_shown_and_do_nothing(tree, summary, hostile):
    summary["named"] = summary["named_all"][0] = summary["indistinguishable"][0] = hostile
    summary["candidates"][0] |= {"effect": hostile, "unit": hostile, "parameters": {hostile: 1.0}}
    summary |= {"model_before": hostile, "remarks": [hostile], "provenance": {hostile: [hostile]}}
    summary["not_checked"] = [{"id": hostile, "why": hostile}]
    summary["amplitude"][0] |= {"effect": hostile, "unit": hostile}
    spectrum = tree["spectrum"].to_dataset()
    spectrum["segment"] = ("channel", np.full(spectrum.sizes["channel"], hostile))
    tree["spectrum"] = xr.DataTree(spectrum)
    text = discovery_html(tree, summary)
    assert "<script" not in text
    page = Page(text)
    assert page.astray == []
    assert page.text.count("alert('x')") > 8


def test_nothing_is_loaded_from_anywhere_and_nothing_runs(catalogue, summary):
    text = discovery_html(catalogue, summary)
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {"script", "iframe", "img", "object", "embed", "base", "form"}
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), f"{tag} has a handler {name}"
            if name in ("src", "href"):
                assert value.startswith("#") or value == "data:,", value
    assert not re.search(r"url\(|@import|https?:", re.findall(r"<style>(.*?)</style>", text, re.DOTALL)[0])


def test_it_is_written_from_what_was_stored(tree, summary, tmp_path):
    tree.to_netcdf(tmp_path / "discovery.nc")
    stored = xr.open_datatree(tmp_path / "discovery.nc")
    told = json.loads(json.dumps({**summary, "provenance": {}}))
    write_discovery(SimpleNamespace(tree=stored, to_json=lambda: told), tmp_path / "out")
    assert (tmp_path / "out" / "report.html").read_text() == discovery_html(tree, told)
    assert json.loads((tmp_path / "out" / "discovery.json").read_text()) == told
    stored.close()


def test_a_folder_that_cannot_be_made_is_said(tree, summary, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        write_discovery(SimpleNamespace(tree=tree, to_json=lambda: summary), tmp_path / "file" / "out")
