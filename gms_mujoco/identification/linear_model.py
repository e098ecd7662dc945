"""A least-squares problem near its solution, and what a fit predicts of blocks of time that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from .folds import folds
from .frf_observation import Seen
from .held_out import BLOCK, HeldOut, block_of_row
from .intervals import block_starts, block_sums
from .misfit import Misfit
from .servo_observation import ServoObservation
from .tall import gram, times

Array = NDArray[np.float64]

FOLDS = 5
_LEAST_PRIOR = 1e-6  # of the largest tangent: with less a sum of squares is not positive definite to rounding
_BLOWN_UP = 10.0  # times its squared residual in the fit: a block that is left out and holds two thirds of an unknown


class LinearModel:
    """A least-squares problem near its solution: residual + tangents * move, with a prior on the move.

    What the motion does not determine is left out.

    Args:
        misfit, vector, residual: the problem, its solution and the residual (m,) there.
    """

    def __init__(self, misfit: Misfit, vector: Array, residual: Array) -> None:
        self.observations = misfit.observations
        self.determined = determined(misfit)
        tangents = misfit.jacobian(vector) * self.determined[:, None]
        self.residual = residual = residual * self.determined
        reach = misfit.reach(vector)
        held = misfit.held(vector, gram(tangents, residual))
        self.columns = np.flatnonzero(~held & ((tangents**2).sum(0) > 0))
        self.reach = reach[self.columns]
        self.tangents = tangents[:, self.columns] * self.reach
        # In units of its reach a move is a standard normal; the residual's size is its noise.
        own = gram(self.tangents, self.tangents)
        least = _LEAST_PRIOR * math.sqrt(max(np.diag(own).max(initial=0.0), 1e-280))  # of what no residual is left of
        self.prior = max(math.sqrt(float(residual @ residual) / max(int(self.determined.sum()), 1)), least)
        self._normal = scipy.linalg.cho_factor(own + self.prior**2 * np.eye(len(own)))
        self.target = self.without(residual[:, None])[:, 0]

    def without(self, columns: Array) -> Array:
        """(m + p, k) columns (m, k), and a row for the prior of each unknown, without what the unknowns can do."""
        move = scipy.linalg.cho_solve(self._normal, gram(self.tangents, columns))
        return np.vstack([columns - times(self.tangents, move), -self.prior * move])

    def held_out(self, columns: Array | None = None) -> Array:
        """(m,) residual of each block of time, predicted by a refit without the blocks of its fold.

        Args:
            columns: (m, k) tangents of what is added.
        """
        added = np.empty((len(self.residual), 0)) if columns is None else columns
        # Everything that a refit needs to know of a block is its share of the normal equations.
        both = np.column_stack([self.tangents, self._scaled(added), self.residual])
        owner = block_of_row(self.observations)
        out = self.residual.copy()
        for blocks, move in self._folds(_block_grams(self.observations, both), _folds(self.observations)):
            rows = np.isin(owner, blocks)
            out[rows] += both[rows, :-1] @ move
        return out

    def _scaled(self, columns: Array) -> Array:
        return columns / np.sqrt(np.mean(columns**2, 0)).clip(1e-300)

    def _folds(self, grams: Array, fold: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Blocks of each fold, and the move (p,) that fits the others best."""
        own, p = self.tangents.shape[1], grams.shape[1] - 1
        ridge = np.diag(np.append(np.full(own, self.prior**2), np.full(p - own, 1e-9 * len(self.residual))))
        total = grams.sum(0)
        for k in np.unique(fold):
            blocks = np.flatnonzero(fold == k)
            rest = total - grams[blocks].sum(0)
            yield blocks, -np.linalg.solve(rest[:p, :p] + ridge, rest[:p, p])


def determined(misfit: Misfit) -> NDArray[np.bool_]:
    """(m,) where the motion says what friction does, see `Observation.determined`; all where it never does."""
    found = np.concatenate([o.determined for o in misfit.observations])
    return found if found.any() else ~found


def cross_validated(misfit: Misfit, vector: Array) -> HeldOut:
    """What is left of each block of time by a refit without the blocks of its fold.

    The refit is one step of least squares from the solution, as far as it really helps the blocks it may see. The
    squares of a block count for at most ten times those that the fit leaves of it. All are divided by the share of the
    command that the drive delivers, see `Misfit.delivered`.

    Args:
        misfit, vector: a problem and its solution.
    """
    residual = misfit.residual(vector)
    model = LinearModel(misfit, vector, residual)
    grams = _block_grams(model.observations, np.column_stack([model.tangents, model.residual]))
    lower, upper = misfit.bounds
    owner, out = block_of_row(model.observations), np.empty(len(residual))
    for blocks, move in model._folds(grams, _folds(misfit.observations)):
        best, chosen = np.inf, residual
        for share in (0.0, 0.1, 0.3, 1.0):
            moved = vector.copy()
            moved[model.columns] += share * move * model.reach
            there = misfit.residual(np.clip(moved, lower, upper)) if share else residual
            squares = block_sums(model.observations, (there * model.determined) ** 2, BLOCK)
            seen = squares.sum() - squares[blocks].sum()
            if seen < best:
                best, chosen = seen, there
        rows = np.isin(owner, blocks)
        out[rows] = chosen[rows]
    out *= model.determined * np.sqrt(_believed(out * model.determined, model.residual, misfit.observations))[owner]
    return HeldOut(out / math.sqrt(misfit.delivered(vector)), misfit.observations)


def _believed(left: Array, fitted: Array, observations: Sequence[Seen]) -> Array:
    """(blocks,) share of the squared residual (m,) of a block not seen that is believed, given that of the whole fit.

    What a block alone determines is predicted by chance, and may outweigh all others.
    """
    held_out, own = (block_sums(observations, x**2, BLOCK) for x in (left, fitted))
    return np.minimum(_BLOWN_UP * np.asarray(own) / np.maximum(held_out, 1e-300), 1.0)


def _folds(observations: Sequence[Seen]) -> NDArray[np.intp]:
    """(blocks,) number of the fold of each block of time: those that are left out together.

    A fifth; of a servo all of one payload and gain, where there are several: an effect has to hold where the fit
    has not been, and runs of one condition share what is particular to it.
    """
    owner = np.repeat(np.arange(len(observations)), [len(o.index) for o in observations])
    starts = block_starts(observations, BLOCK)
    conditions = [o.condition if isinstance(o, ServoObservation) else None for o in observations]
    kinds = sorted({c for c in conditions if c is not None})
    if len(kinds) < 2:
        return folds(len(starts), FOLDS)
    return np.array([kinds.index(conditions[i]) for i in owner[starts]])


def _block_grams(observations: Sequence[Seen], columns: Array) -> Array:
    """(blocks, p, p) products of the columns, summed over each block of time."""
    return np.stack([gram(c, c) for c in np.split(columns, block_starts(observations, BLOCK)[1:])])
