"""One way in to discovery: the engine that fits, functions with effects of one's own, files if asked."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats
import xarray as xr

from gaugeblock.auditing import discovering
from gaugeblock.auditing.discovering import WithFunctions, discover, own_effects, read_measured
from gaugeblock.auditing.identity import versions
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Discovery, Sources
from gaugeblock.discovery.result import Estimate, FitSaid, FitState
from gaugeblock.simulators import Effect, Normal, Prior, Uniform, build_simulator
from gaugeblock.simulators.epidemic import EpidemicEffect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import poisson_log_likelihood

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
    # Each step ends before the next one begins.
    assert len({what for what, _, _ in told}) > 2
    assert told == [(what, done, 1) for what, begun, _ in told if not begun for done in (0, 1)]
    record = quiet.provenance
    assert (record["command"], record["seed"], record["replicates"], record["notes"]) == ("", 0, 399, [])
    assert record["data"] == digest(x.tolist())
    assert record["versions"] == versions()
    assert (record["model"], len(record["simulators"])) == (quiet.model_before, 1)
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
    options = FEW if scheme == "simulations" else {"replicates": 399}
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
    theta = np.exp(rng.normal(np.log([0.4, 0.13]), 0.2, size=(16, 2)))
    reality = epidemic.with_effect(vaccinated.effect(share=0.25))
    # Fixed, the values are arrays too: the recipe of docs/epidemic.md raised TypeError here.
    np.testing.assert_allclose(reality.expected(theta), 0.75 * epidemic.expected(theta))
    own = {"effects": [vaccinated], "only": ("vaccinated",)}
    found = discover(epidemic, reality.simulate(theta, rng), replicates=99, **own)
    assert found.named == "vaccinated"
    # Three of its standard errors: chance leaves it in fewer than one of two hundred seeds.
    assert found.amplitude[0].value == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize(
    ("what", "x", "options", "words"),
    [
        (readings, np.zeros((40, 6)), {}, "readings simulates, and comes without a prior"),
        (readings, None, {}, "a function without data; give discover"),
        ("epidemic", np.ones((1, 12)), {"replicates": 398}, "at least 399 replicates, got 398"),
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
        discover(what, x, **{"simulations": 1000, "replicates": 399, **options})
    assert "\n" not in str(caught.value)


def bent(change):
    """An effect of one's own that is no good."""
    return [entry("drift", "drift", change)]


@pytest.mark.parametrize(
    ("simulate", "effects", "words"),
    [
        (readings, bent(lambda s: 1), r"effect drift failed on \d+ parameter vectors: TypeError: .* given$"),
        (readings, bent(lambda s, t, v, r: np.zeros(3)), r"data of shape \(3,\) for \d+ parameter vectors$"),
        (readings, bent(lambda s, t, v, r: s(t, r)[:, 1:]), "of 5 numbers each, where the model's have 6"),
        (readings, {"mine": readings}, "effect mine: holds a function, not a LibraryEffect"),
        (lambda theta, rng: 1 / 0, OWN, "the simulator failed on 1 parameter vectors: ZeroDivisionError"),
        (
            lambda theta, rng: np.where(theta[:, :1] > 0.0, np.nan, readings(theta, rng)), OWN,
            r"NaN or infinite numbers in \d+ of 1500 data sets or their summaries: mend what simulates them",
        ),
    ],
)  # fmt: skip
def test_code_of_ones_own_that_fails_is_said_to_have(simulate, effects, words):
    x = readings(PRIOR.sample(40, np.random.default_rng(1)), np.random.default_rng(2))
    with pytest.raises(InputError, match=words) as caught:
        discover(simulate, x, prior=PRIOR, effects=effects, **FEW)
    assert "\n" not in str(caught.value)


