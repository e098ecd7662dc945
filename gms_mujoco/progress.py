"""A progress bar on one line of a terminal; silent where nobody watches."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from typing import TextIO

Progress = Callable[[float, str], None]  # share done in 0..1, what is being done

_WIDTH = 24
_REDRAW = 0.1  # s


def silent(done: float, message: str = "") -> None:
    """Tells nobody."""


def part(report: Progress, begin: float, end: float, name: str = "") -> Progress:
    """What a part of the work reports to, whose own share runs from 0 to 1.

    Args:
        report: of the whole.
        begin, end: shares of the whole at which the part begins and ends.
        name: of the part, before each of its messages.
    """
    return lambda done, message: report(begin + done * (end - begin), f"{name}: {message}" if name else message)


class Bar:
    """Called with (share done in 0..1, message); a context manager that clears its line at the end.

    Args:
        stream: where it draws, by default stderr.
        force: draw also where the stream is no terminal.
    """

    def __init__(self, stream: TextIO | None = None, force: bool = False) -> None:
        self._stream = stream or sys.stderr
        self._shown = force or self._stream.isatty()
        self._start = self._last = time.monotonic()
        self._drawn = False

    def __enter__(self) -> Bar:
        return self

    def __call__(self, done: float, message: str = "") -> None:
        now = time.monotonic()
        if not self._shown or (self._drawn and now - self._last < _REDRAW and done < 1):
            return
        self._last, self._drawn = now, True
        done = min(max(done, 0.0), 1.0)
        filled = round(_WIDTH * done)
        text = f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {100 * done:3.0f} %  {now - self._start:4.0f} s  {message}"
        self._stream.write("\r" + text[: shutil.get_terminal_size().columns - 1] + "\x1b[K")
        self._stream.flush()

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
