"""What gates say: the numbers of hand-made findings in words, of every quantity."""

import math

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate.family import Bounds, Judgeable
from gaugeblock.validate.finding import CountFinding, MeanFinding
from gaugeblock.validate.messages import gate_message
from gaugeblock.validate.verdict import Outcome


def said(
    quantity,
    components,
    estimate,
    *,
    half=0.01,
    low=None,
    high=0.05,
    fails=None,
    worst=0,
    outcome=Outcome.FAIL,
    kind=MeanFinding,
    n_trials=1234,
    smallest=None,
    details=None,
    **more,
):
    estimate = np.asarray(estimate, dtype=float)
    words = {"claim": "what it is", "null": "", "reference": "", "id": f"{quantity}.x"} | more
    if kind is MeanFinding:
        words["influence"] = np.zeros((len(estimate), 2))
    finding = kind(
        quantity=quantity, components=tuple(components), estimate=estimate, n_trials=n_trials,
        standard_error=np.zeros(len(estimate)), details=xr.Dataset(details or {}), **words,
    )  # fmt: skip
    ends = {"low": estimate - half, "high": estimate + half}
    none = np.full(len(estimate), np.nan)
    bound = Bounds(
        **ends, **{f"pass_{name}": value for name, value in ends.items()},
        p_value=none, p_adjusted=none, critical=3.0, next_critical=3.0,
    )  # fmt: skip
    item = Judgeable(finding=finding, low=-high if low is None else low, high=high)
    outside = (estimate > item.high) | (estimate < item.low)
    return gate_message(
        item, bound, outside if fails is None else np.array(fails), outcome, worst,
        budget=0.05, power=0.9, smallest_detectable=smallest, settled_by="2,000 would",
    )  # fmt: skip


def test_shifts_and_widths():
    assert said("bias", ["a", "b"], [0.3, -0.4], high=0.2) == (
        "b: posteriors lie 0.400 half-widths too low (-0.400 half-widths, 95% simultaneous -0.410 .. -0.390; "
        "tolerated 0.2)"
    )
    assert "a: posteriors lie 0.300 half-widths too high (+0.300" in said("bias", ["a"], [0.3], high=0.2)
    narrow = said("log_width", ["a @ 0.9"], [math.log(0.8)], high=math.log(1.1), half=math.log(1.05))
    assert narrow == (
        "a: central 90% intervals are 0.800 times as wide as they should be "
        "(95% simultaneous 0.762 .. 0.840; tolerated 0.909 .. 1.100)"
    )
    whole = said("log_width", ["a"], [math.log(2)], high=math.log(1.1))
    assert whole.startswith("a: posteriors are 2.000 times as wide")


def test_every_parameter_that_fails_is_named_once_at_its_worst_the_worst_first():
    found = said("coverage", ["a @ 0.5", "a @ 0.9", "b @ 0.5", "c @ 0.5"], [0.06, -0.08, 0.2, 0.01])
    assert found == (
        "b: central 50% intervals cover 0.700 (gap +0.200, 95% simultaneous +0.190 .. +0.210; "
        "tolerated 0.05); "
        "a: central 90% intervals cover 0.820 (gap -0.080, 95% simultaneous -0.090 .. -0.070; tolerated 0.05)"
    )
    # Where none fails it is the worst.
    one = said("coverage", ["a @ 0.5", "b @ 0.5"], [0.01, 0.02], worst=1, outcome=Outcome.PASS)
    assert one.startswith("b: central 50% intervals cover 0.520")
    assert "a:" not in one


def test_outliers_say_whose_they_are():
    assert said("outliers", ["a"], [0.02], half=0.001, high=0.01) == (
        "a: 2.00% more of the draws than of the truths lie more than 8 half-widths out (+0.0200, "
        "95% simultaneous "
        "+0.0190 .. +0.0210; tolerated 0.01)"
    )
    assert "2.00% more of the truths than of the draws" in said("outliers", ["a"], [-0.02], high=0.01)


