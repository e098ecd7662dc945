"""LuGre friction by Hensen's route: bristle from the response at small amplitude, level from sliding.

About rest the bristle of LuGre moves with the joint (dz/dt = v), and the axis is linear:

    1 / H = sigma0 + i w (sigma1 + sigma2) - J w^2.

The frictional resonance gives sigma0, its damping sigma1 + sigma2, the mass line J; motion at constant velocities
gives Fc + (Fs - Fc) exp(-(v / Vs)^2) + sigma2 v. This is the route that identification from the Dahl resonance extends
(`identify_dahl`): one stiffness, right at the one amplitude it was read at.

At a position amplitude A the bristle lags by a part of first order in A, which adds
i (4 / (3 pi)) sigma0^2 A / Fs to 1 / H (harmonic balance, derived here); it is taken off.

Source: R. H. A. Hensen, M. J. G. van de Molengraft and M. Steinbuch, Frequency domain identification of dynamic
friction model parameters, IEEE Trans. Control Systems Technology 10 (2002).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from . import effects
from .errors import DataError
from .frf import FRF, with_amplitude
from .plant import Plant
from .record import Record
from .responses.frf_noise import incoherence

Array = NDArray[np.float64]

_ALIKE = 2.0  # times the smallest amplitude: responses that are read together
_SMALL = 1.0  # of the bristle's break-away Fs / sigma0: beyond, it slides
_WORST = 1e-3  # relative error of a response that claims to know better
_ROUNDS = 20
_FEWEST = 4  # velocities


@dataclass(frozen=True)
class SlidingCurve:
    """Friction at constant velocity, a Stribeck curve; a frozen value.

    Attributes:
        coulomb, static: Fc and Fs [N m].
        stribeck_velocity: Vs [rad/s].
        viscous: sigma2 [N m s/rad].
        error: rms of the misfit over rms of the torque [1].
    """

    coulomb: float
    static: float
    stribeck_velocity: float
    viscous: float
    error: float

    def torque(self, velocity: Array) -> Array:
        """(n,) friction [N m] at velocities (n,) [rad/s] away from zero."""
        v = np.abs(velocity)
        level = self.coulomb + (self.static - self.coulomb) * np.exp(-((v / self.stribeck_velocity) ** 2))
        return np.asarray(np.sign(velocity) * (level + self.viscous * v))


@dataclass(frozen=True)
class LuGreReading:
    """LuGre friction of an axis as Hensen's route reads it; a frozen value.

    Attributes:
        plant: inertia, `lugre` and `viscous`, with 95 % intervals of inertia, stiffness and damping.
        sliding: the curve at constant velocity.
        amplitude: of the position in the responses that were used, the median [rad].
        error: rms of the relative misfit of 1 / H.
        status: a sentence that tells what was found.
    """

    plant: Plant
    sliding: SlidingCurve
    amplitude: float
    error: float
    status: str

    def __str__(self) -> str:
        return self.status


def identify_lugre(
    frfs: Sequence[FRF],
    velocity: Array,
    torque: Array,
    inertia: float | None = None,
    *,
    kind: str | None = None,
) -> LuGreReading:
    """LuGre friction, and where it is not given the inertia, from responses at small amplitude and from sliding.

    Args:
        frfs: from torque, with their amplitude known; those within twice the smallest amplitude are used.
        velocity, torque: (n,) constant velocities and the torques that hold them [rad/s], [N m]; `constant_velocity`.
        inertia: [kg m^2]; None: identified, from the same points.
        kind: of the joint; None: that of the responses.

    Raises:
        DataError: no responses, a resonance that is none, amplitudes that are not small, or too few velocities.
    """
    if not frfs:
        raise DataError("no frequency responses; one at small amplitude is needed")
    curve = fit_sliding(velocity, torque)
    kind = kind or frfs[0].kind
    all_ = [with_amplitude(f).of_kind(kind) for f in frfs]
    sizes = [float(np.median(f.amplitude)) for f in all_]  # type: ignore[arg-type]
    near = [f for f, a in zip(all_, sizes, strict=True) if a <= _ALIKE * min(sizes)]
    omega = np.concatenate([f.omega for f in near])
    amplitude = np.concatenate([f.amplitude for f in near])
    inverse = 1 / np.concatenate([f.response for f in near])
    relative = np.concatenate(
        [np.full(len(f), _WORST) if f.sigma is None else np.maximum(f.sigma / np.abs(f.response), _WORST) for f in near]
    )
    spread = np.tile(relative * np.concatenate([incoherence(f) for f in near]) * np.abs(inverse), 2)
    zero, one = np.zeros(len(omega)), np.ones(len(omega))
    columns = [np.append(one, zero), np.append(zero, omega)]  # stiffness, damping
    if inertia is None:
        columns.append(np.append(-(omega**2), zero))
    rows = np.column_stack(columns) / spread[:, None]
    if len(rows) <= len(columns):
        raise DataError(f"{len(omega)} points at small amplitude; at least two are needed")
    known = 0.0 if inertia is None else inertia
    solution = np.zeros(len(columns))
    lag = zero
    for _ in range(_ROUNDS):
        target = np.append(inverse.real + known * omega**2, inverse.imag - lag) / spread
        last, solution = solution, np.linalg.lstsq(rows, target, rcond=None)[0]
        lag = 4 / (3 * math.pi) * solution[0] ** 2 * amplitude / curve.static
        if np.allclose(last, solution, rtol=1e-9):
            break
    stiffness, total = float(solution[0]), float(solution[1])
    mass = float(solution[2]) if inertia is None else inertia
    if stiffness <= 0 or mass <= 0:
        raise DataError(
            f"the responses show no frictional resonance: stiffness {stiffness:.3g}, inertia {mass:.3g}; are input, "
            "units and amplitude right?"
        )
    reach = curve.static / stiffness
    size = float(np.median(amplitude))
    if size > _SMALL * reach:
        raise DataError(
            f"an amplitude of {size:.3g} is not small against the break-away distance Fs / sigma0 = {reach:.3g}; "
            "measure at a smaller one"
        )
    left = target - rows @ solution
    free = len(left) - len(solution)
    scale = max(float(left @ left) / free, 1.0)
    half = scipy.stats.t.ppf(0.975, free) * np.sqrt(scale * np.diag(np.linalg.inv(rows.T @ rows)))
    damping = max(total - curve.viscous, 0.0)
    lugre = effects.find("lugre")(
        stiffness=stiffness, damping=damping, coulomb=curve.coulomb, static=curve.static,
        stribeck_velocity=curve.stribeck_velocity,
    )  # fmt: skip
    plant = Plant.axis(mass, kind) + lugre + effects.find("viscous")(coefficient=curve.viscous)
    intervals = {
        "lugre.stiffness": (stiffness - half[0], stiffness + half[0]),
        "lugre.damping": (max(damping - half[1], 0.0), damping + half[1]),
    }
    if inertia is None:
        intervals["inertia"] = (mass - half[2], mass + half[2])
    fitted = stiffness + 1j * (omega * total + lag) - mass * omega**2
    error = float(np.sqrt(np.mean(np.abs(fitted / inverse - 1) ** 2)))
    status = (
        f"LuGre from {len(omega)} points at amplitudes near {size:.3g} (bristle breaks away at {reach:.3g}) and "
        f"{len(velocity)} velocities: stiffness {stiffness:.4g}, damping {damping:.3g}, Fc {curve.coulomb:.4g}, Fs "
        f"{curve.static:.4g}; misfit {100 * error:.2g} % of 1 / H, {100 * curve.error:.2g} % of the sliding torque"
    )
    named = Plant(mass, plant.effects, kind, inertia is not None, intervals, {"method": "Hensen 2002"})
    return LuGreReading(named, curve, size, error, status)


def fit_sliding(velocity: Array, torque: Array) -> SlidingCurve:
    """The Stribeck curve through torques at constant velocities.

    It is linear but in Vs, which is searched.

    Args:
        velocity, torque: (n,) [rad/s], [N m], of either sign.

    Raises:
        DataError: fewer than four velocities, lengths that differ, or no friction that opposes the motion.
    """
    try:
        velocity, torque = np.asarray(velocity, float), np.asarray(torque, float)
    except (TypeError, ValueError) as error:
        raise DataError(f"velocity and torque must be numbers ({error})") from None
    if not (np.isfinite(velocity).all() and np.isfinite(torque).all()):
        raise DataError("velocity and torque must be finite numbers, one torque for each velocity")
    if velocity.shape != torque.shape or velocity.ndim != 1:
        raise DataError(f"velocity has shape {velocity.shape}, torque {torque.shape}; one torque for each velocity")
    v, f = np.abs(velocity), torque * np.sign(velocity)
    if len(np.unique(v[v > 0])) < _FEWEST:
        raise DataError(f"{len(np.unique(v[v > 0]))} different velocities; at least {_FEWEST} are needed")
    v, f = v[v > 0], f[v > 0]
    if f.max() <= 0:
        raise DataError("the torque does not oppose the motion; is its sign that of the drive?")

    def solve(log_vs: float) -> tuple[Array, float]:
        columns = np.column_stack([np.ones(len(v)), np.exp(-((v / math.exp(log_vs)) ** 2)), v])
        return scipy.optimize.nnls(columns, f)

    grid = np.linspace(math.log(v.min()) - 0.5, math.log(v.max()) + 0.5, 60)
    best = grid[int(np.argmin([solve(x)[1] for x in grid]))]
    step = grid[1] - grid[0]
    found = scipy.optimize.minimize_scalar(lambda x: solve(x)[1], bounds=(best - step, best + step), method="bounded")
    x, miss = solve(found.x)
    size = float(np.sqrt(np.sum(f**2)))
    if x[0] + x[1] <= 0:
        raise DataError("no dry friction in the torques at constant velocity; LuGre needs some")
    return SlidingCurve(float(x[0]), float(x[0] + x[1]), math.exp(found.x), float(x[2]), miss / size)


def constant_velocity(records: Sequence[Record], settled: float = 0.5) -> tuple[Array, Array]:
    """Mean velocity and mean torque of runs at constant velocity.

    Args:
        records: each at one velocity.
        settled: part of each run, at its end, over which is averaged.

    Returns:
        (n,) velocities [rad/s] and (n,) torques [N m].
    """
    ends = [r.slice(int((1 - settled) * len(r)), len(r)) for r in records]
    speed = [(r.position[-1] - r.position[0]) / (r.time[-1] - r.time[0]) for r in ends]
    return np.array(speed), np.array([r.torque.mean() for r in ends])
