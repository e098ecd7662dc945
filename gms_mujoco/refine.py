"""The fit next to a point that is close, and its last steps."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from .fit_result import FitResult, result_of, with_covariance
from .inverse import Observation
from .least_squares import agreed, approach, solve
from .misfit import Misfit
from .placement import placed
from .servo_observation import ServoObservation

Array = NDArray[np.float64]

_FINER = 10.0  # than the instants that a replay takes, for the last steps
_SHARP = 0.3  # of the variance of a row: a cost that falls by less moves no parameter by much of its interval
_LAST_STEPS = 10  # of each solve at the end


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
    return better, agreed(better, x, max_steps // 2)


def _near(misfit: Misfit, x: Array, max_steps: int, below: float) -> Array:
    """A solution but for its last steps, on instants that are chosen anew in every one."""
    x = approach(misfit, misfit.settle(x), max_steps, below=below)
    # A residual with slips in it has steps of its own, at which derivatives over short ones lead a search to a halt.
    wide = misfit.with_steps(x, np.inf) if any(isinstance(o, Observation) for o in misfit.observations) else misfit
    return solve(wide, x, max_steps, below=below)


def finished(found: FitResult) -> FitResult:
    """The same fit at its end, see `finish`."""
    return finish(found.misfit, found.vector)


def finish(misfit: Misfit, x: Array) -> FitResult:
    """The fit from which no step would move a parameter by much of its interval, with these intervals."""
    if not any(isinstance(o, ServoObservation) for o in misfit.observations):
        for _ in range(2):
            x = solve(misfit.on_grids(x, _FINER), x, _LAST_STEPS, _SHARP / len(misfit.residual(x)))
        x = agreed(misfit, x, _LAST_STEPS)
    return with_covariance(result_of(misfit, x))
