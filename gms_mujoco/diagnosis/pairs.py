"""Two effects at once, of which neither stands out while the other is missing."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import NamedTuple

from ..effect import Effect
from ..fit_result import FitResult
from ..identification.held_out import HeldOut, p_value
from ..identification.linear_model import cross_validated
from ..identification.refine import refine
from ..identification.screen import Candidate, Screen
from .joint_fits import JointFits, Rough
from .judgement import LEAST_GAIN, Trial, carries, discoveries, floor_of, takes, without
from .steps import Step
from .trials import p_beside


class _Pair(NamedTuple):
    """Two effects that may belong together.

    Attributes:
        first: the name of the one that is fitted first.
        other: the one that is then added.
        left: what both leave of each block, linearly.
        p_value: that they leave no less than either alone.
    """

    first: str
    other: Candidate
    left: HeldOut
    p_value: float

    @property
    def label(self) -> str:
        return f"{self.first} and {self.other.effect.name}"

    @property
    def unknowns(self) -> int:
        """Of the second, in a linear refit."""
        return 0 if self.other.columns is None else self.other.columns.shape[1]


class TwoAtOnce:
    """Looks for two effects at once.

    Args:
        now: the current plant.
        fits: of it with more effects.
        screen: of it.
        rough: joint fits with one effect; of each the first is gone on with.
        trials: whole fits with some of them.
        p_values: of each effect alone.
        selects: whether records that are kept for it agree with a fit.
    """

    def __init__(
        self, now: FitResult, fits: JointFits, screen: Screen, rough: Sequence[Rough], trials: Sequence[Trial],
        p_values: dict[str, float], selects: Callable[[FitResult], bool],
    ) -> None:  # fmt: skip
        self.now, self.fits, self.screen, self.rough, self.trials = now, fits, screen, rough, trials
        self.p_values, self.selects = dict(p_values), selects

    def of(self, candidates: Sequence[Candidate]) -> tuple[Step, Step] | None:
        """A step with each of two of the candidates, in order; None where no two earn it.

        Each must earn its place beside the other. Every two that are looked at count among the discoveries.
        """
        pairs = []
        for both in itertools.combinations(candidates, 2):
            alone, other = sorted(both, key=lambda c: c.held_out.total)
            left = self.screen.together(alone, other)
            pairs.append(_Pair(alone.effect.name, other, left, max(p_value(c.held_out, left) for c in both)))
        return self._best_of(pairs, {c.effect.name: c.held_out.total for c in candidates})

    def beside(self, trial: Trial, addable: Sequence[type[Effect]]) -> tuple[Step, Step] | None:
        """The same of an effect whose whole fit leaves much less of some records, and surely of none, and one more of
        those that could be added: what a second effect does shows where a strong first one has its place."""
        if not takes(self.screen.held_out.total, trial.held_out.total, floor_of(self.now)):
            return None
        result = trial.result
        others = Screen(result.misfit, result.vector).candidates([e for e in addable if e.name not in result.plant])
        before = (trial.held_out, self.screen.held_out)
        pairs = [
            _Pair(trial.name, c, c.held_out, max(p_value(left, c.held_out) for left in before)) for c in others
        ]
        return self._best_of(pairs, {trial.name: trial.held_out.total})

    def _best_of(self, pairs: Sequence[_Pair], alone: dict[str, float]) -> tuple[Step, Step] | None:
        """The two that leave least of those that may earn it, where they do; of several that leave about as much those
        of which the second has fewest unknowns. `alone` is what the first of each leaves."""
        self.p_values |= {pair.label: pair.p_value for pair in pairs}
        passed, floor = discoveries(self.p_values), floor_of(self.now)
        worth = [p for p in pairs if p.label in passed and takes(alone[p.first], p.left.total, floor)]
        if not worth:
            return None
        least = min(p.left.total for p in worth)
        close = [p for p in worth if p.left.total - least <= LEAST_GAIN * p.left.total]
        return self._earned(min(close, key=lambda p: (p.unknowns, p.left.total)))

    def _earned(self, pair: _Pair) -> tuple[Step, Step] | None:
        """A step with each of two effects, fitted jointly, where each earns its place beside the other."""
        first, second = pair.first, pair.other.effect.name
        result = self.fits.best(self.fits.to_end(*self.fits.roughly(self._whole(first)[0], pair.other)))
        for name in (first, second):
            result = self.fits.anew(name, result)
        held_out = cross_validated(result.misfit, result.vector)
        singles = []
        for name, left in ((first, second), (second, first)):
            single = min([*self._whole(name), refine(*without(result, left))], key=attrgetter("error"))
            singles.append(Trial(name, single, cross_validated(single.misfit, single.vector)))
        beside = list(zip(singles, (second, first), strict=True))
        p_second, p_first = (p_beside(s.result, s.held_out, Trial(n, result, held_out)) for s, n in beside)
        floor = min(floor_of(self.now), floor_of(result))
        earned = (
            pair.label in discoveries(self.p_values | {pair.label: max(p_first, p_second)})
            and all(takes(s.held_out.total, held_out.total, floor) for s in singles)
            and all(carries(n, s.result, result) for s, n in beside)
            and self.selects(result)
        )
        if not earned:
            return None
        return (
            Step(first, singles[0].result, None, (), p_first, singles[0].held_out),
            Step(second, result, None, (), p_second, held_out),
        )

    def _whole(self, name: str) -> list[FitResult]:
        """A whole fit with one effect, where one was tried."""
        known = [t.result for t in self.trials if t.name == name]
        begun = (self.fits.to_end(misfit, x) for n, misfit, x in self.rough if n == name)
        return known[:1] or list(itertools.islice(begun, 1))
