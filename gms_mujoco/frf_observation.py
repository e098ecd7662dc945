"""A frequency response as an observation: torque applied beside torque that a plant needs, at every point of it.

A point at (w, U, G) says that the joint moved as |G| U sin(w t + arg G) while the torque was U sin(w t). The effects are
replayed along that motion until they come back to themselves; the first harmonic of their torque, with the inertial one,
is what the plant needs, and the first harmonic of what the drive makes of the sine is what was applied. For a
Maxwell-slip set this is the describing function; it holds for every effect of the catalogue, and for torque-held and
position-held sweeps alike.

A sinusoidal torque does not move a joint with friction quite sinusoidally: the harmonics of the motion change the
fundamental by a tenth or more at and below the resonance. They follow from harmonic balance with the plant at hand
(`settled`), and are kept while a fit takes its steps.

Source of the describing function and of harmonic balance: Gelb and Vander Velde, Multiple-Input Describing Functions
and Nonlinear System Design (1968).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .errors import DataError
from .frf import FRF, join_sines
from .plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAMPLES = 64  # of a period
_ORDERS = np.arange(3, 22, 2)  # harmonics of the motion that are followed
_ROUNDS = 25  # of harmonic balance
_BALANCED = 0.02  # of the torque of the effects: what may be left over at a harmonic
_MODEL_ERROR = 1e-3  # of a torque: what the sampled period and the harmonics left out may cost
_BLOCK = 3  # neighbouring points that are left out together
_MOST_PERIODS = 256  # until a drive effect has come to rest


@dataclass(frozen=True)
class FrfObservation:
    """A response from torque to position, with what its points are worth.

    Rows stand in pairs, real and imaginary part relative to the phase of the motion, point after point.

    Attributes:
        frf: torque to position, amplitudes known.
        deviation: (n,) standard deviation of the torque at each point, E|error|^2 = deviation^2 [N m].
        scale: common to all observations of a fit; a row is a torque times scale over its deviation [N m].
        extra: (n, orders) harmonics of the motion, in the phase of its fundamental [rad].
        resolution: position of one encoder count [rad], None where unknown.
    """

    frf: FRF
    deviation: Array
    scale: float = 1.0
    extra: Complex | None = None
    resolution: float | None = None

    has_memory = False  # in the steady state the beginning is forgotten

    @property
    def name(self) -> str:
        return self.frf.name

    @property
    def use(self) -> str:
        return self.frf.use

    @property
    def bandwidth(self) -> float:
        """Highest frequency [Hz]."""
        return float(self.frf.frequency[-1])

    @property
    def sample_time(self) -> float:
        """A time that is short for these data: a twentieth of the shortest period [s]."""
        return 0.05 / self.bandwidth

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(2 n,) the rows."""
        return np.arange(2 * len(self.frf))

    @cached_property
    def time(self) -> Array:
        """(2 n,) none of the rows has a time: zero."""
        return np.zeros(2 * len(self.frf))

    def rows_per_block(self, duration: float) -> int:
        """Rows that are taken as dependent: those of neighbouring points."""
        return 2 * _BLOCK

    def opening(self, duration: float) -> FrfObservation:
        """Itself."""
        return self

    @cached_property
    def size(self) -> Array:
        """(n,) amplitude of the position [rad]."""
        return np.asarray(self.frf.amplitude, float)

    @cached_property
    def torque(self) -> Complex:
        """(n,) torque commanded, in the phase of the motion: of a held one what acts like a continuous one [N m]."""
        return np.asarray(self.size / self.frf.response, complex)

    @cached_property
    def _rate(self) -> Complex:
        return 1j * self.frf.omega

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        """(n, samples) the motion and its velocity over one period."""
        return self._motion(self.extra)

    def _motion(self, extra: Complex | None) -> tuple[Array, Array]:
        spectrum = np.zeros((len(self.frf), SAMPLES // 2 + 1), complex)
        spectrum[:, 1] = self.size
        if extra is not None:
            spectrum[:, _ORDERS] = extra
        half = SAMPLES / 2
        orders = np.arange(SAMPLES // 2 + 1)
        position = np.fft.irfft(spectrum * half, SAMPLES, axis=1)
        velocity = np.fft.irfft(spectrum * half * 1j * orders * self.frf.omega[:, None], SAMPLES, axis=1)
        return position, velocity

    @property
    def position(self) -> Array:
        """(n samples,) of the motions, one after the other [rad]."""
        return self._waves[0].ravel()

    @property
    def velocity(self) -> Array:
        """(n samples,) [rad/s]."""
        return self._waves[1].ravel()

    @property
    def largest_torque(self) -> float:
        """Largest torque commanded [N m]."""
        return float(np.abs(self.torque).max())

    def _rows(self, x: Complex) -> Array:
        weighted = x * (self.scale / self.deviation)
        return np.stack([weighted.real, weighted.imag], 1).ravel()

    def complex(self, rows: Array) -> Complex:
        """(n,) the torques that rows (2 n,) stand for [N m]."""
        pairs = rows.reshape(-1, 2)
        return np.asarray((pairs[:, 0] + 1j * pairs[:, 1]) * (self.deviation / self.scale), complex)

    @cached_property
    def acceleration(self) -> Array:
        """(2 n,) rows of the acceleration."""
        return self._rows(-self.frf.omega**2 * self.size)

    def applied(self, plant: Plant, skew: float = 0.0) -> Array:
        """(2 n,) rows of the torque that the drive of `plant` delivered."""
        return self._rows(self.torque * self.drive_response(plant))

    def drive_response(self, plant: Plant) -> Complex:
        """(n,) fundamental that the drive delivers over that commanded."""
        out = np.ones(len(self.frf), complex)
        if not plant.drive:
            return out
        wave = np.exp(-2j * math.pi * np.arange(SAMPLES) / SAMPLES)
        for i, (f, size) in enumerate(zip(self.frf.frequency, np.abs(self.torque), strict=True)):
            periods, last = 2, 0j
            while periods <= _MOST_PERIODS:
                phase = np.arange(SAMPLES * periods) / SAMPLES
                torque = size * np.cos(2 * math.pi * phase)
                for effect in plant.drive:
                    torque = effect.deliver(phase / f, torque)
                found = complex(torque[-SAMPLES:] @ wave) * 2 / SAMPLES / size
                if abs(found - last) < 1e-6:
                    break
                periods, last = 2 * periods, found
            out[i] = found
        return out

    def _read(self, plant: Plant) -> tuple[Array, Array, Complex]:
        """Motion, velocity and fundamental of where the joint was, given the sensor effects of the plant."""
        sensors = [e for e in plant.effects if e.kind == "sensor"]
        position, velocity = self._waves
        if not sensors:
            return position, velocity, self.size.astype(complex)
        at = np.empty_like(position)
        for i, f in enumerate(self.frf.frequency):
            at[i] = position[i]
            for effect in reversed(sensors):
                at[i] = effect.correct(np.arange(SAMPLES) / (SAMPLES * f), at[i])
        spectrum = np.fft.rfft(at, axis=1)
        slope = spectrum * 1j * np.arange(SAMPLES // 2 + 1) * self.frf.omega[:, None]
        slope[:, -1] = 0
        return at, np.fft.irfft(slope, SAMPLES, axis=1), spectrum[:, 1] * (2 / SAMPLES)

    def _replay(self, plant: Plant) -> Complex:
        position, velocity, _ = self._read(plant)
        torque = plant.joint().cycle(1 / self.frf.frequency, position, velocity)
        return np.asarray(torque @ _FIRST, complex)

    def replay(self, plant: Plant, memory: Array | None = None, parts: int = 1) -> Array:
        """(2 n,) rows of the torque of the effects along the motion."""
        return self._rows(self._replay(plant))

    def needed(self, plant: Plant, memory: Array | None = None) -> Array:
        """(2 n,) rows of the torque that the plant needs along the motion."""
        return self._rows(self.needed_torque(plant))

    def needed_torque(self, plant: Plant) -> Complex:
        """(n,) fundamental of the torque that the plant needs along the motion [N m]."""
        fundamental = self._read(plant)[2]
        return -plant.driven_inertia * self.frf.omega**2 * fundamental - self._replay(plant)

    def settled(self, plant: Plant) -> FrfObservation:
        """The same observation with the harmonics that the motion of `plant` has under a sinusoidal torque.

        Where no balance is found the harmonics stay as they were.
        """
        found, good = self.balance(plant)
        kept = np.zeros_like(found) if self.extra is None else self.extra
        return replace(self, extra=np.where(good[:, None], found, kept))

    def balance(self, plant: Plant, rounds: int = _ROUNDS) -> tuple[Complex, NDArray[np.bool_]]:
        """(n, orders) harmonics of the motion of `plant`, and (n,) whether its torque has none to within 2 %.

        It may not be found where a harmonic meets the resonance, far below it.
        """
        inertial = plant.driven_inertia * np.outer(self.frf.omega, _ORDERS) ** 2
        joint, period = plant.joint(), 1 / self.frf.frequency
        extra = np.zeros((len(self.frf), len(_ORDERS)), complex) if self.extra is None else self.extra.copy()
        best, least = extra, np.full(len(self.frf), np.inf)
        share = np.full(len(self.frf), 0.5)
        for _ in range(rounds):
            spectrum = np.fft.rfft(joint.cycle(period, *self._motion(extra)), axis=1) * (2 / SAMPLES)
            force, first = spectrum[:, _ORDERS], spectrum[:, 1]
            wrong = force + inertial * extra
            left = np.abs(wrong).max(1) / np.maximum(np.abs(first), 1e-300)
            better = left < least
            best = np.where(better[:, None], extra, best)
            share = np.where(better, share, 0.7 * share)
            least = np.minimum(left, least)
            if np.all(least < 1e-4):
                break
            stiffness = np.abs(first.real / self.size)[:, None]
            away = stiffness - inertial
            # Near the resonance of a harmonic the friction damps it: a step of any size would go too far.
            away = np.where(np.abs(away) < 0.2 * stiffness, np.copysign(0.2 * stiffness, away), away)
            extra = extra + share[:, None] * wrong / away
        return best, least < _BALANCED

    def floor(self, rng: np.random.Generator) -> Array:
        """(2 n,) rows that the uncertainty of the response alone leaves, one draw."""
        return self.scale / math.sqrt(2) * rng.standard_normal(len(self.index))

    def model_response(self, plant: Plant) -> Complex:
        """(n,) response of `plant` at the amplitude of the motion measured: position over torque commanded."""
        return np.asarray(self.size * self.drive_response(plant) / self.needed_torque(plant), complex) * np.exp(0j)


_FIRST = np.exp(-2j * math.pi * np.arange(SAMPLES) / SAMPLES) * (2 / SAMPLES)


def relative_deviation(frf: FRF) -> Array:
    """(n,) standard deviation of a response relative to its size.

    From sigma, smoothed over neighbours, for it is known from a few repeats only; where there is none, from how far
    points stand from a smooth curve through their neighbours.
    """
    n = len(frf)
    if frf.sigma is not None and np.any(frf.sigma > 0):
        share = frf.sigma / np.abs(frf.response)
        usual = ndimage.median_filter(share, min(5, n), mode="nearest")
        return np.asarray(np.maximum(usual, 0.5 * share))
    return np.full(n, roughness(frf))


def roughness(frf: FRF) -> float:
    """How far a point stands from the parabola through its four neighbours, relative; nan with fewer than 8 points."""
    if len(frf) < 8:
        return math.nan
    x = np.log(frf.frequency)
    y = np.log(np.abs(frf.response)) + 1j * np.unwrap(np.angle(frf.response))
    gaps = []
    for i in range(2, len(frf) - 2):
        near = np.array([i - 2, i - 1, i + 1, i + 2])
        powers = np.vander((x[near] - x[i]) / np.ptp(x[near]), 3)
        weights = np.linalg.pinv(powers)[-1]
        gaps.append(abs(y[i] - weights @ y[near]) / math.sqrt(1 + float(weights @ weights)))
    return float(np.median(gaps)) / 0.8326  # of a circular normal distribution


def usable(frf: FRF) -> FRF:
    """The response from torque to position; raises DataError where it does not say how torque and motion belong."""
    f = frf.compliance()
    if f.sine is False:
        raise DataError(
            f"{f.name}: measured with many frequencies at once, where friction has no amplitude of its own for "
            "each; measure one sine at a time, or fit the records in time"
        )
    if f.amplitude is None:
        raise DataError(f"{f.name}: the amplitude of the excitation is not known; give it as amplitude = ... [N m]")
    return f


def observe_frfs(frfs: Sequence[FRF], scale: float | None = None) -> list[FrfObservation]:
    """Responses as observations of one fit.

    Args:
        frfs: from torque, one sine at a time, with their amplitudes.
        scale: standard deviation of the torque in the records they stand beside [N m]; None: there are none, and rows
            are as large as torques are.

    Raises:
        DataError: a response that cannot be used.
    """
    found = [usable(f) for f in join_sines(frfs)]
    shares = [relative_deviation(f) for f in found]
    known = np.concatenate(shares)
    usual = float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.01
    out = []
    for f, share in zip(found, shares, strict=True):
        share = np.where(np.isfinite(share), share, usual)
        size = np.asarray(f.amplitude, float) / np.abs(f.response)
        out.append(FrfObservation(f, np.hypot(share * size, _MODEL_ERROR * size)))
    if scale is None:
        size = np.concatenate([np.abs(o.torque) for o in out])
        units = np.concatenate([np.abs(o.torque) / o.deviation for o in out])
        scale = float(np.sqrt(np.mean(size**2) / np.mean(units**2)))
    return [replace(o, scale=scale) for o in out]


def balanced(observations: Sequence[FrfObservation], plant: Plant) -> list[FrfObservation]:
    """The observations with the harmonics of `plant`, without the points at which none were found."""
    out = []
    for o in observations:
        extra, good = o.balance(plant)
        if good.any():
            frf = o.frf if good.all() else o.frf.where(good)
            out.append(replace(o, frf=frf, deviation=o.deviation[good], extra=extra[good]))
    return out
