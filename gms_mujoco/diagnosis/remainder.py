"""What is left over looks like this: a sentence about a residual that nobody has named, and what tells its cause."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frf import drive_unit
from ..identification.between_samples import mean_torque
from ..identification.frf_observation import FrfObservation, Seen
from ..identification.inverse import Observation
from ..identification.place_spectrum import wave
from ..identification.servo_observation import ServoObservation, errors_of
from ..identification.time_spectrum import line
from ..plant import Plant

Array = NDArray[np.float64]


class Reading(NamedTuple):
    """One look of what is left.

    Attributes:
        share: of the square, that it carries.
        said: of it.
        experiment: that tells what it is; empty where the words say it.
        in_part: whether it stands in a part of what it is tied to.
    """

    share: float
    said: str = ""
    experiment: str = ""
    in_part: bool = False


class Remainder(NamedTuple):
    """What is left over.

    Attributes:
        said: where it stands, and what it looks like; empty where it stands nowhere in particular.
        share: of its square, that its most telling look carries.
        experiment: that tells what has that look; empty where it has none.
    """

    said: str = ""
    share: float = 0.0
    experiment: str = ""


NO_LOOK = Remainder()

_NOTABLE = 0.25  # of the squared residual
_DENSER = 3  # odds of the squared residual over odds of the time
_CROWDED = 1.5  # the same for runs of a servo, whose errors stay
_FAST = np.array([-0.5, 1.0, -0.5])  # what neighbours do not tell
_FOLLOWS, _MOSTLY = 0.2, 0.4  # of the torque; of the square
_CLEARLY, _HARDLY = 0.1, 0.03  # of the square: what hangs on a factor carries so much more than what does not
_BESIDE = 0.5  # of the share of the loudest of several readings: less is its shadow
_MOSTLY_THERE, _PART = 0.8, 0.3  # of what is tied to the place, in less than so much of the samples
_MOMENTS = 160  # short parts of a record
_RARE = 0.025  # of them, that hold most of what stands at few instants
_RECORDS_TOLD, _TOLD = 3, 6  # of those instants: records, and instants of each
_PARTS = 8  # of a record, over which what is left has its mean
_FEWEST_PERIODS = 4  # in a record: what comes back less often is not seen to be periodic, or to follow anything

_ON_FRICTION = " as a factor on friction"
_IN_TIME = (
    "what is periodic in time: the axis at rest with the drive on, and then off, with whatever runs beside it on and "
    "off, and the same run at another sampling rate."
)
_FRICTION_IN_TIME = (
    "what is periodic in time and turns over with the direction: the axis at several constant speeds, with whatever "
    "runs beside it, shakes it or feeds its bearing on and off. A frequency that stays is that of time."
)
_AT_PLACES = (
    "what is tied to the place: slow runs at three constant speeds or more over the same turns, in both directions. "
    "What stays the same is a torque, what turns over with the direction friction, and what grows with the speed an "
    "error of the reading or an inertia."
)
_ELSEWHERE = "what follows the place of another joint: slow runs of that joint while this one is held, and the reverse."
_AT_SPEEDS = (
    "what is tied to the speed: constant speeds in both directions, evenly up to the highest that is used, slowly up "
    "and down again. Where up and down differ it remembers."
)
_AT_TORQUES = (
    "what is tied to the torque: known loads, as weights on a lever, held at rest and moved slowly over the whole "
    "range of the torque, in both directions."
)
_CONSTANT = (
    "what is the same everywhere: the axis at rest with the drive off and on, for the zero of the sensor, and slow "
    "runs in both directions, for a torque that leans on the axis."
)
_JUMPS = "what jumps: the same run three times in a row. It comes back at that instant, at that place, or not at all."
_WANDERS = (
    "what changes in the course of a record: the same run twice in a row, and once more after an hour at rest. What "
    "comes back each time is of the axis and its motion, what comes back after the rest alone is heat, and what does "
    "neither comes from outside."
)
_BETWEEN_RECORDS = (
    "what is another in each record: one run again after each of the others, unchanged, with the temperature and all "
    "that was mounted written down."
)
_AT_REVERSALS = "what stands at reversals: reversals at several accelerations, with rests of several lengths between."
_ONE_WAY = "what stands in one direction: the same run mirrored, and the axis mounted the other way round."
_IN_COUNTS = "what the encoder does not resolve: a finer encoder, or motions of many more counts."
_RARELY = "what stands at few instants: the same run twice more. What comes back is the machine's."


def loudest(seen: Sequence[Seen], parts: Sequence[Array]) -> str:
    """Name of the observation that most of what is left, a part (m,) of each, stands in."""
    return str(seen[int(np.argmax([float(p @ p) for p in parts]))].name)


def describe(plant: Plant, seen: Sequence[Seen], parts: Sequence[Array]) -> Remainder:
    """Where what a plant leaves stands: in which record, at which frequency, place, speed or instant.

    Args:
        plant: that leaves it.
        seen: of what.
        parts: (m,) what is left of each.
    """
    energy = np.array([float(p @ p) for p in parts])
    total = float(energy.sum())
    if total <= 0:
        return NO_LOOK
    servos = [o for o in seen if isinstance(o, ServoObservation)]
    if servos:
        return Remainder(_of_servo(servos, parts))
    observations = [o for o in seen if not isinstance(o, ServoObservation)]
    said = []

    worst = int(np.argmax(energy))
    if len(parts) > 1 and energy[worst] > 1.5 * total / len(parts):
        said.append(f"{100 * energy[worst] / total:.0f} % of its square in {observations[worst].name}")

    o, r = observations[worst], parts[worst]
    if isinstance(o, FrfObservation):
        return Remainder("; ".join([*said, _where(o, r)]))
    runs = [(o, p) for o, p in zip(observations, parts, strict=True) if isinstance(o, Observation)]
    looks = _looks(runs, o, r, total, plant)
    most = max(looks, key=lambda look: look.share * bool(look.experiment), default=Reading(0.0))
    return Remainder("; ".join([*said, *(look.said for look in looks)]), most.share, most.experiment)


def _looks(
    runs: Sequence[tuple[Observation, Array]], o: Observation, r: Array, total: float, plant: Plant
) -> list[Reading]:
    """All that is worth telling of what is left of records, (m,) of each, of which one is the loudest."""
    position = np.concatenate([o.position[o.index] for o, _ in runs])
    velocity = np.concatenate([o.velocity[o.index] for o, _ in runs])
    residual = np.concatenate([p for _, p in runs])
    factors = {
        "": np.ones_like(residual),
        _ON_FRICTION: np.sign(velocity),
        " as a factor on the velocity": velocity,
        " as a factor on the square of the velocity": velocity**2,
        " as a factor on the torque": np.concatenate([o.band(mean_torque(o.record)) for o, _ in runs]),
    }
    alone = len(runs) == 1
    torque, constant = factors[" as a factor on the torque"], float(residual.mean())
    unit = drive_unit("torque", plant.kind)
    share = constant**2 * len(residual) / total
    if share > _MOSTLY_THERE:  # it has that value at each place and speed, too
        return [Reading(share, f"a constant, {constant:+.2g} {unit} ({_percent(share)})", _CONSTANT)]
    instants, times = _instants(runs, total)
    tied = _tied(position, residual, factors, plant.kind)
    waves = _in_waves(position, residual, factors, plant.kind, alone)
    if tied.in_part and tied.share > waves.share - _CLEARLY:  # a stop, or a latch, is no wave
        waves = Reading(0.0)
    readings = [] if 0 < times < _FEWEST_PERIODS else [
        _periodic(runs),
        waves,
        tied,
        _to_neighbour(runs, residual, tied.share),
        Reading(share := _explained(velocity, residual, factors[""])[1], f"tied to velocity ({_percent(share)})",
                _AT_SPEEDS),
        Reading(share := _explained(torque, residual, factors[""])[1], f"tied to the torque ({_percent(share)})",
                _AT_TORQUES),
        jump := _jump(runs, total),
        _wandering(runs, total, jump.share),
        _apart(runs, total, plant),
    ]  # fmt: skip
    least = max(_NOTABLE, _BESIDE * max((look.share for look in readings), default=0.0))
    looks = [look for look in readings if look.share > least]
    slow = np.abs(velocity) < 0.02 * np.sqrt(np.mean(velocity**2))
    blind = float(np.sum(residual[~np.concatenate([x.determined for x, _ in runs])] ** 2)) / total
    forward, backward = velocity > 0, velocity < 0
    fast = np.abs(velocity) > 0.7 * np.abs(velocity).max(initial=0.0)
    for where, what, experiment in (
        (slow, "around standstill and reversals", _AT_REVERSALS),
        (forward & ~slow, "while moving forward", _ONE_WAY),
        (backward & ~slow, "while moving backward", _ONE_WAY),
        (fast & ~slow, "at high speed", _AT_SPEEDS),
    ):
        share, time = float(np.sum(residual[where] ** 2)) / total, float(np.mean(where))
        if share > _NOTABLE and share * (1 - time) > _DENSER * time * (1 - share):
            looks.append(Reading(share, f"{what} ({100 * share:.0f} % in {100 * time:.0f} % of the time)", experiment))
    if blind > _NOTABLE:
        said = f"where the axis moves less than its encoder resolves ({100 * blind:.0f} %)"
        looks.append(Reading(blind, said, _IN_COUNTS))
    looks += _course(runs, plant) + _hiss(runs)

    square = r**2
    sharpest = np.argsort(square)[::-1][: max(len(r) // 200, 1)]
    burst = float(np.sum(square[sharpest]))
    if burst > 0.5 * np.sum(square) and np.ptp(o.time[sharpest]) < 0.1 * np.ptp(o.time):
        said = f"at one instant, {float(np.median(o.time[sharpest])):.3g} s in {o.record.name}"
        return [*looks, Reading(burst / total, said, _RARELY)]
    return [*looks, *instants]


def _instants(runs: Sequence[tuple[Observation, Array]], total: float) -> tuple[list[Reading], int]:
    """The few instants at which most of what is left stands, of the loudest records, and how many there are; nothing
    where it is all over."""
    moments = [_moment(o) for o, _ in runs]
    energy = np.array([np.bincount(m, p**2, _MOMENTS) for m, (_, p) in zip(moments, runs, strict=True)])
    order = np.argsort(-energy, axis=None)
    some = int(np.searchsorted(np.cumsum(energy.flat[order]), _MOSTLY_THERE * total)) + 1
    if some > _RARE * energy.size:
        return [], 0
    chosen = np.zeros(energy.shape, bool)
    chosen.flat[order[:some]] = True
    loud = [k for k in np.argsort(-(energy * chosen).sum(1)) if chosen[k].any()]
    told, n = [], 0
    for k in loud:
        o, p = runs[k]
        at = np.flatnonzero(chosen[k])
        apart = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        n += len(apart)
        here = [np.isin(moments[k], part) for part in apart[:_TOLD]]
        times = ", ".join(f"{np.average(o.time[h], weights=p[h] ** 2):.3g}" for h in here)
        told.append(f"{times} s in {o.record.name}")
    share, time = energy[chosen].sum() / total, some / energy.size
    where = ", ".join(told[:_RECORDS_TOLD]) + (", and others" if len(loud) > _RECORDS_TOLD else "")
    said = f"at few instants ({100 * share:.0f} % in {100 * time:.2g} % of the time): {where}"
    return [Reading(share, said, _RARELY)], n


def _moment(o: Observation) -> NDArray[np.intp]:
    """(m,) number of the short part of a record that each row is in."""
    span = max(float(np.ptp(o.time)), 1e-300)
    return np.minimum(((o.time - o.time[0]) / span * _MOMENTS).astype(int), _MOMENTS - 1)


def _of_servo(runs: Sequence[ServoObservation], parts: Sequence[Array]) -> str:
    """In which runs, conditions and motions what is left of a servo's position stands."""
    error = np.concatenate([errors_of(p) for p in parts])
    square = np.concatenate(parts) ** 2
    total = float(square.sum())
    said: list[str] = []
    owner = np.repeat(np.arange(len(runs)), [len(p) for p in parts])

    def stands(here: NDArray[np.bool_], where: str) -> None:
        share, time = float(square[here].sum()) / total, float(np.mean(here))
        if share > _NOTABLE and share * (1 - time) > _CROWDED * time * (1 - share):
            said.append(f"{where} ({100 * share:.0f} % of its square in {100 * time:.0f} % of the time)")

    worst = int(np.argmax(np.bincount(owner, square)))
    stands(owner == worst, f"in {runs[worst].name}")
    for what, values in (("at gain", [o.run.gain for o in runs]), ("with a payload of", [o.run.weight for o in runs])):
        for value in sorted(set(values)):
            unit = " N m" if what.startswith("with") else ""
            stands(np.array(values)[owner] == value, f"{what} {value:.3g}{unit}")
    powered = np.concatenate([o.run.powered[o.index] for o in runs]) > 0.5
    position = np.concatenate([o.run.position[o.index] for o in runs])
    velocity = np.concatenate([o.velocity[o.index] for o in runs])
    away = velocity * np.sin(position) > 0
    slow = np.abs(velocity) < 0.05 * np.sqrt(np.mean(velocity**2))
    stands(~powered, "without power")
    stands(powered & slow, "at rest")
    stands(powered & ~slow & away, "while raising the payload")
    stands(powered & ~slow & ~away, "while lowering the payload")
    for x, what in ((position, "position"), (velocity, "velocity")):
        _, share = _explained(x, error, np.ones_like(error))
        if share > _NOTABLE:
            said.append(f"tied to {what} ({100 * share:.0f} %)")
    return "; ".join(said)


