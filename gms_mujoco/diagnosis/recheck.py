"""What was found is looked at again, now that what stood beside it is known."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..fit_result import FitResult
from ..identification.candidates import GENERAL_LAWS, absent
from ..identification.held_out import HeldOut, p_value, scatter
from ..identification.inverse import Observation
from ..identification.linear_model import LinearModel, cross_validated
from ..identification.misfit import Misfit
from ..identification.refine import refine
from ..identification.screen import Screen
from ..identification.starts import LAWS
from ..identification.tall import gram
from ..plant import Plant
from .beyond import beyond
from .joint_fits import LIMITS
from .judgement import CLOSE, FALSE_DISCOVERY_RATE, NEARLY, Trial, carries, residual_of, simplest, without
from .other_causes import rippling
from .search import Search
from .steps import Step, Tried

Array = NDArray[np.float64]

_FAR = 4.0  # times the squared error of a fit: one that leaves more, with all else in place, is not as good afresh
MOST_SCATTER = 0.4  # of an effect around its own prediction, relative to its size: more is not the effect
_SPRING, _OFFSET = "spring", "torque_offset"  # one has the other as its preload
_PARTS = {_SPRING: _OFFSET} | {general: special for special, general in LIMITS.items()}
_LEANS, _HARDLY = ("stiffness", "preload"), 0.3  # of the preload, that a spring changes by over the range
_LATE = 0.35  # of a harmonic, that its part in quadrature must have in either direction to count
_IN_QUADRATURE = math.cos(math.radians(25))


def exchange(search: Search) -> bool:
    """Tries in the place of each effect the others that earned it as well; whether any takes it.

    What was still missing when they were compared may have made one look like the other, or better, and so may
    friction that came out a little different beside each. Tried are those that could not be told apart, those of fewer
    free parameters that took nearly as much, a part of the effect, and short of the noise floor those that came close.
    """
    exchanged = False
    for k in range(1, len(search.steps)):
        if k >= len(search.steps):
            break
        step, last = search.steps[k], search.steps[-1]
        assert step.effect is not None
        others = [
            t
            for t in step.others
            if t.name in step.confusable_with
            or (not search.at_floor and t.held_out.total < CLOSE * step.held_out.total)
            or _simpler(t, step, search.steps[k - 1])
        ]
        trials = [Trial(step.effect, last.result, last.held_out), *(_instead(search, step.effect, t) for t in others)]
        if (part := _part(search, step)) is not None and part.name not in [t.name for t in others]:
            trials.append(part)
        chosen, equal = simplest(trials)
        if chosen:
            exchanged = True
            rest = [t for t in step.others if t.name != trials[chosen].name]
            rest.append(Trial(step.effect, step.result, step.held_out))
            search.steps = _along(search.steps, k, trials[chosen])
            if k == len(search.steps):  # the last effect, without which the others do as well
                break
            search.steps[k] = replace(search.steps[k], others=tuple(rest))
        plant = search.steps[-1].result.plant
        alike = tuple(t.name for t in (trials[i] for i in equal) if t.name not in plant and not _hardly_leans(t, plant))
        search.steps[k] = replace(search.steps[k], confusable_with=alike)
    return exchanged


def _part(search: Search, step: Step) -> Trial | None:
    """The last fit with a part of an effect that was added in its place: the offset that a spring has, or the coupling
    of a play; None of other effects.

    While another was missing that is uneven over the place, a slope may have stood for it: at the noise floor none is.
    And where a resonance is, a play that closes finds it as well.
    """
    last = search.steps[-1].result
    name = _PARTS.get(step.effect or "", "")
    if not name or name in last.plant or name in search.barred or not search.at_floor:
        return None
    assert step.effect is not None
    whole = last.plant[step.effect].values
    own = [p.name for p in effects.find(name).parameters]
    values: dict[str, Any] = {k: whole["preload" if name == _OFFSET else k] for k in own}
    bare, start = without(last, step.effect)
    misfit, x = bare.onto(bare.plant(start) + effects.find(name)(**values), start)
    result = refine(misfit, x)
    return Trial(name, result, cross_validated(misfit, result.vector))


def _hardly_leans(trial: Trial, plant: Plant) -> bool:
    """Whether a spring, in the place of the offset of a plant, has come out as hardly more than its preload."""
    runs = [o for o in trial.result.misfit.observations if isinstance(o, Observation)]
    if trial.name != _SPRING or _OFFSET not in plant or not runs:
        return False
    stiffness, preload = (abs(float(np.asarray(trial.result.plant[_SPRING].values[k]))) for k in _LEANS)
    return stiffness * max(float(np.ptp(o.position)) for o in runs) < _HARDLY * preload


def _simpler(trial: Trial, step: Step, before: Step) -> bool:
    """Whether an effect took most of what that of a step did, with fewer free parameters."""
    total = before.held_out.total
    fewer = trial.result.misfit.coordinates.size < step.result.misfit.coordinates.size
    return fewer and total - trial.held_out.total > NEARLY * (total - step.held_out.total)


def _instead(search: Search, name: str, other: Trial) -> Trial:
    """The last fit with another effect in the place of one that it has; without that one, if it has the other too."""
    last = search.steps[-1].result
    bare, start = without(last, name)
    plants = [bare.coordinates.template]
    if other.name not in plants[0]:
        effect = other.result.plant[other.name]
        plants = [plants[0] + effect.replace(**form) for form in search.fits.forms(effect, plants[0])]
    most = _FAR * last.misfit.cost(last.vector)

    def fitted(plant: Plant) -> FitResult:
        misfit = Misfit(plant, bare.observations)
        return refine(misfit, misfit.vector(plant, bare.memories(start, misfit.n_memory)), below=most)

    result = min(map(fitted, plants), key=lambda r: r.error)
    if {e.name for e in result.plant.effects} != {e.name for e in other.result.plant.effects}:
        if result.misfit.cost(result.vector) < most:
            result = search.fits.best(result)
    elif other.result.error <= result.error:
        return other
    return Trial(other.name, result, cross_validated(result.misfit, result.vector))


def _along(steps: Sequence[Step], k: int, last: Trial) -> list[Step]:
    """The steps to a fit in which another effect stands in the place of that of step k, or none."""
    names = [s.effect for s in steps[1:]]
    names[k - 1 : k] = [last.name] if last.name and last.name not in names else []
    if len(names) < k:
        return [*steps[: k - 1], replace(steps[k - 1], result=last.result, held_out=last.held_out)]
    known = {s.effect: s for s in steps}
    return _onwards(steps[:k], [known.get(n, Step(n, last.result)) for n in names[k - 1 :]], _up_to(last, names[k:]))


def _up_to(last: Trial, names: Sequence[str | None]) -> list[Trial]:
    """Fits with ever more of some effects, the last of which has them all: one without any, and one for each."""
    fits = [last]
    for name in reversed(names):
        result = refine(*without(fits[0].result, str(name)))
        fits.insert(0, Trial(str(name), result, cross_validated(result.misfit, result.vector)))
    return fits


def _onwards(begun: Sequence[Step], steps: Sequence[Step], fits: Sequence[Trial]) -> list[Step]:
    """Steps, and others after them with other fits."""
    out = list(begun)
    for step, fit in zip(steps, fits, strict=True):
        p = p_value(out[-1].held_out, fit.held_out)
        out.append(replace(step, result=fit.result, p_value=p, held_out=fit.held_out))
    return out


def join_laws(search: Search, own: str) -> str:
    """Counts laws of friction that were found beside that of a search to the first plant; a sentence on them, empty
    where there are none, and where that is the user's own.

    Where the data choose the law they are how friction is described, and no effect that was missing.
    """
    joined = [str(s.effect) for s in search.steps if s.effect in LAWS]
    if not joined:
        return ""
    first, *others = search.steps
    others = [s for s in others if s.effect not in joined]
    last = Trial("", search.steps[-1].result, search.held_out)
    base, *fits = _up_to(last, [s.effect for s in others])
    search.steps = _onwards([replace(first, result=base.result, held_out=base.held_out)], others, fits)
    names = " and ".join(joined)
    if any(e.name in LAWS and e.name not in joined for e in base.result.plant.effects):
        return f"{names} was found beside it, and counts to the law"
    return f"{names} describes the friction, in the place of {own}" if names != own else ""


def law_first(search: Search) -> None:
    """Counts a general law of friction that was found in the place of a simple one before what was found beside that:
    an effect that came first is beside neither of them now."""
    names = [s.effect for s in search.steps]
    k = next((k for k, name in enumerate(names) if name in GENERAL_LAWS), 0)
    if k > 1:
        first, *others = search.steps
        law = others.pop(k - 1)
        fits = _up_to(Trial("", search.steps[-1].result, search.held_out), [s.effect for s in others])
        search.steps = _onwards([first], [law, *others], fits)


def drop_false(search: Search) -> bool:
    """Takes away again effects that a later one has made superfluous, or that act unlike their prediction.

    Only beside all the others can that be seen: what is still missing would count against what was found first.
    True where there were any: beside the others alone something else may be seen.
    """
    dropped = False
    while len(search.steps) > 1:
        judged = [(k, *_against(search, k)) for k in range(len(search.steps) - 1, 0, -1)]
        # First what has come out as none of its kind, as a spring that is all preload beside an offset.
        idle = sorted((j for j in judged if j[3] > FALSE_DISCOVERY_RATE), key=lambda j: j[3] < 1)
        k, left, held_out, _, most = idle[0] if idle else max(judged, key=lambda j: j[4])
        if not idle and most <= MOST_SCATTER:
            break
        if not idle:
            _reject(search, k)
        search.false.add(str(search.steps[k].effect))
        _drop(search, k, left, held_out)
        dropped = True
    return dropped


def drop_shadows(search: Search) -> None:
    """Takes away again effects in whose place what is in no catalogue leaves much less.

    A cause that is told beside an effect may be all that there is: the effect was chosen while friction was still
    wrong, or not all of the records were, and it showed less. See `beyond`.
    """
    if search.hint is None or search.at_floor:
        return
    for k in range(len(search.steps) - 1, 0, -1):
        last = search.steps[-1]
        left, held_out, *_ = _against(search, k)
        hint = beyond(left, held_out, Trial(str(search.steps[k].effect), last.result, last.held_out))
        if hint is not None:
            search.hint = hint
            _reject(search, k)
            _drop(search, k, left, held_out)


def drop_last(search: Search, ended: FitResult) -> bool:
    """Takes away the last effect where its fit, which has `ended`, leaves no less than the one without it; True where
    it did.

    Near the end of a fit an instant that a look missed may be all that told them apart.
    """
    k = len(search.steps) - 1
    if k == 0 or ended.error < search.steps[k - 1].result.error:
        return False
    _reject(search, k)
    search.false.add(str(search.steps[k].effect))
    search.steps.pop()
    return True


def _against(search: Search, k: int) -> tuple[FitResult, HeldOut, float, float]:
    """The last plant without the effect of step k, what that leaves, and p value and scatter of the effect."""
    last, name = search.steps[-1], search.steps[k].effect
    assert name is not None
    result, held_out = search.steps[-2].result, search.steps[-2].held_out
    if {e.name for e in result.plant.effects} != {e.name for e in last.result.plant.effects} - {name}:
        result = refine(*without(last.result, name))
        held_out = cross_validated(result.misfit, result.vector)
    floor = last.result.floor_rows / math.sqrt(last.result.misfit.delivered(last.result.vector))
    # What the fits leave, not what they predict: a block that alone determines an unknown is predicted by chance.
    # A simulated motion that is off stays off for most of a run: in a few runs what is left goes with any change.
    uneven = 0.0 if search.fits.simulated else scatter(residual_of(result), residual_of(last.result), floor)
    p = p_value(held_out, last.held_out) if carries(name, result, last.result) else 1.0
    return result, held_out, p, uneven


def _reject(search: Search, k: int) -> None:
    step = search.steps[k]
    search.rejected.append(Tried(str(step.effect), step.p_value, search.steps[-1].result.plant, fitted=True))


def _drop(search: Search, k: int, left: FitResult, held_out: HeldOut) -> None:
    """Leaves out step k; the last plant becomes what is left without its effect, as those on the way do."""
    *_, last = search.steps[:k] + search.steps[k + 1 :]
    search.steps = _along(search.steps, k, Trial(last.effect or "", left, held_out))


# ------------------------------------------------------------------------------------- series over the place

_OF_PLACE = ("torque_offset", "spring", "gravity", "cogging")  # torques that hang on nothing else
_LARGER = 3.0  # times all that was missing, of each of two effects
_OPPOSITE = -0.9  # cosine between what they do
_JOINS = 0.3  # cosine from which another effect has to do with them


def undoing(search: Search) -> tuple[tuple[str, ...], float]:
    """Two effects of the place that undo each other, and those that have to do with them, with how many times as much
    as all that was missing the lesser of the two does; nothing where there are none."""
    first, last = search.steps[0].result, search.steps[-1].result
    names = [name for s in search.steps if (name := s.effect) in _OF_PLACE and name is not None]
    missing, left = (r.misfit.residual(r.vector) for r in (first, last))
    if len(names) < 2 or len(missing) != len(left):
        return (), 0.0
    without_one = (last.misfit.onto(last.plant.replace(absent(last.plant[n])), last.vector) for n in names)
    done = np.array([misfit.residual(x) - left for misfit, x in without_one])
    size = np.sqrt(np.sum(done**2, 1))
    cosine = done @ done.T / np.outer(size, size)
    size /= math.sqrt(float(missing @ missing))
    one, other = np.unravel_index(np.argmin(cosine), cosine.shape)
    if cosine[one, other] > _OPPOSITE or min(size[one], size[other]) < _LARGER:
        return (), 0.0
    joined = np.maximum(np.abs(cosine[one]), np.abs(cosine[other])) > _JOINS
    pair = [names[one], names[other]]
    return (*pair, *(n for n, j in zip(names, joined, strict=True) if j and n not in pair)), min(size[one], size[other])


def drop_series(search: Search) -> str:
    """Takes away again what is a series over the place; a sentence on it, empty where there is none.

    A slope, a sine of the revolution and its harmonics make any torque over the range that was measured. Where three
    of them are at work, two of which undo each other many times over, that is what they do; none is there by itself.
    """
    names, times = undoing(search)
    if len(names) < 3:
        return ""
    _take_away(search, names)
    return (
        f"{names[0]} and {names[1]} would undo each other, {times:.0f} times as strong as all that is left, with "
        f"{' and '.join(names[2:])} beside them: the first terms of a series over the place, and none of it a cause"
    )


def _take_away(search: Search, names: Collection[str]) -> None:
    """Takes away the steps of some effects."""
    for name in names:
        for k in [k for k, s in enumerate(search.steps) if s.effect == name]:
            _reject(search, k)
            left, held_out, *_ = _against(search, k)
            _drop(search, k, left, held_out)


# ------------------------------------------------------------------------------------- harmonics that come late


def drop_late(search: Search) -> str:
    """Takes away again what is one torque that follows the place late; a sentence on it, empty where there is none.

    Hysteresis of magnets or of a belt lags behind the place in either direction: A sin(n q + phi - d sign v). That is a
    harmonic of the place, and friction with the same harmonic a quarter of its period ahead. Two causes have no reason
    to agree in both, and neither alone is true.
    """
    result = search.steps[-1].result
    lag = _lag(result, {s.effect for s in search.steps})
    if lag is None:
        return ""
    harmonic, degrees, share = lag
    _take_away(search, _ALONG_THE_PLACE)
    return (
        f"a torque that follows harmonic {harmonic:g} of the place {degrees:.0f} deg late in both directions, as "
        f"hysteresis of magnets does ({100 * share:.0f} %)"
    )


# Torques of one harmonic, and what a lag adds to them: friction a quarter of a period ahead.
_ALONG_THE_PLACE = ("cogging", "position_dependent_friction")


def _lag(result: FitResult, added: set[str | None]) -> tuple[float, float, float] | None:
    """Harmonic, lag [deg] and share of the squared residual of a torque that follows the place late; None without."""
    screen: Screen | None = None
    total = float(np.sum(residual_of(result).rows ** 2))
    for name in _ALONG_THE_PLACE:
        if name not in added:
            continue
        partner = next(n for n in _ALONG_THE_PLACE if n != name)
        for harmonic in np.atleast_1d(result.plant[name].values["harmonics"]):
            found = {name: _of_harmonic(result, name, harmonic)}
            if partner in result.plant and harmonic in np.atleast_1d(result.plant[partner].values["harmonics"]):
                found[partner] = _of_harmonic(result, partner, harmonic)
            else:
                screen = screen or Screen(result.misfit, result.vector)
                seen = screen.at(effects.find(partner), {"harmonics": harmonic})
                if seen is None or p_value(screen.held_out, seen[2]) > FALSE_DISCOVERY_RATE:
                    continue
                found[partner] = seen[1], float(np.ravel(seen[0].values["phase"])[0])
            (torque, phase), (friction, ahead) = (found[n] for n in _ALONG_THE_PLACE)
            sizes = math.sqrt(float(torque @ torque)), math.sqrt(float(friction @ friction))
            if min(sizes) > _LATE * max(sizes) and math.sin(ahead - phase) > _IN_QUADRATURE:
                both = float(np.sum((torque + friction) ** 2))
                return float(harmonic), math.degrees(math.atan2(sizes[1], sizes[0])), both / (both + total)
    return None


# ------------------------------------------------------------------------------------- a torque constant that ripples


def drop_ripple(search: Search) -> str:
    """Takes away again friction that varies over the place where a torque constant that does explains more of blocks
    not seen; a sentence on it, empty where it does not.

    At a steady speed the two are one. Where the axis gathers speed its torque is more than friction, and a motor whose
    poles differ, or a strain gauge on a bent shaft, shows all of it more or less as it turns.
    """
    name, last = _ALONG_THE_PLACE[1], search.steps[-1]
    seen = [o for o in last.result.misfit.observations if isinstance(o, Observation)]
    if search.at_floor or name not in {s.effect for s in search.steps} or len(seen) < len(search.seen):
        return ""
    k = next(k for k, s in enumerate(search.steps) if s.effect == name)
    left, held_out, *_ = _against(search, k)
    misfit, x = left.misfit, left.vector
    model = LinearModel(misfit, x, misfit.residual(x))
    harmonics = np.atleast_1d(last.result.plant[name].values["harmonics"])
    waves = [(n, wave) for n in harmonics for wave in (np.sin, np.cos)]
    columns = np.stack([np.concatenate([o.band(rippling(o, *w)) for o in seen]) for w in waves], 1)
    columns *= model.determined[:, None]
    rippled = HeldOut(model.held_out(columns) / math.sqrt(misfit.delivered(x)), misfit.observations)
    if rippled.total > last.held_out.total or p_value(last.held_out, rippled) > FALSE_DISCOVERY_RATE:
        return ""
    free = model.without(columns)
    by = np.hypot(*np.linalg.lstsq(gram(free, free), gram(free, model.target))[0].reshape(-1, 2).T)
    most = int(np.argmax(by))
    _reject(search, k)
    _drop(search, k, left, held_out)
    return (
        f"a torque constant that ripples with harmonic {harmonics[most]:g} of the place, by {100 * by[most]:.2g} %, "
        f"explains more than {name} ({100 * (1 - rippled.total / held_out.total):.0f} % of the square)"
    )


def _of_harmonic(result: FitResult, name: str, harmonic: float) -> tuple[Array, float]:
    """(m,) what one harmonic of an effect does to the residual, and its phase."""
    effect = result.plant[name]
    here = np.asarray(effect.values["harmonics"]) == harmonic
    plant: Plant = result.plant.replace(effect.replace(amplitude=np.where(here, 0, effect.values["amplitude"])))
    misfit, x = result.misfit.onto(plant, result.vector)
    change = result.misfit.residual(result.vector) - misfit.residual(x)
    return change, float(np.asarray(effect.values["phase"])[here][0])
