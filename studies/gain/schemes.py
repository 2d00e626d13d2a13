"""The published study's three schemes on the study's own spectra: NPE checks, importance sampling, evidence.

The published medium flow's place is taken by the flow that is shipped; at the bright level, where none is
shipped, by exact posterior draws (importance sampling around fits) and by the fit in place of an embedding:
that can only help the schemes. Each sees as many clean as shifted spectra, labelled, which nobody who
measures has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.core.digest import digest
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import posterior_draws
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.protocol import poisson_log_likelihood
from gaugeblock.validate.detectors import auc
from gaugeblock.validate.detectors.embeddings import mahalanobis
from gaugeblock.validate.detectors.predictive import STATISTICS, predictive_p
from gaugeblock.validate.joint.psis import pareto_khat
from gaugeblock.validate.learned.two_sample import classifier_two_sample
from studies.gain.pools import GainPool

REPLICATES = 200
FLOW_DRAWS = 500

SCHEMES = {
    "predictive check": "posterior-predictive check (chi-squared and KS), AUC",
    "embedding distance": "distance in the embedding, AUC",
    "population C2ST": "classifier on embeddings of the two populations, AUC",
    "importance ESS": "effective sample size of importance weights, AUC",
    "importance k-hat": "Pareto k-hat of importance weights, AUC",
    "paired evidence": "difference of log evidences at the same theta, counts held equal, in nat",
}


@dataclass(frozen=True, eq=False)
class Read:
    """What the schemes read off spectra: posterior draws, embeddings, importance weights, log evidence."""

    theta: Array
    embedding: Array
    log_weight: Array
    log_evidence: Array


def read(counts: Array, pool: GainPool, rng: np.random.Generator) -> Read:
    """Read spectra ``(n, channel)`` such as a pool has."""
    return _by_flow(counts, pool, rng) if pool.flow else _by_fit(counts, pool, rng)


def _by_flow(counts: Array, pool: GainPool, rng: np.random.Generator) -> Read:
    from gaugeblock.estimators.npe import load

    flow = load(pool.flow)
    theta, log_q = flow.sample_and_log_prob(counts, FLOW_DRAWS, rng)
    model = pool.model
    likelihood = np.stack(
        [
            poisson_log_likelihood(model.expected(rows) * pool.scale, x)
            for rows, x in zip(theta, counts, strict=True)
        ]
    )
    log_weight = likelihood + model.prior.log_prob(theta) - log_q
    top = log_weight.max(axis=1)
    evidence = top + np.log(np.exp(log_weight - top[:, None]).mean(axis=1))
    return Read(theta[:, :REPLICATES], flow.embed(counts), log_weight, evidence)


def _by_fit(counts: Array, pool: GainPool, rng: np.random.Generator) -> Read:
    model = pool.model
    sources = Sources.of(model, counts, scale=pool.scale)
    fitted = fit(model, counts, scale=sources.scale)
    found = posterior_draws(model, counts, fitted, scale=sources.scale, draws=FLOW_DRAWS, rng=rng)
    place = (np.arange(REPLICATES) + rng.random((len(counts), 1))) / REPLICATES
    picked = np.stack(
        [np.searchsorted(np.cumsum(w)[:-1], u) for w, u in zip(found.weight, place, strict=True)]
    )
    factorials = poisson_log_likelihood(np.ones_like(counts), counts) + counts.shape[1]
    with np.errstate(divide="ignore"):
        log_weight = np.log(found.weight)
    embedding = np.column_stack([model.prior.to_unit_cube(fitted.theta), np.log(counts.sum(axis=1))])
    theta = np.take_along_axis(found.theta, picked[..., None], axis=1)
    return Read(theta, embedding, log_weight, found.log_evidence + factorials)


def per_spectrum(counts: Array, seen: Read, reference: Array, pool: GainPool, seed: int) -> dict[str, Array]:
    """Scores ``(n,)`` of each spectrum alone, large where suspicious; `reference` are clean embeddings."""
    rng = np.random.default_rng(seed)
    model = pool.model
    mean = np.stack([model.expected(rows) for rows in seen.theta]) * pool.scale
    replicated = rng.poisson(mean).astype(float)
    p = [predictive_p(counts, replicated, statistic) for statistic in STATISTICS.values()]
    weight = np.exp(seen.log_weight - seen.log_weight.max(axis=1, keepdims=True))
    effective = weight.sum(axis=1) ** 2 / (weight**2).sum(axis=1)
    return {
        "predictive check": 1.0 - np.minimum(*p),
        "embedding distance": mahalanobis(seen.embedding, reference, rng=rng).observed,
        "importance ESS": -effective,
        "importance k-hat": pareto_khat(seen.log_weight),
    }


def compare(clean: GainPool, shifted: GainPool, *, number: int, pairs: int, seed: int) -> xr.Dataset:
    """All schemes on the first `number` spectra of two pools: value, and where the null's 95% lie."""
    key = [int(digest(["schemes", clean.name, shifted.name])[:8], 16)]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    sets = [pool.draw(0, seed) for pool in (clean, shifted)]
    low, high = (counts[:number] for _, counts in sets)
    reference = read(clean.draw(1, seed)[1][:number], clean, rng).embedding
    seen = [read(counts, clean, rng) for counts in (low, high)]
    scores = [
        per_spectrum(counts, found, reference, clean, int(rng.integers(2**31)))
        for counts, found in zip((low, high), seen, strict=True)
    ]
    width = 1.96 * np.sqrt((2 * number + 1) / (12.0 * number * number))
    rows: dict[str, tuple[float, float, float]] = {
        name: (float(auc(scores[0][name], scores[1][name])), 0.5 - width, 0.5 + width) for name in scores[0]
    }
    told = classifier_two_sample(seen[0].embedding, seen[1].embedding, rng=rng)
    wide = 1.96 * np.sqrt((told.scored + 1) / (12.0 * (told.scored / 2) ** 2))
    rows["population C2ST"] = (told.auc, 0.5 - wide, 0.5 + wide)
    partner = clean.again(sets[1][0][:pairs], seed, rng)
    rows["paired evidence"] = _paired(partner, high[:pairs], seen[1], read(partner, clean, rng))
    order = list(SCHEMES)
    return xr.Dataset(
        {
            name: ("scheme", np.array([rows[scheme][k] for scheme in order]))
            for k, name in enumerate(("value", "null_low", "null_high"))
        },
        coords={"scheme": order},
    )


def _paired(partner: Array, counts: Array, seen: Read, clean: Read) -> tuple[float, float, float]:
    """Mean difference of log evidences at equal counts, and 95% of it if there were none.

    Shifted spectra and clean ones, `partner`, of the same theta; the difference's regression on the log ratio
    of their total counts is taken off, as the published study does.
    """
    difference = seen.log_evidence[: len(counts)] - clean.log_evidence
    ratio = np.log(counts.sum(axis=1) / partner.sum(axis=1))
    design = np.column_stack([np.ones(len(counts)), ratio])
    found = np.linalg.lstsq(design, difference, rcond=None)[0]
    left = difference - design @ found
    spread = float(left.std(ddof=2) * np.sqrt(np.linalg.inv(design.T @ design)[0, 0]))
    return float(found[0]), -1.96 * spread, 1.96 * spread
