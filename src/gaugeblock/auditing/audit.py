"""The audit: where a simulator, an estimator, the validators and a policy meet."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.auditing.baseline import compared, kept_baseline, read_baseline
from gaugeblock.auditing.collect import collect, collect_part, fingerprint
from gaugeblock.auditing.commitment import committed, content_of
from gaugeblock.auditing.commitment import opened as commitment_opened
from gaugeblock.auditing.config import AuditConfig, PolicyLike, TrialsTable, as_policy, as_trials_table
from gaugeblock.auditing.diagnosing import derived_diagnosis, with_diagnosis
from gaugeblock.auditing.estimator_from import as_estimator
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.function_from import as_function, function_identity
from gaugeblock.auditing.identity import identity, versions
from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.auditing.ledger import Entry, check_ledger, entered
from gaugeblock.auditing.looks import audit_look, draws_look, earlier_trials, look_at, stored_looks
from gaugeblock.auditing.observation import fitting, read_observation, trials_around
from gaugeblock.auditing.phases import end_phase, ended
from gaugeblock.auditing.provenance import FORMAT, digests, finished_audit, named, title
from gaugeblock.auditing.result import Audit, write_arrays
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.auditing.trials_from.in_hand import trials_in_hand
from gaugeblock.auditing.trusted import DRAWS, trust_record, with_densities
from gaugeblock.auditing.watch import Watch, watched
from gaugeblock.auditing.workplace import CHUNKS, discard, workplace
from gaugeblock.core.atomic import made_folder
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import kinds
from gaugeblock.core.progress import Progress, shown
from gaugeblock.core.trust import only_named
from gaugeblock.diagnosis.diagnosis import Asked
from gaugeblock.estimators.protocol import (
    Confined,
    Estimator,
    Listed,
    check_fresh,
    devices,
    layers,
    untrusted,
)
from gaugeblock.reports.machine import plain as plain_data
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.validate import Outcome, Policy, run_validators
from gaugeblock.validate import judge as judged
from gaugeblock.validate.findings_file import read_findings
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.summaries import Function, with_summaries
from gaugeblock.validate.trials import POSTERIOR, add_group, read_trials, trials_tree
from gaugeblock.validate.validators import check_validators, default_validators


def audit(
    estimator: Any,
    simulator: Any,
    *,
    prior: Any = None,
    names: Sequence[str] | None = None,
    trials: int | Mapping[str, Any] | TrialsTable | None = None,
    draws: int | None = None,
    seed: int | None = None,
    policy: PolicyLike = "default",
    out: str | os.PathLike[str] | None = None,
    anytime: bool = False,
    observation: Any = None,
    baseline: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    validators: Iterable[str] | None = None,
    summaries: Function | str | None = None,
    densities: bool | None = None,
    ledger: str | os.PathLike[str] | None = None,
    release: bool = False,
    executor: Executor | None = None,
    allow_mixed: bool = False,
    commitment: tuple[Path, Path] | None = None,
    command: str = "",
) -> Audit:
    """Audit an estimator on a simulator: simulate, estimate, validate, judge, report.

    Parameters
    ----------
    estimator
        An object with ``sample(x, n, rng)``, a posterior of sbi, a workflow of BayesFlow, a function
        ``(x, n, rng)``, a class, a model folder, a name: see `as_estimator`. x is ``(batch, *data_shape)``,
        draws are ``(batch, n, parameter)``.
    simulator
        An object with `prior` and ``simulate(theta, rng)``, a function beside its `prior`, a class, a name:
        see `as_simulator`. theta is ``(n, parameter)``, `rng` a `numpy.random.Generator`.
    prior
        Of a simulator that has none, or in place of its own: whatever `as_prior` takes.
    names : sequence of str, optional
        Names of the parameters.
    trials : int or table
        How many (4,000); as a table every key of ``[trials]`` in a configuration, for instance
        ``{"number": 500, "block": 1}``.
    draws : int
        Posterior draws of each trial (250).
    seed : int, optional
        Of everything random. Without it a fixed one, but for somebody else's estimator in its sandbox, which
        could draw the truths again if it knew the seed.
    policy
        ``"default"``, ``"strict"``, a TOML file, a table over one of these (``{"base": "strict", ...}``),
        or a `Policy`.
    out : path, optional
        Folder for trials, findings, verdict and reports; an interrupted audit goes on there, and one that is
        enlarged keeps its trials and shares its error rates with the looks before. None: no files.
    anytime : bool
        Stop as soon as the estimator is certainly broken or certainly within tolerance.
    observation : path or array, optional
        Data in hand, around which calibration is looked at too.
    baseline : path, optional
        Folder of an earlier audit to compare with.
    progress : callable ``(what, done, total)`` or bool, optional
        None: bars in a terminal and in a notebook.
    validators : names, optional
        Which to run; all by default.
    summaries : function or ``"module:function"``, optional
        From data ``(n, *data_shape)`` to up to 64 numbers ``(n, k)``, the flow's own embedding for instance:
        challengers learn from them beside x, and regions lie along them.
    densities : bool, optional
        Whether to ask another library's object for the density of its draws. None: where the simulator has a
        likelihood, which makes it worth its time.
    ledger : path, optional
        File in which every audit of a project is entered; the verdict says how many came before this one.
    release : bool
        Whether the estimator is final: its truths are drawn from a seed that the ledger has not seen.
    executor : concurrent.futures.Executor, optional
        What fills blocks of trials: a `ProcessPoolExecutor` of spawned processes, dask.distributed's
        ``client.get_executor()``, mpi4py's, loky's, Parsl's. Its processes have to see the folder `out`.
        None: this process. The bits are the same.
    allow_mixed : bool
        Whether blocks may be made on different kinds of processors, which gives up equal bits.
    commitment : (path, path), optional
        What `commit` wrote, and a text that came later: the seed is made of both.

    Raises
    ------
    InputError
        If anything given cannot be used, simulator and estimator do not fit, or one of them fails.
    """
    rules = as_policy(policy)
    chosen = None if validators is None else tuple(validators)
    check_validators(chosen or ())
    table = as_trials_table(trials, draws=draws, seed=seed)
    earlier = None if baseline is None else read_baseline(Path(baseline))
    if anytime:
        table = table.model_copy(update={"anytime": True})
    said = as_function(summaries)
    summarised = {} if said is None else {"summaries": function_identity(said)}
    if said is not None and table.anytime:
        raise InputError("summaries: are no part of an anytime audit, which learns as it goes; leave out one")
    observed = read_observation(table.observation if observation is None else observation)
    begin = _begun(
        estimator,
        simulator,
        table,
        rules,
        prior=prior,
        names=names,
        densities=densities,
        ledger=ledger,
        release=release,
        out=out,
        progress=progress,
        side_by_side=executor is not None,
        alone=True,
        commitment=commitment,
        summarised=summarised,
    )
    with begin as run:
        simulated, estimating, plan, folder, tell = (
            run.simulator,
            run.estimator,
            run.plan,
            run.folder,
            run.tell,
        )
        subjects, entry = run.subjects, run.entry
        watch = Watch(rules, plan.seed) if table.anytime else None
        made = _trials_record(plan, table, summarised)
        same = {**subjects, "trials": made}
        if observed is not None:
            fitting(simulated, observed.data, seed=plan.seed)
        known = earlier_trials(folder, same, *devices(estimating))
        work = fingerprint(simulated, estimating, plan)
        tree = collect(
            simulated,
            estimating,
            plan,
            folder / CHUNKS,
            key=work,
            watch=watch,
            progress=tell,
            earlier=known,
            executor=executor,
            allow_mixed=allow_mixed,
        )
        made_on = kinds(folder / CHUNKS / work, mixed=allow_mixed)
        if said is not None:
            tree = with_summaries(tree, said)
        if observed is not None:
            tell("around the observation", 0, 1)
            around = trials_around(simulated, estimating, observed.data, seed=plan.seed, block=plan.block)
            add_group(tree, POSTERIOR, around)
            tell("around the observation", 1, 1)
        if watch is not None:
            made["used"] = tree.sizes["trial"]
        look = audit_look(same, rules, seed=None if run.drawn else plan.seed)
        elsewhere: dict[str, Any] = {}
        if entry is not None:
            # What is watched may stop anywhere, and spends nothing for looks.
            elsewhere["known"] = entry.looked_at if watch is None else ()
            elsewhere["other_policies"] = entry.record["same_truths_other_policies"]
        provenance: dict[str, Any] = {
            "command": command,
            "seed": plan.seed,
            **subjects,
            "ledger": None if entry is None else entry.record,
            **({} if run.commitment is None else {"commitment": run.commitment}),
            "trials": made,
            "processors": made_on,
            "equal_bits": len(made_on) == 1,
        }
        resources: dict[str, Any] = {}
        for layer in layers(estimating):
            if isinstance(layer, Confined):
                confinement = dict(layer.confinement())
                # What was used differs from run to run, and so stays out of everything that must not.
                resources = dict(confinement.pop("used", {}))
                provenance["confinement"] = confinement
            if isinstance(layer, Listed):
                provenance["listing"] = layer.listing()
        given = "seed" in table.model_fields_set and not release
        provenance["trust"] = trust_record(simulated, estimating, seed_given=given)
        end_phase(estimating)
        if observed is not None:
            provenance["observation"] = observed.record
        result = judged_and_kept(
            tree,
            rules,
            seed=plan.seed,
            validators=chosen if watch is None else watched(chosen),
            provenance=provenance,
            out=None if out is None else folder,
            earlier=earlier,
            looks=look_at(None if out is None else folder, look, **elsewhere),
            resources=resources,
            progress=tell,
            estimator=estimating,
        )
        if entry is not None:
            entry.ended(result.outcome.value)
        if out is None:
            tree.load()
        discard(folder / CHUNKS)
    return result


def audit_configured(
    config: AuditConfig,
    out: str | os.PathLike[str] | None = None,
    *,
    policy: PolicyLike | None = None,
    baseline: str | os.PathLike[str] | None = None,
    ledger: str | os.PathLike[str] | None = None,
    release: bool = False,
    executor: Executor | None = None,
    allow_mixed: bool = False,
    commitment: tuple[Path, Path] | None = None,
    command: str = "",
    progress: Progress | bool | None = None,
) -> Audit:
    """`audit` as a configuration says; a `policy` takes the place of the configuration's."""
    with only_named(config.modules):
        return audit(
            config.estimator.table,
            config.simulator.table,
            trials=config.trials,
            policy=config.read_policy() if policy is None else policy,
            out=out,
            baseline=baseline,
            progress=progress,
            validators=config.validators,
            summaries=config.summaries,
            ledger=ledger,
            release=release,
            executor=executor,
            allow_mixed=allow_mixed,
            commitment=commitment,
            command=command,
        )


