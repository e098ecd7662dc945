"""Feedback that knows the inertia alone: PID, disturbance observer, active disturbance rejection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .base import ACCELERATION, ERROR, POSITION, REFERENCE, SPEED, TORQUE, VELOCITY, Array, Controller, expect_positive


class PID(Controller):
    """Feedback with all three poles of the bare inertia at one place.

    Args:
        inertia: [kg m^2].
        sample_time: [s].
        bandwidth: of the poles [Hz].
        filter: of the derivative of the error, first order [Hz].
        limit: of the integral part, against wind-up [N m].

    It also takes (n, 8) observations of n axes and returns (n,) torques.
    """

    def __init__(
        self, inertia: float, sample_time: float, bandwidth: float = 50.0, filter: float = 250.0,
        limit: float = math.inf,
    ) -> None:
        expect_positive(inertia=inertia, sample_time=sample_time, bandwidth=bandwidth, filter=filter, limit=limit)
        w = 2 * math.pi * bandwidth
        self.p, self.i, self.d = 3 * inertia * w**2, inertia * w**3, 3 * inertia * w
        self.sample_time, self.limit = sample_time, limit
        self.smooth = 1 - math.exp(-2 * math.pi * filter * sample_time)
        self.integral: Any = 0.0
        self.slope: Any = 0.0

    def __call__(self, observation: Array) -> Any:
        error = observation[..., ERROR]
        slope = observation[..., VELOCITY] - observation[..., SPEED]
        self.slope = self.slope + self.smooth * (slope - self.slope)
        integral = self.integral + self.i * self.sample_time * error
        self.integral = np.minimum(np.maximum(integral, -self.limit), self.limit)
        return self.p * error + self.integral + self.d * self.slope

    def forget(self, rows: Sequence[int]) -> None:
        """Begins anew on some of n axes."""
        for part in (self.integral, self.slope):
            if np.ndim(part):
                part[list(rows)] = 0.0


class DisturbanceObserver(Controller):
    """Torque against all that a bare inertia does not explain, by its momentum: model-free compensation.

    The estimate d follows  d' = L (dp/dt - torque - d)  with p the measured momentum.

    Args:
        inertia: [kg m^2].
        sample_time: [s].
        bandwidth: L of the estimate [Hz].
        known: a controller against a part that a model explains, such as `GMSObserver`: the estimate is of the rest,
            and the torque is of both.
    """

    def __init__(
        self, inertia: float, sample_time: float, bandwidth: float = 60.0, known: Controller | None = None
    ) -> None:
        expect_positive(inertia=inertia, sample_time=sample_time, bandwidth=bandwidth)
        self.inertia, self.sample_time, self.known = inertia, sample_time, known
        self.against = 0.0  # torque against the known part in the last sample
        self.rate = 1 - math.exp(-2 * math.pi * bandwidth * sample_time)
        self.momentum: float | None = None
        self.estimate = 0.0

    def __call__(self, observation: Array) -> float:
        momentum = self.inertia * float(observation[SPEED])
        if self.momentum is not None:
            found = (momentum - self.momentum) / self.sample_time - float(observation[TORQUE])
            self.estimate += self.rate * (found + self.against - self.estimate)
        self.momentum = momentum
        if self.known is not None:
            self.against = self.known(observation)
        return self.against - self.estimate


class ADRC(Controller):
    """Active disturbance rejection: state feedback on an extended state observer, in place of a PID.

    The observer estimates position, velocity and the torque d that the bare inertia does not explain, all its poles at
    one frequency (Gao, ACC 2006; the current estimator of Miklosovic, Radke and Gao, ACC 2006). The torque is
    J (a_ref + 2 w (v_ref - v) + w^2 (q_ref - q)) - d.

    Args:
        inertia: [kg m^2].
        sample_time: [s].
        bandwidth: w of the feedback [Hz].
        observer: of the poles of the observer [Hz].
    """

    def __init__(self, inertia: float, sample_time: float, bandwidth: float = 50.0, observer: float = 150.0) -> None:
        expect_positive(inertia=inertia, sample_time=sample_time, bandwidth=bandwidth, observer=observer)
        self.inertia, self.sample_time = inertia, sample_time
        self.w = 2 * math.pi * bandwidth
        b = math.exp(-2 * math.pi * observer * sample_time)
        self.gain = np.array([1 - b**3, 1.5 * (1 - b) ** 2 * (1 + b) / sample_time, (1 - b) ** 3 / sample_time**2])
        self.state: Array | None = None  # position [rad], velocity [rad/s], d over the inertia [rad/s^2]

    def __call__(self, observation: Array) -> float:
        h = self.sample_time
        if self.state is None:
            self.state = np.array([observation[POSITION], 0.0, 0.0])
        else:
            q, v, d = self.state
            a = d + observation[TORQUE] / self.inertia
            q, v = q + h * v + h**2 / 2 * a, v + h * a
            self.state = np.array([q, v, d]) + self.gain * (observation[POSITION] - q)
        q, v, d = self.state
        w = self.w
        a = observation[ACCELERATION] + 2 * w * (observation[VELOCITY] - v) + w**2 * (observation[REFERENCE] - q) - d
        return float(self.inertia * a)
