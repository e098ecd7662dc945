"""Trials beside each other and beside friction: how likely chance alone is, and which of them stand for another."""

from __future__ import annotations

from collections.abc import Sequence

from ..effect import LOADED
from ..fit_result import FitResult
from ..identification.candidates import CONTAINED_LAWS, GENERAL_LAWS, is_part_of_wave
from ..identification.frf_observation import Seen
from ..identification.held_out import HeldOut, p_value
from ..identification.inverse import Observation
from ..identification.linear_model import cross_validated
from ..identification.refine import refine
from .joint_fits import Rough
from .judgement import (
    CLOSE,
    FALSE_DISCOVERY_RATE,
    Trial,
    floor_of,
    left_of,
    takes,
    takes_in_part,
    with_curve,
    without,
)

_SURELY = 4.0  # times the cost with an effect: without it much more is left


def p_beside(base: FitResult, before: HeldOut, trial: Trial) -> float:
    """p value of an effect that was added to a fit, which leaves so much on held-out blocks."""
    return max(p_value(before, trial.held_out), _beyond_speed(base, before, trial))


def _beyond_speed(base: FitResult, before: HeldOut, trial: Trial) -> float:
    """p value of an effect that changes friction, where friction is any function of speed; 0 for other effects.

    What a sensor reads wrong is the speed of friction too. A curve that predicts blocks not seen worse than none is
    nothing to beat, and with the effect no better than the effect alone.
    """
    effect = trial.result.plant[trial.name]
    timed = any(isinstance(o, Observation) for o in base.misfit.observations)
    if not (effect.modulates or effect.kind == "sensor") or not timed:
        return 0.0
    curved = with_curve(base)
    if curved.total >= before.total:
        return 0.0
    return p_value(curved, min(trial.held_out, with_curve(trial.result), key=lambda h: h.total))


def is_needless(name: str, last: FitResult, held_out: HeldOut) -> bool:
    """Whether an effect that was chosen beside another curve of friction earns no place beside this one.

    Args:
        name: of the effect.
        last: a fit with it.
        held_out: what that leaves on held-out blocks.
    """
    alone = refine(*without(last, name), below=_SURELY * last.misfit.cost(last.vector))
    left = cross_validated(alone.misfit, alone.vector)
    floor = min(floor_of(alone), floor_of(last))
    earned = takes(left.total, held_out.total, floor) or takes_in_part(alone, left, last, held_out)
    return not (earned and p_value(left, held_out) < FALSE_DISCOVERY_RATE)


def beside_load(earned: Sequence[Trial], seen: Sequence[Seen]) -> list[Trial]:
    """The trials without friction that varies along a part of a wave, where a load that was logged leaves hardly more:
    that varies over the place too, and says by itself how."""
    loaded = next((t for t in earned if t.name == LOADED), None)
    if loaded is None:
        return list(earned)

    def stands_for_load(t: Trial) -> bool:
        close = loaded.held_out.total < CLOSE * t.held_out.total
        return close and is_part_of_wave(t.result.plant[t.name], seen)

    return [t for t in earned if not stands_for_load(t)]


def beside_contained(earned: Sequence[Trial]) -> list[Trial]:
    """The trials without the general laws of friction, where one that they contain leaves hardly more: all that is
    missing may be that."""
    left = min((t.held_out.total for t in earned if t.name in CONTAINED_LAWS), default=float("inf"))
    return [t for t in earned if t.name not in GENERAL_LAWS or CLOSE * t.held_out.total < left]


def surer(rough: Sequence[Rough], ends: Sequence[Rough], p_values: dict[str, float]) -> list[Rough]:
    """The simplest of the rough fits that the screen is surest of, where none as simple that is fitted to its end is.

    A strong effect is tried from the beginning, and its rough fit may owe to that start what it leaves less than one
    that goes on from a plant that has bent; and of two that do much the same the simpler says more.
    """
    least = min((p_values[name] for name, *_ in rough), default=1.0)
    if least > FALSE_DISCOVERY_RATE:
        return []
    sure = [r for r in rough if p_values[r[0]] <= least]
    simplest = min(sure, key=lambda r: (r[1].size, left_of(r[1], r[2])))
    known = any(p_values[r[0]] <= least and r[1].size <= simplest[1].size for r in ends)
    return [] if known else [simplest]
