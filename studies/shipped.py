"""The flows that ship, audited on trials that nobody had seen when they were final.

    python -m studies shipped [NAME ...]            # two audits each, and one of both together
    python -m studies shipped --development NAME    # one audit on the development seed; no table is written
    python -m studies shipped --log                 # every training and audit, those that failed too
    python -m studies shipped --page                # docs/training.md of results/shipped.nc; runs nothing

The policy and the number of trials of each flow stand below, and how many trainings it may have; both seeds
are drawn from the digest of the commit that is measured, which holds the flows. A flow is chosen on the
development seed, and these are opened once, for the flow that was chosen.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock as gb
from gaugeblock.auditing.config import as_policy
from gaugeblock.auditing.judging import judged_and_kept
from gaugeblock.auditing.result import Audit
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.shipped import reference_model_path
from gaugeblock.reports.machine import verdict_json
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.trials import IMPORTANCE, JOINT, group_trials, main_trials, trials_tree
from gaugeblock.validate.verdict import combine
from studies.kit.command import carried_out, parser
from studies.kit.commit import ROOT, committed, seed_of
from studies.kit.page import fill, table
from studies.kit.results import STUDIES, read, record, write

NAME = "studies shipped"
DEVELOPMENT = 1
"""Seed of the audits by which flows are chosen."""

MODELS = reference_model_path().parent
AUDITS = ("first", "second", "both")
EFFICIENCY = "{efficiency:.1%} ({efficiency_lo:.1%} to {efficiency_hi:.1%})"


@dataclass(frozen=True)
class Promise:
    """The policy that a flow ships under, the trials of each of its two audits, draws for each efficiency.

    `trainings` is how many it may have, the first among them; each is a line of shipped.toml. `further` were
    promised after these had failed, which is told wherever the flow is.
    One for many exposures has these audits in every range of `exposures`, and keeps its promise in all.
    """

    policy: str
    trials: int
    importance_draws: int
    exposures: tuple[tuple[float, float], ...] = ()
    trainings: int = 3
    further: int = 0

    @property
    def parts(self) -> Mapping[str, Mapping[str, Any]]:
        """What is audited by itself: its name, and what its simulator has in place of the training's."""
        return {
            f"{low:g} to {high:g} s": {"exposure": {"distribution": "log_uniform", "low": low, "high": high}}
            for low, high in self.exposures
        } or {"": {}}


# With 500 draws the strict policy leaves open a flow whose weights have a tail.
STRICT, DEFAULT = Promise("strict", 10_000, 4_000), Promise("default", 4_000, 500)
# In the middle of them the median draw from the prior has 100, 1,000 and 10,000 counts.
DECADES = Promise("strict", 10_000, 4_000, exposures=((10.8, 108.0), (108.0, 1080.0), (1080.0, 10800.0)))
PROMISES: Mapping[str, Promise] = {
    "epic-pn-faint": STRICT,
    "epic-pn-medium": STRICT,
    "epic-pn-bright": STRICT,
    "nicer-faint": DEFAULT,
    "nicer-medium": DEFAULT,
    "nicer-bright": DEFAULT,
    "epic-pn-medium-gain": DEFAULT,
    # Promised after the third had failed, and before it was run: docs/training.md says why.
    "epic-pn-bright-gain": replace(DEFAULT, further=1),
    "epic-pn-exposures": DECADES,
}


def audited(name: str, part: str, seed: int, work: Path) -> Audit:
    """One audit, with likelihoods of all trials; an interrupted one goes on in its folder below `work`."""
    promise, made = PROMISES[name], _made(name)
    called = "-".join(filter(None, (name, part.replace(" ", "-"), made["sha256"][:12], str(seed))))
    numbers = {
        "number": promise.trials,
        "joint_number": promise.trials,
        "importance_draws": promise.importance_draws,
    }
    return gb.audit(
        f"shipped:{name}",
        made["simulator_table"] | promise.parts[part],
        trials=numbers,
        seed=seed,
        policy=promise.policy,
        out=work / called,
        progress=True,
    )


