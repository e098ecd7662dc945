"""What lies between samples: means around each, of torques that hold, were read or run straight; second differences.

Two neighbouring samples of a position see the torque through a triangular weight, see `inverse`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..plant import Plant
from ..record import Record

Array = NDArray[np.float64]


def held_mean(u: Array) -> Array:
    """Triangular mean of a torque held from sample to sample: (u[k-1] + u[k]) / 2."""
    out = u.copy()
    out[1:] = 0.5 * (u[1:] + u[:-1])
    return out


def read_mean(u: Array) -> Array:
    """Triangular mean of a torque that was read at the samples: (u[k-1] + 10 u[k] + u[k+1]) / 12."""
    out = u.copy()
    out[1:-1] = (u[:-2] + 10 * u[1:-1] + u[2:]) / 12
    return out


def moved(x: Array, rows: int) -> Array:
    """What a series (n, ...) will be so many rows later, or was where that is less than 0."""
    here = np.clip(np.arange(len(x)) + rows, 0, len(x) - 1)
    return x[here] if rows else x


def rms_torque(record: Record) -> float:
    """Root mean square of the torque of a record [N m]."""
    return float(np.sqrt(np.mean(record.torque**2)))


def mean_torque(record: Record, torque: Array | None = None) -> Array:
    """Triangular mean of the torque of a record, or of another that comes in the same way [N m]."""
    u = record.torque if torque is None else torque
    return read_mean(u) if record.sensed else held_mean(u)


def delivered(plant: Plant, record: Record, parts: int) -> Array:
    """(parts * n,) mean torque that the drive of a plant delivered over each of so many parts of a sample [N m]."""
    return plant.delivered(record.held(parts), record.sample_time / parts, 1)


def smooth_mean(f: Array) -> Array:
    """Triangular mean of a torque that varies linearly between samples."""
    out = f.copy()
    out[1:-1] = (f[:-2] + 4 * f[1:-1] + f[2:]) / 6
    return out


def second_difference(q: Array, h: float) -> Array:
    """(q[k+1] - 2 q[k] + q[k-1]) / h^2, zero at both ends [rad/s^2]."""
    out = np.zeros_like(q)
    out[1:-1] = (q[2:] - 2 * q[1:-1] + q[:-2]) / h**2
    return out
