"""The servo axes behind the environments: MuJoCo with the friction of a plant, a drive and an encoder.

Units are those of a hinge; a slide has m for rad and N for N m.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from typing import Any, ClassVar

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from . import engine, native
from .axis import Mechanism
from .errors import ModelError, is_number, listing
from .plant import Plant, plant_of
from .tasks import TASKS, Episode, at_rest, check_tasks, draw, needed, scale_of

Array = NDArray[np.float64]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # with plugin_state, the forces of the elements
_WORTH_THREADS = 32  # axes: fewer step faster on one thread than others wake up


class Axes:
    """n independent servo axes, each with its own friction: the physics and the measurement of all environments.

    Args:
        n: number of axes.
        plant: a Plant, the path of a model.toml or the name of one in models/.
        model: None, a bare axis with the inertia of the plant; or an MJCF file or MjSpec.
        joint: of that model, with its inertia and weight; the others are locked, see `gms_mujoco.axis.Mechanism`.
        rate: of the servo [Hz].
        substeps: time steps of MuJoCo in a sample.
        resolution: position of one encoder count [rad]; the default is a millionth of a revolution, or a micrometre.
        torque_limit: [N m]; the default is 10 times the friction at low speed, or twice what the fastest references
            ask for where drag makes that more, and on top what weight, gravity, springs and cogging come to.
        tasks: references to draw from, by name; see `gms_mujoco.tasks.TASKS`.
        spread: of the friction from episode to episode, a factor or "uncertainty", the intervals of an identified
            plant; see `gms_mujoco.tasks.scatter`. 1: always the plant's own.
        memory: how the friction elements begin: "virgin", never moved; or "random", come to rest after a history
            that differs from episode to episode, so that the axis is at rest under forces that sum to nothing.
        split: "train", "test" or "held_out_friction", see `gms_mujoco.tasks.draw`.
        episode_steps: samples of an episode.
        threads: that step the axes; 0: all processors. The results do not depend on it.

    Raises:
        ModelError: an argument that cannot be.
    """

    def __init__(
        self,
        n: int = 1,
        plant: Plant | str | os.PathLike[str] = "servo_axis",
        model: mujoco.MjSpec | str | os.PathLike[str] | None = None,
        joint: str | None = None,
        rate: float = 2000.0,
        substeps: int = 5,
        resolution: float | None = None,
        torque_limit: float | None = None,
        tasks: Sequence[str] = tuple(TASKS),
        spread: float | str = 1.4,
        memory: str = "virgin",
        split: str = "train",
        episode_steps: int = 2000,
        threads: int = 0,
    ) -> None:
        self.mechanism = Mechanism(plant, model, joint)
        self.plant = self.mechanism.plant
        if resolution is None:
            resolution = 1e-6 * (2 * math.pi if self.plant.kind == "hinge" else 1)
        for name, value in {"rate": rate, "resolution": resolution}.items():
            if not is_number(value) or not 0 < value < math.inf:
                raise ModelError(f"{name} must be positive; {value!r} given")
        for name, count in {"substeps": substeps, "episode_steps": episode_steps, "n": n}.items():
            if not is_number(count, Integral) or count < 1:
                raise ModelError(f"{name} must be a whole number from 1 on; {count!r} given")
        if not is_number(threads, Integral) or threads < 0:
            raise ModelError(f"threads must be a whole number from 0 on; {threads!r} given")
        self.n, self.sample_time, self.substeps, self.episode_steps = n, 1 / rate, substeps, episode_steps
        self.resolution, self.spread, self.memory, self.split = float(resolution), spread, memory, split
        self.tasks = check_tasks(tasks)
        self.scale = scale_of(self.plant, self.resolution)
        limit = self._usual_limit() if torque_limit is None else torque_limit
        if not is_number(limit) or not 0 < limit < math.inf:
            raise ModelError(f"torque_limit must be positive [N m]; {torque_limit!r} given")
        self.torque_limit = float(limit)
        self._draw(np.random.default_rng(0), None)  # a wrong split, spread or task shows here
        self._sensors = [e for e in self.plant.effects if e.kind == "sensor"]
        self._nominal = self._build(self.plant)
        self.models: list[mujoco.MjModel] = [self._nominal] * n
        self.batch = Batch(self._nominal, n, 1 if n < _WORTH_THREADS else threads, persistent=True)
        self._qpos, self._ctrl = self.batch.bind("qpos")[:, 0], self.batch.bind("ctrl")[:, 0]
        self.episodes: list[Episode | None] = [None] * n
        self.step_number = np.zeros(n, int)
        self.position = np.zeros(n)  # true [rad]
        self.reading = np.zeros(n)
        self.last_reading = np.zeros(n)
        self.torque = np.zeros(n)  # that was held in the last sample
        self.start = np.zeros(n)  # true, and what the encoder reads there
        self.first_reading = np.zeros(n)
        self._ahead = np.zeros(n)  # of the joint, where the encoder's effects see it at the start [rad]
        self.reference = np.zeros((n, episode_steps + 2, 3))
        self._rows = np.arange(n)
        self._waiting = set(range(n))  # axes without an episode yet
        self._now: dict[int, Array] = {}  # what `now` has found since the last step
        self._probes: dict[int, tuple[mujoco.MjModel, mujoco.MjData]] = {}

    def _build(self, plant: Plant) -> mujoco.MjModel:
        return self.mechanism.build(plant, self.sample_time / self.substeps, self.torque_limit)

    def _draw(self, rng: np.random.Generator, episode: int | None) -> Episode:
        return draw(
            self.plant, self.scale, rng, self.episode_steps + 2, self.sample_time, self.tasks, self.spread,
            self.memory, self.mechanism.start, self.split, episode, self.mechanism.limits, self.mechanism.push,
        )

    def _usual_limit(self) -> float:
        most = max(10 * self.scale.level, 2 * needed(self.plant, self.scale))
        return most + self.mechanism.weight + self._load()

    def _load(self) -> float:
        """Largest torque of gravity, springs, cogging and the like of the plant where the axis may go [N m]."""
        parts = [e for e in self.plant.effects if e.is_native and e.kind != "friction" and not e.hidden_inertia]
        begin, reach = self.mechanism.start, 100 * self.scale.breakaway
        low, high = (0.0, 2 * math.pi) if begin is None else (begin, begin)
        low, high = np.clip((low - reach, high + reach), *self.mechanism.limits)
        position = np.linspace(low, high, 1000)
        still = replace(self.plant, effects=tuple(parts)).joint()
        return float(np.abs(still.replay(np.arange(1000.0), position, np.zeros(1000)).torque).max())

    def _sees(self, time: Array, position: Array) -> Array:
        """What the effects of the sensor make of the positions."""
        for e in self._sensors:
            position = e.read(time, position)
        return position

    def _counts(self, position: Array) -> Array:
        return np.asarray(np.round(position / self.resolution) * self.resolution)

    def reset(
        self, rows: Sequence[int], rngs: Sequence[np.random.Generator], episodes: Sequence[int | None] | None = None
    ) -> None:
        """Begins new episodes of some axes.

        Args:
            rows: which axes.
            rngs: one for each of them, draws the episode.
            episodes: numbers of fixed ones, for each of them.
        """
        numbers = episodes or [None] * len(rows)
        readings = self._begin(rows, [self._draw(r, k) for r, k in zip(rngs, numbers, strict=True)])
        rows = list(rows)
        self.reading[rows] = self.last_reading[rows] = readings
        self.position[rows] = self.start[rows]
        self.torque[rows] = 0.0
        self.step_number[rows] = 0
        self._now.clear()

    def exchange(self, i: int, plant: Plant) -> None:
        """Begins the episode of axis i anew with another plant: the same reference, another friction.

        Args:
            plant: with the effects of the environment's plant, as many elements and its inertia, or none.
        """
        plant = plant_of(plant)
        episode = self.episodes[i]
        if episode is None:
            raise ModelError("there is no episode yet; reset the environment first")
        own, given = ([f"{e.name} with {e.elements}" for e in p.effects] for p in (self.plant, plant))
        if own != given:
            raise ModelError(f"another plant needs the effects {listing(own)} elements; {listing(given)} given")
        inertia = self.plant.inertia
        if self.mechanism.bare and plant.inertia not in (None, inertia):
            raise ModelError(f"another plant needs the inertia of the axis, {inertia:g}; {plant.inertia:g} given")
        plant, memory = replace(plant, inertia=inertia).complete(), None
        if episode.memory is not None:
            rng, push = np.random.default_rng(0), self.mechanism.push
            memory = at_rest(plant, self.scale, rng, episode.position, push, there=True)[1]
        readings = self._begin([i], [replace(episode, plant=plant, memory=memory)])
        self.reading[i] = self.last_reading[i] = readings[0]
        self.position[i], self.torque[i], self.step_number[i] = self.start[i], 0.0, 0
        self._now.clear()

    def _begin(self, rows: Sequence[int], episodes: Sequence[Episode]) -> Array:
        """Puts axes at the start of episodes; returns what the encoder reads there: the references begin at it.

        An encoder that is off centre reads another place than the joint's. Its reading at the start is the drive's
        zero, so that the joint itself is asked to be `_ahead` before the reference: both errors begin at zero.
        """
        rows = list(rows)
        self._waiting.difference_update(rows)
        self._now.clear()
        before = list(self.models)  # kept until the batch has seen the new ones: addresses tell models apart
        for i, episode in zip(rows, episodes, strict=True):
            self.episodes[i] = episode
            self.models[i] = self._nominal if episode.plant == self.plant else self._build(episode.plant)
            self.start[i], self.reference[i] = episode.position, episode.reference
        self.batch.set_models(self.models)
        self.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[rows] = self.start[rows]
        for i, episode in zip(rows, episodes, strict=True):
            if episode.memory is not None:
                self._remember(i, episode)
        self.batch.forward(rows)
        del before
        seen = self._sees(np.zeros(len(rows)), self.start[rows])
        reading = self._counts(seen)
        self.first_reading[rows], self._ahead[rows] = reading, seen - self.start[rows]
        self.reference[rows, :, 0] += (reading - self.start[rows])[:, None]
        return reading

    def _remember(self, i: int, episode: Episode) -> None:
        """Gives the elements of axis i the forces that a history has left."""
        probe = mujoco.MjData(self.models[i])
        joint = mujoco.mj_name2id(self.models[i], mujoco.mjtObj.mjOBJ_JOINT, self.mechanism.joint)
        found = native.reading(self.models[i]._address, probe._address, joint)
        if found is not None and episode.memory is not None:
            place, state = found.torque, self.batch.bind("plugin_state")[i]
            n = len(episode.memory)
            state[place - n + 2 : place] = episode.memory[2:]  # the first two say where and when: here and now

    def step(self, action: NDArray[Any], skip: NDArray[np.bool_] | None = None) -> None:
        """One sample of the servo.

        Args:
            action: (n,) or (n, 1) torque over its limit, held for the sample; clipped to [-1, 1].
            skip: (n,) axes that stand still.

        Raises:
            ModelError: another number of them, one that is not finite, or there is no episode yet.
        """
        if self._waiting:
            raise ModelError("there is no episode yet; reset the environment first")
        try:
            share = np.asarray(action, float).reshape(self.n)
        except (TypeError, ValueError):
            given = " ".join(repr(action).split())[:60]
            raise ModelError(f"an action is a number for each of {self.n} axes; {given} given") from None
        if not np.isfinite(share).all():
            i = int(np.argmin(np.isfinite(share)))
            raise ModelError(f"an action is a finite number, torque over its limit; {share[i]} given for axis {i}")
        torque = np.clip(share, -1.0, 1.0) * self.torque_limit
        self._ctrl[:] = torque
        self.batch.step(None if skip is None else np.flatnonzero(~skip), nstep=self.substeps)
        self.position[:] = self._qpos
        self.torque[:] = torque
        self.step_number += 1
        self._now.clear()
        self.last_reading[:] = self.reading
        self.reading[:] = self._counts(self._sees(self.step_number * self.sample_time, self.position))

    def velocity(self) -> Array:
        """(n,) difference of the last two readings [rad/s]."""
        return (self.reading - self.last_reading) / self.sample_time

    def now(self, ahead: int = 0) -> Array:
        """(n, 3) reference at this sample, or `ahead` later; not to be changed."""
        if ahead not in self._now:
            self._now[ahead] = self.reference[self._rows, np.minimum(self.step_number, self.episode_steps) + ahead]
        return self._now[ahead]

    def target(self) -> Array:
        """(n,) where the joint itself should be at this sample [rad]: the reference, but for what the encoder is off
        at the start."""
        return np.asarray(self.now()[:, 0] - self._ahead)

    def friction(self, i: int = 0) -> float:
        """True torque of the effects on axis i at this instant [N m]: what an oracle knows."""
        return engine.friction(*self.physics(i), self.mechanism.joint).torque

    def physics(self, i: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Model of axis i and a copy of its state at this instant."""
        model = self.models[i]
        if i not in self._probes or self._probes[i][0] is not model:
            self._probes[i] = (model, mujoco.MjData(model))
        probe = self._probes[i][1]
        mujoco.mj_setState(model, probe, self.batch.state[i], _STATE)
        mujoco.mj_forward(model, probe)
        return model, probe

    @property
    def settings(self) -> dict[str, Any]:
        """What a state depends on: one of `get_state` fits axes with the same."""
        names = ("plant", "sample_time", "substeps", "resolution", "torque_limit", "episode_steps")
        return {k: getattr(self, k) for k in names} | {k: getattr(self.mechanism, k) for k in ("joint", "weight")}

    _FIELDS: ClassVar = ("step_number", "position", "reading", "last_reading", "torque")

    def get_state(self, i: int) -> dict[str, Any]:
        """All of axis i, with the states of its friction elements."""
        if self.episodes[i] is None:
            raise ModelError("there is no state yet; reset the environment first")
        return {"episode": self.episodes[i], "mujoco": self.batch.state[i].copy()} | {
            k: getattr(self, k)[i].item() for k in self._FIELDS
        }

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Puts axis i where `get_state` found it or another of the same environment."""
        self._begin([i], [state["episode"]])
        self.batch.state[i] = state["mujoco"]
        for k in self._FIELDS:
            getattr(self, k)[i] = state[k]
        self._now.clear()
