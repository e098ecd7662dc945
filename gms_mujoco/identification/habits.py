"""Habits of a log: how it came about, which is no physics, and no effect that a plant could lack.

Torques that act before their rows, rows that are the time steps of a simulation, rests where friction does not bend,
responses at which a harmonic of the motion met a resonance.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ..fit_result import FitResult, result_of
from .frf_observation import FrfObservation, Seen, balanced
from .inverse import Observation
from .linear_model import determined
from .misfit import Misfit
from .refine import CLOSE_TO_FLOOR, refine, refined
from .tall import squared
from .time_steps import TimeSteps, in_steps, steps_of, without_rests

Array = NDArray[np.float64]

_EARNED, EARLY_SHARE = 0.05, 0.2  # of the squared error, and of that above the floor: less is no habit of a log
_STEPS_SHARE = 0.5  # of the squared error above the floor, that time steps have to take
_RESTS_SHARE = 0.5  # of the squared error, that rests have to hold
_STOOD_THERE, _SHARPER = 0.75, 0.5  # times the error, left without them by the same plant, and by one fitted so


def as_logged(found: FitResult, fixed: Collection[str] = (), share: float = EARLY_SHARE) -> list[Seen] | None:
    """The observations by another habit of the log, which is no physics, and no effect; None where none explains more.

    Args:
        found: a fit by the habit that is known so far.
        fixed: parameters that stay, as "effect.parameter".
        share: of the squared error above the noise floor, that torques before their rows have to take.
    """
    return (
        _without_rests(found, fixed)
        or _beside_resonances(found, fixed)
        or acting_early(found, fixed, share)
        or _as_time_steps(found, fixed)
    )


def may_be_otherwise(misfit: Misfit, x: Array) -> bool:
    """Whether a fit gives any reason to ask for another habit, as far as that is seen at no cost."""
    asks = any(isinstance(o, Observation) and (o.early or isinstance(o, TimeSteps)) for o in misfit.observations)
    asks = asks or any(isinstance(o, FrfObservation) for o in misfit.observations)
    return asks or "delay" in misfit.coordinates.template or bool(_pressing(misfit, x)) or _rests_press(misfit, x)


def _onto(seen: Sequence[Seen], found: FitResult, fixed: Collection[str]) -> tuple[Misfit, Array]:
    """The problem of a fit and its vector, with its records seen otherwise, of which the skew is not known."""
    return found.misfit.onto(found.plant, found.vector, seen, fixed, skew=0.0)


def _without_rests(found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """The observations, of which nothing is asked where the axis rests within a count of its encoder.

    Where most of what is left is left there, friction bends too little to be seen, and holds by whatever it has to.
    """
    misfit, x = found.misfit, found.vector
    if not _rests_press(misfit, x):
        return None
    return _where_most_stood(without_rests(misfit.observations), found, fixed)


def _where_most_stood(seen: list[Seen], found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """Observations of which a part counts less or not at all; None where it is not most of what is left that stood
    there."""
    # Beside a refit what falls has to be what stood there: fewer rows let a plant bend to what passes on less noise.
    stays = result_of(*found.misfit.onto(found.plant, found.vector, seen, fixed)).error > _STOOD_THERE * found.error
    enough = _STOOD_THERE if found.rattles else _SHARPER
    return None if stays or refine(*_onto(seen, found, fixed)).error > enough * found.error else seen


def _beside_resonances(found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """The observations, with less trust in points of responses at which a harmonic of the motion meets a resonance of
    the plant, or that it has no motion at: which ones these are a plant without that resonance did not show.

    Far from the floor they are the evidence of what is missing.
    """
    seen = found.misfit.observations
    frfs = [o for o in seen if isinstance(o, FrfObservation)]
    if not frfs or found.is_near_floor or found.error > CLOSE_TO_FLOOR * found.floor:
        return None
    again = balanced(frfs, found.plant)
    rest = [o for o in seen if not isinstance(o, FrfObservation)]
    return _where_most_stood([*rest, *again], found, fixed) if again else None


def _rests_press(misfit: Misfit, x: Array) -> bool:
    """Whether most of what is left is left where an axis rests within a count of its encoder."""
    if not any(isinstance(o, Observation) and o.rests for o in misfit.observations):
        return False
    rows = misfit.residual(x)
    return float(np.sum(rows[~determined(misfit)] ** 2)) > _RESTS_SHARE * squared(rows)


def _as_time_steps(found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """The observations, of records whose rows are the time steps of a simulation.

    Their torques seem to act before their rows, by half a row or more, unless a delay puts them off.
    """
    misfit, x = found.misfit, found.vector
    records = [o for o in misfit.observations if isinstance(o, Observation)]
    known = steps_of(misfit.observations)
    asks = known or all(o.early for o in records) or "delay" in found.plant
    done = not known and found.is_near_floor  # what is taken when shows in the last digits too
    if not records or not asks or any(o.record.sensed for o in records) or done:
        return None
    left = squared(misfit.residual(x))
    enough = max(_EARNED * left, _STEPS_SHARE * (left - squared(found.floor_rows)))

    def left_in(late: int, ahead: tuple[int, int]) -> float:
        trial, there = _onto(in_steps(misfit.observations, late, ahead), found, fixed)
        return trial.cost(refined(trial, there, below=left - enough))

    if known:  # found while the fit was still far off
        tried = {known: left}
    else:
        tried = {(late, ahead): left_in(late, ahead) for late in (0, 1) for ahead in ((0, 0), (1, 1))}
    late, _ = min(tried, key=lambda k: tried[k])
    tried |= {(late, a): left_in(late, a) for a in ((0, 0), (1, 1), (0, 1), (1, 0), (-1, 1)) if (late, a) not in tried}
    best = min(tried, key=lambda k: tried[k])
    return in_steps(misfit.observations, *best) if left - tried[best] > enough else None


def acting_early(found: FitResult, fixed: Collection[str] = (), share: float = EARLY_SHARE) -> list[Seen] | None:
    """The observations, with torques that acted before their rows; None where that explains too little more.

    A drive acts after it is told, and at most a tenth of a sample of skew is anybody's. But a torque that was measured
    is that of the interval just over, or of an instant in it, by the habits of the log: no physics, and no effect. One
    that is known to be read from a sensor (`Record.sensed`) may have been half a sample before or after the position.

    Args:
        found: a fit that holds the skew within what is anybody's.
        fixed: parameters that stay, as "effect.parameter".
        share: of the squared error above the noise floor, that torques before their rows have to take.
    """
    misfit, x, n = found.misfit, found.vector, found.misfit.coordinates.size
    side = _pressing(misfit, x)
    if not side:
        return None
    late = side > 0
    rows, residual = misfit.jacobian(x), misfit.residual(x)
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    others = np.delete(rows / scale, n, axis=1)
    column = rows[:, n] / scale[n]
    column = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    left = squared(residual)
    enough = max(_EARNED * left, (EARLY_SHARE if late else share) * (left - squared(found.floor_rows)))
    if (column @ residual < 0) != late or (column @ residual) ** 2 < enough * (column @ column):
        return None
    early = [o.acting_early() if isinstance(o, Observation) else o for o in misfit.observations]
    again = refine(Misfit(found.plant, early, fixed), x)
    return early if left - again.misfit.cost(again.vector) > enough else None


def _pressing(misfit: Misfit, x: Array) -> int:
    """-1 where torques would act earlier than their rows, if they might, 1 where ones that were read would later; 0."""
    sensed = any(isinstance(o, Observation) and o.record.sensed for o in misfit.observations)
    n, (lower, upper) = misfit.coordinates.size, misfit.bounds
    may_be = any(o.may_be_earlier for o in misfit.observations if isinstance(o, Observation))
    if not misfit.n_skew or lower[n] == 0 or not may_be:
        return 0
    if sensed and x[n] >= 0.99 * upper[n]:
        return 1
    return -1 if x[n] <= 0.99 * lower[n] else 0
