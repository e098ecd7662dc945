"""The fit next to a point that is close, and its last steps."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from ..fit_result import FitResult, result_of, with_covariance
from .inverse import Observation
from .least_squares import agreed, approach, nudge, solve
from .misfit import Misfit
from .placement import may_be_anew, placed, placed_anew
from .servo_observation import ServoObservation
from .tall import gram, squared
from .whitened import Whitened, root_of_inverse, whitened

Array = NDArray[np.float64]

_FINER = 10.0  # than the instants that a replay takes, for the last steps
_SHARP = 0.3  # of the variance of a row: a cost that falls by less moves no parameter by much of its interval
_LAST_STEPS = 10  # of each solve at the end
_STEPS_ON = 10  # of the parameters alone, from where a fit has ended
_FURTHER = 0.98  # times an error: by less it is no way on
_MUCH_LESS = 0.7  # of the squared residual, that other states have to leave at most
_ACROSS = 3  # steps across jumps
CLOSE_TO_FLOOR = 5.0  # times it: up to there, what stands between a fit and the noise may be how its elements slip
_PARTS = (1.0, 0.5, 0.25)  # of such a step that are tried


def refine(misfit: Misfit, x: Array, max_steps: int = 20, below: float = math.inf) -> FitResult:
    """The fit next to a vector that is already close, near enough to judge it; without intervals, see `finish`.

    Args:
        misfit, x: the problem, and where to start.
        max_steps: at most so many derivatives at a time.
        below: a squared residual that is of use [N^2 m^2]; a fit that does not get there may end anywhere.
    """
    return result_of(misfit, refined(misfit, x, max_steps, below))


def refined(misfit: Misfit, x: Array, max_steps: int = 20, below: float = math.inf) -> Array:
    """The vector of `refine`."""
    return agreed(misfit, _near(misfit, x, max_steps, below), max_steps // 2)


def fit_to_end(
    misfit: Misfit, x: Array, fixed: Collection[str] = (), max_steps: int = 20, below: float = math.inf
) -> FitResult:
    """The fit that a rough one leads to, with friction elements where they do most; see `refine`."""
    return result_of(*to_end(misfit, x, fixed, max_steps, below))


def to_end(misfit: Misfit, x: Array, fixed: Collection[str], max_steps: int, below: float) -> tuple[Misfit, Array]:
    """The problem and the vector of `fit_to_end`."""
    x = _near(misfit, x, max_steps, below)
    better, there = placed(misfit, x, fixed)
    if better is not misfit:
        x = _near(better, there, max_steps, below)
    if may_be_anew(better) and _is_close(result_of(better, x)) and (anew := placed_anew(better, x, fixed)):
        better, x = anew[0], _near(*anew, max_steps, below)
    return better, agreed(better, x, max_steps // 2)


def _is_close(found: FitResult) -> bool:
    """Whether a fit is above the noise floor and near it: elements that are placed anew beside much that is wrong yet
    take its place, and go further astray."""
    return not found.is_near_floor and found.error <= CLOSE_TO_FLOOR * found.floor


def _near(misfit: Misfit, x: Array, max_steps: int, below: float) -> Array:
    """A solution but for its last steps, on instants that are chosen anew in every one.

    States before the first sample are looked for beside the plant that it begins with. Where others leave much less
    beside the one that it leads to, it goes on from these: no step finds its way from a load on one side of a gap to
    the other.
    """
    x = approach(misfit, misfit.settle(x), max_steps, below=below)
    timed = [isinstance(o, Observation) for o in misfit.observations]
    # A residual with slips in it has jumps, at which derivatives over short steps lead a search to a halt.
    wide = misfit.with_steps(x, np.inf) if any(timed) else misfit
    x = solve(wide, x, max_steps, below=below)
    anew = misfit.settle(x) if all(timed) else x
    return solve(wide, anew, max_steps, below=below) if wide.cost(anew) < _MUCH_LESS * wide.cost(x) else x


def gone_on(found: FitResult) -> FitResult:
    """The same fit gone on with while noise leaves less, but not much less: a few steps of the parameters alone, and to
    its end from there, may find a way on where its own last steps have found none."""
    while found.error > found.floor and _is_close(found):
        further = fit_to_end(found.misfit, nudge(found.misfit, found.vector, _STEPS_ON))
        if further.error > _FURTHER * found.error:
            break
        found = further
    return found


def finished(found: FitResult) -> FitResult:
    """The same fit at its end, see `finish`."""
    return finish(found.misfit, found.vector)


def finish(misfit: Misfit, x: Array) -> FitResult:
    """The fit from which no step would move a parameter by much of its interval, with these intervals."""
    around = None
    if not any(isinstance(o, ServoObservation) for o in misfit.observations):
        tolerance = _SHARP / len(misfit.residual(x))
        fine = misfit.on_grids(x, _FINER)
        for _ in range(2):
            there = solve(fine, x, _LAST_STEPS, tolerance)
            anew = misfit.on_grids(there, _FINER)
            if anew.cost(there) > fine.cost(x):
                break  # better on the instants of x alone
            x, fine = there, anew
        x = agreed(misfit, x, _LAST_STEPS)
        if any(o.jumps for o in misfit.observations):
            x, around = _across_jumps(misfit, x, tolerance)
    return with_covariance(result_of(misfit, x), around)


def _across_jumps(misfit: Misfit, x: Array, tolerance: float) -> tuple[Array, Whitened]:
    """Where steps of Gauss and Newton end that look a standard deviation ahead, and what they see there: small jumps of
    the residual hold up a search that does not."""
    # What is better on the instants of x alone is not: each vector is judged on its own.
    around, r = whitened(misfit, x), misfit.on_grids(x, _FINER).residual(x)
    for _ in range(_ACROSS):
        cost = squared(r) + float(around.prior @ x**2)
        gradient = gram(around.slopes, r) + around.root.T @ (around.prior * x)
        turn = root_of_inverse(around.normal)
        step = turn @ (turn.T @ gradient)
        if float(gradient @ step) < tolerance * cost:
            break
        for part in _PARTS:
            there = np.clip(x - part * (around.root @ step), *misfit.bounds)
            r = misfit.on_grids(there, _FINER).residual(there)
            after = squared(r) + float(around.prior @ there**2)
            if after < cost:
                break
        else:
            break
        x, around = there, whitened(misfit, there)
        if cost - after < tolerance * cost:
            break
    return x, around
