"""Where a fit begins: of several starts the one that leaves the least after a few steps, by a coarse look."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ..plant import Plant
from ..progress import Progress, silent
from .frf_observation import FrfObservation, Seen
from .least_squares import agreed, nudge, solve
from .misfit import Misfit
from .servo_observation import ServoObservation
from .starts import starts

Array = NDArray[np.float64]

_RUNS = 16  # of a servo, for a first look
_ENOUGH = 160  # points of frequency responses, for a first look


def best_start(
    plant: Plant,
    observations: Sequence[Seen],
    fixed: Collection[str] = (),
    report: Progress = silent,
    below: float = math.inf,
) -> Plant:
    """Where that of the starts leads that leaves the least after a few steps; see `refine.refine` for `below`."""
    led: list[tuple[float, Plant]] = []
    some = fewer(observations)
    candidates = starts(plant, some)
    for i, start in enumerate(candidates):
        report(0.1 + 0.4 * i / len(candidates), f"start {i + 1} of {len(candidates)}")
        misfit = Misfit(start, some, fixed, coarse=True)
        common, enough = np.arange(misfit.n_common), min([below, *(cost for cost, _ in led)])
        x = solve(misfit, misfit.settle(misfit.vector(start)), 10, columns=common, below=enough)
        x = agreed(misfit, x, 20, common)
        led.append((misfit.cost(x), misfit.plant(x)))
    return min(led, key=lambda t: t[0])[1]


def begun(
    start: Plant, observations: Sequence[Seen], fixed: Collection[str] = (), below: float = math.inf
) -> tuple[Misfit, Array]:
    """The misfit of a plant with all its values, and its vector, moved off where derivatives say nothing."""
    misfit = Misfit(start, observations, fixed)
    return misfit, nudge(misfit, misfit.vector(start), below=below)


def fewer(observations: Sequence[Seen], enough: int = _ENOUGH) -> list[Seen]:
    """Enough of the points of frequency responses, or of the runs of a servo, to see where a fit leads."""
    if len(observations) > _RUNS and isinstance(observations[0], ServoObservation):
        return list(observations[:: math.ceil(len(observations) / _RUNS)])
    points = sum(len(o.frf) for o in observations if isinstance(o, FrfObservation))
    every = math.ceil(points / enough)
    return [o.thinned(every) if isinstance(o, FrfObservation) else o for o in observations]
