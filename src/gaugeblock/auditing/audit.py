"""The audit: where a simulator, an estimator, the validators and a policy meet."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from gaugeblock.auditing.baseline import read_baseline
from gaugeblock.auditing.beginning import begun, trials_record
from gaugeblock.auditing.collect import collect, collect_part, fingerprint
from gaugeblock.auditing.config import AuditConfig, PolicyLike, TrialsTable, as_policy, as_trials_table
from gaugeblock.auditing.function_from import as_function, function_identity
from gaugeblock.auditing.judging import judged_and_kept
from gaugeblock.auditing.looks import audit_look, earlier_trials, look_at
from gaugeblock.auditing.observation import fitting, read_observation, trials_around
from gaugeblock.auditing.phases import end_phase
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.trusted import trust_record
from gaugeblock.auditing.watch import Watch, watched
from gaugeblock.auditing.workplace import CHUNKS, discard
from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import kinds
from gaugeblock.core.progress import Progress
from gaugeblock.core.trust import only_named
from gaugeblock.estimators.protocol import Confined, Listed, devices, layers
from gaugeblock.validate.summaries import Function, with_summaries
from gaugeblock.validate.trials import POSTERIOR, add_group
from gaugeblock.validate.validators import check_validators


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
    begin = begun(
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
        made = trials_record(plan, table, summarised)
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
    begin = begun(
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
    begin = begun(
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
