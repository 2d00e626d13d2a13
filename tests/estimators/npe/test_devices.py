"""All of torch is where it was asked for: shown on a pretended device, and on a GPU where there is one."""

import warnings
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from safetensors import safe_open  # noqa: E402
from safetensors.torch import load_file  # noqa: E402
from tests.estimators.npe.pretended import NAME, Device, on_the_host  # noqa: E402

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.importance_refined import ImportanceRefined  # noqa: E402
from gaugeblock.estimators.npe import NPE, TrainingConfig, load, train  # noqa: E402
from gaugeblock.estimators.npe.config import NetworkTable  # noqa: E402
from gaugeblock.estimators.npe.coordinates import to_scores  # noqa: E402
from gaugeblock.estimators.npe.networks import NetworkShape, build_network  # noqa: E402
from gaugeblock.estimators.npe.published import builder  # noqa: E402
from gaugeblock.estimators.protocol import devices  # noqa: E402
from gaugeblock.simulators.protocol import poisson_log_likelihood  # noqa: E402

TOLERANCE = 1e-3
"""As docs/performance.md states it: of normal scores, summaries, log densities and losses."""
KINDS = ["default", "published", "laplace"]
SMALL = {"embedding": [16], "embedding_output": 4, "transforms": 2, "hidden": [16, 16], "bins": 4}


@contextmanager
def opened(path, **options):
    """A file of tensors, read by the host."""
    with safe_open(path, **options) as stored:
        read = on_the_host(stored.get_tensor)
        yield SimpleNamespace(metadata=stored.metadata, keys=stored.keys, get_tensor=read)


@contextmanager
def pretended(**options):
    """A device, by the name of "cuda" or its own, and the only place where anything is computed."""

    def chosen(asked=None, **_):
        return NAME if asked in ("cuda", NAME) else "cpu"

    npe = "gaugeblock.estimators.npe"
    with pytest.MonkeyPatch.context() as patch:
        for module in ("estimator", "training", "published"):
            patch.setattr(f"{npe}.{module}.torch_device", chosen)
        for module in ("storage", "training"):
            patch.setattr(f"{npe}.{module}.build_network", on_the_host(build_network))
        patch.setattr(f"{npe}.published.builder", on_the_host(lambda *given: on_the_host(builder(*given))))
        patch.setattr(f"{npe}.checkpoint.safe_open", opened)
        patch.setattr(f"{npe}.laplace.training.load_file", on_the_host(load_file))
        # What sbi asks of a device and of data makes tensors in ways that only real devices see.
        patch.setattr("sbi.inference.trainers.base.process_device", str)
        patch.setattr("sbi.inference.trainers.npe.npe_base.warn_if_invalid_for_zscoring", lambda x: None)
        # Views of inference tensors have no versions, which wrapped ones need.
        patch.setattr(torch, "inference_mode", torch.no_grad)
        with warnings.catch_warnings(), Device(**options) as device:
            # torch would be right if the device had no numbers.
            warnings.filterwarnings("ignore", "for .* copying from a non-meta parameter")
            yield device
    assert device.done > 1000


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr("gaugeblock.estimators.npe.laplace.training.GUESS_STEPS", 5)
    # The pretended device has no kernel of a whole step, and another one rounds otherwise.
    monkeypatch.setattr("gaugeblock.estimators.npe.adamw.FUSED", frozenset())


@pytest.fixture
def simulator(make_counts):
    made = make_counts()
    made.log_likelihood = lambda theta, x: poisson_log_likelihood(made.expected(theta), x)
    return made


@pytest.fixture
def spectra(counts):
    rng = np.random.default_rng(5)
    return counts.simulate(counts.prior.sample(4, rng), rng)


def configured(kind, **training):
    """A training of a second, on fewer groups than there are channels."""
    few = {"simulations": 120, "batch": 40, "steps": 5, "emulator_steps": 5, "checkpoint": 3, "epochs": 2}
    return TrainingConfig.build(
        {
            "simulator": {"name": "counts"},
            "network": {"kind": kind, "groups": 5, "emulator": [16, 16], **SMALL},
            "training": {**few, "seed": 1, **training},
        }
    )


