"""The audit: where a simulator, an estimator, the validators and a policy meet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import xarray as xr

from gaugeblock.auditing.baseline import compared, kept_baseline, read_baseline
from gaugeblock.auditing.collect import Progress, collect, discard, fingerprint
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.identity import identity, versions
from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.auditing.observation import read_observation, trials_around
from gaugeblock.auditing.phases import end_phase, ended
from gaugeblock.auditing.provenance import FORMAT, digests, earlier_provenance, named, title
from gaugeblock.auditing.result import Audit, made_folder, write_arrays
from gaugeblock.auditing.samples import Plan, untrusted
from gaugeblock.auditing.trials_from import read_any_trials
from gaugeblock.auditing.watch import Watch, watched
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.estimators.protocol import Confined, Estimator, Listed
from gaugeblock.reports.machine import plain
from gaugeblock.simulators import Simulator, build_simulator
from gaugeblock.validate import Policy, judge, run_validators
from gaugeblock.validate.findings_file import read_findings
from gaugeblock.validate.trials import POSTERIOR, add_group, read_trials
from gaugeblock.validate.validators import default_validators

CHUNKS = ".chunks"


def audit(
    config: AuditConfig,
    out: Path,
    *,
    policy: Policy | None = None,
    baseline: Path | None = None,
    command: str = "",
    progress: Progress | None = None,
) -> Audit:
    """Simulate, estimate, validate and judge as `config` says; write all files of the contract into `out`.

    An interrupted audit, started again, goes on where it stopped and ends in the same bits.

    Raises
    ------
    InputError
        If anything in the configuration cannot be used, or simulator and estimator do not fit.
    """
    simulator = build_simulator(config.simulator.name, **config.simulator.options)
    estimator = _estimator(config, simulator)
    plan = config.trials.plan()
    with ended(estimator):
        if untrusted(estimator) and "seed" not in config.trials.model_fields_set:
            # A stranger that can foresee the seed could draw the truths again.
            key = fingerprint(simulator, estimator, replace(plan, seed=0))
            plan = replace(plan, seed=kept_seed(made_folder(out) / CHUNKS, key))
        return audit_objects(
            simulator,
            estimator,
            plan,
            out,
            policy=policy or config.read_policy(),
            select=config.validators,
            anytime=config.trials.anytime,
            observation=None if config.trials.observation is None else Path(config.trials.observation),
            names=(named(config.simulator), named(config.estimator)),
            baseline=baseline,
            command=command,
            progress=progress,
        )


def audit_objects(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    out: Path,
    *,
    policy: Policy,
    select: Iterable[str] | None = None,
    anytime: bool = False,
    observation: Path | None = None,
    names: tuple[Mapping[str, Any], Mapping[str, Any]] = ({}, {}),
    baseline: Path | None = None,
    command: str = "",
    progress: Progress | None = None,
) -> Audit:
    """As `audit`, of a simulator and an estimator in hand; `names` say how each was asked for.

    With `anytime` it stops as soon as the estimator is certainly broken or certainly within tolerance; then
    the gates of that mode judge, and everything else that needs a number of trials fixed beforehand is
    reported only. `observation` is a file with data in hand, around which calibration is looked at too.

    Raises
    ------
    InputError
        If simulator and estimator do not fit, or one of them fails.
    """
    made = made_folder(out)
    earlier = None if baseline is None else read_baseline(baseline)
    watch = Watch(policy, plan.seed) if anytime else None
    observed = None if observation is None else read_observation(observation)
    trials = collect(simulator, estimator, plan, made / CHUNKS, watch=watch, progress=progress)
    if observed is not None:
        if progress is not None:
            progress("around the observation", 0, 1)
        around = trials_around(simulator, estimator, observed, seed=plan.seed, block=plan.block)
        add_group(trials, POSTERIOR, around)
        if progress is not None:
            progress("around the observation", 1, 1)
    stopped = {"anytime": True, "used": trials.sizes["trial"]} if anytime else {}
    provenance = {
        "command": command,
        "seed": plan.seed,
        "simulator": {**names[0], **identity(simulator)},
        "estimator": {**names[1], **identity(estimator)},
        "trials": {**vars(plan), **stopped},
    }
    resources: dict[str, Any] = {}
    if isinstance(estimator, Confined):
        confinement = dict(estimator.confinement())
        # What was used differs from run to run, and so stays out of everything that must not.
        resources = dict(confinement.pop("used", {}))
        provenance["confinement"] = confinement
    if isinstance(estimator, Listed):
        provenance["listing"] = estimator.listing()
    end_phase(estimator)
    if observation is not None:
        provenance["observation"] = {"file": str(observation), "file_sha256": file_digest(observation)}
    result = _judged(
        trials,
        policy,
        seed=plan.seed,
        select=watched(select) if anytime else select,
        provenance=provenance,
        resources=resources,
        out=made,
        earlier=earlier,
        progress=progress,
    )
    discard(made / CHUNKS)
    return result


def audit_trials(
    file: Path,
    out: Path,
    *,
    policy: Policy,
    seed: int = 0,
    select: Iterable[str] | None = None,
    baseline: Path | None = None,
    command: str = "",
    progress: Progress | None = None,
) -> Audit:
    """Judge draws from disk: run what the file allows and list what it does not.

    The file holds Trials, or many fits in ArviZ's groups.

    Raises
    ------
    InputError
        If the file cannot be read, breaks the schema of Trials, or its groups cannot be mapped.
    """
    earlier = None if baseline is None else read_baseline(baseline)
    trials = read_any_trials(file)
    provenance = {
        "command": command,
        "seed": seed,
        "trials": {"file": str(file), "file_sha256": file_digest(file)},
    }
    return _judged(
        trials,
        policy,
        seed=seed,
        select=select,
        provenance=provenance,
        out=made_folder(out),
        earlier=earlier,
        progress=progress,
    )


def judge_again(
    folder: Path, *, policy: Policy, out: Path | None = None, seed: int | None = None, command: str = ""
) -> Audit:
    """Judge the findings of an earlier audit under another policy; nothing is sampled.

    `seed` is of the bootstrap behind the simultaneous intervals; without it, the earlier audit's. What that
    one was compared with, this one is compared with too.

    Raises
    ------
    InputError
        If the folder does not hold an audit.
    """
    trials = read_trials(folder / "trials.nc")
    findings, not_checked = read_findings(folder / "findings.nc")
    earlier, baseline = earlier_provenance(folder), kept_baseline(folder)
    chosen = int(earlier.get("seed") or 0) if seed is None else seed
    verdict = judge(findings, not_checked, policy, seed=chosen)
    rules = policy.model_dump(mode="json")
    record = {
        **earlier,
        "command": command,
        "judge_seed": chosen,
        "policy": rules,
        "sha256": {**dict(earlier.get("sha256") or {}), "policy": digest(rules)},
    }
    verdict = explained(replace(verdict, provenance=record), trials)
    if baseline is not None:
        verdict = replace(verdict, baseline=compared(baseline, verdict, findings))
    result = Audit(trials, findings, not_checked, verdict)
    result.write_reports(made_folder(out or folder))
    return result


def _judged(
    trials: xr.DataTree,
    policy: Policy,
    *,
    seed: int,
    select: Iterable[str] | None,
    provenance: Mapping[str, Any],
    out: Path | None,
    resources: Mapping[str, Any] = MappingProxyType({}),
    earlier: Mapping[str, Any] | None,
    progress: Progress | None,
) -> Audit:
    if progress is not None:
        progress("validators", 0, 1)
    findings, not_checked = run_validators(trials, seed=seed, select=select)
    if progress is not None:
        progress("validators", 1, 1)
    verdict = judge(findings, not_checked, policy, seed=seed)
    record = plain(
        {
            **provenance,
            "title": title(provenance),
            "format": FORMAT,
            "policy": policy.model_dump(mode="json"),
            "validators": default_validators() if select is None else list(select),
            "versions": versions(),
        }
    )
    record["sha256"] = digests(record)
    if out is not None:
        record["sha256"]["trials"] = write_arrays(trials, findings, not_checked, out)
    verdict = explained(replace(verdict, provenance=record), trials)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    result = Audit(trials, findings, not_checked, verdict, resources)
    if out is not None:
        result.write_reports(out)
    return result


def _estimator(config: AuditConfig, simulator: Simulator) -> Any:
    from gaugeblock.estimators.registry import build_estimator

    return build_estimator(config.estimator.name, simulator, **config.estimator.options)
