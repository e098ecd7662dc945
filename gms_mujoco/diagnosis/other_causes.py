"""Causes that no effect of the catalogue is, and that effects of it resemble: see `beyond`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..fit_result import FitResult
from ..frf import drive_unit
from ..identification.between_samples import mean_torque, second_difference
from ..identification.inverse import Observation
from ..identification.linear_model import LinearModel
from ..identification.place_spectrum import wave
from ..identification.time_spectrum import line
from .history import faded, following, way

Array = NDArray[np.float64]

_HARMONICS = np.arange(1, 5)  # of an inertia
_KNOTS = np.array([0.25, 0.5, 0.75, 1.0])  # of the largest torque, between which a torque constant goes in lines
_DEAD = np.geomspace(0.002, 0.3, 12)  # of the largest torque, that a drive leaves out
_SAGS = (0.0, 0.02, 0.2)  # s, that a supply takes to follow the power that is drawn
_SCALES = np.geomspace(0.003, 1.0, 6)  # of the longest way, or the most heat, over which something fades
_GRIPS = np.geomspace(0.003, 0.5, 8)  # of the largest acceleration, by which a body follows at most
_SLEWS = np.geomspace(0.01, 0.7, 8)  # of the fastest change of the torque, that a drive follows at most
_LIMITS = np.geomspace(0.15, 1.5, 8)  # of the largest torque, that a drive has at rest
_FASTEST = np.geomspace(1.0, 10.0, 5)  # of the highest speed, at which it has none
_CLOSER = 5  # looks, each half as far apart as the one before
_AS_MUCH = 1.3  # times what is beyond a limit, or by as much less, may be left out
_MOST_ROWS = 10  # that a torque is early or late in a log
_STANDS_OUT = 2.0  # times how far the others are apart
_FEWEST_RECORDS = 3  # that tell one of them from the others
_IN_WAVES = 0.05  # of the squared residual, that waves over the place or in time have to carry to be asked for
_TWICE = 1.5  # waves to a revolution: fewer are one
_TOLD = 0.25  # of a wave over all places, by which their number is told
_FEWEST_PERIODS = 8  # in the shortest record: what comes back less often may be the motion's
_MOVES = 0.02  # of the square of the velocity, at the frequency of a torque that is not the motion's own


class Torques(NamedTuple):
    """What a cause with several strengths takes along a record, each at a strength of one.

    Attributes:
        inertia: (n, k) that is added to that of the axis [kg m^2].
        torque: (n, k) beside what that takes [N m].
    """

    inertia: Array
    torque: Array

    def band(self, o: Observation) -> Array:
        """(m, k) band-limited torque."""
        pull = second_difference(o.record.position, o.record.sample_time)[:, None]
        return o.band(self.inertia * pull + self.torque).T

    def beside(self, o: Observation, strength: Array) -> Observation:
        """The observation of an axis that the cause acts on, with some strengths (k,)."""
        added = {"inertia_change": self.inertia @ strength, "rigid_torque": self.torque @ strength}
        return o.with_signals({k: v + o.record.signals.get(k, 0.0) for k, v in added.items()})


def _taking(torque: Array) -> Torques:
    """What a cause takes along a record (n, k) that leaves the inertia as it is."""
    return Torques(np.zeros_like(torque), torque)


class Cause(NamedTuple):
    """A cause that no effect of the catalogue is.

    Attributes:
        kinds: of joints that it may be at work on.
        torques: along observations, beside a fit to them; none where they give no reason to ask for it.
        missing: share of what it takes from (inertia, torque constant, friction, torque) that strengths (k,) take away
            where they take most, or of the most that they may be.
        say: what they are, and how large, beside a fit.
        experiment: that shows it.
        taken_from: torque (n,) along an observation, of which it takes a share, beside a fit; None where it takes from
            nothing that was measured.
    """

    kinds: tuple[str, ...]
    torques: Callable[[FitResult], list[Torques]]
    missing: Callable[[FitResult, Array], float]
    say: Callable[[FitResult, Array], str]
    experiment: str
    taken_from: Callable[[FitResult, Observation], Array] | None = None


    def left(self, now: FitResult, torques: Sequence[Torques], strength: Array) -> list[float]:
        """What strengths leave of the torque that they take a share of, in each record: standard deviation over that
        before.

        Of a torque with less of everything in it, anything leaves less.

        Args:
            now: the fit that it is beside.
            torques: of the cause along each record.
            strength: (k,) of them.
        """
        seen = records_of(now)
        if self.taken_from is None:
            return [1.0] * len(seen)
        before = [self.taken_from(now, o) for o in seen]
        after = [b - t.torque @ strength for b, t in zip(before, torques, strict=True)]
        return [float(np.std(a)) / max(float(np.std(b)), 1e-300) for a, b in zip(after, before, strict=True)]


def records_of(now: FitResult) -> list[Observation]:
    """What was fitted of records in time."""
    return [o for o in now.misfit.observations if isinstance(o, Observation)]


# ------------------------------------------------------------------------------- an inertia that varies over the place


def _of_revolution(now: FitResult) -> list[Torques]:
    return [_along_revolution(o) for o in records_of(now)]


def _along_revolution(o: Observation) -> Torques:
    """d/dt of dL/dv less dL/dq for a kinetic energy J(q) v^2 / 2: J a + J' v^2 / 2."""
    inertia = _waves(o.position)
    cosines, sines = np.split(inertia, 2, 1)
    slope = np.concatenate([-_HARMONICS * sines, _HARMONICS * cosines], 1)
    return Torques(inertia, slope * o.velocity[:, None] ** 2 / 2)


