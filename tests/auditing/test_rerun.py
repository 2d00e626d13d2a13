"""What a rerun draws again, what it says of it, and which records it does not take."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.rerun import chance_to_catch, rerun
from gaugeblock.core.errors import InputError
from gaugeblock.validate.trials import main_trials, read_trials, trials_tree

TABLE = {"number": 45, "draws": 20, "block": 10, "importance_number": 0, "joint_number": 0, "seed": 4}
WHERE, NOTHING = "verdict.json: provenance", "does not say what it is: nothing can be drawn again"
SIMULATOR = {"name": "linear_gaussian", "parameters": 2, "data": 2}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    audit("exact", SIMULATOR, trials=TABLE, out=out, validators=["draws"], progress=False)
    return out


@pytest.fixture(scope="module")
def kept(finished: Path) -> tuple[xr.Dataset, dict[str, Any]]:
    tree = read_trials(finished / "trials.nc")
    tree.load()
    return main_trials(tree), finished_audit(finished)["provenance"]


def again(main: xr.Dataset, record: Any, share: float = 1.0, near: float = 0.0, **options: Any) -> Any:
    return rerun(trials_tree(main), record, share, near=near, **options)


@pytest.mark.parametrize(("share", "blocks", "one"), [(1.0, 5, "100%"), (0.5, 2, "40%"), (1e-9, 1, "20%")])
def test_what_is_said(kept: tuple[xr.Dataset, dict[str, Any]], share: float, blocks: int, one: str) -> None:
    told: list[tuple[str, int, int]] = []
    found = again(*kept, share, progress=lambda *said: told.append(said))
    assert found.differences == ()
    # Of 45 trials a twentieth are 2, a quarter 11, in blocks of 10: one, two and all.
    two = 1 - math.comb(3, blocks) / math.comb(5, blocks)
    assert found.said == (
        f"all truths and data, and the draws of {blocks} of 5 blocks, were drawn again; how often that meets "
        f"forged trials, by their number: 1 in {one}; 2 in {one}; 11 in {two:.0%}; 45 in 100%"
    )
    assert told == [("rerun", k, 5) for k in range(6)]


def test_every_row_that_differs_is_counted_and_near_is_relative_to_the_largest(
    kept: tuple[xr.Dataset, dict[str, Any]],
) -> None:
    main, record = kept
    x = main["x"].values.copy()
    largest = np.abs(x).max(axis=1)
    x[[0, 9, 44], 0] += [0.011 * largest[0], 0.009 * largest[9], -0.011 * largest[44]]
    changed = main.assign(x=(main["x"].dims, x))
    found = again(changed, record, near=0.01)
    assert found.differences == (
        "trials.nc: x: 2 trial(s), the first of them 0, are not what seed and simulator give",
    )
    assert "x: 3 trial(s)" in again(changed, record).differences[0]
    below = np.flatnonzero(main["x"].values.max(axis=1) < 0)
    assert len(below)
    x = main["x"].values.copy()
    x[below] *= 1.009
    assert again(main.assign(x=(main["x"].dims, x)), record, near=0.01).differences == ()
    (line,) = again(main.drop_vars("x"), record).differences
    assert line.startswith("trials.nc: x: 45 trial(s), the first of them 0,")
    (line,) = again(main.isel(draw=slice(19)), record).differences
    assert line == (
        "trials.nc: draws: 45 trial(s), the first of them 0, are not what seed, simulator and estimator give"
    )
    draws = main["draws"].values.copy()
    draws[23, 4, 1] = np.nan
    (line,) = again(main.assign(draws=(main["draws"].dims, draws)), record, near=1.0).differences
    assert line.startswith("trials.nc: draws: 1 trial(s), the first of them 23,")


def test_another_seed_or_estimator_than_is_said(kept: tuple[xr.Dataset, dict[str, Any]]) -> None:
    main, record = kept
    lines = again(main, {**record, "trials": {**record["trials"], "seed": 5}}).differences
    assert [line.partition(" trial(s)")[0] for line in lines] == [
        f"trials.nc: {name}: 45" for name in ("theta_true", "x", "draws")
    ]
    (line,) = again(main, {**record, "estimator": {**record["estimator"], "says": 3}}).differences
    assert line.startswith("verdict.json: provenance.estimator: has sha256 ")
    assert ", what is found by its name has " in line


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"trials": None}, "draws from disk have no seed and no simulator: leave out --rerun"),
        ({"trials": {"file": "a"}}, "draws from disk have no seed and no simulator: leave out --rerun"),
        ({"simulator": None}, f"{WHERE}.simulator {NOTHING}"),
        ({"estimator": {"name": 3}}, f"{WHERE}.estimator {NOTHING}"),
        ({"estimator": {"name": "exact", "options": [1]}}, f"{WHERE}.estimator.options is no table"),
    ],
)
def test_records_that_say_too_little(
    kept: tuple[xr.Dataset, dict[str, Any]], change: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError) as caught:
        again(kept[0], {**kept[1], **change})
    assert str(caught.value) == said


@pytest.mark.parametrize("name", ["block", "draws", "seed"])
def test_plans_that_are_none(kept: tuple[xr.Dataset, dict[str, Any]], name: str) -> None:
    least = {"block": 1, "draws": 1, "seed": 0}[name]
    plan = {**kept[1]["trials"], name: least - 1}
    with pytest.raises(InputError, match=r"^verdict.json: provenance.trials: .* is no plan of an audit$"):
        again(kept[0], {**kept[1], "trials": plan})
    for share in (0.0, -0.1, 1.01):
        with pytest.raises(InputError) as caught:
            again(*kept, share)
        assert str(caught.value) == (f"--rerun {share:g}: must be above 0 and at most 1, as in --rerun 0.1")


def test_chances_in_whole_numbers() -> None:
    assert chance_to_catch(1, trials=45, block=10, replayed=1) == pytest.approx(1 / 5)
    assert chance_to_catch(10, trials=45, block=10, replayed=1) == pytest.approx(1 / 5)
    assert chance_to_catch(11, trials=45, block=10, replayed=2) == pytest.approx(1 - 3 / 10)
    assert chance_to_catch(45, trials=45, block=10, replayed=1) == 1
    assert chance_to_catch(1, trials=45, block=10, replayed=5) == 1
