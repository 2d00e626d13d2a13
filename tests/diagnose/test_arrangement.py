"""What is written for columns that a diagnosis reads otherwise puts them right.

The columns are made from an exact posterior, so what should be written is known.
"""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from tests.validate.layout.test_layout import NAMES, posterior

from gaugeblock.diagnosis.arrangement import arrangement
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.repair import from_data, plain_repair
from gaugeblock.diagnosis.workflow import locate_and_name
from gaugeblock.stranger.mapping import Mapping

WRONG = {
    "two swapped": lambda draws: draws[..., [1, 0, 2]],
    "all in another order": lambda draws: draws[..., [2, 0, 1]],
    "log10": lambda draws: np.stack([draws[..., 0], np.log10(draws[..., 1]), draws[..., 2]], -1),
    "natural logs of all": lambda draws: np.log(draws),
    "another unit": lambda draws: draws * np.array([1.0, 1.0, 1000.0]),
    "degrees": lambda draws: draws * np.array([180 / np.pi, 1.0, 1.0]),
    "swapped and log10": lambda draws: np.stack([np.log10(draws[..., 1]), draws[..., 0], draws[..., 2]], -1),
}


def said(theta, draws, names=NAMES):
    cases = Cases(names, np.arange(len(theta)), theta, draws)
    found = locate_and_name(cases, seed=1, failed=True)
    return arrangement({"repair": plain_repair(found.repairs)}, names)


def mended(suggestion, draws, names=NAMES):
    """The draws as the suggestion's TOML would have them."""
    table = tomllib.loads(suggestion.toml)["estimator"]["parameters"]
    return Mapping.of(table, names, stranger=names).to_simulator(draws)


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_layout_gets_what_mends_it(kind):
    theta, draws = posterior(0, skewed=True, noise=(0.2, 0.3, 0.4), n=450)
    (suggestion,) = said(theta, WRONG[kind](draws))
    np.testing.assert_allclose(mended(suggestion, WRONG[kind](draws)), draws, rtol=0.35)
    assert suggestion.text.startswith("The draws look as if ")


def test_a_standardised_parameter_and_an_exponentiated_one():
    theta, draws = posterior(1, n=450)
    scaled = theta * np.array([1.0, 17.0, 1.0]) + np.array([0.0, 400.0, 0.0])
    (suggestion,) = said(scaled, draws)
    np.testing.assert_allclose(mended(suggestion, draws)[..., 1], draws[..., 1] * 17 + 400, rtol=0.06)
    (suggestion,) = said(theta, 10**draws)
    assert "a is drawn as 10 to the power of it" in suggestion.text
    np.testing.assert_allclose(mended(suggestion, 10**draws), draws, atol=1e-9)


@pytest.mark.parametrize("fault", ["nothing", "narrow", "biased"])
def test_a_miscalibrated_estimator_in_the_right_layout_gets_none(fault):
    theta, draws = posterior(3, correlation=0.9, n=450)
    center = draws.mean(axis=1, keepdims=True)
    changed = {
        "nothing": draws,
        "narrow": center + 0.3 * (draws - center),
        "biased": draws + 0.5 * draws.std(axis=1, keepdims=True),
    }[fault]
    assert said(theta, changed) == ()


def test_steps_are_put_together():
    steps = [
        {
            **{"function": "reordered", "order": [1, 0], "transforms": ["none", "none"]},
            **{"units": [1.0, 1.0], "offsets": [0.0, 0.0]},
        },
        {"function": "multiplied", "by": [1.0, 10.0]},
        {"function": "mirrored", "flipped": [False, True], "about": [0.0, 3.0]},
        {"function": "moved", "by": [0.5, 0.0], "in_widths": False},
        {"function": "stretched", "by": [2.0, 2.0], "about": "median"},
    ]
    (suggestion,) = arrangement({"repair": steps}, ("a", "b"))
    draws = np.array([[[1.0, 2.0]]])
    # a is column 1, less a half; b is column 0 times ten, mirrored about 3.
    np.testing.assert_allclose(mended(suggestion, draws, ("a", "b")), [[[1.5, -4.0]]])
    assert arrangement({"repair": steps[3:]}, ("a", "b")) == ()
    # A zero that is found first is in the unit of then; what follows a repair of shapes is no layout.
    steps = [{**steps[3], "by": [0.5, 1.0]}, steps[1], steps[4], steps[0]]
    (suggestion,) = arrangement({"repair": steps}, ("a", "b"))
    np.testing.assert_allclose(mended(suggestion, draws, ("a", "b")), [[[0.5, 10.0]]])
    assert arrangement({"named": "other"}, ("a", "b")) == ()


