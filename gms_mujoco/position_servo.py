"""Servos that close their own position loop: logs of them, simulation from the goal, and what the model lacks.

Such a servo logs where it was sent and where it was, and no torque. So nothing can be replayed along the measured
motion: the whole motion is simulated from the goal, and compared with the measured position. A fit and a search for the
missing effect are otherwise those of every axis, with the position error in the place of the torque error:

    runs = load("logs/")                                # a folder with dataset.toml, see servo_run
    steps = explain(servo(), runs.fit)
    print([s.effect for s in steps], error(steps[-1].plant, runs.validate))
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from . import effects, native
from .effect import Effect
from .errors import DataError, ModelError
from .frf_observation import Seen
from .held_out import HeldOut, p_value
from .intervals import covariance
from .least_squares import nudge, solve
from .misfit import Misfit
from .plant import Plant
from .progress import Progress
from .screen import Screen, applicable, cross_validated, is_present
from .search import discoveries, simplest
from .servo_run import ServoRun as ServoRun
from .servo_run import load as load
from .servo_run import read_run as read_run
from .version import __version__

Array = NDArray[np.float64]

STEP = 1e-3  # s, of the simulation
TIED_TO_THE_PLACE = ("cogging", "gravity", "position_dependent_friction", "spring")
_AWAY = 1e3  # rad, where a motion is said to be that ran away
_LARGE = 0.03  # rad, from which an error counts by its size and no longer by its square
_LEAST_GAIN = 0.05  # of the squared error on held-out runs: less is not worth an effect
_CONTENDERS = 8  # candidates that are fitted jointly, roughly


def servo() -> Plant:
    """The plant that a search begins with: position loop, motor, dry and viscous friction, no parameter known.

    The values are a hobby servo's, for a fit to begin with.
    """
    loop = effects.find("position_loop")(stall_torque=3.0, electrical_drag=0.5, goal_speed=5.0)
    friction = effects.find("coulomb")(coulomb=0.1), effects.find("viscous")(coefficient=0.03)
    return Plant(0.02, (loop, *friction), inertia_known=False)


def simulate(plant: Plant, run: ServoRun) -> Array:
    """(n,) position that the servo has at the samples of a run, simulated from its goal alone [rad].

    Args:
        plant: with position_loop; its inertia is that of the servo without payload. A delay acts on the goal and on
            the power, least_duty in the loop; the load of load-dependent effects is what the gear transmits.
        run: goal, power, payload, and where the motion begins.

    Raises:
        ModelError: no position_loop, a parameter without value, or an effect that a servo's goal does not pass.
    """
    plant.complete()
    return _simulate(plant, plant.joint(), run)


def _simulate(plant: Plant, joint: native.Joint, run: ServoRun) -> Array:
    late = least = 0.0
    for e in plant.effects:
        if e.name == "delay":
            late = float(np.asarray(e.values["time"]))
        elif e.name == "least_duty":
            least = float(np.asarray(e.values["duty"]))
        elif not (e.is_native or e.name == "position_loop"):
            raise ModelError(f"{e.name} does not act on a servo that closes its own position loop")
    loop = plant["position_loop"].replace(gain=run.gain)
    motion = joint.simulate_servo(
        plant.driven_inertia + run.inertia, plant.driven_inertia, run.weight, np.append(loop.packed, least), late, STEP,
        run.time, run.goal, run.powered, float(run.position[0]), run.velocity,
    )  # fmt: skip
    steps = run.time[0] + STEP * np.arange(len(motion.position))
    return np.interp(run.time, steps, np.nan_to_num(motion.position, nan=_AWAY))


def error(plant: Plant, runs: Sequence[ServoRun]) -> float:
    """Mean absolute error of the simulated position, over all samples of all runs [rad]."""
    return float(np.mean(np.abs(np.concatenate([simulate(plant, r) - r.position for r in runs]))))


@dataclass(frozen=True)
class ServoObservation:
    """A run as a fit and a screen see it: the measured position beside the simulated one.

    It has of `Observation` what these ask for.
    """

    run: ServoRun

    has_memory = False  # a run begins at rest, and friction forgets where it stood once it slips
    skews = False  # a delay is an effect of its own here

    additive = False  # each effect acts on the motion that all of them make
    jumps = True

    @property
    def name(self) -> str:
        return self.run.name

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(n,) the samples."""
        return np.arange(len(self.run.time))

    @cached_property
    def determined(self) -> NDArray[np.bool_]:
        """(n,) all: a position says something wherever it is."""
        return np.ones(len(self.index), bool)

    @cached_property
    def sample_time(self) -> float:
        """[s]."""
        return float(np.median(np.diff(self.run.time)))

    @property
    def bandwidth(self) -> float:
        """Highest frequency that the samples hold [Hz]."""
        return 0.5 / self.sample_time

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.run.time[-1])

    @property
    def position(self) -> Array:
        """(n,) [rad]."""
        return self.run.position

    @cached_property
    def velocity(self) -> Array:
        """(n,) [rad/s]."""
        return np.gradient(self.run.position, self.run.time)

    @cached_property
    def acceleration(self) -> Array:
        """(n,) [rad/s^2]."""
        return np.gradient(self.velocity, self.run.time)

    @property
    def commands(self) -> Array:
        """(n,) torque of the payload, from which the size of torques is guessed [N m]."""
        return self.run.weight * np.sin(self.run.position)

    typical_torque = commands

    def rows_per_block(self, duration: float) -> int:
        """All: a position error stays for as long as the run goes on."""
        return len(self.index)

    def opening(self, duration: float) -> ServoObservation:
        """Itself."""
        return self

    def settled(self, plant: Plant) -> ServoObservation:
        """Itself."""
        return self

    def grid(self, plant: Plant, memory: Array | None = None, finer: float = 1.0) -> None:
        """None: nothing is replayed."""

    @property
    def samples(self) -> None:
        """None."""

    def look(self, plant: Plant, memory: Array | None = None) -> tuple[Array, None]:
        """What `needed` says."""
        return self.needed(plant), None

    def applied(self, plant: Plant, skew: float = 0.0) -> Array:
        """(n,) measured position [rad]."""
        return self.run.position

    def needed(self, plant: Plant, memory: Array | None = None, grid: None = None) -> Array:
        """(n,) simulated position, large errors moved nearer to the measured one [rad].

        So the square of the difference is the soft L1 loss of the error: a few runs in which the pendulum falls to the
        other side do not decide.
        """
        wrong = self.run.position - _simulate(plant, plant.joint(), self.run)
        square = 2 * _LARGE**2 * (np.sqrt(1 + (wrong / _LARGE) ** 2) - 1)
        return self.run.position - np.copysign(np.sqrt(square), wrong)


