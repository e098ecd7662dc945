"""Resonance, antiresonance and mass line of a frequency response, and the two naive readings of a Dahl resonance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frf import FRF, with_amplitude

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MASS_LINE = 4.0  # times the resonance: where the mass line begins
_DEEP = 2.0  # times its magnitude, that a response must reach on both sides of an antiresonance
COHERENT = 0.5  # coherence below which a point may be noise, or friction that has no amplitude of its own there
_SURE = 4.0  # standard deviations, by which it must


@dataclass(frozen=True)
class Resonance:
    """The Dahl resonance at one amplitude: where position lags torque by a quarter of a turn.

    Attributes:
        amplitude: of the position there [rad].
        frequency: [Hz].
        dissipation: torque in quadrature per position, J w^2 times the loss factor [N m/rad].
        name: of the response it was read from.
    """

    amplitude: float
    frequency: float
    dissipation: float
    name: str = ""

    def stiffness(self, inertia: float) -> float:
        """J w^2: the in-phase stiffness of friction at this amplitude [N m/rad]."""
        return inertia * (2 * math.pi * self.frequency) ** 2

    def loss(self, inertia: float) -> float:
        """Loss factor: twice the damping ratio of a linear axis [1]."""
        return self.dissipation / self.stiffness(inertia)


def find_resonance(frf: FRF) -> Resonance | None:
    """The resonance of a response, None where the phase does not pass through -90 degrees inside the band.

    Of several crossings (noise, or a harmonic far below that meets the resonance) the one counts that best parts the
    points into a stiffness below and a mass above. Real and imaginary part of 1 / H are followed by straight lines in
    w^2 over the four nearest points.

    Raises:
        DataError: the response is not from torque, or its amplitude is unknown.
    """
    f = with_amplitude(frf)
    inverse = 1 / f.response
    crossings = np.flatnonzero((inverse.real[:-1] > 0) & (inverse.real[1:] <= 0))
    if not len(crossings):
        return None
    sides = np.cumsum(np.sign(inverse.real))
    at = int(crossings[np.argmax(2 * sides[crossings] - sides[-1])])
    near = slice(max(at - 1, 0), at + 3)
    square = f.omega[near] ** 2
    slope, level = np.polyfit(square, inverse.real[near], 1)
    root = -level / slope if slope < 0 else math.nan
    if not square[0] <= root <= square[-1]:  # too rough for a line through four points: take the two about it
        a, b = inverse.real[at], inverse.real[at + 1]
        root = float(f.omega[at] ** 2 + a / (a - b) * (f.omega[at + 1] ** 2 - f.omega[at] ** 2))
    assert f.amplitude is not None
    line = np.polyfit(square, inverse.imag[near], 1)
    size = math.exp(float(np.interp(root, square, np.log(f.amplitude[near]))))
    return Resonance(size, math.sqrt(root) / (2 * math.pi), max(float(np.polyval(line, root)), 0.0), frf.name)


def mass_line(frfs: Sequence[FRF]) -> tuple[float, float]:
    """Inertia from the -40 dB/decade line: the slope of Re 1 / H against w^2 far above the resonance.

    Each response has a stiffness of its own, which the slope does not see where the position amplitude is held; all
    share the inertia. At held torque the stiffness grows along the line and `identify_dahl` does better.

    Returns:
        Inertia and its standard deviation [kg m^2].

    Raises:
        DataError: fewer than three points of any response lie at four times its resonance or above.
    """
    xs, ys = [], []
    for frf in frfs:
        f = with_amplitude(frf)
        found = find_resonance(f)
        if found is None:
            continue
        high = f.frequency >= _MASS_LINE * found.frequency
        if high.sum() >= 3:
            x, y = f.omega[high] ** 2, (1 / f.response[high]).real
            weight = 1 / x**2  # errors of a response are relative
            xs.append((x - np.average(x, weights=weight)) * np.sqrt(weight))
            ys.append((y - np.average(y, weights=weight)) * np.sqrt(weight))
    if not xs:
        raise DataError(
            f"no mass line: at least three points above {_MASS_LINE:g} times the resonance are needed; "
            "measure to higher frequencies, or give the inertia"
        )
    x, y = np.concatenate(xs), np.concatenate(ys)
    inertia = -float(x @ y) / float(x @ x)
    if inertia <= 0:
        raise DataError("the response does not fall along a mass line; is it from torque to position?")
    free = max(len(x) - len(xs) - 1, 1)
    return inertia, math.sqrt(float(np.sum((y + inertia * x) ** 2)) / free / float(x @ x))


def find_antiresonance(
    frf: FRF, low: float = 0.0, high: float = math.inf, draws: int = 400, seed: int = 0
) -> tuple[float, float, float]:
    """Where the magnitude has its deepest dip, with a 95 % interval.

    The numerator is followed by a complex quadratic in w^2 through the eight points about the least one, with weights
    from sigma. The interval comes from the scatter of the fit, sigma or the misfit whichever is larger, by redrawing
    the points; it is at least as wide as a tenth of the distance between points, which the shape of the curve may hide.

    Args:
        frf: with at least eight points from `low` to `high` [Hz].
        draws, seed: of the interval.

    Returns:
        Frequency, and the ends of its interval [Hz].

    Raises:
        DataError: too few points, or the magnitude has no dip inside the band.
    """
    part = frf.band(low, high) if np.any((frf.frequency >= low) & (frf.frequency <= high)) else None
    if part is None or len(part) < 8:
        raise DataError(f"{frf.name}: fewer than 8 points from {low:g} to {high:g} Hz")
    size = np.abs(part.response)
    at = int(size.argmin())
    if at in (0, len(part) - 1):
        raise DataError(f"{frf.name}: no antiresonance from {low:g} to {high:g} Hz; the magnitude has no dip there")
    first = min(max(at - 4, 0), len(part) - 8)
    near = slice(first, first + 8)
    f, g = part.frequency[near], part.response[near]
    x = (f / part.frequency[at]) ** 2 - 1
    weight = 1 / np.maximum(np.full(8, 0.02 * size[near].max()) if part.sigma is None else part.sigma[near], 1e-300)
    powers = np.vander(x, 3) * weight[:, None]
    inverse = np.linalg.pinv(powers)
    fine = np.linspace(x[0], x[-1], 2001)

    def dip(values: Complex) -> float:
        least = int(np.abs(np.polyval(inverse @ (values * weight), fine)).argmin())
        return float(part.frequency[at] * math.sqrt(1 + fine[least]))

    left = np.abs(g * weight - powers @ (inverse @ (g * weight)))
    scatter = math.sqrt(max(float(np.sum(left**2)) / 5, 0.0 if part.sigma is None else 1.0)) / weight
    rng = np.random.default_rng(seed)
    noise = (rng.standard_normal((draws, 8)) + 1j * rng.standard_normal((draws, 8))) / math.sqrt(2)
    center = dip(g)
    margin = 0.05 * float(part.frequency[at + 1] - part.frequency[at - 1]) / 2
    ends = np.percentile([dip(g + scatter * e) for e in noise], (2.5, 97.5))
    return center, float(min(ends[0], center) - margin), float(max(ends[1], center) + margin)


def antiresonances(frf: FRF) -> list[tuple[float, float, float]]:
    """Every antiresonance that stands out of the response, with its 95 % interval (`find_antiresonance`).

    On both sides of one the magnitude reaches at least twice what it is there, by more than the noise, before it falls
    below. Medians of three points must see that, so that one outlier makes no dip; a dip with fewer than eight points
    between its shoulders is not read. Points without coherence are left out: what is seen by them alone is none.

    Returns:
        Frequency, and the ends of its interval [Hz], from low to high.
    """
    if frf.coherence is not None and np.any(low := frf.coherence <= COHERENT):
        if low.all():
            return []
        frf = frf.where(~low)
    size = np.abs(frf.response)
    sigma = np.zeros(len(frf)) if frf.sigma is None else frf.sigma
    sure = size - _SURE * sigma  # at least so large
    sure[1:-1] = np.median([sure[:-2], sure[1:-1], sure[2:]], axis=0)
    found: list[tuple[float, float, float]] = []
    inner = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    for i in inner:
        lower = np.flatnonzero(size < size[i])
        first = int(lower[lower < i].max(initial=-1)) + 1
        last = int(lower[lower > i].min(initial=len(frf)))
        shoulders = np.array([first + sure[first:i].argmax(), i + 1 + sure[i + 1 : last].argmax()])
        if sure[shoulders].min() > _DEEP * float(np.median(size[i - 1 : i + 2])):
            low, high = frf.frequency[shoulders]
            try:
                found.append(find_antiresonance(frf, float(low), float(high)))
            except DataError:
                continue
    return found


def secant_curve(resonances: Sequence[Resonance], inertia: float, distance: Array) -> Array:
    """(n,) virgin curve [N m] from J w^2 read as its secant at each amplitude; for comparison."""
    x, k = _readings(resonances, inertia)
    return np.asarray(np.interp(distance, np.append(0, x), np.append(0, k * x)))


def slope_curve(resonances: Sequence[Resonance], inertia: float, distance: Array) -> Array:
    """(n,) virgin curve [N m] from J w^2 read as its slope at each amplitude; for comparison."""
    x, k = _readings(resonances, inertia)
    x = np.append(0, x)
    return np.asarray(np.interp(distance, x, np.append(0, np.cumsum(k * np.diff(x)))))


def _readings(resonances: Sequence[Resonance], inertia: float) -> tuple[Array, Array]:
    points = sorted(resonances, key=lambda r: r.amplitude)
    return np.array([r.amplitude for r in points]), np.array([r.stiffness(inertia) for r in points])
