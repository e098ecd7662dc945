"""fit: the parameters of a plant from measurements, by least squares on the torque along the measured motion."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from . import effects
from .effect import Effect
from .errors import ModelError, listing
from .fit_result import FitResult, result_of
from .identification.candidates import VANISHED, has_phase, is_open, joined, strengths
from .identification.frf_observation import FrfObservation, Seen, tells_another_noise, without_outliers
from .identification.habits import as_logged, may_be_otherwise
from .identification.least_squares import nudge
from .identification.misfit import Misfit
from .identification.observe import Data, driven, expect_enough, loaded, observe
from .identification.placement import placed_later
from .identification.refine import finish, finished, fit_to_end, refined, to_end
from .identification.rough import begun, best_start
from .identification.screen import Screen
from .identification.starts import ELEMENTS, other_weakenings, shared_anew, sliding_furthest, slipping_anew
from .plant import Plant
from .progress import Progress, part, silent
from .servo_run import CONTROLLERS
from .threads import one_blas_thread

Array = NDArray[np.float64]

_HABITS = 4  # of a log that are asked for, one after the other: early, earlier, time steps, what those take when
_BEHIND = 4.0  # times a squared residual that is of use: a fit that leaves more after a few steps is not followed
# Of friction that responses alone are told by: what a fit to them begins anew with, each time from its end. The first
# alone, or both at once, end in several minima that lie side by side.
_ANEW = (("attraction",), ("attraction", "static"))


def baseline(
    inertia: float | None = None, kind: str = "hinge", elements: int = ELEMENTS, controller: str | None = None
) -> Plant:
    """The default baseline, not yet identified: inertia, GMS friction with its Stribeck level, viscous drag.

    Args:
        inertia: [kg m^2]; None: to be identified.
        kind: "hinge" or "slide".
        elements: of GMS.
        controller: "position" for a servo that closes its own position loop: inertia, loop and motor, dry and viscous
            friction.
    """
    if controller not in (None, *CONTROLLERS):
        raise ModelError(f"controller must be one of {listing(CONTROLLERS)}, or None; {controller!r} given")
    if controller == "position":
        bare = Plant.axis(inertia, kind) + effects.find("position_loop")()
        return bare + effects.find("coulomb")() + effects.find("viscous")()
    return Plant.axis(inertia, kind) + effects.find("gms")(elements) + effects.find("viscous")()


@one_blas_thread()
def fit(
    plant: Plant,
    data: Sequence[Data],
    *,
    fixed: Collection[str] = (),
    bandwidth: float | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Identifies the free parameters of a plant.

    Least squares on the difference of applied torque and torque needed along the measured motion, over all records
    together, in the band that the sensors allow, and over every point of frequency responses, each weighed by its
    uncertainty (`frf_observation`). Of a servo that closes its own position loop it is the position, simulated from the
    goal (`servo_observation`). Parameters that have no value yet are started from the data; the others start where they
    are. Of several starts the one that leaves the least after a few steps goes on; where it ends above the noise floor
    so does what the records lead to that slide furthest, if that leaves less. Above the floor still, it goes on with
    elements of friction that slip later than they usually may, and with the weakening of friction that each of the
    starts began with, until one comes down to the floor. One that does not takes no place: beside an effect that the
    plant lacks, the lowest is the friction that has bent furthest to hide it. Responses alone are fitted twice more,
    each from the end so far: with elements that follow their level as at the start, then with a level that falls as at
    the start too. Those that come without a deviation are weighed by how rough a curve the points make beside the
    plant, and fitted again where that is another weight than the one they began with.

    Records are worked on side by side, on every core that the process may use or on as many threads as the environment
    variable GMS_MUJOCO_THREADS says; the result is the same to the last bit.

    Args:
        plant: with or without values; a known inertia stays as it is.
        data: records and frequency responses, or runs of a servo, SI units.
        fixed: names "effect.parameter" to leave as they are.
        bandwidth: of the runs [Hz]; None: chosen from the noise of the records.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: nothing to fit, fewer numbers than unknowns, data of the other kind of joint, or a response that
            cannot be used alone.
        ModelError: a parameter has no value and cannot be identified, the plant has none of a name in `fixed`, or no
            value for it, a load in it is heavier than the axis, or it takes a goal and the data have torques, or the
            other way round.
    """
    report = progress or silent
    _expect_values(driven(plant, data).expect_names(fixed), fixed)
    report(0.0, "looking at the records")
    data = loaded(data, plant)
    seen = observe(data, plant.inertia, bandwidth)
    expect_enough(seen, plant, fixed)
    found = _fitted(plant, seen, fixed, part(report, 0.0, 0.9))
    if tells_another_noise(found.plant, found.misfit.observations):
        weighed = observe(data, plant.inertia, bandwidth, found.plant)
        found = _fitted(plant, weighed, fixed, part(report, 0.9, 1.0))
    report(1.0, found.status)
    return found


