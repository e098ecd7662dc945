"""Friction as it stands in a MuJoCo model that the engine runs."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .shared_library import DECLARATIONS, library

Array = NDArray[np.float64]


class Reading(NamedTuple):
    """Where a joint's friction stands in `plugin_state`.

    Attributes:
        torque: place of the torque.
        states: (effect, begin, end) of each effect with state.
        load: place of the load; None where its friction does not depend on it.
    """

    torque: int
    states: list[tuple[str, int, int]]
    load: int | None


def reading(model: int, data: int, joint: int) -> Reading | None:
    """Where a joint's friction stands in `plugin_state` of a MuJoCo model; None for a joint without friction.

    Args:
        model, data: addresses of the mjModel and the mjData.
        joint: id of a hinge or slide joint.
    """
    torque, load, begin, end = ctypes.c_int(), ctypes.c_int(), ctypes.c_int(), ctypes.c_int()
    found: list[tuple[str, int, int]] = []
    i = 0
    places = tuple(map(ctypes.byref, (torque, load, begin, end)))
    while name := library.gms_engine_read(model, data, joint, i, *places):
        if end.value > begin.value:
            found.append((name.decode(), begin.value, end.value))
        i += 1
    return None if torque.value < 0 else Reading(torque.value, found, load.value if load.value >= 0 else None)


@dataclass(frozen=True)
class Attached:
    """Friction of a joint as it stands in a MuJoCo model.

    Attributes:
        effects: (name, number of elements, packed parameters) of each.
        stiffness: time step times slope over inertia; negative where an explicit step is asked for, infinite where an
            implicit one is.
        limit: of the stiffness for an explicit step.
    """

    effects: list[tuple[str, int, Array]]
    stiffness: float
    limit: float


def attached(model: int, data: int, joint: int) -> Attached | None:
    """The friction of a joint of a MuJoCo model, given by addresses as for `reading`; None where it has none."""
    effect, n, stiffness, limit = ctypes.c_int(), ctypes.c_int(), ctypes.c_double(), ctypes.c_double()
    found: list[tuple[str, int, Array]] = []
    out = [ctypes.byref(x) for x in (effect, n, stiffness, limit)]
    while address := library.gms_engine_effect(model, data, joint, len(found), *out):
        declared = DECLARATIONS[effect.value]
        size = sum(n.value if p.per_element else 1 for p in declared.parameters)
        found.append((declared.name, n.value, np.array((ctypes.c_double * size).from_address(address))))
    return Attached(found, stiffness.value, limit.value) if found else None
