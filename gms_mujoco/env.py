"""Gymnasium environments of one servo axis that runs in MuJoCo with the friction of a plant.

    env = gymnasium.make("GmsMujoco/ServoTracking-v0", plant="model.toml", tasks=["slow_sine", "reversals"])
    envs = gymnasium.make_vec("GmsMujoco/ServoTracking-v0", num_envs=64)

A step is one sample of the servo: the drive holds the torque for the sample, the encoder reads the position in counts
at its end. The single environments and the native vector ones are faces of one class, `servo.Axes`, and agree to the
last bit. Units are those of a hinge; a slide has m for rad and N for N m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, ClassVar

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from .errors import ModelError, listing
from .plant import Plant
from .servo import Axes, axis_model

Array = NDArray[np.float64]

_CELLS = 10  # of the information matrix of the excitation
_FASTEST = 1e4  # rad/s, bound of what is observed


class Tracking:
    """The task of `ServoTracking`: what is observed, rewarded, and ends an episode, for n axes at once."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.error_scale = max(axes.scale.breakaway / 50, 2 * axes.resolution)
        self.most = 100 * axes.scale.breakaway
        seconds = axes.episode_steps * axes.sample_time  # a reference goes on by up to 50 break-aways in 0.15 s
        reach = 4 * math.pi + (200 + 400 * seconds) * axes.scale.breakaway
        a = 100 * axes.scale.acceleration
        self.bounds = np.array([reach, reach, _FASTEST, a, reach, 2 * self.most, _FASTEST, axes.torque_limit])

    def begin(self, i: int) -> None:
        pass

    def observe(self) -> Array:
        x = self.axes
        r, ahead = x.now(), x.now(1)
        columns = (x.reading, *r.T, ahead[:, 0], r[:, 0] - x.reading, x.velocity(), x.torque)
        return np.clip(np.stack(columns, axis=1), -self.bounds, self.bounds)

    def judge(self) -> tuple[Array, NDArray[np.bool_]]:
        error = np.abs(self._error())
        return self.error_scale / (self.error_scale + error), error > self.most

    def info(self) -> dict[str, Array]:
        return {"position": self.axes.position.copy(), "error": self._error()}

    def _error(self) -> Array:
        return self.axes.now()[:, 0] - self.axes.position

    def get_state(self, i: int) -> dict[str, Any]:
        return {}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        pass


