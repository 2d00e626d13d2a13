"""What is told of the causes of each symptom."""

from __future__ import annotations

import pytest

from gaugeblock.diagnosis.causes import CAUSES, UNREACHED, UNSCALED, Cause, causes

SCALE = "standardise x, in training and in sample(), where the network does not"


@pytest.mark.parametrize("symptom", ["scale", "x_noise"])
def test_what_goes_either_way_has_causes_for_each(symptom: str) -> None:
    assert causes(symptom) == CAUSES[f"{symptom} too narrow"]
    assert causes(symptom, wide=True) == CAUSES[f"{symptom} too wide"]
    assert CAUSES[f"{symptom} too narrow"] != CAUSES[f"{symptom} too wide"]


def test_others_have_theirs_and_what_is_unknown_none() -> None:
    for symptom, known in CAUSES.items():
        for wide in (False, True):
            assert causes(symptom, wide=wide) == known
    assert causes("nothing of ours", wide=True, spread=(1e-9, 1e9)) == ()


@pytest.mark.parametrize(
    ("spread", "told"),
    [
        ((1.0, UNSCALED), None),
        ((1.0, 123.456), "1 to 123"),
        ((1 / UNSCALED, 1.0), None),
        ((0.00123, 0.5), "0.00123 to 0.5"),
        ((1e-3, 1e3), "0.001 to 1e+03"),
        ((2.0, 3.0), None),
        (None, None),
    ],
)
def test_data_that_are_not_scaled_come_first(spread: tuple[float, float] | None, told: str | None) -> None:
    for symptom in UNREACHED:
        first = (
            () if told is None else (Cause(f"x is not scaled: its standard deviations are {told}", SCALE),)
        )
        assert causes(symptom, spread=spread) == (*first, *CAUSES[symptom])
    wide = causes("scale", wide=True, spread=spread)
    assert len(wide) == len(CAUSES["scale too wide"]) + (told is not None)
    assert causes("scale", spread=spread) == CAUSES["scale too narrow"]
    assert causes("shift", spread=spread) == CAUSES["shift"]
