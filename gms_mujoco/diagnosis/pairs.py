"""Two effects at once, of which neither stands out while the other is missing."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from operator import attrgetter

from ..fit_result import FitResult
from ..identification.held_out import HeldOut, p_value
from ..identification.linear_model import cross_validated
from ..identification.refine import refine
from ..identification.screen import Candidate, Screen
from .joint_fits import JointFits, Rough
from .judgement import Trial, carries, discoveries, floor_of, takes, without
from .steps import Step
from .trials import p_beside


def two_at_once(
    now: FitResult,
    fits: JointFits,
    screen: Screen,
    candidates: Sequence[Candidate],
    rough: Sequence[Rough],
    trials: Sequence[Trial],
    p_values: dict[str, float],
    selects: Callable[[FitResult], bool],
) -> tuple[Step, Step] | None:
    """A step with each of two effects, in order; None where no two earn it.

    Each must earn its place beside the other. Every two that are looked at count among the discoveries.

    Args:
        now: the current plant.
        fits: of it with more effects.
        screen: of it.
        candidates: to take them from.
        rough: joint fits with them; of each the first is gone on with.
        trials: whole fits with some of them.
        p_values: of each effect alone.
        selects: whether records that are kept for it agree with a fit.
    """
    found: dict[str, tuple[float, HeldOut, Candidate, Candidate]] = {}
    for one, other in itertools.combinations(candidates, 2):
        both, alone = screen.together(one, other), min((one, other), key=lambda c: c.held_out.total)
        p = max(p_value(c.held_out, both) for c in (one, other))
        found[f"{one.effect.name} and {other.effect.name}"] = p, both, alone, other if alone is one else one
    p_values = p_values | {k: p for k, (p, *_) in found.items()}
    passed = discoveries(p_values)
    floor = floor_of(now)
    worth = [
        (both.total, k, alone, other)
        for k, (_, both, alone, other) in found.items()
        if k in passed and takes(alone.held_out.total, both.total, floor)
    ]
    if not worth:
        return None
    _, label, alone, other = min(worth, key=lambda t: t[0])
    first, second = alone.effect.name, other.effect.name

    def whole(name: str) -> FitResult:
        known = [t.result for t in trials if t.name == name]
        return known[0] if known else next(fits.to_end(misfit, x) for n, misfit, x in rough if n == name)

    result = fits.best(fits.to_end(*fits.roughly(whole(first), other)))
    held_out = cross_validated(result.misfit, result.vector)
    singles = []
    for name, left in ((first, second), (second, first)):
        single = min(whole(name), refine(*without(result, left)), key=attrgetter("error"))
        singles.append(Trial(name, single, cross_validated(single.misfit, single.vector)))
    beside = list(zip(singles, (second, first), strict=True))
    p_second, p_first = (p_beside(s.result, s.held_out, Trial(n, result, held_out)) for s, n in beside)
    floor = min(floor, floor_of(result))
    earned = (
        label in discoveries(p_values | {label: max(p_first, p_second)})
        and all(takes(s.held_out.total, held_out.total, floor) for s in singles)
        and all(carries(n, s.result, result) for s, n in beside)
        and selects(result)
    )
    if not earned:
        return None
    return (
        Step(first, singles[0].result, None, (), p_first, singles[0].held_out),
        Step(second, result, None, (), p_second, held_out),
    )
