"""The state of the effects before the first sample of a record: nobody measured where their elements stood.

An element forgets its state when it first slips, so the squared residual has flat parts and steps where a gradient is
blind; a coarse search per element is not. The opening of a record is enough for it, up to where all have slipped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..plant import Plant
from .frf_observation import Seen
from .inverse import Observation
from .tall import squared

Array = NDArray[np.float64]

_OPENING = 2.0  # s of a record, at least
_LEVELS = (-1.0, 0.0, 1.0, -0.5, 0.5)


def search_state(observation: Seen, plant: Plant, skew: float, memory: Array) -> None:
    """Puts better states into `memory` (n_memory,), one after the other.

    Args:
        observation: a record.
        plant: whose effects have the states.
        skew: by which the clock of the torque runs ahead of that of the position [s].
        memory: where to begin.
    """
    o = _opening(observation, plant)
    applied = o.applied(plant, skew)
    found = _search_apart(o, plant, applied, memory) if isinstance(o, Observation) else []
    others = [k for k in range(len(memory)) if k not in found]
    if not others:
        return
    grid = o.sparse
    best = squared(applied - o.needed(plant, memory, grid))
    for value in (*_LEVELS, *_LEVELS):
        for k in others:
            kept, memory[k] = memory[k], value
            cost = squared(applied - o.needed(plant, memory, grid))
            if cost < best:
                best = cost
            else:
                memory[k] = kept


def _opening(observation: Seen, plant: Plant) -> Seen:
    """The beginning of a record, twice as long again and again until the motion has been far enough for each element to
    have slipped, whichever way it was bent: of a sine that grows that may be late."""
    duration = _OPENING
    if isinstance(observation, Observation) and "gms" in plant:
        gms, record = plant["gms"], observation.record
        level = max(float(np.asarray(gms.static)), float(np.asarray(gms.coulomb)))
        furthest = 2 * level * np.max(np.asarray(gms.fraction) / np.maximum(gms.stiffness, 1e-300))
        whole = len(record) * record.sample_time
        while duration < whole and np.ptp(observation.position[: round(duration / record.sample_time)]) < furthest:
            duration *= 2
    return observation.opening(duration)


def _search_apart(o: Observation, plant: Plant, applied: Array, memory: Array) -> list[int]:
    """The same for the separable effects, of which what an element does at each level does not depend on the others.

    Returns:
        Which states those are.
    """
    places = {name: place for name, place in plant.memory_places.items() if plant[name].separable}
    apart = [k for place in places.values() for k in range(place.start, place.stop)]
    if not apart:
        return []
    torques, known = _at_levels(o, plant, list(places), memory)
    left = applied - known
    best = squared(left)
    now = torques[-1].copy()
    for level in (*range(len(_LEVELS)), *range(len(_LEVELS))):
        for k in apart:
            trial = left + (torques[level][k] - now[k])
            cost = squared(trial)
            if cost < best:
                best, left, now[k], memory[k] = cost, trial, torques[level][k], _LEVELS[level]
    return apart


def _at_levels(o: Observation, plant: Plant, names: Sequence[str], memory: Array) -> tuple[Array, Array]:
    """Torque of each element of separable effects, those of `names`, on the instants that `memory` needs.

    Returns:
        (levels + 1, n_memory, m) for each of _LEVELS before the record, then for `memory`; and the (m,) torque that the
        plant needs for `memory`.
    """
    grid = o.grid(plant, memory)
    out = np.empty((len(_LEVELS) + 1, len(memory), len(o.index)))
    for name in names:
        part, place = plant.part(name), plant.memory_places[name]
        native = [e.name for e in part.effects if e.is_native]
        own = part.memory_places[name]
        before = np.zeros(part.joint().n_memory)
        for i, row in enumerate(out):
            before[own] = _LEVELS[i] if i < len(_LEVELS) else memory[place]
            row[place] = o.elements(part, part.joint(), native.index(name), before, grid)
    return out, o.needed(plant, memory, grid)