def test_one_effect_needs_no_list_and_a_prior_may_be_of_scipy():
    mine = replace(entry("drift", "drift", None), parameters={"drift": scipy.stats.uniform(-1.0, 2.0)})
    assert mine.parameters["drift"] == Uniform(-1.0, 1.0)
    assert own_effects(mine) == own_effects([mine]) == {"drift": mine}
    assert own_effects({"other": mine}) == {"other": mine}
    for prior in (
        scipy.stats.norm([0.0, 0.0], [1.0, 1.0]),
        scipy.stats.multivariate_normal([0.0, 0.0]),
        lambda n, rng: rng.normal(size=(n, 1)),
    ):
        with pytest.raises(InputError, match="the prior of drift must be a distribution of one number"):
            replace(mine, parameters={"drift": prior})


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


class Asked(Exception):
    """A search has come to its work."""


@pytest.fixture
def asked(monkeypatch):
    """Stands where the engines are, and keeps which was asked, and what."""
    found = []

    def engine(name):
        def run(*given, **named):
            found.append((name, given, named))
            raise Asked

        return run

    for name in ("source", "catalogue", "simulated"):
        monkeypatch.setattr(discovering, f"discover_{name}", engine(name))

    def ask(*given, **named):
        with pytest.raises(Asked):
            discover(*given, progress=False, **named)
        return found.pop()

    return ask


class Rates:
    """Three channels of one rate."""

    prior = Prior({"level": Uniform(0.5, 2.0)})

    def expected(self, theta):
        return np.asarray(theta)[..., :1] * [1.0, 2.0, 3.0]

    def simulate(self, theta, rng):
        return rng.poisson(self.expected(theta))

    def with_effect(self, effect):
        return self


class Counted(Rates):
    off = 0.0

    def log_likelihood(self, theta, x):
        return poisson_log_likelihood(self.expected(theta), x) + self.off


class Elsewise(Counted):
    off = 1e-3


class Mean:
    """Without a mean that is known."""

    prior, simulate, with_effect = Rates.prior, Rates.simulate, Rates.with_effect


ONE, MANY = np.array([[3, 1, 4]]), np.array([[3, 1, 4], [0, 5, 9]])


@pytest.mark.parametrize(
    ("simulator", "x", "engine", "wanted"),
    [
        (Rates(), ONE, None, "source"),
        (Rates(), ONE[0], None, "source"),
        (Counted(), ONE.astype(float), None, "source"),
        (Counted(), MANY, None, "catalogue"),
        (Rates(), ONE, "catalogue", "catalogue"),
        (Rates(), ONE, "simulations", "simulated"),
        (Elsewise(), MANY, None, "simulated"),
        (Elsewise(), MANY, "catalogue", "catalogue"),
        (Rates(), MANY + 0.5, None, "simulated"),
        (Rates(), MANY - 1, None, "simulated"),
        (Rates(), MANY[:, :, None], None, "simulated"),
        (Mean(), MANY, None, "simulated"),
    ],
)
def test_counts_and_their_mean_say_most(asked, simulator, x, engine, wanted):
    name, given, named = asked(simulator, x, engine=engine, only=["a"], replicates=77, seed=5)
    assert name == wanted
    assert (named["seed"], named["only"], named["replicates"], named["effects"]) == (5, ("a",), 77, {})
    if wanted == "simulated":
        assert given[0] is simulator
        np.testing.assert_array_equal(given[1], x)
        assert (named["most"], named["simulations"], named["summaries"]) == (1, 10_000, None)
    else:
        (sources,) = given if wanted == "source" else given[0]
        assert sources.simulator is simulator
        np.testing.assert_array_equal(sources.counts, np.atleast_2d(x))
    if wanted == "source":
        assert (named["energy"], named["evidence"], named["e_value"]) == (None, False, True)