def _waves(position: Array) -> Array:
    """(n, k) cosine and then sine of each harmonic over positions (n,)."""
    angles = np.multiply.outer(position, _HARMONICS)
    return np.concatenate([np.cos(angles), np.sin(angles)], 1)


def _turned(strength: Array) -> Array:
    """(720,) inertia over a revolution that strengths of its harmonics add [kg m^2]."""
    return _waves(np.linspace(0, 2 * np.pi, 720, endpoint=False)) @ strength


def _say_inertia(now: FitResult, strength: Array) -> str:
    size = np.hypot(*np.reshape(strength, (2, -1)))
    swing = np.ptp(_turned(strength)) / 2 / now.plant.driven_inertia
    return (f"an inertia that varies along the revolution, by {100 * swing:.2g} % to either side, most of it "
            f"{_HARMONICS[int(np.argmax(size))]} to a revolution")  # fmt: skip


# ------------------------------------------------------------------------------- a drive that delivers less


def _of_torque(now: FitResult) -> list[Torques]:
    """What a drive gives less, whose torque constant changes with the torque that is asked for."""
    most = _most_asked(now)

    def one(o: Observation) -> Torques:
        u = o.record.torque
        less = np.stack([mean_torque(o.record, u * np.minimum(np.abs(u) / most, knot)) for knot in _KNOTS], 1)
        return _taking(less)

    return list(map(one, records_of(now)))


def _most_asked(now: FitResult) -> float:
    """The largest torque [N m]."""
    return max(float(np.abs(o.record.torque).max()) for o in records_of(now))


def _fallen(strength: Array) -> float:
    """Share of the torque constant that is gone at the largest torque."""
    return float(strength @ _KNOTS)


def _say_constant(now: FitResult, strength: Array) -> str:
    fallen = _fallen(strength)
    return (f"a torque constant that {'falls' if fallen > 0 else 'grows'} with the torque, by {100 * abs(fallen):.2g} "
            "% up to the largest")  # fmt: skip


def _of_sense(now: FitResult) -> list[Torques]:
    """What a drive gives less to one side, and more to the other, whose torque constants differ."""
    return [_taking(mean_torque(o.record, np.abs(o.record.torque))[:, None]) for o in records_of(now)]


def _say_sense(now: FitResult, strength: Array) -> str:
    less = float(strength[0])
    apart = 2 * abs(less) / (1 + abs(less))
    return f"a torque constant that is {100 * apart:.2g} % smaller for {'positive' if less > 0 else 'negative'} torques"


