"""Terms that one of two log likelihoods may have alone, and what a constant or a factor usually is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlogy

from gaugeblock.core.arrays import Array
from gaugeblock.validate.likelihood.density import Rows


@dataclass(frozen=True)
class Term:
    """Values ``(row,)`` of something that may be added; `usual` are the factors that it usually has."""

    name: str
    words: str
    values: Array
    usual: tuple[float, ...] = (1.0, -1.0)
    of_data: bool = False


def terms(first: Rows, theta: Array, x: NDArray[Any], names: Sequence[str], prior: Any) -> list[Term]:
    """All that are finite and not constant on these rows; constants are named apart, by `constant_words`."""
    flat = np.asarray(x, dtype=float).reshape(len(x), -1)
    found = []
    if is_counts(flat):
        each, total = gammaln(flat + 1.0).sum(-1), gammaln(flat.sum(-1) + 1.0)
        found += [
            Term("factorial", "sum log x!", each, of_data=True),
            Term("factorial", "the multinomial coefficient log(N! / prod x!)", total - each, of_data=True),
            Term("factorial", "log N! of the total N", total, of_data=True),
            Term(
                "deviance",
                "sum (x log x - x), which the C statistic leaves out",
                (xlogy(flat, flat) - flat).sum(-1),
                of_data=True,
            ),
            Term("data term", "the total of the data", flat.sum(-1), (), of_data=True),
        ]
        nothing = first.attempt(theta, np.zeros_like(x))
        if nothing is not None:
            found.append(
                Term("expected total", "the log likelihood of no counts (the expected total)", nothing)
            )
    with np.errstate(all="ignore"):
        found.append(Term("jacobian", "sum log |x| (a Jacobian)", np.log(np.abs(flat)).sum(-1), of_data=True))
        found.append(Term("data term", "sum x^2", np.square(flat).sum(-1), (0.5, -0.5), of_data=True))
        if callable(getattr(prior, "log_prob", None)):
            found.append(Term("prior", "the log prior", np.asarray(prior.log_prob(theta), dtype=float)))
        for j, name in enumerate(names):
            usual = (1.0, -1.0, 0.5, -0.5, float(flat.shape[1]), -float(flat.shape[1]))
            found.append(Term("parameter term", f"log {name}", np.log(np.abs(theta[:, j])), usual))
            found.append(Term("parameter term", f"log(1 - {name})", np.log1p(-theta[:, j]), usual))
            found.append(Term("parameter term", name, theta[:, j], ()))
        if len(names) > 1:
            found.append(Term("jacobian", "sum log theta (a Jacobian)", np.log(np.abs(theta)).sum(-1)))
    return [term for term in found if _varies(term.values)]


def _varies(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) > len(values) // 2 and np.ptp(finite) > 1e-9 * np.max(np.abs(finite)))


def is_counts(flat: Array) -> bool:
    """Whether data are whole numbers, none negative."""
    return bool(np.isfinite(flat).all() and (flat >= 0).all() and (flat == np.rint(flat)).all())


def constant_words(
    value: float, x: NDArray[Any], theta: Array, prior: Any, constants: Mapping[str, float]
) -> tuple[str, str]:
    """What a constant difference usually is, and the words for it: a name, and the constant spelled out."""
    flat = np.asarray(x, dtype=float).reshape(len(x), -1)
    known: list[tuple[str, str, float]] = []
    if callable(getattr(prior, "log_prob", None)):
        known.append(
            ("prior", "the log density of the (uniform) prior", float(np.ravel(prior.log_prob(theta[:1]))[0]))
        )
    if is_counts(flat) and np.ptp(flat.sum(-1)) == 0 and flat[0].sum() > 1:
        known.append(
            ("factorial", f"log N! of the total N = {flat[0].sum():.0f}", float(gammaln(flat[0].sum() + 1)))
        )
    if is_counts(flat) and len(np.unique(flat, axis=0)) == 1:
        known.append(("factorial", "sum log x!", float(gammaln(flat[0] + 1.0).sum())))
    for name, words, size in known:
        for sign in (1.0, -1.0):
            if _close(value, sign * size):
                return name, f"{'' if sign > 0 else 'minus '}{words}"
    for name, words, unit in (
        ("2 pi", "log(2 pi) / 2", 0.5 * math.log(2.0 * math.pi)),
        *(
            (f"log {key}", f"log {key}", math.log(size))
            for key, size in constants.items()
            if size > 0 and size != 1
        ),
        ("log 2", "log 2", math.log(2.0)),
        ("pi", "log(pi) / 2", 0.5 * math.log(math.pi)),
        ("log 10", "log 10", math.log(10.0)),
    ):
        times = round(value / unit)
        if 0 < abs(times) <= 10_000 and _close(value, times * unit):
            count = flat.shape[1]
            of = "" if abs(times) != count or count == 1 else ", one for each datum"
            return name, f"{times} times {words}{of}"
    for n in {*range(3, 21), *flat.shape[1:]}:
        if _close(abs(value), float(gammaln(n + 1.0))):
            return "factorial", f"{'minus ' if value < 0 else ''}log {n}!"
        if _close(abs(value), math.log(n)):
            return "constant", f"{'minus ' if value < 0 else ''}log {n}"
    return "constant", "a constant of the normalisation"


def factor_name(factor: float, shape: tuple[int, ...], terms_too: bool) -> tuple[str, str]:
    """What the ratio of two log likelihoods usually is, and the words for it."""
    sizes = [size for size in dict.fromkeys((math.prod(shape), *shape)) if size > 1]
    for name, words, value in (
        ("sign", "the sign is turned", -1.0),
        ("deviance", "it is a deviance, -2 log L", -2.0),
        ("deviance", "the other is a deviance, -2 log L", -0.5),
        ("log10", "it is a logarithm to base 10", 1.0 / math.log(10.0)),
        ("log10", "the other is a logarithm to base 10", math.log(10.0)),
        ("log2", "it is a logarithm to base 2", 1.0 / math.log(2.0)),
        ("log2", "the other is a logarithm to base 2", math.log(2.0)),
        *(("mean for sum", f"a mean over {size} stands for a sum", 1.0 / size) for size in sizes),
        *(
            ("mean for sum", f"a mean over {size} stands for a sum in the other", float(size))
            for size in sizes
        ),
    ):
        if _close(factor, value):
            return name, f"{words} (factor {factor:.8g})"
    if terms_too and any(_close(factor, value) for value in (2.0, 0.5)):
        return (
            "temperature",
            f"all but what is named beside it is taken {factor:g} times: a half too few or too many",
        )
    return "temperature", f"a power (temperature) of {factor:.8g}"


def _close(value: float, other: float) -> bool:
    return math.isclose(value, other, rel_tol=1e-8, abs_tol=1e-9)
