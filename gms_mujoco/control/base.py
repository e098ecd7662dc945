"""What a controller is: a torque from an observation."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError, is_number

Array = NDArray[np.float64]

POSITION, REFERENCE, VELOCITY, ACCELERATION, AHEAD, ERROR, SPEED, TORQUE = range(8)  # of an observation


def expect_positive(**numbers: float) -> None:
    """Raises ModelError where one of the numbers is not positive."""
    for name, value in numbers.items():
        if not isinstance(value, Real) or not value > 0:
            raise ModelError(f"{name} of a controller must be a positive number; {value!r} given")


class Controller:
    """A torque [N m] from an observation; `+` and `sum` add torques, `0.9 * controller` commands a part of it.

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

    def __add__(self, other: Callable[[Array], float]) -> Controller:
        return _Sum(self, other) if callable(other) else NotImplemented

    def __radd__(self, other: Any) -> Controller:
        """Of a `sum`, which begins with 0."""
        return self if is_number(other) and other == 0 else NotImplemented

    def __mul__(self, share: float) -> Controller:
        return _Share(float(share), self) if is_number(share) else NotImplemented

    __rmul__ = __mul__


class _Sum(Controller):
    def __init__(self, *parts: Callable[[Array], float]) -> None:
        self.parts = parts
        times = (getattr(p, "sample_time", None) for p in parts)
        self.sample_time = next((t for t in times if t is not None), None)

    def __call__(self, observation: Array) -> float:
        return sum(part(observation) for part in self.parts)


class _Share(Controller):
    def __init__(self, share: float, whole: Controller) -> None:
        self.share, self.whole, self.sample_time = share, whole, whole.sample_time

    def __call__(self, observation: Array) -> float:
        return self.share * self.whole(observation)