def _expect_values(plant: Plant, fixed: Collection[str]) -> None:
    """Raises ModelError where what is to be left as it is has no value."""
    unset = [f"{e.name}.{name}" for e in plant.effects for name in e.unset]
    unset += ["inertia"] * (plant.inertia is None)
    if missing := [name for name in unset if name in fixed]:
        raise ModelError(f"fixed leaves parameters at their values, and {listing(missing)} has none; give it one, or "
                         "take it out of fixed")  # fmt: skip


def _fitted(plant: Plant, observations: Sequence[Seen], fixed: Collection[str], report: Progress) -> FitResult:
    misfit, x = _from_what_slides(*_by_its_habits(plant, observations, fixed, report), plant, fixed)
    found = _slipping_later(_turned_round(finish(misfit, x), plant, fixed), fixed)
    return _weakened_otherwise(found, plant, fixed, report)


def _slipping_later(found: FitResult, fixed: Collection[str]) -> FitResult:
    """The fit with elements of friction that slip later than they usually may, where that brings it down to the noise
    floor; that found where it does not."""
    later = None if found.is_near_floor else placed_later(found.misfit, found.vector, fixed)
    if later is None:
        return found
    other = fit_to_end(*later, fixed, below=found.nearly_noise)
    return finished(other) if other.is_near_floor else found


def _turned_round(found: FitResult, plant: Plant, fixed: Collection[str]) -> FitResult:
    """The fit from phases half a turn off those that were given, where harmonics have come to nothing: from a phase
    more than a quarter off no step makes one larger. That found where none has, or it leaves no less."""
    start = found.plant
    for given in (e for e in plant.effects if has_phase(type(e)) and not e.unset):
        size = strengths(type(given))[0].name
        now, before = (np.abs(np.asarray(e.values[size])) for e in (found.plant[given.name], given))
        gone = (before > 0) & (now < VANISHED * before)
        if np.any(gone):
            phase = np.asarray(given.values["phase"]) + math.pi * gone
            start = start.replace(given.replace(**{size: np.where(gone, before, now), "phase": phase}))
    if start is found.plant:
        return found
    misfit, x = found.misfit.onto(start, found.vector, fixed=fixed)
    x = refined(misfit, x)
    return finish(misfit, x) if misfit.cost(x) < found.misfit.cost(found.vector) else found


def _weakened_otherwise(found: FitResult, plant: Plant, fixed: Collection[str], report: Progress) -> FitResult:
    """The first fit that comes down to the noise floor, of that found and those from it with another weakening of
    friction, of which a few steps tell little; that found where none does."""
    misfit, x = found.misfit, found.vector
    others = other_weakenings(plant, found.plant, misfit.observations)
    for i, start in enumerate([] if found.is_near_floor else others):
        report(0.8 + 0.2 * i / len(others), f"another weakening of friction, {i + 1} of {len(others)}")
        trial, there = misfit.onto(start, x, fixed=fixed)
        there = refined(trial, there, below=found.nearly_noise)
        if trial.cost(there) < misfit.cost(x) and (other := finish(trial, there)).is_near_floor:
            return other
    return found


def fit_observations(
    plant: Plant,
    observations: Sequence[Seen],
    fixed: Collection[str] = (),
    report: Progress = silent,
    below: float = math.inf,
) -> FitResult:
    """`fit` on records that are already seen through a band, near enough to judge it, from the start that promises
    most; see `refine` for `below`."""
    found = from_the_data(plant, observations, fixed, report, below)
    return result_of(*_from_what_slides(*found, plant, fixed, below))


def fit_as_logged(plant: Plant, observations: Sequence[Seen], report: Progress = silent) -> FitResult:
    """`fit_observations`, of a log that is seen by its habits; see `as_logged`."""
    return result_of(*_by_its_habits(plant, observations, (), report))


def _by_its_habits(
    plant: Plant, observations: Sequence[Seen], fixed: Collection[str], report: Progress
) -> tuple[Misfit, Array]:
    misfit, x = from_the_data(plant, observations, fixed, report)
    for _ in range(_HABITS):
        if not may_be_otherwise(misfit, x) or not (seen := as_logged(result_of(misfit, x), fixed=fixed)):
            break
        misfit, x = from_the_data(plant, seen, fixed)
    return misfit, x


