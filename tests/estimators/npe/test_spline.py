"""The faster spline against zuko's own, and against what makes it a spline."""

from functools import partial

import pytest

torch = pytest.importorskip("torch")
zuko = pytest.importorskip("zuko")
from zuko.transforms import MonotonicAffineTransform, MonotonicRQSTransform  # noqa: E402

from gaugeblock.estimators.npe.config import NetworkTable  # noqa: E402
from gaugeblock.estimators.npe.networks import NetworkShape, build_network  # noqa: E402
from gaugeblock.estimators.npe.spline import Spline, use_splines  # noqa: E402


def arguments(*shape, bins=8, seed=0):
    """Sizes as large as training makes them, in double precision."""
    made = torch.Generator().manual_seed(seed)
    return [5 * torch.randn(*shape, k, generator=made).double() for k in (bins, bins, bins - 1)]


@pytest.mark.parametrize("options", [{}, {"bound": 3.0, "slope": 1e-2}])
@pytest.mark.parametrize("bins", [2, 8, 11])
def test_values_inverse_and_volume_are_zukos(bins, options):
    given = arguments(50, 3, bins=bins)
    ours, theirs = Spline(*given, **options), MonotonicRQSTransform(*given, **options)
    # Inside, beyond both ends, and on the ends.
    end = torch.full((50, 3), options.get("bound", 5.0)).double()
    for x in (torch.linspace(-6, 6, 150).reshape(50, 3).double(), end, -end):
        for found, expected in zip(ours.call_and_ladj(x), theirs.call_and_ladj(x), strict=True):
            torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)
        torch.testing.assert_close(ours.inv(x), theirs.inv(x), rtol=1e-8, atol=1e-8)


def test_one_spline_may_serve_many_values():
    ours, x = Spline(*arguments(3)), torch.linspace(-6, 6, 60).reshape(20, 3).double()
    each = [Spline(*(part[k] for part in arguments(3)))(x[:, k]) for k in range(3)]
    torch.testing.assert_close(ours(x), torch.stack(each, dim=-1))


@pytest.mark.parametrize("options", [{}, {"bound": 3.0, "slope": 1e-2}])
@pytest.mark.parametrize("bins", [2, 3, 8])
def test_it_is_learnt_as_zukos_is(bins, options):
    """Gradients by all that goes in, weighed by random numbers; inside, beyond both ends and on them."""
    made, gradients = torch.Generator().manual_seed(1), []
    end = options.get("bound", 5.0)
    x = torch.cat((torch.linspace(-6, 6, 148), torch.tensor([end, -end]))).reshape(50, 3).double()
    weights = [torch.randn(50, 3, generator=made).double() for _ in range(2)]
    for kind in (Spline, MonotonicRQSTransform):
        given = [part.requires_grad_() for part in (x.clone(), *arguments(50, 3, bins=bins))]
        values, volume = kind(*given[1:], **options).call_and_ladj(given[0])
        total = (weights[0] * values + weights[1] * volume).sum()
        gradients.append(torch.autograd.grad(total, given))
    for found, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)


def test_gradients_of_a_spline_that_serves_many_values_add_up():
    x, gradients = torch.linspace(-6, 6, 60).reshape(20, 3).double(), []
    for kind in (Spline, MonotonicRQSTransform):
        given = [part.requires_grad_() for part in arguments(3)]
        wide = given if kind is Spline else [part.expand(20, *part.shape) for part in given]
        values, volume = kind(*wide).call_and_ladj(x)
        gradients.append(torch.autograd.grad((values + 2 * volume).sum(), given))
    for found, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)


def test_what_we_build_is_made_of_it_and_nothing_else_is_touched():
    """With the bins and the least slope that sbi asked zuko for."""
    shape = NetworkShape(2, (5,), "standard")
    network = build_network(NetworkTable(transforms=2, hidden=[8], bins=4, embedding=[8]), shape)
    made = [module.univariate for module in network.modules() if hasattr(module, "univariate")]
    splines = [one for one in made if getattr(one, "func", None) is Spline]
    assert len(splines) == 2
    assert MonotonicRQSTransform not in {getattr(one, "func", None) for one in made}
    own = zuko.flows.NSF(2, 3, slope=0.05)
    affine = partial(MonotonicAffineTransform, slope=1e-2)
    others = [zuko.flows.MAF(2, 3, univariate=affine), zuko.flows.NSF(2, 3, bins=1), zuko.flows.BPF(2, 3)]
    for flow in (own, *others):
        use_splines(flow)
    assert {flow.univariate.keywords["slope"] for flow in own.transform.transforms} == {0.05}
    transforms = [module for flow in others for module in flow.modules() if hasattr(module, "univariate")]
    assert Spline not in {getattr(module.univariate, "func", None) for module in transforms}
