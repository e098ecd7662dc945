"""How far a search goes before it ends with what it has found."""

from __future__ import annotations

import math

from ..effort import Effort, counted
from ..fit_result import FitResult
from ..identification.misfit import Misfit

_SHORT = 3_000  # replays of the first plant, after which a search follows what it sees alone
_AT_END = 6_000  # after which it looks for nothing more
_LEAST = 1_150_000  # of effort, of a replay: as of ten records of 6 s at 1 kHz


class Patience:
    """What one diagnosis may take, beside what it has taken so far.

    The first plant tells in some hundred replays along all records whether anything is missing, and most effects are
    found in one or two thousand. What takes many times as much is friction of no law that is known, or effects of no
    catalogue: the search tries one way after another, and most of them lead nowhere. Of what is little, as of responses
    alone, a replay is nearly free, and counts as if there were more of it.

    Args:
        effort: times the usual limits; infinite: there are none.
        spent: what has been done, and goes on to be counted.

    Attributes:
        cut: whether anything was left out.
    """

    def __init__(self, effort: float = math.inf, spent: Effort | None = None) -> None:
        self._effort, self._spent = effort, spent or Effort()
        self._replay = math.inf  # what the first plant takes along all records, in the unit of effort
        self._granted = 0
        self.cut = False

    def begin(self, first: FitResult) -> None:
        """Takes the first plant for what a replay is, where none was taken before."""
        if math.isfinite(self._replay) or math.isinf(self._effort):
            return
        with counted() as once:
            Misfit(first.plant, first.misfit.observations).cost(first.vector)
        self._replay = max(once.spent, _LEAST)

    def grant(self) -> None:
        """Lets a search that promises much, and begins late, go as far as one may that begins at once."""
        self._granted += _SHORT

    @property
    def is_short(self) -> bool:
        """Whether nothing is to be tried from the beginning any more, and no way that was not taken; `cut` is set then:
        it is asked where there is something to try."""
        return self._beyond(_SHORT)

    @property
    def is_at_end(self) -> bool:
        """Whether no effect and no law is to be looked for any more, and nothing to be compared with what was found; as
        above."""
        return self._beyond(_AT_END)

    @property
    def said(self) -> str:
        """A sentence on what was left out."""
        return (
            "The search has come to the limit of its work, with ways left that it did not try: effort = "
            f"{4 * self._effort:g} lets it go on for four times as long"
        )

    def _beyond(self, replays: float) -> bool:
        over = self._spent.spent > self._effort * (replays + self._granted) * self._replay
        self.cut |= over
        return over
