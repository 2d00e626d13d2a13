import hashlib
import os
import resource
import stat
import struct
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator
from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.protocol import Embeds, HasDensity
from gaugeblock.stranger.material import Material
from gaugeblock.stranger.stranger import Claims, Stranger, system_files
from gaugeblock.stranger.usage import children

X = np.array([[0.1, -0.4, 1.2], [0.0, 2.0, -1.0]])


def test_draws_and_densities_are_those_of_the_file(stranger: Any, simulator: Any) -> None:
    one = stranger()
    draws = one.sample(X, 2000, np.random.default_rng(1))
    exact = simulator.posterior_sample(X, 2000, np.random.default_rng(2))
    np.testing.assert_allclose(draws.mean(axis=1), exact.mean(axis=1), atol=0.1)
    np.testing.assert_allclose(one.log_prob(draws, X), simulator.posterior_log_prob(draws, X), atol=1e-10)
    again = one.sample(X, 2000, np.random.default_rng(1))
    np.testing.assert_array_equal(draws, again)
    one.end_phase()
    np.testing.assert_array_equal(draws, one.sample(X, 2000, np.random.default_rng(1)))


def test_it_can_what_it_says_that_it_can(stranger: Any) -> None:
    one = stranger(density=False)
    assert not isinstance(one, HasDensity)
    assert not isinstance(one, Embeds)
    more = stranger("def embed(x):\n    return x[:, :2]")
    assert isinstance(more, HasDensity)
    np.testing.assert_array_equal(more.embed(X), X[:, :2])


def test_chains_are_called_chains(stranger: Any) -> None:
    assert not stranger().autocorrelated
    assert stranger("def describe():\n    return {'autocorrelated': True}").autocorrelated
    assert not stranger("def describe():\n    return {}").autocorrelated


def test_draws_and_densities_come_of_processes_that_share_nothing(stranger: Any) -> None:
    one = stranger(
        """
        CALLS = []
        def sample(x, n, seed):
            CALLS.append("sample")
            open("/tmp/note", "a").write("theta")
            return np.full((len(x), n, 2), float(len(CALLS)))
        def log_prob(theta, x):
            CALLS.append("log_prob")
            return np.full(theta.shape[:2], len(CALLS) + 10.0 * os.path.exists("/tmp/note"))
        """
    )
    rng = np.random.default_rng(1)
    assert one.sample(X, 3, rng).max() == 1
    assert one.sample(X, 3, rng).max() == 2
    assert one.log_prob(np.zeros((2, 4, 2)), X).max() == 1
    one.end_phase()
    assert one.sample(X, 3, rng).max() == 1


def test_what_is_not_finite_is_kept_and_never_asked_for(stranger: Any) -> None:
    one = stranger(
        """
        def sample(x, n, seed):
            return np.full((len(x), n, 2), np.nan)
        def log_prob(theta, x):
            assert np.isfinite(theta).all()
            return np.zeros(theta.shape[:2])
        """
    )
    draws = one.sample(X, 3, np.random.default_rng(1))
    assert np.isnan(draws).all()
    draws[0, 0] = 1.0
    density = one.log_prob(draws, X)
    assert density[0, 0] == 0
    assert np.isnan(density).sum() == 5


def test_its_own_order_and_scale_are_undone(stranger: Any, simulator: Any) -> None:
    one = stranger(
        """
        their_sample, their_log_prob = sample, log_prob
        def sample(x, n, seed):
            return their_sample(x, n, seed)[..., ::-1] * 100
        def log_prob(theta, x):
            return their_log_prob(theta[..., ::-1] / 100, x) - 2 * np.log(100)
        def describe():
            return {"parameters": ["second", "first"]}
        """,
        parameters={
            "theta_1": {"name": "first", "unit": 0.01},
            "theta_2": {"name": "second", "unit": 0.01},
        },
    )
    draws = one.sample(X, 50, np.random.default_rng(1))
    np.testing.assert_allclose(one.log_prob(draws, X), simulator.posterior_log_prob(draws, X), atol=1e-8)
    plain = stranger().sample(X, 50, np.random.default_rng(1))
    np.testing.assert_allclose(draws, plain)


