"""What no effect of the catalogue is, and one that resembles it has to beat.

What resembles a cause takes most of what it does. Where one that is no effect of the catalogue leaves much less than
the best that is, that effect is not what is missing, however much it takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fit_result import FitResult
from ..identification.held_out import HeldOut, p_value
from ..identification.linear_model import LinearModel
from ..identification.refine import refine
from ..identification.tall import gram
from .judgement import FALSE_DISCOVERY_RATE, MUCH_LESS, Trial, floor_of
from .other_causes import CAUSES, Cause, records_of

Array = NDArray[np.float64]

_ROUNDS = 3  # of strengths beside a fit, and the fit beside them
_LEAST, _MOST = 0.01, 0.95  # of what a cause takes from, that is missing somewhere
_LITTLE = 1e-4  # of it, that is left in a record


class Hint(NamedTuple):
    """What explains more than anything in the catalogue.

    Attributes:
        said: a clause on it.
        experiment: that shows whether it does.
        left: squared residual that it leaves of blocks not seen [N^2 m^2]; inf where that is not known.
    """

    said: str
    experiment: str
    left: float = math.inf


def beyond(now: FitResult, before: HeldOut, best: Trial) -> Hint | None:
    """What is in no catalogue and leaves much less than the best fit with an effect more; None where nothing does.

    Args:
        now, before: a fit to records, and what it leaves of each block by a fit without it.
        best: with an effect more.
    """
    hints = (_explains(cause, now, before, best) for cause in CAUSES if now.plant.kind in cause.kinds)
    return min((h for h in hints if h is not None), key=lambda h: h.left, default=None)


def _explains(cause: Cause, now: FitResult, before: HeldOut, best: Trial) -> Hint | None:
    """What is said of a cause that leaves much less than the best fit with an effect more; None where it does not."""
    seen = records_of(now)
    torques = cause.torques(now)
    if not torques:
        return None
    bands = np.concatenate([t.band(o) for t, o in zip(torques, seen, strict=True)])
    strength, result, total, told = np.zeros(bands.shape[1]), now, math.inf, None
    for k in range(_ROUNDS):
        if k:
            beside = [t.beside(o, strength) for t, o in zip(torques, seen, strict=True)]
            result = refine(*now.misfit.onto(result.plant, result.vector, beside))
        misfit, x = result.misfit, result.vector
        model = LinearModel(misfit, x, misfit.residual(x))
        columns = bands * model.determined[:, None]
        free = model.without(columns)
        strength = strength + np.linalg.lstsq(gram(free, free), gram(free, model.target))[0]
        if not _LEAST < cause.missing(now, strength) < _MOST:
            break
        delivered = np.maximum(cause.left(now, torques, strength), _LITTLE) * math.sqrt(misfit.delivered(x))
        left = HeldOut(model.held_out(columns) / np.repeat(delivered, [len(o.index) for o in seen]), seen)
        if left.total > min(best.held_out.total, total):
            break
        total = left.total
        floor = min(floor_of(result), floor_of(best.result))
        much_less = left.total - floor < MUCH_LESS * (best.held_out.total - floor)
        if much_less and p_value(best.held_out, left) <= FALSE_DISCOVERY_RATE:
            told = strength, total
    if told is None:
        return None
    strength, total = told
    share = 100 * (1 - total / before.total)
    said = f"{cause.say(now, strength)}, explains more than any effect ({share:.0f} %)"
    return Hint(said, cause.experiment, total)
