"""Responses too large to be held dense: the same counts, in memory that a laptop has."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array, random_array

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Uniform

pytest.importorskip("jaxspec")
import jax

from gaugeblock.simulators.xray import XraySpectrum, double_precision, reference, sparse
from gaugeblock.simulators.xray.forward import LARGE_CHUNK
from gaugeblock.simulators.xray.recorded import layout

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.mark.parametrize("density", [0.001, 0.03, 0.4])
def test_a_sparse_product_is_the_dense_one(density):
    """Rows of very different lengths, empty ones too."""
    rng = np.random.default_rng(1)
    matrix = random_array((300, 200), density=density, rng=rng, format="csr")
    matrix = csr_array(matrix.multiply((rng.random(300) < 0.7)[:, None]))
    full = np.ones((1, 200))
    matrix = csr_array(np.concatenate([matrix.toarray(), full]))
    vectors = rng.normal(size=(3, 200))
    with double_precision():
        times = jax.jit(jax.vmap(sparse.product(matrix)))
        np.testing.assert_allclose(times(vectors), vectors @ matrix.toarray().T, rtol=1e-12, atol=1e-12)
        slope = jax.jacfwd(sparse.product(matrix))(vectors[0])
    np.testing.assert_allclose(slope, matrix.toarray(), rtol=1e-12)


def test_a_matrix_of_zeros_gives_zeros():
    with double_precision():
        assert np.asarray(sparse.product(csr_array((3, 4)))(np.ones(4))).tolist() == [0.0, 0.0, 0.0]


def of_ones(rows, columns=12):
    matrix = np.zeros((len(rows), columns))
    for row, places in zip(matrix, rows, strict=True):
        row[list(places)] = 1.0
    return matrix


@pytest.mark.parametrize(
    ("rows", "dropped"),
    [
        ([(0, 1), (4, 2, 3), (), (9, 7)], ()),
        # Those of a program's size: the last row is there again.
        ([(0, 1), (2, 3), (5, 6, 8), (5, 6, 8), (5, 6, 8)], (3, 4)),
        # Nobody's to decide: rows that overlap, one within another, weights.
        ([(0, 1, 2), (2, 3)], ()),
        ([(0, 1, 2), (1, 2)], ()),
        ([(1, 2), (0, 1, 2)], ()),
        ([(1, 2), (1, 3), (3, 2)], ()),
        ([(0, 1), (2, 3), (0, 2)], ()),
    ],
)
@pytest.mark.parametrize(("weight", "small"), [(1.0, 0), (0.5, 0), (1.0, 144), (0.5, 144)])
def test_groups_are_summed_as_by_their_matrix(rows, dropped, weight, small, monkeypatch):
    monkeypatch.setattr(sparse, "SMALL", small)
    matrix = weight * of_ones(rows)
    vectors = np.random.default_rng(1).normal(size=(3, 12))
    expected = vectors @ matrix.T
    if weight == 1.0 and not small:
        expected[:, list(dropped)] = 0.0
    with double_precision():
        found = jax.jit(jax.vmap(sparse.sums(csr_array(matrix))))(vectors)
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize("small", [0, 144])
def test_a_program_of_sums_depends_on_shapes_alone(small, monkeypatch):
    monkeypatch.setattr(sparse, "SMALL", small)

    def program(rows):
        summed = sparse.sums(csr_array(of_ones(rows)))
        return str(jax.make_jaxpr(summed)(np.ones(12)))

    one, other = [(0, 1), (2, 3), (5,), (5,)], [(3,), (4, 5, 6, 7), (), (9, 8)]
    assert program(one) == program(other)
    assert program(one) != program(other[1:])


def test_what_is_small_or_full_is_held_dense():
    assert not sparse.is_sparse(csr_array((4000, 4000)))
    assert sparse.is_sparse(csr_array((5000, 5000)))
    assert not sparse.is_sparse(reference("nicer").response.sparse)


def test_a_spectrum_folded_sparsely_is_the_one_folded_densely(monkeypatch):
    plain = reference()
    theta = plain.prior.sample(5, np.random.default_rng(0))
    background = Effect("background", {"level": Uniform(0.0, 1.0), "index": 1.0})
    other = replace(plain.response)
    values = np.concatenate([theta, np.full((5, 1), 0.4)], axis=1)
    dense = [plain.expected(theta), plain.jacobian(theta), plain.with_effect(background).expected(values)]
    monkeypatch.setattr(sparse, "is_sparse", lambda _: True)
    monkeypatch.setattr("gaugeblock.simulators.xray.forward.LARGE", 10)
    one = XraySpectrum(plain.model, other, plain.prior)
    ours = [one.expected(theta), one.jacobian(theta), one.with_effect(background).expected(values)]
    assert one.forward._expected._sizes == (LARGE_CHUNK,)
    for a, b in zip(ours, dense, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


def test_counts_are_not_moved_between_more_channels_than_fit(monkeypatch):
    monkeypatch.setattr(layout, "MOST", 1e5)
    with pytest.raises(InputError, match="too many to move counts between; choose a narrower band"):
        reference().with_effect(Effect("gain_slope", {"slope": 1.01}))
    whole = reference()
    framed = XraySpectrum(whole.model, whole.response.with_frame_time(0.07), whole.prior)
    why = framed.not_in_library()
    assert set(why) == {"gain_slope", "gain_offset", "gain_curve", "resolution", "pileup"}
    assert all("too many to move counts between" in reason for reason in why.values())


LARGE = """
import resource, sys
from pathlib import Path
import numpy as np
from scipy.sparse import csr_array, eye_array
from gaugeblock.simulators import Uniform, Prior
from gaugeblock.simulators.xray import Response, XraySpectrum
size, width = 60_000, 120
edges = np.linspace(0.3, 30.3, size + 1)
bins = np.stack([edges[:-1], edges[1:]], axis=1)
core = np.exp(-0.5 * ((np.arange(width) - width / 2) / (width / 12)) ** 2)
first = np.clip(np.arange(size) - width // 2, 0, size - width)
at = (first[:, None] + np.arange(width)).astype(np.int32).ravel()
ends = np.arange(0, size * width + 1, width)
rows = csr_array((np.tile(core / core.sum(), size), at, ends), shape=(size, size))
response = Response(
    "large", bins, bins, bins, np.full(size, 100.0), rows.T.tocsr(), eye_array(size, format="csr"), 1e4
)
prior = Prior({"powerlaw_1.alpha": Uniform(1.0, 3.0), "powerlaw_1.norm": Uniform(0.0, 1.0)})
simulator = XraySpectrum("powerlaw", response, prior, integration="exact")
counts = simulator.expected([[2.0, 0.5]])[0]
inside = slice(width, -width)
exact = 0.5 * 1e6 * (1 / edges[:-1] - 1 / edges[1:])
assert np.abs(counts / exact - 1)[inside].max() < 1e-3
assert simulator.jacobian([2.0, 0.5]).shape == (size, 2)
# A process begins with the peak of the one that forked it; on Linux the status has its own.
status = Path("/proc/self/status")
lines = status.read_text().splitlines() if status.exists() else []
own = [line.split()[1] for line in lines if line.startswith("VmHWM")]
print(own[0] if own else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def test_sixty_thousand_channels_and_bins_take_less_than_two_gigabytes():
    done = subprocess.run([sys.executable, "-c", LARGE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    unit = 1 if sys.platform == "darwin" else 1024
    assert int(done.stdout) * unit < 2e9
