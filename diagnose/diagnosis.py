"""A diagnosis: what is wrong with an estimator, in a sentence, and what mending it in the draws changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator
from gaugeblock.core.values import Value
from gaugeblock.diagnosis.cases import DRAWS, TRIALS, Cases
from gaugeblock.diagnosis.causes import CAUSES, Cause, causes
from gaugeblock.diagnosis.library.calls import Called, Sample
from gaugeblock.diagnosis.library.symptoms import SYMPTOMS, Fit
from gaugeblock.diagnosis.model_odds import model_odds, of_models
from gaugeblock.diagnosis.repair import Repair, plain_repair, weighted
from gaugeblock.diagnosis.workflow import Found, locate_and_name
from gaugeblock.validate.learned.informed.data import data_of
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.verdict import Gate, Outcome, Verdict

# Fewer trials than these are not parted in three.
LEAST_TRIALS = 150
# Trials whose order of draws is looked at, and draws of each.
ORDERED, LONGEST = 300, 2000
# The share of a disagreement from which on the causes of a repair that leaves something are told.
NEAREST = 0.5
# Inputs that foretell the truths best, of more than so many.
INPUTS = 48
# What only the density of the draws is judged by.
OF_THE_DENSITY = ("density", "importance")


@dataclass(frozen=True)
class Fault:
    """A fault of a user's own: what fits its repairs, and what may cause it.

    `fit` takes `Cases` of the fitting part and the `Reference` of all, and gives repairs that may be tried:
    none where there is no sign of the fault.
    """

    fit: Fit
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(Value):
    """What is wrong with an estimator's draws.

    `named` is the first symptom's id, "other" where something is wrong that the library lacks, None where
    nothing is seen; `named_all` the symptoms in the order in which they are mended; `indistinguishable` the
    others that these trials do not tell from it; `runner_up` the one whose repair takes away most after
    those. `causes` are compatible with it, each with its cure.
    `parameters` are sizes with 90% intervals, from trials that chose nothing. `gap` is by how many nats a
    truth is told from draws, per trial, `before` and `after` the repair; `repair` is that as plain data, in
    the order in which it is applied, empty where draws cannot be mended, and `seed` that of the trials.
    `trials_to_tell` is how many trials would tell each of those that are `indistinguishable` from the named
    one, if that is right; None where nobody will make so many. `called` says whether the estimator was called
    again, `faults` which faults of the user's were looked for.
    """

    named: str | None
    text: str
    named_all: tuple[str, ...] = ()
    indistinguishable: tuple[str, ...] = ()
    causes: tuple[Cause, ...] = ()
    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    gap: tuple[float | None, float | None] = (None, None)
    shows_in: Mapping[str, float] = field(default_factory=dict)
    called: bool = False
    repair: tuple[Mapping[str, Any], ...] = ()
    seed: int | None = None
    faults: tuple[str, ...] = ()
    runner_up: str | None = None
    trials_to_tell: Mapping[str, int | None] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Plain data with the contract's keys."""
        return {
            "named": self.named,
            "named_all": list(self.named_all),
            "indistinguishable": list(self.indistinguishable),
            "trials_to_tell": dict(self.trials_to_tell),
            "runner_up": self.runner_up,
            "causes": [{"cause": each.cause, "cure": each.cure} for each in self.causes],
            "parameters": {
                name: {"value": value, "low": low, "high": high}
                for name, (value, low, high) in self.parameters.items()
            },
            "gap": {"before": self.gap[0], "after": self.gap[1]},
            "shows_in": dict(self.shows_in),
            "called": self.called,
            "repair": [dict(each) for each in self.repair],
            "seed": self.seed,
            "faults": list(self.faults),
            "text": self.text,
        }

    def __repr__(self) -> str:
        return f"<Diagnosis {self.named or 'nothing'}: {self.text}>"


