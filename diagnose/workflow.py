"""Locate, name, repair, confirm: what is wrong with draws, of all that the library knows, if anything is.

Trials are split in three. Repairs are fitted on the first part and judged on the second, and the other way
round, by two things: what is left of the disagreement between truths and draws (`disagreement`), and what it
costs in a proper score. A symptom is named if its repair takes nearly all of the disagreement away, and if,
fitted to all trials, it leaves no evidence of anything; among several that do, the best in both together, and
beside it those that neither two paired errors nor their own draws (`duel`) tell from it. One that takes away
a part may be followed by a second. From the third part come the gap before and after, and sizes with their
intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases, thirds
from gaugeblock.diagnosis.disagreement import Kinds, Reference, candidates, columns, evidence, fit_tilt
from gaugeblock.diagnosis.duel import LogRatios, log_ratios, trials_to_tell
from gaugeblock.diagnosis.library.calls import Called, calls, knows_truth
from gaugeblock.diagnosis.library.symptoms import STRUCTURAL, SYMPTOMS, Fit
from gaugeblock.diagnosis.repair import Repair, as_data, few_values, in_steps
from gaugeblock.diagnosis.scores import kernel_scores

# The share of a disagreement that says what it is, and errors of a difference within which two are alike.
RECOVERED, ALIKE = 0.9, 2.0
# Standard errors of what is left within which as much is taken away as must be.
WITHIN = 1.0
# Nats of evidence from which a disagreement is one where no gate has failed, and where one has: odds of a
# hundred and of three. And standard errors from which what stands for lost information is better.
SEEN, EXPECTED, CERTAIN = float(np.log(100)), float(np.log(3)), 3.0
# What a repair must have taken away whatever the errors are.
LEAST_SHARE = 0.5
# Repairs that are followed by a second one, and what the first must have taken away; trials on which all are
# tried at first.
FOLLOWED, PART = 3, 0.25
FEW = 400
# So many times the trials that there are nobody will make to tell two repairs apart.
HOPELESS = 100.0
GROUPS = 10
LEAST_DRAWS = 20
# Kinds of function that see parameters together, and what is said where only these see anything.
TOGETHER = ("pairs", "joint")
DEPENDENCE = Repair(
    "correlations",
    lambda cases: cases,
    "parameters are right one by one, and depend on each other otherwise than truths do",
)


@dataclass(frozen=True)
class Tried:
    """Repairs one after the other, as they do on the first two parts, each fitted on the other of them.

    `repairs` were fitted on the first part and `crossed` on the second; where the second gave none, that is
    empty. `left` ``(trial,)`` is the disagreement that is left, in nats, and `loss` that and what the repairs
    cost in information; `share` is the share of the disagreement that they take away.
    """

    repairs: tuple[Repair, ...]
    crossed: tuple[Repair, ...]
    left: Array
    loss: Array
    share: float
    mended: bool

    @property
    def symptoms(self) -> tuple[str, ...]:
        """Ids, in the order in which they are mended."""
        return tuple(repair.symptom for repair in self.repairs)


@dataclass(frozen=True)
class Found:
    """What the workflow found, before it is put in words.

    `gap` is the disagreement on the reporting part in nats a trial, before and after the repair, with errors;
    `kinds` which kinds of function it shows in; `sizes` numbers of the named repair with 90% intervals;
    `repairs` all that is wrong in its order, fitted to all cases; `to_tell` how many trials would tell each
    of `alike` from the one that is named.
    """

    structural: tuple[Repair, ...]
    named: Tried | None
    alike: tuple[Tried, ...]
    tried: tuple[Tried, ...]
    seen: bool
    before: tuple[float, float]
    after: tuple[float, float] | None
    kinds: dict[str, float]
    sizes: dict[str, tuple[float, float, float]]
    repairs: tuple[Repair, ...] = ()
    to_tell: dict[str, int | None] = field(default_factory=dict)


def locate_and_name(
    cases: Cases,
    *,
    seed: int,
    failed: bool,
    again: Called | None = None,
    own: Mapping[str, Fit] | None = None,
    as_drawn: Cases | None = None,
) -> Found:
    """What is wrong with the draws of these cases, of all that the library knows.

    `failed` says whether a gate has said that something is; `again` is the estimator, where it can be called;
    `own` are symptoms beside the library's; `as_drawn` are some cases with all their draws in their order,
    where the others' have been thinned.
    """
    structural = tuple(repair for fit in STRUCTURAL for repair in fit(as_drawn or cases))
    if again is not None and not structural:
        structural = tuple(knows_truth(cases, again))
    # Draws that repeat each other depend on their order as well: what is wrong first is mended first.
    structural = structural[:1]
    for repair in structural if as_drawn is None else ():
        cases = repair.apply(cases)
    parts = Parts.of(cases, seed, again, {**SYMPTOMS, **(own or {})})
    limit = SEEN if structural or not failed else EXPECTED
    # Of draws that are all made of the same numbers, or of very few, trials tell nothing more.
    alone = any(repair.symptom == "fixed_seed" for repair in structural) or cases.draws.shape[1] < LEAST_DRAWS
    original = parts.tried((), ())
    if alone or parts.seen <= limit or original.left.mean() <= 0:
        return Found(structural, None, (), (original,), False, parts.gap(()), None, {}, {}, structural)
    tried = [original, *parts.all_tried(original)]
    found = parts.mending(tried)
    if not found:
        for first in first_of_each(tried):
            tried += parts.all_tried(first)
        found = parts.mending(tried)
    if not found and parts.only_joint:
        found = [Tried((DEPENDENCE,), (DEPENDENCE,), original.left, original.left, 0.0, True)]
        tried += found
    # Of those that are not told apart the plainest is named.
    named = min(found, key=numbers_in, default=None)
    after = None if named is None else parts.gap(named.repairs)
    sizes = {} if named is None else sizes_reported(parts, named)
    repairs = (*structural, *(() if named is None else parts.refitted(named.repairs)))
    to_tell = {
        each.symptoms[0]: parts.to_tell(named, each)
        for each in found
        if named is not None and each.symptoms[0] != named.symptoms[0]
    }
    before = parts.gap(())
    return Found(
        structural,
        named,
        tuple(found),
        tuple(tried),
        True,
        before,
        after,
        parts.kinds,
        sizes,
        repairs,
        to_tell,
    )


Halves = tuple[tuple[Cases, Cases], tuple[Cases, Cases]]
"""What is learned from, and what is foretold: each of two parts is both once."""


@dataclass(frozen=True)
class Parts:
    """The three parts, what they are held against, and how a repair does on the first two."""

    cases: Cases
    fitting: Cases
    choosing: Cases
    reporting: Cases
    reference: Reference
    seed: int
    again: Called | None
    symptoms: Mapping[str, Fit]
    _seen: dict[int, tuple[Array, Kinds]] = field(default_factory=dict)
    _told: dict[tuple[int, int], list[LogRatios]] = field(default_factory=dict)

    @classmethod
    def of(cls, cases: Cases, seed: int, again: Called | None, symptoms: Mapping[str, Fit]) -> Parts:
        fitting, choosing, reporting = (cases.taken(rows) for rows in thirds(len(cases), seed))
        # Where truths lie, all of them say; what the data foretell is learned on the fitting part alone.
        reference = replace(Reference.of(fitting), truths=cases.theta)
        of_few, steps = few_values(cases.theta)
        if len(steps):
            symptoms = {
                name: partial(_in_steps, fit=fit, columns=of_few, steps=steps)
                for name, fit in symptoms.items()
            }
        return cls(cases, fitting, choosing, reporting, reference, seed, again, symptoms)

    def all_tried(self, before: Tried) -> list[Tried]:
        """Every repair, fitted to cases to which those before it have been applied, with these."""
        done = set(before.symptoms) - {"region"}  # there may be two
        begun = self.begun(before)
        (fitting, other), (choosing, _) = begun
        few = fitting.taken(slice(FEW)), other.taken(slice(FEW))
        tried = []
        for name, fit in self.symptoms.items():
            found = [] if name in done else fit(fitting, self.reference)
            found = [each for each in found if self.promising((*before.repairs, each), few)]
            crossed = {each.variant: each for each in fit(choosing, self.reference)} if found else {}
            for each in found:
                twin = crossed.get(each.variant)
                both: tuple[Repair, ...] = ()
                if twin is not None and len(before.crossed) == len(before.repairs):
                    both = (*before.crossed, twin)
                tried.append(self.tried((*before.repairs, each), both, begun))
        if self.again is not None and not before.repairs:
            # How the estimator is called has nothing fitted in it.
            tried += [self.tried((each,), (each,)) for each in calls(fitting, self.again)]
        return tried

    def columns(self, cases: Cases) -> tuple[Array, Kinds]:
        """As the function of this name; of the parts as they are only once."""
        if not any(cases is part for part in (self.fitting, self.choosing, self.reporting)):
            return columns(cases, self.reference, self.seed)
        if id(cases) not in self._seen:
            self._seen[id(cases)] = columns(cases, self.reference, self.seed)
        return self._seen[id(cases)]

    @cached_property
    def only_joint(self) -> bool:
        """Whether no more than a tenth of the disagreement shows in parameters one by one."""
        values, kinds = self.columns(self.fitting)
        if "joint" not in kinds.names:
            return False
        alone = ~np.isin(kinds.of, [kinds.names.index(name) for name in kinds.names if name in TOGETHER])
        other = self.columns(self.choosing)[0]
        left = np.concatenate(
            [
                fit_tilt(one * alone, kinds).gains(two * alone)
                for one, two in ((values, other), (other, values))
            ]
        )
        excess, error = _mean(left - (1 - RECOVERED) * self.original)
        return excess < ALIKE * error and float(left.mean()) < LEAST_SHARE * float(self.original.mean())

    def promising(self, chosen: tuple[Repair, ...], few: tuple[Cases, Cases]) -> bool:
        """Whether a few trials leave it possible that with the last of these repairs little is left."""
        left, mended = self.gains(chosen[-1:], *few)
        trial, original = self.original_few
        return not leaves_too_much(left, original[np.isin(trial, mended.trial)], chosen)

    @cached_property
    def original_few(self) -> tuple[NDArray[np.int64], Array]:
        """Those few trials, and what truths are told from draws as they are by there."""
        learned, other = (each.taken(slice(FEW)) for each in self.halves[0])
        return other.trial, self.gains((), learned, other)[0]

    @cached_property
    def original(self) -> Array:
        """Nats ``(trial,)`` by which truths are told from draws as they are, on the first two parts."""
        return np.concatenate([self.gains((), one, two)[0] for one, two in self.halves])

    @property
    def halves(self) -> Halves:
        """The first two parts as they are: the second is foretold first."""
        return (self.fitting, self.choosing), (self.choosing, self.fitting)

    def begun(self, before: Tried) -> Halves:
        """The halves as these repairs leave them: whatever follows them begins here."""
        one, two = (
            (_repaired(learned, mends), _repaired(other, mends))
            for mends, (learned, other) in zip((before.repairs, before.crossed), self.halves, strict=True)
        )
        return one, two

    @cached_property
    def scored(self) -> tuple[Array, Array]:
        """Scores ``(trial, parameter)`` of the draws as they are, of what is foretold."""
        found = [kernel_scores(each, each.half_width) for _, each in self.halves]
        return found[0], found[1]

    @cached_property
    def kinds(self) -> dict[str, float]:
        """In which kinds of function the disagreement shows."""
        return fit_tilt(*self.columns(self.fitting)).by_kind(self.columns(self.choosing)[0])

    def gains(self, chosen: Sequence[Repair], learned: Cases, other: Cases) -> tuple[Array, Cases]:
        """The disagreement ``(trial,)`` of other cases once both are repaired, and those.

        Draws that the last repair weighs stay as they are: candidates have the odds of their weights.
        """
        weigh = _weighing(chosen)
        done = chosen if weigh is None else chosen[:-1]
        both = [_repaired(each, done) for each in (learned, other)]
        odds = [0.0 if weigh is None else weigh(each, candidates(each, self.seed)) for each in both]
        (values, kinds), (others, _) = (self.columns(each) for each in both)
        return fit_tilt(values, kinds, odds[0]).gains(others, odds[1]), both[1]

    @cached_property
    def reported(self) -> Array:
        """Nats ``(trial,)`` by which truths are told from draws as they are, on the third part."""
        return self.gains((), self.fitting, self.reporting)[0]

    def unbeaten(self, alike: Sequence[Tried]) -> list[Tried]:
        """Those that truths do not tell from a better one; all where each is beaten."""
        won = {(i, k): self.duel(alike[i], alike[k]) for i, k in combinations(range(len(alike)), 2)}
        beaten = {k if ahead > 0 else i for (i, k), ahead in won.items() if abs(ahead) > ALIKE}
        return [each for k, each in enumerate(alike) if k not in beaten] or list(alike)

    def duel(self, one: Tried, other: Tried) -> float:
        """By how many of its errors the mean log ratio of both's densities at truths lies above 0."""
        mean, error = _mean(np.concatenate([each.truths for each in self.ratios(one, other)]))
        return mean / max(error, np.finfo(float).tiny)

    def to_tell(self, one: Tried, other: Tried) -> int | None:
        """How many trials would tell the other from this one, to two digits; None where too many."""
        found = self.ratios(one, other)
        number = trials_to_tell(np.concatenate([each.drawn for each in found]))
        number *= len(self.cases) / sum(len(each.truths) for each in found)
        return int(float(f"{number:.2g}")) if number <= HOPELESS * len(self.cases) else None

    def ratios(self, one: Tried, other: Tried) -> list[LogRatios]:
        """Log ratios of both's densities, of the parts on which both were fitted to the other; once."""
        if (id(one), id(other)) in self._told:
            return self._told[id(one), id(other)]
        found = self._told[id(one), id(other)] = []
        for half, mends in enumerate(((one.repairs, other.repairs), (one.crossed, other.crossed))):
            if all(mends):
                learned, judged = (
                    (_repaired(part, mends[0]), _repaired(part, mends[1])) for part in self.halves[half]
                )
                found.append(log_ratios(learned, judged, self.reference, self.seed))
        return found

    def mending(self, tried: Sequence[Tried]) -> list[Tried]:
        """Repairs after which nothing much is seen to be wrong, and which truths do not tell apart."""
        return self.unbeaten(
            [each for each in best_and_alike([one for one in tried if one.mended]) if self.confirmed(each)]
        )

    @cached_property
    def seen(self) -> float:
        """Nats by which all truths are told from draws as they are."""
        return evidence(self.cases, self.reference, self.seed)

    def refitted(self, chosen: Sequence[Repair]) -> tuple[Repair, ...]:
        """Repairs fitted to all cases, one after the other: what an estimator is mended by."""
        found, cases = [], self.cases
        for repair in chosen:
            found.append(_fitted(self, cases, repair) or repair)
            cases = found[-1].apply(cases)
        return tuple(found)

    def confirmed(self, each: Tried) -> bool:
        """Whether no evidence is left, or little of it, once repairs are fitted to all trials.

        What stands for something that draws cannot have is not asked.
        """
        if not all(repair.recovers for repair in each.repairs):
            return True
        chosen = self.refitted(each.repairs)
        weigh = _weighing(chosen)
        mended = _repaired(self.cases, chosen if weigh is None else chosen[:-1])
        odds = None if weigh is None else weigh(mended, candidates(mended, self.seed))
        return evidence(mended, self.reference, self.seed, odds) <= max(
            SEEN, _allowed(each.repairs) * self.seen
        )

    def gap(self, chosen: Sequence[Repair]) -> tuple[float, float]:
        """Disagreement and its error on the reporting part."""
        return _mean(self.gains(chosen, self.fitting, self.reporting)[0] if chosen else self.reported)

    def tried(
        self, chosen: tuple[Repair, ...], crossed: tuple[Repair, ...], begun: Halves | None = None
    ) -> Tried:
        """How repairs do on the first two parts, each of which is mended by those of the other.

        `begun` are the parts as all but the last of them leave them.
        """
        original = self.original
        if not chosen:
            return Tried(chosen, crossed, original, original, 0.0, False)
        allowed = _allowed(chosen)
        found: list[tuple[Array, Array]] = []
        for mends, half, as_it_was, scored in zip(
            (chosen, crossed), begun or self.halves, self.halves, self.scored, strict=True
        ):
            if found and leaves_too_much(found[0][0], original[: len(found[0][0])], chosen):
                # What leaves too much of one part for certain is not asked of the other, but taken for alike.
                n = len(as_it_was[1])
                found.append((np.full(n, found[0][0].mean()), np.full(n, found[0][1].mean())))
            else:
                found.append(self._half(mends[-1:], half if mends else as_it_was, as_it_was[1], scored))
        left, cost = (np.concatenate(parts) for parts in zip(*found, strict=True))
        excess, error = _mean(left - allowed * original)
        price, price_error = _mean(cost)
        share = 1 - max(float(left.mean()), 0) / float(original.mean())
        # Foretelling worse than by chance on other trials is no sign that nothing is left.
        trusted = left.mean() > -(1 - RECOVERED) * original.mean() - CERTAIN * _mean(left)[1]
        mended = trusted and share > LEAST_SHARE and excess < WITHIN * error and price <= ALIKE * price_error
        if allowed == 1:
            better, error = _mean(left + cost - original)
            mended = better < -CERTAIN * error
        return Tried(chosen, crossed, left, left + cost, share, mended)

    def _half(
        self, last: tuple[Repair, ...], half: tuple[Cases, Cases], other: Cases, scored: Array
    ) -> tuple[Array, Array]:
        """What is left ``(trial,)`` of the other part, and what it costs; as it was without a repair.

        `half` is as the repairs before the last leave it, `other` and its scores as they were.
        """
        found, repaired = self.gains(last, *half)
        kept = np.isin(other.trial, repaired.trial)
        # Trials that a repair leaves out gain nothing, and cost what the others do.
        left = np.full(len(other), found.mean())
        left[kept] = found
        weigh = _weighing(last)
        log_weight = None if weigh is None else weigh(repaired, repaired.draws)
        before, after = scored[kept], kernel_scores(repaired, other.half_width[kept], log_weight)
        means = [np.maximum(each.mean(axis=0), np.finfo(float).tiny) for each in (before, after)]
        cost = np.full(len(other), np.log(means[1] / means[0]).sum())
        cost[kept] += (after / means[1] - before / means[0]).sum(axis=1)
        return left, cost


