"""Candidates: the effects that could be added to a plant, and where the search for each begins.

An effect that could be added has strengths, at whose zero it is absent, and other parameters, of which a grid is tried.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..effect import LOADED, Effect
from ..parameter import DECELERATION, KELVIN, WAVES, Parameter
from ..plant import Plant
from .frf_observation import FrfObservation, Seen
from .inverse import Observation
from .scales import Scales
from .servo_observation import ServoObservation
from .starts import LAWS, of_one_law, to_identify

Array = NDArray[np.float64]

GENERAL_LAWS = ("gms", "lugre")
CONTAINED_LAWS = ("coulomb", "stribeck", "dahl")  # in each of these
_NATIVE = "frictionloss"  # what MuJoCo has, and no bearing
VANISHED = 1e-6  # of what a strength was, or of the strongest harmonic
_ROUND = 0.95  # of the revolution: visited as good as whole
_STRAIGHT = 0.05  # of a revolution, over which a sine of it is a straight line
PART_OF_WAVE = 0.25  # that a record passes through at least
ORDERS = 48  # harmonics tried per revolution; of more those that stand out
_RESONANCES = 10  # frequencies tried over the range of responses
_CLOSE = 0.12  # ratio of widths of a play, less 1, that are looked at one after the other
_END = 0.99  # of the most that a strength may be
_MOST_HIDDEN = 0.8  # of the inertia
# Of the largest that is asked of a drive, at which it may be at its limit: the lower ones where one record asks for far
# more than the others, and half of all is below.
_OF_LARGEST = np.array([0.06, 0.08, 0.11, 0.15, 0.2, 0.27, 0.37, 0.5, 0.7, 0.85, 0.95])
_HALF = 0.5
ANEW = "anew"  # parameter that tells what begins with each record from what follows one clock
_LATER = 0.1  # of the longest record, by which another begins later that is not at once
_WIDE = 2.0  # times by how much the temperature varies: what falls exponentially over it is hardly bent


def _laws_aside(plant: Plant) -> tuple[str, ...]:
    """Laws of friction that are not added to those of a plant.

    `gms` and `lugre` are general forms: beside them the others have nothing of their own to add, nor beside a
    `stribeck` that creeps, which takes the place of these where it describes more. The first two are no small change of
    anything else, nor is `frictionloss`: see `with_general_laws`.
    """
    alone = (*GENERAL_LAWS, _NATIVE)
    whole = _creeps(plant) or any(name in plant for name in alone)
    return (*alone, *CONTAINED_LAWS) if whole else alone


def _creeps(plant: Plant) -> bool:
    return "stribeck" in plant and bool(plant["stribeck"].creep_velocity)


def has_general_law(plant: Plant) -> bool:
    """Whether a plant has friction that data may tell from any other, rather than a simple law that may lack one."""
    return any(name in plant for name in GENERAL_LAWS)


def with_one_law(plant: Plant) -> tuple[Plant, str]:
    """The plant with the first of its general laws of friction alone, beside which any other is free to become a
    constant, and a sentence on several laws; the same, and nothing, with one."""
    said = of_one_law(plant)
    general = next((e.name for e in plant.effects if e.name in GENERAL_LAWS), None)
    if not said or general is None:
        return plant, said
    kept = tuple(e for e in plant.effects if e.name == general or e.name not in LAWS)
    return replace(plant, effects=kept), f"{said}: that is {general} here"


def with_general_laws(plant: Plant) -> dict[str, Plant]:
    """The plant with each of the general laws of friction, not fitted, in the place of those that it contains, by the
    name of the law; none where the plant has one already."""
    if _creeps(plant) or has_general_law(plant):
        return {}
    rest = tuple(e for e in plant.effects if e.name not in (*CONTAINED_LAWS, _NATIVE))
    return {name: replace(plant, effects=(to_identify(name), *rest)) for name in GENERAL_LAWS}


# Effects that a frequency response cannot show: it has no clock, no load, and no place on the revolution; and what
# differs between the directions is in the mean and the even harmonics, while the fundamental has the mean of both.
_NEED_RECORDS = (
    "thermal_drift", "load_dependent_friction", "encoder_eccentricity", "position_dependent_friction",
    "asymmetric_friction", "torque_offset",
)  # fmt: skip


# Drive effects that act on the goal of a servo as they act on the torque of an axis.
_ON_GOALS = ("delay", "least_duty")


def _on_servos(plant: Plant) -> list[type[Effect]]:
    """The effects that could be added to a servo: those on its shaft, a delay of its goal, and a least duty.

    Not those that need a temperature, or that put a part of the inertia behind a coupling.
    """
    known = [e for e in effects.CATALOGUE.values() if e.is_native and (e.name not in plant or grows(e))]
    known = [e for e in known if e.name not in (*_laws_aside(plant), "thermal_drift")]
    known = [e for e in known if not any(p.unit == "kg m^2" for p in e.parameters)]
    return known + [effects.find(n) for n in _ON_GOALS if n not in plant]


def applicable(plant: Plant, observations: Sequence[Seen] = ()) -> list[type[Effect]]:
    """The effects of the catalogue that could be added to a plant.

    Not those that it has, unless one more harmonic can be added; not those contained in its friction; none that comes
    once in a revolution where no record sees a twentieth of it, in which a sine is a straight line; on a slide joint
    none that comes once in a revolution, and waves over the place only where two records hold them to it, for zero is
    often set anew (both of EMPS have a ripple every 2.50 mm, the phases 0.7 mm apart); and from frequency responses
    alone none that they cannot show.
    """
    if any(isinstance(o, ServoObservation) for o in observations):
        return _on_servos(plant)
    contained = _laws_aside(plant)
    if observations and all(isinstance(o, FrfObservation) for o in observations):
        sizes = np.abs(np.concatenate([o.torque for o in observations if isinstance(o, FrfObservation)]))
        one_level = sizes.max() < 2 * sizes.min()  # a limit is then a gain like any other
        contained = (*contained, *_NEED_RECORDS, *(["torque_saturation"] if one_level else []))
    out = [e for name, e in effects.CATALOGUE.items() if name not in contained and (name not in plant or grows(e))]
    out = [e for e in out if e.kind != "controller"]  # a record of torque says nothing about one
    runs = [o for o in observations if isinstance(o, Observation)]
    if runs and max(float(np.ptp(o.position)) for o in runs) < _STRAIGHT * 2 * math.pi:
        out = [e for e in out if not has_phase(e) or grows(e)]
    waves = len(runs) > 1
    return [e for e in out if plant.kind == "hinge" or not has_phase(e) or (waves and grows(e))]


def joined(plant: Plant, effect: Effect) -> Plant:
    """The plant with an effect added, or with its elements added to those that the plant has of it.

    A body behind a coupling is a part of the axis: it begins with at most `_MOST_HIDDEN` of what moves with the joint.
    """
    most = _MOST_HIDDEN * plant.driven_inertia if plant.inertia else math.inf
    if effect.hidden_inertia > most:
        effect = effect.replace(inertia=most)
    return plant.replace(merged(plant[effect.name], effect)) if effect.name in plant else plant + effect


def merged(one: Effect, other: Effect) -> Effect:
    """An effect with the elements of both."""
    own = {p.name for p in one.parameters if p.per_element}
    more = {k: (*np.atleast_1d(v), *np.atleast_1d(other.values[k])) for k, v in one.values.items() if k in own}
    return one.replace(**more)


def grows(effect: type[Effect]) -> bool:
    """Whether an effect is a series of harmonics, to which one more can be added."""
    return any(p.unit == WAVES and p.per_element for p in effect.parameters)


def lean(effect: Effect) -> Effect:
    """An effect without those of its harmonics that have come to nothing; at least one stays."""
    if not grows(type(effect)):
        return effect
    (first, *_) = strengths(type(effect))
    size = np.abs(np.atleast_1d(effect.values[first.name]))
    kept = size > VANISHED * size.max()
    if kept.all() or not kept.any():
        return effect
    own = [p.name for p in effect.parameters if p.per_element]
    return effect.replace(**{k: np.atleast_1d(effect.values[k])[kept] for k in own})


def strengths(effect: type[Effect]) -> list[Parameter]:
    """Parameters at whose zero the effect is absent; none of a general law of friction, which is there or is not."""
    if effect.name in GENERAL_LAWS:
        return []
    return [p for p in effect.parameters if p.default == 0 and p.free and p.name != "phase" and not p.is_scale]


def is_present(effect: Effect) -> bool:
    """Whether an effect is more than a name: its first strength, which it is named for, has not vanished, nor one that
    is as large at least, as friction at rest where another law has the level of sliding."""
    first = strengths(type(effect))[:1]
    named = [p.name for p in effect.parameters if p in first or p.at_least in [f.name for f in first]]
    return not first or any(np.any(np.abs(np.asarray(effect.values[name])) > 1e-12) for name in named)


def is_possible(effect: Effect) -> bool:
    """Whether an effect is what it is called: not at the end of what its strengths may be, where something else would
    want it stronger still; and a resonance that is damped so far that it is none only where its default is that."""
    table = {p.name: p for p in effect.parameters}
    bounded = [p for p in strengths(type(effect)) if p.upper < math.inf]
    inside = all(np.all(np.asarray(effect.values[p.name]) < _END * p.upper) for p in bounded)
    damping = table.get("damping")
    if damping is None or damping.unit != "1" or damping.default >= 1:
        return inside
    return inside and float(np.ravel(effect.values["damping"])[0]) < 1


def is_open(effect: Effect) -> bool:
    """Whether it takes a look at what is left without an effect to begin with it: it lacks values, or it is absent and
    would do something else with another phase, which a strength of zero does not show. Laws of friction aside."""
    if effect.kind == "controller" or effect.name in LAWS:
        return False
    return bool(effect.unset) or (has_phase(type(effect)) and not is_present(effect))


def absent(effect: Effect) -> Effect:
    """The effect at strengths of zero; itself where it has none."""
    return effect.replace(**{p.name: 0 * np.asarray(effect.values[p.name]) for p in strengths(type(effect))})


def stronger(plant: Plant, factor: float) -> Plant:
    """The plant with a multiple of all its friction, at rest and sliding."""
    for e in plant.effects:
        if e.kind == "friction" and not e.modulates:
            torques = [p.name for p in e.parameters if p.unit.startswith("N")]
            plant = plant.replace(e.replace(**{k: factor * np.asarray(e.values[k]) for k in torques}))
    return plant


def has_phase(effect: type[Effect]) -> bool:
    """Whether the effect is a harmonic with a free phase: two quadratures of one strength."""
    return any(p.name == "phase" for p in effect.parameters)


def shapes(
    effect: type[Effect], scales: Scales, observations: Sequence[Seen], plant: Plant | None = None
) -> Iterator[dict[str, float]]:
    """Values to try for the parameters that are neither strengths nor phases; no harmonic that `plant` has."""
    grids: dict[str, Sequence[float]] = {}
    for p in effect.parameters:
        if p.unit == KELVIN and scales[p.unit]:
            grids[p.name] = [0.0, _WIDE * scales[p.unit]]
        if p.name == ANEW and begin_apart(observations):
            grids[p.name] = [0.0, 1.0]
        if p.unit == DECELERATION and any(isinstance(o, Observation) for o in observations):
            grids[p.name] = [0.0, scales[p.unit]]
        if p.name == "phase" or not math.isnan(p.default):
            continue
        if plant is not None and plant.kind == "slide" and p.unit == WAVES:
            return  # as many as there are lengths: see `place_spectrum`
        values: Sequence[float] | Array = _grid(effect, p, scales, observations, plant)
        if plant is not None and effect.name in plant:
            values = [v for v in values if v not in np.atleast_1d(plant[effect.name].values[p.name])]
        grids[p.name] = [float(v) for v in np.clip(values, p.lower, p.upper)]
    for chosen in itertools.product(*grids.values()):
        yield dict(zip(grids, chosen, strict=True))


def begin_apart(observations: Sequence[Seen]) -> bool:
    """Whether all are records, by one clock that goes on between them by more than a part of the longest: what fades
    with time may have gone on, too, or begun anew. A response has no beginning."""
    runs = [o for o in observations if isinstance(o, Observation)]
    if not runs or len(runs) < len(observations):
        return False
    return float(np.ptp([o.record.time[0] for o in runs])) > _LATER * max(o.duration for o in runs)


def width_of(effect: type[Effect]) -> str | None:
    """The parameter that is the width of a play; None for an effect without one."""
    return next((p.name for p in effect.parameters if p.unit == "rad" and math.isnan(p.default)), None)


def widths(
    effect: type[Effect], scales: Scales, observations: Sequence[Seen], plant: Plant
) -> Iterator[dict[str, float]]:
    """Values to try, one width of a play close to the next; none for an effect without a play.

    A motion takes up a play or does not: a tenth beside the right one it shows as little as any other.
    """
    name, grid = width_of(effect), list(shapes(effect, scales, observations, plant))
    if name is None or not grid:
        return
    least, most = (f(shape[name] for shape in grid) for f in (min, max))
    others = [shape for shape in grid if shape[name] == least]
    usual = others[len(others) // 2]
    for value in np.geomspace(least, most, math.ceil(math.log(most / least) / _CLOSE) + 1):
        yield {**usual, name: float(value)}


def _grid(
    effect: type[Effect], p: Parameter, scales: Scales, observations: Sequence[Seen], plant: Plant | None
) -> Sequence[float] | Array:
    """What a parameter may typically be, by its unit and what the records span."""
    span = float(np.median([np.ptp(o.position) for o in observations]))
    if p.unit == WAVES:
        # A torque once per revolution is gravity's. A harmonic that the motion does not pass through once cannot be
        # told from a spring or an offset; friction that no record passes through once, from what a load leaves of its.
        if effect.modulates:
            turn, least = longest_way(observations), 1 if plant is not None and LOADED in plant else PART_OF_WAVE
        else:
            turn, least = _visited(observations) / _ROUND, 1
        return [n for n in range(1 if effect.modulates else 2, ORDERS + 1) if n * turn >= least]
    if p.unit == "Hz":
        highest = max(o.bandwidth for o in observations)
        # A contact that knocks is heard at any stiffness; a resonance only at its own frequency.
        if width_of(effect):
            return np.minimum([30.0, 60.0, 120.0], [0.3 * highest, highest, highest])
        frfs = [o.frf.frequency for o in observations if isinstance(o, FrfObservation)]
        if len(frfs) == len(observations):
            return np.geomspace(1.5 * min(f[0] for f in frfs), highest / 1.5, _RESONANCES)
        return highest * np.array([0.06, 0.12, 0.25, 0.5, 1.0])
    if p.unit == "s":
        return max(o.duration for o in observations) * np.array([0.05, 0.2, 0.8])
    if p.unit == "rad":
        finest = max(3 * max(_count(o) for o in observations), 1e-4 * span)
        return np.geomspace(finest, max(0.1 * span, 2 * finest), 9)
    if p.unit == "N m" and effect.kind == "drive":
        asked = np.abs(np.concatenate([o.commands for o in observations]))
        limits = np.max(asked) * _OF_LARGEST
        return limits[(limits > np.median(asked)) | (_OF_LARGEST >= _HALF)]
    if p.unit == "N m":
        return scales.torque * np.array([0.2, 0.6])
    if p.unit == "N m/rad":  # of a contact: it slips after a small part of the motion
        return scales.torque / (span * np.array([1e-4, 1e-3, 1e-2]))
    return scales[p.unit] * np.array([0.1, 1.0, 10.0])


def _visited(observations: Sequence[Seen]) -> float:
    """Share of the revolution that the records have been at."""
    bins = 8 * ORDERS
    been = [np.unique(np.floor(o.position * (bins / (2 * math.pi))).astype(int) % bins) for o in observations]
    return len(np.unique(np.concatenate(been))) / bins


def longest_way(observations: Sequence[Seen]) -> float:
    """Revolutions that the longest way of a record from end to end is."""
    return max(float(np.ptp(o.position)) for o in observations) / (2 * math.pi)


def is_part_of_wave(effect: Effect, observations: Sequence[Seen]) -> bool:
    """Whether an effect makes friction vary in waves over the place that no record passes through once."""
    if not (effect.modulates and grows(type(effect))):
        return False
    return float(np.min(effect.values["harmonics"])) * longest_way(observations) < 1


def _count(o: Seen) -> float:
    """Position of one encoder count; 0 where there is none or it is not known."""
    return (o.record.resolution or 0.0) if isinstance(o, Observation) else 0.0


def is_continuous(effect: type[Effect], name: str) -> bool:
    return any(p.name == name and p.unit in ("Hz", "rad", "s") for p in effect.parameters)


def units_of(effect: type[Effect], names: Sequence[tuple[str, float]]) -> list[str]:
    """Unit of each strength; "" where the effect has none."""
    table = {p.name: p.unit for p in effect.parameters}
    return [table.get(name, "") for name, _ in names]


def valued(effect: type[Effect], values: dict[str, float], strength: dict[str, float]) -> Effect:
    """The effect with one element and some strengths; a parameter bounded below by one of them rises with it."""
    bounded = {p.name: strength[p.at_least] for p in effect.parameters if p.at_least in strength}
    given = {**values, **bounded, **strength}
    per_element = {p.name for p in effect.parameters if p.per_element}
    arguments: dict[str, Any] = {k: [v] if k in per_element else v for k, v in given.items()}
    return effect(**arguments)


def at_strengths(effect: type[Effect], shape: dict[str, float], scales: Scales) -> Iterator[Effect]:
    """The effect at strengths that are not small: what modulates friction does then nothing like its tangent."""
    if effect.modulates and not has_phase(effect):
        p = strengths(effect)[0]
        for share in (-0.3, -0.1, 0.1, 0.3):
            value = share * scales[p.unit]
            if p.lower <= value <= p.upper:
                yield valued(effect, shape, {p.name: value})


def with_strengths(
    effect: type[Effect], shape: dict[str, float], names: Sequence[tuple[str, float]], value: Array, scales: Scales
) -> Effect:
    """The effect at the strengths that the linear refit found, never quite zero so that a fit can move them."""
    found: dict[str, float] = {}
    phase: dict[str, float] = {}
    if has_phase(effect):
        name = names[0][0]
        upper = next(p.upper for p in effect.parameters if p.name == name)
        found[name] = min(math.hypot(value[0], value[1]), upper)
        phase["phase"] = math.atan2(value[1], value[0])
    elif strengths(effect):
        table = {p.name: p for p in effect.parameters}
        for (name, _), v in zip(names, value, strict=True):
            p = table[name]
            least = 1e-3 * scales[p.unit]
            found[name] = float(np.clip(v if abs(v) > least else least, p.lower, p.upper))
            if p.at_least:
                found[name] += found.get(p.at_least, 0.0)  # its tangent is what it is above that one
    return valued(effect, {**shape, **phase}, found)
