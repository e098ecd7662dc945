"""How sure a fit is: the covariance of its unknowns where residuals are correlated and the model is not perfect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .frf_observation import Seen
from .misfit import Misfit
from .tall import gram

Array = NDArray[np.float64]


def covariance(misfit: Misfit, x: Array, block: float = 0.25) -> Array:
    """Covariance of the vector that stays right when residuals are correlated and the model is not perfect.

    The sandwich estimate (Huber 1967; White 1980) with residuals summed over blocks of time.

    Args:
        block: length of a block [s].
    """
    residual, jacobian = misfit.residual(x), misfit.jacobian(x)
    scores = block_sums(misfit.observations, jacobian * residual[:, None], block)
    bread = _pseudo_inverse(gram(jacobian, jacobian))
    influence = scores @ bread  # its square is symmetric and never negative, however large what the data do not see
    return np.asarray(influence.T @ influence * len(scores) / max(len(scores) - misfit.coordinates.size, 1))


def block_sums(observations: Sequence[Seen], rows: Array, block: float) -> Array:
    """(blocks, ...) sums of consecutive rows (m, ...), over blocks of time that end with their record [s], or of
    neighbouring points of a frequency response."""
    edges, start = [], 0
    for o in observations:
        length = o.rows_per_block(block)
        count = max(len(o.index) // length, 1)
        edges.append(start + length * np.arange(count))
        start += len(o.index)
    return np.add.reduceat(rows, np.concatenate(edges), axis=0)


def _pseudo_inverse(a: Array) -> Array:
    """Inverse of a symmetric matrix, scaled; directions that the data does not see get no spurious certainty."""
    scale = np.sqrt(np.maximum(np.diag(a), 1e-24 * max(np.diag(a).max(initial=0.0), 1e-200)))
    value, vector = np.linalg.eigh(a / np.outer(scale, scale))
    inverse = vector @ np.diag(1 / np.maximum(value, 1e-14)) @ vector.T
    return inverse / np.outer(scale, scale)
