"""How many correlated draws are worth one: the integrated autocorrelation time of a Markov chain."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

# Trials per transform: bounds the memory of the padded spectra, and changes no result.
CHUNK = 256
# Sum correlations up to the first lag of this many autocorrelation times (Sokal 1997).
WINDOW = 5.0


def integrated_autocorrelation_time(draws: ArrayLike) -> NDArray[np.float64]:
    """tau = 1 + 2 sum of correlations, per trial and parameter, of draws ``(trial, draw, parameter)``.

    At least 1; 1 where the draws do not vary. Sokal's automatic window.

    >>> import numpy as np
    >>> white = np.random.default_rng(0).normal(size=(50, 500, 1))
    >>> bool(abs(integrated_autocorrelation_time(white).mean() - 1) < 0.1)
    True
    """
    chains = np.asarray(draws, dtype=float)
    parts = [_times(chains[start : start + CHUNK]) for start in range(0, len(chains), CHUNK)]
    return np.concatenate(parts) if parts else np.ones((0, chains.shape[2]))


def _times(chains: NDArray[np.float64]) -> NDArray[np.float64]:
    n = chains.shape[1]
    centred = chains - chains.mean(axis=1, keepdims=True)
    scale = np.abs(centred).max(axis=1, keepdims=True)
    centred = centred / np.where(scale > 0, scale, 1.0)
    length = fft.next_fast_len(2 * n, real=True)
    spectrum = np.abs(fft.rfft(centred, length, axis=1)) ** 2
    covariance = fft.irfft(spectrum, length, axis=1)[:, :n]
    variance = covariance[:, :1]
    correlation = covariance / np.where(variance > 0, variance, 1.0)
    time = 2 * np.cumsum(correlation, axis=1) - 1
    enough = np.arange(n)[None, :, None] >= WINDOW * time
    enough[:, -1] = True
    window = enough.argmax(axis=1)
    chosen = np.take_along_axis(time, window[:, None], axis=1)[:, 0]
    return np.where(variance[:, 0] > 0, np.maximum(chosen, 1.0), 1.0)