def _allowed(chosen: Sequence[Repair]) -> float:
    """The share of a disagreement that repairs may leave."""
    return 1 - min(repair.recovers for repair in chosen)


def leaves_too_much(left: Array, original: Array, chosen: Sequence[Repair]) -> bool:
    """Whether repairs leave more ``(trial,)`` of a disagreement than they may, for certain.

    A first one may leave what a second takes away; one that stands for what draws cannot have, all of it.
    """
    allowed = max(_allowed(chosen), 1 - PART if len(chosen) == 1 else 0.0)
    excess, error = _mean(left - allowed * original)
    return allowed < 1 and excess > CERTAIN * error


def _weighing(chosen: Sequence[Repair]) -> Callable[[Cases, Array], Array] | None:
    """What the last repair weighs draws by, where it does."""
    return chosen[-1].log_weight if chosen else None


def _in_steps(
    cases: Cases, reference: Reference, fit: Fit, columns: NDArray[np.int64], steps: Array
) -> list[Repair]:
    """Repairs after which parameters with few values have no others."""
    return [
        replace(each, apply=partial(in_steps, mend=each.apply, columns=columns, steps=steps))
        if as_data(each.apply)
        else each
        for each in fit(cases, reference)
    ]


def _repaired(cases: Cases, chosen: Sequence[Repair]) -> Cases:
    for repair in chosen:
        cases = repair.apply(cases)
    return cases


