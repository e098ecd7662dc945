"""Where a fit starts: values for parameters that have none yet, from the data alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from .. import effects
from ..effect import Effect
from ..errors import ModelError, listing
from ..plant import Plant
from ..threads import each
from .frf_observation import FrfObservation, Seen
from .inverse import Observation
from .scales import Scales
from .servo_observation import ServoObservation
from .servo_starts import servo_starts

Array = NDArray[np.float64]

_GRID = 20  # break-away distances tried
_WIDEST = 0.3  # of the travel: one that breaks away later hardly slips both ways
# An element that slips only after many times the usual distance is a spring with an unknown offset in every record:
# it would hide gravity, asymmetry and drift. In units of the median break-away distance.
LONGEST_BREAK_AWAY = 20.0
_SOME = 0.01  # of the level: elements with less are not the friction beside which others are springs
_ABOUT = 1.1  # times the softest that an element may be: it would be softer
_IDLE = 1e-3  # of the level: an element with less does nothing
_APART = 1.5  # times as soft, and as stiff, as an element are those that it is parted into
_FINE_GRID = 40  # the same from frequency responses, whose amplitudes tell more
_STUCK = 0.5  # of the largest amplitude: at the level it starts from no element breaks away at twice that
_SLIPS = 0.6  # of it: an element that breaks away there shows that it does
_FURTHER = 2.0  # times as late an element may slip where amplitudes tell when it does
_FINEST = 0.3  # of their smallest amplitude
_WEAKER = 1.05  # static level over that of sliding
_STRIBECK_VELOCITIES = (0.03, 0.3, 3.0)  # in units of the rms velocity
_CREEP_VELOCITIES = (0.03, 0.001)  # the same: from above, for below the slowest motion none is told from another
_CREEP_TIME = 5e-3  # s, as far from the least as from the longest that MuJoCo's time steps make likely
_AT_ONCE = 20.0  # times as fast as the samples come: a level that is followed faster is followed within any instant
_BENT = 0.25, 4.0  # exponents of Stribeck curves, beyond which they are steps
_SETTLES = 3.0  # times as long as the records last: what settles more slowly has one level in all of them
_FAR = 0.3  # of the mean speed of the fastest record: those as fast slide through what a slow one hangs on
LAWS = ("gms", "lugre", "dahl", "stribeck", "frictionloss")  # of friction, that the data start
ELEMENTS = 8  # of a law that has elements, if nobody asks for another number


def to_identify(law: str, **values: float) -> Effect:
    """A law of friction by its name, to be identified but for the values given."""
    effect = effects.find(law)
    return effect(ELEMENTS if any(p.per_element for p in effect.parameters) else None, **values)


def of_one_law(plant: Plant) -> str:
    """That a plant has several laws of friction, each of which is all of it; empty where it has one or none."""
    laws = [e.name for e in plant.effects if e.name in LAWS]
    return "" if len(laws) < 2 else (
        f"{listing(laws)} are each a law of all the friction, and data can hardly tell what is whose; one of them is "
        "enough"
    )  # fmt: skip


def starts(plant: Plant, observations: Sequence[Seen]) -> list[Plant]:
    """Plants like `plant` with every parameter set, to start a fit from; more than one where it may matter.

    Raises:
        ModelError: a parameter has no value, is not identified by a fit, and cannot be guessed.
    """
    servos = [o for o in observations if isinstance(o, ServoObservation)]
    if servos:
        return servo_starts(plant, servos)
    scales = Scales.of(observations)
    law = next((e for e in plant.effects if e.name in LAWS and e.unset), None)
    rest = [_typical(e, scales) for e in plant.effects if e is not law]
    if law is None:
        inertia = scales["kg m^2"] if plant.inertia is None else plant.inertia
        first = replace(plant, inertia=inertia, effects=tuple(rest))
        return [replace(first, inertia=_maxwell_slip(first, (), observations)[0])] if plant.inertia is None else [first]

    distances = break_away_distances(observations)
    others = replace(plant, effects=tuple(rest))
    sprung = "spring" in plant
    inertia, viscous, levels, stuck = _maxwell_slip(others, distances, observations, spring=True)
    if not any(isinstance(o, Observation) for o in observations):
        latest = _latest(distances, levels, observations, sprung)
        if sprung or latest < distances[-1]:  # what slips later, if ever, is a spring, of the plant or yet to be found
            stuck += float(np.sum((levels / distances)[distances > latest]))
            levels = np.where(distances <= latest, levels, 0.0)
        else:  # an element that never slips is no less likely than a spring
            inertia, viscous, levels, stuck = _maxwell_slip(others, distances, observations)
    if sprung and stuck > 0 and not plant["spring"].stiffness:
        rest = [e.replace(stiffness=stuck) if e.name == "spring" else e for e in rest]
    if "viscous" in others and not plant["viscous"].coefficient:
        rest = [e.replace(coefficient=viscous) if e.name == "viscous" else e for e in rest]
    group = gathered if any(isinstance(o, FrfObservation) for o in observations) else _grouped
    stiffness, share, level = group(distances, levels, law.elements)
    if "fraction" in law.values and "stiffness" in law.unset and np.ptp(law.fraction) < 1e-12:
        law = law.replace(fraction=share)  # equal shares are what nobody has chosen
    found: dict[str, object] = {
        "stiffness": stiffness if law.name == "gms" else _of_one_bristle(distances, levels, level),
        "coulomb": level, "static": _WEAKER * level, "attraction": _attraction(level, scales),
        "creep_time": _CREEP_TIME,
    }  # fmt: skip
    out = []
    velocities = _velocities(observations, scales) if "stribeck_velocity" in law.unset else (None,)
    creeps = [c * scales["rad/s"] for c in _CREEP_VELOCITIES] if "creep_velocity" in law.unset else (None,)
    for velocity, creep in itertools.product(velocities, creeps):
        started = _with(law, **found, stribeck_velocity=velocity, creep_velocity=creep)
        by_name = {e.name: e for e in (*rest, started)}
        out.append(replace(plant, inertia=inertia, effects=tuple(by_name[e.name] for e in plant.effects)))
    return out


def other_weakenings(plant: Plant, found: Plant, observations: Sequence[Seen]) -> list[Plant]:
    """A plant that was found, with each weakening of friction that a fit of `plant` may start from; none where its law
    has a Stribeck velocity already."""
    law = next((e for e in plant.effects if e.name in LAWS and "stribeck_velocity" in e.unset), None)
    if law is None or any(isinstance(o, ServoObservation) for o in observations):
        return []
    return [found.replace(weakened(found[law.name], v)) for v in _velocities(observations, Scales.of(observations))]


def weakened(law: Effect, velocity: float) -> Effect:
    """A law of friction that weakens about another velocity [rad/s], and by enough to be seen."""
    static = max(float(np.asarray(law.static)), _WEAKER * float(np.asarray(law.coulomb)))
    return law.replace(static=static, stribeck_velocity=velocity)


def slipping_anew(plant: Plant, found: Plant, observations: Sequence[Seen], names: Collection[str]) -> Plant | None:
    """A plant that a fit of `plant` to frequency responses found, with values of `names` (`attraction`, `static`) for
    its friction as at the start; None where the fit did not choose these, or records tell.

    Few points tell little of how fast elements follow their level and of how far that falls, and many minima that
    differ in them lie side by side: which of them a fit falls into, rounding decides.
    """
    if "gms" not in plant or not set(names) <= set(plant["gms"].unset):
        return None
    if not all(isinstance(o, FrfObservation) for o in observations):
        return None
    law, level = found["gms"], float(np.asarray(found["gms"].coulomb))
    begun = {"attraction": _attraction(level, Scales.of(observations)), "static": _WEAKER * level}
    return found.replace(law.replace(**{name: begun[name] for name in names}))


def shared_anew(plant: Plant, found: Plant, observations: Sequence[Seen]) -> Plant | None:
    """A plant that a fit of `plant` to frequency responses found, with an element that has nothing to do in the place
    of half of the one that has most; None where each has something to do, the fit did not choose them, or records tell.

    An element whose share has come to nothing stays so: no step from there makes it useful.
    """
    if "gms" not in plant or "stiffness" not in plant["gms"].unset:
        return None
    frfs = [o for o in observations if isinstance(o, FrfObservation)]
    law = found["gms"]
    if len(frfs) < len(observations) or law.elements < 2:
        return None
    share, stiffness = np.array(law.fraction, float), np.array(law.stiffness, float)
    distance = share * float(np.asarray(law.coulomb)) / stiffness
    least, most = int(np.argmin(share)), int(np.argmax(share))
    if share[least] > _IDLE or distance[least] > _FINEST * min(float(o.size.min()) for o in frfs):
        return None
    share[most], share[least] = 0.5 * share[most], 0.5 * share[most] + share[least]
    stiffness[most], stiffness[least] = 0.5 * stiffness[most] / _APART, 0.5 * stiffness[most] * _APART
    return found.replace(law.replace(fraction=share, stiffness=stiffness))


def sliding_furthest(observations: Sequence[Seen]) -> list[Observation]:
    """The records that move furthest in their time; none where the others move about as far, or there are responses."""
    records = [o for o in observations if isinstance(o, Observation)]
    if len(records) < len(observations):
        return []
    speeds = [float(np.mean(np.abs(o.velocity))) for o in records]
    furthest = [o for o, speed in zip(records, speeds, strict=True) if speed > _FAR * max(speeds)]
    return furthest if len(furthest) < len(records) else []


def _attraction(level: float, scales: Scales) -> float:
    """Where the rate at which elements follow their level starts [N m/s]."""
    return 0.1 * level / scales["s"]


def _velocities(observations: Sequence[Seen], scales: Scales) -> list[float]:
    """Stribeck velocities to start from [rad/s]."""
    fastest = max(float(np.abs(o.velocity).max()) for o in observations)
    return [min(factor * scales["rad/s"], fastest) for factor in _STRIBECK_VELOCITIES]


def _of_one_bristle(distances: Array, levels: Array, level: float) -> float:
    """Stiffness of a bristle whose force, level (1 - exp(-stiffness x / level)) from rest, passes half of its level
    where springs of these break-away distances together do [N m/rad]."""
    force = np.minimum(distances[:, None] / distances, 1.0) @ levels
    half = float(np.interp(0.5 * level, force, distances))
    return level * math.log(2) / half


def break_away_distances(observations: Sequence[Seen]) -> Array:
    """Break-away distances to try: those that the records pass, and those that the amplitudes of responses tell."""
    grids = []
    records = [o for o in observations if isinstance(o, Observation)]
    if records:
        span = max(float(np.ptp(o.position)) for o in records)
        finest = 3 * min(o.record.resolution or 0.0 for o in records)
        grids.append(np.geomspace(min(max(finest, 1e-5 * span), 1e-3 * span), _WIDEST * span, _GRID))
    sizes = [o.size for o in observations if isinstance(o, FrfObservation)]
    if sizes:
        size = np.concatenate(sizes)
        grids.append(np.geomspace(_FINEST * size.min(), size.max(), _FINE_GRID))
    return np.sort(np.concatenate(grids))


def _latest(distances: Array, levels: Array, observations: Sequence[Seen], sprung: bool) -> float:
    """The longest break-away distance that frequency responses let an element have.

    Twice the largest amplitude; where that is many times the usual distance, so that the other elements have all
    slipped long ago, or where the plant has a spring, less than the amplitude: there an element is told from a spring.

    Args:
        sprung: whether the plant has a spring.
    """
    largest = max(float(o.size.max()) for o in observations if isinstance(o, FrfObservation))
    usual = weighted_median(distances, levels) if levels.any() else largest
    longest = _FURTHER * LONGEST_BREAK_AWAY * usual
    if sprung:
        return min(longest, _SLIPS * largest)
    return longest if longest < _SLIPS * largest else largest / _STUCK


def visible_limits(plant: Plant, observations: Sequence[Seen]) -> dict[str, tuple[float, float]]:
    """Lower and upper limit of parameters beyond which these observations say nothing about them, by label.

    A drive that cuts off most of what it is asked for would leave nothing to explain, least of all with an inertia and
    a friction of nearly zero: at least half of the commands stay below the limit of `torque_saturation`. A fit would
    find no way back from a level that weakens beyond the fastest speed, or, of `gms`, from an element that is too soft,
    never slips and is a spring, or from a level that is followed faster than the samples come. A curve of a larger
    exponent than 4, or of a smaller than 1 / 4, is not told from a step. One resonance is told from another only below
    half of their rate. Friction that settles over much more than the time of the records would be another unit of all
    of it. A value that the plant has already is inside.
    """
    limits: dict[str, tuple[float, float, float]] = {}
    if "torque_saturation" in plant and not plant["torque_saturation"].unset:
        middle = float(np.median(np.abs(np.concatenate([o.commands for o in observations]))))
        limits["torque_saturation.limit"] = (middle, np.inf, float(np.asarray(plant["torque_saturation"].limit)))
    for e in plant.effects:
        if e.name in LAWS and "stribeck_velocity" in e.values and not e.unset:
            limits[f"{e.name}.stribeck_velocity"] = _visible_weakening(e, observations)
            limits[f"{e.name}.stribeck_exponent"] = (*_BENT, float(np.asarray(e.values["stribeck_exponent"])))
    timed = [o.time for o in observations if isinstance(o, Observation)]
    if "thermal_drift" in plant and not plant["thermal_drift"].unset and timed:
        longest = max(float(np.ptp(t)) for t in timed)
        span = max(float(t[-1]) for t in timed) - min(float(t[0]) for t in timed)
        drift = plant["thermal_drift"]
        most = _SETTLES * (longest if drift.anew else span)
        limits["thermal_drift.time_constant"] = (1e-3 * longest, most, float(np.asarray(drift.time_constant)))
    if timed:
        fastest = 0.5 / min(o.sample_time for o in observations if isinstance(o, Observation))
        for e in plant.effects:
            for p in (p for p in e.parameters if p.unit == "Hz" and p.name not in e.unset):
                limits[f"{e.name}.{p.name}"] = (0.0, fastest, float(np.asarray(e.values[p.name])))
    if "gms" in plant and not plant["gms"].unset:
        limits |= _visible_gms(plant, observations)
    return {k: (min(lo, float(v)), max(hi, float(v))) for k, (lo, hi, v) in limits.items()}


def _visible_weakening(law: Effect, observations: Sequence[Seen]) -> tuple[float, float, float]:
    """Lower and upper limit of the Stribeck velocity of a law, and the one that it has [rad/s]."""
    fastest = max(float(np.abs(o.velocity).max()) for o in observations)
    slowest = 1e-3 * min(float(np.sqrt(np.mean(o.velocity**2))) for o in observations)
    frfs = [o for o in observations if isinstance(o, FrfObservation)]
    if len(frfs) == len(observations):  # a weakening at speeds where nothing slides is not seen
        total = float(np.asarray(law.coulomb))
        sliding = [o.velocity for o in frfs if np.abs(o.torque).max() > total]
        if sliding:
            slowest = max(slowest, 0.01 * min(float(np.sqrt(np.mean(v**2))) for v in sliding))
    return slowest, fastest, float(np.asarray(law.stribeck_velocity))


def _visible_gms(plant: Plant, observations: Sequence[Seen]) -> dict[str, tuple[float, float, float]]:
    gms = plant["gms"]
    stiffness, level = np.asarray(gms.stiffness), np.asarray(gms.fraction) * np.asarray(gms.coulomb)
    total, softest = float(level.sum()), _softest(level, stiffness, observations)
    step = min(o.sample_time for o in observations)
    duration = max(o.duration for o in observations)
    names = [f"gms.stiffness[{i}]" for i in range(gms.elements)] if gms.elements > 1 else ["gms.stiffness"]
    softer = np.full(gms.elements, softest)
    frfs = [o for o in observations if isinstance(o, FrfObservation)]
    if len(frfs) == len(observations):  # one that never slipped at any amplitude is told from no other such
        latest = _latest(level / stiffness, level, observations, "spring" in plant)
        largest = max(float(o.size.max()) for o in frfs)
        # An element that starts small would become a spring as its share grows.
        softer = (np.maximum(level, level.mean()) if latest < largest else level) / latest
    limits = {n: (float(low), np.inf, float(k)) for n, low, k in zip(names, softer, stiffness, strict=True)}
    limits["gms.attraction"] = (0.1 * total / duration, _AT_ONCE * total / step, float(np.asarray(gms.attraction)))
    if len(frfs) == len(observations):  # a level that no torque reached is not seen
        hardest = float(max(np.abs(o.torque).max() for o in frfs))
        above = float(np.asarray(gms.static) - np.asarray(gms.coulomb))
        limits["gms.static"] = (0.0, max(hardest - total, 0.1 * total), above)  # its coordinate: above the other level
    return limits


def _softest(level: Array, stiffness: Array, observations: Sequence[Seen]) -> float:
    """The softest that an element of friction may be, of those with these levels and stiffnesses."""
    return float(level.mean()) / longest_break_away(level / stiffness, level, observations)


def is_softest(gms: Effect, observations: Sequence[Seen]) -> bool:
    """Whether an element with some of the level is as soft as these observations let one be."""
    stiffness, level = np.asarray(gms.stiffness), np.asarray(gms.fraction) * float(np.asarray(gms.coulomb))
    some = level > _SOME * level.sum()
    return bool(np.any(stiffness[some] <= _ABOUT * _softest(level, stiffness, observations)))


def longest_break_away(distances: Array, levels: Array, observations: Sequence[Seen]) -> float:
    """The longest break-away distance that these observations let an element of friction have, beside these others.

    What hardly slips in the travel of any record does not say what is usual, nor does one so much softer than the
    others as a spring is: it would make room for itself.
    """
    travel = max((float(np.ptp(o.position)) for o in observations if isinstance(o, Observation)), default=math.inf)
    slips = distances <= _WIDEST * travel
    weights = np.where(slips, levels, 0.0) if levels[slips].any() else levels
    return LONGEST_BREAK_AWAY * _usual(distances, weights)


def _usual(distance: Array, level: Array) -> float:
    """The median break-away distance of the elements that are not so much softer than the others as a spring is, which
    may hold most of the level. Elements with next to none of it, however stiff, say nothing of what is usual."""
    order = np.argsort(distance)
    distance, level = distance[order], level[order]
    stiff = np.cumsum(level / distance)
    for i in range(1, len(distance)):
        usual = weighted_median(distance[:i], level[:i])
        some = stiff[i - 1] > 0.5 * stiff[-1] and level[:i].sum() > _SOME * level.sum()
        if some and distance[i] > LONGEST_BREAK_AWAY * usual:
            return usual
    return weighted_median(distance, level)


def _typical(effect: Effect, scales: Scales) -> Effect:
    values = {}
    for p in effect.parameters:
        if p.name in effect.unset:
            if not p.free:
                raise ModelError(f"{effect.name}.{p.name} has no value, and a fit cannot find it; give it")
            guess = min(max(scales[p.unit], p.lower), p.upper)
            values[p.name] = (guess,) * effect.elements if p.per_element else guess
    return effect.replace(**values) if values else effect


def _with(effect: Effect, **values: object) -> Effect:
    """`effect` with those parameters set that have no value yet; a law of friction without a level has none."""
    none = (*effect.unset, *(k for k in ("coulomb", "static") if effect.values.get(k) == 0))
    return effect.replace(**{k: v for k, v in values.items() if k in none})


def _maxwell_slip(
    plant: Plant, distances: Sequence[float] | Array, observations: Sequence[Seen], spring: bool = False
) -> tuple[float, float, Array, float]:
    """Inertia, viscous coefficient, the level of one slipping spring per break-away distance, and the stiffness of what
    never slips beside them.

    A Maxwell-slip set on preset break-away distances is linear in its levels, so non-negative least squares finds
    the global optimum. An offset and a spring stand beside it: without them one that the plant does not have yet
    would be taken for elements that never slip.

    Args:
        spring: put one beside them in frequency responses too.
    """
    # What modulates friction modulates each spring too.
    bare = Plant(1.0, tuple(e for e in plant.effects if e.modulates))
    offset = [o.replay(bare) for o in observations]

    def column(e: Effect) -> Array:
        return np.concatenate([b - o.replay(bare + e) for o, b in zip(observations, offset, strict=True)])

    applied = np.concatenate([o.applied(plant) for o in observations])
    columns = [column(effects.find("viscous")(coefficient=1.0))]
    if len(distances):
        level = float(np.sqrt(np.mean(applied**2))) or 1.0
        columns = [*_slipping(bare, np.asarray(distances), level, observations), *columns]
    inertial = np.concatenate([o.acceleration for o in observations])
    known = np.concatenate([o.replay(plant) for o in observations])
    if plant.inertia is None or not plant.inertia_known:
        columns.append(inertial)
        target = applied + known
    else:
        target = applied + known - plant.driven_inertia * inertial
    beside = _offset_and_spring(observations)
    if spring and not beside:
        force = column(effects.find("spring")(stiffness=1.0))
        beside = [force, -force]
    matrix = np.column_stack([*columns, *beside])
    scale = np.maximum(np.sqrt(np.mean(matrix**2, 0)), 1e-300)
    solution = scipy.optimize.nnls(matrix / scale, target)[0] / scale
    n = len(distances)
    stuck = float(solution[-2] - solution[-1]) if beside or spring else 0.0
    if plant.inertia is not None and plant.inertia_known:
        return plant.inertia, float(solution[n]), solution[:n], stuck
    inertia = float(solution[n + 1])
    if inertia <= 0:
        inertia = 1e-3 * float(np.std(target) / np.std(inertial))
    inertia += sum(e.hidden_inertia for e in plant.effects)
    return inertia, float(solution[n]), solution[:n], stuck


def _slipping(plant: Plant, distances: Array, level: float, observations: Sequence[Seen]) -> Array:
    """(springs, m) torque that springs of level 1 take, one per break-away distance, beside what modulates friction.

    They follow their level at once, as a start knows no rate at which they would.

    Args:
        level: of all of them together [N m], by which the instants are chosen at which their torque bends.
    """
    n = len(distances)
    law = effects.find("gms")(
        stiffness=level / n / distances, fraction=np.full(n, 1 / n), coulomb=level, static=level, stribeck_velocity=1.0,
        attraction=_AT_ONCE * level / min(o.sample_time for o in observations),
    )  # fmt: skip
    whole = plant + law
    joint, number = whole.joint(), whole.number_in_joint(law.name)
    return -n / level * np.concatenate(each(lambda o: o.elements(whole, joint, number), observations), axis=1)


def _offset_and_spring(observations: Sequence[Seen]) -> list[Array]:
    """(m,) columns of a constant torque and of one in proportion to the position, with either sign; 0 in responses."""
    records = [o for o in observations if isinstance(o, Observation)]
    if not records:
        return []
    middle = float(np.mean(np.concatenate([o.position[o.index] for o in records])))
    shapes = [
        np.concatenate([f(o) if isinstance(o, Observation) else np.zeros(len(o.index)) for o in observations])
        for f in (lambda o: np.ones(len(o.index)), lambda o: o.position[o.index] - middle)
    ]
    return [sign * x for x in shapes for sign in (1.0, -1.0)]


def weighted_median(values: Array, weights: Array) -> float:
    """The value at which half of the weight is reached."""
    order = np.argsort(values)
    half = np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())
    return float(values[order][min(half, len(values) - 1)])


def _grouped(distances: Array, levels: Array, n: int) -> tuple[Array, Array, float]:
    """Stiffness, share and total level of n elements that stand for the springs on the grid."""
    levels = np.where(distances <= LONGEST_BREAK_AWAY * weighted_median(distances, levels), levels, 0.0)
    total = float(levels.sum())
    if total <= 0:
        total, levels = 1e-12, np.full(len(distances), 1e-12 / len(distances))
    middle = (np.cumsum(levels) - levels / 2) / total
    group = np.minimum((middle * n).astype(int), n - 1)
    level = np.array([levels[group == i].sum() for i in range(n)])
    stiffness = np.array([(levels / distances)[group == i].sum() for i in range(n)])
    empty = level <= 0
    # Elements that the data leaves without work start small, between the others, where a fit can grow them.
    level[empty] = 1e-3 * total
    stiffness[empty] = level[empty] / np.interp(
        (np.flatnonzero(empty) + 0.5) / n, np.sort(middle), distances[np.argsort(middle)]
    )
    # A fit moves the share more freely than the stiffness: with a share like the others none may become a spring.
    softest = total / n / (LONGEST_BREAK_AWAY * weighted_median(distances, levels))
    return np.maximum(stiffness, softest), level / level.sum(), total


def gathered(distances: Array, levels: Array, n: int) -> tuple[Array, Array, float]:
    """The same where small distances matter however little of the level breaks away there."""
    total = float(levels.sum())
    active = np.flatnonzero(levels > 1e-6 * total)
    if not len(active):
        return _grouped(distances, levels, n)
    groups = [list(g) for g in np.split(active, np.flatnonzero(np.diff(active) > 1) + 1)]
    elements = [(float(levels[g].sum()), float((levels[g] / distances[g]).sum())) for g in groups]
    while len(elements) > n:  # those that differ least become one
        x = np.log([level / k for level, k in elements])
        lesser = [min(a[1], b[1]) for a, b in pairwise(elements)]
        i = int(np.argmin(np.diff(x) * lesser))
        (a, k), (b, c) = elements[i : i + 2]
        elements[i : i + 2] = [(a + b, k + c)]
    while len(elements) < n:  # where the gap is widest an element starts small, so that a fit can grow it
        x = np.log([level / k for level, k in elements])
        if len(x) == 1:
            at, where = 1, float(x[0]) - 1
        else:
            at = int(np.argmax(np.diff(x))) + 1
            where = float(x[at - 1] + x[at]) / 2
        elements.insert(at if len(x) > 1 else 0, (1e-3 * total, 1e-3 * total / np.exp(where)))
    level, stiffness = np.array(elements).T
    return stiffness, level / level.sum(), float(level.sum())
