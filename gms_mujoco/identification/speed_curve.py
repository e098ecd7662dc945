"""Friction as any function of speed: what an effect that changes its level with something else has to beat.

Nobody knows the curve of friction over speed beforehand; Coulomb, Stribeck and viscous friction are its usual shape. On
one sine the load of an inertia, the position and the speed are functions of each other, and friction that "grows with
the load" may be nothing but a curve of another shape. Load, place or time change friction where it differs at the
same speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..plant import Plant
from .frf_observation import Seen
from .inverse import Observation

Array = NDArray[np.float64]

_KNOTS = 15  # of the curve; with half as many the bends of a load on a sine stand out from it
_LEVELS = ("coulomb", "stribeck", "dahl", "lugre", "gms")


def curve(plant: Plant, observations: Sequence[Seen]) -> Array:
    """(m, k) torques of friction whose level is a hat function of speed: together, any curve with so many knots.

    Args:
        plant: whose friction is given another level.
        observations: with m band-limited values in all; of frequency responses, which have no speed of their own, the
            rows are zero.
    """
    friction = Plant(plant.inertia, tuple(e for e in plant.effects if e.name in _LEVELS), kind=plant.kind)
    none = Plant(plant.inertia, kind=plant.kind)
    speeds, torques = [], []
    for o in observations:
        if isinstance(o, Observation):
            seen = o.seen_by(plant)
            speeds.append(np.abs(seen.velocity[o.index]))
            torques.append(seen.replay(friction) - seen.replay(none))
        else:
            speeds.append(np.zeros(len(o.index)))
            torques.append(np.zeros(len(o.index)))
    speed, torque = np.concatenate(speeds), np.concatenate(torques)
    knots = np.unique(np.quantile(speed, np.linspace(0, 1, _KNOTS)))
    return np.stack([np.interp(speed, knots, one) for one in np.eye(len(knots))], 1) * torque[:, None]
