"""What is said of what was found, word by word, and what is looked at before anything is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis import diagnosis as module
from gaugeblock.diagnosis.cases import DRAWS, TRIALS
from gaugeblock.diagnosis.causes import Cause, causes
from gaugeblock.diagnosis.diagnosis import (
    INPUTS,
    Asked,
    Diagnosis,
    Fault,
    cases_of,
    cures_said,
    diagnose,
    foretelling_inputs,
    spread_of_data,
    worded,
)
from gaugeblock.diagnosis.repair import Repair
from gaugeblock.diagnosis.workflow import Found, Tried
from gaugeblock.validate import Outcome, make_trials
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import trials_tree
from gaugeblock.validate.verdict import Gate


def mend(symptom: str, words: str = "draws are off", **options: Any) -> Repair:
    return Repair(symptom, lambda cases: cases, words, **options)


def tried(*repairs: Repair, share: float = 0.9, left: float = 0.1) -> Tried:
    return Tried(repairs, repairs, np.full(4, left), np.full(4, left), share, True)


NOTHING = tried(share=0.0, left=1.0)


def found(**changes: Any) -> Found:
    empty = Found((), None, (), (NOTHING,), False, (0.01234, 0.0056), None, {}, {})
    return replace(empty, **changes)


def said(
    it: Found, own: Any = None, *, called: bool = False, alone: bool = True, spread: Any = None
) -> Diagnosis:
    return worded(it, own or {}, called=called, alone=alone, spread=spread)


def test_nothing_is_seen_or_it_is_too_small() -> None:
    for alone, words in (
        (True, "nothing is seen to be wrong"),
        (False, "what is wrong is too small to be named"),
    ):
        made = said(found(), alone=alone, called=alone)
        assert made.text == f"{words}: truths are told from draws by 0.0123 +- 0.0056 nats a trial."
        assert (made.named, made.gap, made.called, made.causes) == (None, (0.01234, None), alone, ())


OTHER = (
    "something is wrong that the library has no name for: truths are told from draws by 0.0123 nats a trial"
)


@pytest.mark.parametrize(
    ("kinds", "where"),
    [
        ({}, ""),
        ({"tails": 0.0, "joint": -0.1}, ""),
        ({"tails": 0.2, "joint": 0.3, "shape": -0.5}, ", mostly in all parameters together"),
        ({"regions": 0.1}, ", mostly in some places and not in others"),
    ],
)
def test_what_has_no_name_and_where_it_shows(kinds: dict[str, float], where: str) -> None:
    made = said(found(seen=True, kinds=kinds))
    assert made.text == f"{OTHER}{where}, and no repair takes all of it away."
    assert (made.named, made.shows_in, made.runner_up, made.causes) == ("other", kinds, None, ())
    assert made.gap == (0.01234, None)


def test_what_comes_nearest_to_what_has_no_name() -> None:
    half, least = mend("skew", numbers={"a": 0.2}), mend("shift")
    every = (NOTHING, tried(least, share=0.2, left=0.8), tried(half, least, share=0.5, left=0.5))
    made = said(found(seen=True, tried=every))
    assert made.text == (
        f"{OTHER}, and no repair takes all of it away. skew and shift would take 50%. "
        f"{cures_said(causes('skew'))}"
    )
    assert (made.causes, made.runner_up) == (causes("skew"), "shift")
    fewer = (*every[:2], tried(half, share=0.49, left=0.51))
    made = said(found(seen=True, tried=fewer))
    assert made.text == f"{OTHER}, and no repair takes all of it away. skew would take 49%."
    assert (made.causes, made.runner_up) == ((), "skew")
    none = said(found(seen=True, tried=(NOTHING, tried(half, share=0.0, left=1.0))))
    assert none.text == f"{OTHER}, and no repair takes all of it away."
    # What the data say beyond the draws has causes of its own, and none is told twice.
    wide = mend("scale", numbers={"a": 1.5})
    made = said(found(seen=True, kinds={"data": 1.0}, tried=(NOTHING, tried(wide, share=0.6))))
    unused = causes("unused")
    assert made.causes[: len(unused)] == unused
    assert {each.cause for each in made.causes} == {
        each.cause for each in (*unused, *causes("scale", wide=True))
    }
    assert len({each.cause for each in made.causes}) == len(made.causes)
    # So has whatever a network learned from data that nobody scaled, wherever it shows.
    for kinds in ({}, {"prior": 1.0}, {"data": 1.0}):
        made = said(found(seen=True, kinds=kinds, tried=(NOTHING, tried(wide, share=0.6))), spread=(1.0, 1e3))
        unscaled = [each for each in made.causes if each.cause.startswith("x is not scaled")]
        assert unscaled == [made.causes[0]]


def test_what_is_named_first_and_what_it_would_take_to_tell() -> None:
    narrow = mend("scale", "draws are too narrow", numbers={"a": 0.5, "b": 1.2})
    chain = mend("autocorrelated", "draws depend on their order")
    alike = (tried(narrow), tried(mend("clipped_tails")), tried(mend("skew")), tried(mend("scale")))
    it = found(
        structural=(chain,),
        named=alike[0],
        alike=alike,
        tried=(NOTHING, *alike, tried(mend("shift"), share=0.3), tried(mend("log"), share=0.2)),
        seen=True,
        before=(0.5, 0.1),
        after=(0.0123, 0.2),
        kinds={"shape": 1.0},
        sizes={"a": (0.5, 0.4, 0.6)},
        to_tell={"clipped_tails": 12_000, "skew": None},
    )
    made = said(it)
    assert made.text == (
        "draws depend on their order; then draws are too narrow. Mended, truths are told from draws by 0.012 "
        "instead of 0.5 nats a trial. These trials do not tell it from: clipped_tails (some 12,000 would), "
        f"skew (nor would a hundred times as many). {cures_said(causes('autocorrelated'))}"
    )
    assert (made.named, made.named_all) == ("autocorrelated", ("autocorrelated", "scale"))
    assert made.indistinguishable == ("clipped_tails", "skew")
    assert made.trials_to_tell == {"clipped_tails": 12_000, "skew": None}
    assert (made.runner_up, made.gap, made.parameters) == ("shift", (0.5, 0.0123), {"a": (0.5, 0.4, 0.6)})
    assert made.repair == ()
    # A mean of the numbers of 1 or less is too narrow.
    for numbers, wide in (({"a": 0.5, "b": 1.5}, False), ({"a": 0.6, "b": 1.5}, True), ({}, False)):
        one = tried(mend("scale", numbers=numbers))
        plain = said(found(named=one, alike=(one,), seen=True, after=(-0.3, 0.1), before=(0.5, 0.1)))
        assert plain.causes == causes("scale", wide=wide)
        assert plain.text == (
            "draws are off. Mended, truths are told from draws by 0 instead of 0.5 nats a trial. "
            f"{cures_said(plain.causes)}"
        )
    # What stands for information that was not used is no repair.
    lost = tried(mend("x_noise", recovers=0.0))
    assert "Mended" not in said(found(named=lost, alike=(lost,), seen=True, after=(0.1, 0.1))).text


def test_faults_of_ones_own_have_their_own_causes() -> None:
    own = {"mine": Fault(lambda cases, reference: [], (Cause("a cause", "a cure"),))}
    one = tried(mend("mine"))
    made = said(found(named=one, alike=(one,), seen=True), own)
    assert made.text == "draws are off. Possible cause: a cause: a cure."
    assert cures_said((Cause("a", "b"), Cause("c", "d"))) == "Possible causes: a: b; c: d."
    assert cures_said(()) == ""


def gate(name: str, outcome: Outcome) -> Gate:
    return Gate(
        id=name, outcome=outcome, statistic=0.5, interval=(0.4, 0.6), pass_interval=(0.4, 0.6), tolerance=0.1,
        p_value=None, p_adjusted=None, n_trials=10, smallest_detectable=None, trials_to_settle=None,
        component="", message=f"{name} is off",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("failed", "draws", "density"),
    [
        ((), False, None),
        (("sbc.bias",), True, None),
        (("density.normalisation", "importance.ess"), False, "density.normalisation"),
        (("importance.ess", "sbc.bias"), True, None),
    ],
)
def test_what_a_verdict_asks(failed: tuple[str, ...], draws: bool, density: str | None) -> None:
    gates = tuple(
        gate(name, Outcome.FAIL if name in failed else Outcome.INCONCLUSIVE)
        for name in ("density.normalisation", "importance.ess", "sbc.bias")
    )
    for outcome in Outcome:
        asked = Asked.of(SimpleNamespace(gates=gates, outcome=outcome))  # type: ignore[arg-type]
        assert (asked.failed, asked.blocked) == (draws, outcome is Outcome.FAIL)
        assert (asked.density.id if asked.density else None) == density


def test_plain_data_and_the_line() -> None:
    made = Diagnosis(
        named="a", text="words", named_all=("a", "b"), indistinguishable=("c",), causes=(Cause("x", "y"),),
        parameters={"p": (1.0, 0.5, 1.5)}, gap=(0.3, 0.1), shows_in={"tails": 0.2}, called=True,
        repair=({"function": "f"},), seed=4, faults=("mine",), runner_up="d", trials_to_tell={"c": None},
    )  # fmt: skip
    assert made.to_json() == {
        "named": "a", "named_all": ["a", "b"], "indistinguishable": ["c"], "trials_to_tell": {"c": None},
        "runner_up": "d", "causes": [{"cause": "x", "cure": "y"}],
        "parameters": {"p": {"value": 1.0, "low": 0.5, "high": 1.5}}, "gap": {"before": 0.3, "after": 0.1},
        "shows_in": {"tails": 0.2}, "called": True, "repair": [{"function": "f"}], "seed": 4,
        "faults": ["mine"], "text": "words",
    }  # fmt: skip
    assert repr(made) == "<Diagnosis a: words>"
    assert repr(Diagnosis(named=None, text="words")) == "<Diagnosis nothing: words>"


def prepared(trials: int, draws: int, **further: Any) -> Prepared:
    rng = np.random.default_rng(2)
    theta, drawn = rng.normal(size=(trials, 2)), rng.normal(size=(trials, draws, 2))
    return Prepared(trials_tree(make_trials(theta, drawn, ["a", "b"], **further)), 1)


@pytest.mark.parametrize(("draws", "step"), [(40, 1), (DRAWS, 1), (2 * DRAWS - 1, 1), (3 * DRAWS + 5, 3)])
def test_cases_are_the_first_trials_with_draws_evenly_spaced(draws: int, step: int) -> None:
    it = prepared(160, draws)
    cases = cases_of(it)
    main = it.main
    row = {int(number): k for k, number in enumerate(main["trial"].values)} if "trial" in main.coords else {}
    rows = [row.get(int(number), int(number)) for number in cases.trial]
    assert sorted(rows) == list(range(160))
    np.testing.assert_array_equal(cases.theta, main["theta_true"].values[rows])
    np.testing.assert_array_equal(cases.draws, main["draws"].values[rows][:, ::step][:, :DRAWS])
    assert cases.x is None
    assert len(cases) <= TRIALS


def test_of_very_many_trials_the_first_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = cases_of(prepared(160, 20))
    for most in (159, 100, 1):
        monkeypatch.setattr(module, "TRIALS", most)
        cases = cases_of(prepared(160, 20))
        assert len(cases) == len(cases.trial) == len(cases.draws) == most
        np.testing.assert_array_equal(cases.theta, whole.theta[:most])


def test_draws_with_weights_are_as_often_there_as_these_say() -> None:
    rng = np.random.default_rng(4)
    weight = np.zeros((160, 20))
    heavy, light = rng.permuted(np.tile(np.arange(20), (160, 1)), axis=1)[:, :2].T
    weight[np.arange(160), heavy], weight[np.arange(160), light] = 3.0, 1.0
    it = prepared(160, 20, weight=weight)
    cases = cases_of(it)
    draws = it.main["draws"].values[cases.trial]
    for chosen, often in ((heavy, 15), (light, 5)):
        there = draws[np.arange(160), chosen[cases.trial]][:, None]
        number = (cases.draws == there).all(axis=2).sum(axis=1)
        assert (number[cases.trial > 0] == often).all()


def test_data_come_with_their_cases() -> None:
    x = np.random.default_rng(3).normal(size=(160, 3))
    cases = cases_of(prepared(160, 20, x=x))
    assert cases.x is not None
    # On scales of their own, which rise with the data's.
    order = np.argsort(x[cases.trial], axis=0)
    assert (np.diff(np.take_along_axis(cases.x[:, :3], order, axis=0), axis=0) >= 0).all()
    assert len(cases.inputs) == cases.x.shape[1]


def test_of_very_many_inputs_those_stay_that_foretell_truths() -> None:
    """Or their squares; in their own order, with their names, judged on a third of the trials."""
    rng = np.random.default_rng(5)
    theta = rng.normal(size=(900, 2))
    values = rng.normal(size=(900, 200)) * 10.0 ** rng.uniform(-3, 3, 200)
    values[:, 7] = 4.0
    values[:, 150] = theta[:, 0] + 3.0 * rng.normal(size=900)
    values[:, 31] = -(theta[:, 1] ** 2) + 2.0 * rng.normal(size=900)
    names = tuple(f"x{k}" for k in range(200))
    chosen, called = foretelling_inputs(values, names, theta)
    assert chosen.shape == (900, INPUTS)
    places = [int(name[1:]) for name in called]
    assert places == sorted(places)
    assert {31, 150} <= set(places)
    assert 7 not in places
    np.testing.assert_array_equal(chosen, values[:, places])
    few = values[:, :INPUTS]
    assert foretelling_inputs(few, names[:INPUTS], theta) == (pytest.approx(few), names[:INPUTS])


def test_how_widely_the_datas_channels_spread() -> None:
    x = np.random.default_rng(6).normal(size=(160, 4)) * [1.0, 0.01, 30.0, 0.0]
    x[155:] = 1e6  # which nobody looks at
    sd = x[:150].std(axis=0)
    assert spread_of_data(prepared(160, 10, x=x)) == pytest.approx((sd[1], sd[2]))
    assert spread_of_data(prepared(160, 10, x=np.ones((160, 2)))) is None
    assert spread_of_data(prepared(160, 10)) is None
    assert spread_of_data(prepared(160, 10, x=x.reshape(160, 2, 2))) == pytest.approx((sd[1], sd[2]))


def test_few_trials_do_not_say_and_ids_are_ones_own() -> None:
    rng = np.random.default_rng(2)
    theta, drawn = rng.normal(size=(149, 1)), rng.normal(size=(149, 10, 1))
    tree = xr.DataTree(make_trials(theta, drawn, ["a"]))
    verdict: Any = None
    made = diagnose(tree, verdict, seed=3, faults={"mine": Fault(lambda cases, reference: [])})
    assert made.text == "149 trials with finite draws do not say what is wrong: 150 are needed."
    assert (made.named, made.seed, made.faults) == (None, 3, ("mine",))
    for taken in ("shift", "other"):
        with pytest.raises(InputError) as caught:
            diagnose(
                tree, verdict, seed=3, faults={"mine": Fault(lambda c, r: []), taken: Fault(lambda c, r: [])}
            )
        assert str(caught.value) == f"faults: {taken} is the library's own: give yours another id"


def asked(draws: np.ndarray, *failed: str, x: np.ndarray | None = None, **options: Any) -> Diagnosis:
    """A diagnosis of 150 trials of few draws, of which the disagreement is not asked."""
    theta = np.random.default_rng(8).normal(size=(len(draws), 1))
    tree = xr.DataTree(make_trials(theta, draws, ["a"], x=x))
    gates = tuple(gate(name, Outcome.FAIL) for name in failed)
    verdict: Any = SimpleNamespace(gates=gates, outcome=Outcome.FAIL if gates else Outcome.INCONCLUSIVE)
    return diagnose(tree, verdict, seed=3, **options)


FEW = np.random.default_rng(7).normal(size=(150, 19, 1))


def test_a_density_that_a_gate_has_failed_of_draws_of_which_nothing_is_seen() -> None:
    made = asked(FEW, "density.normalisation", "importance.ess")
    assert made.text == (
        "of the draws nothing is wrong that these trials show; their log density is: density.normalisation "
        f"is off {cures_said(causes('log_q'))}"
    )
    assert (made.named, made.named_all, made.causes) == ("log_q", ("log_q",), causes("log_q"))
    assert made.parameters == {"density.normalisation": (0.5, 0.4, 0.6)}
    for failed, words in (
        (("density.normalisation", "sbc.bias"), "what is wrong is too small to be named: "),
        ((), "nothing is seen to be wrong: "),
    ):
        other = asked(FEW, *failed)
        assert (other.named, other.called) == (None, False)
        assert other.text.startswith(words)


def test_what_shows_in_draws_alone_comes_before_their_density() -> None:
    same = np.repeat(FEW[:, :9], 2, axis=1)
    made = asked(same, "density.normalisation")
    assert (made.named, made.named_all) == ("few_distinct", ("few_distinct",))
    assert made.text.startswith("only 50% of the draws of a trial are different ones. Possible causes: ")


def test_an_estimator_that_can_be_called_is() -> None:
    rng = np.random.default_rng(8)
    theta = rng.normal(size=(150, 1))

    def sample(x: Any, n: int, rng: Any) -> Any:
        return x[:, None] + rng.normal(size=(len(x), n, 1))

    made = asked(sample(theta, 19, rng), x=theta, sample=sample)
    assert made.called is True
    assert asked(sample(theta, 19, rng), sample=sample).called is False
    # Draws that were better than they are once more, of which the data say nothing.
    known = asked(theta[:, None] + 0.01 * FEW, x=rng.normal(size=(150, 1)), sample=sample)
    assert (known.named, known.called) == ("knows_truth", True)