def _of_dead_zone(now: FitResult) -> list[Torques]:
    """What a drive gives less, that leaves out as much as each of some torques, whichever way it is asked."""
    widths = _most_asked(now) * _DEAD

    def one(o: Observation) -> Torques:
        u = o.record.torque
        return _taking(np.stack([mean_torque(o.record, np.clip(u, -w, w)) for w in widths], 1))

    return list(map(one, records_of(now)))


def _left_out(now: FitResult, strength: Array) -> float:
    """Of a torque that is larger than all of them [N m]."""
    return _most_asked(now) * float(strength @ _DEAD)


def _dead(now: FitResult, strength: Array) -> float:
    """The same over the rms torque."""
    asked = np.concatenate([o.record.torque for o in records_of(now)])
    return abs(_left_out(now, strength)) / float(np.sqrt(np.mean(asked**2)))


def _say_dead_zone(now: FitResult, strength: Array) -> str:
    out, unit = _left_out(now, strength), drive_unit("torque", now.plant.kind)
    if out > 0:
        return f"a drive with a dead zone, that leaves out the first {out:.2g} {unit} of what is asked for"
    return f"a drive that makes up for a dead zone which it has not, by {-out:.2g} {unit} more than is asked for"


def _of_power(now: FitResult) -> list[Torques]:
    """What a drive gives less, whose supply gives way to the power that is drawn, at once or late."""

    def one(o: Observation, power: Array) -> Torques:
        less = np.stack([mean_torque(o.record, o.record.torque * p) for p in power.T], 1)
        return _taking(less)

    return [one(o, p) for o, p in zip(records_of(now), _drawn(now), strict=True)]


def _drawn(now: FitResult) -> list[Array]:
    """(n, k) of each record: power that the motion takes from the drive, over the largest, as a supply follows it in
    each of some times."""
    followed = [_followed(o) for o in records_of(now)]
    most = max(max(float(p.max()) for p in followed), 1e-300)
    return [p / most for p in followed]


def _followed(o: Observation) -> Array:
    """(n, k) power of a record as a supply follows it [W]."""
    power, h = np.maximum(o.record.torque * o.velocity, 0.0), o.record.sample_time
    shares = [1 - math.exp(-h / t) if t else 1.0 for t in _SAGS]
    return np.stack([scipy.signal.lfilter([a], [1.0, a - 1.0], power) for a in shares], 1)


def _sagged(now: FitResult, strength: Array) -> float:
    """Share of the torque constant that is gone where most is, of either sign."""
    return _largest(np.concatenate([p @ strength for p in _drawn(now)]))


def _say_sag(now: FitResult, strength: Array) -> str:
    gone = _sagged(now, strength)
    return (f"a torque constant that {'falls' if gone > 0 else 'grows'} with the power that is drawn, by "
            f"{100 * abs(gone):.2g} % where most is")  # fmt: skip


def _of_slew(now: FitResult) -> list[Torques]:
    """What a drive gives less, whose torque changes by at most each of several rates."""
    return [
        _taking(np.stack([mean_torque(o.record, x) for x in less.T], 1))
        for o, less in zip(records_of(now), _late(now), strict=True)
    ]


def _late(now: FitResult) -> list[Array]:
    """(n, k) of each record: torque that is asked for over an interval and not there yet, by each rate [N m]."""
    seen, rates = records_of(now), _slews(now)
    u, h = [o.record.torque for o in seen], [o.sample_time for o in seen]

    def one(u: Array, h: float, end: Array) -> Array:
        step = np.diff(end, axis=0, prepend=end[:1])
        return u[:, None] - end + step * np.abs(step) / (2 * rates * h)  # on the way to where an interval ends

    return list(map(one, u, h, following(u, h, rates)))


def _slews(now: FitResult) -> Array:
    """(k,) rates [N m/s]."""
    fastest = max(float(np.abs(np.diff(o.record.torque)).max()) / o.sample_time for o in records_of(now))
    return max(fastest, 1e-300) * _SLEWS


