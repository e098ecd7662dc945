"""How many elements friction needs."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from . import effects
from .effect import Effect
from .errors import ModelError
from .fit import fit_observations
from .fit_result import FitResult
from .identification.linear_model import cross_validated
from .identification.observe import Data, driven, expect_enough, is_enough, observe
from .identification.refine import finished
from .plant import Plant
from .progress import Progress, silent

COUNTS = (1, 2, 3, 4, 6, 8)


def choose_elements(
    plant: Plant,
    data: Sequence[Data],
    counts: Sequence[int] = COUNTS,
    *,
    fixed: Collection[str] = (),
    progress: Progress | None = None,
) -> FitResult:
    """The fit with as few friction elements as the data ask for.

    Each count is fitted; of those whose error on held-out blocks is within a standard error of the least the smallest
    is taken (Hastie, Tibshirani and Friedman, The Elements of Statistical Learning, section 7.10).

    Args:
        plant: with `gms` whose stiffnesses have no value yet.
        data: runs and frequency responses to fit.
        counts: to try, rising.
        fixed, progress: see `fit`.

    Raises:
        ModelError: the plant has no `gms`, or its elements have values.
        DataError: nothing to fit.
    """
    if "gms" not in plant or "stiffness" not in plant["gms"].unset:
        raise ModelError("the number of elements is chosen for gms friction whose stiffness has no value yet")
    if not len(counts):
        raise ModelError("no number of elements to choose from; counts = (4, 6, 8), say")
    report = progress or silent
    driven(plant, data).expect_names(fixed)
    observations = observe(data, plant.inertia)
    expect_enough(observations, plant.replace(_with(plant["gms"], min(counts))), fixed)
    found: list[tuple[FitResult, float, float]] = []
    for i, n in enumerate(counts):
        report(i / len(counts), f"{n} element{'s' if n > 1 else ''}")
        tried = plant.replace(_with(plant["gms"], n))
        if n > min(counts) and not is_enough(observations, tried, fixed):
            break
        result = fit_observations(tried, observations, fixed)
        blocks = cross_validated(result.misfit, result.vector).squares
        found.append((result, float(blocks.mean()), float(blocks.std() / np.sqrt(len(blocks)))))
        if i > 1 and found[-1][1] > found[-2][1] > found[-3][1]:
            break  # more only follow the noise
    _, least, spread = min(found, key=lambda f: f[1])
    chosen = finished(next(result for result, error, _ in found if error <= least + spread))
    report(1.0, chosen.status)
    return chosen


def _with(gms: Effect, elements: int) -> Effect:
    kept = {p.name: gms.values[p.name] for p in gms.parameters if not p.per_element and p.name not in gms.unset}
    return effects.find("gms")(elements, **kept)
