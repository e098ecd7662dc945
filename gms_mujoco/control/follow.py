"""One controller per axis follows the references of an environment."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .base import POSITION, REFERENCE, Array, Controller


@dataclass(frozen=True)
class Trace:
    """What happened, n axes at once.

    Attributes:
        reference, position, reading: (steps, n) true position and encoder after each sample, and where to be [rad].
        torque: (steps, n) that was held over the sample [N m].
        ended: (n,) whether the axis ran away.
        sample_time: [s].
        cost: of one call of one controller, mean [s].
    """

    reference: Array
    position: Array
    reading: Array
    torque: Array
    ended: Array
    sample_time: float
    cost: float

    @property
    def error(self) -> Array:
        """(steps, n) true tracking error [rad]."""
        return self.reference - self.position

    def rms(self) -> Array:
        """(n,) rms of it [rad]; infinite where the axis ran away."""
        return np.where(self.ended, math.inf, np.sqrt(np.mean(self.error**2, axis=0)))


def follow(
    envs: Any,
    make: Callable[[int], Controller] | Sequence[Controller],
    seed: int | Sequence[int] | None = None,
    episodes: Sequence[int] | None = None,
    prepare: Callable[[Any], None] | None = None,
) -> Trace:
    """Runs one episode on every axis of a vector `ServoTracking`.

    Args:
        envs: of `gymnasium.make_vec`.
        make: the controller of axis k, or all of them.
        seed: of the axes.
        episodes: numbers in a fixed split.
        prepare: called with the axes once the episodes are drawn, before the first sample.
    """
    envs = envs.unwrapped
    axes = envs.axes
    observation, _ = envs.reset(seed=seed, options=None if episodes is None else {"episode": list(episodes)})
    if prepare is not None:
        prepare(axes)
        observation = envs.task.observe()
    controllers = [make(k) for k in range(axes.n)] if callable(make) else list(make)
    shape = (axes.episode_steps, axes.n)
    reference, position, reading, torque = (np.zeros(shape) for _ in range(4))
    ended, spent = np.zeros(axes.n, bool), 0.0
    for step in range(axes.episode_steps):
        start = time.perf_counter()
        for k, controller in enumerate(controllers):
            torque[step, k] = controller(observation[k])
        spent += time.perf_counter() - start
        np.clip(torque[step], -axes.torque_limit, axes.torque_limit, out=torque[step])
        observation, _, terminated, _, info = envs.step(torque[step][:, None] / axes.torque_limit)
        ended |= terminated
        reference[step], reading[step] = observation[:, REFERENCE], observation[:, POSITION]
        position[step] = info["position"]
    return Trace(reference, position, reading, torque, ended, axes.sample_time, spent / (shape[0] * shape[1]))
