"""The views of a servo's position error: over position, velocity, the error that its loop sees, time, frequency ..."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..identification.motion import Swings
from .compare_servo import REGIMES
from .residual_maps import Regime, ResidualMap
from .residuals import Residuals

if TYPE_CHECKING:
    from ..plant import Plant
    from .compare_servo import ServoComparison

Array = NDArray[np.float64]

_SMALLEST = 0.01  # of the span: a smaller swing may be noise


class ServoResiduals(Residuals):
    """The position errors of runs of a servo under one plant, and their views."""

    def __init__(self, plant: Plant, records: Sequence[ServoComparison]) -> None:
        super().__init__(plant, records)  # type: ignore[arg-type]  # what differs is asked for below
        self.runs = list(records)
        self.unit = self.angle

    @cached_property
    def _swings(self) -> list[Swings]:
        return [Swings.between(r.time, r.position, _SMALLEST * float(np.ptp(r.position))) for r in self.runs]

    def regimes(self) -> tuple[Regime, ...]:
        """Mean absolute error at rest, moving and without power [rad]; what the runs do not enter is left out."""
        where = np.concatenate([r.regime for r in self.runs])
        return self._by_regime(REGIMES, where, lambda x: float(np.mean(np.abs(x))))

    def after_reversal(self) -> None:
        """None: no torque was measured."""

    def _quantities(self) -> list[tuple[str, str, str, bool]]:
        return [
            ("position", "position", "rad", False),
            ("velocity", "velocity", "rad/s", False),
            ("acceleration", "acceleration", "rad/s^2", False),
            ("following_error", "goal less position", "rad", False),
            ("goal_rate", "rate of the goal", "rad/s", False),
            ("since_reversal", "distance since the reversal", "rad", True),
            ("time_since_reversal", "time since the reversal", "s", True),
        ]

    def _quantity(self, name: str, k: int) -> Array | None:
        r = self.runs[k]
        if name == "position":
            return r.position
        if name == "velocity":
            return r.velocity
        if name == "acceleration":
            return r.observation.acceleration
        if name == "following_error":
            return r.goal - r.position
        if name == "goal_rate":
            return np.gradient(r.goal, r.time)
        return self._swings[k].distance if name == "since_reversal" else self._swings[k].time

    def _excitation(self, k: int) -> Array:
        return self.runs[k].goal

    def _input_correlation(self) -> ResidualMap | None:
        """None: there is no torque to correlate with."""
        return None
