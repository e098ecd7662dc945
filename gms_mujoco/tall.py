"""Products of tall, narrow matrices.

In slices that a BLAS works off on one core: its threads cost more than they bring at these sizes, most of all where
other work shares the machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROWS = 64


def gram(a: Array, b: Array) -> Array:
    """a.T @ b for a (m, p) and b (m, q) or (m,)."""
    out = a[:0].T @ b[:0]
    for i in range(0, len(a), _ROWS):
        out = out + a[i : i + _ROWS].T @ b[i : i + _ROWS]
    return out


def times(a: Array, b: Array) -> Array:
    """a @ b for a (m, p) and b (p, q) or (p,)."""
    return np.concatenate([a[i : i + _ROWS] @ b for i in range(0, len(a), _ROWS)])


def squared(r: Array) -> float:
    """r @ r of a vector (m,)."""
    return float(np.einsum("i,i", r, r))
