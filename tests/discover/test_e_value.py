"""The e-value beside a name: it changes nothing else, and pays for the choice of the name."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Candidates, Sources, discover_source
from gaugeblock.simulators.effects import Effect

THETA = np.array([20_000.0, 1.5])


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None])


def searched(library, hidden, **options):
    true = library.simulator
    for effect in hidden:
        true = true.with_effect(effect)
    sources = Sources.of(library.simulator, true.simulate(THETA[None], np.random.default_rng(11)))
    return discover_source(sources, library=library, replicates=399, **options)


def test_it_is_reported_with_the_choice_paid_for(library):
    hidden = [Effect("edge", {"energy": 2.4, "depth": 0.25})]
    plain, found = searched(library, hidden), searched(library, hidden, e_value=True)
    assert plain.to_json()["e_value"] is None
    said = found.to_json()["e_value"]
    assert said["paths"] == len(library)
    assert said["log"] == pytest.approx(said["log_own"] - np.log(len(library)))
    assert said["p"] == pytest.approx(np.exp(-said["log"]))
    assert said["log"] > np.log(20)
    assert found.to_json() | {"e_value": None} == plain.to_json()
    told = []
    again = searched(library, hidden, e_value=True, step=told.append)
    assert again.to_json()["e_value"] == said
    assert "split likelihood ratio" in told[-1]


def test_two_effects_pay_twice(library):
    hidden = [Effect("line", {"energy": 5.0, "counts": 700.0}), Effect("edge", {"energy": 1.2, "depth": 0.2})]
    found = searched(library, hidden, e_value=True)
    assert len(found.named_all) == 2
    assert found.to_json()["e_value"]["paths"] == len(library) ** 2


def test_where_nothing_is_named_there_is_none(library):
    assert searched(library, [], e_value=True).e_value is None


def test_where_it_cannot_be_had_it_is_said_and_the_name_stays(library, monkeypatch):
    def refused(*_, **__):
        raise InputError("no halves of this")

    monkeypatch.setattr("gaugeblock.discovery.record.split_likelihood_ratio", refused)
    hidden = [Effect("edge", {"energy": 2.4, "depth": 0.25})]
    found = searched(library, hidden, e_value=True)
    assert found.named == "edge"
    assert found.e_value is None
    assert [(one.id, one.why) for one in found.not_checked] == [("e_value", "no halves of this")]
