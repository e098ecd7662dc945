"""Friction from the Dahl resonance: frequency responses at several amplitudes become a Maxwell-slip set.

At small motion friction is a spring that resonates with the inertia; it softens as the amplitude A grows and its
elements begin to slip. With the describing function of a Maxwell-slip set of stiffnesses k_i and break-away distances
x_i, an axis answers a torque of angular frequency w with the position

    1 / H(w, A) = sum k_i (phi(x_i / A) + i psi(x_i / A)) + i c w - J w^2,

    phi(r) = (theta - sin(2 theta) / 2) / pi, cos(theta) = 1 - 2 r,   psi(r) = (4 / pi) r (1 - r)   for r < 1,
    phi = 1, psi = 0 for r >= 1.

H relates the fundamentals. Under a sinusoidal torque the motion has harmonics too, which change it by a tenth or more
at and below the resonance; `identify_dahl` computes that change by harmonic balance with the friction found so far,
takes it off the data and fits again. The formula is linear in k_i on a preset grid of x_i, in the viscous coefficient
c and in the inertia J, so non-negative least squares finds the global optimum over every measured point, at held
torque as at held position.

Sources: the principle, J. Y. Yoon and D. L. Trumper, Mechatronics 24 (2014); elements that stick and slip in parallel,
W. D. Iwan, Journal of Applied Mechanics 33 (1966); the formulas are derived here. The two naive readings of a
resonance, as the secant of the virgin curve and as its local slope, are here for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from . import effects
from .effect import Effect
from .errors import DataError
from .frf import FRF, usable
from .plant import Plant, slide_unit
from .responses.frf_noise import incoherence
from .responses.harmonics import Balance, balance, fundamental, motion
from .responses.resonance import Resonance, find_resonance, secant_curve, slope_curve

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_GRID = 60  # break-away distances tried
_FINEST = 0.3  # of the smallest amplitude: the smallest break-away distance tried
_MODEL_ERROR = 0.002  # of a describing function, beside that of its correction for harmonics
_CORRECTION_ERROR = 0.1  # of that correction
_ROUNDS = 4  # of reweighting
_NO_FRICTION = ("no friction is seen: nothing stiff below a mass line; are units (dB or abs, deg or rad), amplitude, "
                "input and output right, and do points stand close together from below the resonance to beyond it?")
_CORRECTIONS = 8  # times that the harmonics are computed anew


@dataclass(frozen=True)
class DahlReading:
    """What frequency responses say about friction in pre-sliding; a frozen value.

    Attributes:
        plant: inertia, GMS friction and, where it was found, viscous drag. Its level is the torque at which all
            elements slip at the speeds of these data: with a Stribeck curve less than the static level. That curve
            and the attraction are not identified and stand at values without effect.
        breakaway: (m,) break-away distance of each element [rad], rising.
        stiffness: (m,) of each element [N m/rad].
        stuck: stiffness that did not slip at any amplitude [N m/rad].
        inertia: [kg m^2], given or identified.
        viscous: [N m s/rad].
        amplitude: smallest and largest position amplitude in the data [rad]; nothing is known beyond the largest.
        error: median misfit of 1 / H, relative.
        resonances: those found, one per response at most.
        status: a sentence that tells what was found and what the data cannot say.
    """

    plant: Plant
    breakaway: Array
    stiffness: Array
    stuck: float
    inertia: float
    viscous: float
    amplitude: tuple[float, float]
    error: float
    resonances: tuple[Resonance, ...]
    status: str

    def virgin_curve(self, distance: Array) -> Array:
        """(n,) friction torque [N m] at `distance` (n,) from rest [rad], up to the largest amplitude measured."""
        return virgin_curve(self.stiffness, self.breakaway, distance) + self.stuck * np.asarray(distance, float)

    def readings(self) -> list[tuple[float, float, float, float, float]]:
        """Each resonance from small to large: amplitude [rad], J w^2 [N m/rad], and the virgin curve there [N m] by the
        describing function and by the two naive readings, as its secant and as its local slope."""
        points = sorted(self.resonances, key=lambda r: r.amplitude)
        x = np.array([r.amplitude for r in points])
        curves = (f(points, self.inertia, x) if len(x) else x for f in (secant_curve, slope_curve))
        rows = zip(x, (r.stiffness(self.inertia) for r in points), self.virgin_curve(x), *curves, strict=True)
        return [(float(a), float(k), float(d), float(s), float(t)) for a, k, d, s, t in rows]

    def __str__(self) -> str:
        return self.status


def describing_function(stiffness: Array, breakaway: Array, amplitude: Array) -> Complex:
    """(n,) torque per position of a Maxwell-slip set in sinusoidal motion [N m/rad].

    Args:
        stiffness: (m,) [N m/rad].
        breakaway: (m,) [rad].
        amplitude: (n,) of the position [rad].
    """
    ratio = np.asarray(breakaway, float) / np.asarray(amplitude, float)[:, None]
    return np.asarray((_phi(ratio) + 1j * _psi(ratio)) @ np.asarray(stiffness, float))


def virgin_curve(stiffness: Array, breakaway: Array, distance: Array) -> Array:
    """(n,) friction torque [N m] of a relaxed Maxwell-slip set after it was moved one way by `distance` (n,) [rad]."""
    return np.asarray(np.minimum(np.asarray(distance, float)[:, None], breakaway) @ np.asarray(stiffness, float))


def read_resonances(
    resonances: Sequence[Resonance], inertia: float, *, kind: str = "hinge", viscous: bool = True
) -> DahlReading:
    """Friction from resonances alone: their frequencies and their damping, two halves that stand by themselves.

    Args:
        resonances: at least two, at different amplitudes.
        inertia: [kg m^2].
        kind: of the joint.
        viscous: whether viscous drag may take part of the damping.

    Raises:
        DataError: fewer than two amplitudes.
    """
    points = sorted(resonances, key=lambda r: r.amplitude)
    size = np.array([r.amplitude for r in points])
    if len(np.unique(size)) < 2:
        raise DataError(f"resonances at {len(np.unique(size))} amplitude(s); at least two are needed")
    omega = 2 * math.pi * np.array([r.frequency for r in points])
    k, loss = inertia * omega**2, np.array([r.dissipation for r in points]) / (inertia * omega**2)
    grid, p, q = _columns(size)
    drag = omega if viscous else np.zeros(len(omega))
    in_phase, quadrature, solution = k, loss, np.zeros(0)
    for _ in range(_ROUNDS):
        # An error e of a frequency is 2 e in J w^2, and none in the loss factor, which is a ratio.
        rows = np.vstack([
            np.column_stack([p, np.zeros(len(k))]) / (2 * in_phase[:, None]),
            np.column_stack([q - loss[:, None] * p, drag]) / (np.maximum(quadrature, 0.02) * in_phase)[:, None],
        ])  # fmt: skip
        target = np.concatenate([k / (2 * in_phase), np.zeros(len(k))])
        solution = _nnls(rows, target)
        # Weights of the fitted values: weights of the measured ones would favour those that came out small.
        fitted = p @ solution[:-1]
        in_phase = np.clip(fitted, 0.3 * k, 3 * k)
        quadrature = np.clip((q @ solution[:-1] + solution[-1] * drag) / in_phase, 0.3 * loss, 3 * loss + 0.02)
    error = float(np.sqrt(np.mean((p @ solution[:-1] / k - 1) ** 2)))
    return _reading(grid, solution[:-1], float(solution[-1]), inertia, True, size, error, tuple(points), kind)


def identify_dahl(
    frfs: Sequence[FRF], inertia: float | None = None, *, kind: str | None = None, viscous: bool = True
) -> DahlReading:
    """Friction, and where it is not given the inertia, from every point of frequency responses at several amplitudes.

    Args:
        frfs: from torque, with their amplitude known, measured one sine at a time (taken for granted where `sine` of a
            response is None).
        inertia: [kg m^2]; None: from the same fit, which the points above the resonance decide.
        kind: of the joint; None: that of the responses.
        viscous: whether viscous drag may take part of the damping.

    Raises:
        DataError: responses that are not from torque, lack their amplitude, were measured with many frequencies at
            once, or have all the same amplitude.
    """
    if isinstance(frfs, FRF):
        frfs = [frfs]
    for f in frfs:
        if not isinstance(f, FRF):
            raise DataError("frequency responses are expected, as those of gms.load(...).frfs; "
                            f"{type(f).__name__} given")
    if not frfs:
        raise DataError("no frequency responses; at least two amplitudes are needed")
    if inertia is not None and not 0 < inertia < math.inf:
        raise DataError(f"the inertia must be a positive number; {inertia!r} given")
    kind = kind or frfs[0].kind
    all_ = [usable(f).of_kind(kind) for f in frfs]
    size = np.concatenate([f.amplitude for f in all_])
    if size.max() < 1.2 * size.min():
        raise DataError("all points have the same amplitude; measure at several, best a decade or more apart")
    omega = np.concatenate([f.omega for f in all_])
    inverse = 1 / np.concatenate([f.response for f in all_])
    sigma = np.concatenate([np.zeros(len(f)) if f.sigma is None else f.sigma for f in all_])
    grid, p, q = _columns(size)
    # What friction can do at a point, so that points on the mass line do not outweigh those that know friction.
    rough = float(np.median(np.abs(inverse.real[omega <= np.median(omega)])))
    worse = np.concatenate([incoherence(f) for f in all_])
    spread = worse * np.hypot(sigma * np.abs(inverse) ** 2, _MODEL_ERROR * (np.abs(inverse) + rough))
    mass = omega**2
    known = 0.0 if inertia is None else inertia
    column = mass if inertia is None else np.zeros(len(mass))
    drag = omega if viscous else np.zeros(len(omega))
    harmonic = np.zeros(len(omega), complex)
    trusted = np.ones(len(omega), bool)
    solution = np.zeros(0)
    found: Balance | None = None
    for i in range(_ROUNDS + _CORRECTIONS):
        rows = np.vstack([
            np.column_stack([p, np.zeros(len(omega)), -column]) / spread[:, None],
            np.column_stack([q, drag, np.zeros(len(omega))]) / spread[:, None],
        ])  # fmt: skip
        sought = inverse - harmonic
        target = np.concatenate([sought.real + known * mass, sought.imag]) / np.tile(spread, 2)
        keep = np.tile(trusted, 2)
        solution = _nnls(rows[keep], target[keep])
        friction = (p + 1j * q) @ solution[:-2]
        total = known + float(solution[-1])
        fitted = friction + 1j * solution[-2] * drag - total * mass + harmonic
        if i >= _ROUNDS - 1 and total > 0:
            breakaway, stiffness = _with_stuck(grid, solution[:-2], size.max())
            if not stiffness @ breakaway > 0:
                raise DataError(f"{_named(all_)}: {_NO_FRICTION}")
            new, found = harmonic_part(
                stiffness, breakaway, total, float(solution[-2]), size, omega, found.extra if found else None
            )
            trusted = found.good
            if 2 * trusted.sum() < len(omega):
                raise DataError(
                    "the responses are not those of an inertia with friction: at most points what fits them best has "
                    "no periodic motion; are amplitude, units and input right?"
                )
            harmonic = new if i == _ROUNDS - 1 else 0.5 * (harmonic + new)
        # Weights of the fitted values: the measured ones would favour points that noise has made small.
        near = np.clip(np.abs(fitted), 0.1 * np.abs(inverse), 3 * np.abs(inverse))
        spread = worse * np.hypot(sigma * near**2, _MODEL_ERROR * (near + np.abs(friction)))
        spread = np.hypot(spread, _CORRECTION_ERROR * np.abs(harmonic))
    if total <= 0:
        raise DataError("the responses do not fall along a mass line; are they from torque to position?")
    # The resonances of the fundamental alone, as the formula has them.
    cuts = np.cumsum([len(f) for f in all_])[:-1]
    fundamental = np.asarray(1 / (inverse - harmonic), complex)
    parts = zip(all_, np.split(fundamental, cuts), np.split(trusted, cuts), strict=True)
    plain = [replace(f, response=g, excitation=None).where(ok) for f, g, ok in parts if ok.sum() > 1]
    resonances = [r for r in map(find_resonance, plain) if r is not None]
    misfit = np.abs(inverse - fitted)[trusted] / np.abs(inverse[trusted])
    error = float(np.median(misfit))
    return _reading(
        grid, solution[:-2], float(solution[-2]), total, inertia is not None, size, error, tuple(resonances), kind
    )


def _named(frfs: Sequence[FRF]) -> str:
    return frfs[0].name + (f" and {len(frfs) - 1} more" if len(frfs) > 1 else "")


def harmonic_part(
    stiffness: Array, breakaway: Array, inertia: float, viscous: float, amplitude: Array, omega: Array,
    extra: Complex | None = None,
) -> tuple[Complex, Balance]:  # fmt: skip
    """What the harmonics of the motion add to torque over position under a sinusoidal torque, by harmonic balance.

    Args:
        stiffness, breakaway: (m,) of the Maxwell-slip set [N m/rad], [rad].
        inertia, viscous: [kg m^2], [N m s/rad].
        amplitude: (n,) of the fundamental of the position [rad].
        omega: (n,) of the torque [rad/s].
        extra: (n, orders) harmonics of the motion to begin with [rad]; None: there are none.

    Returns:
        (n,) addition to 1 / H [N m/rad], and the balance.
    """
    plant = Plant(inertia, (_maxwell_slip(stiffness, breakaway), effects.find("viscous")(coefficient=viscous)))
    joint = plant.joint()
    found = balance(joint, inertia, amplitude, omega, extra)
    alone = fundamental(joint.cycle(2 * math.pi / omega, *motion(amplitude, omega)))
    return np.asarray((alone - found.first) / amplitude, complex), found


def _maxwell_slip(stiffness: Array, breakaway: Array) -> Effect:
    """GMS friction whose level is the same at all velocities."""
    level = float(stiffness @ breakaway)
    return effects.find("gms")(
        stiffness=stiffness, fraction=stiffness * breakaway / level, coulomb=level, static=level,
        stribeck_velocity=1.0, attraction=level,
    )  # fmt: skip


def _phi(r: Array) -> Array:
    theta = np.arccos(1 - 2 * np.minimum(r, 1))
    return (theta - np.sin(2 * theta) / 2) / math.pi


def _psi(r: Array) -> Array:
    r = np.minimum(r, 1)
    return 4 / math.pi * r * (1 - r)


def _columns(size: Array) -> tuple[Array, Array, Array]:
    """Break-away distances of the grid, the last one never reached, with the unit describing functions (n, m)."""
    grid = np.geomspace(_FINEST * size.min(), 0.97 * size.max(), _GRID)
    grid = np.append(grid, math.inf)
    ratio = np.minimum(grid, 1e6 * size.max()) / size[:, None]
    return grid, _phi(ratio), _psi(ratio)


def _nnls(rows: Array, target: Array) -> Array:
    scale = np.sqrt(np.mean(rows**2, 0))
    scale[scale == 0] = 1.0
    # Of tall data only their triangle matters.
    q, r = np.linalg.qr(rows / scale)
    return np.asarray(scipy.optimize.nnls(r, q.T @ target)[0] / scale)


def _reading(
    grid: Array, weight: Array, viscous: float, inertia: float, known: bool, size: Array, error: float,
    resonances: tuple[Resonance, ...], kind: str,
) -> DahlReading:  # fmt: skip
    stuck = float(weight[-1])
    breakaway, stiffness = _merged(grid[:-1], weight[:-1])
    low, high = float(size.min()), float(size.max())
    x, k = _with_stuck(grid, weight, high)
    if not len(k) or not float(k @ x) > 0:
        raise DataError(_NO_FRICTION)
    plant = Plant(inertia, (_maxwell_slip(k, x),), kind, known)
    if viscous > 0:
        plant += effects.find("viscous")(coefficient=viscous)
    said = [
        f"{len(k)} elements, stiffness {k.sum():.4g} N m/rad, level {k @ x:.4g} N m; "
        f"inertia {inertia:.4g} kg m^2 ({'given' if known else 'identified'}); misfit {100 * error:.2f} %",
        f"amplitudes {low:.3g} to {high:.3g} rad",
    ]
    if stuck > 0.02 * k.sum():
        said.append(
            f"a stiffness of {stuck:.3g} N m/rad did not slip: the level is a lower bound; measure at larger amplitudes"
        )
    said.append(
        "the level is that at the speeds of these data; coulomb below static, stribeck_velocity and attraction are not "
        "determined: constant-velocity runs and reversals at speed determine them"
    )
    text = "; ".join(said)
    return DahlReading(plant, breakaway, stiffness, stuck, inertia, viscous, (low, high), error, resonances,
                       text if kind == "hinge" else slide_unit(text))


def _merged(grid: Array, weight: Array) -> tuple[Array, Array]:
    """Neighbours on the grid that share an element become it again, with its level and its stiffness."""
    active = np.flatnonzero(weight > 1e-6 * max(weight.sum(), 1e-300))
    if not len(active):
        return np.zeros(0), np.zeros(0)
    groups = np.split(active, np.flatnonzero(np.diff(active) > 1) + 1)
    stiffness = np.array([weight[g].sum() for g in groups])
    return np.array([weight[g] @ grid[g] for g in groups]) / stiffness, stiffness


def _with_stuck(grid: Array, weight: Array, largest: float) -> tuple[Array, Array]:
    """Break-away distances and stiffnesses, what never slipped being given the least distance that it may have."""
    x, k = _merged(grid[:-1], weight[:-1])
    return (np.append(x, largest), np.append(k, weight[-1])) if weight[-1] > 0 else (x, k)
