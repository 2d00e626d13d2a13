"""Samples stacked or run by run: what the truths tell of their axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gaugeblock import trials_from_numpyro
from gaugeblock.core.errors import InputError

RNG = np.random.default_rng(1)


class Run:
    """As an MCMC that was run."""

    def __init__(self, samples: Any):
        self.samples = samples

    def get_samples(self, group_by_chain: bool = False) -> Any:
        assert group_by_chain
        return self.samples


@pytest.mark.parametrize(
    ("shape", "truth", "draws"),
    [
        ((4, 10), (4,), (4, 10, 1)),
        ((4, 2, 10), (4,), (4, 20, 1)),
        ((4, 5, 5), (4,), (4, 25, 1)),
        ((4, 8, 1), (4,), (4, 8, 1)),
        ((4, 10, 3), (4, 3), (4, 10, 3)),
        ((4, 2, 10, 3), (4, 3), (4, 20, 3)),
    ],
)
def test_chains_are_put_one_after_the_other(
    shape: tuple[int, ...], truth: tuple[int, ...], draws: tuple[int, ...]
) -> None:
    samples, true = RNG.normal(size=shape), RNG.normal(size=truth)
    found = trials_from_numpyro({"a": samples, "more": samples}, {"a": true}, names=["a"])
    np.testing.assert_array_equal(found["draws"].values, samples.reshape(draws))
    np.testing.assert_array_equal(found["theta_true"].values, true.reshape(4, -1))
    assert found.attrs["autocorrelated"] == 1
    plain = trials_from_numpyro({"a": samples}, {"a": true}, autocorrelated=False)
    assert "autocorrelated" not in plain.attrs


def test_vectors_do_not_pass_as_chains() -> None:
    with pytest.raises(InputError) as caught:
        trials_from_numpyro({"a": np.zeros((4, 6, 5))}, {"a": np.zeros(4)})
    assert str(caught.value) == (
        "trials_from_numpyro, variable a: samples have the shape (4, 6, 5), which with truths (4,) means 6 "
        "chains of 5 draws; if so, join the chains: (trial, draw, ...)"
    )


def test_runs_have_chains_whatever_their_number() -> None:
    """Of each run the chains are known, so that more of them than draws are no doubt."""
    samples = RNG.normal(size=(4, 6, 5))
    runs = [Run({"a": one, "b": one[..., None] + [1, 2]}) for one in samples]
    truths = [{"a": k, "b": [k, k + 1], "y": "words"} for k in range(4)]
    found = trials_from_numpyro(runs, truths)
    np.testing.assert_array_equal(found["draws"].values[..., 0], samples.reshape(4, 30))
    np.testing.assert_array_equal(found["draws"].values[..., 2], samples.reshape(4, 30) + 2)
    assert found["theta_true"].values[3].tolist() == [3.0, 3.0, 4.0]
    assert found["parameter"].values.tolist() == ["a", "b[0]", "b[1]"]
    held = {"a": np.arange(4), "b": np.zeros((4, 2)), "y": np.arange(8).reshape(4, 2)}
    assert trials_from_numpyro(runs, held, x="y")["x"].values.tolist() == held["y"].tolist()
    with pytest.raises(InputError) as caught:
        trials_from_numpyro(runs[0], truths)
    assert str(caught.value) == (
        "trials_from_numpyro: one MCMC is one trial; give a list of them, one per simulated data set"
    )
