"""A repair that was named makes a new estimator, which holds on trials of its own."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.diagnose.problems import FAULTS, about_middle, exact, lighter, one_sign, two_modes
from tests.diagnose.test_calls import PRIOR, QUICK, SMALL, right, simulate

import gaugeblock as gb
from gaugeblock.auditing.identity import identity
from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis import Cause, Diagnosis, Fault, Repair, Repaired
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.symptoms import STRUCTURAL, SYMPTOMS
from gaugeblock.diagnosis.repair import as_data, from_data
from gaugeblock.diagnosis.workflow import locate_and_name
from gaugeblock.validate import make_policy

SIZE = {"trials": 900, "draws": 80, "progress": False}
# What stands for something that draws cannot be given.
NOTHING_MENDS = {"ignored_parameter", "truncated_prior", "fixed_seed"}


def all_repairs():
    """Every repair that the library fits to the faults of the problems, with the cases."""
    for name, (_, fault) in FAULTS.items():
        cases = exact(3, trials=300)
        cases = cases.drawn(fault(cases, np.random.default_rng(3)))
        yield name, cases
    for fault in (one_sign, lighter):
        cases = two_modes(3, trials=300)
        yield fault.__name__, cases.drawn(fault(cases, np.random.default_rng(3)))


def test_every_repair_can_be_written_down_and_read_again():
    seen = set()
    for _, cases in all_repairs():
        reference = Reference.of(cases)
        fitted = [fit(cases) for fit in STRUCTURAL] + [fit(cases, reference) for fit in SYMPTOMS.values()]
        for repair in (repair for repairs in fitted for repair in repairs):
            data = as_data(repair.apply)
            if repair.symptom in NOTHING_MENDS:
                assert data is None
                continue
            again = from_data(json.loads(json.dumps(data)), where="here")
            assert np.array_equal(again(cases).draws, repair.apply(cases).draws)
            seen.add(repair.symptom)
    assert seen >= set(SYMPTOMS) - NOTHING_MENDS


@pytest.mark.parametrize(
    "wrong",
    [
        {"function": "system", "by": 1},
        {"function": "moved", "by": [0.0]},
        {"function": "moved", "by": [0.0], "in_widths": True, "cases": 1},
        "moved",
    ],
)
def test_what_is_no_repair_is_refused(wrong):
    with pytest.raises(InputError, match=r"^here: "):
        from_data(wrong, where="here")


def narrow(x, n, rng):
    draws = right(x, n, rng)
    middle = draws.mean(axis=1, keepdims=True)
    return (middle + 0.6 * (draws - middle))[..., ::-1]


def test_a_repaired_estimator_passes_on_other_trials_and_is_another_one(tmp_path):
    first = gb.audit(narrow, simulate, prior=PRIOR, seed=4, out=tmp_path / "first", **SIZE, **QUICK)
    assert first.outcome == "FAIL"
    said = first.verdict.diagnosis
    assert set(said["named_all"]) == {"columns", "scale"}
    assert [each["function"] for each in said["repair"]]
    table = {"name": "repaired", "base": narrow, "diagnosis": tmp_path / "first"}
    with pytest.raises(InputError, match="seed 4, which would judge the repair by itself"):
        gb.audit(table, simulate, prior=PRIOR, seed=4, **SIZE)
    # What fails the original; by ranks and coverage alone, which need fewer trials than all validators.
    policy = make_policy(
        {"required": ["sbc", "coverage"], "tolerance": {"bias": 0.2, "log_width": 0.2, "coverage": 0.1}},
        source="test",
    )
    seen = {"validators": ("draws", "sbc", "coverage"), "policy": policy}
    second = gb.audit(table, simulate, prior=PRIOR, seed=5, **{**SIZE, "trials": 1000}, **seen)
    assert second.outcome == "PASS"
    # The original's verdict stays what it was, and the new one has a name and a record of its own.
    assert json.loads((tmp_path / "first" / "verdict.json").read_text())["verdict"] == "FAIL"
    record = second.verdict.provenance["estimator"]
    assert record["estimator"] == "repaired"
    assert record["repair"] == list(said["repair"])
    assert record["base"]["estimator"] == "narrow"


def test_a_repair_of_the_call_is_one_too():
    def scaled(x, n, rng):
        return right(x / 1000, n, rng)

    first = gb.audit(scaled, simulate, prior=PRIOR, seed=4, **SMALL, **QUICK)
    assert first.verdict.diagnosis["named"] == "x_scale"
    mended = Repaired(scaled_object(scaled), gb_simulator(), diagnosis=first_diagnosis(first, scaled))
    second = gb.audit(mended, simulate, prior=PRIOR, seed=5, **SIZE, **QUICK)
    assert second.outcome != "FAIL"
    assert second["sbc.log_width[a]"].outcome != "FAIL"


def scaled_object(function):
    return type("Scaled", (), {"sample": staticmethod(function)})()


def gb_simulator():
    return type("Named", (), {"prior": PRIOR})()


def first_diagnosis(result, function):
    return result.diagnose(scaled_object(function))


def test_draws_that_are_not_finite_stay_so_and_few_that_are_left_are_enough():
    class Base:
        def sample(self, x, n, rng):
            draws = right(x, n, rng)
            draws[0] = np.nan
            draws[:, ::10] += 500.0 * rng.choice([-1, 1], size=draws[:, ::10].shape)
            return draws

    content = diagnosis_of([{"function": "without_stray"}])
    mended = Repaired(Base(), gb_simulator(), diagnosis=content)
    rng = np.random.default_rng(1)
    found = mended.sample(simulate(PRIOR.sample(50, rng), rng), 100, rng)
    assert found.shape == (50, 100, 2)
    assert np.isnan(found[0]).all()
    assert np.abs(found[1:]).max() < 100
    # Draws that are left out are replaced by others, not by the same ones again.
    assert np.mean([len(np.unique(row[:, 0])) for row in found[1:]]) >= 95


def test_a_repair_is_fitted_to_all_trials_of_the_diagnosis():
    cases = exact(5, trials=600)
    broken = cases.drawn(about_middle(cases, 0.6))
    found = locate_and_name(broken, seed=1, failed=True)
    (repair,) = found.repairs
    whole = {each.variant: each for each in SYMPTOMS["scale"](broken, Reference.of(broken))}[repair.variant]
    assert repair.numbers == whole.numbers
    assert repair.numbers != found.named.repairs[0].numbers


class Plain:
    """An estimator that says nothing of itself."""

    def __init__(self, size):
        self.size = size

    def sample(self, x, n, rng):
        return right(x, n, rng) * self.size


def test_what_is_repaired_is_told_from_another_of_its_class():
    content = diagnosis_of([{"function": "without_stray"}])
    found = [identity(Repaired(Plain(size), gb_simulator(), diagnosis=content)) for size in (1.0, 2.0)]
    assert found[0]["base"]["state_sha256"] != found[1]["base"]["state_sha256"]
    assert found[0]["repair"] == found[1]["repair"]


def diagnosis_of(repair):
    nothing = gb.audit_draws(np.zeros((20, 1)), np.ones((20, 30, 1)), names=["a"], progress=False).diagnose()
    return replace(nothing, repair=tuple(repair), seed=None)


def test_where_nothing_mends_it_says_so(tmp_path):
    with pytest.raises(InputError, match="has no repair"):
        Repaired(Repaired, gb_simulator(), diagnosis=diagnosis_of([]))
    (tmp_path / "verdict.json").write_text("{}")
    with pytest.raises(InputError, match="holds no diagnosis"):
        Repaired(Repaired, gb_simulator(), diagnosis=tmp_path)


def rounded_to_halves(cases, reference):
    """A user's own fault: every second trial's draws are turned about their middle."""
    odd = cases.trial % 2 == 1
    off = np.median((cases.theta - cases.middle)[odd] / cases.half_width[odd], axis=0)
    if np.abs(off).max() < 0.1:
        return []

    def back(other):
        by = np.where((other.trial % 2 == 1)[:, None], off, 0.0) * other.half_width
        return other.drawn(other.draws + by[:, None])

    return [Repair("odd_trials", back, "draws of every second trial lie elsewhere", {"a": float(off[0])})]


def test_a_fault_of_ones_own_is_named():
    rng = np.random.default_rng(8)
    theta = PRIOR.sample(500, rng)
    draws = right(simulate(theta, rng), 64, rng)
    draws[1::2] += 3.0 * draws.std(axis=1, keepdims=True)[1::2]
    result = gb.audit_draws(theta, draws, names=["a", "b"], progress=False, **QUICK)
    assert result.verdict.diagnosis["named"] not in (None, "odd_trials")
    own = {"odd_trials": Fault(rounded_to_halves, (Cause("a loop over pairs", "look at its index"),))}
    found = result.diagnose(faults=own)
    assert found.named == "odd_trials"
    assert "look at its index" in found.text
    assert found.faults == ("odd_trials",)
    assert found.repair == ()
    with pytest.raises(InputError, match="shift is the library's own"):
        result.diagnose(faults={"shift": own["odd_trials"]})


def test_repairs_of_a_region_hold_there_alone():
    cases = exact(6, draws=64)
    side = cases.middle[:, 0] > 0.5
    broken = cases.drawn(np.where(side[:, None, None], about_middle(cases, 0.4), cases.draws))
    (repair, *_) = [r for r in SYMPTOMS["region"](broken, Reference.of(broken)) if r.variant == "scale"]
    mended = from_data(as_data(repair.apply), where="here")(broken)
    changed = (mended.draws != broken.draws).any(axis=(1, 2))
    assert changed[side].mean() > 0.8
    assert changed[~side].mean() < 0.1


class Asked:
    """Draws that rise from 0, of which some are far out; and what it was asked."""

    def __init__(self, far=0.0):
        self.far, self.asked = far, []

    def sample(self, x, n, rng):
        self.asked.append((np.array(x), n))
        draws = np.array(np.broadcast_to(np.arange(n, dtype=float)[:, None] / n, (len(x), n, 2)))
        draws[:, : int(self.far * n)] += 1e6
        return draws


def repaired(base, *repair, **options):
    held = Diagnosis(named="a", text="words", repair=repair, **options)
    return Repaired(base, gb_simulator(), diagnosis=held)


SHIFT = {"function": "moved", "by": [-1.0, 2.0], "in_widths": False}
TURN = {"function": "standardised", "zero": 1.0, "unit": 2.0}


def test_what_a_repaired_estimator_asks_of_its_base_and_makes_of_it():
    x = np.array([[1, 3], [5, 7]])
    base = Asked()
    found = repaired(base, TURN, SHIFT, seed=9).sample(x, 10, np.random.default_rng(1))
    ((asked, n),) = base.asked
    np.testing.assert_allclose(asked, [[0.0, 1.0], [2.0, 3.0]])
    assert (n, found.shape) == (40, (2, 10, 2))
    # By lot, in their order, none twice.
    assert (np.diff(found[..., 0], axis=1) > 0).all()
    assert np.isin(((found - [1.0, -2.0]) * 40).round(9), np.arange(40.0)).all()
    assert not np.array_equal(found, repaired(Asked(), TURN, SHIFT).sample(x, 10, np.random.default_rng(2)))
    assert repaired(base, SHIFT, seed=9).seed_of_repair == 9
    turned = Asked()
    found = repaired(turned, TURN).sample(x, 10, np.random.default_rng(1))
    assert turned.asked[0][1] == 10
    np.testing.assert_array_equal(found[0, :, 0], np.arange(10) / 10)


def test_it_asks_for_more_where_a_repair_leaves_few():
    few = {"function": "thinned", "stride": 7}
    base = Asked()
    assert repaired(base, few).sample(np.zeros((2, 1)), 10, np.random.default_rng(1)).shape == (2, 10, 2)
    assert [n for _, n in base.asked] == [40, 160]
    base = Asked()
    with pytest.raises(InputError, match=r"^the repair leaves fewer than one of 256 draws over$"):
        repaired(base, {"function": "thinned", "stride": 300}).sample(
            np.zeros((2, 1)), 10, np.random.default_rng(1)
        )
    assert [n for _, n in base.asked] == [40, 160, 640, 2560]


def test_where_a_diagnosis_is_read_from(tmp_path):
    content = {"diagnosis": {"named": "a", "repair": [SHIFT], "seed": 3}}
    (tmp_path / "verdict.json").write_text(json.dumps(content))
    for place in (tmp_path, str(tmp_path), tmp_path / "verdict.json"):
        made = Repaired(Asked(), gb_simulator(), diagnosis=place)
        assert made.seed_of_repair == 3
        assert made.describe()["repair"] == [SHIFT]
    for held, said in (
        ({"diagnosis": {"repair": []}}, "verdict.json has no repair: it names nothing, which draws alone"),
        ({"diagnosis": {"named": "a", "repair": "b"}}, "verdict.json has no repair: it names a, which draws"),
        (
            {"diagnosis": None},
            "verdict.json holds no diagnosis: give the folder of an audit that did not PASS",
        ),
        ([], "verdict.json holds no diagnosis"),
    ):
        (tmp_path / "verdict.json").write_text(json.dumps(held))
        with pytest.raises(InputError) as caught:
            Repaired(Asked(), gb_simulator(), diagnosis=tmp_path)
        assert f"{tmp_path / 'verdict.json'}"[:-12] in str(caught.value)
        assert said in str(caught.value)
