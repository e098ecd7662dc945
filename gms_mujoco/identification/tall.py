"""Products of tall, narrow matrices.

In slices that a BLAS works off on one core: its threads cost more than they bring at these sizes, most of all where
other work shares the machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROWS = 64  # at least
_WORK = 2**18  # products of a matrix with another, and
_WORK_OF_ONE = 2**13  # with a vector, that OpenBLAS works off on one core


def gram(a: Array, b: Array) -> Array:
    """a.T @ b for a (m, p) and b (m, q) or (m,)."""
    out = a[:0].T @ b[:0]
    rows = _rows(out.size, b)
    for i in range(0, len(a), rows):
        out = out + a[i : i + rows].T @ b[i : i + rows]
    return out


def times(a: Array, b: Array) -> Array:
    """a @ b for a (m, p) and b (p, q) or (p,)."""
    rows = _rows(b.size, b)
    return np.concatenate([a[i : i + rows] @ b for i in range(0, len(a), rows)])


def _rows(products: int, b: Array) -> int:
    """Rows of a slice, each so many products with a matrix or a vector."""
    return max((_WORK if b.ndim > 1 else _WORK_OF_ONE) // max(products, 1), _ROWS)


def squared(r: Array) -> float:
    """r @ r of a vector (m,)."""
    return float(np.einsum("i,i", r, r))
