"""Screening: what each effect of the catalogue could still explain, at the price of a few replays.

An effect that is weak adds its tangent to the torque: the derivative by its strength at strength zero, for each
value of its other parameters. What a joint refit would gain follows from these tangents once everything that the
plant itself could do (its own tangents) is projected out of them; a regression on the leftover residual is not the
same, because the plant has already bent to hide the effect (score test; Rao 1948).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from . import effects
from .effect import Effect
from .frf_observation import FrfObservation, Seen
from .intervals import block_sums
from .misfit import Misfit
from .parameter import Parameter
from .plant import Plant
from .scales import Scales
from .tall import gram, times

Array = NDArray[np.float64]

BLOCK = 0.5  # s; residuals further apart than this are taken as independent
FOLDS = 5
_ORDERS = 48  # harmonics tried per revolution
_STEP = 1e-3  # of the typical strength, for the derivative


@dataclass(frozen=True)
class Candidate:
    """An effect that could be added.

    Attributes:
        effect: with the values from which a joint fit starts.
        strong: the same at a strength that is not small, for an effect that does then nothing like its tangent.
        gain: share of the squared residual that it explains, after a joint linear refit.
        held_out: (blocks,) squared residual of each block, predicted without that block [N^2 m^2].
    """

    effect: Effect
    gain: float
    held_out: Array
    strong: Effect | None = None


class Screen:
    """Scores effects against one fitted plant.

    Every unknown of the plant may follow a candidate, but only as far as its tangent means something: unknowns
    that the data hardly sees would otherwise take any distance and hide what they cannot really do.

    Args:
        misfit, vector: the plant's least-squares problem and its solution.
    """

    def __init__(self, misfit: Misfit, vector: Array) -> None:
        self.misfit, self.vector = misfit, vector
        self.plant = misfit.coordinates.decode(vector[: misfit.coordinates.size])
        self.residual = misfit.residual(vector)
        self.scales = Scales.of(misfit.observations)
        self.model = LinearModel(misfit, vector, self.residual)
        self.held_out = self.model.held_out()

    def candidate(self, effect: type[Effect]) -> Candidate | None:
        """The best way to add an effect; None where the data cannot show it (no motion, signal missing)."""
        # The best by its tangents, and the best at strengths that are not small.
        weak: tuple[float, Effect, Array] | None = None
        strong: tuple[float, Effect, Array] | None = None
        out_of_bounds: Effect | None = None
        for shape in shapes(effect, self.scales, self.misfit.observations):
            columns, names = self._tangents(effect, shape)
            free = self.model.without(columns)
            seen = (free**2).sum(0) > 1e-12 * (columns**2).sum(0).clip(1e-300)
            if not seen.any():
                continue
            strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
            if strength.any() and not strength[seen].all():  # the others must do without those out of bounds
                seen &= strength != 0
                strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
            seen &= strength != 0
            started = _started(effect, shape, names, -strength, self.scales)
            out_of_bounds = out_of_bounds or started
            if seen.any():
                gain = self._gain(free @ strength)
                if weak is None or gain > weak[0]:
                    weak = gain, started, columns[:, seen]
            for trial in _strong(effect, shape, self.scales):
                change = self._change(trial)[:, None]
                gain = self._gain(-self.model.without(change)[:, 0])
                if np.isfinite(gain) and (strong is None or gain > strong[0]):
                    strong = gain, trial, change
        found = sorted((s for s in (weak, strong) if s is not None), key=lambda s: -s[0])
        if not found:
            # It can be seen, but every strength that is allowed makes things worse.
            return Candidate(out_of_bounds, 0.0, self.held_out) if out_of_bounds else None
        gain, started, columns = found[0]
        share = gain / max(float(self.residual @ self.residual), 1e-300)
        return Candidate(started, share, self.model.held_out(columns), strong[1] if strong else None)

    def _gain(self, fitted: Array) -> float:
        """By how much the squared residual falls when `fitted` is taken from it."""
        return float(2 * fitted @ self.model.target - fitted @ fitted)

    def _change(self, effect: Effect) -> Array:
        """(m,) what adding the effect does to the residual while everything else stays."""
        moved = Misfit(self.plant + effect, self.misfit.observations)
        memories = self.misfit.memories(self.vector, moved.n_memory)
        at = moved.vector(self.plant + effect, memories, self.misfit.skew(self.vector))
        return moved.residual(at) - self.residual

    def _tangents(self, effect: type[Effect], shape: dict[str, float]) -> tuple[Array, list[tuple[str, float]]]:
        """(m, k) derivatives of the residual, and which strength and phase each belongs to."""
        if not strengths(effect):  # absent only at the end of its range: its whole change
            return self._change(_valued(effect, shape, {}))[:, None], [("", 0.0)]
        columns, names = [], []
        phases = (0.0, math.pi / 2) if has_phase(effect) else (0.0,)
        for p, phase in itertools.product(strengths(effect), phases):
            step = _STEP * self.scales[p.unit]
            trial = _valued(effect, {**shape, **({"phase": phase} if has_phase(effect) else {})}, {p.name: step})
            columns.append(self._change(trial) / step)
            names.append((p.name, phase))
        return np.stack(columns, 1), names

    @staticmethod
    def _allowed(effect: type[Effect], names: Sequence[tuple[str, float]], strength: Array) -> Array:
        """Strengths that are outside their bounds do nothing; a phase makes either sign possible."""
        if has_phase(effect):
            return strength
        lower = {"": 0.0} | {p.name: p.lower for p in effect.parameters}
        return np.array([0.0 if -s < lower[name] else s for (name, _), s in zip(names, strength, strict=True)])


def strengths(effect: type[Effect]) -> list[Parameter]:
    """Parameters at whose zero the effect is absent."""
    return [p for p in effect.parameters if p.default == 0 and p.free and p.name != "phase"]


def is_present(effect: Effect) -> bool:
    """Whether an effect is more than a name: its first strength, which it is named for, has not vanished."""
    first = strengths(type(effect))[:1]
    return all(np.any(np.abs(np.asarray(effect.values[p.name])) > 1e-12) for p in first)


def has_phase(effect: type[Effect]) -> bool:
    """Whether the effect is a harmonic with a free phase: two quadratures of one strength."""
    return any(p.name == "phase" for p in effect.parameters)


def shapes(effect: type[Effect], scales: Scales, observations: Sequence[Seen]) -> Iterator[dict[str, float]]:
    """Values to try for the parameters that are neither strengths nor phases."""
    grids: dict[str, Sequence[float]] = {}
    for p in effect.parameters:
        if p.name == "phase" or not math.isnan(p.default):
            continue
        values = _grid(p, 1 if effect.modulates else 2, scales, observations)
        grids[p.name] = [float(v) for v in np.clip(values, p.lower, p.upper)]
    for chosen in itertools.product(*grids.values()):
        yield dict(zip(grids, chosen, strict=True))


def _grid(p: Parameter, first: int, scales: Scales, observations: Sequence[Seen]) -> Sequence[float] | Array:
    """What a parameter may typically be, by its unit and what the records span."""
    if p.unit == "1/rev":
        # A torque once per revolution is gravity's. A harmonic that the motion does not pass through once cannot be
        # told from a spring or an offset.
        turn = max(float(np.ptp(o.position)) for o in observations) / (2 * math.pi)
        return [n for n in range(first, _ORDERS + 1) if n * turn >= 1]
    if p.unit == "Hz":
        return max(o.bandwidth for o in observations) * np.array([0.06, 0.12, 0.25, 0.5, 1.0])
    if p.unit == "s":
        return max(o.duration for o in observations) * np.array([0.05, 0.2, 0.8])
    if p.unit == "rad":
        return np.median([float(np.ptp(o.position)) for o in observations]) * np.array([0.003, 0.01, 0.03, 0.1])
    if p.unit == "N m":
        return max(float(np.abs(o.commands).max()) for o in observations) * np.array([0.5, 0.7, 0.85, 0.95])
    return scales[p.unit] * np.array([0.1, 1.0, 10.0])


def _valued(effect: type[Effect], values: dict[str, float], strength: dict[str, float]) -> Effect:
    """The effect with one element and some strengths; a parameter bounded below by one of them rises with it."""
    bounded = {p.name: strength[p.at_least] for p in effect.parameters if p.at_least in strength}
    merged = {**values, **bounded, **strength}
    per_element = {p.name for p in effect.parameters if p.per_element}
    arguments: dict[str, Any] = {k: [v] if k in per_element else v for k, v in merged.items()}
    return effect(**arguments)


def _strong(effect: type[Effect], shape: dict[str, float], scales: Scales) -> Iterator[Effect]:
    """The effect at strengths that are not small: what modulates friction does then nothing like its tangent."""
    if effect.modulates and not has_phase(effect):
        p = strengths(effect)[0]
        for share in (-0.3, -0.1, 0.1, 0.3):
            value = share * scales[p.unit]
            if p.lower <= value <= p.upper:
                yield _valued(effect, shape, {p.name: value})


def _started(
    effect: type[Effect], shape: dict[str, float], names: Sequence[tuple[str, float]], value: Array, scales: Scales
) -> Effect:
    """The effect at the strengths that the linear refit found, never quite zero so that a fit can move them."""
    found: dict[str, float] = {}
    phase: dict[str, float] = {}
    if has_phase(effect):
        name = names[0][0]
        upper = next(p.upper for p in effect.parameters if p.name == name)
        found[name] = min(math.hypot(value[0], value[1]), upper)
        phase["phase"] = math.atan2(value[1], value[0])
    elif strengths(effect):
        table = {p.name: p for p in effect.parameters}
        for (name, _), v in zip(names, value, strict=True):
            p = table[name]
            least = 1e-3 * scales[p.unit]
            found[name] = float(np.clip(v if abs(v) > least else least, p.lower, p.upper))
            if p.at_least:
                found[name] += found.get(p.at_least, 0.0)  # its tangent is what it is above that one
    return _valued(effect, {**shape, **phase}, found)


def _least_squares(columns: Array, target: Array, seen: NDArray[np.bool_]) -> Array:
    """Coefficients of `target` on the columns that are seen, zero for the others."""
    out = np.zeros(columns.shape[1])
    size = np.sqrt((columns[:, seen] ** 2).sum(0))
    scaled = columns[:, seen] / size
    out[seen] = np.linalg.lstsq(gram(scaled, scaled), gram(scaled, target), rcond=1e-12)[0] / size
    return out


class LinearModel:
    """A least-squares problem near its solution: residual + tangents * move, with a prior on the move.

    Args:
        misfit, vector, residual: the problem, its solution and the residual (m,) there.
    """

    def __init__(self, misfit: Misfit, vector: Array, residual: Array) -> None:
        self.observations = misfit.observations
        self.residual = residual
        tangents, reach = misfit.jacobian(vector, residual), misfit.reach(vector)
        held = misfit.held(vector, gram(tangents, residual))
        self.columns = np.flatnonzero(~held & ((tangents**2).sum(0) > 0))
        self.reach = reach[self.columns]
        self.tangents = tangents[:, self.columns] * self.reach
        # In units of its reach a move is a standard normal; the residual's size is its noise.
        self.prior = math.sqrt(float(np.mean(residual**2)))
        own = gram(self.tangents, self.tangents)
        self._normal = linalg.cho_factor(own + (self.prior**2 + 1e-300) * np.eye(len(own)))
        self.target = self.without(residual[:, None])[:, 0]

    def without(self, columns: Array) -> Array:
        """(m + p, k) columns (m, k), and a row for the prior of each unknown, without what the unknowns can do."""
        move = linalg.cho_solve(self._normal, gram(self.tangents, columns))
        return np.vstack([columns - times(self.tangents, move), -self.prior * move])

    def held_out(self, columns: Array | None = None) -> Array:
        """(blocks,) squared residual of each block of time, predicted by a refit without the blocks of its fold.

        Args:
            columns: (m, k) tangents of what is added.
        """
        added = np.empty((len(self.residual), 0)) if columns is None else columns
        # Everything that a refit needs to know of a block is its share of the normal equations.
        grams = _block_grams(self.observations, np.column_stack([self.tangents, self._scaled(added), self.residual]))
        p = grams.shape[1] - 1
        out = np.empty(len(grams))
        for blocks, move in self._folds(grams):
            for b in blocks:
                g = grams[b]
                out[b] = g[p, p] + 2 * move @ g[:p, p] + move @ g[:p, :p] @ move
        return out

    def _scaled(self, columns: Array) -> Array:
        return columns / np.sqrt(np.mean(columns**2, 0)).clip(1e-300)

    def _folds(self, grams: Array) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Blocks of each fold, and the move (p,) that fits the others best."""
        own, p = self.tangents.shape[1], grams.shape[1] - 1
        ridge = np.diag(np.append(np.full(own, self.prior**2), np.full(p - own, 1e-9 * len(self.residual))))
        total, fold = grams.sum(0), np.arange(len(grams)) % FOLDS
        for k in range(FOLDS):
            blocks = np.flatnonzero(fold == k)
            rest = total - grams[blocks].sum(0)
            yield blocks, -np.linalg.solve(rest[:p, :p] + ridge, rest[:p, p])


