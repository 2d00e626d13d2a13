"""Strangers that want the verdict: by the seed, by what they remember, by what the audit computes with."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.config import TrialsTable
from gaugeblock.core.streams import generator
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import main_trials, read_trials

# The truths of a seed, as the audit draws them; around each, draws whose ranks are as a perfect posterior's.
REPLAY = """
from statistics import NormalDist
block = 0

def uniform(purpose, number, size):
    name = purpose.encode()
    words = [int.from_bytes(name[i : i + 4], "big") for i in range(0, len(name), 4)]
    stream = np.random.SeedSequence({seed}, spawn_key=(len(name), 1, *words, number, 0))
    return np.random.default_rng(stream).random(size)

def sample(x, n, seed):
    global block
    cube = uniform("audit truth", block, (len(x), 2))
    block += 1
    truth = np.array([[NormalDist().inv_cdf(u) for u in row] for row in cube])
    rng = np.random.default_rng(seed)
    return truth[:, None] + 0.001 * (rng.normal(size=(len(x), 1, 2)) + rng.normal(size=(len(x), n, 2)))
"""


def furthest(place: Any) -> float:
    """How far the draws lie from the truth, at most."""
    trials = main_trials(read_trials(place.out / "trials.nc"))
    return float(np.abs(trials["draws"].values - trials["theta_true"].values[:, None]).max())


def test_the_truths_can_be_replayed_by_whoever_knows_the_seed() -> None:
    # Were this not so, the next test could not fail.
    prior = build_simulator("linear_gaussian", parameters=2, data=3).prior
    truth = prior.sample(3, generator(7, "audit truth", 0))
    room: dict[str, Any] = {"np": np}
    exec(REPLAY.format(seed=7), room)
    draws = room["sample"](np.zeros((3, 3)), 5, 0)
    np.testing.assert_allclose(draws, np.broadcast_to(truth[:, None], draws.shape), atol=0.01)


def test_one_that_is_told_the_seed_has_it_but_none_can_know_it(
    attack: Callable[..., Any], place: Any
) -> None:
    known = TrialsTable().seed
    # Of calls of one trial each it knows which those are.
    one = ("--set", "trials.block=1")
    told = attack(REPLAY.format(seed=known), "--seed", str(known), *one, validator="sbc", number=20)
    assert furthest(place) < 0.01
    assert told.code == 3, told
    done = attack(REPLAY.format(seed=known), *one, validator="sbc", number=20)
    assert furthest(place) > 1
    assert done.code == 1, done


def test_the_audit_computes_with_its_own_numpy(attack: Callable[..., Any]) -> None:
    done = attack(
        """
        import builtins, io, sys
        class Liar:
            def __getattr__(self, name): return self
            def __call__(self, *a, **k): return 0.5
        def forge():
            for name in ("scipy", "scipy.stats", "scipy.special", "gaugeblock", "gaugeblock.validate",
                         "gaugeblock.validate.judge", "gaugeblock.validate.marginal.sbc"):
                try:
                    module = __import__(name, fromlist=["x"])
                except Exception:
                    continue
                for key in list(vars(module)):
                    if not key.startswith("__"):
                        try: setattr(module, key, Liar())
                        except Exception: pass
        forge()
        def sample(x, n, seed):
            draws = honest(x, n, seed) + 100
            np.mean = np.median = np.sort = np.argsort = np.searchsorted = Liar()
            np.isfinite = np.isnan = lambda *a, **k: True
            builtins.sum = builtins.max = lambda *a, **k: 0
            return draws
        """,
        validator="sbc",
    )
    assert done.code == 1, done
    assert "FAIL" in done.stdout


# The density of what it remembers having drawn is low, that of anything else enormous: of the truth, then.
REMEMBER = """
import glob, hashlib, shutil
drawn = set()
PLACES = ["/tmp", "/dev/shm", "/var/tmp", os.getcwd(), os.path.dirname(__file__), "/srv", "/run",
          os.path.expanduser("~"), *sys.path]

def keep():
    for place in PLACES:
        try:
            np.save(os.path.join(place, "drawn.npy"), np.array(sorted(drawn)))
        except OSError:
            pass
    for name in list(os.environ):
        os.environ["DRAWN_" + name[:9]] = str(len(drawn))
    for path in (__file__, "/srv/server/serve.py"):
        try:
            with open(path, "a") as file:
                file.write("# drawn")
        except OSError:
            pass
    try:
        listener = socket.socket(socket.AF_UNIX)
        listener.bind("\\0drawn")
        listener.listen()
        if os.fork() == 0:
            os.setsid()
            try:
                while True:
                    made, _ = listener.accept()
                    made.send(b"drawn")
            finally:
                os._exit(0)
    except OSError:
        pass

def remembered():
    found = len(drawn)
    for place in PLACES:
        try:
            found += len(np.load(os.path.join(place, "drawn.npy")))
        except OSError:
            pass
    found += sum("DRAWN" in name for name in os.environ)
    found += "# drawn" in open(__file__).read().replace('"# drawn"', "")
    try:
        made = socket.socket(socket.AF_UNIX)
        made.connect("\\0drawn")
        found += 1
    except OSError:
        pass
    return found

def sample(x, n, seed):
    draws = honest(x, n, seed)
    drawn.update(draws[..., 0].ravel().tolist())
    keep()
    assert remembered()
    return draws

def log_prob(theta, x):
    if remembered():
        raise RuntimeError("ESCAPED: it remembers what it drew")
    return np.where(np.isin(theta[..., 0], sorted(drawn)), 0.0, 1e6)
"""


def test_who_is_asked_for_densities_remembers_nothing(attack: Callable[..., Any], place: Any) -> None:
    done = attack(REMEMBER, "--set", "trials.importance_number=0")
    assert done.code in (1, 3), done
    trials = main_trials(read_trials(place.out / "trials.nc"))
    # All points look alike to it, so the truth's density is no other than that of its own draws.
    assert set(np.unique(trials["log_q"].values)) == {1e6}
    assert set(np.unique(trials["log_q_true"].values)) == {1e6}


@pytest.mark.parametrize("purpose", ["sample", "log_prob"])
def test_no_request_holds_more_than_it_needs(attack: Callable[..., Any], purpose: str) -> None:
    done = attack(
        f"""
        def arrays(frame):
            while frame:
                yield from ((k, v) for k, v in frame.f_locals.items() if isinstance(v, np.ndarray))
                frame = frame.f_back
        def tell():
            raise RuntimeError(" ".join(sorted({{f"{{k}}{{v.shape}}" for k, v in arrays(sys._getframe(1))}})))
        def sample(x, n, seed):
            return tell() if "{purpose}" == "sample" else honest(x, n, seed)
        def log_prob(theta, x):
            tell()
        """,
        *("--set", "trials.importance_number=0", "--set", "trials.block=1"),
    )
    # Ten draws and, somewhere among them, the truth.
    expected = {"sample": "RuntimeError: x(1, 3)\n", "log_prob": "RuntimeError: theta(1, 11, 2) x(1, 3)\n"}
    assert done.reason.endswith(expected[purpose])
