"""The gate on somebody else's networks: verdicts as numbers, and how the page counts them."""

from types import SimpleNamespace

import numpy as np
import pytest
from studies.kit.resume import Pieces
from studies.paper.beyond import gate_verdicts
from studies.paper.experiments import go_no_go
from studies.paper.numbers import as_table, by_claim, together


def test_a_network_is_asked_for_draws_alone_on_truths_of_its_own(monkeypatch, tmp_path):
    """Draws of the prior, at medium: blocked; each network and training has another seed."""
    pytest.importorskip("jaxspec")
    import gaugeblock as gb

    seeds = []

    def network(name):
        def sample(x, n, rng):
            return np.stack([_prior().sample(n, rng) for _ in x])

        return SimpleNamespace(sample=sample, log_prob=None, name=name)

    def audited(estimator, simulator, *, seed, **kwargs):
        seeds.append(seed)
        return gb_audit(estimator, simulator, seed=seed, **kwargs)

    gb_audit = gb.audit
    monkeypatch.setattr(gb, "audit", audited)
    monkeypatch.setattr(go_no_go, "paper_flow", network)
    sizes = {"trials": 100, "draws": 30, "training": ""}
    found = by_claim(go_no_go.run(sizes, Pieces(tmp_path, {}), 3))
    assert list(found) == ["faint", "medium", "bright", "bright-cut"]
    for parts in found.values():
        assert (parts["FAIL"], parts["PASS"], parts["INCONCLUSIVE"]) == (1.0, 0.0, 0.0)
        assert parts["informed.rank"] == 1.0
        assert parts["draws.finite"] == 0.0
        # A function has no density.
        assert "importance.ess" not in parts
    assert len(set(seeds)) == 4
    go_no_go.run(sizes | {"training": "-seed101"}, Pieces(tmp_path, {"other": 1}), 3)
    assert len(set(seeds)) == 8


def _prior():
    from gaugeblock.simulators.xray.published import REFERENCE_PRIOR

    return REFERENCE_PRIOR


def test_the_page_counts_audits():
    verdicts = [{"PASS": 0.0, "INCONCLUSIVE": 1.0, "FAIL": 0.0, "sbc.bias": 0.0, "joint.tarp": 0.0}]
    verdicts += [{"PASS": 0.0, "INCONCLUSIVE": 0.0, "FAIL": 1.0, "sbc.bias": 1.0, "joint.tarp": 0.0}] * 2
    tables = {str(k): as_table({"bright": found}) for k, found in enumerate(verdicts)}
    table = together(tables).assign_attrs(sizes='{"trials": 4000, "draws": 250}')
    _, said, rows = gate_verdicts({"go_no_go": table})
    assert "4,000 truths with 250 draws" in said
    assert "| bright |  | 1 | 2 | `sbc.bias` (2) |" in rows
    assert gate_verdicts({}) == []
