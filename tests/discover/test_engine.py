"""Which effects a look sends on to be fitted, by a loop."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.catalogue import CATALOGUE
from gaugeblock.discovery.engine import Extension, Look, Thresholds, promising, together
from gaugeblock.discovery.simulations import SIMULATIONS
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect


def entry(name, parameters):
    named = {f"p{i}": Uniform(-1.0, 1.0) for i in range(parameters)}
    return LibraryEffect(
        name=name, parameters=named, amplitude="p0", neutral=0.0, step=0.1, cause="", typical="",
        scanned={key: (0.0, 0.5) for key in named if key != "p0"},
    )  # fmt: skip


def look(rng, most):
    """Thirty templates of eight effects of one to three parameters, of either sign."""
    owner = np.array([f"e{i % 8}" for i in range(30)])
    z = rng.uniform(-most, most, 30)
    return Look(
        entries={f"e{i}": entry(f"e{i}", 1 + i % 3) for i in range(8)}, owner=owner, node=np.arange(30), z=z,
        amplitude=np.zeros(30), kept=np.ones(30), smallest_detectable=np.ones(30), null=np.zeros(9),
        state=None,
    )  # fmt: skip


def by_hand(seen, thresholds, behind):
    promise = {}
    for i in range(8):
        key = f"e{i}"
        best = max(z for z, owner in zip(seen.z, seen.owner, strict=True) if owner == key)
        if thresholds.again or behind is None or key not in behind.path:
            promise[key] = (best**2 / 2 if best > 0 else 0.0) - (1 + i % 3)
    ranked = [key for _, key in sorted((-value, key) for key, value in promise.items())]
    gross = max(seen.z) > 0 and max(seen.z) ** 2 / 2 > thresholds.far
    if not gross:
        most = max(promise.values())
        near = [
            key
            for key in ranked
            if promise[key] >= thresholds.share * most or promise[key] >= most - thresholds.behind
        ]
        ranked = ranked[: len(near) if len(near) > thresholds.at_least else thresholds.at_least]
    if behind is not None:
        return ranked[: thresholds.later]
    return ranked if gross else ranked[: thresholds.profiled]


@pytest.mark.parametrize("most", [2.0, 4.0, 9.9, 14.0])
def test_effects_are_sent_on_by_what_they_promise(most):
    rng = np.random.default_rng(int(10 * most))
    usual = Thresholds(behind=1.5, share=0.9)
    few = replace(usual, again=False, profiled=3, later=2, at_least=1)
    lengths = set()
    for _ in range(60):
        seen = look(rng, most)
        for thresholds in (usual, few, Thresholds()):
            for behind in (None, Extension(("e1",), 9.0, 1)):
                chosen = promising(seen, thresholds, behind)
                assert chosen == by_hand(seen, thresholds, behind)
                lengths.add(len(chosen))
    assert len(lengths) > 2


def test_what_a_look_says_of_one_effect_is_of_its_strongest_template():
    made = LibraryEffect(
        name="bump", parameters={"place": Uniform(0.0, 9.0), "size": Uniform(0.5, 3.0)}, amplitude="size",
        neutral=1.0, step=0.1, cause="", typical="", scanned={"place": (2.0, 4.0, 6.0)},
    )  # fmt: skip
    seen = Look(
        entries={"bump": made, "e0": entry("e0", 1)}, owner=np.array(["bump", "e0", "bump", "bump"]),
        node=np.array([0, 0, 2, 1]), z=np.array([-7.0, 4.0, 3.0, 2.0]),
        amplitude=np.array([0.1, 0.2, 0.7, 0.4]),
        kept=np.array([0.1, 0.2, 0.3, 0.4]), smallest_detectable=np.array([1.0, np.inf, 2.0, 3.0]),
        null=np.array([1.0, 2.0, 3.0, 4.0, 5.0]), p_rest=0.3, state=None,
    )  # fmt: skip
    found = seen.tested("bump")
    assert (seen.best("bump"), found.template, found.z, found.kept) == (2, 2, 3.0, 0.3)
    assert found.values == {"place": 6.0, "size": pytest.approx(1.7)}
    assert (found.p_global, found.smallest_detectable) == (pytest.approx(4 / 6), 2.0)
    other = seen.tested("e0")
    assert (other.template, other.smallest_detectable, other.p_global) == (1, None, pytest.approx(3 / 6))
    assert (seen.strength, seen.p_effects, seen.p_global) == (8.0, pytest.approx(0.5), 0.6)
    assert (seen.promise("bump"), seen.promise("e0")) == (2.5, 7.0)
    # What can only be less than nothing promises nothing.
    turned = replace(seen, z=np.array([-7.0, -4.0, -3.0, -2.0]))
    assert (turned.strength, turned.promise("bump"), turned.promise("e0")) == (0.0, -2.0, -1.0)
    # Fifty nats are not gross, more are.
    at = [replace(seen, z=np.full(4, z)).gross(Thresholds()) for z in (10.0, 10.001, -20.0)]
    assert at == [False, True, False]


def test_a_model_pays_for_parameters_and_what_they_cost():
    one = Extension(("line", "dip"), 20.0, 3, cost=2.5)
    assert (one.label, one.merit) == ("line + dip", 14.5)
    assert Extension(("line",), 20.0, 3).merit == 17.0


@pytest.mark.parametrize(
    ("thresholds", "parts", "fewest"),
    [
        (Thresholds(), 4, 399),
        (CATALOGUE, 1, 99),
        (SIMULATIONS, 4, 399),
        (Thresholds(level=0.05), 4, 79),
        (Thresholds(level=0.3), 4, 13),
    ],
)
def test_replicates_are_enough_from_where_every_look_can_reach_the_level(thresholds, parts, fewest):
    """The look with the least part: alone, or half of what has half of the chance."""

    def least(replicates):
        looks = [1.0] * (parts - 1) + [1 / (replicates + 1)]
        return together(*looks)

    assert least(fewest) <= thresholds.level < least(fewest - 1)
    assert thresholds.enough(fewest) == fewest
    with pytest.raises(
        InputError, match=rf"at least {fewest} replicates, got {fewest - 1}: .* {thresholds.level}$"
    ):
        thresholds.enough(fewest - 1)


def test_windows_and_library_share_the_chance_of_a_false_alarm():
    seen = replace(look(np.random.default_rng(1), 3.0), null=np.full(399, 9.0), p_rest=together(1 / 400, 1.0))
    assert seen.p_effects == 1.0
    assert seen.p_global == pytest.approx(0.01)
    assert replace(seen, p_rest=None).p_global == 1.0
    assert together(0.6, 0.7) == 1.0
