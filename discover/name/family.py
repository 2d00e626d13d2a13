"""What comes with a line: whether the rest of its family is there, and whether these counts could tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.name.beside import effect_part
from gaugeblock.discovery.name.profiles import Profile
from gaugeblock.discovery.name.score import projection
from gaugeblock.discovery.name.shapes import Templates
from gaugeblock.discovery.result import FamilySaid, FollowerSaid
from gaugeblock.simulators.library import Follower, Known, LibraryEffect, Stage

SURE = 3.0
"""Standard errors from which on a follower is seen, or missed where it would have to be."""

NEAR = 2.0
"""Nats within which another ionisation is as good."""


@dataclass(frozen=True, eq=False)
class Family:
    """A model's effect `at`, which may be the `line` that others come with, and what is known of the data.

    `shapes` are templates at the fit `base` without effects, of all `entries`. Effects of the model that are
    no broader than `reach` (keV), and as near to where a follower should be, are taken for it. `band` in keV,
    as recorded.
    """

    model: Profile
    at: int
    line: Known
    counts: Array
    shapes: Templates
    base: Fit
    entries: Mapping[str, LibraryEffect]
    reach: float
    band: tuple[float, float]

    def said(self) -> FamilySaid | None:
        """Amplitudes of all that comes with the line; None where nothing of it lies in the band.

        They are fitted together, to first order, to the Poisson counts of all regions, every other parameter
        of the model free; with them whatever moves the line, which moves all by one factor. Every ionisation
        of the family is tried, with known ratios.
        """
        found = [one for stage in self.line.family if (one := self._stage(stage)).followers]
        if not found:
            return None
        best = max(one.gain for one in found)
        # Of ionisations that are alike the lowest, with all that may follow; what that lacks by the lowest of
        # all.
        alike = [one for one in found if one.gain > best - NEAR]
        said = alike[0].said()
        names = {one.name for one in said}
        seen = [
            follower for follower, one in zip(alike[0].followers, said, strict=True) if one.seen and one.power
        ]
        chance = self._elsewhere(seen[0], alike[0].factor) if seen else None
        lacking = tuple(one for one in found[0].said() if one.name not in names)
        return FamilySaid(self.line.name, tuple(one.name for one in alike), (*lacking, *said), chance)

    def _elsewhere(self, one: Follower, factor: float) -> float:
        """Share of places in the band, as far apart as `reach`, where as much would be seen that could be
        this follower, its own among them.
        """
        places = np.arange(self.band[0] + 0.5 * self.reach, self.band[1], self.reach)
        places = places[np.abs(places - factor * one.energy) > self.reach]
        own = self._project(self._lines(places, 0.0))
        information = (own**2).sum(axis=1)
        ratio, error = own @ self._residual / information, information**-0.5
        alike = (ratio >= SURE * error) & (np.abs(ratio - (one.ratio or 0.0)) < SURE * error)
        return float((1 + alike.sum()) / (1 + len(places)))

    def _stage(self, stage: Stage) -> _Fitted:
        factor, rows, followers = self._energy / stage.energy, [], []
        for one in stage.followers:
            row = self._template(one, factor) if self.band[0] < factor * one.energy < self.band[1] else None
            if row is not None:
                rows.append(row)
                followers.append(one)
        own = self._project(np.array(rows).reshape(-1, len(self.counts)))
        fixed = np.array([one.ratio or 0.0 for one in followers])
        free = [i for i, one in enumerate(followers) if one.ratio is None]
        left = self._residual - fixed @ own
        left = left - np.linalg.lstsq(own[free].T, left)[0] @ own[free]
        covariance: Array = np.asarray(np.linalg.pinv(own @ own.T, hermitian=True), dtype=float)
        amplitude = covariance @ (own @ self._residual)
        return _Fitted(stage.name, tuple(followers), factor, amplitude, covariance, -0.5 * float(left @ left))

    @property
    def _energy(self) -> float:
        return float(self.model.added[self.at]["energy"])

    @cached_property
    def _rest(self) -> tuple[Fit, Array]:
        """The fit without the parameters of effects that may be followers, of any ionisation, and the counts
        expected without them.
        """
        fit, gone = self.model.fit, list[int]()
        mean = fit.expected[0].copy()
        places = [
            (one.effect, self._energy / stage.energy * one.energy)
            for stage in self.line.family
            for one in stage.followers
        ]
        for place, (entry, values) in enumerate(zip(self.model.entries, self.model.added, strict=True)):
            near = any(entry.name == key and abs(values["energy"] - at) <= self.reach for key, at in places)
            if place != self.at and near and values.get("sigma", 0.0) <= self.reach:
                first = self.model.first(place)
                gone += range(first, first + len(entry.parameters))
                mean -= effect_part(self.model, place).change
        keep = [i for i in range(fit.theta.shape[1]) if i not in gone]
        return replace(fit, jacobian=fit.jacobian[..., keep], precision=fit.precision[keep]), mean

    def _project(self, rows: Array) -> Array:
        return np.asarray(projection(self._rest[0])(rows[None])[0])

    @cached_property
    def _residual(self) -> Array:
        return np.asarray(self._project((self.counts - self._rest[1])[None])[0])

    def _template(self, one: Follower, factor: float) -> Array | None:
        """Counts ``(channel,)`` of a follower, per unit of its ratio to the line's amplitude; of another
        effect than the line's per unit of its own, from scanned energies. None where that was not scanned.
        """
        if one.effect == self.model.entries[self.at].name:
            return np.asarray(
                self._lines(np.array([factor * one.energy]), factor * one.width)[0], dtype=float
            )
        if one.effect not in self.entries:
            return None
        other = self.entries[one.effect]
        rows = self.shapes.values[0, self.shapes.owner == one.effect]
        rows = np.asarray(rows * self._rest[1] / np.maximum(self.base.expected[0], TINY), float)
        scanned = other.nodes[:, list(other.parameters).index("energy")]
        place = np.interp(factor * one.energy, scanned, np.arange(len(scanned)))
        low = int(np.clip(np.floor(place), 0, max(len(scanned) - 2, 0)))
        high = min(low + 1, len(scanned) - 1)
        return np.asarray((1.0 - (place - low)) * rows[low] + (place - low) * rows[high])

    def _lines(self, energies: Array, width: float) -> Array:
        """Counts ``(energy, channel)`` of the line itself at other energies, its width in proportion and with
        some more.
        """
        entry, fit, simulator = self.model.entries[self.at], self.model.fit, self.model.candidate.simulator
        index = {name: i for i, name in enumerate(entry.parameters, self.model.first(self.at))}
        theta = np.repeat(fit.theta, len(energies) + 2, axis=0)
        theta[1, index[entry.amplitude]] = entry.neutral
        if "sigma" in index:
            theta[2:, index["sigma"]] = np.hypot(theta[0, index["sigma"]] * energies / self._energy, width)
        theta[2:, index["energy"]] = energies
        mean = np.asarray(simulator.expected(theta))
        return np.asarray((mean[2:] - mean[1]) * fit.expected[0].sum() / mean[0].sum())


@dataclass(frozen=True, eq=False)
class _Fitted:
    """One ionisation: amplitudes of its followers, their covariance; its log likelihood, ratios as known."""

    name: str
    followers: tuple[Follower, ...]
    factor: float
    amplitude: Array
    covariance: Array
    gain: float

    def said(self) -> tuple[FollowerSaid, ...]:
        """Each follower with all others free; seen, missing, or neither where these counts could not tell."""
        found = []
        errors = np.sqrt(np.maximum(np.diag(self.covariance), TINY**2))
        for one, ratio, error in zip(self.followers, self.amplitude.tolist(), errors.tolist(), strict=True):
            power = None if one.ratio is None else one.ratio / error
            seen = True if ratio >= SURE * error else None
            if seen is None and one.ratio is not None and min(one.ratio, one.ratio - ratio) >= SURE * error:
                seen = False
            at = self.factor * one.energy
            found.append(FollowerSaid(one.name, at, ratio, error, one.ratio, power, seen))
        return tuple(found)
