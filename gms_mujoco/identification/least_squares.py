"""The vector of least squares of a misfit, by Levenberg-Marquardt with bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..threads import each
from .frf_observation import FrfObservation
from .misfit import ROUNDING, Misfit
from .tall import gram, squared

Array = NDArray[np.float64]

_WORTH = 0.03  # of the tolerance: a step that promises less is not tried
_AHEAD = 20  # steps over which a cost may go on to fall as it did: as many as a fit has
_COARSE = 0.1  # of the squared residual, that the square of the error of a coarse look may be
_EXACT = 0.01  # of the same: no exact look finds anything that is much better
_ROUNDS = 4  # of solving and computing the harmonics anew
_AGREED = 0.98  # of the cost: less of a fall is none
_FARTHEST = 6.0  # times its reach, that an unknown moves in one step; of a logarithm 3


def solve(
    misfit: Misfit,
    start: Array,
    max_steps: int = 40,
    tolerance: float = 3e-4,
    columns: NDArray[np.intp] | None = None,
    below: float = np.inf,
    enough: float = 0.0,
) -> Array:
    """The vector of least squares near `start`.

    Levenberg-Marquardt on the normal equations, with the parameters that press against a bound held there: many
    of the unknowns (states before the first sample, shares) end on a bound, where interior methods crawl. What the data
    hardly see stays near what is likely (`Misfit.prior`): it would run to and fro between its bounds, and no step of
    the others be tried for its own sake.

    Args:
        misfit: the problem.
        start: (size,) where to begin.
        max_steps: at most so many derivatives.
        tolerance: stops when the cost has fallen by a smaller share in two steps.
        columns: the unknowns to move; None: all.
        below: a cost that is of use [N^2 m^2]; stops when that is out of reach at the pace of the last two steps.
        enough: a cost at which it stops [N^2 m^2].
    """
    lower, upper = misfit.bounds
    columns = np.arange(misfit.size) if columns is None else columns
    x = np.clip(start, lower, upper)
    r = misfit.residual(x)
    damping, stalled, reach, pace = 1e-3, 0, misfit.reach(x)[columns], 1.0
    for _ in range(max_steps if len(columns) else 0):
        prior = misfit.prior * squared(r) / len(r)  # what is left says how much the data tell
        cost = squared(r) + float(prior @ x**2)
        hessian, gradient = _normal(misfit, misfit.jacobian(x, columns), r, columns)
        gradient += prior[columns] * x[columns]
        hessian += np.diag(prior[columns])
        push = np.zeros(misfit.size)
        push[columns] = gradient
        seen = np.diag(hessian) * reach**2 > ROUNDING**2 * cost
        free = np.flatnonzero(~misfit.held(x, push)[columns] & seen)
        if not len(free):
            break
        moving = columns[free]
        scale, farthest = np.sqrt(np.diag(hessian)[free]), _FARTHEST * reach[free]
        normal = hessian[np.ix_(free, free)] / np.outer(scale, scale)
        before, growth = cost, 4.0
        for _ in range(12):
            step = np.linalg.solve(normal + damping * np.eye(len(free)), gradient[free] / scale) / scale
            if float(gradient[free] @ step) < _WORTH * tolerance * cost:
                break
            trial = x.copy()
            trial[moving] = np.clip(x[moving] - np.clip(step, -farthest, farthest), lower[moving], upper[moving])
            r_trial = misfit.residual(trial)
            cost_trial = squared(r_trial) + float(prior @ trial**2)
            if cost_trial < cost:
                x, r, cost, damping = trial, r_trial, cost_trial, max(damping / 5, 1e-9)
                break
            damping, growth = damping * growth, 2 * growth
        stalled = stalled + 1 if before - cost <= tolerance * before else 0
        fall = 1 - cost / before if before > 0 else 0.0
        if stalled == 2 or cost == before or cost < enough or cost * (1 - _AHEAD * max(fall, pace)) > below:
            break
        pace = fall
    return x


def _normal(misfit: Misfit, jacobian: Array, r: Array, columns: NDArray[np.intp]) -> tuple[Array, Array]:
    """(c, c) products of the derivatives by some unknowns (c,), and (c,) of them and the residual.

    The rows of an observation know nothing of the states before others, which are most of the unknowns of many.
    """
    common = columns[columns < misfit.n_common]
    rows, left = np.split(jacobian, misfit.splits), np.split(r, misfit.splits)

    def one(i: int) -> tuple[NDArray[np.intp], Array, Array]:
        begin, end = misfit.states(i)
        own = np.append(common, columns[(columns >= begin) & (columns < end)])
        part = rows[i].T[own].T
        return own, gram(part, part), gram(part, left[i])

    hessian, gradient = np.zeros((misfit.size, misfit.size)), np.zeros(misfit.size)
    for own, squares, products in each(one, range(len(left))):
        hessian[np.ix_(own, own)] += squares
        gradient[own] += products
    return hessian[np.ix_(columns, columns)], gradient[columns]


def nudge(misfit: Misfit, x: Array, max_steps: int = 6, below: float = np.inf) -> Array:
    """A few steps of the parameters alone, most by a coarse look: enough to see how good a fit will be.

    Args:
        misfit, x: the problem, and where to start.
        max_steps: at most so many derivatives at a time.
        below: a cost that is of use [N^2 m^2]; no exact look is taken where a coarse one says that it is out of reach.
    """
    common, x = np.arange(misfit.n_common), misfit.settle(x)
    few = max_steps // 3
    near = approach(misfit, x, max_steps + (few if below < np.inf else 0), 3e-3, common, below)
    if near is x:
        return solve(misfit, x, max_steps, 3e-3, common, below)
    coarse, exact = misfit.coarsely().residual(near), misfit.residual(near)
    error = squared(coarse - exact)
    # Where a coarse look finds nothing better, an exact one goes below by no more than the error of the first.
    least = max(squared(coarse) ** 0.5 - error**0.5, 0.0) ** 2
    if error <= _EXACT * squared(exact) or least > below:
        return near
    return solve(misfit, near, few, 3e-3, common, below)


def approach(
    misfit: Misfit,
    start: Array,
    max_steps: int,
    tolerance: float = 3e-4,
    columns: NDArray[np.intp] | None = None,
    below: float = np.inf,
) -> Array:
    """As near to the vector of least squares as a coarse look leads, which costs a part of an exact one.

    Its error must be little beside what is left: where it is not, `start` itself, as where there is no record to look
    at coarsely. Arguments as for `solve`.
    """
    if all(o.sparse is None for o in misfit.observations):
        return start
    coarse, exact = misfit.coarsely(), misfit.residual(start)
    enough = squared(coarse.residual(start) - exact) / _COARSE
    if squared(exact) < enough:
        return start
    x = solve(coarse, start, max_steps, tolerance, columns, below, enough)
    return x if misfit.cost(x) < squared(exact) else start


def agreed(misfit: Misfit, x: Array, max_steps: int, columns: NDArray[np.intp] | None = None) -> Array:
    """`x` solved anew until the harmonics of the motions of frequency responses, which depend on the plant that they
    are to tell, agree with it; as it is where there are none."""
    if any(isinstance(o, FrfObservation) for o in misfit.observations):
        for _ in range(_ROUNDS):
            there = misfit.settle(x)
            before = misfit.cost(there)
            x = solve(misfit, there, max_steps, columns=columns)
            if misfit.cost(x) > _AGREED * before:
                break
    return x
