"""The whole of a search: the law of friction, the effects one after another, their order, and the paths not taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..identification.refine import CLOSE_TO_FLOOR
from ..progress import Progress, part, silent
from .friction_law import FrictionLaw
from .judgement import Trial, floor_of, leaves_much_less, left_of, simplest, takes
from .recheck import drop_false, drop_late, drop_ripple, drop_series, drop_shadows, exchange
from .search import MOST_EFFECTS, MOST_ROUNDS, Search
from .steps import Step

_HARDLY_MORE = 3.0  # times the squared error with an effect, that another may have left to be gone on with
_MOST_RIVALS = 2
_BEHIND = 4.0  # times the squared error of a search with no more effects: one that leaves more does not catch up
_SAME = 0.01  # relative difference of errors that a fit leaves of its own


class Way(NamedTuple):
    """How a search has come to where it is.

    Attributes:
        law: a sentence on the law of friction where it is another than the first; else empty.
        late: one on what was found last and taken away again; else empty.
        halted: whether it is not at its end.
    """

    law: str
    late: str = ""
    halted: bool = False


def _never(search: Search) -> bool:
    return False


def searched(
    search: Search, free: bool, report: Progress, instead_of: Search | None = None,
    halt: Callable[[Search], bool] = _never,
) -> Way:  # fmt: skip
    """Takes a search to its end, or to where it is to halt.

    The law is chosen, where it is free, and effects are added while they earn their place; then the order is checked.
    Where the noise floor is not reached that way others are gone, see `along_rivals`.

    Args:
        search: that has begun, or has not.
        free: whether the law of friction is.
        report: called with a share in 0..1 and a message.
        instead_of: one that has ended, in whose place this one has to leave much less; no other way is gone where the
            first does not.
        halt: asked of the first plant, of one with another law, and after each look for an effect; True where it is
            not to go on.
    """
    friction = FrictionLaw(search, free)
    if not search.steps:
        search.first(part(report, 0.0, 0.22, "baseline"))
        if halt(search):
            return Way(friction.said, halted=True)
    if _to_its_end(search, friction, part(report, 0.22, 0.82), halt=halt):
        return Way(friction.said, halted=True)
    leads = instead_of is None or leaves_much_less(instead_of.steps[-1].result, search.steps[-1].result)
    if leads and not (search.at_floor or search.quick or search.patience.is_short):
        friction = along_rivals(search, friction, part(report, 0.82, 1.0))
    drop_shadows(search)
    return Way(friction.said, drop_late(search) or drop_series(search) or drop_ripple(search))


def _to_its_end(
    search: Search, friction: FrictionLaw, report: Progress, most: int = MOST_EFFECTS,
    before_it: Sequence[Search] = (), halt: Callable[[Search], bool] = _never,
) -> bool:  # fmt: skip
    """Goes on to where nothing more earns its place, there are `most` effects, patience is at its end and neither has
    the last look taken most of what was left nor does another law of friction, or one of those before it has been or is
    far ahead; whether it was to halt before."""
    # With another law, or once it sees the log by another of its habits, a search begins anew, and so do its rounds.
    k, seen, said, leaps = 0, search.seen, friction.said, False
    while k < MOST_ROUNDS:
        k = k + 1 if search.seen is seen and friction.said == said else 1
        seen, said = search.seen, friction.said
        if any(_has_been(other, search.steps[-1]) or _is_ahead(other, search) for other in before_it):
            return False
        law = friction.better()
        at_end = k > 1 and not leaps and search.patience.is_at_end
        if at_end and (law is None or not leaves_much_less(search.steps[-1].result, law.result)):
            drop_false(search)
            return False
        if law is not None and (law.clear or at_end):  # beside what was found it may tell what no effect has
            friction.take(law)
            if halt(search):
                return True
            continue
        had_room, before = friction.has_room, list(search.steps)
        in_part = part(report, (k - 1) / MOST_ROUNDS, k / MOST_ROUNDS)
        added = len(search.steps) <= most and search.add_one(in_part, law.result if law else None)
        # What has just taken most may have uncovered what one look more takes the rest by.
        leaps = not search.at_floor and leaves_much_less(before[-1].result, search.steps[-1].result)
        if halt(search):
            return True
        if added:
            search.as_one_wave()
            if not had_room:  # an effect has shown that less can be left than noise was thought to leave
                law = friction.instead(before)
            if law is not None and law.held_out.total < search.held_out.total:
                search.steps = before
                friction.take(law)
            elif not search.patience.is_at_end and exchange(search):
                search.shape()  # what another effect had hidden of it may show now
            if not search.at_floor:
                search.reformed()  # what a form leaves that was chosen while another effect was missing is no third
            continue
        if law is not None:
            friction.take(law)
            continue
        report(k / MOST_ROUNDS, "checking the order")
        dropped = drop_false(search)
        if not (search.reformed() or dropped):
            break
    else:
        drop_false(search)
    return False


def along_rivals(search: Search, friction: FrictionLaw, report: Progress) -> FrictionLaw:
    """Goes on from effects that left hardly more than the one that was chosen instead; the law of friction of the end.

    What has many forms takes a part of what a second effect does along with the first, and leaves that no place of its
    own. Which of two was the first cause is told by where they lead: with one effect more at most to what leaves less.
    """
    rivals, most = _rivals(search)[:_MOST_RIVALS], min(len(search.steps), MOST_EFFECTS)
    ends, gone, known = [(search, friction)], [search], [_names(search.steps[-1])]
    for i, (k, rival) in enumerate(rivals):
        report(i / len(rivals), f"going on from {rival.name}")
        other = search.branch(k, rival)
        if any(_has_been(before, other.steps[-1]) for before in gone):
            continue
        other.shape()  # as beside the one that was chosen
        if _promises_nothing(other, search):
            continue
        law = friction.beside(other)
        _to_its_end(other, law, silent, most, gone)
        gone.append(other)
        if _names(other.steps[-1]) in known and not leaves_much_less(search.steps[-1].result, other.steps[-1].result):
            continue
        known.append(_names(other.steps[-1]))
        if best([search, other]):
            if len(other.steps) > most:  # there may be more to it
                _to_its_end(other, law, silent)
            ends.append((other, law))
        if other.at_floor or search.patience.is_short:
            break
    other, law = ends[best([s for s, _ in ends])]
    search.become(other)
    return law


def _names(step: Step) -> set[str]:
    return {e.name for e in step.result.plant.effects}


def _has_been(search: Search, step: Step) -> bool:
    """Whether a search has come through a fit of the same effects that leaves as much: it goes on from there alike."""
    return any(_names(s) == _names(step) and abs(s.result.error / step.result.error - 1) < _SAME for s in search.steps)


def _promises_nothing(other: Search, search: Search) -> bool:
    """Whether a search that has come close to the noise floor has taken what no effect more would take beside another,
    by a linear refit. Further from it plants have bent, and no linear refit knows how far."""
    last = search.steps[-1].result
    left, floor = left_of(last.misfit, last.vector), floor_of(last)
    # A plant that has bent claims more of what it leaves for noise than it did before.
    close = last.error <= CLOSE_TO_FLOOR * min(s.result.floor for s in search.steps)
    return close and not takes(left, other.within_reach(), floor)


def _is_ahead(other: Search, search: Search) -> bool:
    """Whether a search has ended with no more effects than another has by now, and leaves much less."""
    left, least = (s.steps[-1].result.error ** 2 for s in (search, other))
    return len(other.steps) <= len(search.steps) and left > _BEHIND * least


def best(searches: Sequence[Search]) -> int:
    """Which search has come furthest, by its place; the simplest of those that have come as far."""
    return simplest([Trial("", s.steps[-1].result, s.held_out) for s in searches])[0]


def _rivals(search: Search) -> list[tuple[int, Trial]]:
    """The effects that left hardly more than that of a step, each with the number of that step; those of the fewest
    free parameters first."""
    found = [
        (k, rival)
        for k, step in enumerate(search.steps)
        for rival in step.others
        if rival.name not in _names(search.steps[-1]) and rival.held_out.total <= _HARDLY_MORE * step.held_out.total
    ]
    return sorted(found, key=lambda r: (r[1].result.misfit.coordinates.size, r[1].held_out.total))
