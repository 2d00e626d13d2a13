"""Compiled programs on disk: told to JAX before it starts, bounded, never in anybody's way."""

import os
import subprocess
import sys

import pytest

from gaugeblock.core.compilation_cache import LARGEST, bounded, keep_compiled

ASK = """
import os
from gaugeblock.core.compilation_cache import keep_compiled
print(keep_compiled(), os.environ.get("JAX_COMPILATION_CACHE_DIR"))
"""
COMPILE = """
from gaugeblock.core.compilation_cache import keep_compiled
keep_compiled()
import jax, jax.monitoring
hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append(event))
print(float(jax.jit(lambda x: x * 3.0 + 1.0)(2.0)), any("cache_hits" in event for event in hits))
"""


def said(code, **variables):
    env = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "TF_"))}
    ran = subprocess.run(
        [sys.executable, "-c", code], env=env | variables, capture_output=True, text=True, check=True
    )
    assert ran.stderr == ""
    return ran.stdout.split()


def test_one_process_compiles_and_the_next_does_not(tmp_path):
    pytest.importorskip("jax")
    assert said(COMPILE, GAUGEBLOCK_CACHE=str(tmp_path)) == ["7.0", "False"]
    assert said(COMPILE, GAUGEBLOCK_CACHE=str(tmp_path)) == ["7.0", "True"]


def test_the_folder_is_of_the_processor_and_the_versions(tmp_path):
    pytest.importorskip("jax")
    folder, told = said(ASK, GAUGEBLOCK_CACHE=str(tmp_path))
    assert folder == told
    assert folder.startswith(str(tmp_path / "compiled"))
    other = f"import gaugeblock.core.processors as there\nthere._chip = lambda: 'another'\n{ASK}"
    assert said(other, GAUGEBLOCK_CACHE=str(tmp_path))[0] != folder


@pytest.mark.parametrize("variables", [{"GAUGEBLOCK_CACHE": ""}, {"JAX_COMPILATION_CACHE_DIR": "/mine"}])
def test_nothing_is_told_where_it_is_not_wanted(variables):
    kept, told = said(ASK, **variables)
    assert kept == "None"
    assert told == variables.get("JAX_COMPILATION_CACHE_DIR", "None")


def test_where_it_cannot_be_written_only_time_is_lost(tmp_path):
    (tmp_path / "file").write_text("")
    assert said(ASK, GAUGEBLOCK_CACHE=str(tmp_path / "file")) == ["None", "None"]


def test_the_oldest_go_first(tmp_path):
    for age, name in enumerate(["newest", "middle", "oldest"]):
        path = tmp_path / "key" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x" * 100)
        os.utime(path, (1000 - age, 1000 - age))
    bounded(tmp_path, largest=250)
    assert {path.name for path in (tmp_path / "key").iterdir()} == {"newest", "middle"}
    bounded(tmp_path, largest=200)
    assert len(list((tmp_path / "key").iterdir())) == 2


def test_the_users_own_cache_and_settings(tmp_path, monkeypatch):
    """Below what the system calls the cache, where nothing else is named; bounded before it is used."""
    pytest.importorskip("jax")
    monkeypatch.delitem(sys.modules, "jax")
    told = {"COMPILE_TIME_SECS": "0", "ENTRY_SIZE_BYTES": "-1"}
    told = {f"JAX_PERSISTENT_CACHE_MIN_{name}": value for name, value in told.items()}
    told["TF_CPP_MIN_LOG_LEVEL"] = "3"
    for name in ("JAX_COMPILATION_CACHE_DIR", "GAUGEBLOCK_CACHE", *told):
        monkeypatch.setenv(name, "")  # put back at the end
        monkeypatch.delenv(name)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    compiled = tmp_path / "cache" / "gaugeblock" / "compiled"
    compiled.mkdir(parents=True)
    (compiled / "old").touch()
    os.truncate(compiled / "old", LARGEST + 1)  # of no blocks
    folder = keep_compiled()
    assert folder is not None
    assert (folder.parent, len(folder.name), folder.is_dir()) == (compiled, 16, True)
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(folder)
    assert {name: os.environ[name] for name in told} == told
    assert not (compiled / "old").exists()
    assert keep_compiled() is None  # what is named by now stands
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("TF_CPP_MIN_LOG_LEVEL", "1")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert keep_compiled() == tmp_path / ".cache" / "gaugeblock" / "compiled" / folder.name
    assert os.environ["TF_CPP_MIN_LOG_LEVEL"] == "1"
