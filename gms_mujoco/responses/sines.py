"""Sines that were commanded, and what a plant makes of the motion at each: the arithmetic of `frf_observation`.

Every effect is replayed along the periodic motion of a point until it is steady; the first harmonic of the torque is
what counts (Gelb and Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, 1968).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect, passed
from ..identification.grid import Grid
from ..native import Joint
from ..plant import Plant
from ..recent import kept
from .harmonics import SAMPLES, fundamental, motion, velocity

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MOST_PERIODS = 256  # until a drive effect has come to rest


class Sines(ABC):
    """Points at which a joint moved as `size` sin(w t) while the torque was `torque`, with some harmonics.

    Rows stand in pairs, real and imaginary part relative to the phase of the motion, point after point.
    """

    has_memory = False  # in the steady state the beginning is forgotten
    skews = False  # its phase was estimated with torque and position on one clock
    typical_torque = None  # what is applied is one
    temperature = None  # nobody says
    additive = True  # what an effect needs does not depend on the others
    jumps = False  # a motion in closed form has no samples between which an element just slips or just does not
    sparse = None

    @property
    @abstractmethod
    def frequency(self) -> Array:
        """(n,) [Hz]."""

    @property
    @abstractmethod
    def size(self) -> Array:
        """(n,) amplitude of the position [rad]."""

    @property
    @abstractmethod
    def torque(self) -> Complex:
        """(n,) torque commanded, in the phase of the motion: of a held one what acts like a continuous one [N m]."""

    @property
    @abstractmethod
    def weight(self) -> Array:
        """(n,) by which a torque becomes a row."""

    @property
    @abstractmethod
    def extra(self) -> Complex | None:
        """(n, orders) harmonics of the motion, in the phase of its fundamental [rad]."""

    @cached_property
    def omega(self) -> Array:
        """(n,) [rad/s]."""
        return 2 * math.pi * self.frequency

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(2 n,) the rows."""
        return np.arange(2 * len(self.frequency))

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        """(n, samples) the motion and its velocity over one period."""
        return motion(self.size, self.omega, self.extra)

    @property
    def position(self) -> Array:
        """(n samples,) of the motions, one after the other [rad]."""
        return self._waves[0].ravel()

    @property
    def velocity(self) -> Array:
        """(n samples,) [rad/s]."""
        return self._waves[1].ravel()

    @property
    def commands(self) -> Array:
        """(n samples,) torque commanded over one period of each point [N m]."""
        return np.outer(np.abs(self.torque), np.cos(2 * math.pi * np.arange(SAMPLES) / SAMPLES)).ravel()

    def _rows(self, x: Complex) -> Array:
        """(..., 2 n) rows that stand for torques (..., n)."""
        return np.ascontiguousarray(x * self.weight).view(float)

    def complex(self, rows: Array) -> Complex:
        """(n,) the torques that rows (2 n,) stand for [N m]."""
        pairs = rows.reshape(-1, 2)
        return np.asarray((pairs[:, 0] + 1j * pairs[:, 1]) / self.weight, complex)

    @cached_property
    def acceleration(self) -> Array:
        """(2 n,) rows of the acceleration."""
        return self._rows((-self.omega**2 * self.size).astype(complex))

    def applied(self, plant: Plant, skew: float = 0.0) -> Array:
        """(2 n,) rows of the torque that the drive of `plant` delivered."""
        return self._rows(self.torque * self.drive_response(plant))

    def drive_response(self, plant: Plant) -> Complex:
        """(n,) fundamental that the drive delivers over that commanded."""
        if not plant.drive:
            return np.ones(len(self.frequency), complex)
        return kept(self._delivered, plant.drive, lambda: self._deliver(plant.drive))

    @cached_property
    def _delivered(self) -> dict[tuple[Effect, ...], Complex]:
        return {}

    def _deliver(self, drive: tuple[Effect, ...]) -> Complex:
        out = np.empty(len(self.frequency), complex)
        for i, (f, size) in enumerate(zip(self.frequency, np.abs(self.torque), strict=True)):
            periods, last = 2, 0j
            while periods <= _MOST_PERIODS:
                phase = np.arange(SAMPLES * periods) / SAMPLES
                torque = size * np.cos(2 * math.pi * phase)
                for effect in drive:
                    torque = passed(effect, "deliver", phase / f, torque)
                found = complex(fundamental(torque[None, -SAMPLES:])[0]) / size
                if abs(found - last) < 1e-6:
                    break
                periods, last = 2 * periods, found
            out[i] = found
        return out

    def _read(self, plant: Plant) -> tuple[Array, Array, Complex]:
        """Motion, velocity and fundamental of where the joint was, given the sensor effects of the plant."""
        sensors = [e for e in plant.effects if e.kind == "sensor"]
        position, rate = self._waves
        if not sensors:
            return position, rate, self.size.astype(complex)
        at = np.empty_like(position)
        for i, f in enumerate(self.frequency):
            at[i] = position[i]
            for effect in reversed(sensors):
                at[i] = passed(effect, "correct", np.arange(SAMPLES) / (SAMPLES * f), at[i])
        spectrum = np.fft.rfft(at, axis=1)
        return at, velocity(spectrum, self.omega), fundamental(at)

    def effects_torque(self, plant: Plant) -> Complex:
        """(n,) fundamental of the torque of the effects along the motion [N m]."""
        if not any(e.is_native for e in plant.effects):
            return np.zeros(len(self.frequency), complex)
        position, rate, _ = self._read(plant)
        return fundamental(plant.joint().cycle(1 / self.frequency, position, rate))

    def along(self, plant: Plant, torque: Callable[[Array, Array], Array]) -> Array:
        """(2 n,) rows of a torque that follows from position and velocity, (samples,) each of one period."""
        position, rate, _ = self._read(plant)
        return self._rows(fundamental(np.stack([torque(q, v) for q, v in zip(position, rate, strict=True)])))

    def elements(
        self, plant: Plant, joint: Joint, effect: int, memory: Array | None = None, grid: Grid | None = None
    ) -> Array:
        """(elements, 2 n) rows of the torque of each element of an effect of `joint`, on the motion that `plant` sees.

        Args:
            effect: its number in the joint.
        """
        position, rate, _ = self._read(plant)
        return self._rows(fundamental(joint.cycle(1 / self.frequency, position, rate, effect)).T)

    def changes(
        self, plant: Plant, joints: Sequence[Joint], memories: Sequence[Array | None], grid: Grid | None = None,
        effect: int = 0, apart: int = 0,
    ) -> Array:  # fmt: skip
        """Rows of the differences of the torques of joints with the same effects from that of the first, of each of the
        first `apart` after it by the elements of an effect."""
        position, rate, _ = self._read(plant)

        def rows(joint: Joint, number: int | None) -> Array:
            found = fundamental(joint.cycle(1 / self.frequency, position, rate, number))
            return self._rows(found[None] if number is None else found.T)

        split, whole = joints[1 : apart + 1], joints[apart + 1 :]
        out, base = [np.empty((0, len(self.index)))], None
        if split:
            base = rows(joints[0], effect)
            out += [rows(joint, effect) - base for joint in split]
        if whole:
            if base is not None and joints[0].n_effects == 1:
                base = base.sum(0, keepdims=True)
            else:
                base = rows(joints[0], None)
            out += [rows(joint, None) - base for joint in whole]
        return np.concatenate(out)

    def accelerated(self, plant: Plant) -> Array:
        """(2 n,) rows of the acceleration, as the plant's sensor tells it."""
        return self._rows(-(self.omega**2) * self._read(plant)[2])

    def grid(self, plant: Plant, memory: Array | None = None, finer: float = 1.0) -> None:
        """None: a motion in closed form has no samples."""
        return None

    def look(self, plant: Plant, memory: Array | None = None) -> tuple[Array, None]:
        """What `needed` says."""
        return self.needed(plant), None

    def replay(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """(2 n,) rows of the torque of the effects along the motion."""
        return self._rows(self.effects_torque(plant))

    def needed(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """(2 n,) rows of the torque that the plant needs along the motion."""
        return self._rows(self.needed_torque(plant))

    def needed_torque(self, plant: Plant) -> Complex:
        """(n,) fundamental of the torque that the plant needs along the motion [N m]."""
        at = self._read(plant)[2]
        return np.asarray(-plant.driven_inertia * self.omega**2 * at - self.effects_torque(plant), complex)
