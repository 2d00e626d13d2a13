"""The one-pass inverse against zuko's own, which asks the whole network again for every parameter."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
zuko = pytest.importorskip("zuko")

from gaugeblock.estimators.npe import load  # noqa: E402
from gaugeblock.estimators.npe.flows import as_flow  # noqa: E402
from gaugeblock.estimators.npe.incremental import forward, inverse, normal_log_density  # noqa: E402

ROWS, DRAWS = 5, 40
FLOWS = {
    "spline": (zuko.flows.NSF, 5, 12, {}),
    "affine": (zuko.flows.MAF, 3, 4, {"transforms": 2}),
    "one parameter": (zuko.flows.NSF, 1, 4, {}),
    "two parameters, one layer": (zuko.flows.NSF, 2, 3, {"hidden_features": [32]}),
    "three layers, any order": (zuko.flows.NSF, 7, 5, {"randperm": True, "hidden_features": [40, 30, 20]}),
    "few units": (zuko.flows.NSF, 6, 2, {"hidden_features": [4, 3]}),
    "two at a time": (zuko.flows.NSF, 6, 5, {"passes": 2}),
    "another function": (zuko.flows.NSF, 4, 5, {"activation": torch.nn.ELU}),
    "residual blocks": (zuko.flows.MAF, 4, 5, {"residual": True, "hidden_features": [16, 16]}),
    "polynomials, clipped": (zuko.flows.SOSPF, 3, 4, {"transforms": 2}),
    "Bernstein polynomials": (zuko.flows.BPF, 3, 4, {"transforms": 2}),
    "neural, no known inverse": (zuko.flows.NAF, 3, 4, {"transforms": 1, "hidden_features": [16]}),
}


def flow_of(make, size, context, options):
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        flow = make(size, context, **options).double()
        for parameter in flow.parameters():
            parameter.data += 0.1 * torch.randn_like(parameter)
        return flow, torch.randn(ROWS, context).double(), 1.5 * torch.randn(ROWS, DRAWS, size).double()


@pytest.mark.parametrize("name", FLOWS)
def test_values_and_density_are_those_of_zuko(name):
    flow, context, noise = flow_of(*FLOWS[name])
    values, volume = inverse(flow.transform.transforms, noise, context)
    with torch.no_grad():
        whole = flow(context[:, None].expand(-1, DRAWS, -1))
        theirs, density = whole.transform.inv(noise), whole.log_prob(values)
        back, own = forward(flow.transform.transforms, values, context)
    torch.testing.assert_close(values, theirs, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(normal_log_density(noise) + volume, density, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(back, whole.transform(values), rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(normal_log_density(back) + own, density, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", FLOWS)
def test_a_density_is_learnt_as_zukos_is(name):
    flow, context, values = flow_of(*FLOWS[name])
    asked, gradients = [*flow.parameters(), context.requires_grad_()], []
    back, volume = forward(flow.transform.transforms, values, context)
    theirs = flow(context[:, None].expand(-1, DRAWS, -1)).log_prob(values)
    for density in (normal_log_density(back) + volume, theirs):
        gradients.append(torch.autograd.grad((density.exp() + density).sum(), asked, allow_unused=True))
    assert sum(part is not None for part in gradients[0]) >= len(asked) - 1
    for found, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)


def test_the_density_is_the_volume_that_noise_is_stretched_by():
    """By differences, which share nothing with a transform's own derivative."""
    flow, context, noise = flow_of(*FLOWS["spline"])
    step, at = 1e-6, noise[:, :1]
    moved = torch.cat([at + step * direction for direction in torch.eye(5).double()], dim=1)
    values, volume = inverse(flow.transform.transforms, at, context)
    jacobian = (inverse(flow.transform.transforms, moved, context)[0] - values) / step
    torch.testing.assert_close(volume[:, 0], -torch.linalg.slogdet(jacobian).logabsdet, rtol=1e-3, atol=1e-3)


def test_each_hidden_unit_is_evaluated_once(monkeypatch):
    flow, context, noise = flow_of(*FLOWS["three layers, any order"])
    seen, relu = [], torch.nn.ReLU.forward
    monkeypatch.setattr(torch.nn.ReLU, "forward", lambda self, x: seen.append(x.shape) or relu(self, x))
    inverse(flow.transform.transforms, noise, context)
    assert sum(shape[-1] for shape in seen) == 3 * (40 + 30 + 20)
    # What reads data alone is evaluated once a row.
    assert {shape[1] for shape in seen} == {1, DRAWS}


@pytest.mark.parametrize("name", ["epic-pn-medium", "epic-pn-bright-gain", "nicer-faint"])
def test_shipped_flows_draw_as_their_own_inverse_does(name):
    estimator = load(f"shipped:{name}")
    x = np.random.default_rng(1).poisson(4.0, (3, *estimator.data_shape))
    draws, log_q = estimator.sample_and_log_prob(x, 60, np.random.default_rng(2))
    flow = as_flow(estimator.network)
    with torch.inference_mode():
        context = flow.context(torch.from_numpy(x.astype(float)))
        noise = np.random.default_rng(2).standard_normal((3, 60, draws.shape[-1])).astype(np.float32)
        scores, density = flow.draw(torch.from_numpy(noise), context)
        np.testing.assert_allclose(density, flow.log_prob(scores, context), rtol=0, atol=5e-3)
    again = estimator.log_prob(draws, x)
    inside = np.isfinite(again)  # no spectrum of this source: some draws round to the prior's border
    assert inside.mean() > 0.9
    np.testing.assert_allclose(log_q[inside], again[inside], rtol=0, atol=5e-3)
    # Base noise went to where it came from.
    assert np.abs(back(flow, scores, context) - noise).max() < 5e-3


def back(flow, scores, context):
    with torch.inference_mode():
        if hasattr(flow, "net"):
            return flow.net(context[:, None].expand(-1, scores.shape[1], -1)).transform(scores).numpy()
        head = flow.head
        read, mean, factor = head._split(context)
        away = (scores - mean[:, None]).transpose(1, 2)
        local = torch.linalg.solve_triangular(factor, away, upper=False).transpose(1, 2)
        wide = read[:, None].expand(-1, scores.shape[1], -1)
        outer = head.affine(wide).transform(local)
        return head.spline(wide).transform(3.0 * torch.asinh(outer / 3.0)).numpy()


def test_the_published_coupling_flow_gives_the_density_of_its_draws():
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe.config import NetworkTable
    from gaugeblock.estimators.npe.networks import NetworkShape, build_network

    shape = NetworkShape(parameters=2, data_shape=(16,), features="counts")
    flow = as_flow(build_network(NetworkTable(kind="published"), shape, seed=1).eval())
    with torch.no_grad():
        context = flow.context(torch.arange(48.0).reshape(3, 16))
        values, density = flow.draw(torch.linspace(-2, 2, 3 * 7 * 2).reshape(3, 7, 2), context)
        torch.testing.assert_close(density, flow.log_prob(values, context), rtol=1e-4, atol=1e-4)
