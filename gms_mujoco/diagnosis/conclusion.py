"""The end of a diagnosis: its verdict, what remains and looks how, and what to measure next."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..compare import Comparison
from ..comparison.score import times
from ..identification.undetermined import hardly_slides, never_slips
from .beyond import Hint
from .custom import Scored
from .findings import Diagnosis, Rejected
from .judgement import AT_FLOOR
from .remainder import NO_LOOK, Remainder, describe, loudest
from .search import Search
from .steps import Step
from .waves import known_in_part

Array = NDArray[np.float64]

_SAYS_NOTHING = 0.1  # p value of an effect above which it is no closer to what remains than chance
_ALIKE = 1.5  # times an error, that another one is at most where both say the same
_CLOSER = 0.98  # times the error of new records without an effect, that one which comes close leaves at most
_CLOSE = 1.2  # times the noise floor, which no part of the data makes more of
_WORSE = 1.1  # times what is left of new records without an effect: one with which more is left is contradicted
_NEAR_FLOOR = 2.0  # times the noise floor: more is left of new records by a plant that lacks something


def conclude(
    steps: tuple[Step, ...],
    rejected: tuple[Rejected, ...],
    floor: float,
    search: Search,
    moments: str,
    said: tuple[str, ...],
    hint: Hint | None,
    own: Sequence[Scored] = (),
) -> Diagnosis:
    """The verdict on a search that has ended, what remains, and what to measure next.

    Args:
        steps: with what they leave of the validate records.
        rejected: what was tried on the final plant.
        floor: of the validate records.
        search: that has ended.
        moments: since when the fit records are off the plant, in words; empty where they are not.
        said: sentences on what remains, the first of them on what had been found last.
        hint: on what explains more than any effect that was added.
        own: candidates of the user's.
    """
    last = steps[-1].result
    negligible = max(o.negligible for o in search.seen)
    comparisons = [s.comparison for s in steps if s.comparison is not None]
    holds = _holds(comparisons, negligible)
    at_floor = (search.at_floor or _as_good(steps[-1], negligible)) and holds
    at_floor |= bool(moments) and _told_beforehand(steps[-1].comparison, negligible)
    added = len(steps) > 1
    verdict = ("explained" if added else "adequate") if at_floor else ("partly_explained" if added else "unexplained")
    left = np.split(last.misfit.residual(last.vector), last.misfit.splits)
    remainder, look = "", NO_LOOK
    if not at_floor:
        there = NO_LOOK if holds else _look(steps[-1].comparison)
        look = there if search.at_floor else describe(last.plant, last.misfit.observations, left)
        size = f"{last.score.told(last.error)} of the {last.score.word}"
        when = f"most of it {moments}" if moments else ""
        told = hint.said if hint else ""
        fitted = (told,) if search.at_floor else (size, told, look.said, when)
        said = (*fitted, *said, "" if holds else _elsewhere(steps[-1].comparison, there), _other_curve(search))
        remainder = "; ".join(filter(None, said))
    following = None
    confusable = [(s.effect, other) for s in steps for other in s.confusable_with if s.effect]
    if confusable:
        one, other = confusable[0]
        assert one is not None
        following = (
            f"To tell {one} from {other}: {lowered(effects.find(one).experiment)} "
            f"For {other}: {lowered(effects.find(other).experiment)}"
        )
    elif stuck := never_slips(last.plant, last.misfit.observations):
        following = stuck
    elif hint:
        following = hint.experiment
    elif not at_floor:
        record, error = _loudest(search, steps[-1], left), steps[-1].validate_error
        following = _to_write(rejected, own, error)
        following = following or _to_isolate(rejected, record, look, error, _comes_back(steps[-1]))
    off = f"The fit records are off {moments}" if moments and at_floor else ""
    unseen = _unseen(steps[-1].comparison, negligible) if at_floor else ""
    in_part = known_in_part(last) if added else "", hardly_slides(last.plant, last.misfit.observations)
    lines = (last.habit, off, *in_part, unseen, _contradicted(steps, comparisons))
    notes = tuple(f"{line}." for line in lines if line)
    notes = (*notes, *(s.said for s in own))
    tried = (*rejected, *(Rejected(s.name, s.p_value, s.error) for s in own))
    return Diagnosis(verdict, floor, steps, tried, remainder, following, notes)


def fits_alone(search: Search, steps: Sequence[Step]) -> bool:
    """Whether the last plant is at the noise floor of what was fitted, and far from that of new records."""
    last = steps[-1]
    if last.comparison is None or not (search.at_floor or last.result.error <= _CLOSE * last.result.floor):
        return False
    error, floor = last.comparison.determined
    return error > max(_NEAR_FLOOR * floor, *(o.negligible for o in search.seen))


def _loudest(search: Search, step: Step, left: Sequence[Array]) -> str:
    """Name of the record that most of what remains stands in: of those that were not fitted, where the others are told
    as well as noise allows."""
    if search.at_floor and step.comparison is not None:
        return step.comparison.loudest
    return loudest(step.result.misfit.observations, left)


def _comes_back(step: Step) -> bool:
    """Whether about as much is left of new records as of those that were fitted, and clearly more than noise."""
    if step.comparison is None:
        return False
    errors, floor = (step.result.error, step.comparison.error), max(step.result.floor, step.comparison.noise_floor)
    return min(errors) > max(_NEAR_FLOOR * floor, max(errors) / _ALIKE)


def _to_write(rejected: Sequence[Rejected], own: Sequence[Scored], error: float | None) -> str:
    """What to do with a candidate of the user's that comes closer than anything known; empty where none does."""
    left = {s: math.sqrt(max(1 - s.gain, 0.0)) if error is None or s.error is None else s.error / error for s in own}
    closest = min((s for s in own if left[s] < _CLOSER), key=lambda s: (s.p_value, left[s]), default=None)
    if closest is None or closest.p_value > min([_SAYS_NOTHING, *(r.p_value for r in rejected)]):
        return ""
    return (
        f"Nothing known explains the rest. {closest.name}, a candidate of yours, came closest, with "
        f"{100 * closest.gain:.0f} % of the squared error: as an effect in one file (see CONTRIBUTING) it is fitted "
        "with the plant."
    )


