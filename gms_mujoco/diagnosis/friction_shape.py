"""The shape of a plant's own friction, where a fit does not find it: another Stribeck curve, more elements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..effect import Effect
from ..fit_result import FitResult
from ..identification.candidates import lean
from ..identification.held_out import HeldOut, p_value
from ..identification.inverse import Observation
from ..identification.least_squares import nudge
from ..identification.linear_model import cross_validated
from ..identification.misfit import Misfit
from ..identification.placement import parted, placed_anew, placed_later
from ..identification.refine import CLOSE_TO_FLOOR, fit_to_end, refine, refined
from ..identification.scales import Scales
from ..identification.starts import weakened
from ..identification.undetermined import stuck_within
from ..plant import Plant
from .judgement import LEAST_SHARE, MUCH_LESS, at_floor, floor_of, least_fall, left_of, takes, takes_of_both
from .moments import refit_between

Array = NDArray[np.float64]

# Parameters of a law that no fit frees unasked.
_OF_SPEED, OF_REVERSALS = "stribeck_exponent", "exponent"  # of the curve over speed; over the way after a reversal
_EXPONENTS = (_OF_SPEED, OF_REVERSALS)
_TAIL = "stribeck_tail"
_EXPONENTIAL, _GAUSSIAN = 1.0, 2.0  # exponents of the usual Stribeck curves
_SHAPE = (*_EXPONENTS, _TAIL, "slips_back", "damping_velocity", "elastic", "plastic")
_SIGNIFICANT = 0.05  # p value of what another shape of the law takes
_NEARLY_NOISE = 1.15  # times the noise floor: where a fit leaves more, another exponent or reading is looked for
BENDS = 0.6  # of the level of sliding, below which a bristle only bends, to begin with
STEPS = 10  # of a fit with another shape of friction, before it is judged
_MOST_ELEMENTS = 16  # of friction
_OVER_ALL, _SLOW = 0.5, 0.1  # of the rms velocity: a curve that falls over most speeds, and one that falls before them
_WEAKENS = 1.02  # times the level of sliding: by less friction does not weaken
_COARSE = 0.01  # of the torque: what too few elements of friction may leave beside noise
_AT_ONCE = 0.3  # of the fastest attraction that samples show: a level is followed in a few of them
_SOFT = 0.1  # of the longest way: friction that gives way only beyond may stand for a spring over most of it
_VANISHED = 1e-4  # of the level: an element that carries less
_AS_MUCH = 1.001  # times an error: the same one
_PARTED = 0.1  # of the squared error that is not noise, for which friction gets one element more


def of_the_other_kind(law: Effect, usual: float = 0.0) -> Effect:
    """A law with a Gaussian curve; of a Gaussian one, or one with a tail, with an exponential, whatever speed is
    `usual`."""
    exponential = law.values[_TAIL] or law.values[_OF_SPEED] == _GAUSSIAN
    return law.replace(**{_OF_SPEED: _EXPONENTIAL if exponential else _GAUSSIAN, _TAIL: 0.0})


def with_tail(law: Effect, usual: float = 0.0) -> Effect:
    """A law with the curve of Hess and Soom, whatever speed is `usual`."""
    return law.replace(**{_OF_SPEED: _GAUSSIAN, _TAIL: 1.0})


# Curves from which one of another exponent is looked for, of a law and the rms velocity: its own; the other of the two
# usual ones, and that with a tail; those whose velocities lie between those of `starts`.
_CURVES: tuple[Callable[[Effect, float], Effect], ...] = (
    lambda law, usual: law,
    of_the_other_kind,
    with_tail,
    lambda law, usual: weakened(law, 0.1 * usual),
    lambda law, usual: weakened(law, usual),
)


def other_curve(
    now: FitResult, left: HeldOut, exponents: Sequence[str] = _EXPONENTS
) -> tuple[FitResult, HeldOut]:
    """A fit with another exponent of the curve of friction, which else no fit frees; the same where none takes a good
    part of what is left.

    It is looked for from the present curve first, then near the noise floor from a Gaussian one (of that from an
    exponential one), from one with a tail, and from Stribeck curves of other velocities, between which and that a fit
    may find no way. What friction does at steady speed need not ask for it: the curve is that of every reversal too.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
        exponents: names of those that are looked for.
    """
    usual = Scales.of(now.misfit.observations)["rad/s"]
    for name, exponent in [(e.name, x) for e in now.plant.effects if (x := _exponent_of(e)) and x in exponents]:
        for begun in _CURVES if exponent == _OF_SPEED else _CURVES[:1]:
            if at_floor(now, left, _NEARLY_NOISE):
                break
            if begun in (of_the_other_kind, with_tail) and not at_floor(now, left, CLOSE_TO_FLOOR):
                continue
            if bent := _bent(now, begun(now.plant[name], usual), exponent):
                now, left = _better(now, left, without_idle(fit_to_end(*bent)), LEAST_SHARE)
    return now, left


def other_kind(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with another of the usual curves of friction over speed, where that takes a good part of what is left; else
    the same.

    At the noise floor `other_curve` looks for none: what a wrong curve leaves there tells no effect, but is in all that
    is said of friction. Each has as many unknowns.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
    """
    for law in (e for e in now.plant.effects if e.values.get(_OF_SPEED) in (_EXPONENTIAL, _GAUSSIAN)):
        for other in (of_the_other_kind(law), with_tail(law)):
            misfit, x = now.misfit.onto(now.plant.replace(other), now.vector)
            if (near := _nudged(now, misfit, x)) is not None:
                now, left = _better(now, left, fit_to_end(misfit, near), LEAST_SHARE)
    return now, left


