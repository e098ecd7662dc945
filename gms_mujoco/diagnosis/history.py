"""What an axis has been through, along records: what fades, and a body that is carried along."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def way(velocity: Array, sample_time: float) -> Array:
    """(n,) that is gone since a record began, at velocities (n,) [rad or m]."""
    return np.asarray(np.abs(velocity).cumsum() * sample_time)


def faded(gone: Array, scales: Array) -> Array:
    """(n, k) of 1, that is left after so much of something has gone by (n,), where it fades over each of k scales."""
    return np.asarray(np.exp(-np.divide.outer(gone, scales)))


def carried(velocities: Sequence[Array], sample_times: Sequence[float], grips: Array) -> list[Array]:
    """(n, k) of each record: velocity of a body that friction carries along, by at most each of k accelerations.

    Args:
        velocities: (n,) of each record [rad/s or m/s].
        sample_times: of each [s].
        grips: (k,) friction over the inertia of the body [rad/s^2 or m/s^2].
    """
    long = max(map(len, velocities))
    v = np.stack([np.pad(x, (0, long - len(x))) for x in velocities], 1)[:, :, None]  # all records at once
    most = np.multiply.outer(np.asarray(sample_times), grips)
    body, states = np.broadcast_to(v[0], most.shape), np.empty((long, *most.shape))
    for i in range(long):
        states[i] = body = np.clip(v[i], body - most, body + most)
    return [states[: len(x), k] for k, x in enumerate(velocities)]
