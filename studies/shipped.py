"""The flows that ship, audited on trials that nobody had seen when they were final.

    python -m studies shipped [NAME ...]            # two audits each, and one of both together
    python -m studies shipped --development NAME    # one audit on the development seed; nothing is kept
    python -m studies shipped --page                # docs/training.md of results/shipped.nc; runs nothing

The policy and the number of trials of each flow stand below, the number of trainings that it may have in
`TRAININGS`; both seeds are drawn from the digest of the commit that is measured, which holds the flows. A
flow is chosen on the development seed, and these are opened once, for the flow that was chosen.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock as gb
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.shipped import reference_model_path
from studies.kit.command import carried_out, given, parser
from studies.kit.commit import ROOT, committed, seed_of
from studies.kit.page import fill, table
from studies.kit.results import measured_commit, read, record, write

NAME = "studies shipped"
DEVELOPMENT = 1
"""Seed of the audits by which flows are chosen."""

TRAININGS = 3
"""Of a flow, at most, the first among them."""

AUDITS = ("first", "second", "both")


@dataclass(frozen=True)
class Promise:
    """The policy that a flow ships under, the trials of each of its two audits, draws for each efficiency."""

    policy: str
    trials: int
    importance_draws: int


# With 500 draws the strict policy leaves open a flow whose weights have a tail.
STRICT, DEFAULT = Promise("strict", 10_000, 4_000), Promise("default", 4_000, 500)
PROMISES: Mapping[str, Promise] = {
    "epic-pn-faint": STRICT,
    "epic-pn-medium": STRICT,
    "epic-pn-bright": STRICT,
    "nicer-faint": DEFAULT,
    "nicer-medium": DEFAULT,
    "nicer-bright": DEFAULT,
    "epic-pn-medium-gain": DEFAULT,
    "epic-pn-bright-gain": DEFAULT,
}


def audited(name: str, seed: int, trials: int, out: Path) -> Any:
    """One audit, with likelihoods of all trials; an interrupted one goes on in its folder."""
    path = reference_model_path(name)
    simulator = json.loads((path / "model.json").read_text(encoding="utf-8"))["simulator_table"]
    promise = PROMISES[name]
    numbers = {"number": trials, "joint_number": trials, "importance_draws": promise.importance_draws}
    return gb.audit(
        f"shipped:{name}", simulator, trials=numbers, seed=seed, policy=promise.policy, out=out, progress=True
    )


def together(audits: Sequence[Any], policy: str, seed: int) -> Any:
    """One audit of the trials of several."""
    trees = [audit.trials for audit in audits]
    joined = {
        node.path: xr.concat([tree[node.path].to_dataset(inherit=False) for tree in trees], "trial")
        for node in trees[0].subtree
        if "trial" in node.to_dataset(inherit=False).dims
    }
    return gb.audit_draws(xr.DataTree.from_dict(joined), policy=policy, seed=seed)


def row(name: str, which: str, seed: int, audit: Any) -> dict[str, Any]:
    """What is kept of an audit: its outcome, what failed, and what was left open, required or not."""
    gates = list(audit.gates.values())
    left = [gate for gate in gates if gate.outcome == "INCONCLUSIVE"]
    efficiency = audit.gates["importance.ess"]
    return {
        "flow": name, "audit": which, "seed": str(seed), "policy": PROMISES[name].policy,
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


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every flow: two audits and one of both; the table is written after each flow."""
    commit = committed(ROOT, chosen.commit)
    rows: list[dict[str, Any]] = []
    for name in _named(chosen.names):
        promise = PROMISES[name]
        trials = chosen.trials or promise.trials
        seeds = [seed_of(f"shipped {which}", commit) for which in AUDITS[:2]]
        if chosen.development:
            seeds = [DEVELOPMENT]
        found = [
            audited(name, seed, trials, (chosen.work or chosen.out / "audits") / f"{name}-{seed}")
            for seed in seeds
        ]
        rows += [row(name, which, seed, one) for which, seed, one in zip(AUDITS, seeds, found, strict=False)]
        if not chosen.development:
            rows.append(row(name, AUDITS[2], seeds[0], together(found, promise.policy, seeds[0])))
        made = xr.Dataset({key: ("row", np.array([one[key] for one in rows])) for key in rows[0]})
        made = made.assign_attrs(record(command, seeds[0], commit=commit))
        sys.stdout.write(shown(made) + "\n")
        if not chosen.development:
            write({"": made}, chosen.out / "shipped.nc")


def _named(names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in PROMISES:
            raise InputError(f"no flow {name!r} ships; there are {', '.join(PROMISES)}")
    return list(names or PROMISES)


def shown(made: xr.Dataset) -> str:
    """A line for every audit."""
    header = [
        "flow",
        "audit",
        "policy",
        "trials",
        "verdict",
        "FAIL",
        "left open",
        "open, not required",
        "efficiency",
    ]
    lines = [
        [
            f"`{one['flow']}`", one["audit"], one["policy"], f"{one['trials']:,}", one["outcome"],
            one["failed"] or "-", one["open"] or "-", one["open_beside"] or "-",
            "{efficiency:.1%} ({efficiency_lo:.1%} to {efficiency_hi:.1%})".format_map(one),
        ]
        for one in _rows(made)
    ]  # fmt: skip
    return f"{table(header, lines)}\n\n{measured_commit(made)}"


def _rows(made: xr.Dataset) -> list[dict[str, Any]]:
    return [{str(key): made[key].values[at].item() for key in made} for at in range(made.sizes["row"])]


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = parser(NAME, __doc__)
    options.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PROMISES))
    options.add_argument("--commit", default="HEAD", help="of the flows that are audited: draws the seeds")
    options.add_argument("--trials", type=int, help="of each audit, instead of what was promised")
    options.add_argument("--development", action="store_true", help="one audit, on the seed for choosing")
    options.add_argument("--page", action="store_true", help="only make the page of what is stored")
    chosen = options.parse_args(arguments)
    if chosen.page:
        said = {"shipped": shown(read(chosen.out / "shipped.nc"))}
        return carried_out(partial(fill, chosen.docs / "training.md", said))
    return carried_out(partial(run, chosen, given(NAME, arguments)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
