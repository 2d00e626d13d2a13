"""Masked autoregressive flows both ways, with their volumes; the inverse in one pass.

The inverse finds one parameter after the other. Asking the whole masked network again for each of them costs
as many evaluations as there are parameters, and the density one more; but a hidden unit whose inputs are all
known never changes again. So units are sorted by the last parameter that they read, and each is evaluated
once, as soon as it can be. What reads data alone is evaluated once per row, not per draw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.distributions import Transform
from zuko.flows import MaskedAutoregressiveTransform
from zuko.nn import MaskedLinear

from gaugeblock.estimators.npe.spline import Spline


def inverse(transforms: Iterable[nn.Module], noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
    """What lazy transforms take to `noise` ``(row, draw, parameter)``, given contexts ``(row, feature)``.

    Returns values of the noise's shape, and the log determinant of noise by values ``(row, draw)``. Masked
    autoregressive ones are inverted here, all others by their own inverse; without gradients.

    References
    ----------
    Papamakarios et al. (2017), arXiv:1705.07057, on the cost of sampling.
    """
    volume = noise.new_zeros(noise.shape[:2])
    with torch.no_grad():
        for transform in reversed(list(transforms)):
            if _is_plain(transform):
                values, own = _inverted(transform, noise, context)
            else:
                values, own = _solved(transform(context[:, None].expand(-1, noise.shape[1], -1)), noise)
            noise, volume = values, volume + _of_draws(own)
    return noise, volume


def forward(transforms: Iterable[nn.Module], values: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
    """Noise that lazy transforms take ``(row, draw, parameter)`` to, and the log determinant ``(row, draw)``.

    The inverse of `inverse`; gradients pass.
    """
    volume = values.new_zeros(values.shape[:2])
    for transform in transforms:
        if _is_plain(transform):
            made = transform.univariate(*_asked(transform, values, context))
        else:
            made = transform(context[:, None].expand(-1, values.shape[1], -1))
        values, own = made.call_and_ladj(values)
        volume = volume + _of_draws(own)
    return values, volume


def _of_draws(volume: Tensor) -> Tensor:
    """Log determinants ``(row, draw)`` of what may be those of each parameter."""
    return volume.sum(dim=-1) if volume.dim() == 3 else volume


def normal_log_density(noise: Tensor) -> Tensor:
    """Log density ``(...)`` of base noise ``(..., parameter)``."""
    return -0.5 * (noise.square() + math.log(2 * math.pi)).sum(dim=-1)


def _is_plain(transform: nn.Module) -> bool:
    """Whether each parameter has a transform of its own, by masked layers and plain functions between."""
    if not isinstance(transform, MaskedAutoregressiveTransform) or transform.order is None:
        return False
    # A class of transforms of numbers; flows by neural networks have a method here that mixes parameters.
    if not isinstance(getattr(transform.univariate, "func", transform.univariate), type):
        return False
    *inner, last = transform.hyper
    pairs = zip(inner[::2], inner[1::2], strict=False)
    return (
        len(inner) % 2 == 0
        and isinstance(last, MaskedLinear)
        and all(isinstance(one, MaskedLinear) and not list(other.parameters()) for one, other in pairs)
    )


def _inverted(transform: nn.Module, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
    rows, draws, size = noise.shape
    layers, functions = list(transform.hyper)[::2], list(transform.hyper)[1::2]
    order = transform.order
    places = torch.argsort(order, stable=True)
    steps = [torch.nonzero(order == step)[:, 0] for step in range(int(order.max()) + 1)]
    weights, biases, ready = _sorted(layers, order, places)
    # Of the first layer, what data alone say; of the last, the rows of each parameter.
    told = torch.addmm(biases[0], context, weights[0][:, size:].T)
    weights[0] = weights[0][:, :size]
    asked, offset = weights.pop().unflatten(0, (size, -1)), biases.pop().unflatten(0, (size, -1))
    hidden = [noise.new_empty(rows, draws, len(bias)) for bias in biases]
    known = noise.new_empty(rows, draws, size)  # in the order in which they are found
    values, volume = torch.empty_like(noise), torch.empty_like(noise)
    found = 0
    for step, mine in enumerate(steps):
        # Before anything is known, all draws of a row are alike.
        alike = slice(0, 1) if step == 0 else slice(None)
        for place, function in enumerate(functions):
            start, end = ready[place][step], ready[place][step + 1]
            if start == end:
                continue
            if place == 0:
                reached = told[:, None, start:end]
                if found:
                    reached = reached + known[..., :found] @ weights[0][start:end, :found].T
            else:
                below = ready[place - 1][step + 1]
                weight, bias = weights[place][start:end, :below], biases[place][start:end]
                reached = _layer(hidden[place - 1][:, alike, :below], weight, bias)
            hidden[place][..., start:end] = function(reached)
        last = ready[-1][step + 1]
        wanted = asked[mine][..., :last].flatten(end_dim=1)
        answer = _layer(hidden[-1][:, alike, :last], wanted, offset[mine].flatten())
        answer = answer.unflatten(-1, (len(mine), -1))
        made = transform.univariate(*_split(answer, transform.shapes))
        value, volume[..., mine] = _solved(made, noise[..., mine])
        known[..., found : found + len(mine)] = values[..., mine] = value
        found += len(mine)
    return values, volume


def _layer(below: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """A linear layer of some units ``(row, draw, unit)`` of an array, which are not copied for it."""
    return torch.addmm(bias, below.flatten(end_dim=1), weight.T).unflatten(0, below.shape[:2])


def _solved(made: Transform, noise: Tensor) -> tuple[Tensor, Tensor]:
    """What a transform takes to noise, and the log determinant of noise by it."""
    if isinstance(made, Spline):
        return made.solve(noise)
    value = made.inv(noise)
    return value, made.call_and_ladj(value)[1]


def _asked(transform: nn.Module, values: Tensor, context: Tensor) -> list[Tensor]:
    """Arguments of each parameter's own transform."""
    first, *others = transform.hyper
    size = values.shape[-1]
    weight = first.weight * first.mask
    told = torch.addmm(first.bias, context, weight[:, size:].T)
    reached = told[:, None] + values @ weight[:, :size].T
    for layer in others:
        reached = layer(reached)
    return _split(reached.unflatten(-1, (size, -1)), transform.shapes)


