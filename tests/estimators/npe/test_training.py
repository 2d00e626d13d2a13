import json
import os
import shutil
import signal as signals
import subprocess
import sys

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.estimators.npe import load, run_training, train, training  # noqa: E402
from gaugeblock.estimators.npe.bank import Bank  # noqa: E402
from gaugeblock.estimators.npe.storage import weights_of  # noqa: E402

CONFIG = """
output = "model"
[simulator]
name = "linear_gaussian"
parameters = 2
data = 4
[network]
embedding = [16]
embedding_output = 4
transforms = 1
hidden = [16]
bins = 4
[training]
simulations = 2000
batch = 64
steps = 60
checkpoint = 20
seed = 4
"""

KILLED = """
import os, signal, sys
from gaugeblock.estimators.npe import run_training  # noqa: E402
def progress(stage, done, total):
    if stage == "steps" and done == 45:
        os.kill(os.getpid(), signal.SIGKILL)
run_training(sys.argv[1], out=sys.argv[2], progress=progress)
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "train.toml"
    path.write_text(CONFIG)
    return path


def weights(folder):
    return (folder / "model.safetensors").read_bytes()


def test_killed_and_run_again_it_ends_at_the_same_weights(tmp_path, config):
    undisturbed = run_training(config, out=tmp_path / "undisturbed")
    killed = tmp_path / "killed"
    command = [sys.executable, "-c", KILLED, str(config), str(killed)]
    outcome = subprocess.run(command, env={**os.environ}, check=False, timeout=300)
    assert outcome.returncode == -signals.SIGKILL
    assert not (killed / "model.json").exists()
    assert (killed / "training" / "checkpoint.safetensors").exists()
    steps = []
    run_training(config, out=killed, progress=lambda stage, done, total: steps.append((stage, done)))
    assert min(done for stage, done in steps if stage == "steps") == 41
    assert weights(killed) == weights(undisturbed)
    first, second = (json.loads((f / "model.json").read_text()) for f in (undisturbed, killed))
    assert first["curve"] == second["curve"]
    assert not (killed / "training").exists()


def test_the_seed_decides(tmp_path, config):
    def trained(name, seed):
        return run_training(config, out=tmp_path / name, seed=seed, overrides={"training.steps": 30})

    first, other = trained("first", 5), trained("other", 6)
    with torch.no_grad():  # what others in the process have switched off does not
        again = trained("again", 5)
    assert weights(first) == weights(again)
    assert weights(first) != weights(other)
    recorded = json.loads((first / "model.json").read_text())
    assert recorded["training"]["steps"] == 30
    assert recorded["command"].endswith("--set training.steps=30 --set training.seed=5")


def test_a_checkpoint_of_another_training_is_not_taken(tmp_path, config):
    def stop(stage, done, total):
        if done == 25 and stage == "steps":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_training(config, out=tmp_path / "model", progress=stop)
    starts = []
    changed = {"training.learning_rate": 1e-3}
    run_training(
        config,
        out=tmp_path / "model",
        overrides=changed,
        replace=True,
        progress=lambda stage, done, total: starts.append(done) if stage == "steps" else None,
    )
    assert starts[0] == 1
    fresh = run_training(config, out=tmp_path / "fresh", overrides=changed)
    assert weights(tmp_path / "model") == weights(fresh)


def published(configure):
    values = {"network.kind": "published", "training.epochs": 2, "training.simulations": 1000}
    return configure("counts").replace(values)


def test_training_leaves_global_state_alone(tmp_path, counts, configure):
    torch.manual_seed(9)
    before = torch.get_rng_state(), torch.get_num_threads(), torch.get_default_dtype()
    train(counts, configure("counts", steps=5), folder=tmp_path / "default")
    train(counts, published(configure), folder=tmp_path / "published")
    assert torch.equal(before[0], torch.get_rng_state())
    assert before[1:] == (torch.get_num_threads(), torch.get_default_dtype())


@pytest.mark.parametrize(("asked", "taken"), [({}, 1), ({"training.threads": 2}, 2)])
def test_it_takes_as_many_threads_as_it_is_told_to(asked, taken, tmp_path, config):
    before, seen = torch.get_num_threads(), set()
    torch.set_num_threads(3)
    try:
        few = {"training.steps": 3, "training.simulations": 200, **asked}
        run_training(
            config, out=tmp_path / "m", overrides=few, progress=lambda *_: seen.add(torch.get_num_threads())
        )
        assert (seen, torch.get_num_threads()) == ({taken}, 3)
    finally:
        torch.set_num_threads(before)


def test_a_model_is_never_replaced_without_being_told_to(tmp_path, counts, configure, monkeypatch):
    train(counts, configure("counts", steps=5), folder=tmp_path)
    weights = (tmp_path / "model.safetensors").read_bytes()
    with pytest.raises(InputError, match="holds a model; give --replace") as caught:
        train(counts, configure("counts", steps=5), folder=tmp_path)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "model.safetensors").read_bytes() == weights
    with monkeypatch.context() as patched:
        patched.setattr("gaugeblock.estimators.npe.training.save", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            train(counts, configure("counts", steps=6), folder=tmp_path, replace=True)
    with pytest.raises(InputError, match="holds the unfinished training of another model; give --replace"):
        train(counts, configure("counts", steps=7), folder=tmp_path)
    assert (tmp_path / "model.safetensors").read_bytes() == weights
    # The same one goes on, and had been told to.
    train(counts, configure("counts", steps=6), folder=tmp_path)
    other = (tmp_path / "model.safetensors").read_bytes()
    assert other != weights
    assert not (tmp_path / "training").exists()
    train(counts, configure("counts", steps=5), folder=tmp_path, replace=True)
    assert (tmp_path / "model.safetensors").read_bytes() == weights


def test_the_published_network_trains_and_comes_back(tmp_path, counts, configure, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with torch.no_grad():  # as BayesFlow leaves a whole process
        flow = train(counts, published(configure), folder="model")
    assert capsys.readouterr().out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["model"]  # no log folder of sbi's
    assert len(flow.record["curve"]["epoch"]) == 2
    assert flow.embed(np.zeros((3, 8))).shape == (3, 20)
    x = np.random.default_rng(1).poisson(5.0, size=(3, 8))
    draws, log_q = flow.sample_and_log_prob(x, 50, np.random.default_rng(2))
    again = load("model", counts).sample(x, 50, np.random.default_rng(2))
    np.testing.assert_array_equal(draws, again)
    np.testing.assert_allclose(flow.log_prob(draws, x), log_q, atol=1e-3)
    # Our reading of the flow's inside against sbi's own log_prob.
    from gaugeblock.estimators.npe.coordinates import physical_log_density, to_scores

    scores = to_scores(flow.prior, draws)
    with torch.no_grad():
        theirs = flow.network.log_prob(
            torch.from_numpy(scores.astype(np.float32)).transpose(0, 1),
            torch.from_numpy(x.astype(np.float32)),
        )
    expected = physical_log_density(flow.prior, theirs.T.double().numpy(), scores, draws)
    np.testing.assert_allclose(log_q, expected, atol=1e-3)


def test_the_published_network_refuses_other_than_spectra(configure):
    from gaugeblock.estimators.npe.networks import NetworkShape, build_network

    with pytest.raises(InputError, match="at least 4 channels"):
        build_network(published(configure).network, NetworkShape(2, (3,), "counts"))


def test_the_published_network_refuses_negative_data(tmp_path, config):
    with pytest.raises(InputError, match="negative values"):
        run_training(config, out=tmp_path / "m", overrides={"network.kind": "published"})


def test_the_configuration_says_where_the_model_goes(tmp_path, config, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = run_training(config, overrides={"training.steps": 4, "training.checkpoint": 2})
    assert folder.resolve() == tmp_path / "model"
    picture = pytest.importorskip("matplotlib.image").imread(folder / "training.png")[..., :3]
    # A line for each of the two losses, in the first two colours, and in the legend.
    for colour in ((31, 119, 180), (255, 127, 14)):
        near = (np.abs(picture * 255 - colour) < 2).all(axis=2)
        assert near.sum() > 100
        assert np.ptp(np.nonzero(near)[1]) > 0.5 * picture.shape[1]
    assert json.loads((folder / "model.json").read_text())["command"].startswith("gaugeblock train ")


def test_fixed_noise_and_the_last_weights_when_asked_for(tmp_path, counts, configure):
    fixed = Bank.simulate(counts, 10, seed=1, folder=tmp_path, fresh=False)
    assert not fixed.fresh
    assert np.issubdtype(fixed.data.dtype, np.integer)
    kept = {
        keep: weights_of(
            train(
                counts,
                configure("counts", steps=40, checkpoint=10, learning_rate=0.2, keep=keep),
                folder=tmp_path / keep,
            ).network
        )
        for keep in ("best", "last")
    }
    assert kept["best"] != kept["last"]


def test_each_row_gets_fresh_noise_where_the_simulator_can(tmp_path, counts, signal):
    bank = Bank.simulate(counts, 10, seed=1, folder=tmp_path / "a")
    rng = np.random.default_rng(3)
    rows = np.zeros(4000, dtype=np.int64)
    noisy = bank.observe(rows, rng)
    # Mean of 4000 Poisson counts: five standard errors, a false alarm in two million per channel.
    mean = bank.data[0].astype(float)
    assert np.all(np.abs(noisy.mean(axis=0) - mean) < 5 * np.sqrt(mean / 4000))
    kept = Bank.simulate(signal, 10, seed=1, folder=tmp_path / "b")
    assert not kept.fresh
    np.testing.assert_array_equal(kept.observe(rows[:2], rng), kept.data[[0, 0]])


def test_a_bank_of_another_simulator_is_made_anew(tmp_path, counts, make_counts):
    first = Bank.simulate(counts, 10, seed=1, folder=tmp_path)
    other = Bank.simulate(make_counts(high=9.0), 10, seed=1, folder=tmp_path)
    assert not np.array_equal(first.data, other.data)


def test_a_simulator_with_nan_gives_one_line(tmp_path, make_counts, configure):
    class Broken(make_counts):
        def expected(self, theta):
            return np.where(np.asarray(theta)[:, :1] > 2.9, np.nan, super().expected(theta))

    with pytest.raises(InputError, match=r"not finite at slope=2\.9") as caught:
        train(Broken(), configure("counts"), folder=tmp_path / "model")
    assert "\n" not in str(caught.value)


def test_divergence_gives_one_line(tmp_path, config, monkeypatch):
    monkeypatch.setattr("gaugeblock.estimators.npe.loop._validation_loss", lambda *a: float("nan"))
    with pytest.raises(InputError, match=r"lower training\.learning_rate"):
        run_training(config, out=tmp_path / "model", overrides={"training.steps": 5})


def test_a_configuration_without_a_folder_gives_one_line(tmp_path, config):
    config.write_text(CONFIG.replace('output = "model"', ""))
    with pytest.raises(InputError, match="no folder for the model"):
        run_training(config)


def test_its_key_is_the_last_that_a_finished_training_loses(tmp_path, monkeypatch):
    """Killed while it clears up, it is known as its own; what is empty is nobody's."""
    work = tmp_path / "training"
    (work / "bank").mkdir(parents=True)
    for name in ("key", "checkpoint.safetensors", "bank/scores.npy"):
        (work / name).write_text("")
    seen = []
    remove = shutil.rmtree

    def watched(path, **how):
        seen.append(sorted(inner.name for inner in path.iterdir()))
        remove(path, **how)

    monkeypatch.setattr(training.shutil, "rmtree", watched)
    training.clear_up(work)
    assert seen[-1] == ["key"]
    assert not work.exists()
    work.mkdir()
    training.begin_training(tmp_path, work, "mine", replace=False)
    with pytest.raises(InputError, match="the unfinished training of another model"):
        training.begin_training(tmp_path, work, "another", replace=False)
