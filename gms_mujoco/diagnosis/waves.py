"""Waves over a part of the revolution: several make any curve there, and one that is not the right one calls for more.

A harmonic is chosen from those that the records pass through once, while friction is still bent. On less than a
revolution others make up for one that is wrong.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from ..effect import Effect
from ..fit_result import FitResult
from ..identification.candidates import ORDERS, PART_OF_WAVE, grows, longest_way
from ..identification.misfit import Misfit
from ..identification.refine import fit_to_end
from ..identification.screen import Screen
from .judgement import LEAST_GAIN, left_of, without

_ENDS = 3  # single waves that are fitted to their ends


def as_one_wave(result: FitResult) -> FitResult | None:
    """A fit in which another wave over the place stands for those of an effect: one for several where it leaves hardly
    more, one for one where it leaves less; None where none does, and where a record turns once."""
    plant, misfit = result.plant, result.misfit
    if plant.kind != "hinge" or longest_way(misfit.observations) >= 1:
        return None
    left = left_of(misfit, result.vector)
    for effect in (e for e in plant.effects if grows(type(e))):
        least = left * (1 + LEAST_GAIN if np.size(effect.values["harmonics"]) > 1 else 1 - LEAST_GAIN)
        begun = [misfit.onto(plant.replace(one), result.vector) for one in _single(result, effect)]
        ends = [fit_to_end(near, x, below=least * misfit.delivered(result.vector)) for near, x in begun]
        best = min(ends, key=attrgetter("error"), default=None)
        if best is not None and left_of(best.misfit, best.vector) <= least:
            return best
    return None


def known_in_part(result: FitResult) -> str:
    """Where waves over the place are known, of which the records pass through a part or take several for a curve; empty
    where they are known as what they are."""
    plant, misfit = result.plant, result.misfit
    waves = [e for e in plant.effects if grows(type(e))]
    if plant.kind != "hinge" or not waves:
        return ""
    low, high = _ends(misfit)
    passed = {e.name: np.atleast_1d(e.values["harmonics"]) * (high - low) / (2 * np.pi) for e in waves}
    names = [name for name, p in passed.items() if min(p) < 1 or (len(p) > 1 and high - low < 2 * np.pi)]
    if not names:
        return ""
    return (f"{' and '.join(names)}: known from {low:.3g} to {high:.3g} rad, where the records go; waves that are as "
            "good there may differ beyond")  # fmt: skip


def _ends(misfit: Misfit) -> tuple[float, float]:
    """Between which positions the records go."""
    place = np.concatenate([o.position for o in misfit.observations])
    return float(place.min()), float(place.max())


def _single(result: FitResult, effect: Effect) -> list[Effect]:
    """Some single waves in the place of those of an effect, with which a linear refit leaves least."""
    misfit, x = without(result, effect.name)
    low, high = _ends(misfit)
    screen, turn = Screen(misfit, x), (high - low) / (2 * np.pi)
    own = np.atleast_1d(effect.values["harmonics"])
    orders = [n for n in range(2, ORDERS + 1) if n * turn >= PART_OF_WAVE and own.tolist() != [n]]
    found = [seen for n in orders if (seen := screen.at(type(effect), {"harmonics": n}))]
    return [one for one, *_ in sorted(found, key=lambda f: f[2].total)[:_ENDS]]
