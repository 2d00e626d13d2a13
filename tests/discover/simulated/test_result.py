"""What the three engines say, in one shape: the same keys, one report, short words."""

import json

import numpy as np
import pytest

from gaugeblock.discovery import Sources, discover_catalogue, discover_simulated, discover_source
from gaugeblock.reports.discovery import write_discovery
from gaugeblock.simulators.effects import Effect

CONTRACT = {
    "disagreement", "candidates", "named", "named_all", "indistinguishable", "model_before", "model_after",
    "gap", "decoys", "provenance", "statements", "fit",
}  # fmt: skip


@pytest.fixture(scope="module", name="told")
def told_fixture():
    """What each of them says that begins."""
    return {"counts": [], "catalogue": [], "simulations": []}


@pytest.fixture(scope="module")
def all_three(power_law, ruler, readings, told):
    """A dip in one source, the same in forty, a spike in readings that can only be simulated."""
    plain, rng = power_law(), np.random.default_rng(1)
    theta = np.stack([1e4 * np.exp(rng.uniform(-1, 1, 40)), rng.uniform(0.5, 2.5, 40)], axis=1)
    dipped = plain.with_effect(Effect("dip", {"energy": 1.7, "depth": -0.12}))
    alone = dipped.simulate(np.array([[20_000.0, 1.5]]), np.random.default_rng(11))
    one = discover_source(Sources.of(plain, alone), replicates=399, step=told["counts"].append)
    forty = [Sources.of(plain, dipped.simulate(theta, rng))]
    many = discover_catalogue(forty, replicates=199, step=told["catalogue"].append)
    x = readings(200, 11, spike={"height": 0.5, "mark": 2.0})
    learned = discover_simulated(
        ruler, x, seed=1, simulations=2000, replicates=399, step=told["simulations"].append
    )
    return {"counts": one, "catalogue": many, "simulations": learned}


def keys(data):
    """Keys all the way down; lists by their first item, a mapping of names by none of them."""
    if isinstance(data, dict):
        named = {
            "parameters",
            "effects",
            "before",
            "after",
            "units",
            "provenance",
            "beside_nuisances",
            "others",
        }
        return {key: None if key in named else keys(value) for key, value in data.items()}
    return keys(data[0]) if isinstance(data, list) and data else None


def test_the_same_keys_whatever_was_searched(all_three):
    told = {name: keys(found.to_json()) for name, found in all_three.items()}
    assert set(told["counts"]) >= CONTRACT
    for part in ("candidates", "decoys", "amplitude", "gap", "data", "not_checked"):
        shapes = [json.dumps(one[part], sort_keys=True) for one in told.values() if one[part]]
        assert len(set(shapes)) == 1, part
    assert set(told["counts"]) == set(told["catalogue"]) == set(told["simulations"])


@pytest.mark.usefixtures("all_three")
def test_what_begins_is_told_in_order(told):
    begun = {
        "counts": ["fitting the model as it is"],
        "catalogue": ["fitting 40 sources"],
        "simulations": ["fitting the population of theta", "learning the score of every effect"],
    }
    for (name, said), held in zip(told.items(), ("counts", "sources", "data sets"), strict=True):
        assert said == [
            *begun[name],
            "locating where model and data disagree",
            "fitting the candidates for effect 1",
            f"scoring on held-out {held}",
            "measuring the amplitude",
        ]


def test_regions_have_one_pair_of_ends_and_energies_where_they_are_energies(all_three):
    for name, found in all_three.items():
        region = found.to_json()["disagreement"]["regions"][0]
        assert {"lo", "hi", "unit", "z", "p_global", "start", "stop"} <= set(region)
        assert region["lo"] < region["hi"]
        energies = {"energy_lo_kev", "energy_hi_kev"} & set(region)
        assert bool(energies) == (name != "simulations")
        if energies:
            assert (region["energy_lo_kev"], region["energy_hi_kev"]) == (region["lo"], region["hi"])


def test_names_gaps_and_fits_are_there_for_all(all_three):
    for name, found in all_three.items():
        assert found.named == ("spike" if name == "simulations" else "dip")
        assert found.gap.held_out.after < found.gap.held_out.before
        assert found.fit.after is not None
        first = found.statements[0]
        assert first.effect == found.named
        assert first.indistinguishable == found.indistinguishable
        low, high = (0.9, 0.981) if first.certain else (0.8, 0.841)
        assert low < first.probability < high
        assert first.text
        assert len(found.fit.after.parameters) > len(found.fit.before.parameters)
        assert {"candidates", "scan", "windows", "held_out"} <= set(found.tree.children)
        correlation = found.tree["candidates"]["correlation"].values
        np.testing.assert_allclose(np.diag(correlation), 1.0, atol=1e-6)


def test_one_report_for_all(all_three, tmp_path):
    for name, found in all_three.items():
        write_discovery(found, tmp_path / name)
        page = (tmp_path / name / "report.html").read_text()
        assert json.loads((tmp_path / name / "discovery.json").read_text()) == found.to_json()
        assert found.gap.measure in page
        assert 'id="where"' in page
        assert 'id="what"' in page
        assert "no group" not in page
        assert ('id="spectrum"' in page) == (name != "simulations")


def test_a_discovery_is_told_in_few_words(all_three):
    for found in all_three.values():
        said = repr(found)
        assert len(said) < 2000
        assert found.named in said
        assert "global p" in said
        assert "<strong" in found._repr_html_()
        assert len(found._repr_html_()) < 6000


def test_what_was_no_candidate_is_none(all_three):
    with pytest.raises(KeyError, match="glow"):
        all_three["counts"].candidate("glow")
