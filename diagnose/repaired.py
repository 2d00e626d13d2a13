"""An estimator mended by what a diagnosis found: a new estimator, with an identity of its own."""

from __future__ import annotations

import os
from collections.abc import Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import read_json
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.diagnosis import Diagnosis
from gaugeblock.diagnosis.repair import from_data
from gaugeblock.simulators.protocol import Simulator, description

# Draws of the base for each that is asked for: repairs leave some out, or weigh them; and most of them.
SPARE, MOST = 4, 256


class Repaired(Shown):
    """Draws of `base`, repaired as a diagnosis of it says.

    The diagnosis was made on trials of its own: an audit of the repaired estimator on the same ones is
    refused, so its verdict rests on truths that neither fitted nor chose the repair. It has no density.

    Parameters
    ----------
    base
        The estimator that was diagnosed.
    simulator
        Its simulator.
    diagnosis
        A `Diagnosis`; or the folder of a diagnosed audit, or its verdict.json.

    Raises
    ------
    InputError
        If the diagnosis holds no repair, or none that this version knows.
    """

    def __init__(
        self, base: Any, simulator: Simulator, *, diagnosis: Diagnosis | str | os.PathLike[str]
    ) -> None:
        where, content = _content(diagnosis)
        repair = content.get("repair")
        if not isinstance(repair, list | tuple) or not repair:
            raise InputError(
                f"{where} has no repair: it names {content.get('named') or 'nothing'}, which draws alone "
                "cannot be mended of"
            )
        steps = [from_data(each, where=where) for each in repair]
        self._turns = [step for step in steps if "x" in signature(step).parameters]
        self._mends = [step for step in steps if "x" not in signature(step).parameters]
        self.base, self._names, self._repair = base, simulator.prior.names, list(repair)
        self.seed_of_repair = content.get("seed")
        """The seed of the trials that the repair was fitted to; None where there is none."""

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Repaired draws ``(batch, n, parameter)``; NaN where the base's are not finite.

        Raises
        ------
        InputError
            If the repair leaves too few draws over.
        """
        data = np.asarray(x)
        with np.errstate(all="ignore"):
            for turn in self._turns:
                data = turn(data.astype(float))
        if not self._mends:
            return np.asarray(self.base.sample(data, n, rng), dtype=float)
        trial = rng.integers(1 << 31, size=len(data))
        spare = SPARE
        while spare <= MOST:
            draws = np.asarray(self.base.sample(data, spare * n, rng), dtype=float)
            bad = ~np.isfinite(draws).all(axis=(1, 2))
            draws[bad] = 0.0
            cases = Cases(self._names, trial, np.zeros((len(draws), draws.shape[2])), draws)
            for mend in self._mends:
                cases = mend(cases)
            number = cases.draws.shape[1]
            if number >= n:
                # By lot: what a repair repeats stands at even distances.
                found = np.array(cases.draws[:, np.sort(rng.permutation(number)[:n])])
                found[bad] = np.nan
                return found
            spare *= SPARE
        raise InputError(f"the repair leaves fewer than one of {MOST} draws over")

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base and repair included."""
        return {"estimator": "repaired", "base": description(self.base), "repair": self._repair}


def _content(diagnosis: Any) -> tuple[str, Mapping[str, Any]]:
    """Where a diagnosis is from, and its plain data."""
    if isinstance(diagnosis, Diagnosis):
        return "the diagnosis", diagnosis.to_json()
    path = Path(diagnosis)
    path = path / "verdict.json" if path.is_dir() else path
    try:
        content = read_json(path)
    except ValueError:
        content = None
    found = content.get("diagnosis") if isinstance(content, Mapping) else None
    if not isinstance(found, Mapping):
        raise InputError(
            f"{path} holds no diagnosis: give the folder of an audit that did not PASS, or run "
            "`gaugeblock diagnose` on it first"
        )
    return str(path), found