def test_sources_that_were_made_before(asked):
    one, many = Sources.of(Rates(), ONE), Sources.of(Rates(), MANY)
    assert asked(one, energy=6.4, evidence=True)[2]["energy"] == 6.4
    assert asked([one])[:2] == ("source", (one,))
    assert asked(many)[:2] == ("catalogue", ([many],))
    assert asked([one, many])[:2] == ("catalogue", ([one, many],))
    assert asked(one, engine="catalogue")[0] == "catalogue"
    executor = object()
    for what, options in ((one, {}), (Mean(), {"x": MANY})):
        with pytest.raises(InputError) as caught:
            discover(what, executor=executor, **options)
        assert str(caught.value) == (
            "discover: workers share the sources of a catalogue, and this is none: leave out --workers, "
            "--scheduler or executor"
        )
    for what, options in ((many, {}), (Mean(), {"x": MANY}), (one, {"engine": "catalogue"})):
        with pytest.raises(InputError, match=r"^discover: an energy can be stated of counts of one source$"):
            discover(what, energy=6.4, **options)


def test_effects_of_ones_own_by_name():
    first, last = OWN
    assert own_effects({"other": first}) == {"other": first}
    assert own_effects([first, last]) == {"drift": first, "stuck": last}
    assert own_effects([OWN, {"a": last}]) == {"drift": first, "stuck": last}
    assert own_effects([f"{__name__}:OWN"]) == {"drift": first, "stuck": last}
    assert own_effects([f"{__name__}:FIRST"]) == {"drift": first}
    with pytest.raises(InputError) as caught:
        own_effects([[first, 3]])
    assert str(caught.value).endswith("holds a int, not a LibraryEffect")


FIRST = OWN[0]


def test_effects_are_worked_in_one_after_the_other_each_with_parameters_of_its_own():
    seen = []

    def base(theta, rng):
        seen.append(theta)
        return theta[:, :1] * 10.0

    def added(simulate, theta, values, rng):
        return simulate(theta, rng) + values["by"][:, None] + 100.0 * values["size"][:, None]

    def doubled(simulate, theta, values, rng):
        return values["times"][:, None] * simulate(theta, rng)

    plain = WithFunctions(base, PRIOR)
    own = plain.with_effect(Effect("add", {"by": Uniform(0.0, 1.0), "size": 2}, kind=added))
    own = own.with_effect(Effect("times", {"times": Uniform(0.0, 3.0)}, kind=doubled))
    own = own.with_effect(Effect("add", {"by": 5.0, "size": Uniform(0.0, 1.0)}, kind=added))
    assert own.prior.names == ("level", "add_1.by", "times_1.times", "add_2.size")
    assert plain.prior.names == ("level",)
    theta = [[1.0, 0.5, 3.0, 0.25], [2.0, 0.25, 2.0, 0.5]]
    found = own.simulate(theta, np.random.default_rng(1))
    assert found.ravel().tolist() == [(10 + 0.5 + 200) * 3 + 5 + 25, (20 + 0.25 + 200) * 2 + 5 + 50]
    assert seen[-1].tolist() == [[1.0], [2.0]]
    assert plain.simulate([[1.5]], np.random.default_rng(1)).tolist() == [[15.0]]
    fixed = plain.with_effect(Effect("add", {"by": 1.0, "size": 0.0}, kind=added))
    assert fixed.prior.names == ("level",)
    assert fixed.simulate([[1.5]], np.random.default_rng(1)).tolist() == [[16.0]]


