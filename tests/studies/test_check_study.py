"""The study of checks, small: its parts, its tables, and that the page says what was found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from studies.check import problems
from studies.check.__main__ import main, powers, sizes
from studies.check.document import power_table, size_table
from studies.check.parts import BENCHMARKS, batch
from studies.check.published import ward
from studies.kit.results import DOCS, RESULTS, read

SMALL = {"learned": 600, "fresh": 199}


def test_a_batch_rejects_what_was_made_seldom_and_sees_what_was_planted():
    """60 observations; more than 10 rejections at 5% would be an accident of 0.02%."""
    parts = [batch(problems.IMAGE, 20, np.random.default_rng(seed), **SMALL) for seed in range(3)]
    found = {"image": {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}}
    table = sizes(found)
    assert int(table["observations"][0]) == 60
    assert int(table["rejected"][0]) <= 10
    assert float(table["outlier_seen"][0, -1]) > float(table["outlier_seen"][0, 0])
    assert float(table["outlier_right"][0, -1]) / float(table["outlier_told"][0, -1]) > 0.8
    rejected = found["image"]["p"] <= 0.05
    assert (found["image"]["outlier seen"][rejected] == 1).any()
    both = found["image"]["outlier seen"][:, -1] * found["image"]["outlier right"][:, -1] * ~rejected
    assert float(table["outlier_right"][0, -1]) == both.sum()
    text = size_table(
        table.assign_attrs(batches=3, learned=600, fresh=199, command="python -m studies check")
    )
    assert text.count("|\n") + 1 >= 3
    assert "image" in text


def test_a_summary_that_is_astray_is_probably_misspecified():
    """Against the same probability by integrating over a grid, for one Gaussian summary."""
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(1)
    simulated = rng.normal(3.0, 2.0, (20000, 1))
    detector = ward(simulated, rng)
    places = np.array([[3.0], [9.0], [23.0]])
    y = (places[:, 0] - 3.0) / 2.0
    x = np.linspace(-8, 12, 40001)
    spike = stats.norm(0, (1 + 0.01**2) ** 0.5).pdf(y)
    slab = np.array([np.trapezoid(stats.norm.pdf(x) * stats.cauchy(scale=0.25).pdf(one - x), x) for one in y])
    assert detector(places)[:2] == pytest.approx(np.log(slab / spike)[:2], abs=0.5)
    assert detector(places)[2] > 20


@pytest.mark.parametrize("name", ["gaussian", "sir"])
def test_benchmarks_compare_ours_and_theirs(name):
    pytest.importorskip("sklearn")
    make, cases = BENCHMARKS[name]
    found = make(np.random.default_rng(2), observations=60, **SMALL)
    assert all(part.shape == (len(cases),) for part in found.values())
    assert found["ours"][0] < 0.2
    assert found["ours"][1] > 0.7
    table = powers({name: [found, {which: part - 0.1 for which, part in found.items()}]})
    assert table["ours"].shape == (2, len(cases))
    made = table.assign(ours=table["theirs"] + np.array([[0.1], [0.3]]))
    text = power_table(made.assign_attrs(command="python -m studies check"))
    assert cases[1] in text
    assert text.count("| +20.0 +- 10.0 |") == len(cases)


def test_a_line_for_what_is_named_and_pieces_are_found_again(capsys, tmp_path):
    command = ["two moons", "--batches", "2", "--observations", "5", "--learned", "400", "--fresh", "99"]
    command += ["--out", str(tmp_path)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert said.startswith("two moons")
    assert main(command) == 0
    assert capsys.readouterr().out == said
    assert not (tmp_path / "check.nc").exists()


def test_the_page_says_what_was_found():
    text = (DOCS / "check.md").read_text(encoding="utf-8")
    assert size_table(read(RESULTS / "check.nc")) in text
    assert power_table(read(RESULTS / "check-power.nc")) in text


def test_the_sizes_that_are_committed_are_what_they_should_be():
    """1,000 observations of each simulator: 3.6% to 6.6%; and places are named rightly, nine in ten."""
    table = read(RESULTS / "check.nc")
    assert (table["observations"] == 1000).all()
    rate = table["rejected"] / table["observations"]
    assert ((rate >= 0.036) & (rate <= 0.066)).all()
    for kind in ("outlier", "bump"):
        assert (table[f"{kind}_right"] >= 0.9 * table[f"{kind}_told"]).all()
