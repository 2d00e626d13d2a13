"""A catalogue's sources in other processes: the same bits, whoever answers for a block, and however often."""

import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.cli.inside import inside

import gaugeblock as gb
from gaugeblock.auditing import discovering
from gaugeblock.auditing.answers import fingerprint
from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import opened
from gaugeblock.discovery import Sources, blocks
from gaugeblock.simulators import LogUniform, Prior, Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect

EDGES = np.geomspace(0.5, 8.0, 25)
AT, WIDTH = np.sqrt(EDGES[1:] * EDGES[:-1]), np.diff(EDGES)


class Slope:
    """``norm * E ** -index`` counts a keV through an area with ripples, and a bump or a bend of it."""

    def __init__(self, ripple: float = 0.0, effects: tuple[Effect, ...] = (), prior: Prior | None = None):
        self.ripple, self.effects = ripple, effects
        self.prior = prior or Prior({"norm": LogUniform(10.0, 1e6), "index": Uniform(-1.0, 4.0)})

    def expected(self, theta: Any) -> Any:
        theta = np.asarray(theta, dtype=float)
        area, place = 1.0 + self.ripple * np.sin(6.0 * np.log(AT)), 2
        mean = theta[..., :1] * AT ** -theta[..., 1:2] * WIDTH * area
        for effect in self.effects:
            values = {name: np.full(theta.shape[:-1], value) for name, value in effect.fixed.items()}
            for name in effect.free:
                values[name], place = theta[..., place], place + 1
            size, energy = values["size"][..., None], values.get("energy", np.ones(()))[..., None]
            shape = np.log(AT) ** 2 if effect.name == "bend" else np.exp(-0.5 * ((AT - energy) / 0.4) ** 2)
            mean = mean * (1.0 + size * shape)
        return np.maximum(mean, 1e-9)

    def with_effect(self, effect: Effect) -> "Slope":
        more = effect.prior(f"{effect.name}_{1 + sum(one.name == effect.name for one in self.effects)}")
        return type(self)(
            self.ripple, (*self.effects, effect), self.prior if more is None else self.prior * more
        )

    def effect_library(self, theta: Any) -> dict[str, LibraryEffect]:
        about: dict[str, Any] = {
            "amplitude": "size", "neutral": 0.0, "step": 0.05, "cause": "", "typical": "",
            "origin": "instrument",
        }  # fmt: skip
        size = {"size": Uniform(-0.4, 0.4)}
        return {
            "bump": LibraryEffect(
                name="bump", parameters={"energy": Uniform(0.6, 7.5), **size},
                scanned={"energy": np.geomspace(0.7, 7.0, 8)}, **about,
            ),
            "bend": LibraryEffect(name="bend", parameters=size, **about),
        }  # fmt: skip

    def describe(self) -> dict[str, Any]:
        return {
            "simulator": "slope",
            "ripple": self.ripple,
            "effects": [effect.describe() for effect in self.effects],
        }


def spectra(simulator: Any) -> list[Sources]:
    """Two responses: 36 sources, which are two blocks, and 8."""
    rng = np.random.default_rng(3)
    theta = np.stack([4e4 * np.exp(rng.uniform(-1, 1, 44)), rng.uniform(0.5, 2.5, 44)], axis=1)
    bump, groups = Effect("bump", {"energy": 1.75, "size": -0.12}), []
    for rows, one in ((slice(36), simulator), (slice(36, 44), type(simulator)(0.3))):
        true = Slope(one.ripple).with_effect(bump)
        groups.append(Sources.of(one, rng.poisson(true.expected(theta[rows]))))
    return groups


def searched(simulator: Any = None, **how: Any) -> dict[str, Any]:
    found = gb.discover(spectra(simulator or Slope()), replicates=99, progress=False, **how)
    return found.to_json()


