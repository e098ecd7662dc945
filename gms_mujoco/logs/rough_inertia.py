"""What measurements roughly say of an axis by a straight least squares: its inertia, and what friction takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frf import FRF
from ..identification.inverse import Observation
from ..plant import Plant
from ..record import Record

Array = NDArray[np.float64]

_FEWEST = 64  # samples of a record that is looked at
_BAND = 20.0  # samples of a period that is followed
_SAYS_TOO_LITTLE = 0.7  # of the torque (rms), that what was found leaves
_NO_POWER = 0.1  # of the power that goes in and out, that friction takes or gives by chance
_LARGE = 0.2  # of the torque (rms), that is an inertia's: of less its size is not told
_FAR = 0.5  # of how much responses differ, that is left where they do not look like an inertia


class RoughInertia(NamedTuple):
    """What records roughly say.

    Attributes:
        inertia: [kg m^2] or [kg]; negative where a torque of the wrong sign says so, or a spring.
        power: that friction takes [W]; 0 where it is little beside what goes in and out.
        share: of inertia in the torque (rms).
    """

    inertia: float
    power: float
    share: float

    @property
    def is_told(self) -> bool:
        """Whether a good part of the torque is an inertia's, or a spring's."""
        return self.share > _LARGE


class Rows(NamedTuple):
    """A record as the least squares takes it: columns (m, 7), torque (m,) and velocity (m,)."""

    columns: Array
    torque: Array
    velocity: Array


def rows_of(record: Record) -> Rows | None:
    """The rows of a record; None of one that is too short."""
    if len(record) < _FEWEST:
        return None
    bare = Plant.axis(1.0)
    o = Observation(record, 1 / (_BAND * record.sample_time))
    q, v = o.position[o.index], o.velocity[o.index]
    columns = np.stack([o.acceleration, np.sign(v), v, np.ones_like(v), q, np.sin(q), np.cos(q)], 1)
    return Rows(columns, o.applied(bare) + o.replay(bare), v)  # without what a robot's rigid bodies take


def rough_inertia(rows: Sequence[Rows]) -> RoughInertia | None:
    """The inertia of the axis that records are of; None where they say too little.

    By least squares of the torque on acceleration, direction, velocity and what a position alone determines.
    """
    if not rows:
        return None
    a, y, v = (np.concatenate(part) for part in zip(*rows, strict=True))
    scale = np.maximum(np.sqrt(np.mean(a**2, 0)), 1e-300)
    x = np.linalg.lstsq(a / scale, y, rcond=1e-6)[0] / scale
    friction = x[1] * np.sign(v) + x[2] * v
    total = float(np.sqrt(np.mean(y**2)))
    if total == 0 or float(np.std(y - a @ x)) > _SAYS_TOO_LITTLE * total:
        return None
    power = float(np.mean(friction * v))
    if abs(power) < _NO_POWER * float(np.mean(np.abs(y * v))):
        power = 0.0
    return RoughInertia(float(x[0]), power, abs(float(x[0])) * float(scale[0]) / total)


def rough_inertia_of(records: Sequence[Record]) -> float | None:
    """The same of records, the inertia alone."""
    found = rough_inertia([rows for r in records if (rows := rows_of(r)) is not None])
    return found.inertia if found else None


def rough_inertia_of_responses(frfs: Sequence[FRF]) -> float | None:
    """Rough inertia, where it takes a good part of the torque: torque over position as an inertia, and a spring that is
    another in each response; None where they do not look like that."""
    used = [f.compliance() for f in frfs if f.input in ("torque", "load")]
    if not used:
        return None
    inverse = np.concatenate([1 / f.response for f in used])
    mass = np.concatenate([f.omega**2 for f in used])
    owner = np.repeat(np.arange(len(used)), [len(f) for f in used])
    columns = np.column_stack([-mass, *(owner[:, None] == np.arange(len(used))).T]) / np.abs(inverse)[:, None]
    target = inverse.real / np.abs(inverse)
    scale = np.maximum(np.sqrt(np.mean(columns**2, 0)), 1e-300)
    x = np.linalg.lstsq(columns / scale, target, rcond=1e-6)[0] / scale
    left = float(np.std(target - columns @ x))
    if len(target) <= len(x) or x[0] <= 0 or x[0] * scale[0] < _LARGE or left > _FAR * float(np.std(target)):
        return None
    return float(x[0])
