"""Series of samples, in the native library: means of a torque around each, what a low-pass leaves of them, and how that
changes with parameters."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import effort
from .joint import Joint
from .shared_library import library

Array = NDArray[np.float64]

_TOGETHER = 16  # joints that the library takes along at once


@dataclass(frozen=True)
class Band:
    """What band-limited values are made of a torque at the instants of a motion.

    Attributes:
        kernel: (taps,) weights.
        first, stride, count: where the first of the values begins, the next, and how many there are.
        instants: (N,) in samples from the first: the weights are of means around the samples; None: of the torques.
        asked: (n,) by which each sample is multiplied; None: by 1.
    """

    kernel: Array
    first: int
    stride: int
    count: int
    instants: Array | None = None
    asked: Array | None = None


def mean(instants: Array, torque: Array) -> Array:
    """Mean around each sample, with a weight that falls linearly to zero at the samples beside it.

    Args:
        instants: (N,) in samples from the first, rising, every sample among them, contiguous.
        torque: (N,) or (N, columns), straight between the instants.

    Returns:
        (n,) or (n, columns); at the first and the last sample the torque itself.
    """
    torque = np.ascontiguousarray(torque, float)
    assert len(torque) == len(instants)
    out = np.empty((int(instants[-1]) + 1, *torque.shape[1:]))
    columns = 1 if torque.ndim == 1 else torque.shape[1]
    library.gms_series_mean(len(instants), instants.ctypes.data, columns, torque.ctypes.data, out.ctypes.data)
    return out


def band(x: Array, kernel: Array, first: int, stride: int, count: int) -> Array:
    """Series (n,) or (n, columns) weighted by a kernel (taps,) from row `first` on, and again every `stride` rows.

    Returns:
        (count,) or (columns, count).
    """
    x = np.ascontiguousarray(x, float)[first:]
    assert len(x) >= stride * (count - 1) + len(kernel)
    columns = 1 if x.ndim == 1 else x.shape[1]
    out = np.empty((*x.shape[1:], count))
    library.gms_series_band(len(kernel), kernel.ctypes.data, stride, count, columns, x.ctypes.data, out.ctypes.data)
    return out


def changes(
    joints: Sequence[Joint],
    time: Array,
    position: Array,
    velocity: Array,
    load: Array | None,
    temperature: Array | None,
    memories: Sequence[Array] | None,
    band: Band,
    effect: int = 0,
    apart: int = 0,
) -> Array:
    """Band-limited differences of the torques of joints with the same effects from that of the first, along one motion.

    Args:
        joints: (j,).
        time, position, velocity, load, temperature: as for `Joint.replay`, (N,) each, contiguous.
        memories: (j,) state of each before the first instant; None: never moved.
        effect: number of a separable effect.
        apart: joints after the first of which the torque of each element of that effect is asked for, not the whole.

    Returns:
        (apart * elements + j - 1 - apart, count) [N m].
    """
    here = joints[0]
    effort.add((len(joints) - 1) * len(time) * here.work)  # however many calls they are shared out to
    out = np.empty((apart * here.counts[effect] + len(joints) - 1 - apart if apart else len(joints) - 1, band.count))
    motion = [None if a is None else a.ctypes.data for a in (time, position, velocity, load, temperature)]
    instants, asked = (None if a is None else a.ctypes.data for a in (band.instants, band.asked))
    done = 0
    for begin in range(1, len(joints), _TOGETHER - 1):
        some = [0, *range(begin, min(begin + _TOGETHER - 1, len(joints)))]
        handles = (ctypes.c_void_p * len(some))(*(joints[j].handle for j in some))
        memory = None if memories is None else np.array([memories[j] for j in some], float)
        split = min(max(apart + 1 - begin, 0), len(some) - 1)
        library.gms_joints_changes(
            handles, len(some), effect, split, len(time), *motion, None if memory is None else memory.ctypes.data,
            instants, asked, len(band.kernel), band.kernel.ctypes.data, band.first, band.stride, band.count,
            out[done:].ctypes.data,
        )  # fmt: skip
        done += split * here.counts[effect] + len(some) - 1 - split
    return out