def untrained(kind, prior, *, device=None):
    table, shape = NetworkTable(kind=kind, groups=5, **SMALL), NetworkShape(2, (8,), "counts")
    network = on_the_host(build_network)(table, shape)
    return NPE(network, prior, data_shape=(8,), counts=True, device=device)


def answers(flow, x):
    """Draws, as scores; densities of them, in one pass and asked for; summaries."""
    draws, log_q = flow.sample_and_log_prob(x, 30, np.random.default_rng(2))
    return to_scores(flow.prior, draws), log_q, flow.log_prob(draws, x), flow.embed(x)


@pytest.mark.parametrize("kind", KINDS)
def test_draws_densities_and_summaries_are_made_on_the_device(kind, counts, spectra):
    expected = answers(untrained(kind, counts.prior), spectra)
    with pretended():
        found = answers(untrained(kind, counts.prior, device="cuda"), spectra)
    for one, other in zip(found, expected, strict=True):
        assert type(one) is np.ndarray
        np.testing.assert_array_equal(one, other)


class Cut(Exception):
    """A training is killed."""


@pytest.mark.parametrize(("kind", "more"), [("default", {}), ("published", {}), ("laplace", {"redraws": 2})])
def test_a_training_is_done_on_the_device_cut_off_or_not_and_says_so(tmp_path, simulator, kind, more):
    """What goes on from a checkpoint is the training itself: all but sbi's own are cut off once."""

    def stop(stage, done, total):
        if stage == "steps" and done == 4:
            raise Cut

    expected = train(simulator, configured(kind, **more), folder=tmp_path / "here").record
    # sbi's own trainer keeps its lists of rows on the host.
    with pretended(host=kind == "published"):
        config = configured(kind, device="cuda", **more)
        if kind != "published":
            with pytest.raises(Cut):
                train(simulator, config, folder=tmp_path / "there", progress=stop)
        flow = train(simulator, config, folder=tmp_path / "there")
        again = load(tmp_path / "there", simulator, device="cuda")
    assert flow.device == again.device == NAME
    found = flow.record
    assert found["training"]["device"] == NAME
    assert expected["training"]["device"] == "cpu"
    assert found["sha256"] == expected["sha256"]
    assert found["curve"] == expected["curve"]


def test_it_does_not_go_on_elsewhere_unasked(tmp_path, simulator):
    def stop(stage, done, total):
        raise Cut

    with pytest.raises(Cut):
        train(simulator, configured("default"), folder=tmp_path, progress=stop)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gaugeblock.estimators.npe.training.torch_device", lambda *_, **__: NAME)
        with pytest.raises(InputError, match="unfinished training of another model"):
            train(simulator, configured("default"), folder=tmp_path)


def test_a_flow_says_where_it_is_through_what_wraps_it(simulator):
    flow = untrained("default", simulator.prior)
    assert devices(ImportanceRefined(flow, simulator)) == [flow.device] == ["cpu"]
    assert devices(object()) == []


def test_a_device_that_is_not_there_is_told_before_any_work(tmp_path, counts, counts_folder, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"estimator npe: device 'cuda': torch sees 0 CUDA devices"):
        load(counts_folder, counts, device="cuda")
    with pytest.raises(InputError, match=r"training.device 'gpu': no such device"):
        train(counts, configured("default", device="gpu"), folder=tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device")
class TestOnAGPU:
    """Against the CPU, to the tolerance that is stated."""

    @pytest.mark.parametrize("kind", KINDS)
    def test_answers_agree(self, kind, counts, spectra):
        here, there = (untrained(kind, counts.prior, device=name) for name in ("cpu", "cuda"))
        assert {value.device.type for value in there.network.state_dict().values()} == {"cuda"}
        for one, other in zip(answers(there, spectra), answers(here, spectra), strict=True):
            np.testing.assert_allclose(one, other, rtol=TOLERANCE, atol=TOLERANCE)

    @pytest.mark.parametrize("kind", KINDS)
    def test_a_few_steps_agree(self, tmp_path, simulator, kind):
        few = {"steps": 10, "checkpoint": 4}
        here, there = (
            train(simulator, configured(kind, device=name, **few), folder=tmp_path / name).record
            for name in ("cpu", "cuda")
        )
        assert there["training"]["device"] == "cuda:0"
        np.testing.assert_allclose(
            there["curve"]["training"], here["curve"]["training"], rtol=TOLERANCE, atol=TOLERANCE
        )
