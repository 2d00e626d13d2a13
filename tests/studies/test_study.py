"""The study itself with few replicates: the same code, the same parts, tables, figures and text."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats
from studies import gate, power, size
from studies.__main__ import main, parts
from studies.document import read
from studies.replicates import Part, run
from studies.summary import clopper_pearson, indicators, p_values

from gaugeblock.errors import InputError


def draw(seed):
    return {"below": float(np.random.default_rng(seed).random() < 0.3)}


PART = Part(
    name="toy",
    says="a coin",
    cases={"a": draw, "b": draw},
    replicates=3,
    settings={"chance": 0.3},
    summarise=indicators,
)


def test_results_do_not_depend_on_workers_or_interruptions(tmp_path):
    whole = run(PART, tmp_path / "one", seed=1, replicates=40)
    assert run(PART, tmp_path / "two", seed=1, replicates=40, workers=2).values == whole.values
    run(PART, tmp_path / "three", seed=1, replicates=15)
    file = tmp_path / "three" / "toy.jsonl"
    file.write_text(file.read_text()[:-7])  # stopped in the middle of a line
    said = []
    again = run(PART, tmp_path / "three", seed=1, replicates=40, progress=lambda *now: said.append(now))
    assert again.values == whole.values
    assert said[0] == ("toy", 30, 80)
    assert said[-1] == ("toy", 80, 80)
    assert whole.values["a"] != whole.values["b"]


def test_replicates_of_other_settings_are_not_mixed(tmp_path):
    run(PART, tmp_path, seed=1)
    with pytest.raises(InputError, match="another seed or other settings; remove it"):
        run(PART, tmp_path, seed=2)


def test_counts_have_exact_intervals():
    results = {"a": [{"x": 1.0}, {"x": 0.0, "y": 1.0}, {"x": np.nan}], "b": [{}, {}, {}]}
    table = indicators(results)
    assert table["count"].sel(case="a").values.tolist() == [1, 1]
    assert table["replicates"].values.tolist() == [[2, 3], [3, 3]]
    low, high = clopper_pearson([0, 3], [10, 10])
    expected = stats.binomtest(3, 10).proportion_ci(method="exact")
    assert (low[0], low[1]) == (0, pytest.approx(expected.low))
    assert (high[0], high[1]) == (pytest.approx(1 - 0.025 ** (1 / 10)), pytest.approx(expected.high))
    table = p_values({"a": [{"t": 0.005}, {"t": 0.04}, {"t": 0.9}, {"t": np.nan}]})
    assert table["rejected"].values.tolist() == [[1, 2, 2]]
    assert table["replicates"].values.tolist() == [3]
    assert table["histogram"].values.sum() == 3


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Every part with few replicates."""
    out = tmp_path_factory.mktemp("study")
    made = {"size": size.part(), "gate": gate.part(out, seed=1, references=4), "power": power.part()}
    replicates = {"size": 20, "gate": 8, "power": 1}
    return {name: run(part, out, seed=1, replicates=replicates[name]) for name, part in made.items()}


def test_no_p_value_is_far_off_its_size(few):
    """20 replicates a case: at most 8 of p <= 0.05 (chance 1e-6 for each of some 100 tests)."""
    table = p_values(few["size"].values)
    assert table.sizes["row"] > 15
    assert int(table["rejected"].sel(level=0.05).max()) <= 8
    assert (table["rate"].sel(level=0.1) < 1).all()


def test_the_whole_gate_is_rarely_wrong(few):
    """8 replicates a case: more than 4 of either error has chance 4e-5 at 5%, in 16 cases."""
    table = indicators(few["gate"].values)
    assert int(table["count"].sel(thing="FAIL").max()) <= 4
    assert int(table["count"].sel(thing="PASS").drop_sel(case="exact").max()) <= 4
    outcomes = table["count"].sel(thing=["PASS", "FAIL", "INCONCLUSIVE"]).sum("thing")
    assert (outcomes == 8).all()
    assert int(table["count"].sel(thing="inside").min()) >= 4


def test_gross_faults_are_blocked(few):
    """Members that any gate must see; one replicate each, at a power beyond 0.999."""
    table = indicators(few["power"].values)
    failed = table["count"].sel(thing="FAIL")
    for name in ("parameters swapped", "prior as posterior", "NaN in 1% of draws", "truth leaked"):
        assert int(failed.sel(case=name)) == 1, name
    assert set(power.ZOO) == set(table["case"].values.tolist())


def test_the_command_keeps_a_small_table_that_says_how_it_was_made(tmp_path, capsys):
    arguments = ["shortcut", "--replicates", "2", "--out", str(tmp_path), "--seed", "3"]
    assert main(arguments) == 0
    table = read("shortcut", tmp_path)
    assert table.attrs["command"] == "python studies/run.py " + " ".join(arguments)
    assert "numpy" in json.loads(table.attrs["versions"])
    assert int(table["replicates"].max()) == 2
    assert main([*arguments[:-1], "4"]) == 2
    assert "other settings" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["nothing"])
    assert set(parts(tmp_path, 1)) >= {"size", "gate", "shortcut", "power"}
