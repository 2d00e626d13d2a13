"""What each effect does to the epidemic: nothing at its neutral value, and what its table says elsewhere."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Simulator, Uniform, build_simulator
from gaugeblock.simulators.epidemic import EFFECTS, Epidemic, EpidemicEffect
from gaugeblock.simulators.protocol import HasExactDensity, HasExactEvidence, HasExactPosterior
from gaugeblock.simulators.segments import segments

RATES = np.array([[0.3, 0.12], [0.5, 0.2], [0.9, 0.06]])
PLAIN = Epidemic(nodes=65)
LIBRARY = PLAIN.effect_library(RATES)


def extended(name, amplitude, scanned=3.4):
    """An epidemic with one free effect, and theta with the amplitude given and scanned weeks in mid-week."""
    entry = LIBRARY[name]
    values = [amplitude if p == entry.amplitude else scanned for p in entry.parameters]
    return PLAIN.with_effect(entry.effect()), np.column_stack([RATES, np.tile(values, (len(RATES), 1))])


def test_the_library_is_what_is_known():
    assert set(LIBRARY) == set(EFFECTS)
    for name, entry in LIBRARY.items():
        assert name == entry.name
        assert set(entry.units) == set(entry.parameters) == set(EFFECTS[name].parameters)
        assert entry.cause
        assert entry.typical
        simulator = PLAIN.with_effect(entry.effect())
        theta = np.concatenate([np.tile(RATES[0], (len(entry.nodes), 1)), entry.nodes], axis=1)
        assert simulator.prior.contains(theta).all()
        assert np.all(np.abs(simulator.expected(theta) / PLAIN.expected(RATES[:1]) - 1).max(axis=1) > 1e-3)


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_neutral_is_the_plain_epidemic_to_the_last_bit(name):
    simulator, theta = extended(name, LIBRARY[name].neutral)
    np.testing.assert_array_equal(simulator.expected(theta), PLAIN.expected(RATES))


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_an_extended_epidemic_is_a_simulator_without_an_exact_posterior(name):
    entry = LIBRARY[name]
    simulator, theta = extended(name, entry.neutral + entry.step)
    assert isinstance(simulator, Simulator)
    assert simulator.prior.names[2:] == tuple(f"{name}_1.{p}" for p in entry.parameters)
    for missing in (HasExactPosterior, HasExactDensity, HasExactEvidence):
        assert isinstance(PLAIN, missing)
        assert not isinstance(simulator, missing)
    x = simulator.simulate(theta, np.random.default_rng(1))
    assert x.shape == (3, 12)
    assert simulator.log_likelihood(theta[:, None], x).shape == (3, 3)
    assert simulator.describe() != PLAIN.with_effect(entry.effect(**{entry.amplitude: 0.5})).describe()


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_derivatives_agree_with_differences(name):
    entry = LIBRARY[name]
    simulator, theta = extended(name, entry.neutral + entry.step)
    jacobian = simulator.jacobian(theta)
    assert jacobian.shape == (3, 12, simulator.prior.size)
    for k in range(simulator.prior.size):
        move = np.zeros(simulator.prior.size)
        move[k] = 1e-5 * max(abs(theta[0, k]), 1e-2)
        difference = (simulator.expected(theta + move) - simulator.expected(theta - move)) / (2 * move[k])
        scale = np.abs(difference).max(axis=1, keepdims=True)
        np.testing.assert_allclose(jacobian[..., k] / scale, difference / scale, atol=1e-6)
    # The shape of theta is the shape of what comes back, one row and none at all too.
    np.testing.assert_array_equal(simulator.jacobian(theta[0]), jacobian[0])


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_jax_agrees(name):
    jax = pytest.importorskip("jax")
    entry = LIBRARY[name]
    simulator, theta = extended(name, entry.neutral + entry.step)
    x = simulator.simulate(theta, np.random.default_rng(2)).astype(float)

    def evaluated(theta, x):
        return simulator.expected_jax(theta), jax.value_and_grad(simulator.log_likelihood_jax)(theta, x)

    with jax.enable_x64(True):
        mean, (likelihood, gradient) = jax.jit(jax.vmap(evaluated))(theta, x)
    np.testing.assert_allclose(mean, simulator.expected(theta), rtol=1e-11)
    np.testing.assert_allclose(likelihood, simulator.log_likelihood(theta, x), rtol=1e-10)
    weight = (x / simulator.expected(theta) - 1)[..., None]
    np.testing.assert_allclose(
        gradient, (weight * simulator.jacobian(theta)).sum(axis=1), rtol=1e-7, atol=1e-7
    )


def test_what_is_reported_is_what_the_table_says():
    plain = PLAIN.expected(RATES)
    simulator, theta = extended("reporting_step", 0.3)
    np.testing.assert_allclose(
        simulator.expected(theta) / plain, np.tile([1, 1, 1, 1 - 0.3 * 0.6] + [0.7] * 8, (3, 1)), rtol=1e-12
    )
    simulator, theta = extended("missed_week", 0.5)
    np.testing.assert_allclose(
        simulator.expected(theta) / plain, np.tile([1, 1, 1, 0.7, 0.8] + [1] * 7, (3, 1)), rtol=1e-12
    )
    simulator, theta = extended("imported_cases", 7.0)
    np.testing.assert_allclose(simulator.expected(theta) - plain, 7.0, rtol=1e-9)
    simulator, theta = extended("reporting_delay", 0.25)
    late = simulator.expected(theta)
    np.testing.assert_allclose(late[:, 1:], 0.75 * plain[:, 1:] + 0.25 * plain[:, :-1], rtol=1e-12)
    # None is lost but the last week's late ones.
    np.testing.assert_allclose(late.sum(axis=1), plain.sum(axis=1) - 0.25 * plain[:, -1], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "amplitude", "week"),
    [
        ("waning", 0.02, None),
        ("mixing", 0.8, None),
        ("contact_change", 0.5, 4.0),
        ("contact_change", 2.0, 3.4),
    ],
)
def test_dynamics_solve_the_differential_equation(name, amplitude, week):
    simulator, theta = extended(name, amplitude, week)

    def slope(day, state, contact, recovery):
        susceptible, infected, removed = state
        changed = contact * (amplitude if name == "contact_change" and day >= 7 * week else 1.0)
        new = changed * susceptible ** (1 + (amplitude if name == "mixing" else 0)) * infected
        back = (amplitude if name == "waning" else 0.0) * removed
        return [-new + back, new - recovery * infected, recovery * infected - back, new]

    def whole(day, state, contact, recovery):
        return slope(day, state[:3], contact, recovery)

    days = 7.0 * np.arange(13)
    for rates, expected in zip(RATES, simulator.expected(theta), strict=True):
        solved = solve_ivp(
            whole, (0, days[-1]), [1 - 5 / 2000, 5 / 2000, 0, 0], t_eval=days, args=tuple(rates),
            rtol=1e-9, atol=1e-12, max_step=0.1,
        )  # fmt: skip
        # Half-day steps are part of the definition, as without the effect.
        # Nor does the mean fall below its floor.
        np.testing.assert_allclose(expected, np.maximum(np.diff(solved.y[3]) * 400, 1e-6), rtol=6e-3)


def test_steps_are_classical_runge_kutta_steps_of_half_a_day():
    """All that drives an epidemic at once, to rounding; a change within a step counts for its part."""
    simulator = PLAIN
    values = {
        "contact_change": {"factor": 0.6, "week": 3.43},
        "waning": {"rate": 0.01},
        "mixing": {"exponent": 0.7},
    }
    for name, fixed in values.items():
        simulator = simulator.with_effect(Effect(name, fixed))
    for (contact, recovery), found in zip(RATES, simulator.expected(RATES), strict=True):

        def slope(state, rate, recovery=recovery):
            s, i, r, _ = state
            new = rate * s * i * max(s, 0.01) ** 0.7
            return np.array([-new + 0.01 * r, new - recovery * i, recovery * i - 0.01 * r, new])

        state, course = np.array([1 - 5 / 2000, 5 / 2000, 0.0, 0.0]), [0.0]
        for number in range(12 * 14):
            rate = contact * (1 - 0.4 * np.clip(number + 1 - 14 * 3.43, 0.0, 1.0))
            one = slope(state, rate)
            two = slope(state + one / 4, rate)
            three = slope(state + two / 4, rate)
            state = state + (one + 2 * two + 2 * three + slope(state + three / 2, rate)) / 12
            course.append(state[3])
        np.testing.assert_allclose(found, 400 * np.diff(course[::14]), rtol=1e-9)


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_cases_are_positive_over_the_whole_prior(name):
    # Where an epidemic burns out within weeks, a step may leave fewer than no susceptible.
    simulator = PLAIN.with_effect(LIBRARY[name].effect())
    cube = np.random.default_rng(3).random((4000, simulator.prior.size))
    cube[:2000] = np.round(cube[:2000])
    expected = simulator.expected(simulator.prior.from_unit_cube(cube))
    assert np.all((expected > 0) & (expected < 400 * 12))


def test_effects_compose_and_count():
    first = PLAIN.with_effect(LIBRARY["waning"].effect()).with_effect(LIBRARY["waning"].effect(rate=0.01))
    assert first.prior.names[2:] == ("waning_1.rate",)
    twice = PLAIN.with_effect(LIBRARY["waning"].effect()).with_effect(LIBRARY["waning"].effect())
    assert twice.prior.names[2:] == ("waning_1.rate", "waning_2.rate")
    np.testing.assert_allclose(
        first.expected([[0.3, 0.12, 0.02]]), twice.expected([[0.3, 0.12, 0.02, 0.01]]), rtol=1e-13
    )


def test_exponents_of_mixing_add_and_two_changes_multiply():
    once = {"mixing": {"exponent": 0.75}, "contact_change": {"factor": 0.3, "week": 4.0}}
    twice = {"mixing": [{"exponent": 0.5}, {"exponent": 0.25}],
             "contact_change": [{"factor": 0.5, "week": 4.0}, {"factor": 0.6, "week": 4.0}]}  # fmt: skip
    for name, parameters in once.items():
        first, second = (Effect(name, each) for each in twice[name])
        np.testing.assert_allclose(
            PLAIN.with_effect(first).with_effect(second).expected(RATES),
            PLAIN.with_effect(Effect(name, parameters)).expected(RATES),
            rtol=1e-12,
        )


def test_an_effect_of_ones_own():
    weekend = EpidemicEffect(
        {"share": (0.0, 1.0)},
        report=lambda cases, values: cases * (1.0 - values["share"][..., None] * 0.5),
    )
    simulator = PLAIN.with_effect(Effect("weekend", {"share": Uniform(0.0, 1.0)}, kind=weekend))
    assert simulator.prior.names[2:] == ("weekend_1.share",)
    np.testing.assert_allclose(simulator.expected([[0.3, 0.12, 0.4]]), 0.8 * PLAIN.expected(RATES[:1]))


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (Effect("gain_slope", {"slope": 1.0}), "not known to the epidemic; there are reporting_step"),
        (Effect("waning", {}), "takes rate; rate missing"),
        (Effect("waning", {"rate": 0.1, "week": 2.0}), "week unknown"),
        (Effect("waning", {"rate": Uniform(0.0, 2.0)}), "rate must lie between 0 and 1, got 0 to 2"),
        (Effect("reporting_delay", {"share": -0.1}), "share must lie between 0 and 0.95"),
    ],
)
def test_mistakes_are_one_clear_line(effect, words):
    with pytest.raises(InputError, match=words) as caught:
        PLAIN.with_effect(effect)
    assert "\n" not in str(caught.value)


def test_what_may_be_and_where_it_is_sought():
    """Priors, steps from neutral and scans; imported cases follow the size of the epidemic."""
    cases, weeks = PLAIN.expected(RATES).mean(), tuple(range(12))
    week, inner = (0.0, 12.0), {"week": weeks[1:11]}
    expected = {
        "reporting_step": ({"share": (-0.9, 0.9), "week": week}, 0.0, 0.1, inner, "instrument"),
        "reporting_delay": ({"share": (0.0, 0.95)}, 0.0, 0.1, {}, "instrument"),
        "missed_week": (
            {"share": (-0.9, 0.9), "week": (0.0, 11.0)}, 0.0, 0.2, {"week": weeks}, "instrument"
        ),
        "imported_cases": ({"rate": (0.0, 2 * cases)}, 0.0, 0.1 * cases, {}, "source"),
        "contact_change": ({"factor": (0.1, 3.0), "week": week}, 1.0, -0.1, inner, "source"),
        "waning": ({"rate": (0.0, 0.1)}, 0.0, 0.005, {}, "source"),
        "mixing": ({"exponent": (-0.3, 4.0)}, 0.0, 0.2, {}, "source"),
    }  # fmt: skip
    assert set(LIBRARY) == set(expected)
    for name, (ranges, neutral, step, scans, origin) in expected.items():
        entry = LIBRARY[name]
        assert {key: prior.support for key, prior in entry.parameters.items()} == ranges, name
        assert (entry.amplitude, entry.neutral, entry.origin) == (next(iter(ranges)), neutral, origin)
        assert entry.step == pytest.approx(step)
        assert {key: tuple(values) for key, values in entry.scanned.items()} == scans
        assert set(entry.units.values()) <= {"", "weeks", "per day", "cases a week"}
    # The shortest data that leave a week to be tried.
    assert Epidemic(weeks=2).effect_library(RATES)["contact_change"].scanned["week"].tolist() == [1.0]


def test_the_data_are_one_run_of_weeks():
    (segment,) = segments(build_simulator("epidemic", weeks=3), 3)
    assert (segment.name, segment.start, segment.stop, segment.unit) == ("cases", 0, 3, "week")
    assert segment.edges.tolist() == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]


def test_an_effect_is_part_of_what_an_epidemic_is():
    effect = Effect("waning", {"rate": Uniform(0.0, 0.1)})
    plain = {key: value for key, value in PLAIN.describe().items() if key != "nodes"}
    assert PLAIN.with_effect(effect).describe() == {**plain, "effects": [effect.describe()]}
