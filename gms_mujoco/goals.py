"""What the environments ask for: what is observed, rewarded, and ends an episode, for n axes at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ModelError
from .servo import Axes

Array = NDArray[np.float64]

_CELLS = 10  # of the information matrix of the excitation
_FASTEST = 1e4  # rad/s, bound of what is observed


class Tracking:
    """Follow a reference: see `gms_mujoco.env.ServoTracking`."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.error_scale = max(axes.scale.breakaway / 50, 2 * axes.resolution)
        self.most = 100 * axes.scale.breakaway
        seconds = axes.episode_steps * axes.sample_time  # a reference goes on by up to 50 break-aways in 0.15 s
        reach = 4 * math.pi + abs(axes.mechanism.start or 0.0) + (200 + 400 * seconds) * axes.scale.breakaway
        a = 100 * axes.scale.acceleration
        self.bounds = np.array([reach, reach, _FASTEST, a, reach, 2 * self.most, _FASTEST, axes.torque_limit])

    def begin(self, i: int) -> None:
        pass

    def observe(self) -> Array:
        x = self.axes
        r = x.now()
        out = np.empty((x.n, 8))
        out[:, 0] = x.reading
        out[:, 1:4] = r
        out[:, 4] = x.now(1)[:, 0]
        np.subtract(r[:, 0], x.reading, out=out[:, 5])
        out[:, 6] = x.velocity()
        out[:, 7] = x.torque
        return np.minimum(np.maximum(out, -self.bounds, out=out), self.bounds, out=out)

    def judge(self) -> tuple[Array, NDArray[np.bool_]]:
        error = np.abs(self._error())
        return self.error_scale / (self.error_scale + error), error > self.most

    def info(self) -> dict[str, Array]:
        return {"position": self.axes.position.copy(), "error": self._error()}

    def _error(self) -> Array:
        return self.axes.target() - self.axes.position

    def get_state(self, i: int) -> dict[str, Any]:
        return {}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        pass


class Excitation:
    """Tell of the friction: see `gms_mujoco.env.ServoExcitation`."""

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
        columns = (x.reading - x.first_reading, x.velocity(), x.torque, x.step_number / x.episode_steps)
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


Goal = Tracking | Excitation


def expect_vector(envs: Any, *goals: type[Goal]) -> Any:
    """The native vector environment behind wrappers; raises ModelError where it is another, or has another goal."""
    found = getattr(envs, "unwrapped", envs)
    if not (hasattr(found, "num_envs") and isinstance(getattr(found, "task", None), goals)):
        names = " or ".join(f"Servo{goal.__name__}" for goal in goals)
        raise ModelError(
            f"a vector {names} is expected, as gymnasium.make_vec makes it; {type(found).__name__} given"
        )
    return found
