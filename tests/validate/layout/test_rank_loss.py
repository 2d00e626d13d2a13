"""What a column foretells, by loops over a few trials with ties and weights."""

import numpy as np
import pytest

from gaugeblock.validate.layout import rank_loss
from gaugeblock.validate.layout.rank_loss import ColumnLoss, Foretelling, foretellings, share_below
from gaugeblock.validate.layout.readings import AS_IT_IS, LayoutReading, readings


def share(truths, value):
    return sum((t < value) + 0.5 * (t == value) for t in truths) / len(truths)


def test_ties_count_half_and_no_number_is_none():
    order = np.array([1.0, 2.0, 2.0, 4.0])
    values = np.array([0.0, 1.0, 1.5, 2.0, 4.0, 5.0, np.nan])
    np.testing.assert_array_equal(share_below(order, values), [0.0, 1 / 8, 1 / 4, 1 / 2, 7 / 8, 1.0, np.nan])


def losses(truths, draws, weight):
    """Square error of the mean share, less the weighted spread over one less than as many draws."""
    found = []
    for truth, row, w in zip(truths, draws, weight, strict=True):
        w = w / w.sum()
        shares = np.array([share(truths, value) for value in row])
        mean = w @ shares
        number = 1 / (w @ w)
        alone = max(1 - 1 / number, 2.0**-52)
        found.append((share(truths, truth) - mean) ** 2 - w @ (shares - mean) ** 2 / number / alone)
    return np.array(found)


@pytest.mark.parametrize("weighted", [False, True])
def test_losses_trial_by_trial(weighted):
    rng = np.random.default_rng(1)
    truths = rng.integers(0, 9, size=(12, 2)).astype(float)
    draws = truths[:, None] + rng.integers(-2, 3, size=(12, 5, 2))
    weight = rng.exponential(size=(12, 5)) if weighted else None
    if weighted:
        weight[0] = [0, 0, 3.0, 0, 0]
    counted = np.ones((12, 5)) if weight is None else weight
    found = foretellings(truths, draws, weight=weight)
    for parameter in range(2):
        own = losses(truths[:, parameter], draws[..., parameter], counted)
        for column in range(2):
            loss = losses(truths[:, parameter], draws[..., column], counted)
            (one,) = (
                f for f in found
                if (f.parameter, f.column, f.reading) == (parameter, column, AS_IT_IS)
            )  # fmt: skip
            assert one.loss == pytest.approx(loss.mean())
            assert one.gain == pytest.approx((own - loss).mean(), abs=1e-12)
            error = (own - loss).std(ddof=1) / np.sqrt(12)
            assert one.standard_error == pytest.approx(error, abs=1e-12)
            assert one.z == pytest.approx((own - loss).mean() / error if parameter != column else 0.0)


@pytest.mark.parametrize(("size", "fitted"), [(1e300, 4), (1e307, 4), (1.7e308, 1)])
def test_draws_up_to_the_largest_double_have_readings(size, fitted):
    """Where their quartiles are farther apart than any number, an offset alone is left."""
    truth = np.linspace(-1.0, 1.0, 50)
    draws = size * np.repeat(np.sign(truth)[:, None], 20, axis=1)
    found = [one for one in readings(truth, draws) if one.fitted]
    assert len(found) == fitted
    assert all(np.isfinite([one.unit, one.offset]).all() and one.unit > 0 for one in found)
    if fitted > 1:
        assert found[1].unit == pytest.approx(np.ptp(np.quantile(truth, [0.25, 0.75])) / (2 * size))


def test_readings_are_tried_of_all_columns_of_few_parameters_and_of_the_own_of_many(monkeypatch):
    rng = np.random.default_rng(2)
    truths = 10 ** rng.normal(size=(60, 3))
    draws = truths[:, None] * 10 ** (0.1 * rng.normal(size=(60, 8, 3)))
    draws[..., 2] = np.log10(draws[..., 2])
    found = foretellings(truths, draws)
    pairs = {(f.parameter, f.column) for f in found if f.reading != AS_IT_IS}
    assert {(0, 2), (1, 2), (2, 2)} <= pairs
    best = max((f for f in found if f.parameter == 2), key=lambda f: f.gain)
    assert best.column == 2
    assert best.reading != AS_IT_IS
    assert best.z > 5
    monkeypatch.setattr(rank_loss, "EVERYWHERE", 3)
    assert foretellings(truths, draws) == found
    monkeypatch.setattr(rank_loss, "EVERYWHERE", 2)
    fewer = foretellings(truths, draws)
    assert {(f.parameter, f.column) for f in fewer if f.reading != AS_IT_IS} <= {(0, 0), (1, 1), (2, 2)}
    assert [f for f in found if f.column == f.parameter or f.reading == AS_IT_IS] == fewer


def test_gains_without_any_error_are_no_evidence():
    assert Foretelling(0, 0, AS_IT_IS, 0.1, 0.2, 0.05).z == pytest.approx(4.0)
    assert Foretelling(0, 0, AS_IT_IS, 0.1, 0.2, 0.0).z == 0.0
    assert isinstance(AS_IT_IS, LayoutReading)
    column = ColumnLoss.of(np.array([[3.0, 1.0], [2.0, 2.0]]), np.array([[1.0, 3.0], [5.0, 5.0]]))
    assert column.ordered.tolist() == [1.0, 2.0, 2.0, 3.0]
    assert column.weight.tolist() == [[0.25, 0.75], [0.5, 0.5]]