def test_files_of_one_source_or_a_folder_of_many(tmp_path, monkeypatch):
    from gaugeblock.simulators.xray import catalog, observation

    calls = []
    one = SimpleNamespace(
        simulator=Rates(), counts=ONE.astype(float), scale=np.ones(1), redshift=np.zeros(1), names=("a",)
    )

    def kept(*given, **named):
        calls.append((given, named))
        return one

    monkeypatch.setattr(catalog, "read_catalog", lambda *given, **named: (kept(*given, **named), one))
    monkeypatch.setattr(observation, "read_observation", kept)
    told = []
    common = {
        "rmf": (), "arf": (), "background": (), "redshift": 0.3, "seed": 4, "model": "powerlaw",
        "progress": lambda *said: told.append(said),
    }  # fmt: skip
    (found,) = read_measured("a.pha", **common)
    assert (found.simulator, found.names) == (one.simulator, ("a",))
    none = {
        "rmf": None, "arf": None, "background": None, "redshift": 0.3, "model": "powerlaw", "sys_err": False,
    }  # fmt: skip
    assert calls.pop() == (((Path("a.pha"),),), none)
    read_measured(
        ["a.pha", Path("b.pha")], **{**common, "rmf": "r", "arf": ["s", "t"], "background": ("none",)}
    )
    assert calls.pop() == (
        ((Path("a.pha"), Path("b.pha")),),
        {**none, "rmf": (Path("r"),), "arf": (Path("s"), Path("t")), "background": ("none",)},
    )
    assert len(read_measured(tmp_path, **common)) == 2
    given, named = calls.pop()
    named.pop("progress")(3, 7)
    assert told == [("reading spectra", 3, 7)]
    assert given == (tmp_path,)
    assert named == {"rmf": None, "arf": None, "background": True, "seed": 4, "model": "powerlaw"}
    read_measured(tmp_path, **{**common, "rmf": ["r"], "arf": "s", "background": ("none",)})
    named = calls.pop()[1]
    assert (named["rmf"], named["arf"], named["background"]) == (Path("r"), Path("s"), False)
    for files, more, said in (
        ([], {}, "name PHA files of one source, or a folder with a catalogue of many"),
        ([tmp_path, "a.pha"], {}, "name either PHA files of one source, or one folder with many"),
        (tmp_path, {"rmf": ["a", "b"]}, "a catalogue takes one --rmf and one --arf at most"),
        (tmp_path, {"arf": ["a", "b"]}, "a catalogue takes one --rmf and one --arf at most"),
        (tmp_path, {"band": [(0.5, 8.0), (1.0, 2.0)]}, "a catalogue takes one band for all of its spectra"),
        (tmp_path, {"sys_err": True}, "SYS_ERR is used of one source; weights of many would differ"),
    ):
        with pytest.raises(InputError) as caught:
            read_measured(files, **{**common, **more})
        assert str(caught.value) == f"discover: {said}"
    assert calls == []


def test_of_one_source_the_best_fits_are_written_for_xspec(drift, tmp_path, monkeypatch):
    class Told:
        prior = PRIOR
        effects = ()

        def expected(self, theta):
            return np.ones((len(theta), 3))

        def with_effect(self, effect):
            return self

        def xcm(self, values, effects):
            if any(effect.name == "gain" for effect in effects):
                raise InputError("XSPEC has no gain")
            return f"{values} {[(effect.name, effect.fixed) for effect in effects]}\n"

    def state(**values):
        return FitState({name.replace("__", "."): Estimate(value) for name, value in values.items()})

    before, after = (
        state(level=1.0),
        state(level=2.0, line_1__energy=6.4, edge_1__depth=0.1, line_2__energy=7.0),
    )
    canned = replace(drift, fit=FitSaid(before, None), named_all=())
    monkeypatch.setattr(discovering, "discover_source", lambda *_, **__: canned)
    source = Sources.of(Told(), [3.0, 4.0, 5.0])
    texts = {name: tmp_path / f"model_{name}.xcm" for name in ("before", "after")}
    discover(source, out=tmp_path)
    assert texts["before"].read_text() == "{'level': 1.0} []\n"
    assert not texts["after"].exists()
    canned = replace(drift, fit=FitSaid(before, after), named_all=("line", "edge", "line"))
    discover(source, out=tmp_path)
    assert (
        texts["after"]
        .read_text()
        .endswith("[('line', {'energy': 6.4}), ('edge', {'depth': 0.1}), ('line', {'energy': 7.0})]\n")
    )
    # Of an effect that XSPEC does not have nothing is written, nor left from before.
    canned = replace(canned, named_all=("line", "gain"))
    said = discover(source, out=tmp_path).to_json()
    assert said["provenance"]["notes"] == ["model_after.xcm was not written: XSPEC has no gain"]
    assert texts["before"].exists()
    assert not texts["after"].exists()
    assert discover(source).to_json()["provenance"]["notes"] == []
