"""The native vector environments for stable-baselines3, which needs the extra `rl`.

    envs = SB3Vector(gymnasium.make_vec("GmsMujoco/ServoTracking-v0", num_envs=16, autoreset_mode="SameStep"))
    model = stable_baselines3.PPO("MlpPolicy", Compensation(envs, bandwidth=50.0)).learn(1_000_000)
    controller = Learned(model, envs.axes, bandwidth=50.0)       # for gms_mujoco.control.follow

`SB3Vector` hands the environment over as it is. `Compensation` is a wrapper for `ServoTracking` that scales what is
observed and may add the action to a PID.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from .control import PID, Controller
from .control.base import ERROR, SPEED, TORQUE, VELOCITY
from .env import episode_option
from .errors import GmsError, ModelError
from .goals import Excitation, Tracking, expect_vector
from .learn import NAMES, Features, Sizes
from .servo import Axes

try:
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
except ImportError:
    raise GmsError("gms_mujoco.sb3 needs stable-baselines3: pip install 'gms-mujoco[rl]'") from None

Array = NDArray[np.float64]

REACH = 3.0  # friction levels that the action of `Compensation` spans
_OBSERVED = 3 + len(NAMES)


class SB3Vector(VecEnv):
    """A native vector environment as stable-baselines3 wants one.

    Args:
        envs: `ServoTracking` or `ServoExcitation` of `gymnasium.make_vec` with `autoreset_mode="SameStep"`.

    Raises:
        ModelError: another environment, or its episodes do not start anew in the step in which they end.
    """

    def __init__(self, envs: Any) -> None:
        self.envs = expect_vector(envs, Tracking, Excitation)
        if self.envs.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ModelError("stable-baselines3 needs episodes that start anew at once: autoreset_mode='SameStep'")
        self.axes: Axes = self.envs.axes
        super().__init__(self.envs.num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self._actions = np.zeros((self.num_envs, 1))

    def reset(self) -> Array:
        """Begins an episode on every axis; (num_envs, 8 or 4) observations."""
        given = any(s is not None for s in self._seeds)
        options = {"episode": [episode_option(o) for o in self._options]}
        observation, _ = self.envs.reset(seed=list(self._seeds) if given else None, options=options)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keeps the (num_envs, 1) actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, whether an episode ended, and what else is known."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        ended = terminated | truncated
        error = info.get("error", np.zeros(self.num_envs))
        if "final_info" in info:  # of an episode that has ended, not of the next one
            error = np.where(ended, info["final_info"].get("error", error), error)
        infos: list[dict[str, Any]] = [{"error": e, "TimeLimit.truncated": False} for e in error.tolist()]
        for i in np.flatnonzero(ended):
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return observation, reward.astype(np.float32), ended, infos

    def close(self) -> None:
        """Closes the environment."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the vector environment, once for each axis asked for."""
        return [getattr(self.envs, attr_name)] * len(self._which(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute of the vector environment, which all axes share."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of the vector environment, once; its result for each axis asked for."""
        return [getattr(self.envs, method_name)(*args, **kwargs)] * len(self._which(indices))

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """Never: an axis of a native vector environment is no environment of its own."""
        return [False] * len(self._which(indices))

    def _which(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))


class _Eye:
    """(n, 15) numbers of order one from (n, 8) observations."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes, self.features = sizes, Features(sizes)

    def __call__(self, observation: Array) -> NDArray[np.float32]:
        s = self.sizes
        error = np.clip(50 * observation[:, ERROR] / s.breakaway, -10, 10)
        slope = (observation[:, VELOCITY] - observation[:, SPEED]) / (100 * s.breakaway)
        own = np.stack([error, np.clip(slope, -10, 10), observation[:, TORQUE] / s.level], axis=1)
        return np.concatenate([own, np.clip(self.features(observation), -10, 10)], axis=1).astype(np.float32)


class Compensation(VecEnvWrapper):
    """`ServoTracking` with observations of order one, and an action of three friction levels, alone or beside a PID.

    Observation, (15,): error (per 1/50 break-away distance), its slope, torque (in friction levels), and the features
    of `gms_mujoco.learn`.

    Args:
        venv: of `ServoTracking`.
        bandwidth: of the PID [Hz]; None: the action is the whole torque.
    """

    def __init__(self, venv: SB3Vector, bandwidth: float | None = 50.0) -> None:
        space = gym.spaces.Box(-10.0, 10.0, (_OBSERVED,), np.float32)
        expect_vector(venv.envs, Tracking)
        super().__init__(venv, observation_space=space)
        self.axes, self.sizes = venv.axes, Sizes.of(venv.axes)
        self.eye, self.pid = _Eye(self.sizes), _pid(self.sizes, bandwidth)
        self.seen = np.zeros((self.num_envs, 8))

    def reset(self) -> NDArray[np.float32]:
        """Begins an episode on every axis."""
        self.eye = _Eye(self.sizes)
        if self.pid is not None:
            self.pid.forget(range(self.num_envs))
        self.seen = np.asarray(self.venv.reset())
        return self.eye(self.seen)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Turns (num_envs, 1) actions into torques."""
        torque = np.asarray(actions, float)[:, 0] * REACH * self.sizes.level
        if self.pid is not None:
            torque = torque + self.pid(self.seen)
        self.venv.step_async((torque / self.axes.torque_limit)[:, None])

    def step_wait(self) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """As of `SB3Vector`."""
        seen, reward, ended, infos = self.venv.step_wait()
        self.seen = np.asarray(seen)
        rows = np.flatnonzero(ended).tolist()
        if rows:
            last = self.seen.copy()
            last[rows] = [infos[i]["terminal_observation"] for i in rows]
            final = self.eye(last)
            for i in rows:
                infos[i]["terminal_observation"] = final[i]
            self.eye.features.forget(rows, self.seen)
            if self.pid is not None:
                self.pid.forget(rows)
            shown = final.copy()
            shown[rows] = self.eye(self.seen)[rows]  # the others have not moved since: a second look leaves them be
            return shown, reward, ended, infos
        return self.eye(self.seen), reward, ended, infos


class Learned(Controller):
    """A policy of stable-baselines3, trained on `Compensation`, as a controller of one axis.

    Args:
        model: has `predict`.
        axes: that it was trained on, for their sizes.
        bandwidth: of the PID [Hz], as in the training.
    """

    def __init__(self, model: Any, axes: Axes, bandwidth: float | None = 50.0) -> None:
        self.model, self.sizes = model, Sizes.of(axes)
        self.eye, self.pid = _Eye(self.sizes), _pid(self.sizes, bandwidth)

    def __call__(self, observation: Array) -> float:
        action, _ = self.model.predict(self.eye(observation[None])[0], deterministic=True)
        torque = float(action[0]) * REACH * self.sizes.level
        return torque + (0.0 if self.pid is None else float(self.pid(observation)))


def _pid(sizes: Sizes, bandwidth: float | None) -> PID | None:
    return None if bandwidth is None else PID(sizes.inertia, sizes.sample_time, bandwidth)
