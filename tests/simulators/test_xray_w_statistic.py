"""The W-statistic: its profile is the minimum. Its bias is shown in the tests of the joint background."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.w_statistic import profiled_background, w_statistic


@pytest.mark.parametrize("found", [0, 1, 7])
@pytest.mark.parametrize("other", [0, 1, 7])
@pytest.mark.parametrize("mean", [0.0, 0.2, 3.0])
@pytest.mark.parametrize("scale", [0.1, 1.0, 4.0])
def test_the_profile_is_the_minimum(found, other, mean, scale):
    def cost(behind):
        total = mean + scale * behind
        return (
            total
            + behind
            - (found * np.log(total) if found else 0.0)
            - (other * np.log(behind) if other else 0.0)
        )

    best = minimize_scalar(cost, bounds=(1e-12, 60.0), method="bounded", options={"xatol": 1e-10})
    behind = profiled_background(found, other, mean, scale)
    assert cost(max(float(behind), 1e-12)) <= best.fun + 1e-9
    # Twice what is lost against a mean of one's own for every count; added up over channels.
    own = sum(n - (n * np.log(n) if n else 0.0) for n in (found, other))
    expected = 2.0 * (cost(max(float(behind), 1e-300)) - own)
    assert w_statistic([found], [other], [mean], scale) == pytest.approx(expected, abs=1e-9)
    both = w_statistic([[found, 7], [7, found]], [other, 20], [[mean, 10.0], [10.0, mean]], [scale, 1.0])
    assert both.shape == (2,)
    assert both[0] - expected == pytest.approx(float(w_statistic([7], [20], [10.0], 1.0)), abs=1e-9)


def test_w_refuses_what_is_no_count():
    with pytest.raises(InputError, match="at least 0"):
        w_statistic([-1.0], [0.0], [1.0], 1.0)
    with pytest.raises(InputError, match="positive"):
        w_statistic([1.0], [0.0], [1.0], 0.0)
