import hashlib
import os
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator
from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.protocol import Embeds, HasDensity
from gaugeblock.stranger.material import Material
from gaugeblock.stranger.stranger import Stranger

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
