"""Typical sizes in data, from which typical sizes of parameters follow by their unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..parameter import DECELERATION, KELVIN, WAVES
from ..plant import Plant
from .frf_observation import Seen
from .inverse import Observation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scales:
    """Root mean squares over a set of observations; `scales[unit]` is a typical size of a parameter."""

    torque: float
    position: float
    velocity: float
    acceleration: float
    sample_time: float
    load: float  # that was logged, else the torque
    temperature: float  # by which it differs, over all of them; 0 where one does not know it
    inertia: float | None = None  # of the axis, where it is known

    @classmethod
    def of(cls, observations: Sequence[Seen], plant: Plant | None = None) -> Scales:
        def pooled(values: list[Array]) -> float:
            return float(np.sqrt(np.mean([np.mean(v**2) for v in values]))) or 1.0

        none = Plant.axis(1.0)
        torque = [o.applied(none) if o.typical_torque is None else o.typical_torque for o in observations]
        return cls(
            pooled(torque),
            pooled([o.position - o.position.mean() for o in observations]),
            pooled([o.velocity for o in observations]),
            pooled([o.acceleration for o in observations]),
            float(np.mean([o.sample_time for o in observations])),
            pooled(_loads(observations) or torque),
            _spread_of_temperature(observations),
            plant.inertia if plant else None,
        )

    def __getitem__(self, unit: str) -> float:
        t, v = self.torque, self.velocity
        return {
            "N m": t,
            "N m/rad": t / self.position,
            "N m s/rad": t / v,
            "N m s^2/rad^2": t / v**2,
            "N m/s": t * v / self.position,
            "1/(N m)": 1 / self.load,
            "kg m^2": t / self.acceleration,
            "rad": 1.0,
            WAVES: 1 / self.position,  # on a slide joint: a radian of phase over the travel
            "rad/s": v,
            DECELERATION: self.acceleration if self.inertia is None else t / self.inertia,
            "s": self.sample_time,
            KELVIN: self.temperature,
        }.get(unit, 1.0)


def _loads(observations: Sequence[Seen]) -> list[Array]:
    logged = [o.record.get("load") for o in observations if isinstance(o, Observation)]
    return [x for x in logged if x is not None]


def _spread_of_temperature(observations: Sequence[Seen]) -> float:
    measured = [o.temperature for o in observations]
    known = [t for t in measured if t is not None]
    return float(np.std(np.concatenate(known))) if len(known) == len(measured) else 0.0
