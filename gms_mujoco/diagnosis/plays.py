"""A play that is begun again from other contacts: beside a fit lie others in which its load knocks at other instants,
and no step leads from one to the next."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from operator import attrgetter

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..fit_result import FitResult
from ..identification.candidates import width_of
from ..identification.least_squares import nudge
from ..identification.misfit import Misfit
from ..identification.refine import fit_to_end
from ..plant import Plant

Array = NDArray[np.float64]

_WIDTHS = (0.75, 1.0, 1.25)  # times that of a fit
_FREQUENCIES = (0.6, 1.0, 1.5)  # times that of a fit
_DAMPINGS = (0.05, 0.15, 0.4)  # a contact that is damped more does not ring, and hides when it knocks
_LOOKS = 64  # at contacts beside that of a fit, spread over a box: the valley of a stiff one is narrow, and oblique
# Its sides, times what a fit has.
_BESIDE = {
    "width": (0.87, 1.15), "frequency": (0.5, 5.0), "damping": (0.33, 1.3), "inertia": (0.87, 1.15),
    "deceleration": (0.7, 1.5),
}  # fmt: skip
_CLOSE = 1.1  # times the noise floor: a fit that leaves no more is the one
_ENDS = 2  # of the contacts that are tried, fitted to their ends
_LOOKED_AT = 3  # records, those of which most is left
_CLOSER = 9  # plants of which a few steps are taken, those that leave least as they are: no other came out best
_MOST = 4  # rounds
_BETTER = 0.95  # of the error, that a round has to come down to for another


def play_of(plant: Plant) -> tuple[Effect, str] | None:
    """The effect of a plant that has a play, and the name of its width; None without one."""
    found = ((e, width_of(type(e))) for e in plant.effects)
    return next(((e, width) for e, width in found if width), None)


def from_other_contacts(result: FitResult) -> FitResult:
    """The fit with its play begun from other contacts, where that leaves less; itself at the noise floor, and without a
    play."""
    for _ in range(_MOST):
        play = play_of(result.plant)
        if play is None or result.error <= _CLOSE * result.floor:
            break
        again = min((fit_to_end(*result.misfit.onto(p, result.vector)) for p in _promising(result, *play)),
                    key=attrgetter("error"))  # fmt: skip
        if again.error > _BETTER * result.error:
            break
        result = again
    return result


def _promising(result: FitResult, play: Effect, width: str) -> list[Plant]:
    """Plants with other contacts, of which a few steps leave least."""
    names = {"width": width} | {k: k for k in _BESIDE if k != "width" and play.values[k]}
    own = {name: float(np.asarray(play.values[name])) for name in names.values()}
    there = [
        {width: wider * own[width], "frequency": faster * own["frequency"], "damping": damping}
        for wider, faster, damping in itertools.product(_WIDTHS, _FREQUENCIES, _DAMPINGS)
    ]
    low, high = np.log([_BESIDE[k] for k in names]).T
    spread = scipy.stats.qmc.Sobol(len(low), seed=0).random(_LOOKS)
    for times in np.exp(low + (high - low) * spread):
        there.append({k: float(x * own[k]) for k, x in zip(own, times, strict=True)})
    bounds = {p.name: (p.lower, p.upper) for p in play.parameters}
    inside = [{k: float(np.clip(x, *bounds[k])) for k, x in values.items()} for values in there]
    plants = [result.plant.replace(play.replace(**values)) for values in inside]
    return looked_at(result.misfit, result.vector, [p for p in plants if p.driven_inertia > 0])[:_ENDS]


def looked_at(misfit: Misfit, vector: Array, plants: Sequence[Plant]) -> list[Plant]:
    """The most promising plants after a few steps on the records of which a fit leaves most, those that leave least
    there first.

    Args:
        misfit, vector: the fit.
        plants: with at least the effects of its plant, at their places.
    """
    some = sorted(misfit.loudest(vector)[:_LOOKED_AT])
    begun = []
    for plant in plants:
        whole, x = misfit.onto(plant, vector)
        near, x = whole.part(x, some)
        begun.append((near.cost(x), near, x))
    begun.sort(key=lambda t: t[0])
    tried = [(near, nudge(near, x)) for _, near, x in begun[:_CLOSER]]
    return [near.plant(x) for near, x in sorted(tried, key=lambda t: t[0].cost(t[1]))]
