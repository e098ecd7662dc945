"""What an axis has been through, along records: what fades, and what follows late."""

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


def following(signals: Sequence[Array], sample_times: Sequence[float], rates: Array) -> list[Array]:
    """(n, k) of each record: what follows a signal by at most each of k rates, from where that begins.

    A body that friction carries along follows the velocity by at most an acceleration, a drive with a slew limit the
    torque that is asked for.

    Args:
        signals: (n,) of each record.
        sample_times: of each [s].
        rates: (k,) [unit of the signals / s].
    """
    long = max(map(len, signals))
    followed = np.stack([np.pad(x, (0, long - len(x))) for x in signals], 1)[:, :, None]  # all records at once
    most = np.multiply.outer(np.asarray(sample_times), rates)
    now, states = np.broadcast_to(followed[0], most.shape), np.empty((long, *most.shape))
    for i in range(long):
        states[i] = now = np.clip(followed[i], now - most, now + most)
    return [states[: len(x), k] for k, x in enumerate(signals)]
