"""What else moves while a sine is measured: the free motion that set in with it, and noise.

Between the harmonics of a steady sine, which repeats itself, the spectrum of a record holds its transient and noise
alone. The spectrum of a transient is smooth: far from its own frequencies a polynomial of the frequency, near one of
them a polynomial over a straight line that is zero there, exact for a damped oscillation. Followed over the lines
beside the sine it tells what the transient adds to the sine, and what is left over tells the noise.

Sources: the local polynomial method, R. Pintelon and J. Schoukens, System Identification, 2nd ed. (2012), chapter 7;
local rational models, T. McKelvey and G. Guerin, Non-parametric frequency response estimation using a local rational
model, IFAC SYSID (2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_NEAR = 8  # lines looked at on each side of the sine
_FEWEST = 3
_DEGREE = 2
_APART = 1.0  # lines, from which a free motion is told from the sine itself
_ROUNDING = 1e-10  # of the output
_ROUNDS = 6  # of reweighting


@dataclass(frozen=True)
class FreeMotion:
    """What stands in the spectrum beside a sine; amplitudes as those of the output.

    Attributes:
        at_sine: what it adds to the output at the frequency of the sine.
        noise: variance of the output there, E|error|^2.
        doubt: part of `noise` by which `at_sine` is uncertain.
    """

    at_sine: complex
    noise: float
    doubt: float


def find_free_motion(u: Array, y: Array, periods: int, line: int) -> FreeMotion | None:
    """The free motion and the noise beside one sine.

    Args:
        u, y: (n,) input and output over whole periods, without drift.
        periods: in them.
        line: of the sine, cycles in a period.

    Returns:
        None with fewer than three lines on each side.
    """
    n, center = len(u), periods * line
    reach = min(_NEAR, center - 1, (n - 1) // 2 - center)
    if reach < _FEWEST:
        return None
    lines = slice(center - reach, center + reach + 1)
    spectra = [np.fft.rfft(x)[lines] * (2 / n) for x in (u, y)]
    x = np.arange(-reach, reach + 1)
    beside = x != 0
    x, (u0, y0) = x[beside] / reach, (s[reach] for s in spectra)
    us, ys = (s[beside] for s in spectra)
    best, at_sine = FreeMotion(0j, math.inf, 0.0), 0j
    for _ in range(2):  # the response that is to be taken off is known once the free motion is
        e = ys - (y0 - at_sine) / u0 * us
        floor = (_ROUNDING * abs(y0)) ** 2
        found = [f for f in (_nothing(e), _smooth(x, e), _resonant(x, e, reach)) if f is not None]
        best, _ = min(((m, _criterion(left, p, len(e), floor)) for m, left, p in found), key=lambda f: f[1])
        at_sine = best.at_sine
    return best


Found = tuple[FreeMotion, float, int]  # sum of squares that is left, complex unknowns


def _criterion(left: float, unknowns: int, points: int, floor: float) -> float:
    """Akaike's, corrected for few points."""
    k, n = 2 * unknowns + 1, 2 * points
    return n * math.log(max(left / points, floor) or 1e-300) + 2 * k + 2 * k * (k + 1) / (n - k - 1)


def _nothing(e: Complex) -> Found:
    left = float(np.sum(np.abs(e) ** 2))
    return FreeMotion(0j, left / len(e), 0.0), left, 0


def _smooth(x: Array, e: Complex) -> Found | None:
    if len(e) < 2 * (_DEGREE + 1):
        return None
    return _fitted(np.vander(x, _DEGREE + 1, increasing=True).astype(complex), e)


def _resonant(x: Array, e: Complex, reach: int) -> Found | None:
    """e (1 + a x) = polynomial, reweighted so that errors of e count."""
    powers = np.vander(x, _DEGREE + 1, increasing=True).astype(complex)
    if len(e) < 2 * (_DEGREE + 2):
        return None
    weight = np.ones(len(x))
    for _ in range(_ROUNDS):
        rows = np.column_stack([powers, -x * e])
        a = np.linalg.lstsq(rows * weight[:, None], e * weight, rcond=None)[0][-1]
        weight = 1 / np.maximum(np.abs(1 + a * x), 1e-6)
    if abs(a) * _APART > reach:  # its frequency, at x = -1 / a
        return None
    own = 1 + a * x
    b = np.linalg.lstsq(powers / own[:, None], e, rcond=None)[0]
    tangents = np.column_stack([powers, -x * (powers @ b / own)]) / own[:, None]
    rest, left, unknowns = _fitted(tangents, e - powers @ b / own)
    return replace(rest, at_sine=rest.at_sine + complex(b[0])), left, unknowns


def _fitted(rows: Complex, e: Complex) -> Found:
    """A linear fit whose first unknown is what it says at the sine, x = 0."""
    inverse = np.linalg.pinv(rows)
    b = inverse @ e
    left = float(np.sum(np.abs(e - rows @ b) ** 2))
    noise = left / (len(e) - rows.shape[1])
    doubt = noise * float(np.sum(np.abs(inverse[0]) ** 2))
    return FreeMotion(complex(b[0]), noise + doubt, doubt), left, rows.shape[1]
