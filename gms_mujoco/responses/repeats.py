"""What points of one frequency in a file are to each other: repeats, which are averaged, or levels of excitation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frf import Complex

Array = NDArray[np.float64]

_SAME = 1e-6  # of a frequency: another one
_APART = 1.05  # ratio of neighbouring excitations that belong to different levels
_WIDTH = 1.25  # of the excitations of one level, the most over the least
_POINTS = 3  # of a level on average, where not all of them have points at one frequency


def levels(frequency: Array, excitation: Array) -> list[NDArray[np.bool_]]:
    """Which points belong to each level of excitation, from small to large; one level where all are repeats.

    Args:
        frequency: (n,) [Hz], in any order.
        excitation: (n,) amplitude of the input at each.

    Raises:
        DataError: excitations at one frequency differ, and are no levels.
    """
    order = np.argsort(frequency, kind="stable")
    groups = np.split(order, _cuts(frequency[order]))
    widths = [float(excitation[g].max() / excitation[g].min()) for g in groups]
    widest = groups[int(np.argmax(widths))]
    ranked = np.sort(excitation)
    steps = np.flatnonzero(ranked[1:] > _APART * ranked[:-1])
    number = np.searchsorted(ranked[steps], excitation)
    count = len(steps) + 1
    found = [number == i for i in range(count)]
    if max(widths) < _APART or (count == 1 and max(widths) < _WIDTH):
        return [np.ones(len(frequency), bool)]
    beside = max(len(np.unique(number[g])) for g in groups)
    narrow = all(np.ptp(np.log(excitation[x])) < np.log(_WIDTH) for x in found)
    if narrow and (count == beside or _POINTS * count <= len(frequency)):
        return found
    if max(widths) < _WIDTH:
        return [np.ones(len(frequency), bool)]
    low, high = excitation[widest].min(), excitation[widest].max()
    raise DataError(f"at {frequency[widest[0]]:.4g} Hz stand excitations of {low:.3g} to {high:.3g}, and no levels "
                    "that are the same at all frequencies; number the responses from 1 in a column 'response', or give "
                    "each a file of its own")


def _cuts(frequency: Array) -> NDArray[np.int64]:
    """Where another frequency begins, of rising ones (n,)."""
    return np.flatnonzero(np.diff(frequency) > _SAME * frequency[:-1]) + 1


def average_repeats(frequency: Array, response: Complex) -> tuple[Array, Complex, Array | None, Array, int]:
    """Points of equal frequency as one each.

    Args:
        frequency: (n,) [Hz], in any order; equal within 1e-6 of themselves is equal.
        response: (n,).

    Returns:
        (m,) frequency [Hz], (m,) robust mean, (m,) its standard deviation or None where nothing is repeated, (m,)
        number of repeats, and how many points were left without weight.
    """
    order = np.argsort(frequency, kind="stable")
    f, g = frequency[order], response[order]
    cut = _cuts(f)
    groups = np.split(g, cut)
    where = np.array([x.mean() for x in np.split(f, cut)])
    means = [robust_mean(x) for x in groups]
    value = np.array([m[0] for m in means])
    repeats = np.array([len(x) for x in groups])
    several = repeats > 1
    if not several.any():
        return where, value, None, repeats, 0
    spread = np.array([m[1] for m in means])  # of one point
    # Two or three repeats tell little of their own scatter: it is at least the usual one.
    usual = float(np.median(spread[several] / np.abs(value[several])))
    weak = usual * np.abs(value)
    spread = np.where(repeats > 3, np.maximum(spread, 0.3 * weak), np.maximum(spread, weak))
    left = np.array([m[2] for m in means])
    return where, value, spread / np.sqrt(left), repeats, int(repeats.sum() - left.sum())


def robust_mean(x: Complex) -> tuple[complex, float, int]:
    """Mean of repeats (n,) with Tukey's biweight from their median; outliers have no weight.

    Returns:
        The mean, the standard deviation of one point about it, and the number of points with weight.
    """
    x = np.asarray(x, complex)
    if len(x) < 3:
        mean = complex(x.mean())
        return mean, float(np.sqrt(np.sum(np.abs(x - mean) ** 2) / max(len(x) - 1, 1))), len(x)
    mean = complex(np.median(x.real), np.median(x.imag))
    weight = np.ones(len(x))
    for _ in range(20):
        gap = np.abs(x - mean)
        scale = float(np.median(gap)) / 0.8326  # of a circular normal distribution
        if scale == 0:
            weight = (gap == 0).astype(float)
            break
        weight = np.clip(1 - (gap / (4 * scale)) ** 2, 0, None) ** 2
        mean = complex((weight @ x) / weight.sum())
    inside = weight > 0
    n = int(inside.sum())
    return mean, float(np.sqrt(np.sum(np.abs(x[inside] - mean) ** 2) / max(n - 1, 1))), n
