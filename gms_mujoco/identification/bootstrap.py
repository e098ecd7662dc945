"""Bootstrap: intervals of a fit from refits to records whose residuals have other signs.

The intervals of `fit` hold where the model is nearly linear in its parameters over their width. Refits need no such
step, and show where an estimate stands at a bound. Each refit sees the torque that the fitted plant needs plus the
residual of the fit, its sign drawn anew for each block of time: neighbouring residuals, which are alike, keep together,
and each keeps its size.
Source: Wu, Annals of Statistics 14 (1986); over blocks, Cameron, Gelbach and Miller, Review of Economics and Statistics
90 (2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..fit_result import FitResult
from ..plant import Plant
from ..record import Record
from .coordinates import Coordinates
from .least_squares import nudge
from .misfit import Misfit
from .observe import loaded, observe
from .refine import finished, refine
from .time_steps import as_fitted

Array = NDArray[np.float64]

BLOCK = 0.25  # s, as for the intervals of `fit`
_FEWEST = 8


def refit(plant: Plant, records: Sequence[Record], bandwidth: float) -> FitResult:
    """The fit to records that is next to `plant`.

    Args:
        plant: a fit to the same or to similar records.
        records: SI units.
        bandwidth: [Hz].
    """
    misfit = Misfit(plant, as_fitted(observe(loaded(records, plant), plant.inertia, bandwidth), plant.provenance))
    return finished(refine(misfit, nudge(misfit, misfit.vector(plant))))


def residuals(found: FitResult, records: Sequence[Record]) -> list[Array]:
    """(n,) residual at every sample of each record [N m]."""
    parts = np.split(found.misfit.residual(found.vector), found.misfit.splits)
    seen = found.misfit.observations
    return [np.interp(np.arange(len(r)), o.index, p) for r, o, p in zip(records, seen, parts, strict=True)]


def redrawn(
    records: Sequence[Record], residual: Sequence[Array], block: float, rng: np.random.Generator
) -> list[Record]:
    """The records with the sign of their residual drawn anew for each block.

    Args:
        records: that were fitted.
        residual: (n,) of each [N m].
        block: length of the blocks [s].
        rng: draws the signs.

    Raises:
        DataError: fewer than 8 blocks in all.
    """
    found, total = [], 0
    for r, left in zip(records, residual, strict=True):
        count = max(round(len(r) * r.sample_time / block), 1)
        total += count
        signs = rng.choice((-1.0, 1.0), size=count)
        place = np.minimum(np.arange(len(r)) * count // len(r), count - 1)
        found.append(r.with_signals({"torque": r.torque + (signs[place] - 1) * left}))
    if total < _FEWEST:
        raise DataError(f"a bootstrap needs at least {_FEWEST} blocks; blocks of {block:g} s give {total}")
    return found


def with_intervals(plant: Plant, refits: Sequence[Plant]) -> Plant:
    """The plant with 95 % intervals and covariance from refits: percentiles of each value.

    Args:
        plant: the fit to all data.
        refits: with the same effects and elements.
    """
    numbers = [p.numbers() for p in refits]
    intervals = {}
    for name in plant.uncertainty:
        low, high = np.percentile([n[name][0] for n in numbers], (2.5, 97.5))
        intervals[name] = (float(low), float(high))
    coordinates = Coordinates(plant, [b.label for b in Coordinates(plant).blocks if b.labels[0] not in intervals])
    scatter = np.atleast_2d(np.cov(np.array([coordinates.encode(p) for p in refits]).T))
    return replace(
        plant,
        uncertainty=intervals,
        covariance=dict(zip(coordinates.labels, map(tuple, scatter.tolist()), strict=True)),
        provenance={**plant.provenance, "intervals": f"percentiles of {len(refits)} refits to redrawn residuals"},
    )