@pytest.fixture(scope="module", autouse=True)
def small_blocks() -> Iterator[None]:
    """Few sources are several blocks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "BLOCK", 32)
        yield


@pytest.fixture(scope="module")
def alone() -> dict[str, Any]:
    return searched()


@pytest.fixture(scope="module", autouse=True)
def by_value() -> None:
    """Workers cannot import this file."""
    pytest.importorskip("cloudpickle").register_pickle_by_value(sys.modules[__name__])


@pytest.fixture(scope="module")
def dask() -> Iterator[Executor]:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as cluster,
        opened(scheduler=cluster.scheduler_address) as (executor, _),
    ):
        assert executor is not None
        yield executor


def test_the_bits_are_those_of_one_process(alone: dict[str, Any], dask: Executor, tmp_path: Path) -> None:
    assert alone["named_all"] == ["bump"]
    assert alone["gap"]["in_sample"]["after"] < 1.1
    assert searched(out=tmp_path / "files") == alone
    assert searched(out=tmp_path / "dask", executor=dask) == alone
    files = [(tmp_path / name / "discovery.nc").read_bytes() for name in ("files", "dask")]
    assert files[0] == files[1]
    assert not list(tmp_path.glob("*/.chunks"))


def test_blocks_say_together_what_the_whole_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every source once, in its place, with its own random numbers: sums round otherwise, and that is all."""
    one = spectra(Slope())[:1]
    cut = gb.discover(one, replicates=99, progress=False)
    monkeypatch.setattr(blocks, "BLOCK", 1000)
    whole = gb.discover(one, replicates=99, progress=False)
    assert cut.gap.in_sample.after < 1.1
    assert "random 3" in cut.tree["held_out"]["model"]
    for name, group in whole.tree.to_dict().items():
        for array in group:
            if group[array].dtype.kind == "f":
                np.testing.assert_allclose(cut.tree[f"{name}/{array}"], group[array], rtol=1e-5, atol=1e-6)
    assert cut.tree["scan"].attrs == pytest.approx(whole.tree["scan"].attrs, rel=1e-6)


class Mortal(Slope):
    """Kills its process the first time that an effect is asked for, anywhere."""

    mark = Path()

    def expected(self, theta: Any) -> Any:
        if self.effects and not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().expected(theta)


def test_a_process_that_is_killed_is_one_line_and_the_next_run_goes_on(
    alone: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Mortal, "mark", tmp_path / "killed")
    out = tmp_path / "out"
    with opened(workers=2) as (executor, _), pytest.raises(InputError, match="a worker could not go on"):
        searched(Mortal(), out=out, executor=executor)
    first, second, third = sorted(out.glob(".chunks/*/answer-000000-*.npz"))
    made = first.stat().st_mtime_ns
    second.write_bytes(third.read_bytes())
    monkeypatch.setattr(discovering, "discard", lambda place: None)
    again = searched(Mortal(), out=out)
    for name in ("disagreement", "candidates", "amplitude", "gap", "decoys", "catalogue"):
        assert again[name] == alone[name], name
    assert first.stat().st_mtime_ns == made
    assert second.read_bytes() != third.read_bytes()


def test_another_search_takes_no_answers_of_this_one() -> None:
    groups = spectra(Slope())
    fewer = [replace(groups[0], counts=groups[0].counts + 1.0), groups[1]]
    said = {"seed": 0, "only": (), "replicates": 99}
    keys = [
        fingerprint(groups, False, **said),
        fingerprint(fewer, False, **said),
        *(fingerprint(groups, False, **said | other) for other in ({"seed": 1}, {"only": ("bump",)})),
        # Of one's own effects nobody knows what they hold.
        *(fingerprint(groups, True, **said) for _ in range(2)),
    ]
    assert len(set(keys)) == len(keys)
    assert fingerprint(spectra(Slope()), False, **said) == keys[0]


class Counted(Slope):
    """Counts, in each process, how many simulators came there."""

    came = 0

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        type(self).came += 1


def test_a_process_gets_each_simulator_once(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as threads:
        searched(Counted(), out=tmp_path, executor=threads)
    # Of each response as it was given, with either effect to be found and to be shared, with the one that was
    # found, and with either beside it. Were it once a task, hundreds.
    assert 0 < Counted.came <= 16


def test_what_is_no_catalogue_is_not_shared(tmp_path: Path) -> None:
    one = spectra(Slope())[0].select([0])
    with (
        ThreadPoolExecutor(1) as threads,
        pytest.raises(InputError, match="and this is none: leave out"),
    ):
        gb.discover(one, executor=threads)
    (tmp_path / "one.pha").touch()
    said = inside("discover", "one.pha", "--workers", "0", cwd=tmp_path)
    assert (said.returncode, said.stderr) == (2, "gaugeblock: --workers 0: must be 1 or more\n")
