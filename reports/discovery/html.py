"""report.html of a discovery: one page that tells what was found, with nothing to load from anywhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.core.atomic import discard_unfinished, made_folder, write_atomically
from gaugeblock.discovery import Discovery
from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.discovery.before_after import spectrum_chapter
from gaugeblock.reports.discovery.best_fit import fit_chapter
from gaugeblock.reports.discovery.candidate_chapter import candidate_chapter
from gaugeblock.reports.discovery.catalogue import catalogue_chapter
from gaugeblock.reports.discovery.chapter import Chapter, LeftOut
from gaugeblock.reports.discovery.headline import headline
from gaugeblock.reports.discovery.held_out import held_out_chapter
from gaugeblock.reports.discovery.located import located_chapter
from gaugeblock.reports.discovery.phrases import finite, pick
from gaugeblock.reports.discovery.priors import prior_chapter
from gaugeblock.reports.discovery.size import amplitude_chapter, evidence_chapter, shape_chapter
from gaugeblock.reports.machine import plain
from gaugeblock.reports.page import render
from gaugeblock.reports.words import count
from gaugeblock.validate.storage import write_tree

MODELS = ("model_before.xcm", "model_after.xcm")
"""The best fit of one source in XSPEC's own notation, without and with the named effects."""


def discovery_html(tree: xr.DataTree, summary: Mapping[str, Any]) -> str:
    """The whole page as text.

    `tree` and `summary` as described in `gaugeblock.reports.discovery.schema`. A chapter whose group is
    missing is left out, and the page says why.

    Raises
    ------
    InputError
        If a variable of the tree lies along other dimensions than the schema's.
    """
    content = plain(summary)
    made = _chapters(tree, content)
    unknown = [{"id": chapter.title, "why": chapter.why} for chapter in made if isinstance(chapter, LeftOut)]
    name = pick(content, "data", "name")
    return render(
        "discovery.html",
        title=f"Discovery: {name}" if name else "Discovery",
        headline=headline(content),
        remarks=[str(remark) for remark in content.get("remarks") or []],
        facts=_facts(content),
        # The nearest candidate of what has no name is no explanation.
        causes=[] if content.get("named") in (None, "unnamed") else _causes(content),
        chapters=[chapter for chapter in made if isinstance(chapter, Chapter)],
        left_out=unknown,
        not_checked=content.get("not_checked") or [],
        provenance=content.get("provenance") or {},
    )


def write_discovery(found: Discovery, out: Path | str, models: Mapping[str, str] | None = None) -> None:
    """Write discovery.json, discovery.nc and report.html into the folder `out`, each whole or not at all.

    `models` are the texts of `MODELS` that there are; what an earlier search left of the others goes.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    summary, folder = found.to_json(), made_folder(out)
    write_atomically(folder / "discovery.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    write_tree(found.tree, folder / "discovery.nc")
    content = discovery_html(found.tree, summary)
    # A file name in the data may hold bytes that are no text; they must not stop the report.
    write_atomically(folder / "report.html", content.encode("utf-8", "replace"))
    for name in MODELS:
        if models and name in models:
            write_atomically(folder / name, models[name])
        else:
            (folder / name).unlink(missing_ok=True)
    discard_unfinished(folder, ("discovery.json", "discovery.nc", "report.html", *MODELS))


def _chapters(tree: xr.DataTree, summary: Mapping[str, Any]) -> list[Chapter | LeftOut]:
    before = str(summary.get("model_before") or "the model")
    after = str(summary.get("model_after") or "the model with what was added")
    sources = int(finite(pick(summary, "data", "n_sources")) or 1)
    added, unnamed = bool(summary.get("named_all")), summary.get("named") == "unnamed"
    joined = "unnamed" in (summary.get("indistinguishable") or [])
    # A simulator that can only simulate expects nothing of a channel.
    counted = finite(pick(summary, "data", "counts")) is not None
    made = [
        spectrum_chapter(tree, summary, models=(before, after), sources=sources, added=added)
        if counted
        else None,
        located_chapter(tree, summary),
        candidate_chapter(tree, summary),
        prior_chapter(summary) if summary.get("statements") else None,
        fit_chapter(summary),
        shape_chapter(tree) if counted and (unnamed or joined) else None,
        held_out_chapter(tree, summary) if added or "held_out" in tree.children else None,
        amplitude_chapter(summary) if added else None,
        catalogue_chapter(tree, summary) if counted or "catalogue" in tree.children else None,
        evidence_chapter(summary) if added and counted else None,
    ]
    return [chapter for chapter in made if chapter is not None]


def _facts(summary: Mapping[str, Any]) -> list[str]:
    data = summary.get("data") or {}
    facts = []
    counted = finite(data.get("counts")) is not None
    nouns = ("source", "channel", "count") if counted else ("data set", "number", "")
    for key, noun in zip(("n_sources", "n_channels", "counts"), nouns, strict=True):
        value = finite(data.get(key))
        if value is not None:
            facts.append(count(int(value), noun))
    if summary.get("model_before"):
        facts.append(f"model {summary['model_before']}")
    return facts


def _causes(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, cause and typical size of each effect that was named or cannot be told from it."""
    names = dict.fromkeys([*(summary.get("named_all") or []), *(summary.get("indistinguishable") or [])])
    found = []
    for name in map(str, names):
        known = pick(summary, "effects", name) or {}
        if known.get("cause"):
            found.append((effect_words(name), str(known["cause"]), str(known.get("typical") or "")))
    return found
