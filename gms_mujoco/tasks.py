"""What an episode of the servo environments is: a friction, a start, a reference, from stated distributions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import effects
from .errors import ModelError, is_number, listing
from .parameter import WAVES
from .plant import Plant
from .sampling import sample

Array = NDArray[np.float64]

SPLITS = ("train", "test", "held_out_friction")
MEMORIES = ("virgin", "random")
N_EPISODES = 64  # of each fixed split
_SETTLING = 200  # ms in which most axes have come to rest
_MOST_SETTLING = 60  # times as long, for those that have not
_STILL = 1e-4  # break-away distances in a quarter of that time: less is rest
_STREAM = 20140  # keeps the episodes of the fixed splits the same for everybody


@dataclass(frozen=True)
class Scale:
    """What is large and small for an axis.

    Attributes:
        level: friction torque at low speed [N m].
        breakaway: displacement from rest at which friction reaches 63 % of that [rad].
        acceleration: that the references stay below [rad/s^2].
    """

    level: float
    breakaway: float
    acceleration: float


def scale_of(plant: Plant, resolution: float) -> Scale:
    """Scales of a plant, from a slow replay of its friction from the virgin state.

    Args:
        plant: every parameter set.
        resolution: position of one encoder count [rad]; the break-away is at least 50 of them.
    """
    friction = plant.complete().friction
    position = np.geomspace(1e-9, 10.0, 400)
    speed = np.full(400, 1e-3)
    torque = np.abs(friction.joint().replay(position / 1e-3, position, speed).torque)
    assert plant.inertia is not None
    level, breakaway = float(torque.max()), 0.0
    if level < 1e-3 * plant.inertia:  # frictionless: what turns it at a pace that suits a servo
        level = 200 * plant.inertia
    else:
        breakaway = float(position[np.argmax(torque >= 0.63 * level)])
    return Scale(level, max(breakaway, 50 * resolution), 3 * level / plant.inertia)


def needed(plant: Plant, scale: Scale) -> float:
    """Torque that friction and inertia ask for along the fastest references [N m]."""
    b = scale.breakaway
    speed = min(940 * b, math.sqrt(50 * b * scale.acceleration))  # of 50 break-aways, point to point in 0.1 s or more
    position = np.linspace(0.0, 20 * b, 400)
    friction = plant.friction.joint().replay(position / speed, position, np.full(400, speed)).torque
    assert plant.inertia is not None
    return float(np.abs(friction).max()) + plant.inertia * scale.acceleration


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        plant: with the friction of this episode.
        task: name of the reference.
        position: where the axis starts, at rest [rad].
        reference: (n, 3) position [rad], velocity [rad/s] and acceleration [rad/s^2] at each sample.
        memory: (n_state,) state of the native effects at the start; None: never moved before.
    """

    plant: Plant
    task: str
    position: float
    reference: Array
    memory: Array | None = None


Room = tuple[float, float]  # how far a reference may go down (at most 0) and up (at least 0) from its start [rad]
Moves = Iterator[tuple[float, float, float]]  # distance [rad], duration [s], rest after it [s]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return low * (high / low) ** float(rng.random())


def _micro_steps(rng: np.random.Generator, scale: Scale) -> Moves:
    while True:
        side = float(rng.choice((-1, 1)))
        yield side * scale.breakaway * _log(rng, 0.02, 0.5), _log(rng, 0.01, 0.04), rng.uniform(0.05, 0.15)


def _reversals(rng: np.random.Generator, scale: Scale) -> Moves:
    side = float(rng.choice((-1, 1)))
    while True:
        yield side * scale.breakaway * _log(rng, 0.05, 3.0), _log(rng, 0.03, 0.15), 0.0
        side = -side


def _point_to_point(rng: np.random.Generator, scale: Scale) -> Moves:
    while True:
        side = float(rng.choice((-1, 1)))
        yield side * scale.breakaway * _log(rng, 5, 50), rng.uniform(0.1, 0.3), rng.uniform(0.05, 0.15)


