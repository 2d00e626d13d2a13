"""Every experiment runs at the size of its twin, resumes bit for bit, and measures its claims."""

import numpy as np
import pytest
from studies.kit.results import read, write
from studies.paper import Agreement, Setting, claims, judge
from studies.paper.experiment import committed, made
from studies.paper.experiments import EXPERIMENTS, PAST, load


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pieces")


@pytest.fixture(scope="module", params=(*EXPERIMENTS, *PAST))
def twin(request, folder):
    experiment = load(request.param)
    if experiment.extra == "xray":
        request.getfixturevalue("xray_data")
    return experiment, made(experiment, Setting.TWIN, folder, seed=11)


DIFFERING = {
    *("pair.counts", "tb.ratio", "sub.scaling"),
    *("cal.dev.pn.bright", "tab2.production", "grid.pn.medium.B1.5e-06.D3"),
}
"""Of what is committed; three are the study's own numbers, to more digits than it prints."""


def mine(experiment):
    return {name: claim for name, claim in claims().items() if claim.by == experiment.name}


def test_it_measures_the_claims_that_are_its_and_no_others(twin):
    experiment, table = twin
    assert set(experiment.measured(table)) == set(mine(experiment))


def test_every_claim_is_measured(twin):
    experiment, table = twin
    found = experiment.measured(table)
    judged = [judge(claim, found[name]) for name, claim in mine(experiment).items()]
    assert not [item for item in judged if item.verdict is Agreement.PENDING]


def test_a_run_that_finds_its_pieces_gives_the_same_bits(twin, folder):
    experiment, table = twin
    again = made(experiment, Setting.TWIN, folder, seed=11)
    assert again.drop_attrs().identical(table.drop_attrs())


def test_a_table_survives_its_file_and_says_how_it_was_made(twin, tmp_path):
    experiment, table = twin
    write({"": table}, tmp_path / "a.nc")
    stored = read(tmp_path / "a.nc")
    for name, values in table.data_vars.items():
        np.testing.assert_array_equal(stored[name].values, values.values)
    assert (stored.attrs["experiment"], stored.attrs["setting"]) == (experiment.name, "twin")
    assert stored.attrs["command"] == f"python -m studies.paper {experiment.name} --twin --seed 11"
    assert "numpy" in stored.attrs["versions"]


@pytest.mark.parametrize("name", [*EXPERIMENTS, *PAST])
def test_what_is_committed_is_a_full_run_that_still_says_what_it_said(name):
    table, experiment = committed(name), load(name)
    if table is None:
        pytest.skip(f"{name} has no committed result yet")
    assert (table.attrs["setting"], table.attrs["version"]) == ("full", experiment.version)
    found = experiment.measured(table)
    for key, claim in mine(experiment).items():
        differs = judge(claim, found[key]).verdict is Agreement.DIFFERS
        assert differs == (key in DIFFERING), key


def test_exact_and_arithmetic_claims_agree_but_three():
    experiment = load("published")
    found = experiment.measured(experiment.run({}, None, 1))
    verdicts = {name: judge(claim, found[name]).verdict for name, claim in mine(experiment).items()}
    assert len(verdicts) == 42
    assert set(verdicts.values()) == {Agreement.AGREES, Agreement.DIFFERS}
    differing = {name for name, verdict in verdicts.items() if verdict is Agreement.DIFFERS}
    assert differing == {"pair.counts", "tb.ratio", "sub.scaling"}


def test_the_published_intervals_and_p_values_come_out_too():
    """Beside the claims themselves; bootstrap and permutation errors are far below these tolerances."""
    experiment = load("published")
    found = {name: item.parts for name, item in experiment.measured(experiment.run({}, None, 1)).items()}
    assert found["pair.mean"]["error"] == pytest.approx(1.37, abs=0.005)
    assert found["pair.mean"]["p"] == pytest.approx(0.812, abs=0.0005)
    assert found["pair.reg.slope"]["error"] == pytest.approx(24.2, abs=0.05)
    assert found["pair.reg.slope"]["p"] == pytest.approx(0.0021, abs=0.002)
    assert found["pair.reg.intercept"]["error"] == pytest.approx(0.87, abs=0.005)
    for name, low, high in (("B1.medium", -90, -44), ("B1.bright", -1166, -562), ("B4.medium", 3, 26)):
        part = found[f"ns.cc.{name}"]
        assert part["low"] == pytest.approx(low, abs=0.06 * (high - low))
        assert part["high"] == pytest.approx(high, abs=0.06 * (high - low))
