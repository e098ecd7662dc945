"""What records that were not fitted show, and those that were fitted do not.

A drive that saturates in the strongest record alone leaves no trace in those before it. Nothing is chosen by it: what
was not fitted is there to be told beforehand. But it says what to look for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..compare import Comparison
from ..fit_result import FitResult
from ..identification.candidates import applicable
from ..identification.frf_observation import Seen
from ..identification.held_out import p_value
from ..identification.linear_model import cross_validated
from ..identification.misfit import Misfit
from ..identification.refine import refine
from ..identification.screen import Screen
from .beyond import Hint
from .judgement import AT_FLOOR, discoveries
from .search import Search

_MOST = 0.5  # of the squared error of all records on blocks not seen, that an effect takes which is told


def shown_unfitted(search: Search, last: FitResult, others: Sequence[Seen], comparison: Comparison) -> Hint | None:
    """What a fit to all records lacks, and one to those that were fitted does not; None where nothing is known to be.

    Args:
        search: that has ended.
        last: its plant, at the noise floor of what was fitted.
        others: records that were not fitted, of which it leaves more.
        comparison: of the plant with them.
    """
    if not search.only_timed:
        return None
    before, seen = last.misfit, [*last.misfit.observations, *others]
    everything = Misfit(last.plant, seen)
    memories = before.memories(last.vector, everything.n_memory)
    memories += [np.empty(0) if r.memory is None else r.memory for r in comparison.records]
    now = refine(everything, everything.vector(last.plant, memories, before.skew(last.vector)))
    loud = comparison.loudest
    experiment = f'{loud} shows what the fit records do not: give it, or another run like it, use = "fit".'
    if now.error <= AT_FLOOR * now.floor:
        return Hint(f"a fit to all records leaves {now.score.told(now.error)}: those that were fitted do not tell all "
                    "parameters", experiment)  # fmt: skip
    left, screen = cross_validated(now.misfit, now.vector), Screen(now.misfit, now.vector)
    found = screen.candidates(e for e in applicable(now.plant, seen) if e.name not in search.barred)
    p_values = {c.effect.name: p_value(left, c.held_out) for c in found}
    passed = [c for c in found if c.effect.name in discoveries(p_values)]
    best = min(passed, key=lambda c: c.held_out.total, default=None)
    if best is None or best.held_out.total > (1 - _MOST) * left.total:
        return None
    name, share = best.effect.name, 100 * (1 - best.held_out.total / left.total)
    return Hint(f"the fit records show no {name}, but of what a fit to all records leaves it takes {share:.0f} % "
                f"(p = {p_values[name]:.1g} on held-out blocks)", experiment)  # fmt: skip