def test_a_hostile_name_stays_a_key_of_toml():
    names = ('a"\n[x]', "b\\", "c")
    step = {"function": "reordered", "order": [1, 0, 2], "transforms": PLAIN, "units": [1.0] * 3,
            "offsets": [0.0] * 3}  # fmt: skip
    (suggestion,) = arrangement({"repair": [step]}, names)
    assert set(tomllib.loads(suggestion.toml)["estimator"]["parameters"]) == set(names[:2])


PLAIN, LOGS = ["none"] * 3, ["none", "log10", "log"]
STEPS = {
    "multiplied": {"function": "multiplied", "by": [2.0, 1.0, 0.5]},
    "mirrored": {"function": "mirrored", "flipped": [True, False, True], "about": [1.0, 5.0, 0.0]},
    "moved": {"function": "moved", "by": [0.5, -1.0, 0.0], "in_widths": False},
    "ordered": {
        "function": "reordered", "order": [2, 0, 1], "transforms": PLAIN, "units": [3.0, 1.0, -1.0],
        "offsets": [0.5, 2.0, 0.0],
    },
    "read": {
        "function": "reread", "transforms": PLAIN, "units": [1.0, -2.0, 4.0], "offsets": [1.0, 0.0, -3.0]
    },
    "logs": {"function": "reread", "transforms": LOGS, "units": [1.0, 2.0, 3.0], "offsets": [0.0, 0.0, 0.5]},
    "ordered logs": {
        "function": "reordered", "order": [1, 2, 0], "transforms": LOGS, "units": [2.0, 1.0, 1.0],
        "offsets": [0.0, 0.0, 0.0],
    },
}  # fmt: skip


@pytest.mark.parametrize(
    "steps",
    [
        *([name] for name in STEPS if name != "moved"),
        ["multiplied", "mirrored", "moved"],
        ["moved", "mirrored", "ordered", "multiplied"],
        ["ordered", "ordered", "read"],
        ["read", "moved", "ordered", "mirrored"],
        ["logs", "ordered", "multiplied", "read"],
        ["ordered logs", "mirrored", "moved", "ordered"],
    ],
)
def test_what_is_written_does_what_the_repairs_do(steps):
    draws = np.random.default_rng(1).uniform(0.1, 2.0, (4, 5, 3))
    cases = Cases(("a", "b", "c"), np.arange(4), np.ones((4, 3)), draws)
    for name in steps:
        cases = from_data(STEPS[name], where="here")(cases)
    (suggestion,) = arrangement({"repair": [STEPS[name] for name in steps]}, ("a", "b", "c"))
    np.testing.assert_allclose(mended(suggestion, draws, ("a", "b", "c")), cases.draws, rtol=1e-6)


def test_what_is_said_of_two_columns():
    step = {"function": "reordered", "order": [1, 0, 2], "transforms": PLAIN, "units": [1.0, 2.0, 1.0],
            "offsets": [0.0] * 3}  # fmt: skip
    (suggestion,) = arrangement({"repair": [step]}, ("a", "b", "c"))
    head, _, last = suggestion.text.partition("; ")
    assert head == "The draws look as if a is in column 1, where b is expected"
    assert last.startswith("b is in column 0, where a is expected and is drawn as ")
    assert last.endswith(" (columns are counted from 0).")
    assert suggestion.toml.splitlines()[:2] == ["[estimator.parameters]", '"a" = { index = 1 }']
    assert len(suggestion.toml.splitlines()) == 3