def _slowed(now: FitResult, strength: Array) -> float:
    """Share of the torque that comes late, of the record with most."""
    return _most_of_torque(now, [x @ strength for x in _late(now)])


def _most_of_torque(now: FitResult, parts: Sequence[Array]) -> float:
    """A part (n,) of the torque of each record over all of it, standard deviations, of the record with most."""
    return max(float(np.std(x) / np.std(o.record.torque)) for o, x in zip(records_of(now), parts, strict=True))


def _say_slew(now: FitResult, strength: Array) -> str:
    rate = _slews(now)[np.argmax(strength)]
    unit = "N m/s" if now.plant.kind == "hinge" else "N/s"
    return f"a drive whose torque changes by no more than about {rate:.2g} {unit}"


def _of_speed_limit(now: FitResult) -> list[Torques]:
    """What a drive leaves out beyond a limit of its torque that falls with the speed, of those that explain most."""
    limit = _speed_limit(now)
    return [_taking(mean_torque(o.record, _beyond(o, *limit))[:, None]) for o in records_of(now)] if limit else []


def _beyond(o: Observation, most: float, fastest: float) -> Array:
    """(n,) torque beyond a limit that is `most` at rest, and nothing at a velocity of `fastest` the way it acts."""
    u, falls = o.record.torque, most * np.clip(o.velocity / fastest, -1.0, 1.0)
    return np.asarray(u - np.clip(u, -most - falls, most - falls))


def _speed_limit(now: FitResult) -> tuple[float, float] | None:
    """Largest torque at rest, and velocity at which there is none, of the limit that explains most of what is left;
    None where none leaves out any torque.

    It is looked for on a grid, and then ever closer around the best.
    """
    seen = records_of(now)
    model = LinearModel(now.misfit, now.vector, now.misfit.residual(now.vector))

    def explained(limits: Array) -> Array:
        """(k,) squared residual that each of some limits (k, 2) takes."""
        beyond = [np.stack([mean_torque(o.record, _beyond(o, *limit)) for limit in limits], 1) for o in seen]
        bands = np.concatenate([_taking(b).band(o) for b, o in zip(beyond, seen, strict=True)])
        free = model.without(bands * model.determined[:, None])
        along = np.maximum(free.T @ model.target, 0.0)
        return along**2 / np.maximum((free**2).sum(0), 1e-300)

    scale = np.array([_most_asked(now), max(float(np.abs(o.velocity).max()) for o in seen)])
    limits, step = scale * np.stack(np.meshgrid(_LIMITS, _FASTEST), -1).reshape(-1, 2), _LIMITS[1] / _LIMITS[0]
    for _ in range(_CLOSER):
        taken = explained(limits)
        best = limits[int(np.argmax(taken))]
        step = math.sqrt(step)
        limits = best * step ** np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), -1).reshape(-1, 2)
    return (float(best[0]), float(best[1])) if taken.max() > 0 else None


def _cut(now: FitResult, strength: Array) -> float:
    """Share of the torque that is left out, of the record with most; 0 where less or more than what is beyond is."""
    if not 1 / _AS_MUCH < float(strength[0]) < _AS_MUCH or (limit := _speed_limit(now)) is None:
        return 0.0
    return _most_of_torque(now, [_beyond(o, *limit) for o in records_of(now)])


def _say_speed_limit(now: FitResult, strength: Array) -> str:
    most, fastest = _speed_limit(now) or (0.0, 0.0)
    torque, speed = drive_unit("torque", now.plant.kind), "rad/s" if now.plant.kind == "hinge" else "m/s"
    return (f"a drive whose largest torque falls with the speed, from about {most:.2g} {torque} at rest to none at "
            f"about {fastest:.2g} {speed}, as at the voltage of its supply")  # fmt: skip


# ------------------------------------------------------------------------------- what fades in the course of a record