def diagnose(
    tree: xr.DataTree,
    verdict: Verdict,
    *,
    seed: int,
    sample: Sample | None = None,
    faults: Mapping[str, Fault] | None = None,
) -> Diagnosis:
    """Name what is wrong with the draws of some trials, of all that the library knows.

    `sample` is the estimator's, ``(x, n, rng)`` to draws ``(batch, n, parameter)``, where it can be called
    again: faults in what it is called with are looked for then too. `faults` are a user's own, by id, which
    stand beside the library's.

    The same trials, verdict and seed give the same diagnosis.

    Raises
    ------
    InputError
        If a fault of the user's bears an id of the library's.
    """
    own = dict(faults or {})
    taken = sorted(set(own) & {*SYMPTOMS, *CAUSES})
    if taken:
        raise InputError(f"faults: {taken[0]} is the library's own: give yours another id")
    found = _diagnosed(tree, verdict, seed=seed, sample=sample, own=own)
    return replace(found, seed=seed, faults=tuple(own))


@dataclass(frozen=True)
class Asked:
    """What of a verdict a diagnosis depends on, beside trials and seed.

    `failed`: whether a gate of the draws has FAILed; `density`: the first gate that has, where only gates of
    their density have; `blocked`: whether the verdict is FAIL.
    """

    failed: bool
    density: Gate | None
    blocked: bool

    @classmethod
    def of(cls, verdict: Verdict) -> Asked:
        """Of a verdict."""
        gates = [gate for gate in verdict.gates if gate.outcome is Outcome.FAIL]
        draws = [gate for gate in gates if gate.id.partition(".")[0] not in OF_THE_DENSITY]
        density = gates[0] if gates and not draws else None
        return cls(bool(draws), density, verdict.outcome is Outcome.FAIL)


def _diagnosed(
    tree: xr.DataTree, verdict: Verdict, *, seed: int, sample: Sample | None, own: Mapping[str, Fault]
) -> Diagnosis:
    prepared = Prepared(tree, seed)
    if len(prepared.trial) < LEAST_TRIALS:
        known = f"{len(prepared.trial)} trials with finite draws"
        return Diagnosis(named=None, text=f"{known} do not say what is wrong: {LEAST_TRIALS} are needed.")
    if of_models(prepared):
        return Diagnosis(**model_odds(prepared))
    asked = Asked.of(verdict)
    cases = cases_of(prepared)
    again = None if sample is None else _again(prepared, cases, sample, seed)
    found = locate_and_name(
        cases, seed=seed, failed=asked.failed, again=again,
        own={name: fault.fit for name, fault in own.items()},
        as_drawn=None if prepared.order.stride == 1 else _as_drawn(prepared, cases),
    )  # fmt: skip
    if found.named is None and not found.structural and asked.density is not None:
        return _density(asked.density)
    return worded(
        found, own, called=again is not None, alone=not asked.blocked, spread=spread_of_data(prepared)
    )


