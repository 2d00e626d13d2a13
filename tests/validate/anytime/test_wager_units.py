"""What is asked of a sequence: edges that a policy tolerates, by quadrature, and back in its own unit."""

import numpy as np
import pytest
from scipy import integrate, stats

from gaugeblock.validate import make_policy
from gaugeblock.validate.anytime.anytime import bias_sequence, log_width_sequence
from gaugeblock.validate.anytime.sequence import gap_sequence
from gaugeblock.validate.anytime.wager_units import bias_of, hidden, log_width_of, question

POLICY = make_policy(
    {"required": ["sbc"], "tolerance": {"bias": 0.2, "log_width": 0.15, "coverage": 0.1}}, source="test"
)


def mean_of(function, *, shift=0.0, sd=1.0):
    """Of a normal number cut at 3 on either side."""
    cut = lambda z: function(np.clip(z, -3.0, 3.0)) * stats.norm.pdf(z, shift, sd)  # noqa: E731
    return sum(integrate.quad(cut, *ends, epsabs=1e-12)[0] for ends in ((-20, -3), (-3, 0), (0, 3), (3, 20)))


def square_ratio(log_width, shift=0.0):
    """Cut squares of truths about draws whose log width is off by so much, against those of exact ones.

    All in the draws' own sd: where they are too wide the squares are too small.
    """
    narrow = np.exp(-log_width)
    return mean_of(np.square, shift=shift, sd=narrow) / mean_of(np.square)


def score(seed):
    return np.random.default_rng(seed).normal(size=50).clip(-3, 3)


def test_an_exact_estimator_is_off_by_nothing_and_edges_are_the_tolerances():
    found = {
        "bias": (bias_sequence("a", score(1), np.zeros(50)), 0.2),
        "width": (log_width_sequence("a", score(2) ** 2, np.full(50, 0.99), draws=100.0), 0.15),
        "gap": (gap_sequence("anytime.coverage", "coverage", score(3)[None] > 0, [0.5], "x", claim=""), 0.1),
    }
    for kind, (finding, tolerance) in found.items():
        asked = question(finding, POLICY)
        assert asked.unit(np.array([asked.exact])) == pytest.approx(0.0, abs=2e-3), kind
        assert asked.falls == (kind == "width")
        one = float(asked.unit(asked.tolerable[0])[0])
        assert one == pytest.approx(tolerance if asked.falls else -tolerance, abs=2e-3), kind
        for low, high in (asked.tolerable, asked.passable):
            assert (low < asked.exact).all(), kind
            assert (high > asked.exact).all(), kind
            assert asked.edges[0] < low[0] < high[0] < asked.edges[1]


def test_the_edges_of_a_width_leave_room_for_a_bias():
    """Too wide is a ratio below 1; a hundred draws hide a twenty-fifth of a log width."""
    finding = log_width_sequence("a", score(2) ** 2, np.full(50, 0.99), draws=100.0)
    asked = question(finding, POLICY)
    off = 0.15 / 1.04
    np.testing.assert_allclose(asked.tolerable, [[square_ratio(off)], [square_ratio(-off, 0.2)]], rtol=2e-3)
    np.testing.assert_allclose(asked.passable, [[square_ratio(off, 0.2)], [square_ratio(-off)]], rtol=2e-3)


def test_units_there_and_back():
    for bias in (-0.7, 0.0, 0.3):
        assert float(bias_of(mean_of(lambda z: z, shift=bias))) == pytest.approx(bias, abs=1e-3)
    for log_width in (-0.4, 0.0, 0.25):
        ratio = square_ratio(log_width)
        assert float(log_width_of(ratio)) == pytest.approx(log_width, abs=2e-3)
        assert float(log_width_of(ratio, 50.0)) == pytest.approx(1.08 * log_width, abs=2e-3)
    assert hidden(np.inf) == 1.0
    assert hidden(8.0) == pytest.approx(1.5)
