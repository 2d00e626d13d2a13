"""The front door: whatever people have in hand goes in, and a verdict comes out.

Where an outcome is asserted, the seed is fixed and the policy wide: an exact estimator fails it in far less
than one of a thousand seeds, a broken one is tens of standard errors outside.
"""

import inspect
import math
import random
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import gaugeblock as gb
from gaugeblock.auditing.estimator_from import RearrangedEstimator
from gaugeblock.core.errors import InputError
from gaugeblock.stranger.mapping import Mapping as ColumnMapping

WIDE = {
    "required": ["draws.finite", "sbc.bias", "sbc.log_width"],
    "tolerance": {"bias": 0.3, "log_width": 0.3, "coverage": 0.2},
}
SMALL = {"trials": 300, "draws": 50, "policy": WIDE, "validators": ("draws", "sbc"), "progress": False}
PRIOR = gb.Prior({"mean": gb.Normal(0.0, 1.0)})


def simulate(theta, rng):
    """One reading of the mean, as noisy as the prior is wide."""
    return rng.normal(theta, 1.0)


def exact(x, n, rng):
    """Its posterior: half the reading, standard deviation 1/sqrt(2)."""
    return x[:, None] / 2 + math.sqrt(0.5) * rng.standard_normal((len(x), n, 1))


def narrow(x, n, rng):
    return x[:, None] / 2 + 0.3 * math.sqrt(0.5) * rng.standard_normal((len(x), n, 1))


class Model:
    prior = PRIOR

    def simulate(self, theta, rng):
        return simulate(theta, rng)


class Alone:
    """An estimator that knows its simulator by heart."""

    def sample(self, x, n, rng):
        return exact(x, n, rng)


class WithSimulator(Alone):
    def __init__(self, simulator):
        assert simulator.prior.names == ("mean",)


def test_two_functions_and_a_prior():
    right = gb.audit(exact, simulate, prior=PRIOR, **SMALL)
    wrong = gb.audit(narrow, simulate, prior=PRIOR, **SMALL)
    assert right.outcome == "PASS"
    assert wrong.outcome == "FAIL"
    gate = wrong["sbc.log_width[mean]"]
    # Its draws are 0.3 times as wide as they should be.
    assert math.log(0.2) < gate.statistic < math.log(0.45)


@pytest.mark.parametrize("estimator", [exact, Alone, Alone(), WithSimulator, "ALONE"])
@pytest.mark.parametrize("simulator", [Model, Model(), "MODEL", simulate])
def test_every_form_of_the_same_two_gives_the_same_numbers(estimator, simulator, monkeypatch, tmp_path):
    (tmp_path / "front_door_toys.py").write_text(Path(__file__).read_text())
    monkeypatch.chdir(tmp_path)
    if estimator == "ALONE":
        estimator = "front_door_toys:Alone"
    if simulator == "MODEL":
        simulator = "front_door_toys:Model"
    prior = PRIOR if simulator is simulate else None
    result = gb.audit(estimator, simulator, prior=prior, trials=20, draws=5, seed=3, validators=("draws",))
    expected = gb.audit(exact, simulate, prior=PRIOR, trials=20, draws=5, seed=3, validators=("draws",))
    assert np.array_equal(result.trials["draws"], expected.trials["draws"])
    assert np.array_equal(result.trials["theta_true"], expected.trials["theta_true"])


def test_a_prior_of_another_library_leaves_a_simulator_its_likelihood():
    """Importance weights of the exact posterior, density included, are as good as can be."""
    stats = pytest.importorskip("scipy.stats")

    class Known:
        def __init__(self):
            self.prior = {"mean": stats.norm(0.0, 1.0)}

        def simulate(self, theta, rng):
            return simulate(theta, rng)

        def log_likelihood(self, theta, x):
            return stats.norm(theta, 1.0).logpdf(x).sum(axis=-1)

    class Dense(Alone):
        def log_prob(self, theta, x):
            return stats.norm(x[:, None] / 2, math.sqrt(0.5)).logpdf(theta).sum(axis=-1)

    result = gb.audit(Dense, Known, trials=40, draws=20, validators=("importance",), progress=False)
    assert result["importance.ess"].statistic == pytest.approx(1.0)


def test_names_of_ones_own():
    result = gb.audit(exact, simulate, prior=PRIOR, names=["mu"], trials=20, draws=5, validators=("draws",))
    assert result.trials["parameter"].values.tolist() == ["mu"]


