"""Networks as built: sizes, weights by their seed, and a published embedding that NumPy can follow."""

import subprocess
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.npe.config import NetworkTable  # noqa: E402
from gaugeblock.estimators.npe.networks import NetworkShape, build_network  # noqa: E402
from gaugeblock.estimators.npe.published import PublishedEmbedding  # noqa: E402


def pooled(x, layer):
    """Convolution with a border of two zeros, rectified, the larger of two neighbours."""
    weight, bias = (part.detach().numpy() for part in (layer.weight, layer.bias))
    wide = np.pad(x, ((0, 0), (2, 2)))
    made = [
        [(wide[:, at : at + 5] * one).sum() + own for at in range(x.shape[1])]
        for one, own in zip(weight, bias, strict=True)
    ]
    whole = np.maximum(made, 0.0)[:, : x.shape[1] // 2 * 2]
    return whole.reshape(len(whole), -1, 2).max(axis=2)


@pytest.mark.parametrize("channels", [4, 13])
def test_the_published_embedding_is_what_it_says(channels):
    network = PublishedEmbedding(channels)
    x = np.random.default_rng(1).poisson(20.0, (2, channels)).astype(float)
    found = network(torch.from_numpy(x)).detach().numpy()
    first, second = (layer for layer in network.convolutions if hasattr(layer, "weight"))
    inner, outer = (layer for layer in network.dense if hasattr(layer, "weight"))
    for row, summary in zip(x, found, strict=True):
        flat = pooled(pooled(np.log(1 + row)[None], first), second).ravel()
        assert len(flat) == 32 * (channels // 4)
        hidden = np.maximum(inner.weight.detach().numpy() @ flat + inner.bias.detach().numpy(), 0.0)
        expected = outer.weight.detach().numpy() @ hidden + outer.bias.detach().numpy()
        np.testing.assert_allclose(summary, expected, rtol=1e-4, atol=1e-5)


def test_sizes_are_those_of_the_table_and_weights_those_of_the_seed():
    table = NetworkTable(embedding=[9, 7], embedding_output=5, transforms=3, hidden=[11, 10], bins=4)
    shape = NetworkShape(2, (6,), "counts")
    before = torch.get_rng_state()
    one, same, other = (build_network(table, shape, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(before, torch.get_rng_state())
    dense = [tuple(part.weight.shape) for part in one._embedding_net if hasattr(part, "weight")]
    # Six roots, six shares, the total and one group.
    assert dense == [(9, 14), (7, 9), (5, 7)]
    transforms = [part for part in one.net.transform.transforms if hasattr(part, "hyper")]
    assert len(transforms) == 3
    sizes = [tuple(layer.weight.shape) for layer in transforms[0].hyper if hasattr(layer, "weight")]
    assert sizes == [(11, 7), (10, 11), (2 * 11, 10)]
    weights = [torch.cat([part.flatten() for part in net.parameters()]) for net in (one, same, other)]
    assert torch.equal(weights[0], weights[1])
    assert not torch.isclose(weights[0], weights[2]).all()


@pytest.mark.parametrize("shape", [(3,), (4, 4)])
def test_the_published_network_reads_spectra_of_four_channels_or_more(shape):
    table = NetworkTable(kind="published")
    with pytest.raises(InputError, match="reads spectra of at least 4 channels"):
        build_network(table, NetworkShape(2, shape, "counts"))
    assert build_network(table, NetworkShape(2, (4,), "counts")).embedding_net(torch.ones(2, 4)).shape == (
        2,
        20,
    )


@pytest.mark.parametrize("features", ["standard", "auto"])
def test_the_laplace_network_is_for_counts(features):
    with pytest.raises(InputError, match="is for counts in one dimension"):
        build_network(NetworkTable(kind="laplace"), NetworkShape(2, (8,), features))


USED = """
import sys
import numpy as np
import gaugeblock as gb
flow = gb.load("shipped:epic-pn-medium")
x = np.ones((2, *flow.data_shape))
flow.log_prob(flow.sample(x, 3, np.random.default_rng(1)), x)
print(sorted({"sbi", "sympy", "torch._dynamo", "sklearn"} & set(sys.modules)))
"""


def test_a_flow_of_ours_imports_neither_sbi_nor_torchs_compiler():
    """Three seconds of every command that loads one."""
    done = subprocess.run([sys.executable, "-c", USED], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_default_network_is_sbis_zuko_nsf():
    """Weights bear the same names, and with the same weights densities are the same."""
    from sbi.neural_nets import posterior_nn

    table = NetworkTable(embedding=[9], embedding_output=5, transforms=3, hidden=[11, 10], bins=4)
    network = build_network(table, NetworkShape(2, (6,), "counts"), seed=3)
    options = {"num_transforms": 3, "hidden_features": [11, 10], "num_bins": 4}
    embedding = build_network(table, NetworkShape(2, (6,), "counts"))._embedding_net
    theta, x = torch.randn(7, 2), torch.arange(42.0, dtype=torch.float64).reshape(7, 6)
    theirs = posterior_nn(
        "zuko_nsf", **options, embedding_net=embedding, z_score_theta="none", z_score_x="none"
    )(theta, x)
    theirs.load_state_dict(network.state_dict())
    with torch.no_grad():
        found = network.log_prob(theta[:, None], network.context(x))[:, 0]
        torch.testing.assert_close(found, theirs.log_prob(theta[None], x)[0], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("channels", [8, 102, 971])
def test_the_larger_of_two_is_what_pooling_after_relu_gives_to_the_last_bit(channels):
    torch.manual_seed(4)
    embedding = PublishedEmbedding(channels)
    first, _, _, second, _, _ = embedding.convolutions
    study = torch.nn.Sequential(
        first, torch.nn.ReLU(), torch.nn.MaxPool1d(2), second, torch.nn.ReLU(), torch.nn.MaxPool1d(2)
    )
    # Most channels are empty, so that neighbours tie.
    x = torch.log1p(torch.poisson(torch.full((20, 1, channels), 0.2)))
    assert (x == 0).float().mean() > 0.7
    weight = torch.randn(20, 32, channels // 4)
    found = []
    for layers in (embedding.convolutions, study):
        embedding.zero_grad()
        values = layers(x)
        (values * weight).sum().backward()
        found.append(
            [values.detach(), *(p.grad.clone() for p in (*first.parameters(), *second.parameters()))]
        )
    assert all(torch.equal(*both) for both in zip(*found, strict=True))
    assert found[0][0].shape == (20, 32, channels // 4)
    assert all(gradient.abs().max() > 0 for gradient in found[0][1:])
