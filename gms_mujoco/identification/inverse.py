"""Inverse dynamics: the torque that a plant needs along a measured motion, beside the torque that was applied.

The drive holds its torque from sample to sample and the encoder reads the position at the samples. Integrating
J q'' = u + f twice over two neighbouring samples gives, exactly and without any differentiator,

    J (q[k+1] - 2 q[k] + q[k-1]) / h^2 = (u[k-1] + u[k]) / 2 + (w * f)[k],

with the triangular weight w of half width h on the torque f of the effects (1/6, 4/6, 1/6 on samples of a
piecewise linear f). A model that ignores this sees a delay of half a sample in every healthy axis. A torque that was
read from a sensor is no held one: its mean is that of a smooth course, (u[k-1] + 10 u[k] + u[k+1]) / 12 (Numerov).
Where an element slips or the motion reverses between two samples, f bends there, and is followed on a finer grid. Both
sides then pass the same zero-phase low-pass, which sets the bandwidth in which model and measurement are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from .. import native
from ..comparison.score import TORQUE
from ..effect import Effect, passed
from ..logs.encoder import between_counts
from ..native import series
from ..plant import Plant
from ..recent import kept
from ..record import Record
from .between_samples import delivered, mean_torque, moved, rms_torque, second_difference
from .grid import Grid, Path, Sparse
from .readings import Readings, smoothed
from .rest import Rest

Array = NDArray[np.float64]


FINE = 8  # parts of a sample in which the drive's torque is followed
_STRAIGHT = 1e-3  # of the torque: bends between samples that do more are followed
_MOST_SKIPPED = 5  # samples between two of a sparse look
_STEADY = 0.03  # of the rms torque: what it deviates by over a period of the bandwidth
_MOSTLY = 0.5  # of what the low-pass sees
_EASED = 0.5  # of a period of the highest frequency that the low-pass lets through
_SEEN = 1.5  # periods of the highest frequency that the low-pass lets through, either way, that it sees
_SLOW = 0.1  # of the rms speed: an axis that moves faster slides
SKEW = 0.1  # of a sample, that torque and position of any log may be apart
# Samples that a torque may have acted before its row: a command, one that was measured after, one that came late.
_EARLY = (SKEW, 1.1, 5.1)
_READ = (SKEW, 0.6)  # samples between the instants at which torque and position were read


@dataclass(frozen=True)
class Observation:
    """A record seen through a band: everything about it that does not depend on the model.

    Attributes:
        record: the run.
        bandwidth: -6 dB frequency of the low-pass [Hz].
        cutoff: frequency up to which the position is kept as it is, being more motion than noise of the encoder [Hz];
            0: found from its spectrum.
        early: whether the torque of a row may have acted at another instant than the record says: 1 for up to a sample
            before, or of one that was read up to half a sample either way, 2 for several samples before.
        asked: (n,) 0 for samples of which nothing is asked, else 1; None: found from the record, see `at_rest`.
    """

    record: Record
    bandwidth: float
    cutoff: float = 0.0
    early: int = 0
    asked: Array | None = None

    has_memory = True  # what went before the first sample still acts
    skews = True  # nobody says that torque and position were read on one clock
    typical_torque = None  # what is applied is one
    additive = True  # what an effect needs does not depend on the others
    jumps = True  # as an element slips at one sample or the next
    score = TORQUE
    substeps = 4  # of a forward simulation in a sample
    negligible = 1e-3  # error that nobody asks the cause of, as a simulation without noise may leave it

    @property
    def name(self) -> str:
        return self.record.name

    @property
    def use(self) -> str:
        return self.record.use

    @property
    def sample_time(self) -> float:
        """[s]."""
        return self.record.sample_time

    @property
    def step(self) -> float:
        """From one band-limited value to the next [s]."""
        return self.stride * self.record.sample_time

    @property
    def duration(self) -> float:
        """From the first band-limited value to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def commands(self) -> Array:
        """(n,) torque commanded [N m]."""
        return self.record.torque

    @property
    def temperature(self) -> Array | None:
        """(n,) measured [degC]; None where none was."""
        return self.record.get("temperature")

    def rows_per_block(self, duration: float) -> int:
        """Band-limited values in a stretch of time [s]."""
        return max(int(duration / (self.stride * self.record.sample_time)), 1)

    @cached_property
    def stride(self) -> int:
        """Samples from one band-limited value to the next."""
        return max(int(1 / (self.record.sample_time * self.bandwidth * 3)), 1)

    @cached_property
    def _half(self) -> int:
        # A Hamming window of this length has a transition band of half the bandwidth.
        wanted = int(np.ceil(3.3 / (self.record.sample_time * self.bandwidth)))
        return self.stride * int(np.ceil(min(wanted, len(self.record) // 8) / self.stride))

    @cached_property
    def _kernel(self) -> Array:
        rate = 1 / self.record.sample_time
        return scipy.signal.firwin(2 * self._half + 1, min(self.bandwidth, 0.49 * rate), fs=rate)

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(m,) samples of the record at which band-limited values stand; those at the ends are not defined."""
        return np.arange(self._half + 1, len(self.record) - self._half - 1, self.stride)

    @cached_property
    def time(self) -> Array:
        """(m,) [s]."""
        return self.record.time[self.index]

    @cached_property
    def _readings(self) -> Readings:
        return Readings(self.record)

    @cached_property
    def rest(self) -> Rest:
        """Where the axis rests, in periods of the highest frequency that the low-pass lets through."""
        return Rest(self._readings, self._period)

    @cached_property
    def _asked(self) -> Array | None:
        if self.asked is not None:
            return self.asked
        at_rest = self.rest.at_once
        return self._asked_beside(at_rest) if at_rest.any() else None

    def _asked_beside(self, still: NDArray[np.bool_]) -> Array:
        """(n,) 0 where the axis rests, given the samples (n,) until the next of which it is still; 1 where it moves.

        It rises from one to the other over a part of a period of the highest frequency that the low-pass lets through:
        cut off at once, the noise of a position that was differentiated twice would fold from far above it into the
        band.
        """
        if not still.any():
            return np.ones(len(still))
        away = scipy.ndimage.distance_transform_edt(~self.rest.beside(still))  # [samples]
        return np.asarray(np.sin(np.pi / 2 * np.minimum(away / (_EASED * self._period), 1.0)) ** 2)

    @property
    def resting(self) -> NDArray[np.bool_]:
        """(n,) samples of which nothing is asked."""
        return np.zeros(len(self.record), bool) if self._asked is None else self._asked == 0

    @cached_property
    def determined(self) -> NDArray[np.bool_]:
        """(m,) where all that the low-pass sees of the axis moves by more than its encoder resolves, or most of it
        where that is to the last digit.

        Elsewhere friction is whatever holds the axis: below one count even a perfect model cannot say how far the
        contact is bent, nor, of one that does not bend, when it let go. What is left there speaks for no model and
        against none.
        """
        if self._asked is not None:
            return np.asarray(self.band(np.ones(len(self.record))) > _MOSTLY)
        return np.asarray(~scipy.ndimage.maximum_filter1d(self.rest.stuck, 2 * self._period + 1)[self.index])

    @property
    def _period(self) -> int:
        """Samples in a period of the highest frequency that the low-pass lets through."""
        return max(round(1 / (self.bandwidth * self.record.sample_time)), 1)

    @property
    def rests(self) -> bool:
        """Whether the axis rests within what its encoder resolves, and is asked about it."""
        return self._asked is None and bool(self.rest.stuck.any())

    def without_rests(self) -> Observation:
        """The same observation, of which nothing is asked where the axis rests within what its encoder resolves, if
        only for a part of a period."""
        if self._asked is not None:
            return self
        still = self.rest.briefly
        if not still.any():
            return self
        return replace(self, cutoff=self._cutoff, asked=self._asked_beside(still))

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        """(m,) where the axis moves one way at some speed, all through what the low-pass sees.

        Friction is its level there, and does not depend on how a contact bends that the encoder hardly resolves.
        """
        v, width = self.velocity, 2 * int(_SEEN / (self.bandwidth * self.record.sample_time)) + 1
        least = _SLOW * float(np.sqrt(np.mean(v**2)))
        forward, backward = (scipy.ndimage.minimum_filter1d(side > least, width) for side in (v, -v))
        return np.asarray((forward | backward)[self.index] & self.determined)

    def opening(self, duration: float) -> Observation:
        """The same observation of the first part of the record [s]."""
        n = max(int(duration / self.record.sample_time), 8 * self._half)
        if n >= len(self.record):
            return self
        if n not in self._openings:
            self._openings[n] = self.part(0, n)
        return self._openings[n]

    def part(self, start: int, stop: int) -> Observation:
        """The same observation of samples `start` to `stop` of the record."""
        asked = None if self.asked is None else self.asked[start:stop]
        return replace(self, record=self.record.slice(start, stop), cutoff=self._cutoff, asked=asked)

    @cached_property
    def _openings(self) -> dict[int, Observation]:
        return {}

    def again(self, position: Array) -> Observation:
        """The same observation of another position (n,) [rad]."""
        return self.with_signals({"position": position})

    def with_signals(self, signals: Mapping[str, Array]) -> Observation:
        """The same observation with other signals (n,), or more of them."""
        record = self.record.with_signals(signals)
        return replace(self, record=record, cutoff=self._cutoff, asked=self._asked)

    @property
    def skews_within(self) -> tuple[float, float]:
        """By how many samples the clock of the torque may run ahead of that of the position, least and most."""
        most = self._earlier[self.early]
        return (-most, most) if self.record.sensed else (-most, SKEW)

    @property
    def _earlier(self) -> tuple[float, ...]:
        return _READ if self.record.sensed else _EARLY

    @property
    def may_be_earlier(self) -> bool:
        """Whether its torque may have acted at instants that are not allowed for yet."""
        return self.early < len(self._earlier) - 1

    def acting_early(self) -> Observation:
        """The same observation, whose torque may have acted at another instant, or at one that is further off."""
        return replace(self, early=min(self.early + 1, len(self._earlier) - 1), cutoff=self._cutoff)

    def unsmoothed(self) -> Observation:
        """The same observation, whose position is taken as it stands."""
        return replace(self, cutoff=1 / self.record.sample_time)

    def seen_by(self, plant: Plant) -> Observation:
        """The same observation of where the joint was, given the plant's sensor effects; itself where it has none."""
        sensors = tuple(e for e in plant.effects if e.kind == "sensor")
        if not sensors:
            return self

        def corrected() -> Observation:
            position = self._read
            for effect in reversed(sensors):
                position = passed(effect, "correct", self.record.time, position)
            return self.again(position)

        return kept(self._corrected, sensors, corrected)

    @cached_property
    def _corrected(self) -> dict[tuple[Effect, ...], Observation]:
        return {}

    def band(self, x: Array) -> Array:
        """(m,) or (columns, m) band-limited values of series of samples (n,) or (n, columns)."""
        first = int(self.index[0]) - self._half
        if self._asked is not None:
            x = (x.T * self._asked).T
        return series.band(x, self._kernel, first, self.stride, len(self.index))

    @cached_property
    def position(self) -> Array:
        """(n,) position with the encoder's quantisation smoothed away [rad]."""
        return smoothed(self._read, self.record.sample_time, self._cutoff)

    @cached_property
    def _read(self) -> Array:
        """(n,) position that the readings of the encoder stand for [rad]."""
        torque = self.record.torque - np.mean(self.record.torque)
        mean, square = (scipy.ndimage.uniform_filter1d(x, self._period) for x in (torque, torque**2))
        steady = square - mean**2 < (_STEADY * self._torque) ** 2
        return between_counts(self.record.position, self._readings.count, steady, self._period)

    @cached_property
    def velocity(self) -> Array:
        """(n,) velocity of the smoothed position [rad/s]."""
        return np.asarray(scipy.interpolate.CubicSpline(self.record.time, self.position)(self.record.time, 1))

    @cached_property
    def _cutoff(self) -> float:
        return self.cutoff or max(self._readings.clear_up_to, 1.5 * self.bandwidth)

    @cached_property
    def acceleration(self) -> Array:
        """(m,) band-limited acceleration [rad/s^2]."""
        return self.band(second_difference(self.record.position, self.record.sample_time))

    @cached_property
    def rigid(self) -> Array | float:
        """(m,) band-limited torque that a robot's rigid bodies take beyond inertia times acceleration [N m]."""
        r = self.record
        torque, change = r.get("rigid_torque"), r.get("inertia_change")
        rigid: Array | float = 0.0 if torque is None else self.band(torque)
        if change is not None:
            rigid = rigid + self.band(change * second_difference(r.position, r.sample_time))
        return rigid

    def applied(self, plant: Plant, skew: float = 0.0) -> Array:
        """(m,) band-limited torque that the drive of `plant` delivered for the recorded command [N m].

        Args:
            skew: by which the clock of the torque runs ahead of that of the position [s].
        """
        h = self.record.sample_time
        whole = round(skew / h) if abs(skew) > _EARLY[1] * h else 0  # samples
        skew -= whole * h

        def banded() -> tuple[Array, ...]:
            return tuple(map(self.band, self._shifted(moved(self._mean_torque(plant), -whole))))

        torque, rate, bend = kept(self._applied, (plant.drive, whole), banded)
        return torque - skew * rate + skew**2 / 2 * bend if skew else torque

    @cached_property
    def _applied(self) -> dict[tuple[tuple[Effect, ...], int], tuple[Array, ...]]:
        return {}

    # With both, a torque between samples lies on the parabola through three of them: exact for a skew of a sample.
    def _shifted(self, mean: Array) -> tuple[Array, Array, Array]:
        """Mean torque (n,) around each sample, its rate, and its second derivative."""
        h = self.record.sample_time
        return mean, np.gradient(mean, h), second_difference(mean, h)

    def _mean_torque(self, plant: Plant) -> Array:
        """(n,) mean around each sample of what the drive delivered."""
        r = self.record
        if not plant.drive:
            return mean_torque(r)
        rising = (2 * np.arange(FINE) + 1) / (2 * FINE**2)
        kernel = np.append(rising, rising[::-1])
        return np.append(r.torque[:1], series.band(delivered(plant, r, FINE), kernel, 0, FINE, len(r) - 1))

    def driven(self, plant: Plant) -> Array:
        """(substeps * n,) mean torque that the drive of a plant delivered over each part of a sample [N m]."""
        return delivered(plant, self.record, self.substeps)

    def replay(
        self, plant: Plant, memory: Array | None = None, grid: Grid | None = None, finer: float = 1.0
    ) -> Array:
        """(m,) band-limited torque of the effects along the motion, between the samples too, less what a robot's rigid
        bodies take [N m].

        Args:
            memory: state before the first sample, see `native.Joint.replay`.
            grid: the instants to look at; None: those that this plant needs.
            finer: for so much less of an error than is usual, where it chooses them.
        """
        joint = plant.joint()
        if not joint.n_effects:
            return np.zeros(len(self.index)) - self.rigid
        if grid is None:
            return self.band(self.seen_by(plant)._mean(joint, memory, finer)[0]) - self.rigid
        return self._banded(grid, self._path(plant, grid).torque(joint, memory)) - self.rigid

    def elements(
        self, plant: Plant, joint: native.Joint, effect: int, memory: Array | None = None, grid: Grid | None = None
    ) -> Array:
        """(elements, m) band-limited torque of each element of an effect of `joint`, on the motion that `plant` sees.

        Args:
            effect: its number in the joint; others as for `replay`.
        """
        grid = grid or self.grid(plant, memory)
        return self._banded(grid, self._path(plant, grid).elements(joint, effect, memory))

    def changes(
        self, plant: Plant, joints: Sequence[native.Joint], memories: Sequence[Array | None], grid: Grid | None = None,
        effect: int = 0, apart: int = 0,
    ) -> Array:  # fmt: skip
        """Band-limited differences of the torques of joints with the same effects from that of the first, on the motion
        that `plant` sees; see `series.changes`.

        Args:
            memories: state of each before the first sample.
            others as for `elements`.
        """
        grid = grid or self.grid(plant, memories[0])
        if isinstance(grid, Sparse):
            band = series.Band(grid.kernel, 1, grid.stride, len(self.index))
        else:
            first = int(self.index[0]) - self._half
            band = series.Band(self._kernel, first, self.stride, len(self.index), grid.instants, self._asked)
        known = [m for m in memories if m is not None]
        return self._path(plant, grid).changes(joints, known or None, band, effect, apart)

    def _banded(self, grid: Grid, torque: Array) -> Array:
        """(m,) or (columns, m) band-limited values of torques (N,) or (N, columns) at the instants of a grid."""
        return grid.band(torque, len(self.index)) if isinstance(grid, Sparse) else self.band(grid.mean(torque))

    def _path(self, plant: Plant, grid: Grid) -> Path:
        seen = self.seen_by(plant)
        return grid.path(self.record, seen.position, seen.velocity)

    def grid(self, plant: Plant, memory: Array | None = None, finer: float = 1.0) -> Grid:
        """The instants that the torque of this plant needs, or with `finer` for so much less of an error."""
        return Grid(self.seen_by(plant)._mean(plant.joint(), memory, finer)[1])

    @cached_property
    def sparse(self) -> Grid:
        """No more samples than band-limited values, if that leaves out but a few: for a look that need not be exact."""
        every = max(n for n in range(1, _MOST_SKIPPED + 2) if self.stride % n == 0)
        if every == 1 or self._asked is not None:
            return Grid(np.arange(len(self.record), dtype=float))
        # Torques that change faster than that are hardly in the band: the low-pass may do without those samples too.
        kernel = np.convolve(self._kernel, [1 / 6, 4 / 6, 1 / 6])[1:-1:every]
        instants = np.append(0.0, np.arange(1.0, len(self.record), every))
        return Sparse(instants, kernel / kernel.sum(), self.stride // every)

    def _mean(self, joint: native.Joint, memory: Array | None, finer: float = 1.0) -> tuple[Array, Array]:
        r = self.record
        tolerance = _STRAIGHT * self._torque / finer
        signals = r.get("load"), r.get("temperature")
        return joint.mean(r.time, self.position, self.velocity, *signals, memory, tolerance)

    @cached_property
    def _torque(self) -> float:
        return rms_torque(self.record)

    def needed(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """(m,) band-limited torque that the plant needs along the motion [N m]; arguments as for `replay`."""
        return plant.driven_inertia * self.accelerated(plant) - self.replay(plant, memory, grid)

    def accelerated(self, plant: Plant) -> Array:
        """(m,) band-limited acceleration, as the plant's sensor tells it [rad/s^2]."""
        return self.seen_by(plant).acceleration

    def look(self, plant: Plant, memory: Array | None = None) -> tuple[Array, Grid]:
        """What `needed` says, and the instants that it took."""
        mean, instants = self.seen_by(plant)._mean(plant.joint(), memory)
        replayed = self.band(mean) - self.rigid
        return plant.driven_inertia * self.accelerated(plant) - replayed, Grid(instants)
