"""An inertia that is given, and that the records contradict."""

from __future__ import annotations

from dataclasses import replace

from ..effect import Effect
from ..fit import fit_observations
from ..fit_result import FitResult, result_of
from ..identification.least_squares import nudge
from ..identification.linear_model import cross_validated
from ..identification.refine import fit_to_end, refine, refined
from ..logs.plausible import hint
from ..plant import Plant
from ..progress import silent
from .judgement import AT_FLOOR, CLOSE, MUCH_LESS, Trial, floor_of, leaves_much_less, left_of, simplest, without
from .moments import has_moments, refit_between
from .paths import best
from .search import Search

_OF_USE = 4.0  # times what counts: a fit that leaves more after a few steps will not come down to it
_LEFT_OVER = 0.1  # of the squared error above the floor, that an inertia leaves which explains nearly all of it
_HARDLY = 0.05  # the same of one that is not clearly another: no effect looks as much like a little inertia
_CLEARLY = 0.1  # relative difference of two inertias, of which one is wrong
_ALIKE = 0.02  # of two that are the same
_SAME = 5e-4  # of two that no figure tells apart


def free(plant: Plant) -> Plant:
    """The plant with an inertia to be identified, from the one that is given."""
    return replace(plant, inertia_known=False)


def contradicts(search: Search) -> bool:
    """Whether beside what a search has found so far an inertia that is another than the given one explains nearly all
    that is above the noise floor, the nearer it is the more: effects that are found beside the given one would stand
    for the difference. Where it is right another explains next to nothing of what any effect does.

    So does a load that was found, where without it an axis that is as much lighter leaves hardly more.
    """
    last = search.steps[-1].result
    if not last.plant.inertia_known or search.fits.simulated:
        return False
    if any(_is_only_lighter(last, e) for e in last.plant.effects if e.hidden_inertia):
        return True
    if search.at_floor:
        return False
    left, floor = left_of(last.misfit, last.vector), floor_of(last)
    of_use = _OF_USE * _explained(left, floor, _LEFT_OVER)
    undetermined = max(last.misfit.cost(last.vector) - left, 0.0)
    misfit, x = last.misfit.onto(free(last.plant), last.vector)
    x = nudge(misfit, x, below=of_use + undetermined)
    if left_of(misfit, x) > of_use:
        return False
    found = refine(misfit, x)
    other, given = _inertia(found.plant), _inertia(last.plant)
    if _is_alike(other, given, _ALIKE):
        return False
    leaves = _HARDLY if _is_alike(other, given, _CLEARLY) else _LEFT_OVER
    # An axis that is lighter makes less of the noise of its encoder, and its floor is lower: that counts.
    return left_of(found.misfit, found.vector) <= _explained(left, min(floor, floor_of(found)), leaves)


def _is_only_lighter(last: FitResult, load: Effect) -> bool:
    """Whether an axis without a load is as light as if its spring were too soft to move it, and leaves hardly more."""
    felt, enough = last.plant.driven_inertia, CLOSE * left_of(last.misfit, last.vector)
    misfit, x = without(last, load.name)
    misfit, x = misfit.onto(free(replace(misfit.plant(x), inertia=felt)), x)
    x = nudge(misfit, x, below=_OF_USE * enough)
    if left_of(misfit, x) > _OF_USE * enough:
        return False
    found = refine(misfit, x)
    return left_of(found.misfit, found.vector) <= enough and _is_alike(_inertia(found.plant), felt, _ALIKE)


def is_needed(search: Search, given: Plant) -> bool:
    """Whether a search that has identified the inertia has come by that to where it is: beside the same effects the
    one of a given plant leaves much more."""
    last = search.steps[-1].result
    misfit, x = last.misfit.onto(replace(last.plant, inertia=given.inertia, inertia_known=True), last.vector)
    return leaves_much_less(fit_to_end(misfit, nudge(misfit, x)), last)