def _where(o: FrfObservation, rows: Array) -> str:
    """Between which frequencies most of the residual of a response stands."""
    square = np.sum(rows.reshape(-1, 2) ** 2, 1)
    inside = np.searchsorted(np.cumsum(square) / square.sum(), (0.1, 0.9))
    low, high = o.frf.frequency[np.minimum(inside, len(square) - 1)]
    return f"in {o.name} from {low:.3g} to {high:.3g} Hz (80 %)"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _periodic(runs: Sequence[tuple[Observation, Array]]) -> Reading:
    """That it is a line in time, by itself or as a factor on friction, and not of a motion that is periodic itself."""
    seen, left = zip(*runs, strict=True)
    senses: dict[str, Callable[[Array], Array]] = {"": np.ones_like, _ON_FRICTION: np.sign}
    lines = {k: line(seen, left, _FEWEST_PERIODS, sense) for k, sense in senses.items()}
    shares = {k: found.share if found.moved.max() <= _NOTABLE else 0.0 for k, found in lines.items()}
    factor = _loudest(shares)
    said = f"periodic in time{factor} at {lines[factor].frequency:.3g} Hz ({_percent(shares[factor])})"
    return Reading(shares[factor], said, _FRICTION_IN_TIME if factor else _IN_TIME)


def _in_waves(
    position: Array, residual: Array, factors: Mapping[str, Array], kind: str, alone: bool
) -> Reading:
    """That it is a sine over the place, by itself or as a factor (m,) on something."""
    waves = {k: wave(position, residual, f) for k, f in factors.items()}
    factor = _loudest({k: share for k, (_, share) in waves.items()})
    period, share = waves[factor]
    hinge = kind == "hinge"
    every = f"{period:.3g} rad, {2 * math.pi / period:.3g} to a revolution" if hinge else f"{period:.3g} m"
    lone = ", which a second record to fit would hold to the place" if alone and not hinge else ""
    said = f"in waves over the place{factor}, one every {every} ({_percent(share)}){lone}"
    return Reading(share, said, _AT_PLACES)


