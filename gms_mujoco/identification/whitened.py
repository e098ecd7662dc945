"""The unknowns of a fit in coordinates that the data tell independently of each other, and equally well.

Where friction slips, a residual has steps: an element just slips at a reversal, or just does not. A derivative at a
point sees none of them or takes one for a slope. What a fit may conclude rests on how residuals change over as much as
the data leave open: a standard deviation either way, along directions that stay among the likely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ..threads import each
from .misfit import Misfit
from .tall import gram, squared, times

Array = NDArray[np.float64]

ANYWHERE = 1e3  # times its reach: the deviation of an unknown that the data do not see, and the most of any
_LEAST = 0.1  # of a deviation: where bounds leave less to look at, the derivative at the point counts


@dataclass(frozen=True)
class Whitened:
    """Directions from a vector of least squares, in which unknowns scatter independently and by 1.

    Attributes:
        residual: (m,) at the vector [N m].
        prior: (size,) precision of each unknown before the data, for a residual of this size.
        root: (size, size) a direction in each column, for white noise of 1 N m.
        slopes: (m, size) change of the residual along each.
        jacobian: (m, size) derivative of the residual by each unknown.
    """

    residual: Array
    prior: Array
    root: Array
    slopes: Array
    jacobian: Array

    @property
    def normal(self) -> Array:
        """(size, size) of the normal equations along the directions; the identity where nothing bends."""
        return gram(self.slopes, self.slopes) + self.root.T @ (self.prior[:, None] * self.root)


def whitened(misfit: Misfit, x: Array) -> Whitened:
    """The unknowns around a vector of least squares.

    States before a record follow the parameters as they fit best; alone they are seen by their derivatives. Where
    nothing jumps, derivatives over steps of each unknown alone tell the same.
    """
    jumps = any(o.jumps for o in misfit.observations)
    residual, jacobian = misfit.residual(x), misfit.jacobian(x)
    variance = squared(residual) / len(residual)
    # Without the little that is known of every unknown, those that the data hardly see would be known to no digit, and
    # what they are weighed against with them.
    reach = misfit.reach(x)
    little = np.where(reach > 0, (ANYWHERE * np.where(reach > 0, reach, 1.0)) ** -2, 0.0)
    prior = np.where(misfit.prior == 0, little, misfit.prior) * variance
    root = root_of_inverse(gram(jacobian, jacobian) + np.diag(prior))
    if not jumps:
        deviation = np.sqrt(np.sum(root**2, 1) * variance)
        jacobian = misfit.with_steps(x, deviation).jacobian(x)
        root = root_of_inverse(gram(jacobian, jacobian) + np.diag(prior))
    common = misfit.n_common
    if common < misfit.size:
        root = root @ scipy.linalg.qr(root[:common].T)[0]
    slopes = times(jacobian, root)
    if jumps:
        lower, upper = misfit.bounds
        room = np.minimum(np.minimum(x - lower, upper - x), misfit.reach(x))

        def fill(j: int) -> None:
            step = variance**0.5 * root[:, j]
            moved = step != 0
            part = float(np.min(room[moved] / np.abs(step[moved]), initial=1.0))
            if part > _LEAST:
                # As far as there is room, but for what rounding adds.
                ahead, behind = (np.clip(x + way * part * step, lower, upper) for way in (1, -1))
                slopes[:, j] = (misfit.residual(ahead) - misfit.residual(behind)) / (2 * part * variance**0.5)

        each(fill, range(common))
    return Whitened(residual, prior, root, slopes, jacobian)


def root_of_inverse(a: Array) -> Array:
    """root with root @ root.T the inverse of a symmetric matrix, scaled; directions that the data does not see get no
    spurious certainty."""
    scale = np.sqrt(np.maximum(np.diag(a), 1e-24 * max(np.diag(a).max(initial=0.0), 1e-200)))
    # Not by divide and conquer, as NumPy does it: that fails on some matrices of less than full rank.
    value, vector = scipy.linalg.eigh(a / np.outer(scale, scale))
    return np.asarray(vector / np.sqrt(np.maximum(value, 1e-14)) / scale[:, None])
