"""An X-ray spectrum as a simulator: prior, expected counts, Poisson noise, likelihood, effects."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.poisson import PoissonCounts
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.segments import Segment
from gaugeblock.simulators.xray.effects import Assembly, extend
from gaugeblock.simulators.xray.expression import leaves, of_jaxspec, parameter_names, parse
from gaugeblock.simulators.xray.folding import forward
from gaugeblock.simulators.xray.forward import ForwardModel, HeldSpectrum
from gaugeblock.simulators.xray.integration import INTEGRATIONS
from gaugeblock.simulators.xray.library import effect_library, not_in_library
from gaugeblock.simulators.xray.places import places
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.tables import is_table, table_file
from gaugeblock.simulators.xray.xcm import saved


class XraySpectrum(PoissonCounts):
    """Poisson counts of an XSPEC-style model seen through a response.

    Implements `gaugeblock.simulators.Simulator` with every capability that has a likelihood but no
    closed-form posterior. Shapes: theta ``(..., parameter)`` in physical units, counts ``(..., channel)``.

    Parameters
    ----------
    model : str
        Model expression, such as ``tbabs*(powerlaw+bbodyrad)``.
    response : Response
    prior : Prior
        Over the model's parameters, by their dotted names, in any order; kept in that order.
    effects : tuple of Effect
        Ways in which this spectrum differs from the plain model, applied in order.
    integration : {"jaxspec", "exact"}
        How photons are integrated over the response's input bins: by jaxspec's rule, or to fourth order and
        on either side of every absorption edge, as small gains and bright spectra need it. Models with a
        component that jaxspec does not compute are always integrated exactly.

    Raises
    ------
    InputError
        If prior and model do not have the same parameters, or an effect cannot be applied.
    """

    def __init__(
        self,
        model: str,
        response: Response,
        prior: Prior,
        *,
        effects: tuple[Effect, ...] = (),
        integration: str = "jaxspec",
    ):
        if integration not in INTEGRATIONS:
            raise InputError(f"integration: there are {' and '.join(INTEGRATIONS)}, got {integration!r}")
        tree = parse(model)
        needed, given = set(parameter_names(tree)), set(prior.names)
        if needed - given:
            raise InputError(f"model {model!r}: no prior for {', '.join(sorted(needed - given))}")
        if given - needed:
            raise InputError(
                f"model {model!r}: prior for {', '.join(sorted(given - needed))}, which it does not have; "
                f"it has {', '.join(parameter_names(tree))}"
            )
        self.model = model
        self.response = response
        self.effects = tuple(effects)
        # What jaxspec does not compute has one rule only.
        self.integration = integration if of_jaxspec(tree) else "exact"
        self._plain_prior = prior
        self._assembly = extend(Assembly(tree, prior), self.effects)
        self.prior = self._assembly.prior
        self.exposure, self.channels = response.exposure, response.channels
        self.data_shape = (len(response.channels),)
        lacking = [bound.what.lacking(response) for bound in self._assembly.recorded]
        if any(lacking):
            raise InputError(f"response {response.name}: {next(filter(None, lacking))}")

    @cached_property
    def forward(self) -> ForwardModel:
        """The compiled forward model; also holds its pure, traceable functions."""
        return forward(self._assembly, self.response, integration=self.integration)

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Expected counts ``(..., channel)``, float64, at least 1e-6 per channel."""
        return self.forward.expected(theta)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log probability of counts x given theta, with the ``-log x!`` term, shape ``(...)``.

        Leading axes broadcast: theta ``(batch, n, parameter)`` goes with x ``(batch, 1, channel)``.
        """
        return self.forward.log_likelihood(theta, x)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected counts by the parameters, ``(..., channel, parameter)``."""
        return self.forward.jacobian(theta)

    def held(self, values: ArrayLike) -> HeldSpectrum:
        """`expected` and `jacobian` of the first parameters, the last ones held at values ``(k,)`` for all.

        Nothing is compiled again at other values, and what they decide is computed once for many spectra.
        """
        return self.forward.held(values)

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts of one theta, traceable by JAX.

        Transform and call it inside `double_precision()`.
        """
        return self.forward.expected_jax(theta)

    def with_effect(self, effect: Effect) -> XraySpectrum:
        """The same spectrum with one more effect."""
        return self._with(self.response, (*self.effects, effect))

    def effect_library(self, theta: ArrayLike) -> Mapping[str, LibraryEffect]:
        """The effects that may be missing, their amplitudes scaled for fitted theta ``(n, parameter)``."""
        return effect_library(self._assembly, self.response, theta)

    @cached_property
    def places(self) -> Mapping[str, tuple[str, ...]]:
        """Energies of the model's lines and edges that are free, each with the rest of its component."""
        return places(parse(self.model))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired or left out when the files were read, one line each."""
        return self.response.notes

    def not_in_library(self) -> Mapping[str, str]:
        """Effects that this response does not allow: by name, why and how to mend it."""
        return not_in_library(self.response)

    def xcm(self, values: Mapping[str, float], effects: tuple[Effect, ...]) -> str:
        """A fit as XSPEC reads it, ``@file.xcm``; see `xcm.saved`."""
        return saved(self.model, values, (*self.effects, *effects))

    def segments(self) -> tuple[Segment, ...]:
        """All channels, with their energies."""
        return (Segment(self.response.name, 0, len(self.channels), self.channels),)

    def with_exposure(self, seconds: float) -> XraySpectrum:
        """The same spectrum, observed for another time; nothing is compiled again.

        Raises
        ------
        InputError
            Unless the exposure is a positive finite number.
        """
        response = self.response.with_exposure(seconds)
        other = self._with(response, self.effects)
        other.__dict__["forward"] = self.forward.with_exposure(response.exposure)
        return other

    def _with(self, response: Response, effects: tuple[Effect, ...]) -> XraySpectrum:
        return XraySpectrum(
            self.model, response, self._plain_prior, effects=effects, integration=self.integration
        )

    def __getstate__(self) -> dict[str, Any]:
        # Compiled functions stay in their process; another one compiles its own.
        return {name: value for name, value in self.__dict__.items() if name != "forward"}

    def _tables(self) -> dict[str, str]:
        found = {leaf.component for leaf in leaves(self._assembly.tree) if is_table(leaf.component)}
        return {component: file_digest(table_file(component)) for component in sorted(found)}

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies this simulator: model, response by sha256, prior, effects."""
        names = {effect.name for effect in self.effects}
        return {
            "simulator": "xray",
            "model": self.model,
            "response": self.response.describe(),
            "prior": self.prior.describe(),
            "effects": [
                effect.describe() | ({} if effect.kind is None else {"kind": effect.kind.identity})
                for effect in self.effects
            ],
            **({} if "pileup" not in names else {"frame_time_s": self.response.frame_time}),
            **({"tables": tables} if (tables := self._tables()) else {}),
            # What was identified before there was a choice keeps its identity.
            **({} if self.integration == "jaxspec" else {"integration": self.integration}),
        }
