"""The registry of validators, and one call that runs them over Trials."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate.anytime.anytime import WATCHED, anytime
from gaugeblock.validate.controls.controls import controls
from gaugeblock.validate.designs.identifiability import identifiability, posterior_sd
from gaugeblock.validate.evidence.evidence import evidence
from gaugeblock.validate.evidence.models import models
from gaugeblock.validate.finding import Finding, NotChecked, SequenceFinding
from gaugeblock.validate.joint.importance import importance
from gaugeblock.validate.joint.joint import STATISTICS, joint
from gaugeblock.validate.joint.normalisation import density, ratios
from gaugeblock.validate.layout.layout import layout
from gaugeblock.validate.learned.c2st import c2st
from gaugeblock.validate.learned.informed.informed import informed
from gaugeblock.validate.learned.informed.pools import pools
from gaugeblock.validate.learned.lc2st import lc2st
from gaugeblock.validate.learned.learned import candidates
from gaugeblock.validate.local.declared import location
from gaugeblock.validate.local.local import local
from gaugeblock.validate.local.posterior_sbc import posterior_sbc
from gaugeblock.validate.marginal.conformal import box, conformal
from gaugeblock.validate.marginal.coverage import coverage
from gaugeblock.validate.marginal.finite import finite
from gaugeblock.validate.marginal.half_widths import half_widths
from gaugeblock.validate.marginal.sbc import sbc
from gaugeblock.validate.marginal.tails import outliers, tails
from gaugeblock.validate.policy import Levels
from gaugeblock.validate.prepared import Prepared, Statistic, effective_draws, pit


@dataclass(frozen=True)
class Validator:
    """From prepared trials to findings, with the per-trial statistics that they rest on.

    `findings` returns a NotChecked for each finding that the trials do not allow. `statistics` of all chosen
    validators are computed in one pass over the draws; one that is not named here costs a pass of its own.
    `by_default` is False for what only runs when it is asked for. What learns is shown the first `most`
    trials: from more it learns no more, and it holds all that it is shown.
    """

    findings: Callable[[Prepared], list[Finding | NotChecked]]
    statistics: tuple[Statistic, ...] = ()
    by_default: bool = True
    most: int | None = None


# Trials that are shown to what learns.
LEARNED = 100_000

# Name (the part of every finding's id before the first dot) -> validator.
VALIDATORS: Mapping[str, Validator] = {
    "draws": Validator(finite),
    "sbc": Validator(sbc, (pit, half_widths, effective_draws)),
    "coverage": Validator(coverage, (pit,)),
    "tails": Validator(tails, (pit, effective_draws, outliers)),
    "joint": Validator(joint, STATISTICS),
    "density": Validator(density, (ratios,)),
    "local": Validator(local, (pit, half_widths, location), most=LEARNED),
    "c2st": Validator(c2st, (candidates,), most=LEARNED),
    "informed": Validator(informed, (pools,), most=LEARNED),
    "lc2st": Validator(lc2st, (candidates,), most=LEARNED),
    "posterior_sbc": Validator(posterior_sbc),
    "layout": Validator(layout),
    "conformal": Validator(conformal, (effective_draws, half_widths, box)),
    "importance": Validator(importance),
    "evidence": Validator(evidence),
    "identifiability": Validator(identifiability, (posterior_sd,)),
    "controls": Validator(controls, (location,), most=LEARNED),
    "anytime": Validator(anytime, WATCHED, by_default=False),
    "models": Validator(models, by_default=False),
}


def run_validators(
    tree: xr.DataTree | xr.Dataset,
    *,
    seed: int,
    select: Iterable[str] | None = None,
    levels: Levels | None = None,
    part: bool = False,
) -> tuple[tuple[Finding, ...], tuple[NotChecked, ...]]:
    """Findings of every default validator (or of `select`), and exactly what could not be checked and why.

    `levels` says which central intervals are looked at; without, those of the default policy. Of a `part`,
    some trials of more, what rests on those before is left out. The same trials and seed give the same bits,
    in whatever order or chunks the trials were made.

    Raises
    ------
    InputError
        If `select` names a validator that does not exist.
    """
    chosen = default_validators() if select is None else list(select)
    check_validators(chosen)
    whole = xr.DataTree(tree) if isinstance(tree, xr.Dataset) else tree
    prepared = Prepared(whole, seed, levels or Levels(), part)
    validators = [VALIDATORS[name] for name in VALIDATORS if name in chosen]
    shown = {most: prepared.first(most) for most in {validator.most for validator in validators}}
    for trials in {id(each): each for each in shown.values()}.values():
        here = [validator for validator in validators if shown[validator.most] is trials]
        trials.compute([statistic for validator in here for statistic in validator.statistics])
    said: list[Finding | NotChecked] = []
    for place, validator in enumerate(validators, 1):
        trials = shown[validator.most]
        found = validator.findings(trials)
        later = [one for other in validators[place:] for one in other.statistics]
        trials.forget(set(validator.statistics).difference(later))
        if trials is not prepared:
            sizes = trials.main.sizes["trial"], prepared.main.sizes["trial"]
            found = [_of_the_first(item, *sizes) for item in found]
        why = trials.too_dependent if validator.statistics else ""
        said += only_reported(found, why) if why else found
    return (
        tuple(item for item in said if isinstance(item, Finding)),
        tuple(item for item in said if isinstance(item, NotChecked)),
    )


def _of_the_first(item: Finding | NotChecked, shown: int, number: int) -> Finding | NotChecked:
    """What was found among some trials has them for its population: it shares none with what is of all."""
    if isinstance(item, NotChecked):
        return item
    said = f"the first {shown:,} of {number:,} trials: what learns is shown no more"
    return replace(item, population=f"{item.population}, the first {shown:,}", caveats=(*item.caveats, said))


def only_reported(found: Iterable[Finding | NotChecked], why: str) -> list[Finding | NotChecked]:
    """The same findings with no say in a verdict, and for each gate that they would have been, why not."""
    said: dict[str, Finding | NotChecked] = {}
    for item in found:
        if isinstance(item, NotChecked) or not item.quantity:
            said[item.id] = item
            continue
        gate = item.id.partition("[")[0]
        said[f"{gate}: why not"] = NotChecked(gate, why)
        if not isinstance(item, SequenceFinding):
            said[item.id] = replace(item, quantity="")
    return list(said.values())


def default_validators() -> list[str]:
    """Names of the validators that run unless others are chosen."""
    return [name for name, validator in VALIDATORS.items() if validator.by_default]


def check_validators(names: Iterable[str]) -> None:
    """Raise InputError for a name that no validator has."""
    unknown = [name for name in names if name not in VALIDATORS]
    if unknown:
        raise InputError(f"unknown validator {', '.join(unknown)}; there are {', '.join(VALIDATORS)}")