def test_nothing_is_left_without_out_and_all_of_it_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    gb.audit(exact, simulate, prior=PRIOR, **SMALL)
    assert [path.name for path in tmp_path.rglob("*")] == ["temporary"]
    for place in ("out", tmp_path / "other"):
        gb.audit(exact, simulate, prior=PRIOR, out=place, **SMALL)
        found = {path.name for path in Path(place).iterdir()}
        assert found >= {"trials.nc", "findings.nc", "verdict.json", "junit.xml", "summary.md", "report.html"}
        assert ".chunks" not in found


def test_arrays_and_every_file_of_them_say_the_same(tmp_path):
    rng = np.random.default_rng(5)
    theta = rng.standard_normal((300, 2))
    x = theta + rng.standard_normal((300, 2))
    draws = x[:, None] / 2 + math.sqrt(0.5) * rng.standard_normal((300, 40, 2))
    options = {"policy": WIDE, "validators": ("draws", "sbc"), "seed": 2}
    first = gb.audit_draws(theta, draws, x=x, names=["a", "b"], **options)
    made = gb.make_trials(theta, draws, ["a", "b"], x=x)
    gb.write_trials(made, tmp_path / "t.nc")
    np.savez(tmp_path / "t.npz", theta_true=theta, draws=draws, x=x, names=["a", "b"])
    sources = [made, tmp_path / "t.nc", str(tmp_path / "t.npz"), first.trials]
    for source in sources:
        assert gb.audit_draws(source, **options).verdict.gates == first.verdict.gates
    assert first.outcome == "PASS"
    assert {"sbc.bias[a]", "sbc.log_width[b]"} <= set(first.gates)


def test_arrays_of_one_parameter_need_no_axis_for_it():
    rng = np.random.default_rng(5)
    result = gb.audit_draws(rng.standard_normal(50), rng.standard_normal((50, 20)), validators=("draws",))
    assert result.trials["parameter"].values.tolist() == ["theta_1"]
    assert result.trials["draws"].shape == (50, 20, 1)


def test_judged_again_in_memory_and_from_disk(tmp_path):
    result = gb.audit(exact, simulate, prior=PRIOR, out=tmp_path, **SMALL)
    for audited in (result, tmp_path, str(tmp_path)):
        again = gb.judge(audited, {**WIDE, "tolerance": {"bias": 0.001}})
        assert again.outcome == "INCONCLUSIVE"
        assert again["sbc.bias[mean]"].statistic == result["sbc.bias[mean]"].statistic


def test_a_plan():
    planned = gb.plan(width_error=0.1, bias=0.1, power=0.9, params=5)
    assert 2500 < planned.trials < 4000
    assert gb.plan(trials=1000).trials == 1000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((exact, simulate), "simulate simulates, and comes without a prior: give prior=..."),
        ((Model(), exact), "the order is (estimator, simulator)"),
        ((3, Model()), "the estimator is a int without sample"),
        ((exact, 3), "the simulator is a int without simulate"),
        ((exact, "no_such"), "no simulator 'no_such'"),
        (("no_such", Model()), "no estimator 'no_such'"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments, words):
    with pytest.raises(InputError) as error:
        gb.audit(*arguments)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"policy": "lenient"}, "lenient"),
        ({"policy": 3}, "policy cannot be a int"),
        ({"policy": {"tolerance": {"bia": 1}}}, "bia"),
        ({"trials": 3}, "number"),
        ({"trials": {"numbers": 3}}, "unknown key numbers"),
        ({"draws": 1}, "draws"),
        ({"validators": ("sbx",)}, "sbx"),
        ({"baseline": "/nowhere"}, "nowhere"),
        ({"observation": "/nowhere.npy"}, "nowhere"),
    ],
)
def test_settings_that_cannot_be_are_said_before_anything_runs(options, words):
    def never(x, n, rng):
        raise AssertionError

    with pytest.raises(InputError) as error:
        gb.audit(never, simulate, prior=PRIOR, **options)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_progress_is_told():
    told = []
    gb.audit(exact, simulate, prior=PRIOR, **{**SMALL, "progress": lambda *said: told.append(said)})
    assert ("trials", 300, 300) in told
    assert ("validators", 1, 1) in told


def test_the_package_shows_its_public_names_and_no_other():
    import gaugeblock.discovery
    import gaugeblock.validate.trials  # noqa: F401

    shown = dir(gb)
    assert shown == sorted(shown)
    for name in shown:
        assert not inspect.ismodule(getattr(gb, name)), name
    assert {
        "audit",
        "audit_draws",
        "discover",
        "judge",
        "plan",
        "load",
        "Prior",
        "Policy",
        "LibraryEffect",
    } <= set(shown)
    assert isinstance(gb.__version__, str)
    with pytest.raises(AttributeError, match="there are Audit"):
        _ = gb.nothing