def _fading(
    torque: Callable[[FitResult, Observation], Array], gone: Callable[[Observation], Array]
) -> Callable[[FitResult], list[Torques]]:
    """A torque (n,) by a share that is another at first, and nears its end as something goes by (n,)."""

    def torques(now: FitResult) -> list[Torques]:
        seen = records_of(now)
        amounts = [gone(o) for o in seen]
        scales = max(max(float(x[-1]) for x in amounts), 1e-300) * _SCALES
        return [_taking(torque(now, o)[:, None] * faded(x, scales)) for o, x in zip(seen, amounts, strict=True)]

    return torques


def _heat(o: Observation) -> Array:
    """(n,) that the torque has given a motor, but for a factor."""
    return np.asarray(np.cumsum(o.record.torque**2) * o.sample_time)


def _way(o: Observation) -> Array:
    return way(o.velocity, o.sample_time)


def _in_course(strength: Array) -> Array:
    """(50,) share that is taken in the course of the longest record."""
    return np.asarray(faded(np.append(0.0, np.geomspace(1e-3, 1.0, 49)), _SCALES) @ strength)


def _largest(shares: Array) -> float:
    """Of either sign."""
    return float(shares[np.argmax(np.abs(shares))])


def _say_fading(what: str, change: Callable[[Array], Array]) -> Callable[[FitResult, Array], str]:
    def say(now: FitResult, strength: Array) -> str:
        first, *_, last = change(_in_course(strength))
        goes = "falls" if last < first else "grows"
        return f"{what.format(goes)} in the course of a record, by {100 * abs(last / first - 1):.2g} %"

    return say


# ------------------------------------------------------------------------------- a body that friction carries along


def _of_body(now: FitResult) -> list[Torques]:
    """What a body of an inertia of one takes that dry friction of several levels carries along."""
    seen = records_of(now)
    v, h = [o.velocity for o in seen], [o.sample_time for o in seen]
    most = max(float(np.abs(second_difference(o.position, o.sample_time)).max()) for o in seen)
    return [_taking(np.gradient(body, dt, axis=0)) for body, dt in zip(following(v, h, most * _GRIPS), h, strict=True)]


def _body(now: FitResult, strength: Array) -> float:
    """Of its inertia, over that of the axis with it: it lets slip at one acceleration, between two of those tried."""
    return float(np.convolve(strength, np.ones(3), "same").max()) / now.plant.driven_inertia


def _say_body(now: FitResult, strength: Array) -> str:
    return f"a body of {100 * _body(now, strength):.2g} % of the inertia, that friction carries along and lets slip"


# ------------------------------------------------------------------------------- what is another in each record


def _in_each(torque: Callable[[FitResult, Observation], Array], first: int = 1) -> Callable[[FitResult], list[Torques]]:
    """A torque (n,) by a share of its own in each record after the first, which a plant describes, or from it on."""

    def torques(now: FitResult) -> list[Torques]:
        seen = records_of(now)
        if len(seen) < _FEWEST_RECORDS:
            return []
        return [_taking(np.outer(torque(now, o), np.arange(first, len(seen)) == k)) for k, o in enumerate(seen)]

    return torques


def _asked_for(now: FitResult, o: Observation) -> Array:
    return mean_torque(o.record)


def _of_friction(now: FitResult, o: Observation) -> Array:
    return mean_torque(o.record) - now.plant.driven_inertia * second_difference(o.position, o.sample_time)


def _changing(now: FitResult, o: Observation) -> Array:
    """What a torque (n,) has less that acts a row later than it is logged [N m]."""
    return np.gradient(mean_torque(o.record))


def _apart(strength: Array) -> float:
    """The largest difference between two records."""
    return float(np.ptp(np.append(strength, 0.0)))


def _rows_apart(now: FitResult, strength: Array) -> float:
    """The same of rows, over the most that a log is late."""
    return float(np.ptp(strength)) / _MOST_ROWS


