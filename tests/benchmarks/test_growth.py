"""How cost grows: measured in commands of their own, resumed, put on a page."""

import json
from functools import partial

import numpy as np
import pytest
from benchmarks import growth

from gaugeblock.core.errors import InputError

# GB that an audit of a few hundred trials does not take.
LIMIT = 0.45


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Two small points of one axis, measured from a process that is larger than either."""
    large = np.ones(60_000_000)
    small = growth.Axis(
        (150, 300), partial(growth.audited, grows="trials", draws=30, parameters=1), "30 draws"
    )
    path = tmp_path_factory.mktemp("growth") / "growth.json"
    made = growth.grown({"trials": small}, path)
    assert large.nbytes > LIMIT * 1e9
    return small, path, made


def test_points_are_measured_once_and_kept(found, monkeypatch):
    small, path, made = found
    points = made["axes"]["trials"]
    assert list(points) == ["150", "300"]
    assert all(0.5 < one["seconds"] < 200 and 0.05 < one["gb"] < LIMIT for one in points.values())
    assert json.loads(path.read_text()) == made
    monkeypatch.setattr(growth, "measured", lambda _: pytest.fail("measured again"))
    assert growth.grown({"trials": small}, path) == made


def test_a_point_that_comes_later_stands_where_it_belongs(tmp_path, monkeypatch):
    path = tmp_path / "growth.json"
    monkeypatch.setattr(growth, "measured", lambda commands: {"seconds": float(commands[0][0]), "gb": 1.0})
    axis = growth.Axis((300, 2000), lambda size, _: [[str(size)]], "")
    growth.grown({"trials": axis}, path)
    made = growth.grown({"trials": growth.Axis((40, 300, 2000), axis.commands, "")}, path)
    assert list(made["axes"]["trials"]) == ["40", "300", "2000"]
    assert list(json.loads(path.read_text())["axes"]["trials"]) == ["40", "300", "2000"]


def test_a_page_of_what_there_is(found, tmp_path):
    pytest.importorskip("matplotlib")
    _, path, _ = found
    (tmp_path / "performance.md").write_text("<!-- growth -->\n<!-- /growth -->\n")
    made = json.loads(path.read_text())
    made["axes"]["trials"] = {"100": {"seconds": 2.0, "gb": 0.5}, "400": {"seconds": 8.0, "gb": 0.5}}
    path.write_text(json.dumps(made))
    assert growth.main(["--page", "--out", str(path), "--docs", str(tmp_path)]) == 0
    text = (tmp_path / "performance.md").read_text()
    assert "| 100, 400 trials (100 draws, 3 parameters) | 2, 8 (1) | 0.5, 0.5 (0) |" in text
    assert (tmp_path / "figures" / "growth.svg").stat().st_size > 1000


def test_a_command_that_fails_is_said():
    with pytest.raises(InputError, match="audit --set no"):
        growth.measured([["audit", "--set", "no"]])


@pytest.mark.parametrize("name", growth.AXES)
def test_one_number_grows_and_the_others_stay(name, tmp_path):
    axis = growth.AXES[name]
    assert sorted(axis.sizes) == list(axis.sizes)
    few, many = (axis.commands(size, tmp_path) for size in axis.sizes[-2:])
    changed = [
        (a, b) for one, two in zip(few, many, strict=True) for a, b in zip(one, two, strict=True) if a != b
    ]
    assert len(changed) == 1
    assert [int(word.rpartition("=")[2]) for word in changed[0]] == list(axis.sizes[-2:])