def _observe(runs: Sequence[ServoRun]) -> list[Seen]:
    if not runs:
        raise DataError("no runs of a servo to look at")
    return cast(list[Seen], [ServoObservation(r) for r in runs])


def fit(plant: Plant, runs: Sequence[ServoRun]) -> Plant:
    """Identifies the free parameters of a plant, by least squares on the simulated position.

    Args:
        plant: every parameter with the value from which the fit begins.
        runs: to fit.

    Returns:
        The plant with 95 % intervals (runs being independent of each other) and provenance.

    Raises:
        ModelError, DataError: as for `simulate`; there are no runs.
    """
    plant.complete()
    misfit = Misfit(plant, _observe(runs))
    return _found(misfit, solve(misfit, misfit.vector(plant)), runs)


def _found(misfit: Misfit, x: Array, runs: Sequence[ServoRun]) -> Plant:
    plant = misfit.coordinates.decode(x)
    provenance = {
        "records": [r.name for r in runs],
        "position_error": error(plant, runs),
        "version": f"gms_mujoco {__version__}",
    }
    return replace(plant, uncertainty=misfit.coordinates.intervals(x, *covariance(misfit, x)), provenance=provenance)


@dataclass(frozen=True)
class Step:
    """One plant on the way: the one to begin with, or the plant before with one effect more.

    Attributes:
        effect: what was added; None for the first.
        plant: the joint fit.
        error: mean absolute error of the position on the runs that were fitted [rad].
        p_value: of the fall of the squared error on held-out conditions.
        confusable_with: effects that these runs cannot tell from the one added.
        rejected: of the last step, what was tried after it in vain, with its p value.
    """

    effect: str | None
    plant: Plant
    error: float
    p_value: float = float("nan")
    confusable_with: tuple[str, ...] = ()
    rejected: tuple[tuple[str, float], ...] = ()


