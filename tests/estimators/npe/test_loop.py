"""The training loop of a straight line, beside the same in NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.npe.bank import stream  # noqa: E402
from gaugeblock.estimators.npe.config import TrainingTable  # noqa: E402
from gaugeblock.estimators.npe.loop import train_default  # noqa: E402

ROWS, HELD_OUT = 40, 8
# Losses are taken every second step and after the last; checkpoints are of steps 4 and 8.
SHOWN = (2, 4, 6, 8, 9)


class Line(torch.nn.Module):
    """Scores foretold by a slope and an offset: what is made small is the square of what is missed."""

    def __init__(self, offset=0.2):
        super().__init__()
        self.line = torch.nn.Parameter(torch.tensor([-0.5, offset], dtype=torch.float64))

    def context(self, x):
        return self.line[0] * x + self.line[1]

    def log_prob(self, values, context):
        return -((values - context[:, None])[..., 0] ** 2)


class Pairs:
    """Rows of a line; data get new noise whenever they are taken."""

    def __init__(self):
        rng = np.random.default_rng(1)
        self.scores = rng.standard_normal((ROWS, 1))
        self.data = 2.0 * self.scores - 1.0

    def __len__(self):
        return ROWS

    def pairs(self, rows, rng):
        data = self.data[rows]
        return self.scores[rows], data + 0.1 * rng.standard_normal(data.shape)


def options(**changes):
    return TrainingTable(
        **{
            "simulations": ROWS, "validation": HELD_OUT / ROWS, "batch": 5, "learning_rate": 1.0, "steps": 9,
            "weight_decay": 0.1, "clip": 2.0, "average": 0.3, "checkpoint": 5, "seed": 3, **changes,
        }
    )  # fmt: skip


def by_hand(chosen):
    """Averaged weights after each step, losses of the steps, and validation losses after each."""
    bank, weights = Pairs(), np.array([-0.5, 0.2])
    average, first, second = weights.copy(), np.zeros(2), np.zeros(2)
    held_score, held_x = (part[:, 0] for part in bank.pairs(slice(32, None), stream(3, "validation")))
    averages, losses, held = [], [], []
    for step in range(chosen.steps):
        rng = stream(3, "step", step)
        score, x = (part[:, 0] for part in bank.pairs(rng.integers(0, 32, chosen.batch), rng))
        away = weights[0] * x + weights[1] - score
        losses.append(np.mean(away**2))
        gradient = np.array([np.mean(2 * away * x), np.mean(2 * away)])
        gradient *= min(1.0, chosen.clip / (np.linalg.norm(gradient) + 1e-6))
        turn = 0.2 * chosen.steps
        up = step < turn
        low, high = (0.04, 1.0) if up else (1.0, 1e-4)
        part = step / turn if up else (step - turn) / (chosen.steps - turn)
        rate = chosen.learning_rate * (low + (high - low) * (1 - math.cos(math.pi * part)) / 2)
        first = 0.9 * first + 0.1 * gradient
        second = 0.99 * second + 0.01 * gradient**2
        mean, square = first / (1 - 0.9 ** (step + 1)), second / (1 - 0.99 ** (step + 1))
        weights = weights * (1 - rate * chosen.weight_decay) - rate * mean / (np.sqrt(square) + 1e-8)
        average = average + max(1 - chosen.average, 1 / (step + 1)) * (weights - average)
        averages.append(average)
        held.append(np.mean((average[0] * held_x + average[1] - held_score) ** 2))
    return averages, losses, held


def trained(path, chosen, **more):
    network = Line(more.pop("offset", 0.2))
    curve = train_default(network, Pairs(), chosen, checkpoint=path / "checkpoint", key="this", **more)
    return network.line.detach().numpy(), curve


@pytest.mark.parametrize("keep", ["best", "last"])
def test_steps_averages_and_losses_are_those_of_a_loop_by_hand(tmp_path, keep):
    chosen = options(keep=keep)
    seen = []
    weights, curve = trained(tmp_path, chosen, progress=lambda *said: seen.append(said))
    averages, losses, held = by_hand(chosen)
    among = [held[step - 1] for step in SHOWN]
    best = SHOWN[int(np.argmin(among))]
    assert best == 2  # before the first checkpoint, which so has to keep it beside the average
    np.testing.assert_allclose(weights, averages[(best if keep == "best" else 9) - 1], rtol=1e-9)
    assert curve["step"] == list(SHOWN)
    np.testing.assert_allclose(curve["validation"], among, rtol=1e-9)
    np.testing.assert_allclose(curve["best"], min(among), rtol=1e-9)
    parts = np.split(losses, SHOWN[:-1])
    np.testing.assert_allclose(curve["training"], [part.mean() for part in parts], rtol=1e-9)
    assert seen == [("steps", step + 1, 9) for step in range(9)]


@pytest.mark.parametrize("keep", ["best", "last"])
def test_stopped_it_goes_on_from_its_last_checkpoint_and_from_no_other(tmp_path, keep):
    chosen = options(keep=keep)
    (tmp_path / "whole").mkdir()
    whole = trained(tmp_path / "whole", chosen)

    class Stopped(Exception):
        pass

    def stop(stage, done, total):
        if done == 7:
            raise Stopped

    with pytest.raises(Stopped):
        trained(tmp_path, chosen, progress=stop)
    seen = []
    # Other first weights do not matter: those of the checkpoint are taken.
    again = trained(tmp_path, chosen, offset=1e3, progress=lambda stage, done, total: seen.append(done))
    assert seen == [5, 6, 7, 8, 9]
    np.testing.assert_array_equal(again[0], whole[0])
    assert again[1] == whole[1]
    train_default(
        Line(), Pairs(), options(steps=1), checkpoint=tmp_path / "checkpoint", key="another",
        progress=lambda stage, done, total: seen.append(done),
    )  # fmt: skip
    assert seen[5:] == [1]


def test_losses_that_are_no_numbers_are_never_the_best(tmp_path):
    class Fails(Line):
        def log_prob(self, values, context):
            return super().log_prob(values, context) * (math.nan if self.taken() else 1.0)

        def taken(self):
            return len(seen) >= 4

    seen = []
    network = Fails()
    curve = train_default(
        network, Pairs(), options(), checkpoint=tmp_path / "checkpoint", key="this",
        progress=lambda *said: seen.append(said),
    )  # fmt: skip
    assert np.isfinite(curve["best"])
    np.testing.assert_array_equal(np.isfinite(curve["validation"]), [True, True, False, False, False])
    assert np.isfinite(network.line.detach().numpy()).all()
    seen = list(range(9))
    with pytest.raises(InputError, match="no finite loss in 9 steps"):
        train_default(Fails(), Pairs(), options(), checkpoint=tmp_path / "new", key="this")
