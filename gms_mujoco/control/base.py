"""What a controller is: a torque from an observation."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError

Array = NDArray[np.float64]

POSITION, REFERENCE, VELOCITY, ACCELERATION, AHEAD, ERROR, SPEED, TORQUE = range(8)  # of an observation


def expect_positive(**numbers: float) -> None:
    """Raises ModelError where one of the numbers is not positive."""
    for name, value in numbers.items():
        if not isinstance(value, Real) or not value > 0:
            raise ModelError(f"{name} of a controller must be a positive number; {value!r} given")


class Controller:
    """A torque [N m] from an observation; `+` adds the torques of two, `0.9 * controller` commands a part of it.

    Attributes:
        sample_time: that it is made for [s]; None: any.
    """

    sample_time: Any = None

    def __call__(self, observation: Array) -> float:
        """Torque to hold until the next sample [N m].

        Args:
            observation: (8,) of `ServoTracking`; every sample of the episode in turn, from its reset on.
        """
        raise NotImplementedError

    def __add__(self, other: Controller) -> Controller:
        return _Sum(self, other)

    def __rmul__(self, share: float) -> Controller:
        return _Share(float(share), self)


class _Sum(Controller):
    def __init__(self, *parts: Controller) -> None:
        self.parts = parts
        self.sample_time = next((p.sample_time for p in parts if p.sample_time is not None), None)

    def __call__(self, observation: Array) -> float:
        return sum(part(observation) for part in self.parts)


class _Share(Controller):
    def __init__(self, share: float, whole: Controller) -> None:
        self.share, self.whole, self.sample_time = share, whole, whole.sample_time

    def __call__(self, observation: Array) -> float:
        return self.share * self.whole(observation)
