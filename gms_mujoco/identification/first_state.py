"""The state of the effects before the first sample of a record: nobody measured where their elements stood.

An element forgets its state when it first slips, so the squared residual has flat parts and steps where a gradient is
blind; a coarse search per element is not. From there on a gradient sees how they trade with each other. The opening of
a record is enough for it, up to where all have slipped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..plant import Plant
from .frf_observation import Seen
from .grid import Grid
from .inverse import Observation
from .tall import gram, squared

Array = NDArray[np.float64]

_OPENING = 2.0  # s of a record, at least
_SURELY = 3.0  # break-away distances, after which an element has slipped, whatever it began with and modulates it
_LEVELS = (-1.0, 0.0, 1.0, -0.5, 0.5)
_STEPS = 16  # of Gauss and Newton
_FAR, _NEAR = 0.5, 0.02  # the longest of them, and one from which on no shorter one is tried
_APART = 0.01  # of a level, over which derivatives are taken
_TRAPPED = 0.5  # of what levels of one element after the other leave, that others leave where these are wrong
_WAYS = 12  # lengths that are tried of a way before the record
_ROUNDING = 1e-9
_FALLS = 0.01  # of what is left: a step by which less is gained is the last


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
        record, furthest = observation.record, _furthest(plant["gms"])
        whole = len(record) * record.sample_time
        while duration < whole and np.ptp(observation.position[: round(duration / record.sample_time)]) < furthest:
            duration *= 2
    return observation.opening(duration)


def _search_apart(o: Observation, plant: Plant, applied: Array, memory: Array) -> list[int]:
    """The same for the separable effects, of which what an element does at each level does not depend on the others.

    Returns:
        Which states those are.
    """
    names = [name for name in plant.memory_places if plant[name].separable]
    apart = [k for name in names for k in range(plant.memory_places[name].start, plant.memory_places[name].stop)]
    if not apart:
        return []
    grid = o.grid(plant, memory)

    def elements(states: Array) -> Array:
        there = memory.copy()
        there[apart] = states
        return _elements(o, plant, names, there, grid)[apart]

    levels = np.array([*(np.full(len(apart), level) for level in _LEVELS), memory[apart]])
    torques = np.array([elements(states) for states in levels])
    rest = applied - o.needed(plant, memory, grid) - torques[-1].sum(0)
    least, at = _one_by_one(torques, rest)
    memory[apart] = levels[at, np.arange(len(apart))]
    # Others have to leave much less: else they would hide a part of what is missing in a plant that is wrong yet.
    left = rest + torques[at, np.arange(len(apart))].sum(0)
    if names == ["gms"] and squared(left[_forgotten(o, plant)]) < _TRAPPED * least:
        cost, states = _descended(elements, _loaded(plant["gms"], torques[: len(_LEVELS)], rest), rest)
        if cost < _TRAPPED * least:
            memory[apart] = states
    return apart


def _forgotten(o: Observation, plant: Plant) -> NDArray[np.bool_]:
    """(m,) whether the motion has been so far by then that every element has slipped, whatever it began with."""
    way = np.maximum.accumulate(o.position) - np.minimum.accumulate(o.position)
    return np.asarray(way[o.index] > _furthest(plant["gms"]))


def _furthest(gms: Effect) -> float:
    """The way after which every element has slipped, whatever it began with [rad]."""
    return _SURELY * float(_break_away(gms).max())


def _break_away(gms: Effect) -> Array:
    """(n,) distance over which each element is bent from nothing to its level at rest [rad]."""
    level = max(float(np.asarray(gms.static)), float(np.asarray(gms.coulomb)))
    return level * np.asarray(gms.fraction) / np.maximum(gms.stiffness, 1e-300)


def _one_by_one(torques: Array, rest: Array) -> tuple[float, NDArray[np.intp]]:
    """The squared torque that is left, and (n,) at which of the levels each element begins then, one changed after the
    other, from the last level on.

    Args:
        torques: (levels, n, m) of each element.
        rest: (m,) torque that they balance.
    """
    count, n, _ = torques.shape
    at, left = np.full(n, count - 1), rest + torques[-1].sum(0)
    best = squared(left)
    for level in (*range(count - 1), *range(count - 1)):
        for k in range(n):
            trial = left + (torques[level][k] - torques[at[k]][k])
            if (cost := squared(trial)) < best:
                best, left, at[k] = cost, trial, level
    return best, at


def _loaded(gms: Effect, torques: Array, rest: Array) -> Array:
    """(n,) states as after a way from where the joint has never moved, and another back, of those that leave least as
    far as levels between those of `torques` (levels, n, m) tell; arguments as for `_one_by_one`."""
    distance = _break_away(gms)
    bends = distance[(distance > 0) & (np.asarray(gms.stiffness) > 0)]
    if not len(bends):
        return np.zeros(len(distance))
    distance = np.maximum(distance, _ROUNDING * bends.min())
    way = np.geomspace(bends.min() / 4, 2 * bends.max(), _WAYS)
    there, back = np.meshgrid(np.concatenate([-way, [0], way]), np.append(0, way))
    bent = np.clip(there.reshape(-1, 1) / distance, -1, 1)
    states = np.clip(bent - np.sign(there.reshape(-1, 1)) * back.reshape(-1, 1) / distance, -1, 1)
    order = np.argsort(_LEVELS)
    at = np.interp(states, np.asarray(_LEVELS)[order], np.arange(len(order)))
    weight = np.maximum(1 - np.abs(at[:, None] - np.argsort(order)[:, None]), 0).reshape(len(states), -1)
    flat = torques.reshape(-1, torques.shape[-1])
    return states[np.argmin(weight @ (2 * flat @ rest) + ((weight @ gram(flat.T, flat.T)) * weight).sum(1))]


def _descended(elements: Callable[[Array], Array], states: Array, rest: Array) -> tuple[float, Array]:
    """(n,) states from which steps of Gauss and Newton, no longer than they hold, lead to nothing better; before them
    the squared torque that is left.

    Args:
        elements: (n, m) torque of each element from such states on.
        states, rest: where to begin, and the (m,) torque that the elements balance.
    """
    torques = elements(states)
    left = rest + torques.sum(0)
    best, radius, slopes = squared(left), _FAR, None
    for _ in range(_STEPS):
        if slopes is None:
            inward = np.where(states > 0, -_APART, _APART)
            slopes = ((elements(states + inward) - torques) / inward[:, None]).T
        near = [np.clip(states + way, -1, 1) - states for way in (-radius, radius)]
        step = scipy.optimize.lsq_linear(slopes, -left, (near[0] - _ROUNDING, near[1] + _ROUNDING)).x.clip(*near)
        there = elements(states + step)
        after = rest + there.sum(0)
        falls = 1 - squared(after) / max(best, 1e-300)
        if falls > 0:
            states, torques, left, best, slopes = states + step, there, after, squared(after), None
        if falls <= _FALLS:
            if falls > 0 or radius < _NEAR:
                break
            radius /= 4
    return best, states


def _elements(o: Observation, plant: Plant, names: Sequence[str], memory: Array, grid: Grid | None) -> Array:
    """(n_memory, m) torque of each element of separable effects, those of `names`, on instants of `grid`; else 0."""
    out = np.zeros((len(memory), len(o.index)))
    for name in names:
        part, place = plant.part(name), plant.memory_places[name]
        before = np.zeros(part.joint().n_memory)
        before[part.memory_places[name]] = memory[place]
        out[place] = o.elements(part, part.joint(), part.number_in_joint(name), before, grid)
    return out