def test_a_density_is_zero_without_a_counterpart_and_nan_without_a_point(file: Any) -> None:
    """The stranger holds logarithms: a uniform density there is one over both parameters here."""
    text = """
        def log_prob(theta, x):
            assert np.isfinite(theta).all()
            return np.zeros(theta.shape[:2]) + x[:, :1]
        """
    simulator: Any = SimpleNamespace(prior=SimpleNamespace(names=("a", "b"), center=np.ones(2)))
    table = {name: {"transform": "log"} for name in ("a", "b")}
    one = Stranger(file(text), simulator, parameters=table, trust=True)
    theta = np.array([[2.0, 3.0], [-2.0, 3.0], [2.0, 0.0], [np.nan, 3.0], [-1.0, np.inf], [5.0, 0.5]])
    inside = np.array([-np.log(6.0), -np.inf, -np.inf, np.nan, np.nan, -np.log(2.5)])
    found = one.log_prob(np.stack([theta, theta[::-1]]), X)
    one.close()
    np.testing.assert_allclose(found, np.stack([inside, inside[::-1]]) + X[:, :1], atol=1e-12)


def test_a_column_that_is_left_out_leaves_draws_and_no_density(stranger: Any) -> None:
    one = stranger(
        """
        def sample(x, n, seed):
            return np.broadcast_to([1.0, 2.0, 3.0], (len(x), n, 3))
        def describe():
            return {"parameters": ["a", "b", "c"]}
        """,
        parameters={"theta_1": "c", "theta_2": "a"},
        trust=True,
    )
    assert not isinstance(one, HasDensity)
    assert one.sample(X, 4, np.random.default_rng(1)).tolist() == [[[3.0, 1.0]] * 4] * 2


def test_one_that_failed_is_asked_again_in_a_fresh_process(stranger: Any) -> None:
    one = stranger(
        """
        CALLS = []
        def sample(x, n, seed):
            CALLS.append(n)
            if n == 1:
                raise ValueError
            return np.full((len(x), n, 2), float(len(CALLS)))
        """,
        trust=True,
    )
    rng, before = np.random.default_rng(1), children(os.getpid())
    assert one.sample(X, 2, rng).max() == 1
    assert children(os.getpid()) == before
    with pytest.raises(InputError, match="could not answer sample: ValueError"):
        one.sample(X, 1, rng)
    assert one.sample(X, 2, rng).max() == 1
    assert len(children(os.getpid())) == len(before)
    one.close()
    assert len(children(os.getpid())) == len(before) - 1


def test_the_most_that_it_used_is_kept_when_a_phase_ends(stranger: Any) -> None:
    one = stranger(
        """
        import threading
        def sample(x, n, seed):
            if n == 1:
                held, until = np.ones(15 * 10**6), time.process_time() + 0.4
                threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
                while time.process_time() < until: pass
            return np.zeros((len(x), n, 2))
        """,
        trust=True,
    )
    rng = np.random.default_rng(1)
    one.sample(X, 1, rng)
    used = one.confinement()["used"]
    assert list(used) == ["draws"]
    assert 0.12 < used["draws"]["memory_gb"] < 0.4
    assert 0.3 < used["draws"]["cpu_seconds"] < 5
    assert used["draws"]["threads"] == 2
    one.end_phase()
    one.sample(X, 2, rng)
    assert one.confinement()["used"]["draws"]["memory_gb"] >= used["draws"]["memory_gb"]
    one.log_prob(np.zeros((2, 1, 2)), X)
    one.end_phase()
    later = one.confinement()["used"]
    assert set(later) == {"draws", "densities"}
    assert later["draws"]["threads"] == 2
    assert later["densities"]["memory_gb"] < used["draws"]["memory_gb"]


