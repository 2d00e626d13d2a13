"""One way in to discovery: the engine that fits, functions with effects of one's own, files if asked."""

import json

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.discovering import discover
from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Discovery, Sources
from gaugeblock.simulators import Normal, Prior, Uniform, build_simulator
from gaugeblock.simulators.epidemic import EpidemicEffect
from gaugeblock.simulators.library import LibraryEffect

PRIOR = Prior({"level": Normal(0.0, 1.0)})


def readings(theta, rng):
    """Six readings of one level."""
    return theta[:, :1] + 0.5 * rng.standard_normal((len(theta), 6))


def drifting(simulate, theta, values, rng):
    """Readings drift from the third on."""
    return simulate(theta, rng) + values["drift"][:, None] * np.clip(np.arange(6.0) - 2.0, 0.0, None)


def sticking(simulate, theta, values, rng):
    """One reading is off."""
    return simulate(theta, rng) + values["offset"][:, None] * (np.arange(6) == 4)


def entry(name, amplitude, kind):
    return LibraryEffect(
        name=name, parameters={amplitude: Uniform(-2.0, 2.0)}, amplitude=amplitude, neutral=0.0, step=0.2,
        cause="wear", typical="0.2", kind=kind,
    )  # fmt: skip


OWN = [entry("drift", "drift", drifting), entry("stuck", "offset", sticking)]
FEW = {"simulations": 1500, "replicates": 399}


@pytest.fixture(scope="module")
def drift():
    """Eighty data sets of a plain function, with a drift that it does not know."""
    rng = np.random.default_rng(4)
    theta = PRIOR.sample(80, rng)
    x = drifting(readings, theta, {"drift": np.full(80, 0.25)}, rng)
    return discover(readings, x, prior=PRIOR, effects=OWN, seed=2, **FEW)


def test_a_plain_function_with_effects_of_its_own(drift):
    assert isinstance(drift, Discovery)
    assert drift.named == "drift"
    (said,) = drift.amplitude
    assert said.interval[0] - 0.1 < 0.25 < said.interval[1] + 0.1
    assert drift.provenance["seed"] == 2
    assert drift.not_checked[0].id == "delta_log_evidence"


