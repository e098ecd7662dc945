"""A few results kept by what they were worked out for."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

_FEW = 5  # a fit tries many, one after another and a few at a time


def kept(known: dict[K, V], key: K, make: Callable[[], V]) -> V:
    """The result for a key, worked out where it is not known; those for others are forgotten once they are many.

    Args:
        known: results so far, no None among them.
        key: what the result depends on.
        make: works it out.
    """
    found = known.get(key)
    if found is None:
        found = make()
        if len(known) >= _FEW:
            known.clear()
        known[key] = found
    return found
