"""Any simulator somebody has, as one of ours: an object, a class, a plain function beside a prior."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import numbers, plain
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.global_state import SEEDS, seeded_globals
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.prior_from import as_prior
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.simulators.registry import build_simulator, call, load_object

GIVE_A_PRIOR = "give prior=..., a gaugeblock.Prior or one of scipy, torch, sbi or numpyro"


class FunctionSimulator:
    """A function `simulate(theta, rng)` and the prior of its parameters.

    theta is ``(n, parameter)``, what comes back ``(n, *data_shape)``. A function of theta alone, as sbi has
    them, gets a tensor where torch is installed, and its random numbers from torch's and NumPy's global
    generators, which are seeded for each call and put back. `circular` names parameters that are angles.
    """

    def __init__(self, simulate: Callable[..., Any], prior: Any, *, circular: Sequence[str] = ()):
        self._simulate, self.prior, self.circular = simulate, prior, tuple(circular)
        self._alone = takes_no_rng(simulate, arguments=1)

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[Any]:
        """Data ``(n, *data_shape)`` for each row of theta."""
        if not self._alone:
            made = self._simulate(np.asarray(theta, dtype=float), rng)
        else:
            with seeded_globals(int(rng.integers(SEEDS))) as torch:
                rows = np.asarray(theta, dtype=float)
                made = self._simulate(rows if torch is None else torch.as_tensor(rows, dtype=torch.float32))
        return numbers(made, what="the simulator's data")

    def describe(self) -> dict[str, Any]:
        """The function, its source and the prior; without a source file of its own it has no identity."""
        return {
            "simulator": _called(self._simulate),
            "prior": self.prior.describe(),
            **source_of(self._simulate),
        }

    def __repr__(self) -> str:
        return f"FunctionSimulator({_called(self._simulate)}, parameters {', '.join(self.prior.names)})"


class FunctionSimulatorWithLikelihood(FunctionSimulator):
    """The same, with the likelihood of the data as a function: a capability is a method that is there."""

    def __init__(
        self,
        simulate: Callable[..., Any],
        prior: Any,
        log_likelihood: Callable[..., Any],
        *,
        circular: Sequence[str] = (),
    ):
        super().__init__(simulate, prior, circular=circular)
        self._log_likelihood = log_likelihood

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Normalised natural log density of x given theta, broadcast over leading axes."""
        return plain(self._log_likelihood(theta, x), what="the simulator's log likelihood")


def as_simulator(
    simulator: Any,
    *,
    prior: Any = None,
    names: Sequence[str] | None = None,
) -> Simulator:
    """Whatever simulates, as a `Simulator`.

    Parameters
    ----------
    simulator
        An object with `prior` and `simulate(theta, rng)`; a class that makes one; a function ``(theta, rng)``
        or, as sbi has them, ``(theta)``, beside its `prior`; a name (``"xray"``, ``"module:object"``), or a
        table ``{"name": ..., ...options}`` as in a configuration.
    prior
        Whatever `as_prior` takes. It takes the place of the simulator's own, where that has one.
    names : sequence of str, optional
        Of the parameters, in the order of theta's columns.

    Raises
    ------
    InputError
        If it is none of these, or a function comes without a prior.

    >>> from gaugeblock.simulators import Prior, Uniform
    >>> coin = as_simulator(lambda theta, rng: rng.binomial(20, theta), prior=Prior({"p": Uniform(0, 1)}))
    >>> coin.simulate([[0.0], [1.0]], np.random.default_rng(1)).tolist()
    [[0], [20]]
    """
    if isinstance(simulator, str):
        simulator = _loaded(simulator) or build_simulator(simulator)
    elif isinstance(simulator, Mapping):
        options = dict(simulator)
        name = options.pop("name", None)
        if not isinstance(name, str):
            raise InputError("the simulator's table needs a name, as in {'name': 'xray', 'level': 'medium'}")
        if isinstance(options.get("prior"), str) and ":" in options["prior"]:
            theirs = options.pop("prior")
            prior = load_object(theirs, "prior") if prior is None else prior
        simulator = (None if options else _loaded(name)) or build_simulator(name, **options)
    if inspect.isclass(simulator):
        simulator = call(simulator, f"the simulator, the class {simulator.__name__},")
    method, own = getattr(simulator, "simulate", None), getattr(simulator, "prior", None)
    if not callable(method):
        if not callable(simulator) or hasattr(simulator, "sample"):
            given = type(simulator).__name__
            raise InputError(
                f"the simulator is a {given} without simulate: give an object with prior and simulate(theta, "
                "rng), or a function of (theta, rng) and its prior; the order is (estimator, simulator)"
            )
        if prior is None:
            raise InputError(f"{_called(simulator)} simulates, and comes without a prior: {GIVE_A_PRIOR}")
        return FunctionSimulator(simulator, as_prior(prior, names))
    if prior is None and own is None:
        raise InputError(f"the simulator is a {type(simulator).__name__} without a prior: {GIVE_A_PRIOR}")
    if prior is None and names is None and isinstance(own, Prior):
        return simulator  # type: ignore[no-any-return]
    known = as_prior(own if prior is None else prior, names)
    # Angles stay angles under another prior, and under other names.
    called = dict(zip(getattr(own, "names", ()), known.names, strict=False))
    circular = [called.get(name, name) for name in getattr(simulator, "circular", ())]
    if isinstance(simulator, HasLikelihood):
        return FunctionSimulatorWithLikelihood(method, known, simulator.log_likelihood, circular=circular)
    return FunctionSimulator(method, known, circular=circular)


def _loaded(name: str) -> Any:
    """A function that simulates, given as ``module:function``; None for everything that has to be built."""
    if ":" not in name:
        return None
    found = load_object(name, "simulator")
    return found if first_argument(found) == "theta" else None


def _parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """What a function takes; nothing where it does not say."""
    try:
        return list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return []


def takes_no_rng(function: Callable[..., Any], *, arguments: int) -> bool:
    """Whether a function needs so many positional arguments, and takes no `rng`."""
    parameters = _parameters(function)
    if any(p.name == "rng" or p.kind is p.VAR_POSITIONAL for p in parameters):
        return False
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in kinds and p.default is p.empty for p in parameters) == arguments


def first_argument(function: Callable[..., Any]) -> str:
    """What a function calls its first argument; nothing where it does not say."""
    return next((p.name for p in _parameters(function)), "")


def _called(function: Any) -> str:
    return str(getattr(function, "__qualname__", type(function).__name__))


def source_of(function: Callable[..., Any]) -> dict[str, Any]:
    """What tells a function from another: its file's hash, or None where what it does cannot be told."""
    inner = inspect.unwrap(function)
    bound = getattr(inner, "__self__", None) or getattr(inner, "__closure__", None)
    try:
        source = file_digest(Path(inspect.getsourcefile(inner) or ""))
    except (InputError, TypeError):
        return {"state_sha256": None}
    return {"source_sha256": source, **({"state_sha256": None} if bound else {})}
