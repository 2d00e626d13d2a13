"""What all tests share: threads, data that are fetched or lie elsewhere, how a missing file is treated."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.core.compilation_cache import keep_compiled

ROOT = Path(__file__).resolve().parent

# Before anything imports NumPy or torch: every pytest-xdist worker gets its share of the machine.
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, str(max(1, (os.cpu_count() or 1) // _WORKERS)))
os.environ.setdefault("MPLBACKEND", "Agg")
# Before anything imports JAX, and for processes that tests start: what one file compiles, the next need not.
keep_compiled()
# JAX writes its files in place: in one folder a worker would read what another has half written.
if _WORKERS > 1 and (_compiled := os.environ.get("JAX_COMPILATION_CACHE_DIR")):
    os.environ["JAX_COMPILATION_CACHE_DIR"] = f"{_compiled}/{os.environ['PYTEST_XDIST_WORKER']}"


@pytest.fixture(scope="session", autouse=True)
def _state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Blocks are marked with another key than that of whoever runs the tests; other processes see it too."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


def _missing(reason: str) -> None:
    """Skip, or fail where everything that can be had was promised to be there (`.ci/run`)."""
    if os.environ.get("GAUGEBLOCK_REQUIRE_ALL") == "1":
        pytest.fail(f"GAUGEBLOCK_REQUIRE_ALL=1, but {reason}")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def missing() -> Callable[[str], None]:
    """Say that something a test needs is not on this machine: ``missing("no Chromium found")``."""
    return _missing


@pytest.fixture(scope="session")
def sandbox() -> Any:
    """The sandbox that strangers' estimators run in; tests that need it skip where none works."""
    from gaugeblock.core.errors import InputError
    from gaugeblock.stranger.sandbox import working_sandbox

    try:
        return working_sandbox()
    except InputError as error:
        return _missing(str(error))


@pytest.fixture(scope="session")
def xray_data() -> Any:
    """The responses, spectra and tables of the reference cases, in the cache; fetched where they are not."""
    pytest.importorskip("jaxspec")
    from gaugeblock.core.errors import InputError
    from gaugeblock.simulators.xray.data import fetch

    try:
        return fetch()
    except InputError as error:
        return _missing(str(error))


@pytest.fixture(scope="session")
def shared_file() -> Callable[[str], Path]:
    """Path of a file that is too large or too foreign to be in the repository; its test skips without it.

    They lie in $GAUGEBLOCK_SHARED, or in a folder `shared` beside the checkout.
    """
    beside = Path(__file__).parent.parent / "shared"
    folder = Path(os.environ.get("GAUGEBLOCK_SHARED", beside))

    def find(name: str) -> Path:
        if not (folder / name).exists():
            pytest.skip(f"{name} is not in {folder}; set GAUGEBLOCK_SHARED to a folder that holds it")
        return folder / name

    return find


@pytest.fixture(scope="session")
def tree() -> list[str]:
    """Names of the checkout's files that git does not ignore, symlinks as themselves."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    # Any owner: in a container the checkout often belongs to somebody else.
    command = [
        "git",
        "-c",
        "safe.directory=*",
        "ls-files",
        "-z",
        "--cached",
        "--others",
        "--exclude-standard",
    ]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return sorted(name for name in listed.split("\0") if name and os.path.lexists(ROOT / name))