def _exponent_of(effect: Effect) -> str | None:
    """The name of the exponent of the curve of a law of friction; None of other effects."""
    return next((name for name in _EXPONENTS if name in effect.values), None)


def _bent(now: FitResult, law: Effect, exponent: str) -> tuple[Misfit, Array] | None:
    """The problem of a fit, and its solution, with the exponent that suits it best from a law of friction on, which
    then stays; None where that promises too little."""
    misfit, x = now.misfit.onto(now.plant.replace(law), now.vector, freed=[f"{law.name}.{exponent}"])
    near = _nudged(now, misfit, x)
    if near is None:
        return None
    x = refined(misfit, near)
    return misfit.onto(misfit.plant(x), x)


def turning_round(misfit: Misfit, x: Array, law: str, below: float) -> tuple[Misfit, Array]:
    """The problem of a fit, and its solution, with the exponent by which its law of friction turns round that suits it
    best; see `refine` for `below`."""
    free, y = misfit.onto(misfit.plant(x), x, freed=[f"{law}.{OF_REVERSALS}"])
    y = refined(free, nudge(free, y, STEPS), below=below)
    return free.onto(free.plant(y), y)


def fading_damping(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with a bristle whose damping fades as it slides, where that takes a good part of what is left; else the
    same.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
    """
    if "lugre" not in now.plant or now.plant["lugre"].damping_velocity or at_floor(now, left, _NEARLY_NOISE):
        return now, left
    law, usual = now.plant["lugre"], Scales.of(now.misfit.observations)["rad/s"]
    for velocity in (float(np.asarray(law.stribeck_velocity)), 0.1 * usual):
        misfit, x = now.misfit.onto(now.plant.replace(law.replace(damping_velocity=velocity)), now.vector)
        if (near := _nudged(now, misfit, x)) is not None:
            found, then = _better(now, left, fit_to_end(misfit, near), LEAST_SHARE)
            if found is not now:
                return found, then
    return now, left


def elastic_bristle(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with a bristle that only bends below a share of its level, where that takes a good part of what is left;
    else the same; see `fading_damping`."""
    if "lugre" not in now.plant or now.plant["lugre"].plastic or at_floor(now, left, _NEARLY_NOISE):
        return now, left
    law = now.plant["lugre"]
    bends = now.plant.replace(law.replace(elastic=law.elastic or BENDS))
    misfit, x = now.misfit.onto(bends, now.vector, freed=["lugre.elastic"])
    x = nudge(misfit, x, STEPS)  # it begins far above the plant, which has bent to hide it
    if not takes(left_of(now.misfit, now.vector), left_of(misfit, x), floor_of(now), LEAST_SHARE / 2):
        return now, left
    x = refined(misfit, x)
    return _better(now, left, fit_to_end(*misfit.onto(misfit.plant(x), x)), LEAST_SHARE)


def plastic_bristle(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with a damped spring that is cut off at the level, by either of the usual curves, in the place of a bristle
    that only bends below a share of it, where that takes a good part of what is left; else the same.

    From the data alone a fit does not find it; a bristle that only bends has come near.
    """
    if "lugre" not in now.plant or not now.plant["lugre"].elastic or at_floor(now, left, _NEARLY_NOISE):
        return now, left
    law = now.plant["lugre"].replace(elastic=0.0, plastic=1.0)
    for form in (law, of_the_other_kind(law)):
        misfit, x = now.misfit.onto(now.plant.replace(form), now.vector)
        if (near := _nudged(now, misfit, x)) is not None:
            now, left = _better(now, left, fit_to_end(misfit, near), LEAST_SHARE)
    return now, left


def _nudged(now: FitResult, misfit: Misfit, x: Array) -> Array | None:
    """A few steps of another fit from where it begins; None where they promise too little beside the present one."""
    before, floor = left_of(now.misfit, now.vector), floor_of(now)
    below = now.misfit.cost(now.vector) - least_fall(before, floor) * misfit.delivered(x)
    x = nudge(misfit, x, STEPS, below)
    return x if takes(before, left_of(misfit, x), floor, LEAST_SHARE / 2) else None


def shaped_as(law: Effect, found: Effect) -> Effect:
    """A law of friction with the shape of the same law in a plant that was found: what no fit frees unasked."""
    return law.replace(**{k: found.values[k] for k in _SHAPE if k in found.values})


def straightened(now: FitResult) -> tuple[Plant, tuple[str, ...]] | None:
    """The plant of a fit with friction that does not stand for a drag, and the names of what keeps it from that; None
    where it does not as it is.

    It does where it weakens over most of the speeds that were measured: in its place it weakens at slow speed alone.
    And it may where its curve has another exponent than is usual: in its place it has the nearer of these.
    """
    usual = Scales.of(now.misfit.observations)["rad/s"]
    for law in now.plant.effects:
        if "stribeck_velocity" not in law.values:
            continue
        static, coulomb, velocity = (float(np.asarray(x)) for x in (law.static, law.coulomb, law.stribeck_velocity))
        if static <= _WEAKENS * coulomb:
            continue
        if velocity > _OVER_ALL * usual:
            slow = weakened(law.replace(coulomb=static / _WEAKENS), _SLOW * usual)
            return now.plant.replace(slow), (f"{law.name}.stribeck_velocity",)
        exponent = float(np.asarray(law.values[_OF_SPEED]))
        if exponent not in (_EXPONENTIAL, _GAUSSIAN):
            near = _EXPONENTIAL if exponent**2 < _EXPONENTIAL * _GAUSSIAN else _GAUSSIAN
            return now.plant.replace(law.replace(**{_OF_SPEED: near})), ()
    return None


def with_exponents(found: FitResult, start: Plant) -> FitResult:
    """The same fit with the exponents that it found, other than those of the start, among the unknowns: so they get an
    interval, and count in those of the others."""
    freed = []
    for e in found.plant.effects:
        begun = start[e.name].values if e.name in start else {p.name: p.default for p in e.parameters}
        if (exponent := _exponent_of(e)) and e.values[exponent] != begun[exponent]:
            freed.append(f"{e.name}.{exponent}")
    if not freed:
        return found
    misfit, x = found.misfit.onto(found.plant, found.vector, freed=freed)
    return replace(found, misfit=misfit, vector=x)


def by_the_letter(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with friction that slips back, as by the letter of its switching law, where that explains a good part of
    what is left: near the noise floor, or where moments hold most of it. The same where it does not.

    When an element slips back hangs on little, and a fit that is bent by moments tells it wrong: it begins where the
    records between them lead, unless near the noise floor it leads on from that fit.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
    """
    if not has_another_reading(now.plant) or now.score.of != "torque":
        return now, left
    for misfit, x in _letter_starts(now, left):
        result, held_out = _better(now, left, fit_to_end(misfit, x), LEAST_SHARE)
        if result is not now:
            return result, held_out
    return now, left


def _letter_starts(now: FitResult, left: HeldOut) -> Iterator[tuple[Misfit, Array]]:
    """Where fits with friction by the letter may begin, of which each may lead elsewhere."""
    if at_floor(now, left, _NEARLY_NOISE):
        return
    if at_floor(now, left, CLOSE_TO_FLOOR):
        misfit, x = now.misfit.onto(slipping_back(now.plant), now.vector)
        near, before = nudge(misfit, x), left_of(now.misfit, now.vector)
        if left_of(misfit, near) <= before:  # what it takes, it takes on the way to its end
            yield misfit, near
        if takes(before, left_of(misfit, near), floor_of(now)):
            yield misfit, x
    if len(left.moments(floor_of(now))):
        calm, x = refit_between(now.misfit, now.vector)
        whole = Misfit(slipping_back(calm.plant(x)), now.misfit.observations)
        yield whole, whole.vector(whole.coordinates.template, skew=calm.skew(x))


def has_another_reading(plant: Plant) -> bool:
    """Whether friction is that of `gms`, and not by the letter of its switching law."""
    return "gms" in plant and not plant["gms"].slips_back


def slipping_back(plant: Plant) -> Plant:
    """The plant with friction by the letter of its switching law."""
    return plant.replace(plant["gms"].replace(slips_back=1.0))


def later_elements(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with elements of friction that slip later than a fit lets them unasked, where one would and that leaves
    much less; else the same.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
    """
    later = None if at_floor(now, left, _NEARLY_NOISE) else placed_later(now.misfit, now.vector)
    return (now, left) if later is None else _better(now, left, fit_to_end(*later), 1 - MUCH_LESS)


def more_elements(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    """A fit with as many elements of friction as the little that is left asks for: no law of a few is any finer.

    They are parted one by one; and where that comes to no end at the noise floor, placed anew, as many as there may be.

    Args:
        now, left: the fit, and what it leaves on held-out blocks.
    """
    while _asks_for_more(now, left):
        floor, cost = floor_of(now), left_of(now.misfit, now.vector)
        finer = parted(now.misfit, now.vector, _PARTED * max(cost - floor, 0.0))
        before = now
        if finer is not None:
            now, left = _better(now, left, refine(*finer), _PARTED)
        if now is before:
            break
    return _with_many(now, left) if _asks_for_more(now, left) else (now, left)


def with_many_elements(found: FitResult) -> FitResult:
    """A fit at its end with as many elements of friction as there may be, placed anew, where it is not at the noise and
    they take much of the rest: what is close enough to the floor for an effect to be named may be a third above it."""
    if found.is_near_floor or not _may_have_more(found):
        return found
    return _with_many(found, cross_validated(found.misfit, found.vector))[0]


def _with_many(now: FitResult, left: HeldOut) -> tuple[FitResult, HeldOut]:
    many = placed_anew(now.misfit, now.vector, most=_MOST_ELEMENTS)
    if many is None:
        return now, left
    elements = many[0].coordinates.template["gms"].elements - now.plant["gms"].elements
    return _better(now, left, refine(*many), 1 - (1 - _PARTED) ** elements)


def _asks_for_more(now: FitResult, left: HeldOut) -> bool:
    """Whether a fit may have more elements of friction, and is not at the noise floor."""
    return _may_have_more(now) and not at_floor(now, left)


def _may_have_more(now: FitResult) -> bool:
    """Whether a fit has fewer elements of friction than it may have, and leaves little that is not noise."""
    few = now.score.of == "torque" and "gms" in now.plant and now.plant["gms"].elements < _MOST_ELEMENTS
    return few and now.error**2 - now.floor**2 <= _COARSE**2


def following(now: FitResult) -> FitResult | None:
    """The same fit with friction that follows its level at once; None where it does so, within the band.

    Elements that keep their forces while they slide bend to hide what modulates their level, and follow it as little:
    the tangents of such an effect show nothing beside them.
    """
    records = [o for o in now.misfit.observations if isinstance(o, Observation)]
    if "gms" not in now.plant or not records:
        return None
    law = now.plant["gms"]
    level = float(np.asarray(law.coulomb))
    if level <= float(np.asarray(law.attraction)) / max(o.bandwidth for o in records):
        return None
    quick = law.replace(attraction=_AT_ONCE * level / min(o.sample_time for o in records))
    return refine(*now.misfit.onto(now.plant.replace(quick), now.vector))


def without_idle(result: FitResult) -> FitResult:
    """A fit without the harmonics that it has found to be nothing."""
    plant = replace(result.plant, effects=tuple(map(lean, result.plant.effects)))
    misfit, x = result.misfit.onto(plant, result.vector)
    return result if misfit.coordinates.size == result.misfit.coordinates.size else refine(misfit, x)


def without_vanished(found: FitResult) -> FitResult:
    """A fit without the elements of friction that have come to next to nothing, where it leaves as much without them.

    How stiff such an element is no data tell, and beside it those of the others look as little told.
    """
    if "gms" not in found.plant:
        return found
    kept = np.asarray(found.plant["gms"].fraction) > _VANISHED
    if kept.all():
        return found
    plant, memories = _of_elements(found, kept)
    misfit = Misfit(plant, found.misfit.observations)
    other = refine(misfit, misfit.vector(plant, memories))
    return other if other.error <= _AS_MUCH * found.error else found


def spring_instead(now: FitResult) -> tuple[Misfit, Array] | None:
    """The problem of a plant that has no spring with one in the place of the elements of friction that slip in no
    record, or late, and where to start; None where there are none.

    Such an element may hold another torque as each record begins, and has so stood for a spring in any number of them.
    """
    plant, observations = now.plant, now.misfit.observations
    if "gms" not in plant:
        return None
    stuck = stuck_within(plant["gms"], _SOFT * max(float(np.ptp(o.position)) for o in observations))
    if not stuck.any() or stuck.all():
        return None
    stiffness = float(np.asarray(plant["gms"].stiffness)[stuck].sum())
    rest, memories = _of_elements(now, ~stuck)
    with_spring = rest + effects.find("spring")(stiffness=stiffness, preload=0.0)
    misfit = Misfit(with_spring, observations)
    return misfit, misfit.vector(with_spring, memories)


def _of_elements(found: FitResult, kept: NDArray[np.bool_]) -> tuple[Plant, list[Array]]:
    """The plant of a fit with some of its elements of friction, and the state of it before each record."""
    law, place = found.plant["gms"], found.plant.memory_places["gms"]
    share = np.asarray(law.fraction)[kept]
    whole = float(share.sum())
    fewer = law.replace(
        stiffness=np.asarray(law.stiffness)[kept], fraction=share / whole,
        coulomb=whole * float(np.asarray(law.coulomb)), static=whole * float(np.asarray(law.static)),
    )  # fmt: skip
    gone = place.start + np.flatnonzero(~kept)
    memories = found.misfit.memories(found.vector, found.misfit.n_memory)
    return found.plant.replace(fewer), [np.delete(m, gone) if len(m) else m for m in memories]


def _better(now: FitResult, left: HeldOut, result: FitResult, share: float) -> tuple[FitResult, HeldOut]:
    """The other fit with what it leaves, where that is so much less of what is not noise; else the present one.

    The law is there in either and its shape is no discovery: one test is made of it and not one of a catalogue, and at
    the noise floor too it takes of the rest alone.
    """
    held_out = cross_validated(result.misfit, result.vector)
    floor = min(floor_of(now), floor_of(result))
    worth = left.total > now.negligible and takes_of_both(now, left, result, held_out, floor, share)
    if worth and p_value(left, held_out) < _SIGNIFICANT:
        return result, held_out
    return now, left
