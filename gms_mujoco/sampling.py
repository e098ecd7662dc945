"""sample: plants drawn from the uncertainty of an identified one, for domain randomisation."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from numbers import Integral

import numpy as np
import scipy
from numpy.typing import NDArray

from .effect import KINDS
from .errors import DataError, ModelError, is_number, listing
from .identification.coordinates import Coordinates
from .plant import Plant, plant_of

Array = NDArray[np.float64]

_SIGMAS = 1.96  # half a 95 % interval
_VAGUE = 10.0  # times the value: where there is no natural zero an interval that reaches further says nothing


def sample(
    plant: Plant | str | os.PathLike[str],
    n: int,
    rng: np.random.Generator | int | None = None,
    *,
    kinds: Collection[str] = KINDS,
    outside: bool = False,
) -> list[Plant]:
    """Plants as the data of a fit allow them.

    Each parameter that has a 95 % interval is normal on the scale on which a fit moves it (logarithmic where it has no
    natural zero), cut at 1.96 standard deviations: the ends of the interval, or inside it where few blocks of data make
    it wider. Where the plant has the covariance of its fit, as `fit` leaves it
    and `model.toml` keeps it, the parameters are drawn together: a normal copula with its correlations. From intervals
    alone they are independent. Bounds hold, shares sum to 1, and what data leave open by more than a factor of ten
    either way is drawn within that factor of its value.

    Args:
        plant: as a fit leaves it, every parameter set; or its file, or a name out of models/.
        n: how many.
        rng: a generator, or a seed.
        kinds: of the effects that are drawn, see `Effect.kind`; the inertia is drawn with "mechanics".
        outside: draw from beyond the intervals, up to half their width further: for tests on plants that training has
            not seen.

    Returns:
        n plants with the effects and elements of `plant`; they have no intervals of their own.

    Raises:
        ModelError: nothing of these kinds has an interval, a parameter has no value, or an argument cannot be.
        DataError: `rng` is neither a generator nor a seed.
    """
    wrong = [kinds] if isinstance(kinds, str) else [kind for kind in kinds if kind not in KINDS]
    if wrong:
        raise ModelError(f"kinds is a list out of {listing(KINDS)}; {wrong[0]!r} given")
    if not is_number(n, Integral) or n < 0:
        raise ModelError(f"n must be a whole number from 0 on; {n!r} given")
    plant = plant_of(plant).complete()
    rng = generator(rng)
    among = {e.name for e in plant.effects if e.kind in kinds} | ({"inertia"} if "mechanics" in kinds else set())
    together = _together(plant, among)
    done = {label for b in together.blocks for label in b.labels}
    numbers = plant.numbers()
    alone = [k for k in plant.uncertainty if k in numbers and k.partition(".")[0] in among and k not in done]
    if not together.size and not alone:
        raise ModelError(f"sampling needs 95 % intervals, as a fit writes them; of {listing(kinds)} none has one")
    sigma, root = _scatter(plant, together)
    x, (lower, upper) = together.encode(plant), together.bounds
    if outside:
        sigma = np.maximum(sigma, _half_widths(plant, together, x) / _SIGMAS)
    out = []
    for _ in range(n):
        drawn = plant
        if together.size:
            z = root @ rng.standard_normal(len(x))
            drawn = together.decode(np.clip(x + _SIGMAS * sigma * _cut(z, outside), lower, upper))
        shares = _cut(rng.standard_normal(len(alone)), outside)
        drawn = _within_intervals(drawn, plant, dict(zip(alone, shares, strict=True)))
        told = {**plant.provenance, "sampled": f"drawn {'beyond' if outside else 'within'} the uncertainty of the fit"}
        out.append(replace(drawn, inertia_known=plant.inertia_known, uncertainty={}, covariance={}, provenance=told))
    return out


def generator(seed: np.random.Generator | int | None) -> np.random.Generator:
    """Random numbers from a seed, or those given; raises DataError where it is neither."""
    try:
        return np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise DataError(f"seed must be a whole number from 0 on, or None; {seed!r} given") from None


def _cut(z: Array, outside: bool) -> Array:
    """Standard normal numbers as shares of half an interval, in [-1, 1]; or beyond, in [-2, -1] and [1, 2]."""
    share = scipy.special.ndtri(0.025 + 0.95 * scipy.special.ndtr(z)) / _SIGMAS
    return np.asarray(share + np.copysign(1.0, share) if outside else share)


def _together(plant: Plant, among: Collection[str]) -> Coordinates:
    """The coordinates whose covariance is at hand, of effects `among`."""
    everything = Coordinates(replace(plant, inertia_known="inertia" not in plant.covariance))
    missing = [
        b.label
        for b in everything.blocks
        if (b.effect or "inertia") not in among or not all(k in plant.covariance for k in b.labels[: b.size])
    ]
    return Coordinates(everything.template, missing)


def _half_widths(plant: Plant, coordinates: Coordinates, x: Array) -> Array:
    """(size,) from each coordinate to the upper end of its interval; 0 for shares, which have none of their own."""
    out = np.zeros(coordinates.size)
    for i, label in enumerate(coordinates.labels):
        b = next(b for b in coordinates.blocks if label in b.labels)
        if b.scale != "share" and label in plant.uncertainty:
            top = np.array([plant.uncertainty[label][1]])
            if b.scale == "above":
                top = top - np.asarray(plant[b.effect].values[b.parameter.at_least], float)
            width = float(b.encode(top)[0]) - x[i]
            out[i] = width if math.isfinite(width) or b.scale == "log" else 0.0
    return np.where(coordinates.is_linear, out, np.minimum(out, math.log(_VAGUE)))


def _scatter(plant: Plant, coordinates: Coordinates) -> tuple[Array, Array]:
    """Standard deviations (size,), and a root (size, size) of the correlation matrix."""
    order = list(plant.covariance)
    at = [order.index(label) for label in coordinates.labels]
    matrix = np.array(list(plant.covariance.values()), float).reshape(len(order), len(order))[np.ix_(at, at)]
    sigma = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(sigma > 0, sigma, 1.0)
    value, vector = scipy.linalg.eigh(matrix / np.outer(scale, scale))
    root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T  # the one root that no sign of a vector changes
    length = np.sqrt((root**2).sum(axis=1, keepdims=True))  # 1 but for rounding: every marginal is standard normal
    sigma = np.where(coordinates.is_linear, sigma, np.minimum(sigma, math.log(_VAGUE) / _SIGMAS))
    return sigma, root / np.where(length > 0, length, 1.0)


def _within_intervals(plant: Plant, middle: Plant, draws: Mapping[str, float]) -> Plant:
    """`plant` with values that lie at `draws` half widths from the middle of their intervals."""
    for b in Coordinates(replace(middle, inertia_known=False), free_only=False).blocks:
        if not any(label in draws for label in b.labels):
            continue
        p = b.parameter
        before = plant[b.effect].values[p.name] if b.effect else plant.inertia
        value = np.atleast_1d(np.array(before, float))
        for i, label in enumerate(b.labels):
            if label in draws:
                value[i] = _placed(value[i], *middle.uncertainty[label], draws[label], b.scale == "log")
        value = np.clip(value, p.lower, p.upper)
        if not b.effect:
            plant = replace(plant, inertia=float(value[0]))
            continue
        e = plant[b.effect]
        if p.share:
            value = value / value.sum() if value.sum() > 0 else np.array(before, float)
        if p.at_least:
            value = np.maximum(value, np.asarray(e.values[p.at_least], float))
        changed = {p.name: value if p.per_element else float(value[0])}
        for q in e.parameters:  # those that this one is a lower bound for
            if q.at_least == p.name:
                changed[q.name] = np.maximum(np.asarray(e.values[q.name], float), value if q.per_element else value[0])
        plant = plant.replace(e.replace(**changed))
    return plant


def _placed(value: float, low: float, high: float, share: float, logarithmic: bool) -> float:
    if logarithmic and value > 0:
        low, high = (math.log(min(max(end, value / _VAGUE), value * _VAGUE)) for end in (low, high))
        return math.exp((low + high) / 2 + (high - low) / 2 * share)
    if not math.isfinite(high - low):
        return value
    return (low + high) / 2 + (high - low) / 2 * share
