"""The registry holds every claim of the published list, with its value, and an experiment for each."""

import json

import numpy as np
import pytest
from studies.paper import Kind, claims, find
from studies.paper.claim import Counted, claim_of
from studies.paper.experiments import EXPERIMENTS, PAST, load
from studies.paper.rows import published_rows

from gaugeblock.core.errors import InputError


@pytest.fixture(scope="module")
def targets(shared_file):
    file = shared_file("paper/paper_targets.json")
    return {target["id"]: target for target in json.loads(file.read_text())["targets"]}


def without_gaps(value):
    """A published value without the entries that are missing in it."""
    return {k: v for k, v in value.items() if v is not None} if isinstance(value, dict) else value


def test_there_are_477_claims_of_six_kinds():
    numbers = {kind: sum(claim.kind is kind for claim in claims().values()) for kind in Kind}
    assert sum(numbers.values()) == 477
    assert numbers == {
        Kind.FLOW: 401, Kind.SIMULATOR: 24, Kind.ARITHMETIC: 22, Kind.EXACT: 17, Kind.SETUP: 12,
        Kind.ARTEFACT: 1,
    }  # fmt: skip


def test_ids_values_and_kinds_are_the_published_ones(targets):
    assert set(claims()) == set(targets)
    for name, target in targets.items():
        assert claims()[name].value == without_gaps(target["value"]), name
        assert claims()[name].kind.value == target["kind"], name


def test_stated_bounds_are_ours(targets):
    """Where the list states bounds as numbers, a rule has the same."""
    for name, target in targets.items():
        low, high = target["tolerance"].get("low"), target["tolerance"].get("high")
        if low is None:
            continue
        rules = claims()[name].rules
        lows = np.atleast_1d(low) if len(np.atleast_1d(low)) == len(rules) else np.repeat(low, len(rules))
        highs = np.atleast_1d(high) if len(np.atleast_1d(high)) == len(rules) else np.repeat(high, len(rules))
        assert [(rule.low, rule.high) for rule in rules] == list(zip(lows, highs, strict=True)), name


def test_errors_of_the_grid_are_the_published_ones(targets):
    for name, target in targets.items():
        if name.startswith("grid.") and not claims()[name].known:
            assert claims()[name].error["value"] == pytest.approx(target["uncertainty"], abs=1e-4), name


def test_every_claim_has_an_experiment_and_every_experiment_but_those_past_them_a_claim():
    by = {claim.by for claim in claims().values()}
    assert by == set(EXPERIMENTS)
    assert not by & set(PAST)
    assert [load(name).name for name in (*EXPERIMENTS, *PAST)] == [*EXPERIMENTS, *PAST]


def test_every_claim_has_rules_in_words_and_short_ones_of_its_own():
    for name, claim in claims().items():
        assert claim.rules or claim.counted is Counted.REPORTED, name
        assert all(rule.words() for rule in claim.rules), name
        assert 0 < len(claim.says) < 110, name


def test_what_was_measured_on_nicer_is_a_transfer_check():
    ours = {name for name, claim in claims().items() if claim.transfer}
    assert ours == {name for name in claims() if "nicer" in name and not name.startswith("scale.")} | {
        "det.areacross"
    }


def test_claims_are_found_by_id_and_by_experiment():
    assert list(find(("ns.trend",))) == ["ns.trend"]
    assert set(find(("nested",))) == {"tb.sigma", "tb.floor"}
    assert len(find(())) == 477
    with pytest.raises(InputError, match="neither a claim nor an experiment") as caught:
        find(("tab9",))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rules": [{"near": 3}]}, "no rule is made of near"),
        ({"tolerance": 1}, "tolerance"),
        ({"value": [1.0, 2.0]}, "2 numbers and 0 names"),
        ({"error": {"other": 1.0}}, "no parts of it"),
    ],
)
def test_a_table_that_is_no_claim_is_one_line(change, words):
    table = {"says": "s", "kind": "flow", "value": 1.0, "rules": [{"within": 1}], "by": "x"} | change
    with pytest.raises(InputError, match=words):
        claim_of("a", "section", table)


def test_published_rows_are_those_of_the_study(shared_file):
    rows, bench = published_rows(), json.loads(shared_file("paper/reference/ns_bench.json").read_text())
    given = {row["logz"]: row for row in bench["rows"]}
    assert len(given) == 76
    for i, logz in enumerate(rows["log_evidence"].values):
        row = given[float(logz)]
        assert (row["n_counts"], row["capped"]) == (rows["counts"].values[i], rows["capped"].values[i])
        np.testing.assert_array_equal(row["ns_q"], rows["nested_quantile"].values[i])
        np.testing.assert_array_equal(row["npe_q"], rows["flow_quantile"].values[i])
        np.testing.assert_array_equal(row["truth"], rows["truth"].values[i])
    pairs = json.loads(shared_file("paper/reference/paired_gain_check.json").read_text())["rows"]
    difference = rows["pair_log_evidence_gain"] - rows["pair_log_evidence_clean"]
    np.testing.assert_allclose(difference, [pair["d_paired"] for pair in pairs], rtol=1e-12)
