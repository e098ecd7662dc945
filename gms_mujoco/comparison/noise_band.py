"""The band that sensor noise fills about the mean of a residual.

A band-limited residual is correlated from sample to sample, and sensor noise is not the same everywhere (an encoder
count weighs more where friction is stiff). So the band of a mean over samples i is not sigma / sqrt(n): it comes from
the floor, the residual that sensors alone leave, by its autocorrelation rho and its mean square s^2 in that bin,
var = s^2 / n^2 sum_ij rho(i - j).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

CONFIDENCE = 0.99  # of every band
Z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
_LAGS = 24  # of the floor's autocorrelation: beyond, band-limited noise has forgotten
_PRIOR = 30  # samples' worth of belief that a bin's noise is that of all


@dataclass(frozen=True)
class NoiseBand:
    """What the floors of records say of noise.

    Attributes:
        sigma: its rms.
        rho: (lags + 1,) autocorrelation, tapered to nothing.
    """

    sigma: float
    rho: Array

    @classmethod
    def of(cls, floors: Sequence[Array]) -> NoiseBand:
        lags = np.arange(min(_LAGS, *(len(f) // 4 for f in floors)) + 1)
        found = np.sum([products(f, f, lags) for f in floors], axis=0)
        rho = found / max(float(found[0]), 1e-300)
        sigma = math.sqrt(float(found[0]) / sum(map(len, floors)))
        return cls(sigma, rho * scipy.signal.windows.parzen(2 * len(lags) - 1)[len(lags) - 1 :])

    def means(
        self, groups: Sequence[Index], values: Sequence[Array], floors: Sequence[Array], n: int
    ) -> tuple[Array, Array, Array]:
        """(n,) mean of the values in each group, half width of its band under noise, and number of samples."""
        count, total, square, pairs = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        for g, v, e in zip(groups, values, floors, strict=True):
            inside = g >= 0
            count += np.bincount(g[inside], minlength=n)
            total += np.bincount(g[inside], v[inside], n)
            square += np.bincount(g[inside], e[inside] ** 2, n)
            for lag in range(1, len(self.rho)):
                both = (g[lag:] == g[:-lag]) & (g[lag:] >= 0)
                pairs += 2 * self.rho[lag] * np.bincount(g[lag:][both], minlength=n)
        some = np.maximum(count, 1)
        local = (square + _PRIOR * self.sigma**2) / (count + _PRIOR)
        variance = local / some * np.maximum(1 + pairs / some, 0.1)
        return total / some, Z * np.sqrt(variance), count

    def covariance(self, weights: Array) -> Array:
        """(p, p) covariance of weighted sums of noise, weights (n, p)."""
        spread = self.rho[0] * weights
        for lag in range(1, len(self.rho)):
            spread[lag:] += self.rho[lag] * weights[:-lag]
            spread[:-lag] += self.rho[lag] * weights[lag:]
        return self.sigma**2 * (weights.T @ spread)


def group_means(group: Index, x: Array, n: int) -> Array:
    inside = group >= 0
    count = np.bincount(group[inside], minlength=n)
    return np.where(count > 0, np.bincount(group[inside], x[inside], n) / np.maximum(count, 1), np.nan)


def products(a: Array, b: Array, lags: Index) -> Array:
    """(lags,) sum of a[t] b[t - lag]."""
    n = len(a)
    return np.array([float(a[max(k, 0) : n + min(k, 0)] @ b[max(-k, 0) : n - max(k, 0)]) for k in lags.tolist()])


def bartlett(rho: Array, lags: Index) -> Array:
    """(lags,) n times the variance of an autocorrelation estimated from n samples (Bartlett 1946)."""
    m = len(rho)
    width = 2 * m + int(np.max(np.abs(lags)))
    full = np.zeros(2 * width + 1)
    full[width - m + 1 : width + m] = np.concatenate([rho[:0:-1], rho])
    out = []
    for k in lags.tolist():
        ahead, behind = np.roll(full, -k), np.roll(full, k)
        at = full[width + k]
        out.append(np.sum(full**2 + ahead * behind - 4 * at * full * behind + 2 * at**2 * full**2))
    return np.maximum(np.array(out), 0.0)