def commit(config: AuditConfig, path: Path, *, policy: PolicyLike | None = None) -> None:
    """Write down what is to be audited, before the text exists that its seed is made of (`audit`).

    Raises
    ------
    InputError
        As `audit`; if the configuration has a seed; or if the file is a commitment to something else.
    """
    begin = _begun(
        config.estimator.table,
        config.simulator.table,
        config.trials,
        config.read_policy() if policy is None else as_policy(policy),
        out=None,
        side_by_side=False,
        alone=True,
        commitment=(path, None),
    )
    with only_named(config.modules), begin:
        pass


def audit_part(
    config: AuditConfig,
    out: str | os.PathLike[str],
    part: tuple[int, int],
    *,
    policy: PolicyLike | None = None,
    ledger: str | os.PathLike[str] | None = None,
    release: bool = False,
    executor: Executor | None = None,
    allow_mixed: bool = False,
    progress: Progress | bool | None = None,
) -> int:
    """Fill the blocks of part (i, N) of an audit, for `audit_configured` to finish; how many there are.

    Raises
    ------
    InputError
        As `audit`; or if parts of another plan are in the folder.
    """
    begin = _begun(
        config.estimator.table,
        config.simulator.table,
        config.trials,
        config.read_policy() if policy is None else as_policy(policy),
        ledger=ledger,
        release=release,
        out=out,
        progress=progress,
        side_by_side=True,
        alone=False,
    )
    with only_named(config.modules), begin as run:
        return collect_part(
            run.simulator,
            run.estimator,
            run.plan,
            run.folder / CHUNKS,
            part,
            progress=run.tell,
            executor=executor,
            allow_mixed=allow_mixed,
        )