def test_torch_draws_that_belong_to_a_graph_and_global_seeds_stay():
    torch = pytest.importorskip("torch")

    def attached(x, n, rng):
        return torch.as_tensor(exact(x, n, rng)).requires_grad_()

    assert gb.audit(attached, simulate, prior=PRIOR, **SMALL).outcome == "PASS"

    def alone(theta):
        return theta + torch.randn(theta.shape) + 0 * float(np.random.normal()) + 0 * random.random()  # noqa: NPY002

    torch.manual_seed(4)
    np.random.seed(4)  # noqa: NPY002
    random.seed(4)
    before = torch.get_rng_state(), np.random.get_state()[1].copy(), random.getstate()  # noqa: NPY002
    first = gb.audit(exact, alone, prior=PRIOR, **SMALL)
    after = torch.get_rng_state(), np.random.get_state()[1], random.getstate()  # noqa: NPY002
    assert torch.equal(before[0], after[0])
    assert np.array_equal(before[1], after[1])
    assert before[2] == after[2]
    again = gb.audit(exact, alone, prior=PRIOR, **SMALL)
    assert np.array_equal(first.trials["x"], again.trials["x"])
    assert first.outcome == "PASS"


def test_a_suggested_arrangement_of_columns_can_be_written_for_any_estimator(tmp_path, monkeypatch):
    prior = gb.Prior({"a": gb.Normal(0.0, 1.0), "b": gb.Normal(5.0, 1.0)})
    (tmp_path / "swapped_toy.py").write_text(
        "import numpy as np\n"
        "def swapped(x, n, rng):\n"
        "    draws = (x[:, None] + [0, 5]) / 2 + np.sqrt(0.5) * rng.standard_normal((len(x), n, 2))\n"
        "    return draws[..., ::-1] * 1000\n"
    )
    monkeypatch.chdir(tmp_path)
    wrong = gb.audit("swapped_toy:swapped", simulate, prior=prior, **SMALL)
    assert wrong.outcome == "FAIL"
    table = {"a": {"index": 1, "unit": 0.001}, "b": {"index": 0, "unit": 0.001}}
    mended = {"name": "swapped_toy:swapped", "parameters": table}
    assert gb.audit(mended, simulate, prior=prior, **SMALL).outcome == "PASS"


class Swapped:
    """Draws of b in thousands, then of a's logarithm, with their density."""

    autocorrelated = True

    def sample(self, x, n, rng):
        return np.stack([rng.normal(5000.0, 1000.0, (len(x), n)), rng.standard_normal((len(x), n))], axis=2)

    def log_prob(self, theta, x):
        theta = np.asarray(theta)
        return stats.norm.logpdf(theta[..., 0], 5000.0, 1000.0) + stats.norm.logpdf(theta[..., 1])

    def describe(self):
        return {"estimator": "swapped"}


def test_an_arrangement_of_columns_has_the_density_of_its_draws_and_says_what_it_is():
    mapping = ColumnMapping.of({"a": {"index": 1, "transform": "log"}, "b": {"index": 0, "unit": 1e-3}}, "ab")
    made = RearrangedEstimator(Swapped(), mapping)
    assert made.autocorrelated
    x = np.zeros((3, 1))
    draws = made.sample(x, 4, np.random.default_rng(1))
    theirs = Swapped().sample(x, 4, np.random.default_rng(1))
    np.testing.assert_allclose(draws, np.stack([np.exp(theirs[..., 1]), theirs[..., 0] / 1000], axis=2))
    density = stats.lognorm.logpdf(draws[..., 0], 1.0) + stats.norm.logpdf(draws[..., 1], 5.0, 1.0)
    np.testing.assert_allclose(made.log_prob(draws, x), density)
    said = made.describe()
    assert said["base"]["estimator"] == "swapped"
    assert said["mapping"] == {
        "columns": [1, 0], "transforms": ["log", "none"], "units": [1.0, 1e-3], "offsets": [0.0, 0.0]
    }  # fmt: skip
    beyond = ColumnMapping.of({"a": 1, "b": 2}, "ab", stranger=("c", "a", "b"))
    assert not hasattr(RearrangedEstimator(Swapped(), beyond), "log_prob")
