"""Variances of several noises of known shape that add up to what was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_UPDATES = 300


def likeliest(shapes: Array, square: Array, begin: Array, long_tails: bool = False) -> Array:
    """(k,) variances of which (n,) squares are most likely, their means being `shapes` @ variances.

    It is found by multiplicative updates, which never overshoot (Fevotte and Idier, Algorithms for Nonnegative Matrix
    Factorization with the beta-Divergence, Neural Computation 23, 2011): weights taken from the last solution swing
    between one noise and the other.

    Args:
        shapes: (n, k) what a unit of each variance adds.
        square: (n,) squares of complex normal values, or densities, exponentially distributed: Whittle's likelihood.
        begin: (k,) variances to begin with.
        long_tails: the values are of a complex t distribution of two degrees of freedom instead, p ~ 1 / V
            (1 + |value|^2 / V)^-2, with V in the place of the variance: one that is far off counts for little.
    """
    variance = begin
    for _ in range(_UPDATES):
        power = shapes @ variance
        pull = 2 * square / (power * (power + square)) if long_tails else square / power**2
        variance = variance * np.sqrt(shapes.T @ pull / (shapes.T @ (1 / power)))
    return variance