def _from_what_slides(
    misfit: Misfit, x: Array, plant: Plant, fixed: Collection[str], below: float = math.inf
) -> tuple[Misfit, Array]:
    """Above the noise floor, the fit from where the records lead to that slide furthest, if that leaves less.

    What slides through forgets where its elements were, and its error is smooth in every parameter. To and fro within
    the break-away distance each slip decides on all that come after it: what is wrong by a few per cent leaves as much
    as anything, and many minima lie side by side.
    """
    seen = misfit.observations
    if result_of(misfit, x).is_near_floor or not (sliding := sliding_furthest(seen)):
        return misfit, x
    there, y = from_the_data(plant, sliding, fixed)
    anew, y = to_end(*begun(there.plant(y), seen, fixed), fixed, 40, min(below, misfit.cost(x)))
    return (anew, y) if anew.cost(y) < misfit.cost(x) else (misfit, x)


def _doubting(misfit: Misfit, x: Array) -> list[Seen] | None:
    """The observations with less trust in points of responses that stand alone; None where none does."""
    seen = misfit.observations
    if not any(isinstance(o, FrfObservation) for o in seen):
        return None
    parts = np.split(misfit.residual(x), misfit.splits)
    frfs = [(o, r) for o, r in zip(seen, parts, strict=True) if isinstance(o, FrfObservation)]
    doubted = without_outliers([o for o, _ in frfs], [r for _, r in frfs])
    return [o for o in seen if not isinstance(o, FrfObservation)] + list(doubted) if doubted else None


def from_the_data(
    plant: Plant,
    observations: Sequence[Seen],
    fixed: Collection[str] = (),
    report: Progress = silent,
    below: float = math.inf,
) -> tuple[Misfit, Array]:
    """The problem and the vector of `fit_observations`: where the best of several starts leads to, with the points of
    responses trusted as they deserve."""
    if unknown := [e for e in plant.effects if is_open(e)]:
        return _begun_without(unknown, plant, observations, fixed, report, below)
    first = best_start(plant, observations, fixed, report, below)
    report(0.5, "refining")
    misfit, x = begun(first, observations, fixed, below)
    if not plant.unset:  # it says where to begin, and a coarse look may lead away from there
        misfit, x = min((misfit, x), begun(plant, observations, fixed, below), key=lambda t: t[0].cost(t[1]))
    if misfit.cost(x) > _BEHIND * below:
        return misfit, x
    misfit, x = to_end(misfit, x, fixed, 40, below)
    if again := _doubting(misfit, x):
        misfit = Misfit(misfit.plant(x), again, fixed)
        x = refined(misfit, x)
    if (other := shared_anew(plant, misfit.plant(x), misfit.observations)) and not result_of(misfit, x).is_near_floor:
        misfit, x = _lesser(misfit, x, other, fixed, below)
    for names in _ANEW:
        if other := slipping_anew(plant, misfit.plant(x), misfit.observations, names):
            report(0.7, f"beginning anew with {' and '.join(names)}")
            misfit, x = _lesser(misfit, x, other, fixed, below)
    return misfit, x


def _lesser(misfit: Misfit, x: Array, other: Plant, fixed: Collection[str], below: float) -> tuple[Misfit, Array]:
    """The misfit and the vector of a fit, or of where another plant leads that leaves less."""
    least = misfit.cost(x)
    anew, there = misfit.onto(other, x, fixed=fixed)
    there = refined(anew, there, below=min(below, least))
    return (anew, there) if anew.cost(there) < least else (misfit, x)


def _begun_without(
    unknown: Sequence[Effect], plant: Plant, observations: Sequence[Seen], fixed: Collection[str], report: Progress,
    below: float,
) -> tuple[Misfit, Array]:  # fmt: skip
    """The same for a plant with effects of which nothing is known: each begins with what it would explain best of what
    those before it leave, from there and, where that stays above the noise floor, with all others from the data.

    Raises:
        ModelError: the data cannot show one of them.
    """
    bare = replace(plant, effects=tuple(e for e in plant.effects if e not in unknown))
    misfit, x = from_the_data(bare, observations, fixed, report)
    for e in unknown:
        report(0.5, f"looking for {e.name}")
        if (started := Screen(misfit, x).started(e)) is None:
            raise ModelError(f"{e.name} has no values yet, and these data show nothing of it; give them")
        bare = bare + started
        near, there = misfit.onto(joined(misfit.plant(x), started), x, fixed=fixed)
        near, there = to_end(near, nudge(near, there), fixed, 20, below)
        if not result_of(near, there).is_near_floor:
            afresh, other = from_the_data(bare, observations, fixed, below=min(below, near.cost(there)))
            near, there = (afresh, other) if afresh.cost(other) < near.cost(there) else (near, there)
        misfit, x = near, there
    return misfit, x
