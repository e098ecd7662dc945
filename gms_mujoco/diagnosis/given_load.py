"""The load that friction grows with: one that was logged and acts on the axis too, or the torque of the drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import effects
from ..dataset import Dataset
from ..effect import LOADED
from ..fit import fit_as_logged, fit_observations
from ..fit_result import FitResult
from ..identification.candidates import joined
from ..identification.frf_observation import Seen
from ..identification.held_out import p_value
from ..identification.inverse import Observation
from ..identification.observe import loaded_by_drive, observe
from ..identification.screen import Screen
from ..plant import Plant
from ..record import LOAD_ACTS, Record
from .friction_shape import has_another_reading, slipping_back
from .given_inertia import free
from .judgement import FALSE_DISCOVERY_RATE, leaves_much_less
from .search import Search

_PROMISES = 0.1  # of the squared error, that a load has to take in a linear refit beside a plant that has bent
_PROMISES_MUCH = 0.3  # of it, that friction which grows with the torque of the drive has to
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


def by_drive(seen: Sequence[Seen]) -> list[Seen]:
    """Observations of gears that transmit the torque of the drive; those whose load is known stay as they are."""
    return [o.with_signals(loaded_by_drive(o.record).signals) if isinstance(o, Observation) else o for o in seen]


def grows_with_drive(search: Search) -> Plant | None:
    """The plant to search with where friction may grow with the torque of the drive, where that promises much beside
    what a search has come to that has ended above the noise floor, of records that know of no load; else None.

    A given inertia that is wrong, or a torque constant, leaves what grows with that torque too: a refit may change it.
    A level that follows the torque of the drive falls often, and fast, and there friction by the letter of its
    switching law is another one: where a linear refit beside the usual reading promises little, fits of both decide.
    """
    last = search.steps[-1].result
    seen = last.misfit.observations
    if search.at_floor or not search.only_timed or LOADED in search.barred or LOADED in last.plant:
        return None
    if any(isinstance(o, Observation) and o.record.get("load") is not None for o in seen):
        return None
    carried = by_drive(seen)
    found = Screen(*last.misfit.onto(free(last.plant), last.vector, carried)).candidate(effects.find(LOADED))
    if found is None or found.gain < _PROMISES or not p_value(search.held_out, found.held_out) < FALSE_DISCOVERY_RATE:
        return None
    if found.gain >= _PROMISES_MUCH:
        return search.start
    usual = fit_observations(joined(last.plant, found.effect), carried)
    if has_another_reading(last.plant) and "gms" in search.start:
        letter = fit_observations(slipping_back(usual.plant), carried)
        if leaves_much_less(usual, letter) and leaves_much_less(last, letter):
            return slipping_back(search.start)
    return search.start if leaves_much_less(last, usual) else None


def grown(search: Search, other: Search) -> str:
    """A sentence where a search in which friction may grow with the torque of the drive leaves much less with that;
    else empty."""
    before, after = search.steps[-1].result, other.steps[-1].result
    if LOADED not in after.plant or not (leaves_much_less(before, after) and search.selects(after)):
        return ""
    return (
        "No load was logged. Friction grows with the torque of the drive, which is taken for it: with that the "
        f"{after.score.name} is {after.score.told(after.error)}, else {before.score.told(before.error)}"
    )


def _fitted(runs: Dataset, start: Plant) -> FitResult:
    return fit_as_logged(start, [o for o in observe(runs.fit, start.inertia) if isinstance(o, Observation)])


def _takes(now: FitResult) -> float:
    """Share of the squared error that a torque along with the load takes in a linear refit."""
    seen = [o for o in now.misfit.observations if isinstance(o, Observation)]
    loads = [o.record.signals.get("load") for o in seen]
    torque = [np.zeros(len(o.index)) if x is None else o.band(x) for o, x in zip(seen, loads, strict=True)]
    return Screen(now.misfit, now.vector).shape(np.concatenate(torque))[0]