class Excitation:
    """The task of `ServoExcitation`: the information that the motion holds on a Maxwell-slip axis."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.travel = 2 * math.pi if axes.plant.kind == "hinge" else 500 * axes.scale.breakaway
        self.bounds = np.array([2 * self.travel, _FASTEST, axes.torque_limit, 1.0])
        # Stop operators on a fixed grid of break-away distances, then velocity and acceleration.
        self.widths = axes.scale.breakaway * np.geomspace(0.01, 10, _CELLS - 2)
        self.stops = np.zeros((axes.n, _CELLS - 2))
        self.speed = np.zeros(axes.n)
        self.at = np.zeros(axes.n)
        self.inverse = np.zeros((axes.n, _CELLS, _CELLS))
        self.gain = np.zeros(axes.n)

    def begin(self, i: int) -> None:
        self.stops[i], self.speed[i], self.gain[i] = 0, 0, 0
        self.at[i] = self.axes.position[i]
        self.inverse[i] = np.eye(_CELLS)

    def observe(self) -> Array:
        x = self.axes
        columns = (x.reading - x.start, x.velocity(), x.torque, x.step_number / x.episode_steps)
        return np.clip(np.stack(columns, axis=1), -self.bounds, self.bounds)

    def judge(self) -> tuple[Array, NDArray[np.bool_]]:
        x = self.axes
        moved = x.position - self.at
        self.stops = np.clip(self.stops + moved[:, None], -self.widths, self.widths)
        speed = moved / x.sample_time
        acceleration = (speed - self.speed) / x.sample_time
        self.at, self.speed = x.position.copy(), speed
        v, a = speed / 10, acceleration / x.scale.acceleration
        row = np.concatenate([self.stops / self.widths, v[:, None], a[:, None]], axis=1)
        # The information matrix grows by row row': its determinant by 1 + row' inverse row, its inverse by rank one.
        side = np.ascontiguousarray(self.inverse * row[:, None, :]).sum(axis=2)
        self.gain = np.ascontiguousarray(side * row).sum(axis=1)
        self.inverse = self.inverse - side[:, :, None] * side[:, None, :] / (1 + self.gain)[:, None, None]
        return np.log1p(self.gain), np.abs(x.position - x.start) > self.travel

    def info(self) -> dict[str, Array]:
        return {"position": self.axes.position.copy()}

    def get_state(self, i: int) -> dict[str, Any]:
        return {k: getattr(self, k)[i].copy() for k in ("stops", "speed", "at", "inverse", "gain")}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        for k, value in state.items():
            getattr(self, k)[i] = value


Task = type[Tracking] | type[Excitation]


def _episode_option(options: Mapping[str, Any] | None) -> Any:
    options = options or {}
    for key in options:
        if key != "episode":
            raise ModelError(f"reset has no option {key!r}; its options are {listing(['episode'])}")
    return options.get("episode")


def _action_space() -> gym.spaces.Box:
    return gym.spaces.Box(-1.0, 1.0, (1,), np.float32)


def _observation_space(task: Tracking | Excitation) -> gym.spaces.Box:
    return gym.spaces.Box(-task.bounds, task.bounds, dtype=np.float64)


class _Servo(gym.Env[Array, NDArray[Any]]):
    """One axis; see the subclasses."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}
    _task: ClassVar[Task]

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ModelError(
                f"render_mode must be one of {listing(self.metadata['render_modes'])} or None; {render_mode!r} given"
            )
        self.render_mode = render_mode
        self.axes = Axes(1, **options)
        self.task = self._task(self.axes)
        self.action_space = _action_space()
        self.observation_space = _observation_space(self.task)
        self._picture: _Picture | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Draws an episode; `options={"episode": number}` takes that one of a fixed split."""
        super().reset(seed=seed)
        self.axes.reset(0, self.np_random, _episode_option(options))
        self.task.begin(0)
        self._show()
        return self.task.observe()[0], self._info()

    def step(self, action: NDArray[Any]) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Holds the torque for one sample."""
        self.axes.step(np.reshape(action, 1))
        reward, terminated = self.task.judge()
        truncated = bool(self.axes.step_number[0] >= self.axes.episode_steps)
        if self.axes.step_number[0] % round(1 / (self.axes.sample_time * self.metadata["render_fps"])) == 0:
            self._show()
        return self.task.observe()[0], float(reward[0]), bool(terminated[0]), truncated, self._info()

    def _info(self) -> dict[str, Any]:
        return {k: float(v[0]) for k, v in self.task.info().items()}

    @property
    def friction(self) -> float:
        """True torque of the effects at this instant [N m]: what an oracle knows."""
        return self.axes.friction()

    @property
    def plant(self) -> Plant:
        """With the friction of this episode."""
        episode = self.axes.episodes[0]
        if episode is None:
            raise ModelError("there is no episode yet; reset the environment first")
        return episode.plant

    def get_state(self) -> dict[str, Any]:
        """The exact state: physics with the friction elements, measurement, reference, random numbers."""
        return {
            "axis": self.axes.get_state(0),
            "task": self.task.get_state(0),
            "random": deepcopy(self.np_random.bit_generator.state),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Goes back to a state of `get_state`, of this environment or of another made with the same arguments."""
        self.axes.set_state(0, state["axis"])
        self.task.set_state(0, state["task"])
        self.np_random.bit_generator.state = deepcopy(state["random"])

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the axis, (480, 480, 3), in mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            return None
        return self._drawn().rgb(self.axes.position[0])

    def _show(self) -> None:
        if self.render_mode == "human":
            self._drawn().show(self.axes.position[0])

    def _drawn(self) -> _Picture:
        if self._picture is None:
            self._picture = _Picture(axis_model(self.axes.plant, 1e-3, self.axes.torque_limit))
        return self._picture

    def close(self) -> None:
        """Closes window and renderer."""
        if self._picture is not None:
            self._picture.close()
        self._picture = None


class _Picture:
    """Draws an axis at a position, off screen or in a window."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.renderer: Any = None
        self.window: Any = None

    def _at(self, position: float) -> None:
        self.data.qpos[0] = position
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def rgb(self, position: float) -> NDArray[np.uint8]:
        self.renderer = self.renderer or mujoco.Renderer(self.model, 480, 480)
        self._at(position)
        self.renderer.update_scene(self.data)
        return np.array(self.renderer.render())

    def show(self, position: float) -> None:
        if self.window is None:
            import mujoco.viewer

            self.window = mujoco.viewer.launch_passive(self.model, self.data)
        self._at(position)
        self.window.sync()

    def close(self) -> None:
        for thing in (self.renderer, self.window):
            if thing is not None:
                thing.close()


class _ServoVector(VectorEnv[Array, NDArray[Any], NDArray[Any]]):
    """Many axes; an episode that has ended starts anew at the next step."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}
    _task: ClassVar[Task]

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            raise ModelError(f"the vector environment draws nothing; render_mode={render_mode!r} given")
        self.num_envs = num_envs
        self.axes = Axes(num_envs, **options)
        self.task = self._task(self.axes)
        self.single_action_space, self.single_observation_space = _action_space(), _observation_space(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._random: list[np.random.Generator] = []
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Draws an episode for every axis. As of Gymnasium's own, axis i of seed s has the seed s + i.

        Args:
            seed: of the first axis, or one for each.
            options: "episode": number in a fixed split, or (num_envs,) numbers.
        """
        n = self.num_envs
        if seed is not None or not self._random:
            seeds = [seed + i for i in range(n)] if isinstance(seed, int) else list(seed or [None] * n)
            super().reset(seed=seeds[0])
            old: list[Any] = self._random or [None] * n
            self._random = [
                r if r is not None and s is None else gym.utils.seeding.np_random(s)[0]
                for r, s in zip(old, seeds, strict=True)
            ]
        episode = _episode_option(options)
        numbers = [episode] * n if np.ndim(episode) == 0 else list(episode)
        for i in range(n):
            self._begin(i, numbers[i])
        self._ended[:] = False
        return self.task.observe(), self._info()

    def _begin(self, i: int, episode: int | None = None) -> None:
        self.axes.reset(i, self._random[i], episode)
        self.task.begin(i)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Holds the torques for one sample; (num_envs, 1) actions."""
        fresh = self._ended
        starting: list[int] = np.flatnonzero(fresh).tolist()
        self.axes.step(np.reshape(actions, self.num_envs), fresh if starting else None)
        reward, terminated = self.task.judge()
        truncated = self.axes.step_number >= self.axes.episode_steps
        for i in starting:
            self._begin(i)
        if starting:
            reward[fresh], terminated[fresh], truncated[fresh] = 0.0, False, False
        self._ended = terminated | truncated
        return self.task.observe(), reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        infos: dict[str, Any] = dict(self.task.info())
        return infos | {f"_{k}": np.ones(self.num_envs, bool) for k in infos}

    def get_state(self) -> dict[str, Any]:
        """The exact state of all axes."""
        axes = range(self.num_envs)
        return {
            "axis": [self.axes.get_state(i) for i in axes],
            "task": [self.task.get_state(i) for i in axes],
            "random": [deepcopy(r.bit_generator.state) for r in self._random],
            "ended": self._ended.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Goes back to a state of `get_state`."""
        self._random = self._random or [np.random.default_rng() for _ in range(self.num_envs)]
        for i in range(self.num_envs):
            self.axes.set_state(i, state["axis"][i])
            self.task.set_state(i, state["task"][i])
            self._random[i].bit_generator.state = deepcopy(state["random"][i])
        self._ended = state["ended"].copy()


class ServoTracking(_Servo):
    """Follow a reference that enters pre-sliding.

    Action, Box(-1, 1, (1,)): torque over `axes.torque_limit`.

    Observation, Box (8,) of float64, what a drive knows at the sample:
        0 position, in whole encoder counts [rad]
        1 reference position [rad], 2 velocity [rad/s], 3 acceleration [rad/s^2]
        4 reference position of the next sample [rad]
        5 tracking error, 1 less 0 [rad]
        6 velocity, difference of the last two positions [rad/s]
        7 torque in the last sample [N m]

    Reward in (0, 1]: w / (w + |error|) with the true error at the end of the sample and w = 1/50 of the break-away
    distance. Terminated where the error exceeds 100 break-away distances; truncated after `episode_steps`.
    info: true `position` and `error` [rad]. Arguments: those of `Axes` but `n`.
    """

    _task = Tracking


class ServoTrackingVector(_ServoVector):
    """Many `ServoTracking`; axis i is a `ServoTracking` with its seed, to the last bit."""

    _task = Tracking


class ServoExcitation(_Servo):
    """Move the axis so that its motion tells as much of the friction as it can.

    Action, Box(-1, 1, (1,)): torque over `axes.torque_limit`.

    Observation, Box (4,) of float64:
        0 position since the start, in whole encoder counts [rad]
        1 velocity, difference of the last two positions [rad/s]
        2 torque in the last sample [N m]
        3 share of the episode that is over [1]

    Reward: growth of the log determinant of the information matrix of a Maxwell-slip axis, which is linear in eight
    elements with fixed break-away distances (0.01 to 10 of the plant's), viscous drag (per 10 rad/s) and inertia (per
    `scale.acceleration`), from a unit matrix. Terminated beyond one revolution (a slide: 500 break-away distances)
    from the start; truncated after `episode_steps`. info: true `position` [rad]. Arguments: those of `Axes` but `n`;
    `tasks` has no influence.
    """

    _task = Excitation


class ServoExcitationVector(_ServoVector):
    """Many `ServoExcitation`; axis i is a `ServoExcitation` with its seed, to the last bit."""

    _task = Excitation
