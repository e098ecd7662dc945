"""Moments at which friction goes another way than its law says: it is off until it has slipped again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..fit_result import FitResult, result_of
from ..identification.held_out import HeldOut
from ..identification.inverse import Observation
from ..identification.misfit import Misfit
from ..identification.refine import finish, finished, refined
from .judgement import AT_FLOOR, at_floor, floor_of

Array = NDArray[np.float64]

_BLOCK = 10.0  # of the shortest periods in the band: so finely the beginning of a moment is looked for
_LOUD = 4.0  # times what is left of most blocks
_AFTER = 2  # blocks from there on that are left out
_NAMED = 4  # moments
_SHORTEST = 8  # blocks that tell more than the state they begin with


def has_moments(now: FitResult, left: HeldOut) -> bool:
    """Whether few blocks hold most of what a fit leaves above the noise, of what it leaves on held-out blocks."""
    return not at_floor(now, left) and len(left.moments(floor_of(now))) > 0


def between(misfit: Misfit, x: Array) -> list[Observation]:
    """The records of a misfit, cut where what it leaves begins to be loud: what elements carry from then on is unknown,
    as it is before a record.

    Args:
        misfit, x: of records, and where to look.
    """
    out = []
    for o, begins, length in _begins(misfit, x):
        parts = zip([0, *(begins + _AFTER * length)], [*begins, len(o.record)], strict=True)
        out += [o.part(a, b) for a, b in parts if b - a >= _SHORTEST * length]
    return out


def refit_between(misfit: Misfit, x: Array) -> tuple[Misfit, Array]:
    """The same fit to the records between their moments; to whole ones where nothing is left of them."""
    calm = Misfit(misfit.plant(x), between(misfit, x) or misfit.observations)
    return calm, refined(calm, calm.vector(calm.coordinates.template, skew=misfit.skew(x)))


def unbent(found: FitResult) -> tuple[FitResult, str]:
    """A fit at its end, to the records between their moments, as it is on whole ones, and since when these are off; the
    fit to whole records at its end and "" where more than noise is left between them, or nothing of it is loud.

    What no law of friction does bends the parameters of one that has to do it.
    """
    begins = list(_begins(found.misfit, found.vector))
    when = [f"{o.record.time[i]:.3g} s in {o.name}" for o, samples, _ in begins for i in samples]
    if not when:
        return finished(found), ""
    calm = finish(*refit_between(found.misfit, found.vector))
    if calm.error > AT_FLOOR * calm.floor:
        return finished(found), ""
    whole, x = found.misfit.onto(calm.plant, found.vector, skew=calm.misfit.skew(calm.vector))
    there = result_of(whole, whole.settle(x))
    provenance = {**calm.plant.provenance, **there.plant.provenance}
    more = f" and {len(when) - _NAMED} times more" if len(when) > _NAMED else ""
    said = (
        f"from single moments on, at {', '.join(when[:_NAMED])}{more}, where something pushed, or friction goes "
        "another way than its law until it has slipped again; between them, where the plant was fitted, "
        f"{100 * calm.error:.2g} % is left, with a noise floor of {100 * calm.floor:.2g} %"
    )
    return replace(there, plant=replace(calm.plant, provenance=provenance)), said


def _begins(misfit: Misfit, x: Array) -> Iterator[tuple[Observation, NDArray[np.intp], int]]:
    """Of each record the samples at which what is left begins to be loud, and the length of the blocks that say so."""
    for o, r in zip(misfit.observations, np.split(misfit.residual(x), misfit.splits), strict=True):
        assert isinstance(o, Observation)
        rows = min(o.rows_per_block(_BLOCK / o.bandwidth), len(r))
        n = len(r) // rows
        left = np.sqrt(np.mean(r[: n * rows].reshape(n, rows) ** 2, 1))
        loud = left > _LOUD * np.median(left)
        yield o, o.index[rows * np.flatnonzero(loud & ~np.append(False, loud[:-1]))], rows * o.stride