def cross_validated(misfit: Misfit, vector: Array) -> Array:
    """(blocks,) squared residual of each block of time, left by a refit without the blocks of its fold.

    The refit is one step of least squares from the solution, as far as it really helps the blocks it may see.

    Args:
        misfit, vector: a problem and its solution.
    """
    residual = misfit.residual(vector)
    model = LinearModel(misfit, vector, residual)
    grams = _block_grams(model.observations, np.column_stack([model.tangents, residual]))
    lower, upper = misfit.bounds
    out = np.empty(len(grams))
    for blocks, move in model._folds(grams):
        best, chosen = np.inf, np.empty(0)
        for share in (0.0, 0.1, 0.3, 1.0):
            moved = vector.copy()
            moved[model.columns] += share * move * model.reach
            there = misfit.residual(np.clip(moved, lower, upper)) if share else residual
            squares = block_sums(model.observations, there**2, BLOCK)
            seen = squares.sum() - squares[blocks].sum()
            if seen < best:
                best, chosen = seen, squares
        out[blocks] = chosen[blocks]
    return out


def _block_grams(observations: Sequence[Seen], columns: Array) -> Array:
    """(blocks, p, p) products of the columns, summed over each block of time."""
    ends = np.cumsum(block_sums(observations, np.ones((len(columns), 1)), BLOCK)[:, 0].astype(int))
    return np.stack([gram(c, c) for c in np.split(columns, ends[:-1])])


# Laws of which `gms` is the general form: beside it they have nothing of their own to add. It and `lugre` are no small
# change of anything else, and a plant without them was chosen so.
_SPECIAL_LAWS = ("coulomb", "stribeck", "dahl", "lugre", "gms")


# Effects that a frequency response cannot show: it has no clock, no load, and no place on the revolution.
_NEED_RECORDS = ("thermal_drift", "load_dependent_friction", "encoder_eccentricity", "position_dependent_friction")


def applicable(plant: Plant, observations: Sequence[Seen] = ()) -> list[type[Effect]]:
    """The effects of the catalogue that could be added to a plant.

    Not those that it has, not those contained in its friction, on a slide joint none that counts revolutions, and from
    frequency responses alone none that they cannot show.
    """
    contained = _SPECIAL_LAWS if "gms" in plant else ("gms", "lugre")
    if observations and all(isinstance(o, FrfObservation) for o in observations):
        contained = (*contained, *_NEED_RECORDS)
    out = {name: e for name, e in effects.CATALOGUE.items() if name not in plant and name not in contained}
    return [e for e in out.values() if plant.kind == "hinge" or not has_phase(e)]