def _to_isolate(
    rejected: Sequence[Rejected],
    record: str,
    look: Remainder = NO_LOOK,
    error: float | None = None,
    comes_back: bool = False,
) -> str:
    """What to measure where nothing known explains the rest: what its look asks for, or the closest effect where that
    takes more of the rest than has the look; else the same again.

    Args:
        rejected: what was tried.
        record: that most of what remains stands in.
        look: of what remains.
        error: of the validate records, of which an effect that is close takes something.
        comes_back: whether new records have it too.
    """
    near = [r for r in rejected if error is None or r.validate_error is None or r.validate_error < _CLOSER * error]
    likely = min(near, key=lambda r: r.p_value, default=None)
    close = likely is not None and likely.p_value <= _SAYS_NOTHING
    if look.experiment and (likely is None or not close or look.share > _taken(likely, error)):
        return f"Nothing known explains the rest. To learn the cause of {look.experiment}"
    if likely is not None and close:
        experiment = lowered(effects.find(likely.effect).experiment)
        return f"Nothing known explains the rest. {likely.effect} came closest: {experiment}"
    if comes_back:
        return (
            "Nothing known explains the rest, or comes close. New records have it too, so the machine does it each "
            f"time: repeat {record} with one thing changed at a time, the place, the direction, the speed, the "
            "load, the temperature. What it follows is its cause."
        )
    return (
        f"Nothing known explains the rest, or comes close. Measure {record} twice more in the same way: what comes "
        "back is the machine's, what does not is noise or drift."
    )


def _taken(tried: Rejected, error: float | None) -> float:
    """Share of the square that is left of new records, which an effect that was tried takes; 0 where none were told."""
    if error is None or tried.validate_error is None:
        return 0.0
    return 1 - (tried.validate_error / error) ** 2


