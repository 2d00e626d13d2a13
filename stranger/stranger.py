"""Somebody else's estimator, asked through a pipe while it runs in a sandbox."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.simulators.registry import call
from gaugeblock.stranger.detect import detect
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.listing import listing
from gaugeblock.stranger.mapping import Mapping as ParameterMapping
from gaugeblock.stranger.material import Material
from gaugeblock.stranger.process import Child, Launch
from gaugeblock.stranger.program import Places, own_program, python_program
from gaugeblock.stranger.sandbox import working_sandbox
from gaugeblock.stranger.wire import plain

USER = "user"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def environment(limits: Limits) -> dict[str, str]:
    """Every variable that is set.

    >>> environment(Limits(threads=2))["OMP_NUM_THREADS"]
    '2'
    """
    return {
        "PATH": "/usr/local/bin:/usr/bin:/bin",
        "HOME": "/tmp",
        "TMPDIR": "/tmp",
        "USER": USER,
        "LOGNAME": USER,
        "LANG": "C.UTF-8",
        "TZ": "UTC",
        "JAX_PLATFORMS": "cpu",
        "CUDA_VISIBLE_DEVICES": "",
        **dict.fromkeys(THREADS, str(limits.threads)),
    }


def system_files(material: Material, user: int | None) -> dict[str, Path]:
    """Files of /etc that programs ask for, with nothing of this machine's in them: place -> file."""
    number = 65534 if user is None else user
    texts = {
        "passwd": f"{USER}:x:{number}:{number}::/tmp:/bin/sh\n",
        "group": f"{USER}:x:{number}:\n",
        "hosts": "127.0.0.1 localhost\n",
        "nsswitch.conf": "passwd: files\ngroup: files\nhosts: files\n",
    }
    return {f"/etc/{name}": material.write(name, text) for name, text in texts.items()}


CAN = ("sample", "log_prob", "embed")
MOST = 1000
WORD = 100


@dataclass(frozen=True, kw_only=True)
class Claims:
    """A stranger's library and versions, the names of its parameters if it has any, and what it can do.

    `autocorrelated`: it says that its draws of one trial are a Markov chain; audits measure that themselves.
    """

    library: str
    versions: dict[str, str]
    parameters: tuple[str, ...] | None
    can: tuple[str, ...]
    autocorrelated: bool = False

    @classmethod
    def of(cls, header: Mapping[str, Any]) -> Claims:
        """Out of the header of its answer to ``describe``.

        >>> Claims.of({"can": ["sample"], "parameters": ["a", "b"]}).parameters
        ('a', 'b')

        Raises
        ------
        InputError
            If it cannot sample, or a part is not what the protocol says.
        """
        names, versions, can = (header.get(key) for key in ("parameters", "versions", "can"))
        if not isinstance(can, list) or "sample" not in can:
            raise InputError(f"the stranger does not say that it can sample: can = {plain(can, 80)}")
        if names is not None and not (isinstance(names, list) and 0 < len(names) <= MOST):
            raise InputError(f"the stranger's parameters are no list of names: {plain(names, 80)}")
        if versions is not None and not (isinstance(versions, dict) and len(versions) <= MOST):
            raise InputError(f"the stranger's versions are no table: {plain(versions, 80)}")
        return cls(
            library=plain(header.get("library") or "", WORD),
            versions={plain(key, WORD): plain(value, WORD) for key, value in (versions or {}).items()},
            parameters=None if names is None else tuple(plain(name, WORD) for name in names),
            can=tuple(name for name in CAN if name in can),
            autocorrelated=header.get("autocorrelated") is True,
        )


TRUSTED = "none: trusted by whoever ran the audit"
SEEDS = 1 << 62


