"""The servo axis behind the environments: MuJoCo with the friction of a plant, a drive and an encoder.

Units are those of a hinge; a slide has m for rad and N for N m.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from . import engine
from .errors import ModelError
from .files import MODELS
from .plant import Plant
from .tasks import TASKS, Episode, check_tasks, draw, scale_of

Array = NDArray[np.float64]

JOINT = "shaft"
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # with plugin_state, the forces of the elements


def plant_of(plant: Plant | str | os.PathLike[str]) -> Plant:
    """A plant as it is, from a `model.toml`, or the one of models/ with that name ("servo_axis")."""
    if isinstance(plant, Plant):
        return plant.complete()
    return Plant.load(os.fspath(plant)).complete()


def axis_model(plant: Plant, timestep: float, torque_limit: float) -> mujoco.MjModel:
    """The servo axis of models/ with the inertia and the effects of a plant.

    Args:
        plant: every parameter set.
        timestep: of MuJoCo [s].
        torque_limit: of the drive [N m].
    """
    spec = mujoco.MjSpec.from_file(str(MODELS / "servo_axis.xml"))
    spec.option.timestep = timestep
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # nothing is there to touch
    rotor, joint = spec.body("rotor"), spec.joint(JOINT)
    if plant.kind == "slide":
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE
        rotor.mass = plant.driven_inertia
    else:
        rotor.inertia = [plant.driven_inertia] * 3
    assert plant.inertia is not None
    joint.armature = plant.inertia - plant.driven_inertia  # attach takes it off again
    spec.actuator("drive").ctrlrange = [-torque_limit, torque_limit]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*acts on the measurement alone")  # the encoder below sees to it
        return engine.attach(spec, {JOINT: plant}).compile()


class Axes:
    """n independent servo axes, each with its own friction: the physics and the measurement of all environments.

    Args:
        n: number of axes.
        plant: a Plant, the path of a model.toml or the name of one in models/.
        rate: of the servo [Hz].
        substeps: time steps of MuJoCo in a sample.
        resolution: position of one encoder count [rad]; the default is a millionth of a revolution, or a micrometre.
        torque_limit: [N m]; the default is 10 times the friction at low speed.
        tasks: references to draw from, by name; see `gms_mujoco.tasks.TASKS`.
        spread: of the friction from episode to episode, see `gms_mujoco.tasks.scatter`; 1: always the plant's own.
        split: "train", "test" or "held_out_friction", see `gms_mujoco.tasks.draw`.
        episode_steps: samples of an episode.

    Raises:
        ModelError: an argument that cannot be.
    """

    def __init__(
        self,
        n: int = 1,
        plant: Plant | str | os.PathLike[str] = "servo_axis",
        rate: float = 2000.0,
        substeps: int = 5,
        resolution: float | None = None,
        torque_limit: float | None = None,
        tasks: Sequence[str] = tuple(TASKS),
        spread: float = 1.4,
        split: str = "train",
        episode_steps: int = 2000,
    ) -> None:
        self.plant = plant_of(plant)
        if resolution is None:
            resolution = 1e-6 * (2 * math.pi if self.plant.kind == "hinge" else 1)
        numbers = {"rate": rate, "substeps": substeps, "resolution": resolution, "episode_steps": episode_steps, "n": n}
        for name, value in numbers.items():
            if not 0 < value < math.inf:
                raise ModelError(f"{name} must be positive; {value!r} given")
        if not 1 <= spread < math.inf:
            raise ModelError(f"spread must be at least 1; {spread!r} given")
        self.n, self.sample_time, self.substeps, self.episode_steps = n, 1 / rate, substeps, episode_steps
        self.resolution, self.spread, self.split = float(resolution), spread, split
        self.tasks = check_tasks(tasks)
        self.scale = scale_of(self.plant, self.resolution)
        self.torque_limit = 10 * self.scale.level if torque_limit is None else float(torque_limit)
        if not 0 < self.torque_limit < math.inf:
            raise ModelError(f"torque_limit must be positive [N m]; {torque_limit!r} given")
        self._draw(np.random.default_rng(0), None)  # a wrong split or task shows here
        self._sensors = [e for e in self.plant.effects if e.kind == "sensor"]
        self.episodes: list[Episode | None] = [None] * n
        self.models: list[Any] = [None] * n
        self.data: list[Any] = [None] * n
        self.step_number = np.zeros(n, int)
        self.position = np.zeros(n)  # true [rad]
        self.reading = np.zeros(n)
        self.last_reading = np.zeros(n)
        self.torque = np.zeros(n)  # that was held in the last sample
        self.start = np.zeros(n)
        self.reference = np.zeros((n, episode_steps + 2, 3))
        self._rows = np.arange(n)

    def _draw(self, rng: np.random.Generator, episode: int | None) -> Episode:
        return draw(
            self.plant, self.scale, rng, self.episode_steps + 2, self.sample_time, self.tasks, self.spread, self.split,
            episode,
        )

    def _encoder(self, time: Array, position: Array) -> Array:
        """What the effects of the sensor make of the positions, in whole counts."""
        for e in self._sensors:
            position = e.read(time, position)
        return np.asarray(np.round(position / self.resolution) * self.resolution)

    def reset(self, i: int, rng: np.random.Generator, episode: int | None = None) -> None:
        """Begins a new episode of axis i, drawn by `rng`, or the fixed one of that number."""
        self.reading[i] = self.last_reading[i] = self._begin(i, self._draw(rng, episode))
        self.position[i] = self.start[i]
        self.torque[i] = 0.0
        self.step_number[i] = 0

    def _begin(self, i: int, episode: Episode) -> float:
        """Puts axis i at the start of an episode; returns what the encoder reads there: the reference begins at it."""
        self.episodes[i] = episode
        model = axis_model(episode.plant, self.sample_time / self.substeps, self.torque_limit)
        data = mujoco.MjData(model)
        data.qpos[0] = episode.position
        self.models[i], self.data[i] = model, data
        reading = float(self._encoder(np.zeros(1), np.array([episode.position]))[0])
        self.start[i], self.reference[i] = episode.position, episode.reference
        self.reference[i, :, 0] += reading - episode.position
        return reading

    def step(self, action: NDArray[Any], skip: NDArray[np.bool_] | None = None) -> None:
        """One sample of the servo.

        Args:
            action: (n,) torque over its limit, held for the sample; clipped to [-1, 1].
            skip: (n,) axes that stand still.
        """
        # Not a mujoco.batch.Batch: it makes the plug-ins of all its simulations from one model, so that they would all
        # have one friction. On one thread this loop is as fast.
        torque = np.clip(np.asarray(action, float), -1.0, 1.0) * self.torque_limit
        position, step = self.position, mujoco.mj_step
        for i, (model, data) in enumerate(zip(self.models, self.data, strict=True)):
            if skip is None or not skip[i]:
                data.ctrl[0] = torque[i]
                step(model, data, self.substeps)
                position[i] = data.qpos[0]
        self.torque[:] = torque
        self.step_number += 1
        self.last_reading[:] = self.reading
        self.reading[:] = self._encoder(self.step_number * self.sample_time, position)

    def velocity(self) -> Array:
        """(n,) difference of the last two readings [rad/s]."""
        return (self.reading - self.last_reading) / self.sample_time

    def now(self, ahead: int = 0) -> Array:
        """(n, 3) reference at this sample, or `ahead` later."""
        return self.reference[self._rows, np.minimum(self.step_number, self.episode_steps) + ahead]

    def friction(self, i: int = 0) -> float:
        """True torque of the effects on axis i at this instant [N m]: what an oracle knows."""
        probe = mujoco.MjData(self.models[i])
        mujoco.mj_setState(self.models[i], probe, self._saved(i), _STATE)
        mujoco.mj_forward(self.models[i], probe)
        return engine.friction(self.models[i], probe, JOINT).torque

    def _saved(self, i: int) -> Array:
        out = np.empty(mujoco.mj_stateSize(self.models[i], _STATE))
        mujoco.mj_getState(self.models[i], self.data[i], out, _STATE)
        return out

    _FIELDS: ClassVar = ("step_number", "position", "reading", "last_reading", "torque")

    def get_state(self, i: int) -> dict[str, Any]:
        """All of axis i, with the states of its friction elements."""
        if self.episodes[i] is None:
            raise ModelError("there is no state yet; reset the environment first")
        return {"episode": self.episodes[i], "mujoco": self._saved(i)} | {
            k: getattr(self, k)[i].item() for k in self._FIELDS
        }

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Puts axis i where `get_state` found it or another of the same environment."""
        self._begin(i, state["episode"])
        mujoco.mj_setState(self.models[i], self.data[i], state["mujoco"], _STATE)
        for k in self._FIELDS:
            getattr(self, k)[i] = state[k]
