"""Friction elements that a fit has put in the wrong places are moved: one becomes two, and two of a kind become one.

Each element goes downhill on its own. Two that break away at the same distance do the same, and to part them changes
nothing in first order; an element where there should be two stands between them. What it would bring to part it is of
second order, and can be computed (split and merge, as for mixtures: Ueda, Nakano, Ghahramani and Hinton, Neural
Computation 12, 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from .effect import Effect
from .least_squares import nudge
from .misfit import Misfit
from .plant import Plant
from .tall import gram, times

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_APART = (1.15, 1.35, 1.6)  # times its break-away distance, and over it, where the halves of an element are tried
_LEAST = 5e-3  # of the level: less is not worth parting
_MOVES = 4
_TRIES = 2  # elements that are parted in turn, best first
_WORTH = 0.02  # of the cost, by which a move is to lower it


def placed(misfit: Misfit, x: Array, fixed: Collection[str] = ()) -> tuple[Misfit, Array]:
    """The same problem near a solution with the elements of `gms` in better places, where there are any.

    Args:
        misfit, x: a problem and its solution.
        fixed: what the problem leaves as it is, see `Misfit`.
    """
    labels = {b.label for b in misfit.coordinates.blocks}
    if not labels >= {"gms.stiffness", "gms.fraction"}:
        return misfit, x
    cost = misfit.cost(x)
    for _ in range(_MOVES):
        for gms, parent in _moves(misfit, x, cost):
            trial, y = _moved(misfit, x, gms, parent, fixed)
            y = nudge(trial, y)
            left = trial.cost(y)
            if left < (1 - _WORTH) * cost:
                misfit, x, cost = trial, y, left
                break
        else:
            break
    return misfit, x


def _moved(misfit: Misfit, x: Array, gms: Effect, parent: Indices, fixed: Collection[str]) -> tuple[Misfit, Array]:
    """The problem with other elements, each in the state of its parent before every record."""
    plant: Plant = misfit.coordinates.decode(x[: misfit.coordinates.size]).replace(gms)
    trial = Misfit(plant, misfit.observations, fixed)
    place = misfit.coordinates.template.memory_places["gms"]
    states = [m.copy() for m in misfit.memories(x, misfit.n_memory)]
    for m in states:
        if len(m):
            m[place] = m[place][parent]
    return trial, trial.vector(plant, states, misfit.skew(x))


def _moves(misfit: Misfit, x: Array, cost: float) -> Iterator[tuple[Effect, Indices]]:
    """Elements of which one has been parted and two others are one, and the parent of each; the best of them first."""
    gms = misfit.coordinates.decode(x[: misfit.coordinates.size])["gms"]
    level, stiffness = np.asarray(gms.fraction), np.asarray(gms.stiffness)
    n, distance = len(level), level / stiffness
    if n < 3:
        return
    order = np.argsort(distance)
    pairs = np.column_stack([order[:-1], order[1:]])
    parted = np.flatnonzero(level > _LEAST)
    joint = level[pairs].sum(1) / stiffness[pairs].sum(1)
    apart = np.array(_APART)[:, None]
    tried = np.concatenate([distance, joint, *(distance[parted] * apart), *(distance[parted] / apart)])
    parent = np.concatenate([np.arange(n), pairs[:, 0], np.tile(parted, 2 * len(_APART))])
    share = np.full(len(tried), 1 / len(tried))
    units = gms.replace(stiffness=share / tried, fraction=share)
    unit = misfit.of_elements(x, units, parent) * len(tried)
    own, one, far, near = np.split(unit, np.cumsum([n, n - 1, len(parted) * len(_APART)]))
    residual, project = _projected(misfit, x)

    merged = level[pairs].sum(1)[:, None] * one - (level[:, None] * own)[pairs].sum(1)
    merged = project(merged.T)
    loss = (merged**2).sum(0) + 2 * residual @ merged
    some = np.tile(parted, len(_APART))
    split = project((0.5 * level[some, None] * (far + near - 2 * own[some])).T)
    push, size = -residual @ split, (split**2).sum(0)
    gain = np.where((push > 0) & (size > 0), push**2 / np.maximum(size, 1e-300), 0.0)
    best = np.argsort(-gain)
    done: set[int] = set()
    for k in best:
        i = int(some[k])
        free = [m for m in np.argsort(loss) if i not in pairs[m]]
        if len(done) == _TRIES or not free or gain[k] - max(loss[free[0]], 0.0) < _WORTH * cost:
            break
        if i in done:
            continue
        done.add(i)
        kept, other = pairs[free[0]]
        by = float(np.repeat(_APART, len(parted))[k])
        share, springs, of = level.copy(), stiffness.copy(), np.arange(n)
        share[kept], springs[kept] = level[[kept, other]].sum(), stiffness[[kept, other]].sum()
        share[[i, other]] = level[i] / 2
        springs[[i, other]] = share[i] / (distance[i] * np.array([by, 1 / by]))
        of[other] = i
        yield gms.replace(fraction=share / share.sum(), stiffness=springs), of


def _projected(misfit: Misfit, x: Array) -> tuple[Array, Callable[[Array], Array]]:
    """The residual (m,) at a solution without what the unknowns can do, and what takes that out of columns (m, k)."""
    residual = misfit.residual(x)
    tangents = misfit.jacobian(x)
    size = np.sqrt((tangents**2).sum(0))
    seen = (size > 0) & ~misfit.held(x, gram(tangents, residual))
    tangents = tangents[:, seen] / size[seen]
    normal = np.linalg.pinv(gram(tangents, tangents), rcond=1e-10, hermitian=True)

    def project(columns: Array) -> Array:
        return np.asarray(columns - times(tangents, normal @ gram(tangents, columns)))

    return project(residual), project