def test_gaps_of_regions_three_by_name():
    names = ["tarp @ 0.5", "other @ highest", "third @ 0.5", "fourth @ 0.9", "fifth @ 0.9"]
    found = said("joint", names, [0.3, 0.25, 0.2, 0.15, -0.1])
    first, second, third, rest = (
        found.split("; and ")[0].split("; tolerated 0.05); ") + found.split("; and ")[1:]
    )
    assert (
        first == "tarp: 50% regions hold 0.800 of the truths (gap +0.300, 95% simultaneous +0.290 .. +0.310"
    )
    assert second.startswith("other: highest: the share of truths in it is off (gap +0.250")
    assert third.startswith("third: 50% regions hold 0.700 of the truths (gap +0.200")
    assert rest == "2 more"
    assert "more" not in said("joint", names[:3], [0.3, 0.25, 0.2])


def local(outcome=Outcome.FAIL, components=("x_1 > 3 @ 0.5",), estimate=(0.04,), **more):
    scale = np.full(len(components), 0.5)
    details = {"scale": ("component", scale), "features": 7} | more.pop("details", {})
    return said("local", components, estimate, high=0.02, half=0.01, outcome=outcome, details=details, **more)


def test_regions_of_trials():
    # A quarter of a twentieth; gaps are in units of its root.
    assert local() == (
        "x_1 > 3 (1% of the trials): 50% intervals hold 58% of the truths (56% to 60%, 95% "
        "simultaneous; tolerated "
        "46% to 54%)"
    )
    assert local(components=("x_1 > 3 (lower half) @ 0.5",)).startswith(
        "x_1 > 3 (1% of the trials): 58% of the truths lie in the lower half of their posteriors"
    )
    assert "the lowest 50% of a learned score hold 58%" in local(id="lc2st.x")
    # No share is below nothing or above all.
    assert "hold 100% of the truths (98% to 100%" in local(estimate=(0.25,), components=("x @ 0.5",))
    many = local(components=("a @ 0.5", "a @ 0.9", "b @ 0.5", "c @ 0.5"), estimate=(0.04, 0.04, -0.05, 0.02))
    assert many.startswith("b (1% of the trials): 50% intervals hold 40%")
    assert many.endswith("; and 1 more")
    passed = local(Outcome.PASS, estimate=(0.005,))
    assert passed.startswith(
        "no region that a tree of depth 3 over 7 features found is off by more than is tolerated;"
    )
    assert "nearest to it: x_1 > 3 (1% of the trials): 50% intervals hold 51%" in passed


def informed(estimate, number=2, **more):
    details = {
        "parameter": ("parameter", [f"p{i}" for i in range(number)]),
        "skill": ("parameter", np.linspace(0.5, 0.25, number)),
        "challenger_skill": ("parameter", np.linspace(0.75, 0.5, number)),
    }
    return said("informed", ["ridge"], [estimate], details=details, **more)


def test_what_was_learned():
    assert informed(0.1) == (
        "ridge: a challenger tells truths from draws (gap +0.100, 95% simultaneous +0.090 .. "
        "+0.110; tolerated 0.05); "
        "CRPS skill over the prior: p0 0.50 (a regression on the data: 0.75), p1 0.25 (a "
        "regression on the data: 0.50)"
    )
    assert informed(0.01, outcome=Outcome.PASS).startswith(
        "no challenger of ridge regressions and boosted trees does better by more than the "
        "tolerance (gap +0.010"
    )
    # Neither: what was seen, and of whom. Also where the estimate itself is on one side of the tolerance.
    for seen, half in ((0.055, 0.01), (0.045, 0.01), (0.0, 0.06)):
        assert informed(seen, half=half, outcome=Outcome.INCONCLUSIVE).startswith(
            "ridge: a challenger may tell truths from draws by more than is tolerated, or by less "
            f"(gap {seen:+.3f}, 95% simultaneous {seen - half:+.3f} .. {seen + half:+.3f}; tolerated 0.05); "
        )
    # What would PASS or FAIL, but for a doubt of something else, is told as it was seen.
    doubted = informed(0.01, outcome=Outcome.INCONCLUSIVE, doubt="x is alike")
    assert doubted.startswith("no challenger of ridge")
    eleven = informed(0.1, number=11)
    assert eleven.count("a regression") == 8
    assert eleven.endswith("3 more in the report")
    assert "more" not in informed(0.1, number=8)
    assert "skill" not in said("informed", ["ridge"], [0.1], details={
        name: ("parameter", np.zeros(0)) for name in ("parameter", "skill", "challenger_skill")
    })  # fmt: skip