def _furthest(now: FitResult, levels: Array) -> tuple[int, float, str]:
    """The record whose level is furthest off, what it is beside, and whose that is: of the others, where these are
    alike, else of the first."""
    k = int(np.argmax(np.abs(levels - np.median(levels))))
    others = np.delete(levels, k)
    usual = float(np.median(others))
    if abs(levels[k] - usual) > _STANDS_OUT * np.ptp(others):
        return k, usual, "the others"
    k = int(np.argmax(np.abs(levels - levels[0])))
    return k, float(levels[0]), str(records_of(now)[0].name)


def _say_apart(what: str, level: Callable[[Array], Array]) -> Callable[[FitResult, Array], str]:
    """By how much one record is off, by a level that goes with what is taken."""

    def say(now: FitResult, strength: Array) -> str:
        levels = level(np.append(0.0, strength))
        k, usual, whose = _furthest(now, levels)
        name = records_of(now)[k].name
        return f"{what} that is another in each record, {100 * (levels[k] / usual - 1):+.2g} % in {name} beside {whose}"

    return say


def _say_rows_apart(now: FitResult, strength: Array) -> str:
    k, usual, whose = _furthest(now, strength)
    o, apart = records_of(now)[k], float(strength[k]) - usual
    return (f"a torque that acts {1e3 * abs(apart) * o.sample_time:.2g} ms, or {abs(apart):.2g} of its rows, "
            f"{'later' if apart > 0 else 'earlier'} in {o.name} than in {whose}, by the times that are logged")


# ------------------------------------------------------------------------------- what is periodic in time


def _of_line(now: FitResult) -> list[Torques]:
    """A sine in time, of its own phase in each record."""
    return _in_time(now, _line_in(now), lambda o: np.ones(len(o.record)))


def _of_pulse(now: FitResult) -> list[Torques]:
    """The same as a factor on friction."""
    return _in_time(now, _line_in(now, np.sign), lambda o: _of_friction(now, o))


def _in_time(now: FitResult, frequency: float, torque: Callable[[Observation], Array]) -> list[Torques]:
    """A torque (n,) times a sine of a frequency [Hz]; nothing of a frequency of 0."""
    seen = records_of(now)

    def one(k: int, o: Observation) -> Torques:
        angle, sines = 2 * math.pi * frequency * o.record.time, np.zeros((len(o.record), 2 * len(seen)))
        sines[:, 2 * k], sines[:, 2 * k + 1] = np.cos(angle), np.sin(angle)
        return _taking(torque(o)[:, None] * sines)

    return [one(k, o) for k, o in enumerate(seen)] if frequency else []


def _line_in(now: FitResult, sense: Callable[[Array], Array] = np.ones_like) -> float:
    """Frequency of the sine in time that carries most of what is left, with a sign by the velocity [Hz]; 0 where it is
    little, or the motion's."""
    left = np.split(now.misfit.residual(now.vector), now.misfit.splits)
    found = line(records_of(now), left, _FEWEST_PERIODS, sense)
    return found.frequency if found.share > _IN_WAVES and found.moved[0] < _MOVES else 0.0


def _height(strength: Array) -> float:
    """Of the sine where it is highest."""
    return float(np.hypot(*np.reshape(strength, (-1, 2)).T).max())


def _say_line(now: FitResult, strength: Array) -> str:
    unit = drive_unit("torque", now.plant.kind)
    return f"a torque that is periodic in time, at {_line_in(now):.3g} Hz, of up to {_height(strength):.2g} {unit}"


def _say_pulse(now: FitResult, strength: Array) -> str:
    depth = 100 * _height(strength)
    return f"friction that pulsates in time, at {_line_in(now, np.sign):.3g} Hz, by up to {depth:.2g} % to either side"


# ------------------------------------------------------------------------------- waves over the place


def _of_reading(now: FitResult) -> list[Torques]:
    """What a position r = q + c cos(n q) + s sin(n q) that is read takes beside J r'', of the period that carries most;
    once in a revolution it is an eccentric encoder's."""
    number, inertia = _waves_in(now, np.square), now.plant.driven_inertia
    if now.plant.kind == "hinge" and number < _TWICE:
        return []

    def one(o: Observation) -> Torques:
        angle = number * o.position
        cosine, sine = np.cos(angle), np.sin(angle)
        pull = inertia * number * np.stack([sine, -cosine], 1)
        return Torques(pull, inertia * (number * o.velocity[:, None]) ** 2 * np.stack([cosine, sine], 1))

    return list(map(one, records_of(now))) if number else []


