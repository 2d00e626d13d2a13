"""Any estimator somebody has in hand, as one of ours: other libraries' objects, classes, functions."""

from __future__ import annotations

import inspect
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.auditing.identity import identity
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError
from gaugeblock.core.global_state import SEEDS, seeded_globals
from gaugeblock.core.streams import Rng
from gaugeblock.estimators.protocol import Estimator, HasDensity
from gaugeblock.estimators.registry import build_estimator
from gaugeblock.simulators.from_function import first_argument, source_of, takes_no_rng
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.simulators.registry import load_object, made_for
from gaugeblock.stranger.mapping import Mapping as ColumnMapping

SHIPPED = "shipped:"
# Seconds that an estimator which rejects its own draws may take for data that are tried on it.
BRIEFLY = 5.0


class FunctionEstimator:
    """A function ``(x, n, rng)`` of data ``(batch, *data_shape)`` that gives ``(batch, n, parameter)``.

    What it gives may be a dictionary, of arrays ``(batch, n)`` by the `names` of parameters. A function
    ``(x, n)`` takes its random numbers from global generators, which are seeded for each call and put back.
    """

    def __init__(self, function: Callable[..., Any], names: Sequence[str] = ()):
        self._function, self._names = function, tuple(names)
        self._alone = takes_no_rng(function, arguments=2)

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)``."""
        if self._alone:
            with seeded_globals(int(rng.integers(SEEDS))):
                made = self._function(x, n)
        else:
            made = self._function(x, n, rng)
        if not isinstance(made, Mapping):
            return plain(made, what="the estimator's draws")
        return _columns({str(name): one for name, one in made.items()}, self._names)

    def describe(self) -> dict[str, Any]:
        """The function and its source; without a source file of its own it has no identity."""
        name = getattr(self._function, "__qualname__", type(self._function).__name__)
        return {"estimator": str(name), **source_of(self._function)}


class LibraryEstimator:
    """An object of another library, read by the code that reads it in a stranger's sandbox too.

    `model` has ``sample(x, n, seed)`` and ``describe()``, as the files of `gaugeblock.stranger.child.formats`
    make them; with `densities` its normalised density is asked for too, where it has one. That code takes its
    random numbers from global generators, which are seeded and put back.
    """

    log_prob: Callable[[ArrayLike, ArrayLike], Array]

    def __init__(self, model: Any, *, densities: bool = False):
        self._model = model
        self.autocorrelated = bool(model.describe().get("autocorrelated"))
        # An attribute only where it works: what an estimator can do is read off what it has.
        if densities and callable(getattr(model, "log_prob", None)):
            self.log_prob = self._log_prob

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)``."""
        seed = int(rng.integers(SEEDS))
        with seeded_globals(seed):
            return plain(self._model.sample(x, n, seed), what="the estimator's draws")

    def sample_briefly(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """As `sample`, for data that may be nothing that it was made for: it gives up after seconds."""
        if not hasattr(self._model, "patience"):
            return self.sample(x, n, rng)
        usual, self._model.patience = self._model.patience, BRIEFLY
        try:
            return self.sample(x, n, rng)
        finally:
            self._model.patience = usual

    def __repr__(self) -> str:
        return f"LibraryEstimator({self._model.describe()['library']})"

    def _log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Natural log density ``(batch, n)`` at theta ``(batch, n, parameter)``."""
        with seeded_globals(0):
            return plain(self._model.log_prob(theta, x), what="the estimator's log density")


class RearrangedEstimator:
    """An estimator whose columns are in another order or unit than the simulator's parameters.

    It has a density where its base has one, in which all of its columns are the simulator's.
    """

    log_prob: Callable[[ArrayLike, ArrayLike], Array]

    def __init__(self, base: Estimator, mapping: ColumnMapping):
        self.base, self.mapping = base, mapping
        self.autocorrelated = bool(getattr(base, "autocorrelated", False))
        if mapping.whole and isinstance(base, HasDensity):
            self._density, self.log_prob = base.log_prob, self._log_prob

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)``, in the simulator's order and units."""
        return self.mapping.to_simulator(plain(self.base.sample(x, n, rng), what="the estimator's draws"))

    def describe(self) -> dict[str, Any]:
        """What it rearranges, and how."""
        return {"base": identity(self.base), "mapping": self.mapping.to_json()}

    def _log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Natural log density ``(batch, n)`` at theta ``(batch, n, parameter)``, in the simulator's units."""
        theirs = self.mapping.from_simulator(theta)
        known = plain(self._density(theirs, x), what="log_q")
        return np.asarray(known + self.mapping.log_jacobian(theirs))


def as_estimator(estimator: Any, simulator: Simulator, *, densities: bool = False) -> Estimator:
    """Whatever draws from a posterior, as an `Estimator` for `simulator`.

    Parameters
    ----------
    estimator
        An object with ``sample(x, n, rng)``; a posterior of sbi, or its trainer; a workflow or approximator
        of BayesFlow; a function ``(x, n, rng)`` or ``(x, n)``; a class of estimators, made with the simulator
        where it takes one; ``"shipped:NAME"``, a model folder, a name (``"exact"``, ``"module:object"``), a
        file of somebody else's, which runs in a sandbox; or a table ``{"name": ..., ...options}``, whose
        option `base` may be any of these.
    simulator : Simulator
        What it is for.
    densities : bool
        Whether to ask another library's object for the density of its draws: sbi takes 10,000 draws for each
        data set to normalise it.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(estimator, os.PathLike):
        estimator = os.fspath(estimator)
    if isinstance(estimator, str):
        estimator = _table(estimator)
    if isinstance(estimator, Mapping):
        options = dict(estimator)
        name = options.pop("name", None)
        if not isinstance(name, str):
            raise InputError("the estimator's table needs a name, as in {'name': 'npe', 'path': 'trained'}")
        table = options.pop("parameters", None) if name != "stranger" else None
        if "base" in options and not isinstance(options["base"], Mapping):
            options["base"] = as_estimator(options["base"], simulator, densities=densities)
        made = _named(name, simulator, options)
        if table is None:
            return made
        return RearrangedEstimator(made, ColumnMapping.of(table, simulator.prior.names))
    if inspect.isclass(estimator):
        estimator = made_for(estimator, f"the estimator, the class {estimator.__name__},", simulator)
    library = _library(estimator)
    if library is not None:
        return LibraryEstimator(library, densities=densities)
    if callable(getattr(estimator, "sample", None)):
        return estimator  # type: ignore[no-any-return]
    if callable(estimator):
        return FunctionEstimator(estimator, simulator.prior.names)
    raise InputError(
        f"the estimator is a {type(estimator).__name__} without sample: give an object with sample(x, n, "
        "rng), a function (x, n, rng), a posterior of sbi or a workflow of BayesFlow; the order is "
        "(estimator, simulator)"
    )


def load(path: str | os.PathLike[str], *, device: str | None = None) -> Estimator:
    """A trained flow: a model folder of ``gaugeblock train``, or ``"shipped:NAME"``.

    `device` is ``cpu``, ``cuda``, ``cuda:1`` or ``auto``; by default what the variable GAUGEBLOCK_DEVICE
    says, or the CPU. A UserWarning names the gates that the flow FAILs, where a ``verdict.json`` of these
    weights lies beside them, or says that it was trained more often than had been promised.

    Raises
    ------
    InputError
        If the folder holds no model, or not all of one; or there is no such device.
    MissingExtraError
        If torch or sbi is not installed.
    """
    from gaugeblock.estimators.npe import load as load_flow
    from gaugeblock.estimators.npe.storage import model_folder

    flow = load_flow(path, device=device)
    if told := _told(model_folder(path), flow.record["sha256"]):
        warnings.warn(f"{path} {told}", stacklevel=2)
    return flow


def _told(folder: Path, weights: str) -> str:
    """What the verdict beside these weights has against them; nothing where there is no such verdict."""
    try:
        audit = finished_audit(folder)
        record = audit["provenance"]
        if record["estimator"]["sha256"] != weights:
            return ""
        failed = [str(gate["id"]) for gate in audit["gates"] if gate["verdict"] == "FAIL"]
        if failed:
            return f"FAILs {', '.join(failed)} in the audit beside it: do not use its draws unmended"
        trainings, promised = (int(record["history"][name]) for name in ("trainings", "promised"))
    except (InputError, KeyError, TypeError, ValueError):
        return ""
    if trainings <= promised:
        return ""
    return f"was trained {trainings} times, {promised} had been promised: an audit that it PASSes says less"


def _columns(draws: Mapping[str, Any], names: Sequence[str]) -> Array:
    """Draws ``(batch, n, parameter)`` of arrays ``(batch, n)``, or ``(batch, n, 1)``, by name."""
    lacking = [name for name in names if name not in draws]
    if lacking:
        there = ", ".join(draws) or "none"
        raise InputError(f"the estimator gave no draws of {', '.join(lacking)} (there are {there})")
    columns = [plain(draws[name], what=f"the estimator's draws of {name}") for name in names]
    return np.concatenate([one[..., None] if one.ndim == 2 else one for one in columns], axis=-1)


def _table(name: str) -> dict[str, Any]:
    """What a single word may mean."""
    path = Path(name)
    if name.startswith(SHIPPED) or (path / "model.json").is_file():
        return {"name": "npe", "path": name}
    return {"name": "stranger", "path": name} if path.is_file() else {"name": name}


def _named(name: str, simulator: Simulator, options: Mapping[str, Any]) -> Estimator:
    """What a name stands for; ``module:function`` may be a function that draws, not one that makes it."""
    if ":" in name and not options:
        found = load_object(name, "estimator")
        if inspect.isfunction(found) and first_argument(found) == "x":
            return FunctionEstimator(found, simulator.prior.names)
    return build_estimator(name, simulator, **options)


def _library(estimator: Any) -> Any:
    """The model of another library's object; None for what is none."""
    modules = {kind.__module__.partition(".")[0] for kind in type(estimator).__mro__}
    formats = "gaugeblock.stranger.child.formats"
    if "sbi" in modules:
        sbi = import_module(f"{formats}.sbi_posterior")
        try:
            return sbi.Posterior(sbi.ready(estimator), {})
        except ValueError:
            raise InputError(
                f"the estimator is sbi's {type(estimator).__name__}, which draws nothing: give the "
                "posterior that build_posterior() returns"
            ) from None
    if "bayesflow" in modules:
        bayesflow = import_module(f"{formats}.bayesflow")
        try:
            return bayesflow.Approximator(getattr(estimator, "approximator", estimator), {})
        except (AttributeError, ValueError) as error:
            raise InputError(f"the estimator, BayesFlow's {type(estimator).__name__}: {error}") from None
    return None
