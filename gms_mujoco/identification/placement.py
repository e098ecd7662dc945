"""Friction elements that a fit has put in the wrong places are moved: all of them anew, or one becomes two, and two of
a kind become one.

Each element goes downhill on its own, and what it does when it slips stands between it and a better place. Yet the
force of an element of given break-away distance is in proportion to its share of the level, whatever the curve of
friction: on a grid of distances non-negative least squares finds the shares that are best beside all else as it is.

Two elements that break away at the same distance do the same, and to part them changes nothing in first order; an
element where there should be two stands between them. What it would bring to part it is of second order, and can be
computed (split and merge, as for mixtures: Ueda, Nakano, Ghahramani and Hinton, Neural Computation 12, 2000).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..plant import Plant
from .inverse import Observation
from .least_squares import nudge
from .misfit import Misfit
from .starts import break_away_distances, gathered, is_softest, longest_break_away
from .tall import gram, times

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_APART = (1.15, 1.35, 1.6)  # times its break-away distance, and over it, where the halves of an element are tried
_LEAST = 5e-3  # of the level: less is not worth parting
_MOVES = 4
_TRIES = 2  # elements that are parted in turn, best first
_WORTH = 0.02  # of the cost, by which a move is to lower it
_SPACING = 0.1  # of a grid of break-away distances: each is so much further than the one before
_FINER = 5  # times finer it is made around those that are found to be of use
_BEYOND = 2.0  # times nearer than the nearest element, and further than the furthest, it goes
_LATER = 10.0  # times the usual limit, that an element slips later which would
_AT_ONCE = 64  # elements that one law has
_PATIENCE = 100  # changes of what is of use, for each distance


def placed(misfit: Misfit, x: Array, fixed: Collection[str] = ()) -> tuple[Misfit, Array]:
    """The same problem near a solution with the elements of `gms` in better places, where there are any.

    Args:
        misfit, x: a problem and its solution.
        fixed: what the problem leaves as it is, see `Misfit`.
    """
    if not _movable(misfit):
        return misfit, x
    for _ in range(_MOVES):
        better = _first_better(misfit, x, _moves(misfit, x), fixed)
        if better is None:
            break
        misfit, x = better
    return misfit, x


def placed_later(misfit: Misfit, x: Array, fixed: Collection[str] = ()) -> tuple[Misfit, Array] | None:
    """`placed_anew` with elements that slip later than they usually may, where one would; None where none would.

    A stiff contact with most of the level says nothing of how late a soft one beside it slips. One that would stand for
    a spring, or for what another effect does, does not leave much less: see to that.
    """
    if not may_be_anew(misfit) or not is_softest(misfit.plant(x)["gms"], misfit.observations):
        return None
    return placed_anew(misfit, x, fixed, later=_LATER)


def placed_anew(
    misfit: Misfit, x: Array, fixed: Collection[str] = (), most: int | None = None, later: float = 1.0
) -> tuple[Misfit, Array] | None:
    """The same problem near a solution with all elements of `gms` placed anew; None where that leaves no less.

    Arguments as for `placed`, whose moves come first: few elements that are placed beside much that is wrong yet may go
    further astray. With `most` there are more of them, at most so many: a contact that gives way bit by bit asks for
    many, and those that are parted one by one stand in each other's way. They may slip so many times `later` than
    elements usually may.
    """
    return _first_better(misfit, x, _anew(misfit, x, most, later), fixed) if may_be_anew(misfit) else None


def may_be_anew(misfit: Misfit) -> bool:
    """Whether elements can be placed anew. Responses are not asked: few of their points tell one distance from the
    next."""
    return _movable(misfit) and all(isinstance(o, Observation) for o in misfit.observations)


def _first_better(
    misfit: Misfit, x: Array, moves: Iterable[tuple[Effect, Indices]], fixed: Collection[str]
) -> tuple[Misfit, Array] | None:
    """The problem after the first of some moves that is worth it; None where none is.

    Args:
        misfit, x: the problem before, and its solution.
        moves: the law with other elements, and the parent of each.
        fixed: what the problem leaves as it is, see `Misfit`.
    """
    enough = (1 - _WORTH) * misfit.cost(x)
    for gms, parent in moves:
        trial, y = _moved(misfit, x, gms, parent, fixed)
        y = nudge(trial, y)
        if trial.cost(y) < enough:
            return trial, y
    return None


def parted(misfit: Misfit, x: Array, worth: float) -> tuple[Misfit, Array] | None:
    """The same problem with one element of `gms` more, where that brings most; None where that is less than `worth`.

    Args:
        misfit, x: a problem and its solution.
        worth: of the cost, in second order, that one element more has to bring.
    """
    if not _movable(misfit):
        return None
    law = _Elements(misfit, x)
    if not len(law.apart) or law.gain.max() < worth:
        return None
    k = int(np.argmax(law.gain))
    i, n = law.of[k], len(law.level)
    share, springs = np.append(law.level, 0.0), np.append(law.stiffness, 0.0)
    share[[n, i]], springs[[n, i]] = law.halves(k)
    gms = _with_elements(law.gms, share, springs)
    return _moved(misfit, x, gms, np.append(np.arange(n), i), ())


def _movable(misfit: Misfit) -> bool:
    return {b.label for b in misfit.coordinates.blocks} >= {"gms.stiffness", "gms.fraction"}


def _with_elements(gms: Effect, share: Array, stiffness: Array) -> Effect:
    """The same law with other elements, in any number."""
    kept = {p.name: gms.values[p.name] for p in gms.parameters if not p.per_element}
    return type(gms)(len(share), fraction=share / share.sum(), stiffness=stiffness, **kept)


def _moved(misfit: Misfit, x: Array, gms: Effect, parent: Indices, fixed: Collection[str]) -> tuple[Misfit, Array]:
    """The problem with other elements, each in the state of its parent before every record."""
    plant: Plant = misfit.plant(x).replace(gms)
    trial = Misfit(plant, misfit.observations, fixed)
    place = misfit.coordinates.template.memory_places["gms"]
    states = [
        np.concatenate([m[: place.start], m[place][parent], m[place.stop :]]) if len(m) else m
        for m in misfit.memories(x, misfit.n_memory)
    ]
    return trial, trial.vector(plant, states, misfit.skew(x))


class _Elements:
    """What every element of `gms` would bring if it were parted, in second order.

    Attributes:
        gms, level, stiffness, distance: the law at a solution, and the break-away distances of its elements.
        of, apart: (k,) the element, and by what its halves would stand apart.
        gain: (k,) of the cost.
        pairs: (n - 1, 2) elements that break away one after the other.
        loss: (n - 1,) of the cost, if they were one.
    """

    def __init__(self, misfit: Misfit, x: Array) -> None:
        self.gms = misfit.plant(x)["gms"]
        self.level, self.stiffness = np.asarray(self.gms.fraction), np.asarray(self.gms.stiffness)
        level, n = self.level, len(self.level)
        self.distance = level / self.stiffness
        order = np.argsort(self.distance)
        self.pairs = pairs = np.column_stack([order[:-1], order[1:]])
        some = np.flatnonzero(level > _LEAST)
        self.of, self.apart = np.tile(some, len(_APART)), np.repeat(_APART, len(some))
        if all(isinstance(o, Observation) for o in misfit.observations):  # responses say which amplitudes slip
            # The softer half of one that is as soft as a fit lets it be would be a spring, half by half.
            slips = self.distance[self.of] * self.apart <= longest_break_away(self.distance, level, misfit.observations)
            self.of, self.apart = self.of[slips], self.apart[slips]
        joint = level[pairs].sum(1) / self.stiffness[pairs].sum(1)
        there = self.distance[self.of]
        tried = np.concatenate([self.distance, joint, there * self.apart, there / self.apart])
        parent = np.concatenate([np.arange(n), pairs[:, 0], self.of, self.of])
        share = np.full(len(tried), 1 / len(tried))
        units = _with_elements(self.gms, share, share / tried)
        unit = misfit.of_elements(x, units, parent) * len(tried)
        own, one, far, near = np.split(unit, np.cumsum([n, n - 1, len(self.of)]))
        residual, project = _projected(misfit, x)
        merged = project((level[pairs].sum(1)[:, None] * one - (level[:, None] * own)[pairs].sum(1)).T)
        self.loss = (merged**2).sum(0) + 2 * residual @ merged
        split = project((0.5 * level[self.of, None] * (far + near - 2 * own[self.of])).T)
        push, size = -residual @ split, (split**2).sum(0)
        self.gain = np.where((push > 0) & (size > 0), push**2 / np.maximum(size, 1e-300), 0.0)

    def halves(self, k: int) -> tuple[float, Array]:
        """The level of each half of an element, and their stiffnesses (2,), the softer first."""
        i, by = self.of[k], self.apart[k]
        half = float(self.level[i]) / 2
        return half, half / (self.distance[i] * np.array([by, 1 / by]))


class _Shares:
    """The shares of the level that elements of any break-away distance would have beside all else at a solution.

    Attributes:
        gms, share, distance: the law at the solution, of which distances are for a level of 1.
        some: (n,) whether an element has enough of the level to count.
    """

    def __init__(self, misfit: Misfit, x: Array) -> None:
        self.misfit, self.x, self.gms = misfit, x, misfit.plant(x)["gms"]
        self.share = np.asarray(self.gms.fraction)
        self.distance, self.some = self.share / np.asarray(self.gms.stiffness), self.share > _LEAST
        residual, self._project = _projected(misfit, x, lambda label: not label.startswith("gms."))
        self._target = self._forces(self.distance, np.arange(len(self.share))) @ self.share - residual

    def nearest(self, distances: Array) -> Indices:
        """(k,) the elements that break away most nearly there."""
        away = np.abs(np.log(distances[:, None] / self.distance[self.some]))
        return np.flatnonzero(self.some)[np.argmin(away, 1)]

    def on(self, distances: Array) -> tuple[Array, float]:
        """(k,) the best shares of elements at these distances, and the squared residual that is left."""
        columns = self._forces(distances, self.nearest(distances))
        size = np.maximum(np.sqrt((columns**2).sum(0)), 1e-300)
        triangle = np.asarray(np.linalg.qr(np.column_stack([columns / size, self._target]), mode="r"))
        shares, left = scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1], maxiter=_PATIENCE * len(distances))
        return shares / size, left**2

    def grid(self, later: float) -> Array:
        """(k,) distances around those of the elements that slip in some record; none where none does."""
        seen, level = self.misfit.observations, self.share.sum() * float(np.asarray(self.gms.coulomb))
        slips = self.some & (level * self.distance <= break_away_distances(seen).max())
        if not slips.any():
            return np.empty(0)
        longest = longest_break_away(level * self.distance, level * self.share, seen) / level
        near, far = self.distance[slips].min() / _BEYOND, self.distance[slips].max()
        far = max(far, min(_BEYOND * later * far, later * longest))
        return np.exp(np.arange(np.log(near), np.log(far) + _SPACING, _SPACING))

    def _forces(self, distances: Array, parent: Indices) -> Array:
        """(m, k) what elements do that have all of the level."""
        out = []
        for part in np.array_split(np.arange(len(distances)), math.ceil(len(distances) / _AT_ONCE)):
            even = np.full(len(part), 1 / len(part))
            law = _with_elements(self.gms, even, even / distances[part])
            out.append(self.misfit.of_elements(self.x, law, parent[part]) * len(part))
        return self._project(np.concatenate(out).T)


def _anew(misfit: Misfit, x: Array, most: int | None, later: float) -> Iterator[tuple[Effect, Indices]]:
    """Elements where the best shares on a grid of distances are, as many as there are, or more and at `most` so many,
    and the nearest of the present ones for each; nothing where that promises no less."""
    elements = _Shares(misfit, x)
    grid = elements.grid(later)
    if not len(grid):
        return
    shares, _ = elements.on(grid)
    beside = np.arange(-_FINER, _FINER + 1) * _SPACING / _FINER
    finer = np.exp(np.unique(np.add.outer(np.log(grid[shares > 0]), beside).round(6)))
    if not len(finer):
        return
    shares, left = elements.on(finer)
    if not shares.any() or left > (1 - _WORTH) * misfit.cost(x):
        return
    count, peaks = len(elements.share), int(np.count_nonzero(np.diff(np.append(0, shares > 0)) > 0))
    if most and peaks <= count:
        return
    springs, shares, _ = gathered(finer, shares, min(most, peaks) if most else count)
    yield _with_elements(elements.gms, shares, springs), elements.nearest(shares / springs)


def _moves(misfit: Misfit, x: Array) -> Iterator[tuple[Effect, Indices]]:
    """Elements of which one has been parted and two others are one, and the parent of each; the best of them first."""
    law, cost = _Elements(misfit, x), misfit.cost(x)
    n = len(law.level)
    done: set[int] = set()
    for k in np.argsort(-law.gain):
        i = int(law.of[k])
        free = [m for m in np.argsort(law.loss) if i not in law.pairs[m]]
        if len(done) == _TRIES or law.gain[k] < _WORTH * cost:
            break
        if i in done or not free or law.gain[k] - max(law.loss[free[0]], 0.0) < _WORTH * cost:
            continue
        done.add(i)
        both = law.pairs[free[0]]
        kept, other = both
        share, springs, parent = law.level.copy(), law.stiffness.copy(), np.arange(n)
        share[kept], springs[kept] = law.level[both].sum(), law.stiffness[both].sum()
        share[[i, other]], springs[[i, other]] = law.halves(k)
        parent[other] = i
        yield _with_elements(law.gms, share, springs), parent


def _projected(
    misfit: Misfit, x: Array, counts: Callable[[str], bool] | None = None
) -> tuple[Array, Callable[[Array], Array]]:
    """The residual (m,) at a solution without what the unknowns can do, and what takes that out of columns (m, k).

    Args:
        misfit, x: the problem and its solution.
        counts: by its label, whether a parameter is among the unknowns that count; None: all do, and all memory.
    """
    residual = misfit.residual(x)
    tangents = misfit.jacobian(x)
    size = np.sqrt((tangents**2).sum(0))
    seen = (size > 0) & ~misfit.held(x, gram(tangents, residual))
    if counts is not None:
        labels = misfit.coordinates.labels
        seen &= np.append([counts(label) for label in labels], np.zeros(len(seen) - len(labels), bool))
    tangents = tangents[:, seen] / size[seen]
    normal = np.linalg.pinv(gram(tangents, tangents), rcond=1e-10, hermitian=True)

    def project(columns: Array) -> Array:
        return np.asarray(columns - times(tangents, normal @ gram(tangents, columns)))

    return project(residual), project