def test_no_files_unless_they_are_asked_for(drift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    x = readings(PRIOR.sample(40, np.random.default_rng(1)), np.random.default_rng(2))
    told = []
    quiet = discover(readings, x, prior=PRIOR, effects=OWN, progress=lambda *said: told.append(said), **FEW)
    assert list(tmp_path.iterdir()) == []
    assert told[0][1:] == (0, 1)
    assert told[-1][1:] == (1, 1)
    again = discover(readings, x, prior=PRIOR, effects=OWN, out="found", progress=lambda *_: None, **FEW)
    assert {path.name for path in (tmp_path / "found").iterdir()} == {
        "discovery.json", "discovery.nc", "report.html",
    }  # fmt: skip
    stored = json.loads((tmp_path / "found" / "discovery.json").read_text())
    assert stored == again.to_json() == quiet.to_json()
    with xr.open_datatree(tmp_path / "found" / "discovery.nc") as tree:
        assert {"windows", "candidates", "scan", "moments", "null"} <= set(tree.children)


@pytest.fixture(scope="module")
def towns():
    epidemic = build_simulator("epidemic", nodes=5)
    rng = np.random.default_rng(6)
    theta = epidemic.prior.from_unit_cube(np.clip(rng.normal([0.66, 0.4], 0.1, size=(30, 2)), 0.02, 0.98))
    return epidemic, epidemic.simulate(theta, rng)


@pytest.mark.parametrize(
    ("rows", "engine", "scheme"),
    [(1, None, "counts"), (30, None, "catalogue"), (30, "simulations", "simulations")],
)
def test_the_engine_follows_from_simulator_and_data(towns, rows, engine, scheme):
    epidemic, x = towns
    options = FEW if scheme == "simulations" else {"replicates": 99}
    only = ("missed_week", "reporting_delay")
    found = discover(epidemic, x[:rows], engine=engine, only=only, **options)
    measure = "mean square of the moments" if scheme == "simulations" else "mean Poisson deviance per channel"
    assert found.gap.measure == measure
    assert found.data.n_sources == rows
    assert (found.catalogue is not None) == (scheme == "catalogue")
    assert {one.effect for one in found.candidates} == set(only)
    assert found.named is None


def test_data_that_are_no_counts_are_simulated():
    # It has a mean and a likelihood, and neither is Poisson's.
    simulator = build_simulator("linear_gaussian")
    x = simulator.simulate(simulator.prior.sample(40, np.random.default_rng(1)), np.random.default_rng(2))
    moved = LibraryEffect(
        name="moved", parameters={"by": Uniform(-3.0, 3.0)}, amplitude="by", neutral=0.0, step=0.5,
        cause="a zero point", typical="half", kind=lambda s, t, v, r: s(t, r) + v["by"][:, None],
    )  # fmt: skip
    found = discover(simulator, x, effects=[moved], **FEW)
    assert found.gap.measure == "mean square of the moments"


def test_an_effect_of_the_epidemic_that_somebody_wrote(towns):
    epidemic, _ = towns
    vaccinated = LibraryEffect(
        name="vaccinated", parameters={"share": Uniform(0.0, 0.5)}, amplitude="share", neutral=0.0, step=0.1,
        cause="The vaccinated do not get ill.", typical="a tenth",
        kind=EpidemicEffect(
            {"share": (0.0, 1.0)}, report=lambda cases, values: cases * (1.0 - values["share"][..., None])
        ),
    )  # fmt: skip
    rng = np.random.default_rng(9)
    theta = np.exp(rng.normal(np.log([0.4, 0.13]), 0.2, size=(30, 2)))
    reality = epidemic.with_effect(vaccinated.effect(share=0.25))
    # Fixed, the values are arrays too: the recipe of docs/epidemic.md raised TypeError here.
    np.testing.assert_allclose(reality.expected(theta), 0.75 * epidemic.expected(theta))
    own = {"effects": [vaccinated], "only": ("vaccinated",)}
    found = discover(epidemic, reality.simulate(theta, rng), replicates=99, **own)
    assert found.named == "vaccinated"
    assert found.amplitude[0].value == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize(
    ("what", "x", "options", "words"),
    [
        (readings, np.zeros((40, 6)), {}, "readings simulates, and comes without a prior"),
        (readings, None, {}, "a function without data; give discover"),
        ([], None, {}, "a list without data"),
        ("no-such.pha", None, {}, "no-such.pha"),
        (readings, np.zeros((40, 6)), {"prior": PRIOR, "engine": "magic"}, "engine must be one of counts"),
        (readings, np.zeros((40, 6)), {"prior": PRIOR}, "no effect was given"),
    ],
)
def test_mistakes_are_one_clear_line(what, x, options, words):
    if what == "no-such.pha":
        pytest.importorskip("jaxspec")
    with pytest.raises(InputError, match=words) as caught:
        discover(what, x, replicates=399, **{"simulations": 1000, **options})
    assert "\n" not in str(caught.value)


def test_several_sources_are_no_single_one(towns):
    epidemic, x = towns
    with pytest.raises(InputError, match="engine 'counts' takes one source, got 30"):
        discover(Sources.of(epidemic, x), engine="counts")
    with pytest.raises(InputError, match="takes a simulator and x"):
        discover(Sources.of(epidemic, x), engine="simulations")


def test_a_function_is_the_kind_of_an_effect_on_a_function():
    x = readings(PRIOR.sample(40, np.random.default_rng(1)), np.random.default_rng(2))
    with pytest.raises(InputError, match="effect drift: a simulator without with_effect takes a function"):
        discover(readings, x, prior=PRIOR, effects=[entry("drift", "drift", None)], **FEW)