def _tied(position: Array, residual: Array, factors: Mapping[str, Array], kind: str) -> Reading:
    """That it has a value at each place, by itself or as a factor (m,) on something."""
    turns = kind == "hinge" and np.ptp(position) > 2 * math.pi
    place, what = (np.mod(position, 2 * math.pi), "place on the revolution") if turns else (position, "place")
    tied = {k: _explained(place, residual, f) for k, f in factors.items()}
    factor = _loudest({k: share for k, (_, share) in tied.items()})
    there, share = tied[factor]
    unit = "rad" if kind == "hinge" else "m"
    part = f", most of it from {there[0]:.3g} to {there[1]:.3g} {unit}" if there else ""
    return Reading(share, f"tied to the {what}{factor} ({_percent(share)}{part})", _AT_PLACES, bool(there))


def _to_neighbour(runs: Sequence[tuple[Observation, Array]], residual: Array, own: float) -> Reading:
    """That it has a value at each position of another joint of a robot, by clearly more than the share that it has at
    those of its own."""
    names = set.intersection(*({*o.record.others} for o, _ in runs)) if runs else set()
    shares = {}
    for name in sorted(names):
        there = np.concatenate([o.record.others[name][o.index] for o, _ in runs])
        shares[name] = _explained(there, residual, np.ones_like(residual))[1]
    most = max(shares, key=shares.__getitem__, default="")
    if not most or shares[most] < own + _CLEARLY:
        return Reading(0.0)
    return Reading(shares[most], f"tied to the position of {most} ({_percent(shares[most])})", _ELSEWHERE)


