"""Gymnasium environments of one servo axis that runs in MuJoCo with the friction of a plant.

    env = gymnasium.make("GmsMujoco/ServoTracking-v0", plant="model.toml", tasks=["slow_sine", "reversals"])
    envs = gymnasium.make_vec("GmsMujoco/ServoTracking-v0", num_envs=64)

A step is one sample of the servo: the drive holds the torque for the sample, the encoder reads the position in counts
at its end. The single environments and the native vector ones are faces of one class, `servo.Axes`, and agree to the
last bit. Units are those of a hinge; a slide has m for rad and N for N m.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from .errors import GmsError, ModelError, listing
from .goals import Excitation, Goal, Tracking
from .plant import Plant
from .servo import Axes

if TYPE_CHECKING:
    from .views.scene import Scene

Array = NDArray[np.float64]

_LOOKS = 400.0  # a second, of "human"


def episode_option(options: Mapping[str, Any] | None) -> Any:
    """The only option of reset: which episode of a fixed split."""
    options = options or {}
    if not isinstance(options, Mapping):
        raise ModelError(f'options of reset are a table, as in {{"episode": 5}}; {options!r} given')
    for key in options:
        if key != "episode":
            raise ModelError(f"reset has no option {key!r}; its options are {listing(['episode'])}")
    return options.get("episode")


def expect_state(state: Any, own: Mapping[str, Any]) -> None:
    """Raises ModelError where a state is not of an environment with the same settings."""
    if not isinstance(state, Mapping) or not isinstance(state.get("of"), Mapping):
        raise ModelError(f"a state of get_state is expected; {type(state).__name__} given")
    other = [k for k, v in own.items() if state["of"].get(k) != v]
    if other:
        told = (f"{k} {state['of'].get(k)}, here {own[k]}" if isinstance(own[k], str | Real) else k for k in other)
        raise ModelError(f"the state is of an environment with another {'; another '.join(told)}")


def action_space() -> gym.spaces.Box:
    """Of one axis: torque over its limit."""
    return gym.spaces.Box(-1.0, 1.0, (1,), np.float32)


def observation_space(task: Goal) -> gym.spaces.Box:
    """Of one axis."""
    return gym.spaces.Box(-task.bounds, task.bounds, dtype=np.float64)


class _Servo(gym.Env[Array, NDArray[Any]]):
    """One axis; see the subclasses.

    Args:
        render_mode: "human" shows the axis in the rerun viewer with its friction, reference and position as it runs;
            "rgb_array" draws pictures.
        recording: with "human", a `.rrd` file to write instead of opening a window, or a stream of rerun.
        **options: those of `Axes` but `n`.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012
    _goal: ClassVar[type[Goal]]

    def __init__(self, render_mode: str | None = None, recording: Any = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ModelError(
                f"render_mode must be one of {listing(self.metadata['render_modes'])} or None; {render_mode!r} given"
            )
        self.render_mode = render_mode
        self.axes = Axes(1, **options)
        # A picture a step, as Gymnasium's recorders take them, at the speed of the axis.
        self.metadata = {**self.metadata, "render_fps": max(round(1 / self.axes.sample_time), 1)}
        self.task = self._goal(self.axes)
        self.action_space = action_space()
        self.observation_space = observation_space(self.task)
        self._picture: _Picture | None = None
        self._recording = recording
        self._scene: Scene | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Draws an episode; `options={"episode": number}` takes that one of a fixed split."""
        super().reset(seed=seed)
        self.axes.reset([0], [self.np_random], [episode_option(options)])
        self.task.begin(0)
        self._show()
        return self.task.observe()[0], self._info()

    def step(self, action: NDArray[Any]) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Holds the torque for one sample."""
        self.axes.step(action)
        reward, terminated = self.task.judge()
        truncated = bool(self.axes.step_number[0] >= self.axes.episode_steps)
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

    @property
    def _settings(self) -> dict[str, Any]:
        return {"environment": type(self).__name__, **self.axes.settings}

    def get_state(self) -> dict[str, Any]:
        """The exact state: physics with the friction elements, measurement, reference, random numbers."""
        return {
            "of": self._settings,
            "axis": self.axes.get_state(0),
            "task": self.task.get_state(0),
            "random": deepcopy(self.np_random.bit_generator.state),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Goes back to a state of `get_state`, of this environment or of another made with the same arguments.

        Raises:
            ModelError: the state is of another kind of environment, or of one with other settings.
        """
        expect_state(state, self._settings)
        self.axes.set_state(0, state["axis"])
        self.task.set_state(0, state["task"])
        self.np_random.bit_generator.state = deepcopy(state["random"])

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the axis, (480, 480, 3), in mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            return None
        if self._picture is None:
            self._picture = _Picture(self.axes.mechanism.build(self.axes.plant, 1e-3, self.axes.torque_limit))
        return self._picture.rgb(self.axes.position[0])

    def _show(self) -> None:
        if self.render_mode != "human":
            return
        model, data = self.axes.physics()
        if self._scene is None:
            from .view import stream

            try:
                self._scene = stream(model, data, self._recording, rate=_LOOKS)
            except GmsError as error:
                if self._recording or isinstance(error, ModelError):
                    raise
                raise GmsError(f'{error}, as in recording = "run.rrd"') from None  # there is no screen
        self._scene(model, data, reference=self.axes.target()[0], position=self.axes.position[0])

    def close(self) -> None:
        """Closes window, recording and renderer."""
        for thing in (self._picture, self._scene):
            if thing is not None:
                thing.close()
        self._picture = self._scene = None


class _Picture:
    """Draws an axis at a position, off screen."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.renderer = mujoco.Renderer(model, 480, 480)

    def rgb(self, position: float) -> NDArray[np.uint8]:
        self.data.qpos[0] = position
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self.renderer.update_scene(self.data)
        return np.array(self.renderer.render())

    def close(self) -> None:
        self.renderer.close()


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
    distance, or two encoder counts where those are more. The true error is that of the joint itself, from a reference
    that begins where the joint does; behind an encoder that is off centre the drive sees another. Terminated where
    the error exceeds 100 break-away distances; truncated after `episode_steps`.
    info: true `position` and `error` [rad]. Arguments: those of `Axes` but `n`.
    """

    _goal = Tracking


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

    _goal = Excitation
