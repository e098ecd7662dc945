"""What an axis has been through, along records: what fades, and a body that is carried along."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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

    def after(body: Array, v: Array, h: Array) -> Array:
        return np.asarray(np.clip(v, body - grips * h, body + grips * h))

    first = np.array([v[0] for v in velocities])[:, None]
    return _followed(velocities, sample_times, np.repeat(first, len(grips), 1), after)


def _followed(
    velocities: Sequence[Array], sample_times: Sequence[float], first: Array,
    after: Callable[[Array, Array, Array], Array],
) -> list[Array]:  # fmt: skip
    """(n, k) states along each record, all records at once, from the first (records, k) and what follows one where the
    axis moves at velocities (records, 1) for sample times (records, 1)."""
    long = max(map(len, velocities))
    v = np.stack([np.pad(x, (0, long - len(x))) for x in velocities], 1)[:, :, None]
    h, states = np.asarray(sample_times)[:, None], np.empty((long, *first.shape))
    for i in range(long):
        states[i] = first = after(first, v[i], h)
    return [states[: len(x), k] for k, x in enumerate(velocities)]
