"""The published network, trained as published."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sbi")
pytest.importorskip("jaxspec")

from studies.paper.paper_flow import VARIANTS, paper_flow
from studies.paper.paper_flow.__main__ import train
from studies.paper.paper_flow.flow import PaperFlow
from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.paper_flow.simulations import prior_of, simulations

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray import reference

SMALL = replace(VARIANTS["epic-pn-bright"], simulations=1000, cap=3)
LONGER = replace(SMALL, cap=5)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flows")
    train({"cut": SMALL, "longer": LONGER}, folder, work=folder / "work")
    return folder


def test_it_trains_on_the_published_simulations() -> None:
    # The study says that its medium training set has a median of 986 counts.
    _, counts = simulations(VARIANTS["epic-pn-medium"])
    assert np.median(counts.sum(axis=1)) == 986.0


def test_a_capped_training_keeps_its_last_weights(trained: Path) -> None:
    record = json.loads((trained / "cut.json").read_text())
    assert (record["epochs"], record["weights"]) == (3, "last")
    longer = json.loads((trained / "longer.json").read_text())
    assert longer["validation"][:3] == record["validation"]
    assert (trained / "cut.safetensors").read_bytes() != (trained / "longer.safetensors").read_bytes()


def test_a_training_cut_off_goes_on_to_the_same_bits(trained: Path, tmp_path: Path) -> None:
    class Cut(Exception):
        pass

    def stop(stage: str, done: int, total: int) -> None:
        if done == 2:
            raise Cut

    with pytest.raises(Cut):
        train({"cut": SMALL}, tmp_path, work=tmp_path / "work", progress=stop)
    assert not (tmp_path / "cut.json").exists()
    train({"cut": SMALL}, tmp_path, work=tmp_path / "work")
    assert (tmp_path / "cut.safetensors").read_bytes() == (trained / "cut.safetensors").read_bytes()


def test_draws_leak_from_the_box_and_are_rejected_to_it(trained: Path) -> None:
    flow = paper_flow("cut", trained)
    rng = np.random.default_rng(1)
    simulator = reference(level="bright")
    x = simulator.simulate(simulator.prior.sample(4, rng), rng)
    raw, log_q = flow.raw(x, 500, rng)
    assert 0.0 < flow.inside(raw).mean() < 1.0  # hardly trained: it must leak
    assert flow.inside(flow.sample(x, 200, rng)).all()
    np.testing.assert_allclose(flow.log_prob(raw, x), log_q, atol=1e-3)
    assert flow.embed(x).shape == (4, 20)


def test_its_density_is_one_in_linear_units(trained: Path) -> None:
    flow = paper_flow("cut", trained)
    rng = np.random.default_rng(2)
    x = reference(level="bright").simulate(flow.prior.sample(1, rng), rng)
    # Mean of 1/q over draws inside the box is the box's volume over the share of draws inside.
    theta, log_q = flow.raw(x, 40_000, rng)
    low, high = flow.box
    ratio = flow.inside(theta[0]) / np.exp(log_q[0]) / np.prod(high - low)
    middle = np.abs((theta[0] - low) / (high - low) - 0.5).max(axis=1) < 0.2
    part = np.where(middle, ratio, 0.0)
    error = part.std() / np.sqrt(part.size)
    assert abs(part.mean() - 0.4**5) < 4.0 * error
    assert error < 0.3 * 0.4**5


def test_unknown_names_say_what_there_is(trained: Path) -> None:
    with pytest.raises(InputError, match="there are cut, longer"):
        paper_flow("none", trained)


@pytest.mark.parametrize("path", sorted(FLOWS.glob("*.json")), ids=lambda path: path.stem)
def test_weights_that_ship_are_those_of_their_record(path: Path) -> None:
    record = json.loads(path.read_text())
    assert hashlib.sha256(path.with_suffix(".safetensors").read_bytes()).hexdigest() == record["sha256"]
    assert record["variant"] == VARIANTS[path.stem].describe()
    flow = paper_flow(path.stem)
    assert isinstance(flow, PaperFlow)
    assert flow.prior == prior_of(VARIANTS[path.stem])