def _made(name: str) -> dict[str, Any]:
    """How a flow was made."""
    return dict(json.loads((reference_model_path(name) / "model.json").read_text(encoding="utf-8")))


def history(name: str) -> dict[str, int]:
    """Trainings of a flow, how many were promised before any of them, and its pairs of final audits."""
    every = [one["kind"] for one in _known()["entry"] if one["flow"] == name]
    return {
        "trainings": every.count("training"),
        "promised": PROMISES[name].trainings,
        "final_audits": every.count("final") + 1,
    }


def _known() -> dict[str, Any]:
    return tomllib.loads((STUDIES / "shipped.toml").read_text(encoding="utf-8"))


def together(audits: Sequence[Audit], seeds: Sequence[int], **stated: Any) -> Audit:
    """One audit of the trials of several, under their common policy; what is `stated` is in its record."""
    trees = [audit.trials for audit in audits]
    main = xr.concat([main_trials(tree) for tree in trees], "trial")
    groups = {}
    for name in (IMPORTANCE, JOINT):
        found = [one for one in (group_trials(tree, name) for tree in trees) if one is not None]
        groups[name] = xr.concat(found, "trial") if found else None
    record = dict(audits[0].verdict.provenance)
    used = {f"{name}_number": group.sizes["trial"] for name, group in groups.items() if group is not None}
    sizes = {"number": main.sizes["trial"], **used, "seeds": [str(seed) for seed in seeds]}
    return judged_and_kept(
        trials_tree(main, **groups),
        as_policy(record["policy"]),
        seed=seeds[0],
        validators=None,
        provenance=record | {"trials": {**record["trials"], **sizes}, **stated},
        out=None,
        earlier=None,
        looks=Looks(trials=(main.sizes["trial"],)),
        progress=lambda *_: None,
    )


def row(name: str, part: str, which: str, seed: int, audit: Audit) -> dict[str, Any]:
    """What is kept of an audit: its outcome, what failed, and what was left open, required or not."""
    gates = list(audit.gates.values())
    left = [gate for gate in gates if gate.outcome == "INCONCLUSIVE"]
    efficiency = audit.gates["importance.ess"]
    return {
        "flow": name, "part": part, "audit": which, "seed": str(seed), "policy": PROMISES[name].policy,
        "trials": audit.trials.sizes["trial"], "outcome": str(audit.outcome.value),
        "failed": _families(gate for gate in gates if gate.outcome == "FAIL"),
        "open": _families(gate for gate in left if gate.required),
        "open_beside": _families(gate for gate in left if not gate.required),
        "efficiency": efficiency.statistic, "efficiency_lo": efficiency.interval[0],
        "efficiency_hi": efficiency.interval[1],
    }  # fmt: skip


def _families(gates: Iterable[Any]) -> str:
    """Gates without their parameters, and how many of each.

    >>> from types import SimpleNamespace as Gate
    >>> _families([Gate(id="sbc.bias[a]"), Gate(id="sbc.bias[b]"), Gate(id="joint.hpd")])
    'sbc.bias (2), joint.hpd'
    """
    found = Counter(gate.id.partition("[")[0] for gate in gates)
    return ", ".join(name if number == 1 else f"{name} ({number})" for name, number in found.items())