@dataclass(frozen=True, kw_only=True)
class _Run:
    """An audit before its first trial: who is audited on what, the plan with its seed, and where."""

    simulator: Simulator
    estimator: Estimator
    plan: Plan
    subjects: Mapping[str, Any]
    drawn: bool
    entry: Entry | None
    commitment: Mapping[str, Any] | None
    folder: Path
    tell: Progress


@contextmanager
def _begun(
    estimator: Any,
    simulator: Any,
    table: TrialsTable,
    rules: Policy,
    *,
    out: str | os.PathLike[str] | None,
    side_by_side: bool,
    alone: bool,
    prior: Any = None,
    names: Sequence[str] | None = None,
    densities: bool | None = None,
    ledger: str | os.PathLike[str] | None = None,
    release: bool = False,
    progress: Progress | bool | None = None,
    commitment: tuple[Path, Path | None] | None = None,
    summarised: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[_Run]:
    """An audit about to begin, entered in its ledger; what it holds open ends with the block."""
    if hasattr(estimator, "simulate") and not hasattr(estimator, "sample"):
        raise InputError(
            f"the estimator is a {type(estimator).__name__}, which simulates; "
            "the order is (estimator, simulator)"
        )
    if release and ledger is None:
        raise InputError(
            "a release audit draws a seed that its ledger has not seen: give one with --ledger FILE"
        )
    if release and "seed" in table.model_fields_set:
        raise InputError("a release audit draws its own seed: leave out --seed, and seed of [trials]")
    if commitment is not None and (release or "seed" in table.model_fields_set):
        raise InputError("a commitment makes its own seed: leave out --seed, seed of [trials], and --release")
    if ledger is not None:
        check_ledger(Path(ledger))
    simulated = as_simulator(simulator, prior=prior, names=names)
    dense = isinstance(simulated, HasLikelihood) if densities is None else densities
    estimating = as_estimator(estimator, simulated, densities=dense)
    if side_by_side and untrusted(estimating):
        raise InputError(
            "an estimator that nobody vouches for answers one process alone, which sees to it that all draws "
            "come before any density: leave out workers, scheduler, part and executor"
        )
    plan = table.plan()
    # What the caller made is the caller's to end.
    with (
        ended(None if estimating is estimator else estimating),
        shown(progress) as tell,
        workplace(out, alone=alone) as folder,
    ):
        subjects = {
            "simulator": {**named(simulator), **identity(simulated)},
            "estimator": {**named(estimator), **identity(estimating)},
        }
        drawn, kept_commitment = False, None
        if commitment is not None:
            content = content_of(subjects, rules, plan)
            if commitment[1] is None:
                committed(commitment[0], content)
            else:
                kept_commitment = commitment_opened(commitment[0], commitment[1], content)
                plan = replace(plan, seed=kept_commitment["seed"])
        elif untrusted(estimating) and "seed" not in table.model_fields_set and not release:
            # A stranger that can foresee the seed could draw the truths again.
            kept = fingerprint(simulated, estimating, replace(plan, seed=0))
            plan, drawn = replace(plan, seed=kept_seed(folder / CHUNKS, kept)), True
        check_fresh(estimating, plan.seed)
        entry = None
        if ledger is not None:
            about = {**subjects, "trials": _trials_record(plan, table, summarised)}
            entry = entered(Path(ledger), about, rules, release=release)
            plan = replace(plan, seed=entry.seed)
        yield _Run(
            simulator=simulated,
            estimator=estimating,
            plan=plan,
            subjects=subjects,
            drawn=drawn,
            entry=entry,
            commitment=kept_commitment,
            folder=folder,
            tell=tell,
        )


def _trials_record(plan: Plan, table: TrialsTable, summarised: Mapping[str, Any]) -> dict[str, Any]:
    """How trials are made, for provenance, and for the records of looks."""
    return {**vars(plan), **({"anytime": True} if table.anytime else {}), **summarised}


def audit_draws(
    theta_true: Any,
    draws: ArrayLike | None = None,
    *,
    x: Any = None,
    names: Sequence[str] | None = None,
    log_q: ArrayLike | None = None,
    log_q_true: ArrayLike | None = None,
    weight: ArrayLike | None = None,
    autocorrelated: bool = False,
    seed: int = 0,
    policy: PolicyLike = "default",
    out: str | os.PathLike[str] | None = None,
    baseline: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    validators: Iterable[str] | None = None,
    summaries: Function | str | None = None,
    command: str = "",
) -> Audit:
    """Judge draws in hand: run what they allow, and list what they do not.

    Parameters
    ----------
    theta_true : array ``(trial, parameter)``, arrays by name, or a source of everything
        The truths behind each data set, as an array, a table with columns or a dictionary of arrays; or,
        without `draws`, a path of a NetCDF file (Trials, or ArviZ's groups) or of an ``.npz`` whose arrays
        have the names of these arguments, a Dataset or DataTree of Trials, or an ArviZ object of many fits.
    draws : array ``(trial, draw, parameter)``, or arrays ``(trial, draw, ...)`` by name
        Posterior draws given the data of each trial. An xarray array may have its axes in any order.
    x : array ``(trial, ...)``, table, arrays by name, or its name among the truths, optional
        The data themselves: without them nothing says whether the draws depend on them as they should. Their
        values are called by a table's columns, an xarray array's coordinates or a dictionary's keys.
    names : sequence of str, optional
        Of the parameters.
    log_q, log_q_true, weight : arrays, optional
        ``(trial, draw)``, ``(trial,)`` and ``(trial, draw)``: natural log densities of draws and truths,
        linear weights of draws.
    autocorrelated : bool
        Whether the draws are said to come from Markov chains: a remark; the audit measures their order.

    The other arguments are those of `audit`.

    Raises
    ------
    InputError
        If the draws cannot be read or do not fit together.
    """
    rules, earlier = as_policy(policy), None if baseline is None else read_baseline(Path(baseline))
    if draws is None:
        tree = any_trials(theta_true, names=names)
    else:
        arrays = {"x": x, "log_q": log_q, "log_q_true": log_q_true, "weight": weight}
        tree = trials_tree(
            trials_in_hand(theta_true, draws, names=names, autocorrelated=autocorrelated, **arrays)
        )
    if (said := as_function(summaries)) is not None:
        tree = with_summaries(tree, said)
    file = theta_true if isinstance(theta_true, str | os.PathLike) else None
    record = {} if file is None else {"file": str(file), "file_sha256": file_digest(Path(file))}
    folder = None if out is None else made_folder(out)
    with shown(progress) as tell:
        return judged_and_kept(
            tree,
            rules,
            seed=seed,
            validators=None if validators is None else tuple(validators),
            provenance={"command": command, "seed": seed, "trials": record, "trust": DRAWS},
            out=folder,
            earlier=earlier,
            looks=look_at(folder, draws_look(tree, rules, seed=seed)),
            progress=tell,
        )


def judge(
    audited: Audit | str | os.PathLike[str],
    policy: PolicyLike = "default",
    *,
    out: str | os.PathLike[str] | None = None,
    seed: int | None = None,
    command: str = "",
) -> Audit:
    """Judge the findings of an audit, or of one in a folder, under another policy; nothing is sampled.

    `seed` is of the bootstrap behind the simultaneous intervals; without it, the earlier audit's. What that
    one was compared with, this one is compared with too. Reports are written into `out`, if there is one.

    Raises
    ------
    InputError
        If the folder does not hold an audit, or the policy cannot be used.
    """
    rules = as_policy(policy)
    if isinstance(audited, Audit):
        trials, findings, not_checked = audited.trials, audited.findings, audited.not_checked
        earlier, kept = dict(audited.verdict.provenance), audited.verdict.baseline
        baseline: Mapping[str, Any] | None = None if kept is None else kept["earlier"]
        looks, known = audited.verdict.looks, audited.verdict.diagnosis
    else:
        folder = Path(audited)
        trials = read_trials(folder / "trials.nc")
        findings, not_checked = read_findings(folder / "findings.nc")
        content = finished_audit(folder)
        earlier, baseline = content["provenance"], kept_baseline(content)
        looks, known = stored_looks(content), content.get("diagnosis")
    chosen = int(earlier.get("seed") or 0) if seed is None else seed
    verdict = judged(findings, not_checked, rules, seed=chosen, looks=looks)
    plain_rules = rules.model_dump(mode="json")
    record = {
        **earlier,
        "command": command,
        "judge_seed": chosen,
        "policy": plain_rules,
        "sha256": {**dict(earlier.get("sha256") or {}), "policy": digest(plain_rules)},
    }
    verdict = explained(replace(verdict, provenance=record), trials)
    if isinstance(audited, Audit) and known is not None and Asked.of(audited.verdict) == Asked.of(verdict):
        # The same trials are asked the same.
        verdict = explained(replace(verdict, diagnosis=known), trials)
    elif known is not None or verdict.outcome is not Outcome.PASS:
        verdict = derived_diagnosis(verdict, trials, known or {}, seed=int(earlier.get("seed") or 0))
    if baseline is not None:
        verdict = replace(verdict, baseline=compared(baseline, verdict, findings))
    result = Audit(trials, findings, not_checked, verdict)
    if out is not None:
        result.write_reports(made_folder(out))
    return result


def judged_and_kept(
    trials: xr.DataTree,
    policy: Policy,
    *,
    seed: int,
    validators: tuple[str, ...] | None,
    provenance: Mapping[str, Any],
    out: Path | None,
    earlier: Mapping[str, Any] | None,
    looks: Looks,
    progress: Progress,
    resources: Mapping[str, Any] = MappingProxyType({}),
    estimator: Any = None,
) -> Audit:
    """What policy and validators say of trials, written to `out` where there is one."""
    progress("validators", 0, 1)
    findings, not_checked = run_validators(trials, seed=seed, select=validators, levels=policy.levels)
    progress("validators", 1, 1)
    verdict = judged(findings, not_checked, policy, seed=seed, looks=looks)
    record = plain_data(
        {
            "ledger": None,
            **provenance,
            "trust": with_densities(provenance.get("trust"), findings),
            "title": title(provenance),
            "format": FORMAT,
            "policy": policy.model_dump(mode="json"),
            "validators": default_validators() if validators is None else list(validators),
            "versions": versions(),
        }
    )
    record["sha256"] = digests(record)
    if out is not None:
        record["sha256"]["trials"] = write_arrays(trials, findings, not_checked, out)
    verdict = explained(replace(verdict, provenance=record), trials)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    if verdict.outcome is not Outcome.PASS:
        progress("what is wrong", 0, 1)
        verdict = with_diagnosis(verdict, trials, seed=seed, estimator=estimator)
        progress("what is wrong", 1, 1)
    result = Audit(trials, findings, not_checked, verdict, resources)
    if out is not None:
        result.write_reports(out)
    return result