def _fitting(distance: float, room: Room) -> float:
    """The distance; the other way, or to the farther end, where there is no room for it."""
    low, high = room
    fits = (d for d in (distance, -distance) if low <= d <= high)
    return next(fits, high if high > -low else low)


def _along(moves: Moves, n: int, sample_time: float, most: float, room: Room) -> Array:
    """Minimum-jerk moves one after the other; slower ones where they would exceed the acceleration `most`, the other
    way or shorter where they would leave the room."""
    low, high = room
    out = np.zeros((n, 3))
    k, start = 0, 0.0
    while k < n:
        distance, duration, rest = next(moves)
        distance = _fitting(distance, (low - start, high - start))
        duration = max(duration, math.sqrt(5.78 * abs(distance) / most))
        m = max(round(duration / sample_time), 2)
        s = np.arange(m) / m
        T = m * sample_time
        curve = np.stack(
            [
                start + distance * s**3 * (10 - 15 * s + 6 * s**2),
                distance / T * 30 * s**2 * (1 - s) ** 2,
                distance / T**2 * 60 * s * (1 - s) * (1 - 2 * s),
            ],
            axis=1,
        )
        out[k : k + m] = curve[: n - k]
        start += distance
        out[k + m :, 0] = start
        k += m + round(rest / sample_time)
    return out


def _wave(amplitude: float, frequency: float, n: int, sample_time: float) -> Array:
    """A (1 - cos): a sine that starts at rest at its turning point."""
    w = 2 * math.pi * frequency
    x = w * sample_time * np.arange(n)
    return amplitude * np.stack([1 - np.cos(x), w * np.sin(x), w**2 * np.cos(x)], axis=1)


def _sine(amplitude: float, frequency: float, scale: Scale, n: int, sample_time: float, room: Room) -> Array:
    """A wave to one side; slower where it would exceed the acceleration, the other way or less where it has no room."""
    amplitude = _fitting(2 * amplitude, room) / 2
    slow = math.sqrt(scale.acceleration / abs(amplitude)) / (2 * math.pi) if amplitude else math.inf
    return _wave(amplitude, min(frequency, slow), n, sample_time)


def _slow_sine(rng: np.random.Generator, scale: Scale, n: int, sample_time: float, room: Room) -> Array:
    side = float(rng.choice((-1, 1)))
    amplitude, frequency = side * scale.breakaway * _log(rng, 0.05, 1.0), _log(rng, 1.0, 5.0)
    return _sine(amplitude, frequency, scale, n, sample_time, room)


def _quadrants(rng: np.random.Generator, scale: Scale, n: int, sample_time: float, room: Room) -> Array:
    amplitude, frequency = scale.breakaway * _log(rng, 5, 30), _log(rng, 1.0, 4.0)
    return _sine(float(rng.choice((-1, 1))) * amplitude, frequency, scale, n, sample_time, room)


def _moving(moves: Callable[[np.random.Generator, Scale], Moves]) -> Callable[..., Array]:
    return lambda rng, scale, n, sample_time, room: _along(moves(rng, scale), n, sample_time, scale.acceleration, room)


TASKS: dict[str, Callable[[np.random.Generator, Scale, int, float, Room], Array]] = {
    "micro_steps": _moving(_micro_steps),  # 0.02 to 0.5 of the break-away distance, with rests
    "slow_sine": _slow_sine,  # 0.1 to 2 break-away distances from turn to turn, 1 to 5 Hz
    "reversals": _moving(_reversals),  # turning points 0.05 to 3 break-away distances apart, no rest
    "point_to_point": _moving(_point_to_point),  # 5 to 50 break-away distances, with rests
    "quadrants": _quadrants,  # sine of 10 to 60 break-away distances from turn to turn, up to 4 Hz
}
PRESLIDING = ("micro_steps", "slow_sine", "reversals")