def run(chosen: argparse.Namespace) -> None:
    """Two audits of every flow and one of both, whose verdict is put beside the flow's weights.

    Of a flow in parts, that is the verdict of the `worst`. What was found of other flows stays in the table.

    Raises
    ------
    InputError
        If a flow was audited already, on trials of another commit.
    """
    commit, file = committed(ROOT, chosen.commit), chosen.out / "shipped.nc"
    for name in _named(chosen.names):
        kept = _rows(read(file)) if file.exists() else []
        origin = {"weights": _made(name)["sha256"][:12], "commit": commit}
        for one in kept:
            if one["weights"] == origin["weights"] and one["commit"] != commit:
                raise InputError(
                    f"{file}: {name} was audited on trials of {one['commit'][:7]}, and final trials are "
                    "looked at once: name that with --commit, or another --out"
                )
        rows, verdicts = [], []
        for part in PROMISES[name].parts:
            seeds = [seed_of(f"shipped {which} {part}".rstrip(), commit) for which in AUDITS[:2]]
            found = [audited(name, part, seed, chosen.work) for seed in seeds]
            said = f"python -m {NAME} {name} --commit {commit}"
            both = together(found, seeds, command=said, history=history(name))
            verdicts.append(both)
            rows += [
                row(name, part, which, seed, audit) | origin
                for which, seed, audit in zip(AUDITS, (*seeds, seeds[0]), (*found, both), strict=True)
            ]
        made = _as_table([one for one in kept if one["flow"] != name] + rows)
        made_by = record(f"python -m {NAME} NAME --commit COMMIT", int(rows[0]["seed"]))
        write({"": made.assign_attrs(made_by)}, file)
        kept_one = worst(verdicts)
        text = verdict_json(kept_one.verdict, kept_one.findings)
        write_atomically(chosen.models / name / "verdict.json", text.encode())
        sys.stdout.write(shown(_as_table(rows)) + "\n")


def worst(audits: Sequence[Audit]) -> Audit:
    """The audit with the worst outcome; of several, the one whose worst gate uses most of its tolerance."""
    outcome = combine(one.outcome for one in audits)
    return max(
        (one for one in audits if one.outcome is outcome), key=lambda one: max(_used(one), default=0.0)
    )


def _used(audit: Audit) -> Iterable[float]:
    """Shares of their tolerances that gates use, as estimated; of an efficiency, what is asked of what is."""
    for gate in audit.gates.values():
        if gate.tolerance and gate.statistic:
            share = abs(gate.statistic) / gate.tolerance
            yield 1 / share if gate.id == "importance.ess" else share


def develop(chosen: argparse.Namespace) -> None:
    """One audit of every flow on the seed by which flows are chosen."""
    for name in _named(chosen.names):
        for part in PROMISES[name].parts:
            audit = audited(name, part, DEVELOPMENT, chosen.work)
            one = row(name, part, "development", DEVELOPMENT, audit)
            sys.stdout.write(shown(_as_table([one | {"commit": ""}])) + "\n")


def _as_table(rows: Sequence[Mapping[str, Any]]) -> xr.Dataset:
    order = sorted(rows, key=lambda one: list(PROMISES).index(one["flow"]))
    return xr.Dataset({key: ("row", np.array([one[key] for one in order])) for key in order[0]})


