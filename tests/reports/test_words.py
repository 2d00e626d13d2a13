from dataclasses import replace

import pytest

from gaugeblock.reports.reason import reason
from gaugeblock.reports.words import number, short
from gaugeblock.validate import Gate, NotChecked, Outcome, Verdict


def gate(outcome: Outcome, *, name: str = "sbc.bias[a]", statistic: float = 0.1, **options) -> Gate:
    return Gate(
        id=name, outcome=outcome, statistic=statistic, interval=(0.0, 0.2), pass_interval=(0.05, 0.15),
        tolerance=0.1, p_value=None, p_adjusted=None, n_trials=100, smallest_detectable=0.2,
        component="a", message="m",
        **{"trials_to_settle": None, **options},
    )  # fmt: skip


def verdict(*gates: Gate, outcome: Outcome, not_checked: tuple[NotChecked, ...] = ()) -> Verdict:
    return Verdict(outcome=outcome, gates=gates, not_checked=not_checked)


def test_pass_says_how_many_and_names_what_is_optional_and_open():
    said = reason(
        verdict(
            gate(Outcome.PASS),
            gate(Outcome.INCONCLUSIVE, name="importance.ess", required=False),
            outcome=Outcome.PASS,
        )
    )
    assert said == (
        "The one required gate passed: inside the tolerance with 95% confidence. "
        "Not required, and not decided: importance.ess."
    )


def test_fail_names_the_gates_even_those_not_required():
    said = reason(
        verdict(
            gate(Outcome.PASS),
            gate(Outcome.FAIL, name="importance.ess", required=False),
            outcome=Outcome.FAIL,
        )
    )
    assert said == "1 of 2 gates failed by more than chance explains: importance.ess."


def test_inconclusive_says_how_many_trials_would_settle_it():
    open_gate = gate(Outcome.INCONCLUSIVE, trials_to_settle=1637)
    other = replace(open_gate, id="sbc.bias[b]", trials_to_settle=400)
    said = reason(verdict(open_gate, other, outcome=Outcome.INCONCLUSIVE))
    assert said == (
        "2 of 2 required gates could not be decided: sbc.bias[a] and sbc.bias[b]. "
        "About 1,700 trials would settle it, if the estimates hold."
    )


def test_inconclusive_promises_no_number_where_one_gate_has_none():
    said = reason(
        verdict(
            gate(Outcome.INCONCLUSIVE, trials_to_settle=1637),
            gate(Outcome.INCONCLUSIVE),
            outcome=Outcome.INCONCLUSIVE,
        )
    )
    assert "would settle" not in said


def test_a_required_check_that_could_not_be_made_is_named_as_that():
    missing = gate(Outcome.INCONCLUSIVE, name="importance.ess", statistic=float("nan"))
    said = reason(verdict(gate(Outcome.PASS), missing, outcome=Outcome.INCONCLUSIVE))
    assert said == "What the policy requires could not all be checked: importance.ess."
    assert "requires" in reason(verdict(outcome=Outcome.INCONCLUSIVE))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.5, "−0.5"),
        (123456.7, "123,457"),
        (1e-5, "1e−5"),
        (float("inf"), "∞"),
        (2.5e7, "2.5e7"),
    ],
)
def test_short_numbers(value: float, text: str):
    assert short(value) == text


def test_no_minus_zero():
    assert number(-1e-9, 3, sign=True) == "0.000"
