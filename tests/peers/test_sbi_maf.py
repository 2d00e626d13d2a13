"""sbi's autoregressive flows: the first parameter of each transform is never shown the data."""

from __future__ import annotations

import numpy as np
import pytest

import gaugeblock as gb

pytestmark = pytest.mark.filterwarnings("ignore:torch.triangular_solve is deprecated")

PRIOR = gb.Prior({"a": gb.Normal(0.0, 1.0), "b": gb.Normal(0.0, 1.0)})
SEEDS, STEPS = range(40), 150


def simulate(theta, rng):
    return theta + 0.5 * rng.standard_normal(theta.shape)


def shown(torch, draw, data):
    """Which parameters' draws depend on the data: of the same noise, given data and others."""
    noise, x = torch.randn(20, 2), torch.randn(40, 2)
    with torch.no_grad():
        return (draw(noise, data(x[:20])) != draw(noise, data(x[20:]))).any(dim=0).numpy()


@pytest.fixture(scope="module")
def built(peer):
    """A network of sbi's by its kind and torch's seed, for standard normal parameters and data."""
    torch, made = peer("torch"), peer("sbi.neural_nets").posterior_nn

    def build(kind, seed):
        torch.manual_seed(seed)
        network = made(kind)(torch.randn(200, 2), torch.randn(200, 2))
        flow = network.net

        def draw(noise, context):
            return flow._transform.inverse(noise, context=context)[0]

        return network, shown(torch, draw, flow._embedding_net)

    return build


@pytest.mark.parametrize(("kind", "least", "most"), [("maf", 1, 8), ("maf_rqs", 1, 8), ("nsf", 0, 0)])
def test_theirs_with_some_seeds_never_shows_its_data_to_a_parameter(built, kind, least, most):
    """By random orders: of two parameters one comes first in all five transforms in one of 16 networks."""
    blind = [not built(kind, seed)[1].all() for seed in SEEDS]
    assert least <= sum(blind) <= most


def test_theirs_does_not_learn_what_it_is_not_shown_and_ranks_do_not_tell(peer, built):
    torch = peer("torch")
    seed = next(seed for seed in SEEDS if not built("maf", seed)[1].all())
    network, seen = built("maf", seed)
    name = PRIOR.names[int(np.flatnonzero(~seen)[0])]
    optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
    rng = np.random.default_rng(1)
    for _ in range(STEPS):
        theta = PRIOR.sample(500, rng)
        batch = (torch.tensor(part, dtype=torch.float32) for part in (theta, simulate(theta, rng)))
        optimizer.zero_grad()
        network.loss(*batch).mean().backward()
        optimizer.step()

    def trained(x, n, rng):
        torch.manual_seed(int(rng.integers(2**31)))
        with torch.no_grad():
            return network.sample((n,), condition=torch.tensor(x, dtype=torch.float32)).transpose(0, 1)

    result = gb.audit(trained, simulate, prior=PRIOR, trials=1000, draws=100, progress=False)
    assert "FAIL" not in {result[f"sbc.{what}[{name}]"].outcome for what in ("bias", "log_width")}
    assert result["informed.rank"].outcome == "FAIL"
    assert result.verdict.diagnosis["named"] == "ignored_parameter"
    assert "sbi's maf" in result.verdict.diagnosis["text"]


def test_ours_shows_them_to_all():
    torch = pytest.importorskip("torch")
    pytest.importorskip("zuko")
    from gaugeblock.estimators.npe.config import NetworkTable
    from gaugeblock.estimators.npe.networks import NetworkShape, build_network

    for seed in range(10):
        network = build_network(NetworkTable(), NetworkShape(2, (2,), "standard"), seed=seed)

        def draw(noise, context, network=network):
            return network.net(context).transform.inv(noise)

        assert shown(torch, draw, network.context).all()
