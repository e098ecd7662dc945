"""Effort: how much was computed, counted alike on every machine and by any number of threads.

What fits and searches take their time for are effects that are followed from one instant to the next: their elements,
and what there is to do beside them, are the work that was done, to within a half or so of the time that it took.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class Effort:
    """Work that was done since it is counted.

    Attributes:
        spent: elements followed, times instants; what is no element counts as so many that take as long.
    """

    def __init__(self, around: Effort | None = None) -> None:
        self.spent = 0
        self._around = around
        self._counting = threading.Lock()

    def add(self, work: int) -> None:
        with self._counting:
            self.spent += work
        if self._around is not None:
            self._around.add(work)


_current: ContextVar[Effort | None] = ContextVar("effort", default=None)


@contextmanager
def counted() -> Iterator[Effort]:
    """Counts what is computed inside, also on the threads of `threads.each`; what is around it counts that too."""
    effort = Effort(_current.get())
    before = _current.set(effort)
    try:
        yield effort
    finally:
        _current.reset(before)


def add(work: int) -> None:
    """Says that so much work was done."""
    effort = _current.get()
    if effort is not None:
        effort.add(work)