def test_densities_models_and_weights():
    assert said("normalisation", [""], [0.2]) == (
        "the estimator's log density is 0.200 nat too low for its own draws (+0.200, 95% "
        "simultaneous +0.190 .. "
        "+0.210; tolerated 0.05)"
    )
    assert "0.200 nat too high" in said("normalisation", [""], [-0.2])
    details = {"happened": ("component", [0.25, 0.5]), "number": ("component", [1000, 20])}
    assert said("models", ["m1 @ 0.1 to 0.2", "m2 @ 0.4"], [0.1, 0.01], details=details) == (
        "m1: given 0.1 to 0.2, true in 0.250 of 1,000 trials (gap +0.100, 95% simultaneous +0.090 .. +0.110; "
        "tolerated 0.05)"
    )
    assert said("ess", [""], [0.1], low=0.5, high=1.0, sense="at-least") == (
        "median importance-sampling efficiency is 10.0% of draws (95% simultaneous 9.0% .. "
        "11.0%; at least 50% wanted)"
    )
    assert said("own", ["", "b"], [0.2, 0.1], high=0.15, fails=[True, False]) == (
        "what it is: 0.2 (95% simultaneous 0.19 .. 0.21); tolerated 0.15"
    )
    assert said("own", ["b"], [0.1], low=0.15, high=1, sense="at-least") == (
        "b: what it is: 0.1 (95% simultaneous 0.09 .. 0.11); at least 0.15"
    )


def test_what_is_neither_nor():
    open_ = said("bias", ["a"], [0.04], outcome=Outcome.INCONCLUSIVE)
    assert open_.endswith("; tolerated 0.05): 1,234 trials do not settle it; 2,000 would")
    for remark in ("doubt", "excuse"):
        shown = said("bias", ["a"], [0.0], outcome=Outcome.INCONCLUSIVE, **{remark: "x is alike"})
        assert shown.endswith(", but x is alike")
    assert "alike" not in said("bias", ["a"], [0.0], outcome=Outcome.PASS, excuse="x is alike")


@pytest.mark.parametrize(
    ("quantity", "fault"),
    [
        ("bias", "a bias of 0.100 half-widths"),
        ("log_width", "a width ratio of 0.905 or 1.105"),
        ("coverage", "a gap of 0.100"),
        ("tails", "a gap of 0.1000"),
        ("outliers", "a share of 10.00%"),
        ("joint", "a gap of 0.100"),
        ("normalisation", "an error of 0.100 nat"),
        ("ess", "an efficiency of 10.0%"),
        ("own", "a fault of 0.1"),
    ],
)
def test_a_pass_says_what_would_have_failed(quantity, fault):
    passed = said(quantity, ["a @ 0.5"], [0.0], outcome=Outcome.PASS, smallest=0.1)
    assert passed.endswith(f"; {fault} would FAIL with 90% power")
    for nothing in (None, math.inf):
        without = said(quantity, ["a @ 0.5"], [0.0], outcome=Outcome.PASS, smallest=nothing)
        assert passed == f"{without}; {fault} would FAIL with 90% power"


def test_numbers_that_are_none():
    assert said("finite", ["draws", "log q"], [0, 0], kind=CountFinding, high=0.0) == (
        "no draw or log density is NaN or infinite in 1,234 trials"
    )
    bad = said("finite", ["draws", "log q"], [3000, 0], kind=CountFinding, high=0.0, caveats=("a", "b"))
    assert bad.startswith("NaN or infinite: 3,000 draws (a; b). Look for")
    assert "log q" not in bad