class Stranger(Shown):
    """An estimator out of a file that nobody vouches for; it never sees a truth, nor this process.

    Draws and densities are asked of two children that know nothing of each other. `log_prob` and `embed` are
    there only where the stranger says that it can. `close` ends everything; `end_phase` the children that
    run, so that what is asked next is asked of a fresh one.

    Parameters
    ----------
    path
        The model, a file or a folder; None where `command` needs none.
    simulator
        What it claims to invert: its prior says which parameters there are.
    format
        How to load it, one of `child/formats`; by default found out from its first bytes.
    python
        Interpreter of the stranger's environment; by default the one that is running. In a command the word
        ``{python}`` stands for it.
    command
        In place of both: a program of its own that speaks the protocol (docs/stranger-protocol.md).
    builder, options
        ``FILE.py:function`` and plain data for formats that need them.
    parameters
        Which of the stranger's columns is which parameter, and on what scale (`Mapping`).
    trust
        Run it without a sandbox: with everything that its author may have put into it.
    limits
        What it may use (`Limits`).

    Raises
    ------
    InputError
        If there is no sandbox, the files cannot be read, it cannot be started, or it says something else than
        what the protocol asks; every method raises it too, and names what the stranger did.
    """

    untrusted = True
    log_prob: Callable[[ArrayLike, ArrayLike], Array]
    embed: Callable[[ArrayLike], Array]

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        simulator: Simulator,
        *,
        format: str | None = None,
        python: str | None = None,
        command: str | Sequence[str] | None = None,
        builder: str | None = None,
        options: Mapping[str, Any] | None = None,
        parameters: Mapping[str, Any] | None = None,
        trust: bool = False,
        limits: Mapping[str, Any] | None = None,
    ):
        self._prior, self._limits = simulator.prior, Limits.of(limits or {})
        self._sandbox = None if trust else working_sandbox()
        self._material = Material()
        self._children: dict[str, Child] = {}
        self._peaks: dict[str, dict[str, float]] = {}
        try:
            places = Places(self._material, inside=not trust)
            model = None if path is None else Path(os.path.abspath(path))
            if command is not None:
                program = own_program(places, command, model, python=python)
            elif model is None:
                raise InputError("estimator: give the stranger's file as path, or a command that answers")
            else:
                chosen = format or detect(model)
                program = python_program(
                    places, model, chosen, python=python, builder=builder, options=options or {}
                )
            self._said = dict(program.said)
            copy = None if model is None else self._material.folder / "model" / model.name
            self._model = copy if copy is not None and copy.exists() else None
            self._launch = self._launched(program.words, program.show)
            self._claims = self._introduced()
            self._mapping = self._mapped(parameters)
        except BaseException:
            self.close()
            raise
        if "log_prob" in self._claims.can and self._mapping.whole:
            self.log_prob = self._log_prob
        if "embed" in self._claims.can:
            self.embed = self._embed
        self.autocorrelated = self._claims.autocorrelated

    def _launched(self, words: Sequence[str], show: Mapping[str, Path]) -> Launch:
        folder = str(self._material.folder)
        if self._sandbox is None:
            prlimit = shutil.which("prlimit")
            limited = [] if prlimit is None else self._limits.command(prlimit, own_user=False)
            surroundings = {**os.environ, **environment(self._limits)}
            return Launch([*limited, *words], surroundings, folder, sandboxed=False)
        command = self._sandbox.words(
            words,
            limits=self._limits,
            environment=environment(self._limits),
            show={**system_files(self._material, self._sandbox.user), **show},
        )
        # The sandbox's own process has no environment either: from inside, that one's may be readable.
        return Launch(command, {}, folder, sandboxed=True)

    def _introduced(self) -> Claims:
        seconds = self._limits.startup_seconds
        header, _ = self._child("draws").ask({"request": "describe"}, expect={}, seconds=seconds)
        return Claims.of(header)

    def _mapped(self, table: Mapping[str, Any] | None) -> ParameterMapping:
        own, theirs = self._prior.names, self._claims.parameters
        if theirs is not None and len(theirs) != len(own) and not table:
            raise InputError(
                f"the stranger has {len(theirs)} parameters ({', '.join(theirs)}), the simulator {len(own)} "
                f"({', '.join(own)}); say which is which in [estimator.parameters]"
            )
        return ParameterMapping.of(table, own, stranger=theirs)

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws of the stranger, ``(batch, n, parameter)``, in the simulator's parameters."""
        data = np.asarray(x)
        seed = _one_way(rng.integers(0, SEEDS, (len(data),)))
        _, arrays = self._child("draws").ask(
            {"request": "sample", "n": n, "seed": seed},
            {"x": data},
            expect={"draws": (len(data), n, self._mapping.width)},
        )
        return self._mapping.to_simulator(arrays["draws"])

    def _log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density ``(batch, n)`` that the stranger claims, in the simulator's parameters.

        NaN where theta is not finite, -inf where it has no counterpart on the stranger's scale.
        """
        points, data = np.asarray(theta, dtype=float), np.asarray(x)
        theirs = self._mapping.from_simulator(points)
        there = np.asarray(np.isfinite(theirs).all(axis=-1))
        # What cannot be asked for is asked for somewhere else, and the answer thrown away.
        asked = np.where(there[..., None], theirs, self._mapping.from_simulator(self._prior.center))
        _, arrays = self._child("densities").ask(
            {"request": "log_prob"}, {"theta": asked, "x": data}, expect={"log_prob": points.shape[:2]}
        )
        density = arrays["log_prob"] + self._mapping.log_jacobian(asked)
        nowhere = np.where(np.isfinite(points).all(axis=-1), -np.inf, np.nan)
        return np.where(there, density, nowhere)

    def _embed(self, x: ArrayLike) -> Array:
        """Summary that the stranger claims to make of the data, ``(batch, feature)``."""
        data = np.asarray(x)
        _, arrays = self._child("summaries").ask(
            {"request": "embed"}, {"x": data}, expect={"features": (len(data), None)}
        )
        return arrays["features"]

    def describe(self) -> dict[str, Any]:
        """What was loaded, how it was confined, and what it says of itself."""
        return {
            "estimator": "stranger",
            "sha256": dict(self._material.sha256),
            **self._said,
            "claims": asdict(self._claims),
            "mapping": self._mapping.to_json(),
            "threads": self._limits.threads,
            "sandbox": TRUSTED if self._sandbox is None else "bubblewrap",
        }

    def confinement(self) -> dict[str, Any]:
        """How it was confined, within which limits, and the most that its children were seen to use."""
        for purpose, child in self._children.items():
            self._note(purpose, child)
        return {
            "sandbox": TRUSTED if self._sandbox is None else self._sandbox.describe(),
            "limits": self._limits.model_dump(),
            "used": {purpose: dict(peak) for purpose, peak in self._peaks.items()},
        }

    def listing(self) -> dict[str, Any]:
        """What loading its model would import and call, read without loading it; of a command, nothing."""
        return {} if self._model is None else listing(self._model)

    def end_phase(self) -> None:
        """End the children: whatever they remember is gone."""
        for purpose, child in list(self._children.items()):
            child.close()
            self._note(purpose, child)
            del self._children[purpose]

    def close(self) -> None:
        """End everything and remove the copies of the stranger's files."""
        self.end_phase()
        self._material.close()

    def _child(self, purpose: str) -> Child:
        child = self._children.get(purpose)
        if child is None or child.closed:
            child = self._children[purpose] = Child(self._launch, self._limits)
        return child

    def _note(self, purpose: str, child: Child) -> None:
        now = {
            "memory_gb": round(child.usage.memory / 1e9, 3),
            "cpu_seconds": round(child.usage.cpu_seconds, 2),
            "threads": float(child.usage.threads),
        }
        before = self._peaks.get(purpose, {})
        self._peaks[purpose] = {key: max(value, before.get(key, 0.0)) for key, value in now.items()}


def build(simulator: Simulator, path: str | os.PathLike[str] | None = None, **options: Any) -> Stranger:
    """A `Stranger` out of the table ``[estimator]`` of a configuration.

    Raises
    ------
    InputError
        As `Stranger` does, and if there is no such option.
    """
    return call(Stranger, "estimator 'stranger'", path, simulator, **options)  # type: ignore[no-any-return]


def _one_way(numbers: NDArray[np.int64]) -> int:
    """A seed that does not lead back to the stream of the numbers, and so to the truths of the audit.

    What a generator gives can be computed backwards; a hash cannot.
    """
    return int.from_bytes(hashlib.sha256(numbers.astype("<i8").tobytes()).digest()[:8], "big") % SEEDS
