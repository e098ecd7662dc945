"""A frequency response as an observation: torque applied beside torque that a plant needs, at every point of it.

A point at (w, U, G) says that the joint moved as |G| U sin(w t + arg G) while the torque was U sin(w t). The effects
are replayed along that motion until they come back to themselves (`sines`); the first harmonic of their torque, with
the inertial one, is what the plant needs, and the first harmonic of what the drive makes of the sine is what was
applied. For a Maxwell-slip set this is the describing function; it holds for every effect of the catalogue, and for
torque-held and position-held sweeps alike.

A sinusoidal torque does not move a joint with friction quite sinusoidally: the harmonics of the motion change the
fundamental by a tenth or more at and below the resonance. They follow from harmonic balance with the plant at hand
(`settled`), and are kept while a fit takes its steps.

Source: Gelb and Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design (1968).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ..comparison.score import TORQUE
from ..frf import FRF, join_sines, usable
from ..plant import Plant
from ..responses.frf_noise import beside, has_sigma, incoherence, roughness
from ..responses.harmonics import ORDERS, balance
from ..responses.sines import Sines
from .inverse import Observation
from .servo_observation import ServoObservation

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MODEL_ERROR = 3e-3  # of a torque: what a sampled period costs, and a drive and a sensor that are not quite linear
_DOUBT = 1.03  # of the inertia: where this changes what the harmonics do, one of them meets the resonance
_BLOCK = 3  # neighbouring points that are left out together
_UNKNOWN = 0.01  # relative deviation of a response of which nothing is known
_ALONE = 5.0  # times its deviation, and times what its neighbours are off: a point that stands alone
_BESIDE = 2  # neighbours on each side
_ANOTHER = 1.5  # times a deviation: one by which the points are weighed otherwise
_SAME = 0.03  # relative distance within which frequencies of two responses are the same


@dataclass(frozen=True)
class FrfObservation(Sines):
    """A response from torque to position, with what its points are worth.

    Rows stand in pairs, real and imaginary part relative to the phase of the motion, point after point.

    Attributes:
        frf: torque to position, amplitudes known.
        deviation: (n,) standard deviation of the torque at each point, E|error|^2 = deviation^2 [N m].
        scale: common to all observations of a fit; a row is a torque times scale over its deviation [N m].
        extra: (n, orders) harmonics of the motion, in the phase of its fundamental [rad].
    """

    frf: FRF
    deviation: Array
    scale: float = 1.0
    extra: Complex | None = None

    score = TORQUE
    negligible = 1e-3  # as of a record

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

    @property
    def determined(self) -> NDArray[np.bool_]:
        """(2 n,) all: every point has its own uncertainty."""
        return np.ones(len(self.index), bool)

    @property
    def duration(self) -> float:
        """The longest period [s]."""
        return 1 / float(self.frf.frequency[0])

    def rows_per_block(self, duration: float) -> int:
        """Rows that are taken as dependent: those of neighbouring points."""
        return 2 * _BLOCK

    def opening(self, duration: float) -> FrfObservation:
        """Itself."""
        return self

    def thinned(self, every: int) -> FrfObservation:
        """The same observation of every so many points, the last included."""
        if every < 2 or len(self.frf) < 3 * every:
            return self
        keep = (len(self.frf) - 1 - np.arange(len(self.frf))) % every == 0
        extra = None if self.extra is None else self.extra[keep]
        return replace(self, frf=self.frf.where(keep), deviation=self.deviation[keep], extra=extra)

    @property
    def frequency(self) -> Array:
        """(n,) [Hz]."""
        return self.frf.frequency

    @cached_property
    def weight(self) -> Array:
        """(n,) by which a torque becomes a row."""
        return np.asarray(self.scale / self.deviation)

    @cached_property
    def size(self) -> Array:
        """(n,) amplitude of the position [rad]."""
        return np.asarray(self.frf.amplitude, float)

    @cached_property
    def torque(self) -> Complex:
        """(n,) torque commanded, in the phase of the motion: of a held one what acts like a continuous one [N m]."""
        return np.asarray(self.size / self.frf.response, complex)

    def settled(self, plant: Plant) -> FrfObservation:
        """The same observation with the harmonics that the motion of `plant` has under a sinusoidal torque.

        Where no balance is found the harmonics stay as they were.
        """
        return settled([self], plant)[0]

    def floor(self, rng: np.random.Generator) -> Array:
        """(2 n,) rows that the uncertainty of the response alone leaves, one draw."""
        return self.scale / math.sqrt(2) * rng.standard_normal(len(self.index))

    def model_response(self, plant: Plant) -> Complex:
        """(n,) response of `plant` at the amplitude of the motion measured: position over torque commanded."""
        return np.asarray(self.size * self.drive_response(plant) / self.needed_torque(plant), complex)


Seen = Observation | FrfObservation | ServoObservation


@dataclass(frozen=True)
class Together(Sines):
    """The points of several observations as those of one, so that a plant makes one pass over all of them.

    Attributes:
        parts: in the order of the rows.
    """

    parts: tuple[FrfObservation, ...]

    @cached_property
    def frequency(self) -> Array:
        """(n,) [Hz]."""
        return np.concatenate([o.frequency for o in self.parts])

    @cached_property
    def size(self) -> Array:
        """(n,) amplitude of the position [rad]."""
        return np.concatenate([o.size for o in self.parts])

    @cached_property
    def torque(self) -> Complex:
        """(n,) torque commanded [N m]."""
        return np.concatenate([o.torque for o in self.parts])

    @cached_property
    def weight(self) -> Array:
        """(n,) by which a torque becomes a row."""
        return np.concatenate([o.weight for o in self.parts])

    @cached_property
    def extra(self) -> Complex | None:
        """(n, orders) harmonics of the motion [rad]; None: no part has any."""
        if all(o.extra is None for o in self.parts):
            return None
        return np.concatenate(
            [np.zeros((len(o.frf), len(ORDERS)), complex) if o.extra is None else o.extra for o in self.parts]
        )


def settled(observations: Sequence[FrfObservation], plant: Plant) -> list[FrfObservation]:
    """The observations with the harmonics that the motion of `plant` has under a sinusoidal torque.

    Where no balance is found the harmonics stay as they were.
    """
    if not observations:
        return []
    all_ = Together(tuple(observations))
    found = balance(plant.joint(), plant.driven_inertia, all_.size, all_.omega, all_.extra)
    kept = np.zeros_like(found.extra) if all_.extra is None else all_.extra
    extra = np.where(found.good[:, None], found.extra, kept)
    ends = np.cumsum([len(o.frf) for o in observations])[:-1]
    return [replace(o, extra=x) for o, x in zip(observations, np.split(extra, ends), strict=True)]


def relative_deviation(frf: FRF) -> Array:
    """(n,) standard deviation of a response relative to its size.

    From sigma, smoothed over neighbours, for it is known from a few repeats only; where there is none, from how far
    points stand from a smooth curve through their neighbours, those of less coherence further (`incoherence`).
    """
    if has_sigma(frf):
        share = np.asarray(frf.sigma) / np.abs(frf.response)
        usual = scipy.ndimage.median_filter(share, min(5, len(frf)), mode="nearest")
        return np.asarray(np.maximum(usual, 0.5 * share))
    return roughness(frf) * incoherence(frf)


def observe_frfs(frfs: Sequence[FRF]) -> list[FrfObservation]:
    """Responses as observations, sines of one amplitude joined; raises DataError where one cannot be used."""
    found = [usable(f) for f in join_sines(frfs)]
    shares = [relative_deviation(f) for f in found]
    known = np.concatenate(shares)
    usual = float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else _UNKNOWN
    return rescaled([
        FrfObservation(f, _deviation(f, np.where(np.isfinite(share), share, usual * incoherence(f))))
        for f, share in zip(found, shares, strict=True)
    ])  # fmt: skip


def _deviation(frf: FRF, share: Array) -> Array:
    """(n,) of the torque, of one of the response relative to its size [N m]."""
    return np.hypot(share, _MODEL_ERROR) * np.asarray(frf.amplitude, float) / np.abs(frf.response)


def balanced(observations: Sequence[FrfObservation], plant: Plant) -> list[FrfObservation]:
    """The observations with the harmonics of `plant`, without the points at which there is no balance.

    What the calculation itself may cost is added to the deviation of each point. Where responses come without a
    deviation, it is told from what `plant` leaves if that is less noise than there is without it.
    """
    all_ = Together(tuple(observations))
    found = balance(plant.joint(), plant.driven_inertia, all_.size, all_.omega)
    beside_it = balance(plant.joint(), _DOUBT * plant.driven_inertia, all_.size, all_.omega, found.extra)
    errors = np.hypot(_MODEL_ERROR * np.abs(found.first), np.abs(found.first - beside_it.first))
    out, costs, ends = [], [], np.cumsum([len(o.frf) for o in observations])[:-1]
    for o, good, error, extra in zip(
        observations, *(np.split(x, ends) for x in (found.good & beside_it.good, errors, found.extra)), strict=True
    ):
        if good.any():
            frf = o.frf if good.all() else o.frf.where(good)
            out.append(replace(o, frf=frf, deviation=o.deviation[good], extra=extra[good]))
            costs.append(error[good])
    return [
        replace(o, deviation=np.hypot(o.deviation, cost)) for o, cost in zip(_retold(out, plant), costs, strict=True)
    ]


def _retold(observations: Sequence[FrfObservation], plant: Plant) -> list[FrfObservation]:
    """The observations, those without sigma with the deviation that is told beside `plant` where that is smaller."""
    told = _told_beside(observations, plant)
    if not told or np.median(np.concatenate([d / observations[k].deviation for k, d in told.items()])) > 1:
        return list(observations)
    return [replace(o, deviation=told[k]) if k in told else o for k, o in enumerate(observations)]


def _told_beside(observations: Sequence[FrfObservation], plant: Plant) -> dict[int, Array]:
    """(n,) deviation that is told beside `plant`, by the number of each without sigma; none where none is."""
    bare = {k: o for k, o in enumerate(observations) if not has_sigma(o.frf)}
    shares = beside([o.frf for o in bare.values()], [o.model_response(plant) for o in bare.values()])
    if shares is None:
        return {}
    return {k: _deviation(o.frf, share) for (k, o), share in zip(bare.items(), shares, strict=True)}


def tells_another_noise(plant: Plant, observations: Sequence[Seen]) -> bool:
    """Whether some response without sigma is worth much more or less beside `plant` than it is taken for."""
    bare = settled([o for o in observations if isinstance(o, FrfObservation) and not has_sigma(o.frf)], plant)
    ratios = [float(np.median(d / bare[k].deviation)) for k, d in _told_beside(bare, plant).items()]
    return any(not 1 / _ANOTHER < r < _ANOTHER for r in ratios)


def without_outliers(
    observations: Sequence[FrfObservation], residuals: Sequence[Array]
) -> list[FrfObservation] | None:
    """The observations with points that stand alone given the deviation that they show; None where there are none.

    A physical effect acts on the neighbours of a point too, or at the same frequency at other amplitudes. What does
    neither is a bad measurement, or a motion that jumped to another branch where a harmonic meets the resonance.

    Args:
        observations: frequency responses.
        residuals: (2 n,) rows of each, left by a fit.
    """
    off = [np.abs(o.complex(r)) / o.deviation for o, r in zip(observations, residuals, strict=True)]
    usual = max(float(np.median(np.concatenate(off))), 0.5)
    out, found = [], False
    for k, (o, z) in enumerate(zip(observations, off, strict=True)):
        near = np.array([np.delete(z[max(i - _BESIDE, 0) : i + _BESIDE + 1], min(i, _BESIDE)).max(initial=0.0)
                         for i in range(len(z))])  # fmt: skip
        alone = z > _ALONE * np.maximum(near, usual)
        for i in np.flatnonzero(alone):
            f = o.frf.frequency[i]
            others = [y[np.abs(p.frf.frequency / f - 1) < _SAME] for j, (p, y) in enumerate(
                zip(observations, off, strict=True)) if j != k]  # fmt: skip
            alone[i] = np.concatenate([*others, np.zeros(1)]).max() < _ALONE * usual
        if len(z) > 2 * _BESIDE and alone.any():
            found = True
            deviation = np.where(alone, o.deviation * z / usual, o.deviation)
            out.append(replace(o, deviation=deviation))
        else:
            out.append(o)
    return out if found else None


def rescaled(observations: Sequence[FrfObservation], scale: float | None = None) -> list[FrfObservation]:
    """The observations with a common scale.

    Args:
        scale: standard deviation of the torque in the records they stand beside [N m]; None: there are none, and rows
            are as large as torques are.
    """
    if scale is None:
        size = np.concatenate([np.abs(o.torque) for o in observations])
        units = np.concatenate([np.abs(o.torque) / o.deviation for o in observations])
        scale = float(np.sqrt(np.mean(size**2) / np.mean(units**2)))
    return [replace(o, scale=scale) for o in observations]