def _say_reading(now: FitResult, strength: Array) -> str:
    unit = "rad" if now.plant.kind == "hinge" else "m"
    many = _many(now, _waves_in(now, np.square))
    return f"a position that is read with an error in waves over the place, {many}, of {np.hypot(*strength):.2g} {unit}"


def _of_waves(now: FitResult) -> list[Torques]:
    """Waves over the place that grow with the velocity, or with the speed, of the period that carries most."""
    number = _waves_in(now, np.positive, np.abs)

    def one(o: Observation) -> Torques:
        v, angle = o.velocity, number * o.position
        return _taking(np.stack([f * w(angle) for f in (v, np.abs(v)) for w in (np.cos, np.sin)], 1))

    return list(map(one, records_of(now))) if number else []


def _waves_in(now: FitResult, *grow: Callable[[Array], Array]) -> float:
    """Waves in a radian or a metre, that grow with one function of the velocity or another; 0 where what is left has
    none."""
    velocity = np.concatenate([o.velocity[o.index] for o in records_of(now)])
    return _number_of(now, *(f(velocity) for f in grow))


def _number_of(now: FitResult, *factors: Array) -> float:
    """The same, of waves times one factor (m,) or another: to a revolution a whole number, where one is as close as
    the place that was passed through tells."""
    position, left = np.concatenate([o.position[o.index] for o in records_of(now)]), now.misfit.residual(now.vector)
    period, share = max((wave(position, left, f) for f in factors), key=lambda w: w[1])
    number = 2 * math.pi / period if share > _IN_WAVES else 0.0
    whole = now.plant.kind == "hinge" and abs(round(number) - number) * float(np.ptp(position)) < _TOLD * 2 * math.pi
    return float(round(number)) if whole else number


def _of_ripple(now: FitResult) -> list[Torques]:
    """What a drive gives less whose torque constant goes in waves over the place, of the period that carries most."""
    number = _ripples(now)

    def one(o: Observation) -> Torques:
        return _taking(np.stack([rippling(o, number, w) for w in (np.cos, np.sin)], 1))

    return list(map(one, records_of(now))) if number else []


def rippling(o: Observation, number: float, wave: Callable[[Array], Array]) -> Array:
    """(n,) mean torque asked for around each sample, times a wave over the place, `number` in a radian or a metre."""
    return mean_torque(o.record, o.record.torque * wave(number * o.position))


def _ripples(now: FitResult) -> float:
    """Waves in a radian or a metre, of a share of the torque; 0 where what is left has none."""
    asked = np.concatenate([o.band(_asked_for(now, o)) for o in records_of(now)])
    return _number_of(now, asked)


def _say_ripple(now: FitResult, strength: Array) -> str:
    return (f"a torque constant that ripples over the place, {_many(now, _ripples(now))}, by "
            f"{100 * float(np.hypot(*strength)):.2g} % to either side")  # fmt: skip


def _many(now: FitResult, number: float) -> str:
    return f"{number:.3g} to a revolution" if now.plant.kind == "hinge" else f"one every {2 * math.pi / number:.3g} m"


def _at_most(now: FitResult, strength: Array) -> float:
    """The torque of such waves at the highest speed [N m]."""
    fastest = max(float(np.abs(o.velocity).max()) for o in records_of(now))
    return fastest * float(np.hypot(*np.reshape(strength, (2, 2)).T).sum())


def _say_waves(now: FitResult, strength: Array) -> str:
    unit = drive_unit("torque", now.plant.kind)
    many = _many(now, _waves_in(now, np.positive, np.abs))
    return (f"a torque in waves over the place that grows with the speed, {many}, {_at_most(now, strength):.2g} {unit} "
            "at the highest")  # fmt: skip