def _jump(runs: Sequence[tuple[Observation, Array]], total: float) -> Reading:
    """That it is another from an instant on."""
    most, when, name = 0.0, 0.0, ""
    for o, r in runs:
        n = np.arange(1, len(r))
        early, late = np.cumsum(r)[:-1] / n, np.cumsum(r[::-1])[::-1][1:] / n[::-1]
        share = (late - early) ** 2 * n * n[::-1] / len(r) / total  # of the square, that the two means carry
        inner = slice(len(n) // 10, len(n) - len(n) // 10)
        at = int(np.argmax(share[inner])) + inner.start
        most, when, name = max((most, when, name), (float(share[at]), float(o.time[at]), o.record.name))
    return Reading(most, f"a jump at {when:.3g} s in {name} ({_percent(most)})", _JUMPS)


def _wandering(runs: Sequence[tuple[Observation, Array]], total: float, jump: float) -> Reading:
    """That it changes slowly in the course of each record, about its mean, by more than the share of a jump."""
    parts = [p for _, r in runs if len(r) > _PARTS for p in np.array_split(r - r.mean(), _PARTS)]
    share = sum(len(p) * float(p.mean()) ** 2 for p in parts) / total
    if share <= jump:
        return Reading(0.0)
    said = f"as by an offset of the torque that wanders in the course of a record ({_percent(share)})"
    return Reading(share, said, _WANDERS)


def _course(runs: Sequence[tuple[Observation, Array]], plant: Plant) -> list[Reading]:
    """That the residual grows or fades in the course of a record, by itself and beside the torque."""

    def thirds(parts: Sequence[Array]) -> Array:
        return np.array([[float(p @ p) for p in np.array_split(r, 3)] for r in parts if len(r) > 2]).sum(0)

    left, torque = thirds([r for _, r in runs]), thirds([o.applied(plant) for o, _ in runs])
    share = left / np.maximum(torque, 1e-300)
    if all(x[2] > 3 * x[0] and x[2] > x[1] for x in (left, share)):
        return [Reading(0.0, "growing with time")]
    if all(x[0] > 3 * x[2] and x[0] > x[1] for x in (left, share)):
        return [Reading(0.0, "fading with time")]
    return []


def _apart(runs: Sequence[tuple[Observation, Array]], total: float, plant: Plant) -> Reading:
    """What seems to be another in each record: a payload, a temperature, a sensor's zero that nobody wrote down."""
    torque = [o.applied(plant) for o, _ in runs]
    moved = [(plant.inertia or 0.0) * o.acceleration for o, _ in runs]
    shapes = {
        "an inertia": moved,
        "friction": [u - a - r for u, a, (_, r) in zip(torque, moved, runs, strict=True)],
        "a torque constant": torque,
        "an offset of the torque": [np.ones(len(r)) for _, r in runs],
    }
    found = []
    for what, shape in shapes.items():
        with_it = np.array([float(r @ c) for (_, r), c in zip(runs, shape, strict=True)])
        square = np.array([max(float(c @ c), 1e-300) for c in shape])
        size, common = with_it / square, with_it.sum() / square.sum()
        apart, share = (float(np.sum(a**2 * square)) / total for a in (size - common, size))
        found.append((apart, share, what, size))
    apart, share, what, size = max(found, key=lambda f: f[0])
    if apart < _NOTABLE:  # it is the same in all
        return Reading(0.0)
    k = int(np.argmax(np.abs(size)))
    unit = drive_unit("torque", plant.kind)
    by = f"{size[k]:+.2g} {unit}" if what.startswith("an offset") else f"{100 * size[k]:+.0f} %"
    name = runs[k][0].record.name
    said = f"as by {what} that is another in each record ({_percent(share)}, {by} in {name})"
    return Reading(share, said, _BETWEEN_RECORDS)


def _hiss(runs: Sequence[tuple[Observation, Array]]) -> list[Reading]:
    """That the residual follows the torque at once where that changes fast, while the axis slides.

    A delay or a lag leaves what runs ahead of the torque, a swinging part what has its own frequency.
    """
    torque: list[Array] = []
    left: list[Array] = []
    for o, r in runs:
        here = o.slides[1:-1]
        for series, out in ((o.band(mean_torque(o.record)), torque), (r, left)):
            out.append(np.convolve(series, _FAST, "valid")[here])
    u, r = np.concatenate(torque), np.concatenate(left)
    both, own, other = float(u @ r), float(u @ u), float(r @ r)
    if both <= _FOLLOWS * own or both**2 < _MOSTLY * own * other:
        return []
    said = (
        f"{100 * both / own:.0f} % of what the torque reads at the upper end of the band, which does not move the "
        "axis: noise of the reading, or torque between the rows of a log that is slower than its controller"
    )
    return [Reading(0.0, said)]


def _loudest(shares: Mapping[str, float]) -> str:
    """What has the largest share; the first of those that have hardly less."""
    most, (first, *others) = max(shares.values()), shares
    if shares[first] > most - _CLEARLY:
        return first
    return next(k for k in others if shares[k] > most - _HARDLY)


def _explained(
    x: Array, residual: Array, factor: Array, bins: int = 40
) -> tuple[tuple[float, float] | None, float]:
    """Share of the square that a factor (m,) carries which has a value in each of equally filled bins of x, beyond what
    chance gives; and from where to where most of that lies, None where that is not in a part of the bins."""
    edges = np.quantile(x, np.linspace(0, 1, bins + 1))
    group = np.searchsorted(edges[1:-1], x)
    size = np.bincount(group, factor**2, bins)
    carried = np.bincount(group, residual * factor, bins) ** 2 / np.where(size > 0, size, np.inf)
    share = max(float(carried.sum() / (residual @ residual)) - bins / len(x), 0.0)
    total = np.concatenate([[0.0], np.cumsum(carried)])
    # The fewest bins side by side that carry most of it.
    ends = np.searchsorted(total, total + _MOSTLY_THERE * total[-1])
    width = np.where(ends <= bins, ends - np.arange(bins + 1), bins)
    begin = int(np.argmin(width))
    there = (float(edges[begin]), float(edges[ends[begin]])) if width[begin] < _PART * bins else None
    return there, share
