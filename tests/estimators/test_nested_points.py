"""Real runs of UltraNest and dynesty as plain arrays, and their evidences against exact ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.nested_sampling import from_dynesty, from_ultranest, ultranest_tree
from gaugeblock.validate.evidence.bootstrap import thread_bootstrap
from gaugeblock.validate.evidence.insertion_order import insertion_order_test
from gaugeblock.validate.evidence.nested_threads import split_threads, threads_of

SD = 0.1
# A Gaussian of unit integral, well inside a box of side 2 in three dimensions.
EXACT = -3 * np.log(2)
INFORMATION = -EXACT - 1.5 * np.log(2 * np.pi * np.e * SD**2)


def log_likelihood(theta):
    return -0.5 * np.sum((np.asarray(theta) / SD) ** 2, axis=-1) - 3 * np.log(SD * np.sqrt(2 * np.pi))


def box(cube):
    return 2 * cube - 1


@pytest.fixture(scope="module")
def ultranest_sampler():
    pytest.importorskip("ultranest")
    from gaugeblock.estimators.nested_sampling import global_numpy_seeded, silent_ultranest

    with silent_ultranest(), global_numpy_seeded([1]):
        import ultranest

        sampler = ultranest.ReactiveNestedSampler(["a", "b", "c"], log_likelihood, box, vectorized=True)
        sampler.run(show_status=False, viz_callback=False, min_num_live_points=200, min_ess=100)
    return sampler


@pytest.fixture(scope="module")
def static():
    dynesty = pytest.importorskip("dynesty")
    sampler = dynesty.NestedSampler(log_likelihood, box, 3, nlive=200, rstate=np.random.default_rng(2))
    sampler.run_nested(print_progress=False)
    return sampler.results


@pytest.fixture(scope="module")
def dynamic():
    dynesty = pytest.importorskip("dynesty")
    sampler = dynesty.DynamicNestedSampler(log_likelihood, box, 3, nlive=100, rstate=np.random.default_rng(3))
    sampler.run_nested(nlive_init=100, nlive_batch=50, maxbatch=3, print_progress=False)
    return sampler.results


def evidence_is_right(points, live_points):
    """Pull below 4 (1 seed in 16,000), error within 25% of theory, ranks that are no scandal (1 in 1,000)."""
    evidence = thread_bootstrap(points, rng=np.random.default_rng(4))
    assert abs(evidence.value - EXACT) < 4 * evidence.error
    assert evidence.error == pytest.approx(np.sqrt(INFORMATION / live_points), rel=0.25)
    assert insertion_order_test(points, rng=np.random.default_rng(5)).p_value > 0.001
    return evidence


def test_ultranest(ultranest_sampler):
    points = from_ultranest(ultranest_sampler)
    evidence = evidence_is_right(points, 200)
    # Its own estimate differs by how shells are cut, not by luck.
    assert evidence.value == pytest.approx(ultranest_sampler.results["logz"], abs=0.02)
    assert len(points.log_likelihood) == len(ultranest_sampler.results["weighted_samples"]["logl"])


def test_static_dynesty(static):
    points = from_dynesty(static)
    evidence = evidence_is_right(points, 200)
    assert evidence.value == pytest.approx(static.logz[-1], abs=0.03)
    threads = threads_of(SimpleNamespace(**points._asdict()))
    assert len(threads.start) == 200
    np.testing.assert_array_equal(threads.live_points(np.ones(len(static.logl)))[:-200], 200)


def test_dynamic_dynesty(dynamic):
    points = from_dynesty(dynamic)
    evidence = evidence_is_right(points, 100)
    assert evidence.value == pytest.approx(dynamic.logz[-1], abs=0.05)
    threads = split_threads(*points)
    assert np.count_nonzero(np.isfinite(threads.start)) == 150
    np.testing.assert_array_equal(
        threads.live_points(np.ones(len(dynamic.logl))), dynamic.samples_n[np.argsort(dynamic.logl)]
    )


def test_a_strand_is_born_where_its_batch_begins_and_each_point_above_the_one_before():
    """Two strands of the first batch, one of a second that starts at 1.5, mixed as a result mixes them."""
    given = SimpleNamespace(
        logl=[0.0, 1.0, 2.0, 2.5, 3.0, 4.0],
        samples_id=[5, 2, 5, 9, 2, 9],
        samples_batch=[0, 0, 0, 1, 0, 1],
        batch_logl_bounds=[(-np.inf, np.inf), (1.5, 3.5)],
    )
    points = from_dynesty(given)
    assert points.log_likelihood.tolist() == given.logl
    assert points.birth_log_likelihood.tolist() == [-np.inf, -np.inf, 0.0, 1.5, 1.0, 2.5]
    mixed = [4, 0, 5, 2, 3, 1]
    turned = {name: np.array(value)[mixed] for name, value in vars(given).items() if len(value) == 6}
    other = from_dynesty(SimpleNamespace(**{**vars(given), **turned}, nlive=2, niter=4))
    np.testing.assert_array_equal(other.birth_log_likelihood, points.birth_log_likelihood[mixed])
    del given.samples_batch, given.batch_logl_bounds
    born = [-np.inf, -np.inf, 0.0, -np.inf, 1.0, 2.5]
    assert from_dynesty(given).birth_log_likelihood.tolist() == born
    # One of the two alone says nothing of points that lack.
    assert from_dynesty(SimpleNamespace(**vars(given), niter=6)).birth_log_likelihood.tolist() == born


def test_a_point_of_ultranest_is_born_on_the_contour_of_its_parent():
    def node(number, value, *children):
        return SimpleNamespace(id=number, value=value, children=children)

    tree = node(
        -1, -np.inf, node(0, 1.0, node(3, 2.0, node(5, 6.0)), node(4, 3.0)), node(1, 0.5), node(2, 4.0)
    )
    value, birth, row = ultranest_tree(SimpleNamespace(root=tree))
    assert sorted(zip(row.tolist(), value.tolist(), birth.tolist(), strict=True)) == [
        (0, 1.0, -np.inf), (1, 0.5, -np.inf), (2, 4.0, -np.inf), (3, 2.0, 1.0), (4, 3.0, 1.0), (5, 6.0, 2.0)
    ]  # fmt: skip
    points = from_ultranest(SimpleNamespace(root=tree))
    assert (points.log_likelihood.tolist(), points.birth_log_likelihood.tolist()) == (
        value.tolist(),
        birth.tolist(),
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: from_dynesty({}), "no logl, samples_id"),
        (
            lambda: from_dynesty(SimpleNamespace(logl=[0.0], samples_id=[0], nlive=1, niter=1)),
            "add_live=True",
        ),
        (lambda: from_ultranest({"logz": 0.0}), "give the ReactiveNestedSampler"),
        (lambda: from_ultranest(SimpleNamespace(root=SimpleNamespace(children=[]))), "after run"),
    ],
)
def test_misuse_is_one_clear_line(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