def check_tasks(tasks: Sequence[str]) -> tuple[str, ...]:
    """The names as a tuple; raises ModelError where one does not exist."""
    if not isinstance(tasks, Iterable):
        raise ModelError(f"tasks are names out of {listing(TASKS)}; {tasks!r} given")
    names = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    for name in names:
        if name not in TASKS:
            raise ModelError(f"no task is called {name!r}; the tasks are {listing(TASKS)}")
    if not names:
        raise ModelError(f"at least one task is needed of {listing(TASKS)}")
    return names


def scatter(plant: Plant, rng: np.random.Generator, spread: float | str, held_out: bool = False) -> Plant:
    """The same plant with another friction.

    With a number, levels [N m] of all friction effects take one factor, pre-sliding stiffnesses [N m/rad] another,
    every other parameter with a unit its own; shares, exponents and harmonics stay. A factor is log-uniform in
    [1/spread, spread]; of held-out friction it lies outside: in [spread, spread^2] or [1/spread^2, 1/spread].

    With "uncertainty", friction is drawn from what the data of a fit allow, see `sample`; held-out friction lies
    outside, up to an interval's half width further.

    Args:
        plant: the middle of the distribution.
        rng: draws the factors.
        spread: at least 1, with 1 the friction stays as it is; or "uncertainty".
        held_out: whether the friction lies outside the range of the training.

    Raises:
        ModelError: the spread is neither, or 1 of held-out friction, or no friction parameter of the plant has an
            interval.
    """
    if spread == "uncertainty":
        return sample(plant, 1, rng, kinds=("friction",), outside=held_out)[0]
    if not is_number(spread) or not 1 <= spread < math.inf:
        raise ModelError(f"spread must be at least 1, or 'uncertainty'; {spread!r} given")
    if held_out and spread == 1:
        raise ModelError("friction held out of the training needs a spread above 1; with 1 there is one friction alone")
    size = float(spread)

    def factor() -> float:
        x = float(rng.uniform(-1, 1))
        return size ** (x + math.copysign(1, x) if held_out else x)

    common = {"N m": factor(), "N m/rad": factor()}
    built = []
    for e in plant.effects:
        changed = {}
        for p in e.parameters if e.kind == "friction" else ():
            if p.unit not in ("1", WAVES):
                f = common[p.unit] if p.unit in common else factor()
                changed[p.name] = np.clip(np.asarray(e.values[p.name]) * f, p.lower, p.upper)
        built.append(e.replace(**changed) if changed and spread != 1 else e)
    return replace(plant, effects=tuple(built))


def _no_push(position: float) -> float:
    return 0.0


