"""What a spectrum's file says of the errors of its counts, against a likelihood that is Poisson's alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

POISSERR = {
    "T": True,
    "TRUE": True,
    "1": True,
    "F": False,
    "FALSE": False,
    "0": False,
    "NONE": None,
    "": None,
}
"""What the keyword means as a logical, as a text and as a number; None where it says nothing."""


def poisson_errors(said: Any) -> bool | None:
    """What POISSERR says, None where it is absent or blank.

    Raises
    ------
    InputError
        For what is neither true nor false.

    >>> [poisson_errors(said) for said in (True, "F", " true ", 0, None)]
    [True, False, True, False, None]
    """
    text = str(np.asarray(said).tolist()).strip().upper()
    if text not in POISSERR:
        raise InputError(f"POISSERR is {said!r}, and has to be T or F; correct the header")
    return POISSERR[text]


def systematic(error: Array) -> tuple[str, ...]:
    """A note for fractional systematic errors ``(channel,)`` above 0; pipelines put them into most spectra.

    Raises
    ------
    InputError
        For negative ones.
    """
    _nonnegative("SYS_ERR", error)
    if not error.any():
        return ()
    return (
        f"SYS_ERR (median {np.median(error):.3g}, up to {error.max():.3g}) is not used: the likelihood is "
        "Poisson's, without scatter beyond it; what is found at this level may be the calibration's",
    )


def statistical(
    channel: NDArray[np.int64], counts: NDArray[np.int64], error: Array, poisson: bool | None
) -> tuple[str, ...]:
    """A note where errors ``(channel,)``, in counts, are not used or needless; counting's own need none.

    OGIP/92-007: STAT_ERR holds the errors where POISSERR is F, and where there is no POISSERR; where it is T
    they are Poisson's, whatever STAT_ERR says. Errors of another kind belong to numbers that are no counts.

    Raises
    ------
    InputError
        For errors that hold and are not those of counting, and for negative ones.
    """
    _nonnegative("STAT_ERR", error)
    if not error.any():
        if poisson is False:
            return ("POISSERR is F and no errors are given; whole counts are taken for Poisson's",)
        return ()
    other = np.flatnonzero(~_of_counting(counts, error))
    if not other.size:
        if poisson is False:
            return ("POISSERR is F, but STAT_ERR are those of Poisson counts, which they are taken for",)
        return ()
    i = other[0]
    where = f"channel {channel[i]}: {counts[i]} counts, error {error[i]:.4g}"
    if poisson:
        return (
            f"STAT_ERR ({where}) is not used: POISSERR is T, by which OGIP puts the errors of Poisson counts "
            "in its place",
        )
    raise InputError(
        f"POISSERR is {'absent' if poisson is None else 'F'} and STAT_ERR are not the errors of Poisson "
        f"counts ({where}), which the likelihood needs; give the raw spectrum, neither weighted nor "
        "background-subtracted, or set POISSERR to T if these are raw counts"
    )


def _of_counting(counts: NDArray[np.int64], error: Array) -> NDArray[np.bool_]:
    """Which errors are those of counting, ``(channel,)``.

    They are the root of counts (SAS, XSELECT), Gehrels' 1 + sqrt(N + 0.75) (CIAO), or 1 for no counts, which
    keeps a chi-square finite; files round them to two decimals or to a thousandth.
    """
    root = np.sqrt(counts)
    known = np.stack([root, 1.0 + np.sqrt(counts + 0.75), np.maximum(root, 1.0)])
    return np.asarray((np.abs(error - known) <= 0.006 + 1e-3 * root).any(axis=0))


def _nonnegative(name: str, error: Array) -> None:
    if np.any(error < 0):
        raise InputError(f"{name} is negative ({error.min():.3g}), which no error is; make it anew")
