"""Grid: the instants between which the torque along a motion is taken as straight, samples and some between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..native import series
from ..recent import kept
from ..record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """A motion at the instants of a grid: what `native.Joint.replay` takes."""

    time: Array
    position: Array
    velocity: Array
    load: Array | None
    temperature: Array | None

    def torque(self, joint: native.Joint, memory: Array | None = None) -> Array:
        """(N,) torque at the instants [N m]."""
        return joint.replay(self.time, self.position, self.velocity, self.load, self.temperature, memory).torque

    def elements(self, joint: native.Joint, effect: int, memory: Array | None = None) -> Array:
        """(N, elements) torque of each element of one effect at the instants [N m]."""
        return joint.elements(effect, self.time, self.position, self.velocity, self.load, self.temperature, memory)

    def changes(
        self, joints: Sequence[native.Joint], memories: Sequence[Array] | None, band: series.Band, effect: int,
        apart: int,
    ) -> Array:  # fmt: skip
        """What `series.changes` says of this motion."""
        motion = self.time, self.position, self.velocity, self.load, self.temperature
        return series.changes(joints, *motion, memories, band, effect, apart)


@dataclass(frozen=True, eq=False)
class Grid:
    """Instants at which torques are evaluated.

    On a grid that is set once a torque is a smooth function of the parameters, as its derivatives need it to be; found
    anew for each set of parameters it would jump with every instant that comes or goes.

    Attributes:
        instants: (N,) in samples from the first, rising, every sample among them.
    """

    instants: Array
    _paths: dict[int, tuple[Array, Path]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def _place(self) -> tuple[NDArray[np.intp], Array]:
        """(N,) the sample before each instant (the last but one for the last), and the part of a sample since."""
        before = np.minimum(self.instants.astype(int), int(self.instants[-1]) - 1)
        return before, self.instants - before

    def path(self, record: Record, position: Array, velocity: Array) -> Path:
        """The motion of these positions and velocities (n,), cubic between samples; other signals run straight."""
        # What is kept holds its positions, so that none has the address of another.
        return kept(self._paths, id(position), lambda: (position, self._path(record, position, velocity)))[1]

    def _path(self, record: Record, position: Array, velocity: Array) -> Path:
        k, u = self._place
        h, w = record.sample_time, 1 - u
        moved, a, b = position[k + 1] - position[k], velocity[k], velocity[k + 1]
        place = position[k] + u * u * (3 - 2 * u) * moved + h * u * w * (w * a - u * b)
        speed = 6 * u * w * moved / h + w * (1 - 3 * u) * a + u * (3 * u - 2) * b
        load, temperature = (
            None if x is None else w * x[k] + u * x[k + 1] for x in map(record.get, ("load", "temperature"))
        )
        return Path(w * record.time[k] + u * record.time[k + 1], place, speed, load, temperature)

    def mean(self, torque: Array) -> Array:
        """(n, ...) what `native.Joint.mean` says of torques (N, ...) that run straight between the instants."""
        return series.mean(self.instants, torque)


@dataclass(frozen=True, eq=False)
class Sparse(Grid):
    """The first two samples and every so many after them.

    Attributes:
        kernel: (taps,) weights of the torques at `taps` instants in a row, from the second on, in a band-limited value.
        stride: instants from one band-limited value to the next.
    """

    kernel: Array
    stride: int

    def band(self, torque: Array, count: int) -> Array:
        """(count,) or (columns, count) band-limited values of torques (N,) or (N, columns) at the instants."""
        return series.band(torque, self.kernel, 1, self.stride, count)