def at_rest(
    plant: Plant, scale: Scale, rng: np.random.Generator, position: float, push: Callable[[float], float] = _no_push,
    near: float = math.inf, there: bool = False,
) -> tuple[float, Array | None]:
    """Where the axis comes to rest after some history, and the state of the native effects there.

    Every element begins at a random part of its level and lets go of the axis, which is critically damped and held by
    nothing but what the mechanism does: what is left are elements that are loaded against each other, and against
    weight and springs. Couplings begin unloaded. What nothing holds begins where it is let go.

    Args:
        plant: every parameter set.
        scale: of the plant.
        rng: draws the history.
        position: where it lets go [rad].
        push: torque of the mechanism on the joint at a position [N m].
        near: how far away it may come to rest [rad].
        there: whether it rests at `position`, let go as far beside as it needs to.

    Returns:
        Position [rad] and (n_state,) state; None where nothing has a memory.
    """
    joint = plant.joint()
    if not joint.n_memory:
        return position, None
    damping = 2 * math.sqrt(scale.level / scale.breakaway * plant.driven_inertia)
    drag = effects.find("viscous")(coefficient=damping)
    if "thermal_drift" in plant:  # it is as cold at the start as before
        plant = plant.replace(plant["thermal_drift"].replace(time_constant=1e9))
    free, damped = plant.joint(), (plant.replace(drag) if "viscous" in plant else plant + drag).joint()
    memory = rng.uniform(-1, 1, joint.n_memory)
    for name, place in plant.memory_places.items():
        if plant[name].kind != "friction":
            memory[place] = 0.0

    def settle(position: float) -> tuple[float, Array]:
        begin: dict[str, Any] = {"memory": memory}
        now, velocity, axis = position, 0.0, damped
        for k in range(_MOST_SETTLING):
            motion = axis.simulate(
                plant.driven_inertia, 1e-3, np.full(_SETTLING, push(now)), now, velocity, 5, k * _SETTLING * 1e-3,
                states=True, **begin,
            )  # fmt: skip
            assert motion.states is not None
            still = np.ptp(motion.position[-_SETTLING // 4 :]) < _STILL * scale.breakaway
            if axis is free and np.ptp(motion.position) < 100 * _STILL * scale.breakaway:
                return now, begin["state"]
            now, velocity = float(motion.position[-1]), float(motion.velocity[-1])
            if not abs(now - position) < near:
                break
            begin = {"state": motion.states[-1]}
            # What creeps to rest against the damping may stand where friction that weakens lets go: without, it shows.
            axis = free if axis is damped and still else damped
            velocity = 0.0 if axis is free else velocity
        held = joint.simulate(1e30, 1e-3, np.zeros(2), position, states=True, memory=memory)
        assert held.states is not None
        return position, held.states[-1]

    if there:
        return position, settle(2 * position - settle(position)[0])[1]
    return settle(position)


def draw(
    plant: Plant,
    scale: Scale,
    rng: np.random.Generator,
    n: int,
    sample_time: float,
    tasks: Sequence[str],
    spread: float | str,
    memory: str = "virgin",
    start: float | None = None,
    split: str = "train",
    episode: int | None = None,
    limits: tuple[float, float] = (-math.inf, math.inf),
    push: Callable[[float], float] = _no_push,
) -> Episode:
    """Draws an episode: of the fixed splits one of `N_EPISODES`, the same for everybody.

    Args:
        plant: the middle of the distribution of frictions.
        scale: of that plant; sizes the reference.
        rng: draws everything, or of the fixed splits which episode it is where `episode` is None.
        n: samples of the reference.
        sample_time: [s].
        tasks: names; each is as likely as the others.
        spread: of the friction, see `scatter`.
        memory: "virgin", the friction elements have never moved; "random", see `at_rest`.
        start: position [rad]; None: anywhere on a hinge, 0 on a slide.
        split: "train", "test" (other references and frictions of the same distributions) or "held_out_friction"
            (frictions outside the range of the training).
        episode: number of the episode in a fixed split, from 0.
        limits: of the joint [rad]; no reference leaves them.
        push: torque of the mechanism on the joint at a position, see `at_rest` [N m].

    Raises:
        ModelError: no such spread, memory, split, task or episode.
    """
    for what, given, names in (("split", split, SPLITS), ("memory", memory, MEMORIES)):
        if given not in names:
            raise ModelError(f"{what} must be one of {listing(names)}; {given!r} given")
    if split != "train":
        number = int(rng.integers(N_EPISODES)) if episode is None else episode
        if not is_number(number, Integral) or not 0 <= number < N_EPISODES:
            raise ModelError(f"episode must be a whole number in [0, {N_EPISODES - 1}]; {number!r} given")
        rng = np.random.default_rng([_STREAM, SPLITS.index(split), number])
    elif episode is not None:
        raise ModelError("the train split has no numbered episodes; seed it, or take another split")
    scattered = scatter(plant, rng, spread, split == "held_out_friction")
    begins = start is not None
    if start is None:
        start = float(rng.uniform(0, 2 * math.pi)) if plant.kind == "hinge" else 0.0
    task = tasks[int(rng.integers(len(tasks)))]
    low, high = (float(x) for x in limits)
    reference = TASKS[task](rng, scale, n, sample_time, (min(low - start, 0.0), max(high - start, 0.0)))
    position, state = start, None
    if memory == "random":
        limited = math.isfinite(low) or math.isfinite(high)  # the reference has its room around the start
        near = 100 * scale.breakaway if begins else math.inf
        position, state = at_rest(scattered, scale, rng, start, push, near, limited)
    reference[:, 0] += position
    return Episode(scattered, task, position, reference, state)
