"""Work on several observations at a time: the native library and most of NumPy let other threads run meanwhile.

Results come in the order of what they are made of, and nothing is summed across threads, so the number of threads
changes no bit of them.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from functools import cache
from typing import TypeVar

from threadpoolctl import threadpool_limits

from .errors import GmsError

_In = TypeVar("_In")
_Out = TypeVar("_Out")

VARIABLE = "GMS_MUJOCO_THREADS"
_inside = threading.local()


def count() -> int:
    """How many threads to use: the environment variable GMS_MUJOCO_THREADS, else the cores this process may use.

    Raises:
        GmsError: the variable is not a whole number from 1 on.
    """
    given = os.environ.get(VARIABLE, "").strip()
    if not given:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not given.isdecimal() or int(given) < 1:
        raise GmsError(f"{VARIABLE} must be a whole number from 1 on; {given!r} given")
    return int(given)


def at_hand() -> int:
    """How many threads `each` uses here: one on a thread that is at work for it already."""
    return 1 if getattr(_inside, "busy", False) else count()


@cache
def _pool(n: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(n, "gms_mujoco")


@contextmanager
def alone() -> Iterator[None]:
    """Whatever is done inside stays on this thread: for work of which there is one on every core already."""
    before, _inside.busy = getattr(_inside, "busy", False), True
    try:
        yield
    finally:
        _inside.busy = before


_limited = threading.Lock()
_limits: list[threadpool_limits] = []
_inside_limit = 0


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keeps products of matrices to one thread: in a fit those of a BLAS wait for each other longer than they
    work."""
    global _inside_limit
    with _limited:
        if not _inside_limit:
            _limits.append(threadpool_limits(1, user_api="blas"))
        _inside_limit += 1
    try:
        yield
    finally:
        with _limited:
            _inside_limit -= 1
            if not _inside_limit:  # the last of those at work puts back what the first has found
                _limits.pop().restore_original_limits()


def each(function: Callable[[_In], _Out], items: Iterable[_In]) -> list[_Out]:
    """function(item) of every item, in their order; one after the other where this runs on such a thread already.

    The thread that asks works too: what is done before another wakes has not waited for it.
    """
    todo = list(items)
    n = min(len(todo), at_hand())
    if n < 2:
        return [function(item) for item in todo]
    left, out = deque(range(len(todo))), {}

    def work() -> None:
        with alone():
            while left:
                try:
                    at = left.popleft()
                except IndexError:  # another was faster
                    return
                out[at] = function(todo[at])

    pool = _pool(n - 1, os.getpid())  # threads do not survive a fork
    others = [pool.submit(copy_context().run, work) for _ in range(n - 1)]
    try:
        work()
    finally:
        left.clear()
        for other in others:
            if not other.cancel():
                other.result()
    return [out[at] for at in range(len(todo))]