def explain(
    plant: Plant,
    runs: Sequence[ServoRun],
    most: int = 5,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> tuple[Step, ...]:
    """Adds, one after the other, the effects that a servo's model lacks: the one first that removes most of the error.

    Every effect of the catalogue that can act on a servo is screened; the best are fitted jointly. One is accepted
    where it removes at least 5 % of the squared error at payloads and gains that were left out of the fit, and a t-test
    over the runs in which it acts (`held_out.p_value`) sees that surely (a
    false discovery rate of 1 % over those tried).

    Args:
        plant: to begin with, such as `servo()`.
        runs: that decide; judge the result on others.
        most: effects to add.
        without: names of effects that are not looked at, such as `TIED_TO_THE_PLACE` where the plant is to serve on
            another mount: a pendulum loads the gear by where it hangs, and they can stand for that.
        progress: called with a share in 0..1 and a message.

    Raises:
        ModelError, DataError: as for `fit`.
    """
    report = progress or (lambda done, message: None)
    report(0.0, "fitting")
    seen, fold = _observe(runs), _conditions(runs)
    misfit = Misfit(plant.complete(), seen)
    x = solve(misfit, misfit.vector(plant))
    steps = [_step(None, misfit, x, runs)]
    for k in range(most):
        done = k / most
        report(done, "screening the catalogue")
        held_out = cross_validated(misfit, x, fold)
        screen, current = Screen(misfit, x), misfit.coordinates.decode(x)
        looked_at = [e for e in candidates(current) if e.name not in without]
        scored = [c for c in map(screen.candidate, looked_at) if c is not None]
        scored.sort(key=lambda c: -c.gain)
        trials = []
        for c in scored[:_CONTENDERS]:
            report(done + 0.5 / most, f"trying {c.effect.name}")
            trials.append(min((_tried(current, e, seen, fold) for e in (c.effect, c.strong) if e), key=_left))
        p_values = {t.effect: p_value(held_out, t.held_out) for t in trials}
        enough = (1 - _LEAST_GAIN) * held_out.total
        passed = discoveries(p_values)
        earned = [t for t in trials if t.effect in passed and _left(t) < enough]
        earned = [t for t in earned if is_present(t.misfit.coordinates.decode(t.vector)[t.effect])]
        if not earned:
            steps[-1] = replace(steps[-1], rejected=tuple(p_values.items()))
            break
        at, others = simplest([t.held_out for t in earned], [t.misfit.size for t in earned])
        chosen = earned[at]
        name, misfit = chosen.effect, chosen.misfit
        report(done + 0.9 / most, f"refitting with {name}")
        x = solve(misfit, chosen.vector)
        confusable = tuple(earned[i].effect for i in others)
        steps.append(_step(name, misfit, x, runs, p_values[name], confusable))
    report(1.0, "done")
    return tuple(steps)


@dataclass(frozen=True)
class _Trial:
    """A rough joint fit with one effect more, and what it leaves where it was not fitted."""

    effect: str
    misfit: Misfit
    vector: Array
    held_out: HeldOut


def _tried(plant: Plant, effect: Effect, seen: Sequence[Seen], fold: NDArray[np.intp] | None) -> _Trial:
    misfit = Misfit(plant + effect, seen)
    x = nudge(misfit, misfit.vector(plant + effect))
    return _Trial(effect.name, misfit, x, cross_validated(misfit, x, fold))


def _left(trial: _Trial) -> float:
    return trial.held_out.total


def _conditions(runs: Sequence[ServoRun]) -> NDArray[np.intp] | None:
    """(runs,) number of the payload and gain that each has, None where all have the same.

    An effect has to hold where the fit has not been: runs of one payload and gain share what is particular to them.
    """
    kinds = [(r.inertia, r.weight, r.gain) for r in runs]
    if len(set(kinds)) == 1:
        return None
    return np.unique(np.array(kinds), axis=0, return_inverse=True)[1].reshape(-1)


def _step(
    name: str | None, misfit: Misfit, x: Array, runs: Sequence[ServoRun], p: float = float("nan"),
    confusable: tuple[str, ...] = (),
) -> Step:  # fmt: skip
    plant = _found(misfit, x, runs)
    return Step(name, plant, float(plant.provenance["position_error"]), p, confusable)


def candidates(plant: Plant) -> list[type[Effect]]:
    """The effects that could be added to a servo: those on its shaft, a delay of its goal, and a least duty.

    Not those that need a temperature, or that put a part of the inertia behind a coupling.
    """
    known = [e for e in applicable(plant) if e.is_native and e.name not in plant and e.name != "thermal_drift"]
    known = [e for e in known if not any(p.unit == "kg m^2" for p in e.parameters)]
    return known + [e for n in ("delay", "least_duty") if n not in plant for e in [effects.find(n)]]
