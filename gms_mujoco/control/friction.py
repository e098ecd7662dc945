"""Torque against friction that a model or an oracle tells."""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np

from ..errors import ModelError
from ..plant import Plant, plant_of
from .base import ACCELERATION, AHEAD, POSITION, REFERENCE, VELOCITY, Array, Controller, expect_positive


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
        expect_positive(width=width)
        self.level, self.width = level, width

    def __call__(self, observation: Array) -> float:
        return self.level * math.tanh(float(observation[VELOCITY]) / self.width)


class Follower:
    """The friction of a plant along a motion that becomes known sample by sample.

    It replays the native effects, the same code that MuJoCo and the identifier run, on an axis so heavy that it moves
    as told. The plant may be given by its file or by its name in models/.
    """

    _HEAVY = 1e30

    def __init__(self, plant: Plant | str | os.PathLike[str], sample_time: float) -> None:
        expect_positive(sample_time=sample_time)
        self.joint = plant_of(plant).complete().joint()
        self.sample_time = sample_time
        self.state: Array | None = None
        self.position = math.nan
        self.torque = 0.0
        self.samples = -1  # since the first one: friction may change with time

    def to(self, position: float) -> float:
        """Moves to a position [rad] in one sample; returns the torque on the joint there [N m]."""
        if self.state is None:
            self.position = position
        self.torque, self.state = self._look(position)
        self.position = position
        self.samples += 1
        return self.torque

    def ahead(self, position: float) -> float:
        """The torque if it moved to a position [rad] in the next sample [N m]."""
        return self._look(position)[0]

    def _look(self, position: float) -> tuple[float, Array]:
        h = self.sample_time
        motion = self.joint.simulate(
            self._HEAVY, h, np.zeros(2), self.position, (position - self.position) / h,
            start=self.samples * h, state=self.state, integration="explicit", states=True,
        )
        assert motion.states is not None
        return float(motion.friction[1]), motion.states[1]


class GMSFeedforward(Controller):
    """Torque against the friction that an identified plant has along the reference, mean over the coming sample."""

    def __init__(self, plant: Plant | str | os.PathLike[str], sample_time: float) -> None:
        self.follower, self.sample_time = Follower(plant, sample_time), sample_time

    def __call__(self, observation: Array) -> float:
        here = self.follower.to(float(observation[REFERENCE]))
        return -(here + self.follower.ahead(float(observation[AHEAD]))) / 2


class GMSObserver(Controller):
    """Torque against the friction that an identified plant has along the measured motion.

    The friction state follows the encoder; the torque is that of the middle of the coming sample, taking it to
    move by as much as the reference does.
    """

    def __init__(self, plant: Plant | str | os.PathLike[str], sample_time: float) -> None:
        self.follower, self.sample_time = Follower(plant, sample_time), sample_time

    def __call__(self, observation: Array) -> float:
        here = self.follower.to(float(observation[POSITION]))
        next_position = float(observation[POSITION] + observation[AHEAD] - observation[REFERENCE])
        return -(here + self.follower.ahead(next_position)) / 2


class LuGreObserver(GMSObserver):
    """The same with an identified LuGre model: one bristle state where a Maxwell-slip set has many.

    Args:
        plant: with the effect `lugre`, as `fit` identifies it, its file, or a name out of models/.
        sample_time: [s].

    Raises:
        ModelError: the plant has no `lugre`.
    """

    def __init__(self, plant: Plant | str | os.PathLike[str], sample_time: float) -> None:
        plant = plant_of(plant)
        if "lugre" not in plant:
            raise ModelError(f"a LuGre observer needs a plant with lugre; {[e.name for e in plant.effects]} given")
        super().__init__(plant, sample_time)


class Oracle(Controller):
    """Torque against the true friction of this instant, which no drive knows.

    Args:
        friction: returns it [N m]; `lambda: env.unwrapped.friction`.
    """

    def __init__(self, friction: Callable[[], float]) -> None:
        self.friction = friction

    def __call__(self, observation: Array) -> float:
        return -self.friction()
