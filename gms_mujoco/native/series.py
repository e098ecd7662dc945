"""Series of samples, in the native library: the mean of a torque around each, and what a low-pass leaves of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import library

Array = NDArray[np.float64]


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
