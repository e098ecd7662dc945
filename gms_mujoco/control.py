"""Controllers of a servo axis, from PID to compensation of friction by an identified model.

Each is a callable of one observation of `ServoTracking`, made new for every episode:

    controller = PID(inertia, sample_time) + GMSObserver(plant, sample_time)
    torque = controller(observation)                                     # N m
    observation, *_ = env.step([torque / env.unwrapped.axes.torque_limit])

They add: a sum of controllers commands the sum of their torques. Units are those of a hinge.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .plant import Plant

Array = NDArray[np.float64]

POSITION, REFERENCE, VELOCITY, ACCELERATION, AHEAD, ERROR, SPEED, TORQUE = range(8)  # of an observation


class Controller:
    """A torque [N m] from an observation; `+` adds the torques of two."""

    def __call__(self, observation: Array) -> float:
        """Torque to hold until the next sample [N m].

        Args:
            observation: (8,) of `ServoTracking`; every sample of the episode in turn, from its reset on.
        """
        raise NotImplementedError

    def __add__(self, other: Controller) -> Controller:
        return _Sum(self, other)


class _Sum(Controller):
    def __init__(self, *parts: Controller) -> None:
        self.parts = parts

    def __call__(self, observation: Array) -> float:
        return sum(part(observation) for part in self.parts)


class PID(Controller):
    """Feedback with all three poles of the bare inertia at one place.

    Args:
        inertia: [kg m^2].
        sample_time: [s].
        bandwidth: of the poles [Hz].
        filter: of the derivative of the error, first order [Hz].
        limit: of the integral part, against wind-up [N m].
    """

    def __init__(
        self, inertia: float, sample_time: float, bandwidth: float = 50.0, filter: float = 250.0,
        limit: float = math.inf,
    ) -> None:
        w = 2 * math.pi * bandwidth
        self.p, self.i, self.d = 3 * inertia * w**2, inertia * w**3, 3 * inertia * w
        self.sample_time, self.limit = sample_time, limit
        self.smooth = 1 - math.exp(-2 * math.pi * filter * sample_time)
        self.integral = self.slope = 0.0

    def __call__(self, observation: Array) -> float:
        error = float(observation[ERROR])
        slope = float(observation[VELOCITY] - observation[SPEED])
        self.slope += self.smooth * (slope - self.slope)
        self.integral = min(max(self.integral + self.i * self.sample_time * error, -self.limit), self.limit)
        return self.p * error + self.integral + self.d * self.slope


class Feedforward(Controller):
    """Torque that a bare inertia with viscous drag needs along the reference.

    Args:
        inertia: [kg m^2].
        viscous: drag per velocity [N m s/rad].
    """

    def __init__(self, inertia: float, viscous: float = 0.0) -> None:
        self.inertia, self.viscous = inertia, viscous

    def __call__(self, observation: Array) -> float:
        return self.inertia * float(observation[ACCELERATION]) + self.viscous * float(observation[VELOCITY])


class CoulombFeedforward(Controller):
    """Torque against dry friction along the reference, tanh of its velocity.

    Args:
        level: [N m].
        width: velocity at which three quarters of it act [rad/s].
    """

    def __init__(self, level: float, width: float) -> None:
        self.level, self.width = level, width

    def __call__(self, observation: Array) -> float:
        return self.level * math.tanh(float(observation[VELOCITY]) / self.width)


class Follower:
    """The friction of a plant along a motion that becomes known sample by sample.

    It replays the native effects, the same code that MuJoCo and the identifier run, on an axis so heavy that it moves
    as told.
    """

    _HEAVY = 1e30

    def __init__(self, plant: Plant, sample_time: float) -> None:
        self.joint = plant.complete().joint()
        self.sample_time = sample_time
        self.state: Array | None = None
        self.position = math.nan
        self.torque = 0.0

    def to(self, position: float) -> float:
        """Moves to a position [rad] in one sample; returns the torque on the joint there [N m]."""
        if self.state is None:
            self.position = position
        self.torque, self.state = self._look(position, self.sample_time)
        self.position = position
        return self.torque

    def ahead(self, position: float) -> float:
        """The torque if it moved to a position [rad] in the next sample [N m]."""
        return self._look(position, self.sample_time)[0]

    def _look(self, position: float, duration: float) -> tuple[float, Array]:
        motion = self.joint.simulate(
            self._HEAVY, duration, np.zeros(2), self.position, (position - self.position) / duration,
            state=self.state, integration="explicit", states=True,
        )
        assert motion.states is not None
        return float(motion.friction[1]), motion.states[1]


class GMSFeedforward(Controller):
    """Torque against the friction that an identified plant has along the reference, mean over the coming sample."""

    def __init__(self, plant: Plant, sample_time: float) -> None:
        self.follower = Follower(plant, sample_time)

    def __call__(self, observation: Array) -> float:
        here = self.follower.to(float(observation[REFERENCE]))
        return -(here + self.follower.ahead(float(observation[AHEAD]))) / 2


class GMSObserver(Controller):
    """Torque against the friction that an identified plant has along the measured motion.

    The friction state follows the encoder; the torque is that of the middle of the coming sample, taking it to
    move by as much as the reference does.
    """

    def __init__(self, plant: Plant, sample_time: float) -> None:
        self.follower = Follower(plant, sample_time)

    def __call__(self, observation: Array) -> float:
        here = self.follower.to(float(observation[POSITION]))
        next_position = float(observation[POSITION] + observation[AHEAD] - observation[REFERENCE])
        return -(here + self.follower.ahead(next_position)) / 2


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


class Oracle(Controller):
    """Torque against the true friction of this instant, which no drive knows.

    Args:
        friction: returns it [N m]; `lambda: env.unwrapped.friction`.
    """

    def __init__(self, friction: Callable[[], float]) -> None:
        self.friction = friction

    def __call__(self, observation: Array) -> float:
        return -self.friction()