def cases_of(prepared: Prepared) -> Cases:
    """The first trials of an audit as cases: circular parameters cut open, weighted draws resampled."""
    blocks, rows, number = [], 0, min(len(prepared.trial), TRIALS)
    for block in prepared.blocks():
        step = max(1, block.draws.shape[1] // DRAWS)
        part = Cases(prepared.parameters, block.trial, block.theta_true, block.draws)
        if block.weight is not None:
            with np.errstate(divide="ignore"):
                part = weighted(part, np.log(block.weight))
        blocks.append(part.drawn(part.draws[:, ::step][:, :DRAWS]))
        rows += len(block)
        if rows >= number:
            break
    theta = np.concatenate([part.theta for part in blocks])[:number]
    draws = np.concatenate([part.draws for part in blocks])[:number]
    trial = np.concatenate([part.trial for part in blocks])[:number]
    cases = Cases(prepared.parameters, trial, theta, draws)
    data = data_of(prepared, np.arange(number))
    if not data.values.shape[1]:
        return cases
    return Cases(
        prepared.parameters, trial, theta, draws, *foretelling_inputs(data.values, data.names, theta)
    )


def _as_drawn(prepared: Prepared, cases: Cases) -> Cases:
    """The first of the cases with their draws as they came, where audits use every so many-th alone."""
    rows = np.flatnonzero(prepared.unaffected)[:ORDERED]
    first = prepared.main["draws"].isel(trial=slice(0, int(rows[-1]) + 1)).values[rows, :LONGEST]
    return cases.taken(slice(ORDERED)).drawn(first.astype(float))


def foretelling_inputs(values: Array, names: tuple[str, ...], theta: Array) -> tuple[Array, tuple[str, ...]]:
    """The inputs that have most to do with the truths, or with their squares, where there are very many."""
    if values.shape[1] <= INPUTS:
        return values, names
    half = len(theta) // 3
    target = np.argsort(np.argsort(theta[:half], axis=0), axis=0) / half - 0.5
    target = np.concatenate([target, target**2 - 1 / 12], axis=1)
    known = values[:half] - values[:half].mean(axis=0)
    related = np.abs(known.T @ target / np.maximum(known.std(axis=0), 1e-300)[:, None]).max(axis=1)
    # The features at the end (total, components) stay.
    chosen = np.sort(np.argsort(related, kind="stable")[::-1][:INPUTS])
    return values[:, chosen], tuple(names[k] for k in chosen)


def _again(prepared: Prepared, cases: Cases, sample: Sample, seed: int) -> Called | None:
    if "x" not in prepared.main:
        return None
    rows = np.flatnonzero(prepared.unaffected)[: len(cases)]
    order = np.argsort(cases.trial)
    data = prepared.main["x"].isel(trial=slice(0, int(rows[-1]) + 1)).values[rows]
    return Called(sample, data[order], cases.trial[order], int(generator(seed, "diagnosis").integers(2**62)))


def _density(gate: Gate) -> Diagnosis:
    """Draws that nothing is seen of, with a density that a gate has failed."""
    known = causes("log_q")
    text = f"of the draws nothing is wrong that these trials show; their log density is: {gate.message}"
    return Diagnosis(
        named="log_q", named_all=("log_q",), causes=known, text=f"{text} {cures_said(known)}",
        parameters={gate.id: (gate.statistic, *gate.interval)},
    )  # fmt: skip


def spread_of_data(prepared: Prepared) -> tuple[float, float] | None:
    """The least and the largest standard deviation of the data's channels that vary; None without data."""
    if "x" not in prepared.main:
        return None
    few = np.asarray(prepared.main["x"].isel(trial=slice(0, LEAST_TRIALS)).values, dtype=float)
    sd = few.reshape(len(few), -1).std(axis=0)
    varies = sd[np.isfinite(sd) & (sd > 0)]
    return (float(varies.min()), float(varies.max())) if len(varies) else None


def worded(
    found: Found,
    own: Mapping[str, Fault],
    *,
    called: bool,
    alone: bool,
    spread: tuple[float, float] | None,
) -> Diagnosis:
    """What was found, in words and numbers."""
    gap = (found.before[0], None if found.after is None else found.after[0])
    mended: tuple[Repair, ...] = found.named.repairs if found.named else ()
    both = (*found.structural, *mended)
    if not both and not found.seen:
        nothing = "nothing is seen to be wrong" if alone else "what is wrong is too small to be named"
        size = f"{found.before[0]:.4f} +- {found.before[1]:.4f} nats a trial"
        text = f"{nothing}: truths are told from draws by {size}."
        return Diagnosis(named=None, text=text, gap=(gap[0], None), called=called)
    if not both:
        where = _strongest(found.kinds)
        text = (
            "something is wrong that the library has no name for: truths are told from draws by "
            f"{found.before[0]:.3g} nats a trial{where}, and no repair takes all of it away."
        )
        known = causes("unused" if _kind(found.kinds) == "data" else "other", spread=spread)
        told: tuple[str, ...] = ()
        best = min(found.tried[1:], key=lambda each: float(each.left.mean()), default=None)
        if best is not None and best.share > 0:
            text += f" {' and '.join(best.symptoms)} would take {best.share:.0%}."
            if best.share >= NEAREST:
                nearest, told = _causes_of(best.repairs[0], own, spread), best.symptoms[:1]
                known += tuple(each for each in nearest if each.cause not in {one.cause for one in known})
        return Diagnosis(
            named="other", text=f"{text} {cures_said(known)}".strip(), gap=gap, shows_in=found.kinds,
            called=called, causes=known, runner_up=next_best(found, told),
        )  # fmt: skip
    ids = tuple(repair.symptom for repair in both)
    others = tuple(dict.fromkeys(each.symptoms[0] for each in found.alike if each.symptoms[0] not in ids))
    known = _causes_of(both[0], own, spread)
    said = "; then ".join(repair.words for repair in both)
    text = f"{said}."
    # What stands for information that was not used is no repair.
    if gap[1] is not None and all(repair.recovers for repair in both):
        size = f"{max(gap[1], 0):.2g} instead of {found.before[0]:.2g} nats a trial"
        text += f" Mended, truths are told from draws by {size}."
    to_tell = {name: found.to_tell.get(name) for name in others}
    if others:
        text += f" These trials do not tell it from: {', '.join(map(_to_tell, others, to_tell.values()))}."
    return Diagnosis(
        named=ids[0], named_all=ids, indistinguishable=others, causes=known,
        text=f"{text} {cures_said(known)}", parameters=found.sizes, gap=gap, shows_in=found.kinds,
        called=called, repair=plain_repair(found.repairs), runner_up=next_best(found, (*ids, *others)),
        trials_to_tell=to_tell,
    )  # fmt: skip


def _to_tell(name: str, trials: int | None) -> str:
    return (
        f"{name} (some {trials:,} would)"
        if trials is not None
        else f"{name} (nor would a hundred times as many)"
    )


def _causes_of(
    repair: Repair, own: Mapping[str, Fault], spread: tuple[float, float] | None
) -> tuple[Cause, ...]:
    if repair.symptom in own:
        return own[repair.symptom].causes
    # Of what goes either way, its numbers are above 1 where draws are too wide.
    wide = bool(repair.numbers) and float(np.mean(list(repair.numbers.values()))) > 1
    return causes(repair.symptom, wide=wide, spread=spread)


def next_best(found: Found, named: tuple[str, ...]) -> str | None:
    """Of the symptoms that are not named the one whose repair alone takes most of the disagreement away."""
    others = [each for each in found.tried if len(each.repairs) == 1 and each.symptoms[0] not in named]
    best = max(others, key=lambda each: each.share, default=None)
    return best.symptoms[0] if best is not None and best.share > 0 else None


def cures_said(known: tuple[Cause, ...]) -> str:
    """What may cause it, and what mends that, in a sentence; empty where nobody knows."""
    if not known:
        return ""
    said = "; ".join(f"{each.cause}: {each.cure}" for each in known)
    return f"Possible cause{'s' * (len(known) > 1)}: {said}."


KINDS: Mapping[str, str] = {
    "shape": "parameters one by one",
    "tails": "tails",
    "prior": "the place in the prior",
    "support": "the ends of the prior",
    "pairs": "pairs of parameters",
    "joint": "all parameters together",
    "data": "what the data say beyond the draws",
    "regions": "some places and not in others",
}


def _strongest(kinds: Mapping[str, float]) -> str:
    strongest = _kind(kinds)
    return f", mostly in {KINDS[strongest]}" if strongest else ""


def _kind(kinds: Mapping[str, float]) -> str | None:
    """The kind of function in which most of a disagreement shows; None where it shows in none."""
    return max(kinds, key=lambda kind: kinds[kind]) if kinds and max(kinds.values()) > 0 else None
