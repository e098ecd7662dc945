"""One controller per axis follows the references of an environment."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..goals import Tracking, expect_vector
from .base import POSITION, Array, Controller


@dataclass(frozen=True)
class Trace:
    """What happened, n axes at once; NaN from the sample after that in which an axis ran away.

    Attributes:
        reference, position, reading: (steps, n) where the joint should be after each sample, where it is, and what the
            encoder reads [rad].
        torque: (steps, n) that was held over the sample [N m].
        ended: (n,) whether the axis ran away.
        sample_time: [s].
        cost: of one call of one controller, mean [s].
    """

    reference: Array
    position: Array
    reading: Array
    torque: Array
    ended: NDArray[np.bool_]
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

    Raises:
        ModelError: another environment, not one controller for each axis, one for another sample time, or a torque
            that is no finite number.
    """
    envs = expect_vector(envs, Tracking)
    axes = envs.axes
    if isinstance(make, Controller):
        raise ModelError("every axis needs a controller of its own, as in follow(envs, lambda k: PID(...)); one given")
    observation, _ = envs.reset(seed=seed, options=None if episodes is None else {"episode": list(episodes)})
    if prepare is not None:
        prepare(axes)
        observation = envs.task.observe()
    controllers = [make(k) for k in range(axes.n)] if callable(make) else list(make)
    if len(controllers) != axes.n:
        raise ModelError(f"one controller for each of {axes.n} axes is expected; {len(controllers)} given")
    for c in controllers:
        made_for = getattr(c, "sample_time", None)
        if made_for is not None and not math.isclose(made_for, axes.sample_time, rel_tol=1e-6):
            raise ModelError(f"a controller for samples of {made_for:g} s is given, those of the environment last "
                             f"{axes.sample_time:g} s")  # fmt: skip

    def act(seen: Array, running: NDArray[np.bool_]) -> Array:
        return np.ravel([c(o) if r else 0.0 for c, o, r in zip(controllers, seen, running, strict=True)])

    return play(envs, observation, act)


def play(envs: Any, observation: Array, act: Callable[[Array, NDArray[np.bool_]], Array]) -> Trace:
    """Runs the episodes that a vector `ServoTracking` has begun.

    Args:
        envs: the native environment.
        observation: (n, 8) at the beginning.
        act: (n,) torques from (n, 8) observations and which of the axes have not run away yet.
    """
    axes = envs.axes
    reference, position, reading, torque = (np.full((axes.episode_steps, axes.n), math.nan) for _ in range(4))
    running, spent, calls = np.ones(axes.n, bool), 0.0, 0
    for step in range(axes.episode_steps):
        start = time.perf_counter()
        held = np.clip(np.asarray(act(observation, running), float), -axes.torque_limit, axes.torque_limit)
        spent, calls = spent + time.perf_counter() - start, calls + int(running.sum())
        observation, _, terminated, _, info = envs.step(held[:, None] / axes.torque_limit)
        reads, true, error = observation[:, POSITION], info["position"], info["error"]
        if "final_obs" in info:  # the next episode has begun already
            over, final = info["_final_obs"], info["final_info"]
            reads = reads.copy()
            for k in np.flatnonzero(over):
                reads[k] = info["final_obs"][k][POSITION]
            true, error = np.where(over, final["position"], true), np.where(over, final["error"], error)
        rows = (reference, position, reading, torque)
        for row, values in zip(rows, (true + error, true, reads, held), strict=True):
            row[step, running] = values[running]
        running &= ~terminated
        if not running.any():
            break
    return Trace(reference, position, reading, torque, ~running, axes.sample_time, spent / calls)
