"""What follows from other published numbers by arithmetic alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from studies.paper.auc_error import null_auc_error
from studies.paper.registry import CLEAN, SUSPICIOUS, claims

LINE_KEV, SHIFT = 6.4, 0.03
ACCURACY_EV = {"pn": 12.5, "nicer": 5.0}
REALISTIC = (0.3, 0.1)
"""Per cent: the energy-scale errors that real detectors have."""
BARELY = (1e3, 1e4)
"""Counts at which the study's checks might barely see 3 per cent."""
GAIN_PRIOR_SD = 0.1 / np.sqrt(12.0)
ATOMS = 200
"""Equally spaced gains that the study's flow was trained on."""


def quoted(claim: str, part: str = "value") -> float:
    """A published number."""
    return claims()[claim].parts[part]


def arithmetic() -> dict[str, float | Mapping[str, float]]:
    """Every arithmetic claim computed again, by claim."""
    per_cell = null_auc_error(CLEAN, SUSPICIOUS)
    recur = float(stats.binom.sf(2, 4, 0.05))
    shift_ev = 1000.0 * LINE_KEV * SHIFT
    return {
        "det.percell_se": per_cell,
        "det.diff_noise": _twice(quoted("det.percell_se")),
        "det.D3_floor_acc": CLEAN / (CLEAN + SUSPICIOUS),
        "det.shift.ev": shift_ev,
        "det.shift.res": shift_ev / quoted("det.nicer.fwhm"),
        "cal.PLnorm.prob": {"alone": recur, "times five": 5.0 * recur},
        "is.essfrac.ratio": quoted("is.essfrac.medium") / quoted("is.essfrac.bright"),
        "gm.dGdg": quoted("gm.bias.bright") / SHIFT,
        "gm.quad": GAIN_PRIOR_SD * quoted("gm.dGdg"),
        "sub.scaling": {
            "least": BARELY[0] * (100.0 * SHIFT / REALISTIC[0]) ** 2,
            "most": BARELY[1] * (100.0 * SHIFT / REALISTIC[1]) ** 2,
        },
        **_accuracy(),
        "xc.convention": _convention(),
    }


def _twice(error: float) -> dict[str, float]:
    difference = float(np.sqrt(2.0)) * error
    return {"error": difference, "band": 2.0 * difference}


def _accuracy() -> dict[str, float | Mapping[str, float]]:
    """Energy-scale accuracies in per cent of an energy, and 3 per cent in units of them."""

    def share(instrument: str, kev: float) -> float:
        return 100.0 * ACCURACY_EV[instrument] / (1000.0 * kev)

    at = {f"scale.{name}.{kev}keV": share(name, kev) for name, kev in [("pn", 6), ("pn", 1), ("pn", 10)]} | {
        f"scale.nicer.{kev}keV": share("nicer", kev) for kev in (6, 1)
    }
    factors = {
        f"scale.factor.{name}": {f"{kev} keV": 100.0 * SHIFT / share(name, kev) for kev in (1, 6)}
        for name in ACCURACY_EV
    }
    real = {f"{amplitude} per cent": 100.0 * SHIFT / amplitude for amplitude in REALISTIC}
    return {**at, **factors, "scale.factor.real": real}


def _convention() -> dict[str, float]:
    """Captures against the sd of 200 equally spaced gains, over those against the continuous prior's."""
    wider = float(np.sqrt((ATOMS + 1) / (ATOMS - 1)))
    exact, captured = (claims()[name].parts for name in ("xc.bright.shrink_NS", "xc.bright.capture"))
    ratios = []
    for part, share in captured.items():
        constraint = 1.0 - exact[part.partition(",")[0]]
        flow = 1.0 - share * constraint
        ratios.append((1.0 - flow / wider) / constraint / share)
    return {"least": min(ratios), "most": max(ratios)}
