"""The environments of many axes at once, behind `gymnasium.make_vec`.

They step on `mujoco.batch.Batch`, each axis on a model of its own, and agree with single environments to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from numbers import Integral
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from .env import action_space, episode_option, expect_state, observation_space
from .errors import ModelError, is_number, listing
from .goals import Excitation, Goal, Tracking
from .servo import Axes

Array = NDArray[np.float64]

_MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class _ServoVector(VectorEnv[Array, NDArray[Any], NDArray[Any]]):
    """Many axes.

    Args:
        num_envs: number of axes.
        autoreset_mode: an episode that has ended starts anew at the next step, which ignores its action; or in the
            same step, whose info then has "final_obs" and "final_info", as of Gymnasium's own.
        **options: those of `Axes` but `n`.
    """

    _goal: ClassVar[type[Goal]]

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise ModelError(f"the vector environment draws nothing; render_mode={render_mode!r} given")
        found = [m for m in _MODES if autoreset_mode in (m, m.name, m.value)]
        if not found:
            names = listing(m.name for m in _MODES)
            raise ModelError(f"autoreset_mode must be one of {names}; {autoreset_mode!r} given")
        if not is_number(num_envs, Integral) or num_envs < 1:
            raise ModelError(f"num_envs must be a whole number from 1 on; {num_envs!r} given")
        self.metadata = {"render_modes": [], "autoreset_mode": found[0]}
        self._at_once = found[0] is AutoresetMode.SAME_STEP
        self.num_envs = num_envs
        self.axes = Axes(num_envs, **options)
        self.task = self._goal(self.axes)
        self.single_action_space, self.single_observation_space = action_space(), observation_space(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._random: list[np.random.Generator] = []
        self._ended = np.zeros(num_envs, bool)
        self._all = np.ones(num_envs, bool)
        self._all.flags.writeable = False

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
            if isinstance(seed, Integral):
                seeds: list[Any] = [int(seed) + i for i in range(n)]
            else:
                seeds = [None] * n if seed is None else self._each("seed", seed)
            super().reset(seed=seeds[0])
            old: list[Any] = self._random or [None] * n
            self._random = [
                r if r is not None and s is None else gym.utils.seeding.np_random(s)[0]
                for r, s in zip(old, seeds, strict=True)
            ]
        episode = episode_option(options)
        numbers = [episode] * n if np.ndim(episode) == 0 else self._each("episode", episode)
        self._begin(range(n), numbers)
        self._ended[:] = False
        return self.task.observe(), self._info()

    def _each(self, name: str, given: Any) -> list[Any]:
        """One for each axis, as Python has them."""
        if isinstance(given, str) or not np.iterable(given):
            raise ModelError(f"{name} is a whole number, or one for each of {self.num_envs} axes; {given!r} given")
        values = [v.item() if isinstance(v, np.generic) else v for v in given]
        if len(values) != self.num_envs:
            raise ModelError(f"one {name} for each of {self.num_envs} axes is expected, or one; {len(values)} given")
        return values

    def _begin(self, rows: Sequence[int], episodes: Sequence[int | None] | None = None) -> None:
        self.axes.reset(rows, [self._random[i] for i in rows], episodes)
        for i in rows:
            self.task.begin(i)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Holds the torques for one sample; (num_envs, 1) actions."""
        fresh = self._ended
        starting: list[int] = np.flatnonzero(fresh).tolist() if fresh.any() else []
        self.axes.step(actions, fresh if starting else None)
        reward, terminated = self.task.judge()
        truncated = self.axes.step_number >= self.axes.episode_steps
        if starting:
            self._begin(starting)
            reward[fresh], terminated[fresh], truncated[fresh] = 0.0, False, False
        ended = terminated | truncated
        observation, info = self.task.observe(), self._info()
        if not self._at_once:
            self._ended = ended
        elif ended.any():
            final: dict[str, Any] = {"final_obs": np.full(self.num_envs, None, object), "_final_obs": ended}
            rows: list[int] = np.flatnonzero(ended).tolist()
            for i in rows:
                final["final_obs"][i] = observation[i]
            final["final_info"] = {
                k: v & ended if k[0] == "_" else np.where(ended, v, 0) for k, v in info.items()
            }
            self._begin(rows)
            observation, info = self.task.observe(), self._info() | final | {"_final_info": ended}
        return observation, reward, terminated, truncated, info

    def _info(self) -> dict[str, Any]:
        infos: dict[str, Any] = dict(self.task.info())
        return infos | {f"_{k}": self._all for k in infos}

    @property
    def _settings(self) -> dict[str, Any]:
        return {"environment": type(self).__name__, "num_envs": self.num_envs, **self.axes.settings}

    def get_state(self) -> dict[str, Any]:
        """The exact state of all axes."""
        axes = range(self.num_envs)
        return {
            "of": self._settings,
            "axis": [self.axes.get_state(i) for i in axes],
            "task": [self.task.get_state(i) for i in axes],
            "random": [deepcopy(r.bit_generator.state) for r in self._random],
            "ended": self._ended.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Goes back to a state of `get_state`; raises ModelError where it is of another environment."""
        expect_state(state, self._settings)
        self._random = self._random or [np.random.default_rng() for _ in range(self.num_envs)]
        for i in range(self.num_envs):
            self.axes.set_state(i, state["axis"][i])
            self.task.set_state(i, state["task"][i])
            self._random[i].bit_generator.state = deepcopy(state["random"][i])
        self._ended = state["ended"].copy()


class ServoTrackingVector(_ServoVector):
    """Many `ServoTracking`; axis i is a `ServoTracking` with its seed, to the last bit."""

    _goal = Tracking


class ServoExcitationVector(_ServoVector):
    """Many `ServoExcitation`; axis i is a `ServoExcitation` with its seed, to the last bit."""

    _goal = Excitation
