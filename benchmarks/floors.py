"""What no program could do without, on this core: python -m benchmarks.floors ROW

Bare matrix products of the sizes and the precision that a row of `benchmarks.past` has, and the random
numbers and sorts that are its work: everything else is counted as distance. Prints CPU seconds.
"""

from __future__ import annotations

import sys
import time
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
REPEATS, ROWS = 3, 10_000
SHIPPED = "shipped:epic-pn-medium"
# What an audit of 0.1.0 did by default.
NAMES = (
    *("draws", "sbc", "coverage", "joint", "density", "local", "c2st", "lc2st"),
    *("posterior_sbc", "layout", "conformal", "importance", "evidence", "identifiability"),
)


def seconds(work: Callable[[], object]) -> float:
    """CPU seconds of what was done once before."""
    work()
    start = time.process_time()
    for _ in range(REPEATS):
        work()
    return (time.process_time() - start) / REPEATS


def product(rows: int, inner: int, columns: int, kind: Any = np.float32) -> float:
    """Of one matrix product; of many rows, by as many as fit a cache."""
    some = min(rows, ROWS)
    left, right = np.ones((some, inner), dtype=kind), np.ones((inner, columns), dtype=kind)
    return seconds(lambda: left @ right) * rows / some


def layers(network: Any) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Matrices ``(out, in)`` of a flow: of its embedding, and of its transforms."""
    kept = [(name, tuple(p.shape)) for name, p in network.named_parameters() if p.ndim == 2]
    embedding = [shape for name, shape in kept if "embedding" in name]
    return embedding, [shape for name, shape in kept if "embedding" not in name]


def flow(spectra: int, draws: int) -> float:
    """The shipped flow: spectra through its embedding, draws through its transforms."""
    import gaugeblock as gb

    embedding, transforms = layers(gb.load(SHIPPED).network)
    embedded = sum(product(spectra, inner, out) for out, inner in embedding)
    return embedded + sum(product(draws, inner, out) for out, inner in transforms)


def folded(spectra: int) -> float:
    """Photons through EPIC-pn's response, in double precision."""
    from gaugeblock.simulators import build_simulator

    response = build_simulator("xray", response="epic-pn", level="medium").response
    return product(spectra, *response.transfer.T.shape, np.float64)


def audit() -> float:
    """Of 4,200 spectra 250 draws each, of 200 another 500, and a likelihood of each of those."""
    return flow(4_200, 4_200 * 250 + 200 * 500) + folded(4_200 + 200 * 500)


def train() -> float:
    """Each step's batch forward once and back twice: to the layer before, and to the weights."""
    import gaugeblock as gb

    training = tomllib.loads((EXAMPLES / "train-undertrained.toml").read_text())["training"]
    embedding, transforms = layers(gb.load(EXAMPLES / "undertrained-model").network)
    batch, steps = training["batch"], training["steps"]
    return steps * sum(
        product(batch, inner, out) + product(batch, out, inner) + product(inner, batch, out)
        for out, inner in (*embedding, *transforms)
    )


def validators() -> float:
    """Every number of the trials sorted once, along the draws; the Gram matrices of the discriminants."""
    from benchmarks.validators_speed import trials

    from gaugeblock.validate.learned import discriminant, learned

    kept, taught = trials(0, 4000, 20, 3), list[Any]()

    def noted(truths: Any, draws: Any, **context: Any) -> Any:
        found = discriminant.fit_discriminant(truths, draws, **context)
        taught.extend((len(rows), len(found.scale)) for rows in (truths, draws))
        return found

    with patch.object(learned, "fit_discriminant", noted):
        findings(kept)
    grams = [np.ones(shape) for shape in taught]
    drawn = [values.values for values in kept.data_vars.values() if "draw" in values.dims]
    return sum(seconds(lambda x=x: np.sort(x, axis=1)) for x in drawn) + sum(
        seconds(lambda x=x: x.T @ x) for x in grams
    )


def findings(kept: Any) -> list[Any]:
    """What validators of 0.1.0 find."""
    from gaugeblock.validate import VALIDATORS, trials_tree
    from gaugeblock.validate.prepared import Prepared

    prepared = Prepared(trials_tree(kept), 1)
    chosen = [VALIDATORS[name] for name in NAMES]
    prepared.compute([statistic for one in chosen for statistic in one.statistics])
    return [item for one in chosen for item in one.findings(prepared)]


def judge() -> float:
    """40,000 replicates of each component, correlated within blocks of 256."""
    from benchmarks.validators_speed import trials

    from gaugeblock.validate.finding import Finding

    found = [item for item in findings(trials(0, 1000, 100, 40)) if isinstance(item, Finding)]
    components = sum(len(item.estimate) for item in found)
    rng = np.random.default_rng(1)
    whole, rest = divmod(components, 256)
    normals = seconds(lambda: rng.standard_normal((ROWS, components), dtype=np.float32)) * 4
    return normals + whole * product(40_000, 256, 256) + product(40_000, rest, rest)


def _spectrum(seed: int) -> tuple[Any, Any, np.random.Generator]:
    from gaugeblock.simulators import build_simulator

    simulator, rng = build_simulator("xray", response="epic-pn", level="medium"), np.random.default_rng(seed)
    theta = simulator.prior.from_unit_cube(rng.random((1, simulator.prior.size)))
    return simulator, rng.poisson(simulator.expected(theta)), np.random.default_rng(seed)


def nested() -> float:
    """The photons of each call that UltraNest makes, through the response; per 1,000 effective draws."""
    from gaugeblock.estimators.nested_sampling import NestedSampling

    simulator, x, rng = _spectrum(1)
    run = NestedSampling(simulator).run(x[0], rng)
    weight = np.exp(run.log_weight - run.log_weight.max())
    return folded(run.calls) / (weight.sum() ** 2 / (weight**2).sum() / 1000)


def posterior() -> float:
    """The draws of the flow, and their photons through the response; per 1,000 effective draws."""
    import gaugeblock as gb
    from gaugeblock.estimators.importance_refined import ImportanceRefined

    simulator, x, rng = _spectrum(1)
    found = ImportanceRefined(gb.load(SHIPPED), simulator).weights(x, 2000, rng)
    return (flow(1, 2000) + folded(2000)) / (float(found.effective_draws[0]) / 1000)


FLOORS: Mapping[str, Callable[[], float]] = {
    "gates": audit,
    "audit": audit,
    "train": train,
    "validators": validators,
    "judge": judge,
    "nested": nested,
    "posterior": posterior,
}

if __name__ == "__main__":
    sys.stdout.write(f"{FLOORS[sys.argv[1]]()}\n")
