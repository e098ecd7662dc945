"""Rough fits that begin where no tangent leads: an effect in the place of what stands for it, or from the beginning."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from ..effect import Effect
from ..fit import from_the_data
from ..fit_result import FitResult
from ..identification.candidates import with_general_laws
from ..identification.least_squares import nudge
from ..identification.refine import refined
from ..identification.screen import Candidate, Screen
from ..plant import Plant
from ..progress import Progress, silent
from .friction_shape import following, spring_instead, straightened
from .joint_fits import JointFits, Rough
from .judgement import LEAST_SHARE, left_of

DRAG = "quadratic_drag"  # what a curve of friction that bends over all speeds does
SPRING = "spring"  # what an element of friction that never slips does


def general_laws(now: FitResult, fits: JointFits, barred: Collection[str], below: float = math.inf) -> list[Rough]:
    """A rough fit with each general law of friction in the place of those that it contains: it is no small change of
    them, which a tangent would show; see `JointFits.roughly` for `below`."""
    laws = with_general_laws(now.plant)
    return [(n, *from_the_data(p, fits.few, below=below)) for n, p in laws.items() if n not in barred]


def straight(now: FitResult, addable: Sequence[type[Effect]]) -> tuple[Plant, Plant, tuple[str, ...]] | None:
    """The plant with friction that does not stand for a drag where its own does, without a drag and with one, and the
    names of what a fit leaves as it is; None where it does not, or where a drag is none of the effects that could be
    added. See `straightened`."""
    drag = next((e for e in addable if e.name == DRAG), None)
    if drag is None or (begun := straightened(now)) is None:
        return None
    plant, fixed = begun
    return plant, plant + drag(coefficient=0.0), fixed


def beside_straight(
    now: FitResult, fits: JointFits, addable: Sequence[type[Effect]], below: float = math.inf
) -> list[Rough]:
    """A rough fit with a drag beside friction that does not stand for one, where that of the plant does, and the
    tangent of a drag shows nothing; see `JointFits.roughly` for `below`."""
    if (begun := straight(now, addable)) is None:
        return []
    _, plant, fixed = begun
    misfit, x = now.misfit.onto(plant, now.vector, fits.few, fixed=fixed)
    x = refined(misfit, nudge(misfit, x, below=below), below=below)
    return [(DRAG, *misfit.onto(misfit.plant(x), x))]


def for_stuck(now: FitResult, addable: Sequence[type[Effect]], below: float = math.inf) -> list[Rough]:
    """A rough fit with a spring in the place of elements of friction that slip in no record, beside which its tangent
    shows nothing; see `JointFits.roughly` for `below`."""
    begun = spring_instead(now) if SPRING in [e.name for e in addable] else None
    if begun is None:
        return []
    misfit, x = begun
    return [(SPRING, misfit, refined(misfit, nudge(misfit, x, below=below), below=below))]


def beside_following(now: FitResult, fits: JointFits, addable: Sequence[type[Effect]]) -> list[Rough]:
    """Rough fits with what modulates friction, seen beside friction that follows its level, if that leaves less."""
    if (near := following(now)) is None:
        return []
    screen, least = Screen(near.misfit, near.vector), left_of(now.misfit, now.vector)
    share = (1 - LEAST_SHARE) * least / max(left_of(near.misfit, near.vector), 1e-300)
    seen = [screen.candidate(e) for e in addable if e.modulates]
    return [(c.effect.name, *fits.roughly(near, c)) for c in seen if c is not None and 1 - c.gain < share]


def afresh(now: FitResult, fits: JointFits, candidates: Sequence[Candidate], report: Progress = silent) -> list[Rough]:
    """Rough fits from the beginning with each of the candidates, of those that leave less.

    A plant that has bent far to hide an effect may not find back from where it is, and no linear refit promises then
    what the effect would explain.
    """
    near, there = now.misfit.onto(now.plant, now.vector, fits.few)
    cost = near.cost(there)
    out = []
    for c in candidates:
        report(0.9, f"trying {c.effect.name} from the beginning")
        begun = fits.afresh(now.plant, c.effect, fits.forms(c.effect, now.plant), cost)
        out += [(c.effect.name, m, x) for m, x in begun if m.cost(x) < cost]
    return out