def _sorted(
    layers: list[MaskedLinear], order: Tensor, places: Tensor
) -> tuple[list[Tensor], list[Tensor], list[list[int]]]:
    """Masked weights and biases with hidden units in the order in which they can be evaluated.

    Also, of each hidden layer, how many units are ready before each step, from 0 on.
    """
    size, steps = len(order), int(order.max()) + 1
    weights, biases, ready = [], [], []
    reads = layers[0].mask[:, :size]
    level = torch.where(reads, order, -1).amax(dim=1)
    inputs = torch.cat((places, torch.arange(size, layers[0].mask.shape[1], device=order.device)))
    for layer, after in pairwise((*layers, None)):
        weight = (layer.weight * layer.mask)[:, inputs]
        if after is None:
            weights.append(weight)
            biases.append(layer.bias)
            break
        inputs = torch.argsort(level, stable=True)
        weights.append(weight[inputs])
        biases.append(layer.bias[inputs])
        ready.append([0, *(int((level < step).sum()) for step in range(steps))])
        level = torch.where(after.mask, level, -1).amax(dim=1)
    return weights, biases, ready


def _split(answer: Tensor, shapes: Iterable[tuple[int, ...]]) -> list[Tensor]:
    """Numbers of a univariate transform ``(..., total)`` as its arguments."""
    shapes = [tuple(shape) for shape in shapes]
    parts = answer.split([math.prod(shape) for shape in shapes], dim=-1)
    return [
        part.unflatten(-1, shape) if shape else part[..., 0]
        for part, shape in zip(parts, shapes, strict=True)
    ]