CAUSES = (
    Cause(
        ("hinge",), _of_revolution, lambda now, s: float(-_turned(s).min() / now.plant.driven_inertia), _say_inertia,
        "The same short push, from rest, at several places of the revolution: where an inertia is larger the axis "
        "comes to a lower speed.",
    ),
    Cause(
        ("hinge", "slide"), _of_torque, lambda now, s: abs(_fallen(s)), _say_constant,
        "Known loads, as weights on a lever, held at rest over the whole range of the torque.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_sense, lambda now, s: abs(float(s[0])), _say_sense,
        "A known load, as a weight on a lever, held at rest to the one side and to the other.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_dead_zone, _dead, _say_dead_zone,
        "Torques that rise slowly from zero on the locked axis, to either side, with a torque sensor or the current "
        "logged: where it begins to answer.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_ripple, lambda now, s: float(np.hypot(*s)), _say_ripple,
        "A known load, as a weight on a lever, held at rest at many places, close together beside a wave.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_power, lambda now, s: abs(_sagged(now, s)), _say_sag,
        "The voltage of the supply, logged beside the torque, while the axis speeds up as hard as it can.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_slew, _slowed, _say_slew,
        "Steps of the torque on the locked axis, from small to large, with the current logged: how fast it rises.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _of_speed_limit, _cut, _say_speed_limit,
        "The current and the voltage of the supply, logged while the axis speeds up as hard as it can: where the "
        "current stays below what is asked for.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _fading(_asked_for, _heat), lambda now, s: abs(_largest(_in_course(s))),
        _say_fading("a torque constant that {} as the torque heats the motor", lambda taken: 1 - taken),
        "One long record of the same motion again and again, with the temperature of the motor logged beside it.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _fading(_of_friction, _way), lambda now, s: abs(_largest(_in_course(s))),
        _say_fading("friction that {} over the way", lambda taken: 1 / (1 - taken)),
        "The same slow motion over a long way, without a break, and once more from the beginning.",
        taken_from=_of_friction,
    ),
    Cause(
        ("hinge", "slide"), _of_body, _body, _say_body,
        "Steps of the torque, from small to large: a body that is carried along lets go at the same acceleration.",
    ),
    Cause(
        ("hinge", "slide"), _in_each(_asked_for), lambda now, s: _apart(s),
        _say_apart("a torque constant", lambda taken: 1 - taken),
        "The first record once more after the last, with the temperature of the motor logged beside both.",
        taken_from=_asked_for,
    ),
    Cause(
        ("hinge", "slide"), _in_each(_of_friction), lambda now, s: _apart(s),
        _say_apart("friction", lambda taken: 1 / (1 - taken)),  # without its share it is that of the first
        "The first record once more after the last, with the temperature of the bearing logged beside both.",
        taken_from=_of_friction,
    ),
    Cause(
        ("hinge", "slide"), _in_each(_changing, first=0), _rows_apart, _say_rows_apart,
        "One sharp push of the torque, from rest, at the beginning of every record: how many rows later the axis "
        "answers in each.",
    ),
    Cause(
        ("hinge", "slide"), _of_line, lambda now, s: _height(s) / _most_asked(now), _say_line,
        "The axis at rest with the drive on, and then off: what the torque and the position do by themselves.",
    ),
    Cause(
        ("hinge", "slide"), _of_pulse, lambda now, s: _height(s), _say_pulse,
        "Constant speeds, slow and fast, with whatever runs beside the axis, shakes it or feeds its bearing on and "
        "off: a frequency that stays is that of time.",
        taken_from=_of_friction,
    ),
    Cause(
        ("hinge", "slide"), _of_waves, lambda now, s: _at_most(now, s) / _most_asked(now), _say_waves,
        "Constant speeds from slow to fast, each over several waves, in both directions: how high they are at each.",
    ),
    Cause(
        ("hinge", "slide"), _of_reading, lambda now, s: _waves_in(now, np.square) * float(np.hypot(*s)), _say_reading,
        "The speed that is read while the axis coasts fast over several waves: what it swings by is the reading's.",
    ),
)  # fmt: skip