def _mean(values: Array) -> tuple[float, float]:
    """Mean and standard error."""
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


def first_of_each(tried: Sequence[Tried]) -> list[Tried]:
    """The best repair of each of the few symptoms that take away a part."""
    found: dict[str, Tried] = {}
    for each in sorted(tried, key=lambda each: float(each.loss.mean())):
        if each.share > PART:
            found.setdefault(each.symptoms[0], each)
    return list(found.values())[:FOLLOWED]


def best_and_alike(mended: Sequence[Tried]) -> list[Tried]:
    """The best of those that mend, and those of other symptoms that paired errors do not tell from it."""
    if not mended:
        return []
    best = min(mended, key=lambda each: float(each.loss.mean()))
    alike: dict[frozenset[str], Tried] = {frozenset(best.symptoms): best}
    for each in sorted(mended, key=lambda each: float(each.loss.mean())):
        further, error = _mean(each.loss - best.loss)
        if further <= ALIKE * error:
            alike.setdefault(frozenset(each.symptoms), each)
    return list(alike.values())


def numbers_in(each: Tried) -> int:
    """How many numbers its repairs have fitted."""
    return sum(len(repair.numbers) for repair in each.repairs)


def sizes_reported(parts: Parts, named: Tried) -> dict[str, tuple[float, float, float]]:
    """Numbers of the named repairs fitted to trials that neither fitted nor chose them, with 90% intervals.

    Errors by leaving out one of ten groups of trials at a time (Quenouille's jackknife).
    """
    found = {}
    cases = parts.reporting
    group = np.arange(len(cases)) % GROUPS
    for repair in named.repairs:
        whole = _numbers(parts, cases, repair)
        left_out = [_numbers(parts, cases.taken(group != g), repair) for g in range(GROUPS)]
        for name, value in whole.items():
            others = np.array([each.get(name, np.nan) for each in left_out])
            error = float(np.sqrt((GROUPS - 1) / GROUPS * ((others - others.mean()) ** 2).sum()))
            reach = float(stats.t.ppf(0.95, GROUPS - 1)) * error
            found[name] = (value, value - reach, value + reach)
        cases = repair.apply(cases)
        group = np.arange(len(cases)) % GROUPS
    return found


def _numbers(parts: Parts, cases: Cases, wanted: Repair) -> dict[str, float]:
    """Numbers of the same repair, fitted to other cases; none where it is not there."""
    found = _fitted(parts, cases, wanted)
    return {} if found is None else dict(found.numbers)


def _fitted(parts: Parts, cases: Cases, wanted: Repair) -> Repair | None:
    """The same repair of the same symptom, fitted to other cases."""
    if wanted.symptom not in parts.symptoms:
        return wanted
    fit = parts.symptoms[wanted.symptom]
    return next((r for r in fit(cases, parts.reference) if r.variant == wanted.variant), None)
