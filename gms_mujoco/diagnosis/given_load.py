"""A load that is logged as what friction grows with, where the records say that it acts on the axis too."""

from __future__ import annotations

import numpy as np

from ..dataset import Dataset
from ..fit import fit_as_logged
from ..fit_result import FitResult
from ..identification.inverse import Observation
from ..identification.observe import observe
from ..identification.screen import Screen
from ..plant import Plant
from ..record import LOAD_ACTS, Record
from .judgement import leaves_much_less

_PROMISES = 0.1  # of the squared error, that a torque along with the load has to take beside a plant that has bent
_WAYS = ("in its direction", "against it")


def corrected_load(runs: Dataset, start: Plant) -> tuple[Dataset, str]:
    """The measurements with a load that acts on the axis as a torque, where they ask for it, and a sentence on that; as
    they are, and "", where they do not.

    What presses a bearing together takes no torque; what hangs on a gear does. It is counted in with all of its torque,
    one way or the other, where that leaves much less than without.
    """
    if runs.robot is not None or not any("load" in r.signals for r in runs.fit if isinstance(r, Record)):
        return runs, ""
    before = _fitted(runs, start)
    if before.is_near_floor or _takes(before) < _PROMISES:
        return runs, ""
    ends = [(sign, acting := runs.with_acting_load(sign), _fitted(acting, start)) for sign in LOAD_ACTS]
    sign, acting, after = min(ends, key=lambda end: end[2].error)
    if not leaves_much_less(before, after):
        return runs, ""
    told = before.score.told
    way = _WAYS[LOAD_ACTS.index(sign)]
    said = (
        f"The load that was logged acts on the axis itself, as a torque {way}. That is counted in: without it the "
        f"{before.score.name} is {told(before.error)}, with it {told(after.error)}. Add load_acts = {sign} to [axis]"
    )
    return acting, said


def _fitted(runs: Dataset, start: Plant) -> FitResult:
    return fit_as_logged(start, [o for o in observe(runs.fit, start.inertia) if isinstance(o, Observation)])


def _takes(now: FitResult) -> float:
    """Share of the squared error that a torque along with the load takes in a linear refit."""
    seen = [o for o in now.misfit.observations if isinstance(o, Observation)]
    loads = [o.record.signals.get("load") for o in seen]
    torque = [np.zeros(len(o.index)) if x is None else o.band(x) for o, x in zip(seen, loads, strict=True)]
    return Screen(now.misfit, now.vector).shape(np.concatenate(torque))[0]