def test_one_that_is_trusted_is_held_by_what_the_kernel_keeps(
    stranger: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OURS", "here")
    before = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    one = stranger(
        """
        import resource
        def describe():
            kinds = resource.RLIMIT_NOFILE, resource.RLIMIT_NPROC
            words = [*(resource.getrlimit(kind)[0] for kind in kinds), os.environ["OMP_NUM_THREADS"]]
            return {"library": f"{words} {os.environ['OURS']}"}
        """,
        trust=True,
        limits={"open_files": 77, "threads": 3, "processes": 200},
    )
    record = one.describe()
    assert record["claims"]["library"] == f"[77, {before}, '3'] here"
    assert record["threads"] == 3
    assert record["mapping"]["columns"] == [0, 1]


def test_what_it_says_of_itself_is_plain_and_short() -> None:
    said = {
        "can": ["embed", "fly", "sample"],
        "parameters": ["a" * 200, 7],
        "versions": {"k": 1, "l\n": None},
    }
    found = Claims.of({**said, "library": "x" * 200, "autocorrelated": 1})
    assert (found.can, found.autocorrelated) == (("sample", "embed"), False)
    assert (len(found.library), [len(name) for name in found.parameters or ()]) == (100, [100, 1])
    assert found.versions == {"k": "1", "l": "None"}
    found = Claims.of({"can": ["sample"], "library": None, "autocorrelated": True})
    assert found == Claims(library="", versions={}, parameters=None, can=("sample",), autocorrelated=True)
    for key in ("parameters", "versions"):
        assert Claims.of({"can": ["sample"], key: None}) == Claims.of({"can": ["sample"]})
    assert len(Claims.of({"can": ["sample"], "parameters": ["p"] * 1000}).parameters or ()) == 1000
    for wrong in ({"parameters": []}, {"parameters": ["p"] * 1001}, {"can": "sample"}, {"versions": []}):
        with pytest.raises(InputError, match="the stranger"):
            Claims.of({"can": ["sample"], **wrong})


@pytest.mark.parametrize(("user", "number"), [(None, 65534), (1234567, 1234567)])
def test_the_made_up_user_is_who_it_runs_as(user: int | None, number: int) -> None:
    material = Material()
    try:
        found = system_files(material, user)
        assert set(found) == {f"/etc/{name}" for name in ("passwd", "group", "hosts", "nsswitch.conf")}
        assert found["/etc/passwd"].read_text() == f"user:x:{number}:{number}::/tmp:/bin/sh\n"
        assert found["/etc/group"].read_text() == f"user:x:{number}:\n"
        assert stat.S_IMODE(found["/etc/hosts"].stat().st_mode) == 0o644
    finally:
        material.close()


def test_the_seed_it_gets_is_a_hash_of_numbers_one_a_trial(stranger: Any) -> None:
    one = stranger("def sample(x, n, seed):\n    raise ValueError(str(seed))", trust=True)
    numbers = np.random.default_rng(5).integers(0, 1 << 62, 2).tolist()
    expected = int(hashlib.sha256(struct.pack("<2q", *numbers)).hexdigest()[:16], 16) % 2**62
    with pytest.raises(InputError, match=f"ValueError: {expected}$"):
        one.sample(X, 1, np.random.default_rng(5))


def test_the_seed_it_gets_tells_nothing_of_ours(stranger: Any) -> None:
    one = stranger("def sample(x, n, seed):\n    return np.full((len(x), n, 2), float(seed % 2**50))")
    seeds = {one.sample(X, 1, generator(seed, "draws", 0))[0, 0, 0] for seed in range(5)}
    assert len(seeds) == 5
    assert min(seeds) > 1000


def test_what_was_hashed_is_what_is_loaded(stranger: Any, file: Any) -> None:
    one = stranger()
    path = file("def sample(x, n, seed):\n    return np.zeros((len(x), n, 2))")
    one.end_phase()
    assert one.sample(X, 3, np.random.default_rng(1)).std() > 0
    record = one.describe()
    assert record["sha256"]["model"] != hashlib.sha256(path.read_bytes()).hexdigest()
    assert record["sandbox"] == "bubblewrap"
    assert record["claims"]["versions"]["numpy"] == np.__version__
    confinement = one.confinement()
    assert confinement["limits"]["memory_gb"] == 1.0
    assert confinement["sandbox"]["program"].startswith("bubblewrap")
    assert one.listing()["kind"] == "other"


def test_without_a_sandbox_only_by_the_word(
    simulator: Any, file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies = tmp_path / "copies"
    copies.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(copies))
    monkeypatch.setattr("gaugeblock.stranger.sandbox.shutil.which", lambda *_, **__: None)
    with pytest.raises(InputError, match="--i-trust-this-estimator"):
        Stranger(file(), simulator)
    one = Stranger(file(), simulator, trust=True)
    try:
        assert one.sample(X, 3, np.random.default_rng(1)).shape == (2, 3, 2)
        assert one.describe()["sandbox"] == "none: trusted by whoever ran the audit"
        assert one.confinement()["sandbox"] == "none: trusted by whoever ran the audit"
        assert list(copies.iterdir())
    finally:
        one.close()
    # Of the stranger's files nothing is left lying about.
    assert not list(copies.iterdir())


PERL = """#!/usr/bin/perl
# Says what it is, and answers each request for draws with 0.1, 0.2, ...
use strict; binmode STDIN; binmode STDOUT; $| = 1;
sub take {
    my ($n) = @_; my $b = "";
    while ($n > length $b) { read(STDIN, $b, $n - length $b, length $b) or exit }
    $b
}
sub give { my ($h) = @_; print pack("N", length $h), $h }
while (1) {
    my $head = take(unpack "N", take(4));
    my @arrays = $head =~ /"x"/g;
    take(unpack "Q>", take(8)) for @arrays;
    if ($head =~ /"describe"/) { give('{"answer": "describe", "can": ["sample"], "library": "perl"}'); next }
    my ($n) = $head =~ /"n": (\\d+)/;
    my $text = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, $n, 2), }";
    $text .= " " x (117 - length $text) . "\\n";
    my $npy = "\\x93NUMPY\\x01\\x00" . pack("v", length $text) . $text;
    $npy .= pack("d<*", map { $_ / 10 } 1 .. 4 * $n);
    give('{"answer": "sample", "arrays": ["draws"]}'); print pack("Q>", length $npy), $npy;
}
"""


def test_a_program_in_another_language_is_asked(sandbox: Any, simulator: Any, tmp_path: Path) -> None:
    if not os.access("/usr/bin/perl", os.X_OK):
        pytest.skip("no perl")
    program = tmp_path / "answer.pl"
    program.write_text(PERL)
    program.chmod(0o755)
    one = build_estimator("stranger", simulator, command=[str(program)])
    try:
        assert one.sample(X, 3, np.random.default_rng(1)).ravel().tolist() == [k / 10 for k in range(1, 13)]
        record = one.describe()  # type: ignore[attr-defined]
        assert record["claims"]["library"] == "perl"
        assert record["command"] == ["answer.pl"]
        assert one.listing() == {}  # type: ignore[attr-defined]
        assert record["sha256"] == {"program": hashlib.sha256(PERL.encode()).hexdigest()}
    finally:
        one.close()  # type: ignore[attr-defined]


def test_what_decides_the_bits_is_described_and_where_it_lies_is_not(
    sandbox: Any, simulator: Any, tmp_path: Path, file: Any
) -> None:
    said = []
    for folder, width in (("here", 1), ("there", 1), ("there", 2)):
        path = tmp_path / folder / "theirs.py"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(file().read_bytes())
        one = Stranger(path, simulator, options={"width": width})
        said.append(one.describe())
        one.close()
    assert said[0] == said[1] != said[2]
    assert said[2]["format_options"] == {"width": 2}


def test_a_command_can_name_model_and_interpreter(
    sandbox: Any, simulator: Any, file: Any, tmp_path: Path
) -> None:
    child = Path(sys.modules[Stranger.__module__].__file__ or "").parent / "child"
    # A copy: where gaugeblock is installed beside the interpreter the formats would be seen with it.
    server = tmp_path / "serve.py"
    server.write_bytes((child / "serve.py").read_bytes())
    with pytest.raises(InputError, match=r"ended by itself \(exit \d+\)|cannot be loaded"):
        # It stands alone: the formats are not beside it.
        Stranger(
            file(), simulator, command=["{python}", str(server), '{"format": "python", "path": "{model}"}']
        )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"path": "nothing.pt"}, "nothing.pt: "),
        ({"path": "nothing.py", "format": "python"}, "nothing.py: no such file"),
        ({"format": "fortran", "path": __file__}, "estimator.format = 'fortran': there are .*python"),
        ({}, "give the stranger's file as path"),
        ({"command": ""}, "estimator.command is empty"),
        ({"command": "/usr/bin/nothing-there"}, "ended by itself .*nothing-there"),
        ({"path": __file__, "format": "python", "python": "/nowhere/python"}, "is no Python interpreter"),
        ({"path": __file__, "format": "python", "builder": "file.py"}, "expected FILE.py:function"),
        ({"path": __file__, "limit": {}}, "unexpected keyword argument 'limit'; its options are"),
        ({"path": __file__, "limits": {"memory": 3}}, "unknown key memory"),
    ],
)
def test_what_cannot_be_is_said_before_anything_runs(
    sandbox: Any, simulator: Any, options: Any, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        build_estimator("stranger", simulator, **options)


def test_a_folder_is_copied_once_and_may_hold_files_only(tmp_path: Path) -> None:
    source = tmp_path / "model"
    (source / "deep").mkdir(parents=True)
    (source / "weights").write_bytes(b"123")
    (source / "deep" / "more").write_bytes(b"4")
    material = Material()
    copy = material.take(source, "model")
    assert (copy / "deep" / "more").read_bytes() == b"4"
    assert stat.S_IMODE(material.folder.stat().st_mode) == 0o700
    other = Material()
    other.take(source, "model")
    assert other.sha256 == material.sha256
    (source / "secret").symlink_to("/etc/passwd")
    third = Material()
    with pytest.raises(InputError, match="secret: is a link"):
        third.take(source, "model")
    for one in (material, other, third):
        one.close()
        assert not one.folder.exists()


def test_what_a_killed_process_left_is_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left, held = tmp_path / "gaugeblock-stranger-left", Material()
    left.mkdir()
    for folder in (left, held.folder):
        os.utime(folder, (0, 0))
    Material().close()
    assert list(tmp_path.iterdir()) == [held.folder]
    held.close()
