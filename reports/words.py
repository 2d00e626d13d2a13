"""Numbers and sentences as people read them; shared by the HTML page and the step summary."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gaugeblock.validate import Finding, Gate

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"

_QUESTIONS = {
    "draws.finite": "Is every draw a finite number?",
    "sbc.bias": "Is the posterior centred on the truth?",
    "sbc.log_width": "Is the posterior as wide as its errors are large?",
    "tails.outliers": "Do draws stray where truths never are, or truths where no draws are?",
    "tails.coverage": "Do the outermost intervals hold the truth as often as they claim?",
    "coverage.central": "Do credible intervals hold the truth as often as they claim?",
    "local.coverage": "Do credible intervals hold the truth as often everywhere in the data?",
    "posterior_sbc.bias": "Is the posterior centred on the truth for data like the observation?",
    "posterior_sbc.log_width": "Is it as wide as its errors are large for data like the observation?",
    "c2st.rank": "Can anything that was learned tell truths from draws?",
    "informed.rank": "Is what the data say in the draws?",
    "informed.crps": "How much is learned of it, over the prior?",
    "lc2st.local": "Where in the data can it?",
    "joint.likelihood": "Are all parameters together right, and right for their data?",
    "joint.hpd": "Do joint highest-density regions hold the truth as often as they claim?",
    "joint.tarp": "Do balls of draws hold the truth as often as they claim?",
    "joint.projections": "Are the parameters right together as well as one by one?",
    "joint.quantity": "Is a quantity of your own as often in its intervals as they claim?",
    "density.normalisation": "Is the log density normalised over its own draws?",
    "models.reliability": "Is the model true as often as it is said to be?",
    "models.confidence": "Is the most probable model the true one as often as it is said to be?",
    "evidence.pull": "Do log evidences lie within their stated errors of the truth?",
    "identifiability.shrink": "How much narrower than the prior is the posterior?",
    "identifiability.capture": "How much of the exact constraint does the estimator capture?",
    "anytime.bias": "Is the posterior centred on the truth, at whatever trial one stops?",
    "anytime.log_width": "Is it as wide as its errors are large, at whatever trial one stops?",
    "anytime.coverage": "Do intervals hold the truth as often as they claim, at whatever trial one stops?",
    "anytime.joint": "Are parameters right together, and with the data, at whatever trial one stops?",
    "anytime.hpd": "Do highest-density regions hold the truth as often as they claim, at any trial?",
    "importance.ess": "How much of each posterior survives reweighting to the exact one?",
}
_UNITS = {
    "bias": "half-widths",
    "log_width": "natural log of the width ratio",
    "coverage": "fraction of trials",
    "joint": "fraction of trials",
    "local": "coverage gap, as in a twentieth of the trials",
    "informed": "probability",
    "models": "share of trials less probability",
    "normalisation": "natural log of the density",
    "outliers": "share of draws",
    "tails": "fraction of trials",
    "ess": "fraction of draws",
}


def parameter_of(identifier: str) -> str:
    """Parameter named in a gate's id, or an empty string.

    >>> parameter_of("sbc.bias[tbabs_1.nh]"), parameter_of("coverage.central")
    ('tbabs_1.nh', '')
    """
    head, bracket, rest = identifier.partition("[")
    return rest.removesuffix("]") if bracket and head else ""


def question(gate: Gate, finding: Finding | None) -> str:
    """What a gate asked, as a question; for a validator unknown here, what its finding claims to measure."""
    known = _QUESTIONS.get(gate.id.partition("[")[0])
    return known or (finding.claim if finding is not None else gate.id)


def unit(quantity: str) -> str:
    """Unit of a tolerance, as a person says it; empty where the number is bare."""
    return _UNITS.get(quantity, "")


def decimals_for(spread: float) -> int:
    """Decimals that show two significant digits of an uncertainty of this size.

    >>> decimals_for(0.062), decimals_for(3.1), decimals_for(420.0)
    (3, 1, 0)
    """
    if not math.isfinite(spread) or spread <= 0:
        return 3
    return min(max(1 - math.floor(math.log10(spread)), 0), 8)


def number(value: float | None, decimals: int = 3, *, sign: bool = False) -> str:
    """Fixed decimals, a true minus sign, thousands apart; an en dash for what is not a number.

    >>> number(-0.01234), number(0.5, 2, sign=True), number(None), number(-0.0001)
    ('−0.012', '+0.50', '–', '0.000')
    """
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else MINUS + "∞"
    rounded = round(float(value), decimals) + 0.0
    rounded = 0.0 if rounded == 0 else rounded
    text = f"{abs(rounded):,.{decimals}f}"
    return (MINUS if rounded < 0 else "+" if sign and rounded > 0 else "") + text


def short(value: float | None, digits: int = 3) -> str:
    """Significant digits, without an exponent where a person would not want one.

    >>> short(0.00012345), short(1234567.0), short(0.5), short(-12.0), short(4000), short(1.03, 4)
    ('1.23e−4', '1.23e6', '0.5', '−12', '4,000', '1.030')
    """
    if value is None or not math.isfinite(value):
        return number(value)
    size = abs(value)
    if value == int(value) and size < 1e6:
        text = f"{int(value):,}"
    elif not 1e-3 <= size < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        text = f"{float(mantissa):g}e{int(exponent)}"
    else:
        # More digits than usual are asked for where an interval gives them a meaning: zeros among them too.
        kept = "#" if digits > 3 else ""
        text = f"{value:,.0f}" if size >= 10**digits else f"{value:{kept}.{digits}g}".rstrip(".")
    return text.replace("-", MINUS)


def probability(p: float | None) -> str:
    """A p-value: two significant digits, never a string of zeros.

    >>> probability(0.0421), probability(1e-7), probability(0.5), probability(None)
    ('0.042', '< 0.001', '0.50', '–')
    """
    if p is None or not math.isfinite(p):
        return NOTHING
    if p < 0.001:
        return "< 0.001"
    return f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def p_equals(p: float | None) -> str:
    """`p = 0.042`, `p < 0.001`, or nothing where there is no p-value.

    >>> p_equals(0.5), p_equals(1e-9), p_equals(None)
    ('p = 0.50', 'p < 0.001', '')
    """
    text = probability(p)
    return "" if text == NOTHING else f"p {text}" if text.startswith("<") else f"p = {text}"


def interval(bounds: tuple[float, float], decimals: int) -> str:
    """`lo to hi`, with "at least" or "at most" where one side is open.

    >>> interval((-0.1, 0.2), 2), interval((0.3, float("inf")), 1), interval((float("nan"),) * 2, 1)
    ('−0.10 to 0.20', 'at least 0.3', '–')
    """
    low, high = bounds
    open_below, open_above = not math.isfinite(low), not math.isfinite(high)
    if open_below and open_above:
        return NOTHING
    if open_above:
        return f"at least {number(low, decimals)}"
    if open_below:
        return f"at most {number(high, decimals)}"
    return f"{number(low, decimals)} to {number(high, decimals)}"


def cut(text: str, most: int = 22) -> str:
    """A text that has room: its middle left out where it is longer than `most`.

    >>> cut("powerlaw_1.alpha @ 0.9", 13), cut("short")
    ('powerl…@ 0.9', 'short')
    """
    half = (most - 1) // 2
    return text if len(text) <= most else f"{text[:half]}\N{HORIZONTAL ELLIPSIS}{text[-half:].lstrip()}"


def count(amount: int, noun: str) -> str:
    """`1 gate`, `4,000 trials`."""
    return f"{amount:,} {noun}{'' if amount == 1 else 's'}"


def listed(names: Sequence[str], *, last: str = "and", most: int | None = None) -> str:
    """Names in a sentence: `a, b and c`; of more than `most`, `a, b, c, d and 7 more`.

    >>> listed(["a", "b", "c"]), listed(["a", "b"], last="or"), listed(list("abcdefg"), most=4)
    ('a, b and c', 'a or b', 'a, b, c, d and 3 more')
    """
    shown = list(names[:most])
    shown += [f"{len(names) - len(shown)} more"] if len(names) > len(shown) else []
    return f"{', '.join(shown[:-1])} {last} {shown[-1]}" if len(shown) > 1 else "".join(shown)


def decimals_of(gate: Gate) -> int:
    """Enough decimals to see a gate's interval, but no more than one beyond what its tolerance needs."""
    finite = [
        bound for bound in (*gate.interval, *gate.pass_interval, gate.statistic) if math.isfinite(bound)
    ]
    spread = (max(finite) - min(finite)) / 2 if finite else 0.0
    return min(decimals_for(spread), decimals_for(abs(gate.tolerance)) + 1)