def is_doubtful(search: Search, other: Search) -> bool:
    """Whether another inertia than the given one would leave hardly more in the place of an effect that was found, or
    with one effect that is still missing much less, also than what explains more than any effect would leave, or no
    more than noise.

    A load on a spring too soft to move it takes its inertia off the axis, and a late torque looks like a heavier one:
    an effect may say no more than that a figure from a drawing is wrong.

    Args:
        search: that has ended.
        other: from the same start but for the inertia, which is free; where that is needed it begins.
    """
    last = search.steps[-1].result
    if not last.plant.inertia_known or search.fits.simulated:
        return False
    least, floor = left_of(last.misfit, last.vector), floor_of(last)
    if search.hint is not None:
        least = min(least, search.hint.left)
    enough = max(CLOSE * least, AT_FLOOR**2 * floor)
    undetermined = max(last.misfit.cost(last.vector) - left_of(last.misfit, last.vector), 0.0)
    for step in search.steps[1:]:
        misfit, x = without(last, str(step.effect))
        misfit, x = misfit.onto(free(misfit.plant(x)), x)
        x = nudge(misfit, x, below=_OF_USE * enough + undetermined)
        if left_of(misfit, x) >= _OF_USE * enough or left_of(misfit, x := refined(misfit, x)) >= enough:
            continue
        if not search.at_floor or _is_as_good(fit_to_end(misfit, x), search):
            return True
    # Where noise leaves as much of what was fitted, and more only of blocks not seen, no inertia does better.
    if search.at_floor or last.error <= AT_FLOOR * last.floor or _is_told_between_moments(search):
        return False
    much_less = _much_less(least, floor)
    misfit, x = last.misfit.onto(free(last.plant), last.vector)
    x = refined(misfit, nudge(misfit, x))
    if left_of(misfit, x) < much_less:
        return True
    # What else is missing may show beside the right inertia alone, and take more there than beside the given one.
    if search.with_one_more(misfit, x) < _much_less(min(least, search.within_reach()), floor):
        return True
    if search.patience.is_at_end:
        return False
    # Friction that has bent beside a wrong inertia does not find back from where it is.
    if len(search.steps) > 1:
        begun = free(search.fits.fresh(last.plant))
        afresh = fit_observations(begun, last.misfit.observations, below=much_less + undetermined)
        if left_of(afresh.misfit, afresh.vector) < much_less:
            return True
    other.first(silent)
    return other.within_reach(much_less) < much_less


def _much_less(left: float, floor: float) -> float:
    """Squared residual that is much less than another, or no more than noise."""
    return max(floor + MUCH_LESS * max(left - floor, 0.0), AT_FLOOR**2 * floor)


def _is_told_between_moments(search: Search) -> bool:
    """Whether a few moments hold what a search has left, and no more than noise is between: no inertia does that."""
    last = search.steps[-1]
    if not has_moments(last.result, last.held_out):
        return False
    calm = result_of(*refit_between(last.result.misfit, last.result.vector))
    return calm.error <= AT_FLOOR * calm.floor


def _is_as_good(found: FitResult, search: Search) -> bool:
    """Whether a fit is not told from that of a search that has ended."""
    last = search.steps[-1]
    trials = [Trial("", last.result, last.held_out), Trial("", found, cross_validated(found.misfit, found.vector))]
    chosen, others = simplest(trials)
    return 1 in (chosen, *others)


def corrected(search: Search, other: Search) -> str:
    """A sentence where a search that has identified the inertia leaves much less than one that took the given, or no
    more than noise with fewer effects; else empty.

    A torque that reads too little looks the same, as by a wrong torque constant.
    """
    before, after = search.steps[-1].result, other.steps[-1].result
    (given, unit), (found, _) = (r.plant.numbers()["inertia"] for r in (before, after))
    # On a spring too soft to move it a load takes its inertia off the axis, and does nothing else.
    felt = before.plant.driven_inertia
    lighter = felt < given and _is_alike(found, felt, _ALIKE)
    left = [left_of(r.misfit, r.vector) for r in (before, after)]
    # Far from the floor neither has found the cause, and the effects of either say nothing of the inertia.
    fewer = other.at_floor or (lighter and left[1] <= CLOSE * left[0])
    fewer = fewer and len(other.steps) < len(search.steps) and (lighter or best([search, other]) == 1)
    if not ((fewer or leaves_much_less(before, after)) and search.selects(after)):
        return ""
    told, more = before.score.told, len(search.steps) - len(other.steps)
    if _is_alike(found, given, _SAME):
        return (
            f"The given inertia of {given:.4g} {unit} fits these records, but a search that was free to change it has "
            f"found a way to less: with that the {after.score.name} is {told(after.error)}, else {told(before.error)}"
        )
    beside = f" with {more} effect{'s' * (more > 1)} more that would stand for the difference" if fewer else ""
    return (
        f"The given inertia of {given:.4g} {unit} does not fit these records, which ask for {found:.4g} {unit}, or for "
        f"{given / found:.4g} times the torque{hint(given / found)}: with that the {after.score.name} is "
        f"{told(after.error)}, else {told(before.error)}{beside}"
    )


def _explained(left: float, floor: float, leaves: float) -> float:
    """What a fit leaves at most, squared, that explains all but a share of what is left above a noise floor."""
    return AT_FLOOR**2 * floor + leaves * max(left - floor, 0.0)


def _inertia(plant: Plant) -> float:
    """Of the whole axis."""
    return plant.numbers()["inertia"][0]


def _is_alike(inertia: float, other: float, within: float) -> bool:
    return abs(inertia - other) <= within * other