def _named(names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in PROMISES:
            raise InputError(f"no flow {name!r} ships; there are {', '.join(PROMISES)}")
    return list(names or PROMISES)


def shown(made: xr.Dataset) -> str:
    """A line for every audit."""
    header = [
        *("flow", "audit", "policy", "trials", "verdict"),
        *("FAIL", "left open", "open, not required", "efficiency"),
    ]
    lines = [
        [
            _called(one), one["audit"], one["policy"], f"{one['trials']:,}", one["outcome"],
            one["failed"] or "-", one["open"] or "-", one["open_beside"] or "-", EFFICIENCY.format_map(one),
        ]
        for one in _rows(made)
    ]  # fmt: skip
    return table(header, lines)


def flows(made: xr.Dataset, models: Path) -> str:
    """A line for every flow that ships: how it was made, and what both audits together say."""
    header = [
        *("`shipped:`", "network", "simulations", "steps", "redraws", "loss", "verdict", "efficiency"),
        *("joint likelihood", "trainings"),
    ]
    lines = []
    for one in _rows(made):
        if one["audit"] == AUDITS[2]:
            model = _made(one["flow"])
            kind, trained = model["network"]["kind"], model["training"]
            lines.append([
                _called(one), kind, f"{trained['simulations']:,}", f"{trained['steps']:,}",
                str(trained.get("redraws") or "-"), f"{model['validation_loss']:.3f}",
                "{outcome}, {policy}, {trials:,} trials".format_map(one), EFFICIENCY.format_map(one),
                _likelihood(one, models), _trainings(one["flow"]),
            ])  # fmt: skip
    return table(header, lines)


def _likelihood(one: Mapping[str, Any], models: Path) -> str:
    """The gate `joint.likelihood` of the verdict beside the weights, bold where it is beyond as estimated.

    Of a flow in parts that verdict is of one of them, and the others have none.
    """
    said = json.loads((models / one["flow"] / "verdict.json").read_text(encoding="utf-8"))
    own = PROMISES[one["flow"]].parts[one["part"]]
    if said["provenance"]["simulator"].get("exposure") != own.get("exposure"):
        return ""
    gate = next(gate for gate in said["gates"] if gate["id"] == "joint.likelihood")
    shown = "{statistic:.3f} ({interval[0]:.3f} to {interval[1]:.3f}) of {tolerance:g}".format_map(gate)
    return f"**{shown}**" if abs(gate["statistic"]) > gate["tolerance"] else shown


def _trainings(name: str) -> str:
    """How many there were, bold if more than had been promised; and how often final seeds were opened."""
    trained, promised, finals = history(name).values()
    number = str(trained) if trained <= promised else f"**{trained}, {promised} were promised**"
    opened = {1: "", 2: "; final seeds opened twice"}.get(finals, f"; final seeds opened {finals} times")
    return number + opened


def logged(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line for every training and audit of shipped.toml, then for the audits of the table."""
    known = _known()
    lines = [
        (one["date"].isoformat(), one["flow"], one["weights"], one["kind"], one["commit"], one["says"])
        for one in known["entry"]
    ]
    lines += [
        (known["opened"][one["flow"]].isoformat(), one["flow"], one["weights"], "final", one["commit"][:7],
         "{policy}, {trials:,} trials, {audit} of two final seeds: {outcome}".format_map(one)
         + (f", {one['part']}" if one["part"] else "")
         + (f" by {one['failed']}" if one["failed"] else ""))
        for one in rows
    ]  # fmt: skip
    flows = [*PROMISES, *(line[1] for line in lines)]  # those that do not ship yet come last
    order = sorted(lines, key=lambda line: (flows.index(line[1]), line[0]))
    return "\n".join(
        f"{date:10s}  {flow:20s} {weights}  {kind:8s}  {commit}  {says}"
        for date, flow, weights, kind, commit, says in order
    )


def _called(one: Mapping[str, Any]) -> str:
    return f"`{one['flow']}`" + (f", {one['part']}" if one["part"] else "")


def _rows(made: xr.Dataset) -> list[dict[str, Any]]:
    # Of before there were parts.
    whole = {"part": ""}
    return [
        whole | {str(key): made[key].values[at].item() for key in made} for at in range(made.sizes["row"])
    ]


def _page(page: Path, file: Path, models: Path) -> None:
    made = read(file)
    fill(page, {"shipped flows": flows(made, models), "shipped audits": shown(made)})


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = parser(NAME, __doc__)
    options.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PROMISES))
    options.add_argument("--commit", default="HEAD", help="of the flows that are audited: draws the seeds")
    options.add_argument("--models", type=Path, default=MODELS, help="folder of flows, for their verdicts")
    options.add_argument("--development", action="store_true", help="one audit, on the seed for choosing")
    options.add_argument("--log", action="store_true", help="print every training and audit; runs nothing")
    options.add_argument("--page", action="store_true", help="only make the page of what is stored")
    chosen = options.parse_args(arguments)
    chosen.work = chosen.work or chosen.out / "checkpoints"
    file = chosen.out / "shipped.nc"
    if chosen.log:
        sys.stdout.write(logged(_rows(read(file)) if file.exists() else []) + "\n")
        return 0
    if chosen.page:
        return carried_out(partial(_page, chosen.docs / "training.md", file, chosen.models))
    if chosen.development:
        return carried_out(partial(develop, chosen))
    return carried_out(partial(run, chosen))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
