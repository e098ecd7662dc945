"""A run of a servo as an observation: the measured position beside the one simulated from the goal.

Such a servo logs where it was sent and where it was, and no torque. So nothing can be replayed along the measured
motion: the whole motion is simulated from the goal, and the error is that of the position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..comparison.score import POSITION
from ..errors import DataError, ModelError
from ..plant import Plant
from ..servo_run import ServoRun, repetitions
from .grid import Grid

Array = NDArray[np.float64]

STEP = 1e-3  # s, of the simulation
_AWAY = 1e3  # rad, where a motion is said to be that ran away
_LARGE = 0.03  # rad, from which an error counts by its size and no longer by its square
_BLOCK = 6.0  # s, at most, that are taken as dependent: an error stays until the next motion
_FEWEST_BLOCKS = 8  # of all runs together
_FOURTH = 70.0**0.5 * 0.6745  # median size of a fourth difference of white noise of deviation 1


def simulate_run(plant: Plant, run: ServoRun) -> Array:
    """(n,) position that the servo has at the samples of a run, simulated from its goal alone [rad].

    Args:
        plant: with position_loop; its inertia is that of the servo without payload. A delay acts on the goal and on
            the power, least_duty in the loop; the load of load-dependent effects is what the gear transmits.
        run: goal, power, payload, and where the motion begins.

    Raises:
        ModelError: no position_loop, or an effect that a servo's goal does not pass.
    """
    late = least = 0.0
    for e in plant.effects:
        if e.name == "delay":
            late = float(np.asarray(e.values["time"]))
        elif e.name == "least_duty":
            least = float(np.asarray(e.values["duty"]))
        elif not (e.is_native or e.name == "position_loop"):
            raise ModelError(f"{e.name} does not act on a servo that closes its own position loop")
    loop = plant["position_loop"].replace(gain=run.gain)
    motion = plant.joint().simulate_servo(
        plant.driven_inertia + run.inertia, plant.driven_inertia, run.weight, np.append(loop.packed, least), late, STEP,
        run.time, run.goal, run.powered, float(run.position[0]), run.velocity,
    )  # fmt: skip
    steps = run.time[0] + STEP * np.arange(len(motion.position))
    return np.interp(run.time, steps, np.nan_to_num(motion.position, nan=_AWAY))


@dataclass(frozen=True)
class ServoObservation:
    """A run beside what is known of its measurement. A row is a position error, large ones made smaller.

    Attributes:
        run: goal, measured position, payload.
        spread: (m,) by which the measurement is off by itself: from repetitions of the run, else noise and counts of
            the encoder, one draw [rad].
        block: time over which errors are taken as dependent [s].
    """

    run: ServoRun
    spread: Array
    block: float = _BLOCK

    has_memory = False  # a run begins at rest, and friction forgets where it stood once it slips
    skews = False  # a delay is an effect of its own here
    additive = False  # each effect acts on the motion that all of them make
    jumps = True  # as the pendulum falls to one side or the other
    sparse = None  # nothing is replayed
    score = POSITION
    negligible = 0.0  # there is always an encoder

    @property
    def name(self) -> str:
        return self.run.name

    @property
    def use(self) -> str:
        return self.run.use

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(m,) the samples that are looked at."""
        return np.arange(*(self.run.judged or (0, len(self.run.time))))

    @property
    def time(self) -> Array:
        """(m,) [s]."""
        return self.run.time[self.index]

    @cached_property
    def determined(self) -> NDArray[np.bool_]:
        """(m,) all: a position says something wherever it is."""
        return np.ones(len(self.index), bool)

    @property
    def sample_time(self) -> float:
        """[s]."""
        return self.run.sample_time

    step = sample_time

    @property
    def bandwidth(self) -> float:
        """Highest frequency that the samples hold [Hz]."""
        return 0.5 / self.sample_time

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def position(self) -> Array:
        """(n,) measured [rad]."""
        return self.run.position

    @cached_property
    def velocity(self) -> Array:
        """(n,) [rad/s]."""
        return np.gradient(self.run.position, self.run.time)

    @cached_property
    def acceleration(self) -> Array:
        """(m,) [rad/s^2]."""
        return np.gradient(self.velocity, self.run.time)[self.index]

    @property
    def commands(self) -> Array:
        """(n,) torque of the payload, from which the size of torques is guessed [N m]."""
        return self.run.weight * np.sin(self.run.position)

    typical_torque = commands
    temperature = None  # no friction of a servo follows it

    @property
    def condition(self) -> tuple[float, float, float]:
        """What is left out together where a fit is tried on what it has not seen."""
        return self.run.condition

    def rows_per_block(self, duration: float) -> int:
        """Rows of a stretch over which errors stay."""
        return max(int(max(duration, self.block) / self.sample_time * 1.1), 1)

    def opening(self, duration: float) -> ServoObservation:
        """Itself."""
        return self

    def seen_by(self, plant: Plant) -> ServoObservation:
        """Itself."""
        return self

    def grid(self, plant: Plant, memory: Array | None = None, finer: float = 1.0) -> None:
        """None: nothing is replayed."""

    def look(self, plant: Plant, memory: Array | None = None) -> tuple[Array, None]:
        """What `needed` says."""
        return self.needed(plant), None

    def applied(self, plant: Plant, skew: float = 0.0) -> Array:
        """(m,) measured position [rad]."""
        return self.run.position[self.index]

    def needed(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """(m,) simulated position, where it is far off moved nearer to the measured one [rad].

        So the square of the difference is the soft L1 loss of the error: a few runs in which the pendulum falls to the
        other side do not decide.
        """
        return self.applied(plant) - rows_of(self.applied(plant) - self.simulated(plant))

    def elements(
        self, plant: Plant, joint: native.Joint, effect: int, memory: Array | None = None, grid: Grid | None = None
    ) -> Array:
        """Nothing: effects are not replayed one by one."""
        raise NotImplementedError

    def replay(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """(m,) zeros: no torque was measured along the motion."""
        return np.zeros(len(self.index))

    def simulated(self, plant: Plant) -> Array:
        """(m,) position simulated from the goal [rad]."""
        return simulate_run(plant, self.run)[self.index]

    def floor(self, rng: np.random.Generator) -> Array:
        """(m,) rows that the measurement leaves by itself, one draw."""
        return rows_of(rng.choice((-1.0, 1.0)) * self.spread)


def rows_of(error: Array) -> Array:
    """Rows of least squares for errors of the position [rad]."""
    return np.asarray(error * np.sqrt(2 / (np.sqrt(1 + (error / _LARGE) ** 2) + 1)))


def errors_of(rows: Array) -> Array:
    """The errors of the position that rows stand for [rad]."""
    return np.asarray(rows * np.sqrt(rows**2 / (2 * _LARGE) ** 2 + 1))


def observe_servos(runs: Sequence[ServoRun]) -> list[ServoObservation]:
    """Runs as observations of one fit, with how well each motion repeats.

    Runs that were asked for the same motion with the same payload and gain tell how far the measurement strays by
    itself, and that is taken for the others too. Where none is repeated, only noise and counts of the encoder are
    known.

    Raises:
        DataError: there are none.
    """
    if not runs:
        raise DataError("no runs of a servo to look at")
    total = sum(float(r.time[-1]) for r in runs)
    block = min(_BLOCK, total / _FEWEST_BLOCKS)
    spreads: dict[int, Array] = {}
    for group in repetitions(runs):
        measured = _measured(runs, group)
        if len(measured) > 1:
            share = np.sqrt(len(measured) / (len(measured) - 1))
            for i in group:
                others = [np.interp(runs[i].time, runs[k].time, runs[k].position) for k in measured]
                spreads[i] = share * (runs[i].position - np.mean(others, 0))
    known = list(spreads.values())
    rng = np.random.default_rng(0)
    out = []
    for i, run in enumerate(runs):
        if i in spreads:
            spread = spreads[i]
        elif known:
            spread = np.resize(known[i % len(known)], len(run.time))
        else:
            spread = encoder_noise(run, rng)
        seen = ServoObservation(run, spread, block)
        out.append(replace(seen, spread=spread[seen.index]))
    return out


def _measured(runs: Sequence[ServoRun], group: Sequence[int]) -> list[int]:
    """Numbers of a group's runs that were measured each by itself: a file that is given twice repeats nothing."""
    return list({runs[k].position.tobytes(): k for k in group}.values())


def repeatability(runs: Sequence[ServoRun]) -> float | None:
    """Mean absolute difference of a run from its repetition [rad]; None where none is repeated."""
    apart = []
    for group in repetitions(runs):
        first, *others = _measured(runs, group)
        for k in others:
            again = np.interp(runs[first].time, runs[k].time, runs[k].position)
            apart.append(float(np.mean(np.abs(runs[first].position - again))))
    return float(np.mean(apart)) if apart else None


def encoder_noise(run: ServoRun, rng: np.random.Generator) -> Array:
    """(n,) noise of a position by itself, one draw: half a count either way, or as much as neighbours differ [rad]."""
    steps = np.abs(np.diff(np.unique(run.position)))
    count = float(steps[steps > 1e-9].min(initial=np.inf))
    counts = run.position / count
    even = np.isfinite(count) and np.mean(np.abs(counts - counts[0] - np.round(counts - counts[0])) < 0.1) > 0.9
    sigma = float(np.median(np.abs(np.diff(run.position, 4)))) / _FOURTH
    half = 0.5 * count if even else 0.0
    n = len(run.time)
    return rng.uniform(-half, half, n) + (sigma if sigma > half else 0.0) * rng.standard_normal(n)


def expect_servo(plant: Plant) -> Plant:
    """Itself; raises ModelError where it does not close a position loop."""
    if "position_loop" not in plant:
        raise ModelError("a servo that takes a goal needs a plant with position_loop, as baseline(controller="
                         f'"position") makes; its effects are {", ".join(e.name for e in plant.effects) or "none"}')
    return plant
