"""Exact posteriors with data, and what may be done to their draws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases


def exact(seed: int, *, trials: int = 900, draws: int = 64, rho: float = 0.6) -> Cases:
    """Three parameters of a normal prior, three data, noise of a size that varies: all in closed form."""
    rng = np.random.default_rng(seed)
    prior = np.full((3, 3), rho) + (1 - rho) * np.eye(3)
    theta = rng.multivariate_normal(np.zeros(3), prior, size=trials, method="cholesky")
    noise = 0.4 * np.exp(0.3 * rng.normal(size=trials))
    x = theta + noise[:, None] * rng.normal(size=theta.shape)
    precision = np.linalg.inv(prior) + np.eye(3) / noise[:, None, None] ** 2
    covariance = np.linalg.inv(precision)
    mean = np.einsum("tij,tj->ti", covariance, x) / noise[:, None] ** 2
    root = np.linalg.cholesky(covariance)
    normal = rng.normal(size=(trials, draws, 3))
    found = mean[:, None] + np.einsum("tij,tdj->tdi", root, normal)
    data = np.concatenate([x, noise[:, None]], axis=1)
    return Cases(("a", "b", "c"), np.arange(trials), theta, found, data, ("x[0]", "x[1]", "x[2]", "noise"))


def two_modes(seed: int, *, trials: int = 900, draws: int = 64) -> Cases:
    """One parameter of which the data know the size and not the sign; and one that they know."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(trials, 2)) * [2.0, 1.0] + [0.0, 0.0]
    size = np.abs(theta[:, 0]) + 2
    theta[:, 0] = np.sign(theta[:, 0]) * size
    # Draws and truth are the same in law: the truth is any of them.
    centre = size + 0.1 * rng.normal(size=trials)
    values = centre[:, None] + 0.1 * rng.normal(size=(trials, draws + 1))
    values *= rng.choice([-1.0, 1.0], size=values.shape)
    other = theta[:, 1, None] + 0.3 * rng.normal(size=(trials, draws + 1))
    whole = np.stack([values, other], axis=2)
    data = np.stack([centre, theta[:, 1]], axis=1)
    return Cases(("a", "b"), np.arange(trials), whole[:, 0], whole[:, 1:], data, ("x[0]", "x[1]"))


def about_middle(cases: Cases, factor: float | Array) -> Array:
    """Draws stretched about their median."""
    middle = np.median(cases.draws, axis=1, keepdims=True)
    return np.asarray(middle + factor * (cases.draws - middle))


def width(cases: Cases) -> Array:
    """Standard deviation of the draws, ``(trial, 1, parameter)``."""
    return np.asarray(cases.draws.std(axis=1, keepdims=True))


Fault = Callable[[Cases, np.random.Generator], Array]


def stray(cases: Cases, rng: np.random.Generator) -> Array:
    """Six draws in a hundred 10 to 30 half-widths from the others."""
    sign = rng.choice([-1, 1], size=cases.draws.shape)
    far = cases.draws + sign * width(cases) * rng.uniform(10, 30, size=cases.draws.shape)
    return np.where(rng.random((*cases.draws.shape[:2], 1)) < 0.06, far, cases.draws)


def clipped(cases: Cases, rng: np.random.Generator) -> Array:
    """The outer 4% on either side drawn again from what is between."""
    low, high = np.quantile(cases.draws, [0.04, 0.96], axis=1)
    inside = (cases.draws >= low[:, None]) & (cases.draws <= high[:, None])
    found = np.array(cases.draws)
    for column in range(found.shape[2]):
        order = np.argsort(~inside[..., column], axis=1, kind="stable")
        number = inside[..., column].sum(axis=1, keepdims=True)
        pick = (rng.random(found.shape[:2]) * number).astype(int)
        taken = np.take_along_axis(order, pick, axis=1)
        again = np.take_along_axis(found[..., column], taken, axis=1)
        found[..., column] = np.where(inside[..., column], found[..., column], again)
    return found


def lopsided(cases: Cases, rng: np.random.Generator) -> Array:
    """What lies above the median farther out than it should, what lies below nearer."""
    del rng
    middle = np.median(cases.draws, axis=1, keepdims=True)
    away = cases.draws - middle
    return np.asarray(middle + away * np.where(away > 0, 1.35, 1 / 1.35))


def reshuffled(cases: Cases, rng: np.random.Generator) -> Array:
    """Each column in an order of its own: correlations are gone."""
    return np.take_along_axis(cases.draws, np.argsort(rng.random(cases.draws.shape), axis=1), axis=1)


