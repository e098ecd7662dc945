"""How sure a fit is: intervals that hold where residuals are correlated and the model is not perfect.

The sandwich estimate (Huber 1967; White 1980) sums residuals over blocks. From few blocks it comes out too small, for a
fit bends towards those that weigh most, and it is itself uncertain. Both are put right by the leverage of the blocks,
the latter as degrees of freedom of Student's t (Bell and McCaffrey, Survey Methodology 28, 2002; Pustejovsky and
Tipton, J. Business and Economic Statistics 36, 2018): by its square root where residuals are noise (CR2, unbiased if
blocks are independent), in full where they stay alike for long (CR3, the jackknife, on the safe side).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from .frf_observation import Seen
from .inverse import Observation
from .misfit import ROUNDING, Misfit
from .tall import gram, squared, times
from .whitened import ANYWHERE, Whitened, root_of_inverse, whitened

Array = NDArray[np.float64]

_BLOCK = 0.5  # s, the shortest
_CORRELATED = 40.0  # correlation times of the residual that a block lasts at least
_LAGS = 8  # a part of the record, over which a correlation is looked at: further it is noise
_FEWEST_BLOCKS = 6  # of all records together, if they are long enough
_LEVERAGE = 0.95  # that a block has at most: one that alone decides leaves no residual to judge it by


def covariance(misfit: Misfit, x: Array, around: Whitened | None = None) -> tuple[Array, Array]:
    """Covariance (size, size) of the vector of least squares, and the standard deviations (size,) in half an interval.

    Those are Student's t for 95 %, more than 1.96, for a variance is known from few blocks; infinite for what the data
    do not see, as a Stribeck velocity where both levels are the same.

    Args:
        misfit, x: the problem and its solution.
        around: the unknowns about there; None: looked at now.
    """
    around = around or whitened(misfit, x)
    residual, turn = around.residual, root_of_inverse(around.normal)
    slopes, root = times(around.slopes, turn), around.root @ turn
    scores, kept, kept_twice = [], [], []
    for begin, end, power in blocks(misfit.observations, np.split(residual, misfit.splits)):
        own = slopes[begin:end]
        leverage, axes = scipy.linalg.eigh(gram(own, own))
        leverage = np.clip(leverage, 0, _LEVERAGE)
        more = (1 - leverage) ** -power
        scores.append(axes @ (more * (axes.T @ gram(own, residual[begin:end]))))
        kept.append((axes * (leverage * more)) @ axes.T)
        kept_twice.append((axes * (leverage * more**2)) @ axes.T)
    freedom = _freedom(root, np.array(kept), np.array(kept_twice))
    little = np.where(misfit.prior == 0, around.prior, 0.0)  # what is known without the data is as uncertain as it says
    before = root.T * np.sqrt(little * squared(residual) / len(residual))
    spread = root @ np.hstack([np.array(scores).T, before])
    scatter = np.asarray(spread @ spread.T)
    deviations = np.asarray(scipy.stats.t.ppf(0.975, np.maximum(freedom, 1.0)))
    reach, seen = misfit.reach(x), np.sum(around.jacobian**2, 0)
    unseen = (misfit.prior == 0) & (seen * reach**2 <= ROUNDING**2 * squared(residual))
    scatter[unseen] = scatter[:, unseen] = 0.0
    scatter[unseen, unseen] = (ANYWHERE * reach[unseen]) ** 2
    return scatter, np.where(unseen, np.inf, deviations)


def _freedom(root: Array, kept: Array, kept_twice: Array) -> Array:
    """(size,) Satterthwaite's degrees of freedom, for residuals that would be independent.

    Args:
        root: (size, size) square root of the inverse of the normal matrix.
        kept, kept_twice: (blocks, size, size) normal matrix of each block, corrected for its leverage once and twice.
    """
    out = np.empty(len(root))
    for i, c in enumerate(root):
        own = np.einsum("j,gjk,k->g", c, kept_twice, c)
        shared = kept @ c
        trace = own.sum() - float(np.sum(shared**2))
        square = np.sum(own**2) - 2 * float(own @ np.sum(shared**2, 1)) + float(np.sum((shared.T @ shared) ** 2))
        out[i] = trace**2 / square if square > 0 else 1.0
    return out


def blocks(observations: Sequence[Seen], residuals: Sequence[Array]) -> Iterator[tuple[int, int, float]]:
    """First row, end, and power of the leverage of blocks that are hardly correlated with each other.

    Noise is forgotten within a sample or two, what a model lacks stays for as long as the motion does: the residual
    of each record says how long its blocks have to be.
    """
    records = max(sum(isinstance(o, Observation) for o in observations), 1)
    start = 0
    for o, r in zip(observations, residuals, strict=True):
        length, power = o.rows_per_block(_BLOCK), 0.5
        if isinstance(o, Observation):
            alike = round(_CORRELATED * correlation(r))
            if alike > length:
                length, power = max(min(alike, len(r) // math.ceil(_FEWEST_BLOCKS / records)), length), 1.0
        edges = np.linspace(start, start + len(r), max(len(r) // length, 1) + 1).astype(int)
        yield from ((int(a), int(b), power) for a, b in pairwise(edges))
        start += len(r)


def correlation(residual: Array) -> float:
    """Correlation time of a series in samples: the sum of its squared autocorrelations."""
    n = len(residual)
    power = np.abs(np.fft.rfft(residual, 2 * n)) ** 2
    product = np.fft.irfft(power)[: max(n // _LAGS, 1)]
    return float(1 + 2 * np.sum((product[1:] / product[0]) ** 2)) if product[0] > 0 else 1.0


def block_starts(observations: Sequence[Seen], block: float) -> NDArray[np.intp]:
    """(blocks,) first row of each block of time, which ends with its record [s], or of neighbouring points of a
    frequency response."""
    starts, first = [], 0
    for o in observations:
        length = o.rows_per_block(block)
        count = max(len(o.index) // length, 1)
        starts.append(first + length * np.arange(count))
        first += len(o.index)
    return np.concatenate(starts)


def block_sums(observations: Sequence[Seen], rows: Array, block: float) -> Array:
    """(blocks, ...) sums of the rows (m, ...) of each block, see `block_starts`."""
    return np.add.reduceat(rows, block_starts(observations, block), axis=0)