def _as_good(step: Step, negligible: float) -> bool:
    """Whether hardly more is left than noise leaves, of all that was fitted and of all that was not.

    The search looks closer: at what the motion determines, of which a coarse encoder may leave little, and known worse
    than the noise.
    """
    ends = [(step.result.error, step.result.floor)]
    if step.comparison is not None:
        ends.append((step.comparison.error, step.comparison.noise_floor))
    return all(error <= max(_CLOSE * floor, negligible) for error, floor in ends)


def _holds(comparisons: Sequence[Comparison], negligible: float) -> bool:
    """Whether the last plant is as good on new records as those before it and near the noise floor, or at it.

    What fits well and does not hold on new records is no explanation, whatever it does to those it was fitted to. Where
    the axis moves less than its encoder resolves nothing holds, and that speaks against no plant.
    """
    if not comparisons:
        return True
    *before, last = comparisons
    error, floor = last.determined
    most = min(_NEAR_FLOOR * floor, *(c.determined[0] for c in before), math.inf)
    return error <= most or _told_beforehand(last, negligible)


def _told_beforehand(comparison: Comparison | None, negligible: float) -> bool:
    """Whether a plant leaves no more than noise of records that it has not seen."""
    return comparison is not None and comparison.error <= max(AT_FLOOR * comparison.noise_floor, negligible)


def _unseen(comparison: Comparison | None, negligible: float) -> str:
    """That new records leave more than noise, and where; empty where they do not."""
    if comparison is None or _told_beforehand(comparison, negligible):
        return ""
    error, floor = comparison.determined
    if error > AT_FLOOR * floor:
        return f"Left is {_elsewhere(comparison, _look(comparison))}"
    share = 1 - (error / comparison.error) ** 2
    return (
        f"Of the square that is left of the records that were not fitted {100 * share:.0f} % is where the axis moves "
        "less than its encoder resolves, and no model knows what holds it"
    )


def _contradicted(steps: Sequence[Step], comparisons: Sequence[Comparison]) -> str:
    """That new records leave clearly more with effects than without them, and what the user may do, or show nothing of
    an effect; else empty."""
    if len(comparisons) < len(steps):
        return ""
    errors = [c.determined[0] for c in comparisons]
    best, floor = int(np.argmin(errors)), comparisons[-1].determined[1]
    told = comparisons[-1].score.told
    if errors[-1] <= max(_WORSE * errors[best], AT_FLOOR * floor):
        idle = [k for k in range(1, len(errors)) if errors[k] > max(_CLOSER * errors[k - 1], AT_FLOOR * floor)]
        said = (f"{steps[k].effect} ({told(comparisons[k - 1].error)} without it, {told(comparisons[k].error)} with it)"
                for k in idle)
        return f"The validate records show nothing of {' and of '.join(said)}" if idle else ""
    names = " and ".join(str(s.effect) for s in steps[best + 1 :])
    return (
        f"The validate records contradict {names}: {told(comparisons[-1].error)} of them would be left, "
        f"{told(comparisons[best].error)} without. One with use = \"select\" would have to agree with every choice"
    )


def _look(comparison: Comparison | None) -> Remainder:
    """The look of what is left of the records that were not fitted."""
    if comparison is None or not comparison.records:
        return NO_LOOK
    runs = comparison.records
    return describe(comparison.plant, [r.observation for r in runs], [r.residual for r in runs])


def _elsewhere(comparison: Comparison | None, look: Remainder) -> str:
    """What is left of the records that were not fitted, and where that stands."""
    if comparison is None:
        return ""
    error, floor = comparison.determined
    score = comparison.score
    size = f"{score.told(comparison.error)} of the {score.word} of the records that were not fitted"
    if error > AT_FLOOR * floor:
        size += f", {times(error, floor)} what noise leaves"
    return "; ".join(filter(None, (size, look.said)))


def _other_curve(search: Search) -> str:
    """That friction over speed is not what the plant says, where that would explain a good part of the rest."""
    share = search.bent
    if not share:
        return ""
    return f"friction over speed has another shape than its Stribeck curve ({100 * share:.0f} % of the square)"


def lowered(text: str) -> str:
    return text[:1].lower() + text[1:]