def of_another_prior(cases: Cases, rng: np.random.Generator) -> Array:
    """One in eight of the draws, likelier the smaller the first two parameters are: a narrower prior."""
    log = -0.8 * (cases.draws[..., :2] ** 2).sum(axis=2)
    taken = np.argsort(-log - rng.gumbel(size=log.shape), axis=1)[:, : cases.draws.shape[1] // 8]
    return np.take_along_axis(cases.draws, taken[..., None], axis=1)


def somewhere(cases: Cases, rng: np.random.Generator) -> Array:
    """Too narrow where the first datum is large."""
    del rng
    assert cases.x is not None
    there = (cases.x[:, 0] > np.quantile(cases.x[:, 0], 0.7))[:, None, None]
    return np.where(there, about_middle(cases, 0.5), cases.draws)


def outside(cases: Cases, rng: np.random.Generator) -> Array:
    """One draw in twenty beyond all truths."""
    low, high = cases.theta.min(axis=0), cases.theta.max(axis=0)
    beyond = high + 0.3 * (high - low) * rng.random(cases.draws.shape)
    return np.where(rng.random((*cases.draws.shape[:2], 1)) < 0.05, beyond, cases.draws)


def alike(cases: Cases, rng: np.random.Generator) -> Array:
    """The prior's values of the second parameter, whatever the data."""
    found = np.array(cases.draws)
    found[..., 1] = rng.choice(cases.theta[:, 1], size=found.shape[:2])
    return found


def one_sign(cases: Cases, rng: np.random.Generator) -> Array:
    """Only the positive of two modes."""
    del rng
    return np.asarray(np.abs(cases.draws) * [1, 0] + cases.draws * [0, 1])


def lighter(cases: Cases, rng: np.random.Generator) -> Array:
    """The positive mode with three times its odds."""
    found = np.array(cases.draws)
    turned = (found[..., 0] < 0) & (rng.random(found.shape[:2]) < 0.5)
    found[..., 0] = np.where(turned, -found[..., 0], found[..., 0])
    return found


def repeated(cases: Cases, rng: np.random.Generator) -> Array:
    """A quarter of the draws, each four times, in any order."""
    few = np.repeat(cases.draws[:, : cases.draws.shape[1] // 4], 4, axis=1)
    order = np.argsort(rng.random(few.shape[:2]), axis=1)
    return np.take_along_axis(few, order[..., None], axis=1)


def chained(cases: Cases, rng: np.random.Generator) -> Array:
    """A stationary chain with the same marginals as far as means and widths go."""
    middle, size = cases.draws.mean(axis=1, keepdims=True), width(cases)
    found = rng.normal(size=cases.draws.shape)
    for step in range(1, found.shape[1]):
        found[:, step] = 0.9 * found[:, step - 1] + np.sqrt(1 - 0.81) * found[:, step]
    return np.asarray(middle + size * found)


def same_numbers(cases: Cases, rng: np.random.Generator) -> Array:
    """The same standard normal numbers in every trial."""
    middle, size = cases.draws.mean(axis=1, keepdims=True), width(cases)
    return np.asarray(middle + size * rng.normal(size=(1, *cases.draws.shape[1:])))


def noisier(cases: Cases, rng: np.random.Generator) -> Array:
    """Draws of the posteriors for 1.6 times the noise."""
    assert cases.x is not None
    prior = 0.6 * np.ones((3, 3)) + 0.4 * np.eye(3)
    weight = 1 / (1.6 * cases.x[:, 3]) ** 2
    covariance = np.linalg.inv(np.linalg.inv(prior) + weight[:, None, None] * np.eye(3))
    mean = np.einsum("tij,tj->ti", covariance, weight[:, None] * cases.x[:, :3])
    # Not by singular vectors, whose signs are another processor's.
    normal = rng.standard_normal(cases.draws.shape)
    return mean[:, None] + normal @ np.linalg.cholesky(covariance).swapaxes(1, 2)


def from_part_of_the_prior(cases: Cases, rng: np.random.Generator) -> Array:
    """None of the first parameter below -1.5, where one in fifteen truths is."""
    found = np.array(cases.draws)
    below = -1.5 + 0.1 * rng.exponential(size=found.shape[:2])
    found[..., 0] = np.where(found[..., 0] < -1.5, below, found[..., 0])
    return found


FAULTS: dict[str, tuple[str, Fault]] = {
    "shift": ("shift", lambda c, _: c.draws + 0.5 * width(c) * [0, 1, 0]),
    "narrow": ("scale", lambda c, _: about_middle(c, 0.7)),
    "one wide": ("scale", lambda c, _: about_middle(c, np.array([1.6, 1, 1]))),
    "lopsided": ("skew", lopsided),
    "stray": ("outliers", stray),
    "clipped": ("clipped_tails", clipped),
    "exchanged": ("columns", lambda c, _: c.draws[..., [1, 0, 2]]),
    "unit": ("unit", lambda c, _: c.draws * [1, 1000, 1]),
    "exponential": ("log", lambda c, _: np.where([True, False, False], np.exp(c.draws), c.draws)),
    "sign": ("sign", lambda c, _: c.draws * [1, 1, -1]),
    "ignored": ("ignored_parameter", alike),
    "uncorrelated": ("correlations", reshuffled),
    "another prior": ("other_prior", of_another_prior),
    "noisier": ("x_noise", noisier),
    "part of the prior": ("truncated_prior", from_part_of_the_prior),
    "somewhere": ("region", somewhere),
    "outside": ("leakage", outside),
    "repeated": ("few_distinct", repeated),
    "chain": ("autocorrelated", chained),
    "same numbers": ("fixed_seed", same_numbers),
}
