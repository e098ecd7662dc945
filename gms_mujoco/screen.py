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
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from . import effects
from .effect import Effect
from .frf_observation import FrfObservation, Seen
from .held_out import BLOCK, HeldOut
from .intervals import block_sums
from .inverse import Observation
from .misfit import Misfit, squared
from .parameter import Parameter
from .plant import Plant
from .scales import Scales
from .servo_observation import ServoObservation
from .tall import gram, times

Array = NDArray[np.float64]

FOLDS = 5
_ORDERS = 48  # harmonics tried per revolution
_FINER = (1.41, 1.19)  # factors between the values of a grid
_RESONANCES = 10  # frequencies tried over the range of responses
_TOGETHER = 6  # harmonics that may be added at once
_STANDS_OUT = 0.2  # of what the others leave of the squared residual, which one more must take
_MOSTLY = 0.5  # of the squared residual, which several together must not leave
_BLOWN_UP = 10.0  # times its squared residual in the fit: a block that is left out and holds two thirds of an unknown
_END = 0.99  # of the most that a strength may be
_STEP = 1e-3  # of the typical strength, for the derivative
_MOST_HIDDEN = 0.8  # of the inertia


@dataclass(frozen=True)
class Candidate:
    """An effect that could be added.

    Attributes:
        effect: with the values from which a joint fit starts.
        gain: share of the squared residual that it explains, after a joint linear refit.
        held_out: what is left of each block, predicted without that block.
        strong: the same at a strength that is not small, for an effect that does then nothing like its tangent.
        columns: (m, k) what it does to the residual.
    """

    effect: Effect
    gain: float
    held_out: HeldOut
    strong: Effect | None = None
    columns: Array | None = None


@dataclass
class _Best:
    """The best so far by tangents, and at strengths that are not small: gain, effect, columns."""

    weak: tuple[float, Effect, Array] | None = None
    strong: tuple[float, Effect, Array] | None = None
    shape: dict[str, float] | None = None  # of the best by its tangents
    tried: list[tuple[dict[str, float], list[tuple[str, float]], Array, Array]] = field(default_factory=list)
    out_of_bounds: Effect | None = None


def joined(plant: Plant, effect: Effect) -> Plant:
    """The plant with an effect added, or with its elements added to those that the plant has of it.

    A body behind a coupling is a part of the axis: it begins with at most `_MOST_HIDDEN` of what moves with the joint.
    """
    most = _MOST_HIDDEN * plant.driven_inertia if plant.inertia else math.inf
    if effect.hidden_inertia > most:
        effect = effect.replace(inertia=most)
    return plant.replace(_merged(plant[effect.name], effect)) if effect.name in plant else plant + effect


def _merged(one: Effect, other: Effect) -> Effect:
    """An effect with the elements of both."""
    own = {p.name for p in one.parameters if p.per_element}
    more = {k: (*np.atleast_1d(v), *np.atleast_1d(other.values[k])) for k, v in one.values.items() if k in own}
    return one.replace(**more)


def grows(effect: type[Effect]) -> bool:
    """Whether an effect is a series of harmonics, to which one more can be added."""
    return any(p.unit == "1/rev" and p.per_element for p in effect.parameters)


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
        self._left = float(self.model.residual @ self.model.residual)
        self._delivered = misfit.delivered(vector)
        self.held_out = self._predicted(None, 1.0)

    def candidate(self, effect: type[Effect]) -> Candidate | None:
        """The best way to add an effect; None where the data cannot show it (no motion, signal missing).

        An effect of several elements that the plant has already is given one more.
        """
        best = _Best()
        tried = list(shapes(effect, self.scales, self.misfit.observations, self.plant))
        for shape in tried:
            self._try(best, effect, shape)
        # Between the values of the grid, as far as the best by its tangents leads.
        for factor in _FINER:
            for name in [k for k in (best.shape or {}) if _is_continuous(effect, k)]:
                assert best.shape is not None
                around = best.shape
                for by in (factor, 1 / factor):
                    table = {p.name: p for p in effect.parameters}[name]
                    value = float(np.clip(around[name] * by, table.lower, table.upper))
                    self._try(best, effect, {**around, name: value})
        if best.weak is None and best.strong is None:
            # It can be seen, but every strength that is allowed makes things worse.
            return Candidate(best.out_of_bounds, 0.0, self.held_out) if best.out_of_bounds else None
        if best.weak is not None and grows(effect) and self._goes_round:
            best.weak = self._series(best, effect)
        gain, started, columns = max((s for s in (best.weak, best.strong) if s is not None), key=lambda s: s[0])
        share = max(gain, 0.0) / max(self._left, 1e-300)
        strong = best.strong[1] if best.strong else None
        return Candidate(started, share, self._predicted(columns, self._kept(started)), strong, columns)

    def together(self, one: Candidate, other: Candidate) -> HeldOut:
        """What two candidates leave of each block, predicted without that block."""
        both = [c.columns for c in (one, other) if c.columns is not None]
        return self._predicted(np.column_stack(both), self._kept(one.effect) * self._kept(other.effect))

    def _predicted(self, columns: Array | None, kept: float) -> HeldOut:
        """What is left of each block with some columns more, for a drive that delivers everything."""
        rows = self.model.held_out(columns) / math.sqrt(self._delivered * kept)
        return HeldOut(rows, self.misfit.observations)

    @property
    def _goes_round(self) -> bool:
        """Whether a record turns once: on less, harmonics together are any curve over the position."""
        return max(float(np.ptp(o.position)) for o in self.misfit.observations) >= 2 * math.pi

    def _series(self, best: _Best, effect: type[Effect]) -> tuple[float, Effect, Array]:
        """The harmonics that stand out, together, if most of what is missing is theirs; else the best one.

        With one of many a model is hardly better than with none, and where the others act it is worse. More of a series
        that is there already need not be most of what is missing.
        """
        assert best.shape is not None and best.weak is not None
        begun = effect.name in self.plant
        least = _STANDS_OUT / 4 if begun else _STANDS_OUT
        shape = best.shape
        chosen = [next(t for t in best.tried if t[0] == shape)]
        others = [t for t in best.tried if t[0] != shape]
        while True:
            basis = linalg.orth(np.column_stack([free for *_, free in chosen]))
            left = self.model.target - basis @ (basis.T @ self.model.target)
            if not others or len(chosen) == _TOGETHER:
                break
            gains = [_projected(free - basis @ (basis.T @ free), left) for *_, free in others]
            k = int(np.argmax(gains))
            if gains[k] < least * float(left @ left):
                break
            chosen.append(others.pop(k))
        if len(chosen) == 1 or (not begun and float(left @ left) > _MOSTLY * self._left):
            return best.weak
        free, columns = np.column_stack([t[3] for t in chosen]), np.column_stack([t[2] for t in chosen])
        strength = -_least_squares(free, self.model.target, (free**2).sum(0) > 0)
        found: Effect | None = None
        for (of, names, _, _), pair in zip(chosen, strength.reshape(len(chosen), -1), strict=True):
            one = _started(effect, of, names, pair, self.scales)
            found = one if found is None else _merged(found, one)
        assert found is not None
        return (self._left - float(left @ left), found, columns)

    def _try(self, best: _Best, effect: type[Effect], shape: dict[str, float]) -> None:
        """Scores an effect with one choice of its other parameters; `best` keeps it where it is better."""
        columns, names = self._tangents(effect, shape)
        free = self.model.without(columns)
        seen = (free**2).sum(0) > 1e-12 * (columns**2).sum(0).clip(1e-300)
        # What does nothing at a strength that would matter is nothing but rounding.
        typical = np.array([self.scales[u] for u in _units(effect, names)])
        seen &= typical * np.sqrt((columns**2).sum(0)) > 1e-6 * math.sqrt(self._left)
        if not seen.any():
            return
        strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
        if strength.any() and not strength[seen].all():  # the others must do without those out of bounds
            seen &= strength != 0
            strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
        seen &= strength != 0
        started = _started(effect, shape, names, -strength, self.scales)
        best.out_of_bounds = best.out_of_bounds or started
        if seen.any():
            if grows(effect):
                best.tried.append((shape, names, columns, free))
            gain = self._compared(self._gain(free @ strength), started)
            if best.weak is None or gain > best.weak[0]:
                best.weak, best.shape = (gain, started, columns[:, seen]), shape
        for trial in _strong(effect, shape, self.scales):
            change = self._change(trial)[:, None]
            gain = self._compared(self._gain(-self.model.without(change)[:, 0]), trial)
            if np.isfinite(gain) and (best.strong is None or gain > best.strong[0]):
                best.strong = gain, trial, change

    def at(self, effect: type[Effect], shape: dict[str, float]) -> tuple[Effect, Array, HeldOut] | None:
        """An effect of one shape as strong as in a linear refit; what it does to the residual (m,), and what is left of
        each block not seen. None where it cannot be seen."""
        columns, names = self._tangents(effect, shape)
        free = self.model.without(columns)
        seen = (free**2).sum(0) > 1e-12 * (columns**2).sum(0).clip(1e-300)
        if not seen.any():
            return None
        strength = -_least_squares(free, self.model.target, seen)
        return _started(effect, shape, names, strength, self.scales), columns @ strength, self._predicted(columns, 1.0)

    def shape(self, torque: Array) -> tuple[float, float, HeldOut]:
        """Gain, strength, and what is left of each block not seen, of a torque (m,) that has one strength."""
        columns = (torque * self.model.determined)[:, None]
        free = self.model.without(columns)
        seen = (free**2).sum(0) > 1e-12 * (columns**2).sum(0).clip(1e-300)
        if not seen.any():
            return 0.0, 0.0, self.held_out
        strength = _least_squares(free, self.model.target, seen)
        gain = self._gain(free @ strength) / max(self._left, 1e-300)
        return gain, -float(strength[0]), self._predicted(columns, 1.0)

    def _gain(self, fitted: Array) -> float:
        """By how much the squared residual falls when `fitted` is taken from it."""
        return squared(self.model.target) - squared(self.model.target - fitted)

    def _kept(self, effect: Effect) -> float:
        """Share of what the drive of the plant delivers that it still delivers with one effect more."""
        if type(effect).deliver is Effect.deliver:
            return 1.0
        moved = Misfit(joined(self.plant, effect), self.misfit.observations)
        return moved.delivered(moved.vector(joined(self.plant, effect))) / self._delivered

    def _compared(self, gain: float, effect: Effect) -> float:
        """The gain when what is left is compared with what the drive then delivers."""
        return self._left - (self._left - gain) / self._kept(effect)

    def _change(self, effect: Effect) -> Array:
        """(m,) what adding the effect does to the residual while everything else stays."""
        change = self.misfit.change(self.vector, joined(self.plant, effect), effect.name)
        return change * self.model.determined

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


def is_possible(effect: Effect) -> bool:
    """Whether an effect is what it is called: not at the end of what its strengths may be, where something else would
    want it stronger still; and a resonance that is damped so far that it is none only where its default is that."""
    table = {p.name: p for p in effect.parameters}
    bounded = [p for p in strengths(type(effect)) if p.upper < math.inf]
    inside = all(np.all(np.asarray(effect.values[p.name]) < _END * p.upper) for p in bounded)
    damping = table.get("damping")
    return inside and (damping is None or damping.default >= 1 or float(np.ravel(effect.values["damping"])[0]) < 1)


def absent(effect: Effect) -> Effect:
    """The effect at strengths of zero; itself where it has none."""
    return effect.replace(**{p.name: 0 * np.asarray(effect.values[p.name]) for p in strengths(type(effect))})


def has_phase(effect: type[Effect]) -> bool:
    """Whether the effect is a harmonic with a free phase: two quadratures of one strength."""
    return any(p.name == "phase" for p in effect.parameters)


def shapes(
    effect: type[Effect], scales: Scales, observations: Sequence[Seen], plant: Plant | None = None
) -> Iterator[dict[str, float]]:
    """Values to try for the parameters that are neither strengths nor phases; no harmonic that `plant` has."""
    grids: dict[str, Sequence[float]] = {}
    for p in effect.parameters:
        if p.name == "phase" or not math.isnan(p.default):
            continue
        values: Sequence[float] | Array = _grid(effect, p, scales, observations)
        if plant is not None and effect.name in plant:
            values = [v for v in values if v not in np.atleast_1d(plant[effect.name].values[p.name])]
        grids[p.name] = [float(v) for v in np.clip(values, p.lower, p.upper)]
    for chosen in itertools.product(*grids.values()):
        yield dict(zip(grids, chosen, strict=True))


def _grid(
    effect: type[Effect], p: Parameter, scales: Scales, observations: Sequence[Seen]
) -> Sequence[float] | Array:
    """What a parameter may typically be, by its unit and what the records span."""
    span = float(np.median([np.ptp(o.position) for o in observations]))
    if p.unit == "1/rev":
        # A torque once per revolution is gravity's. A harmonic that the motion does not pass through once cannot be
        # told from a spring or an offset.
        turn = max(float(np.ptp(o.position)) for o in observations) / (2 * math.pi)
        return [n for n in range(1 if effect.modulates else 2, _ORDERS + 1) if n * turn >= 1]
    if p.unit == "Hz":
        highest = max(o.bandwidth for o in observations)
        # A contact that knocks is heard at any stiffness; a resonance only at its own frequency.
        if any(q.unit == "rad" for q in effect.parameters):
            return np.minimum([30.0, 60.0, 120.0], [0.3 * highest, highest, highest])
        frfs = [o.frf.frequency for o in observations if isinstance(o, FrfObservation)]
        if len(frfs) == len(observations):
            return np.geomspace(1.5 * min(f[0] for f in frfs), highest / 1.5, _RESONANCES)
        return highest * np.array([0.06, 0.12, 0.25, 0.5, 1.0])
    if p.unit == "s":
        return max(o.duration for o in observations) * np.array([0.05, 0.2, 0.8])
    if p.unit == "rad":
        finest = max(3 * max(_count(o) for o in observations), 1e-4 * span)
        return np.geomspace(finest, max(0.1 * span, 2 * finest), 9)
    if p.unit == "N m" and effect.kind == "drive":
        return max(float(np.abs(o.commands).max()) for o in observations) * np.array([0.5, 0.7, 0.85, 0.95])
    if p.unit == "N m":
        return scales.torque * np.array([0.2, 0.6])
    if p.unit == "N m/rad":  # of a contact: it slips after a small part of the motion
        return scales.torque / (span * np.array([1e-4, 1e-3, 1e-2]))
    return scales[p.unit] * np.array([0.1, 1.0, 10.0])


def _count(o: Seen) -> float:
    """Position of one encoder count; 0 where there is none or it is not known."""
    return (o.record.resolution or 0.0) if isinstance(o, Observation) else 0.0


def _is_continuous(effect: type[Effect], name: str) -> bool:
    return any(p.name == name and p.unit in ("Hz", "rad", "s") for p in effect.parameters)


def _units(effect: type[Effect], names: Sequence[tuple[str, float]]) -> list[str]:
    """Unit of each strength; "" where the effect has none."""
    table = {p.name: p.unit for p in effect.parameters}
    return [table.get(name, "") for name, _ in names]


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


def _projected(columns: Array, target: Array) -> float:
    """Squared length of the target's part that lies in the span of columns (m, k)."""
    found = _least_squares(columns, target, (columns**2).sum(0) > 0)
    fitted = columns @ found
    return float(2 * fitted @ target - fitted @ fitted)


def _least_squares(columns: Array, target: Array, seen: NDArray[np.bool_]) -> Array:
    """Coefficients of `target` on the columns that are seen, zero for the others."""
    out = np.zeros(columns.shape[1])
    size = np.sqrt((columns[:, seen] ** 2).sum(0))
    scaled = columns[:, seen] / size
    out[seen] = np.linalg.lstsq(gram(scaled, scaled), gram(scaled, target), rcond=1e-12)[0] / size
    return out


class LinearModel:
    """A least-squares problem near its solution: residual + tangents * move, with a prior on the move.

    What the motion does not determine is left out.

    Args:
        misfit, vector, residual: the problem, its solution and the residual (m,) there.
    """

    def __init__(self, misfit: Misfit, vector: Array, residual: Array) -> None:
        self.observations = misfit.observations
        self.determined = determined(misfit)
        tangents = misfit.jacobian(vector) * self.determined[:, None]
        self.residual = residual = residual * self.determined
        reach = misfit.reach(vector)
        held = misfit.held(vector, gram(tangents, residual))
        self.columns = np.flatnonzero(~held & ((tangents**2).sum(0) > 0))
        self.reach = reach[self.columns]
        self.tangents = tangents[:, self.columns] * self.reach
        # In units of its reach a move is a standard normal; the residual's size is its noise.
        self.prior = math.sqrt(float(residual @ residual) / max(int(self.determined.sum()), 1))
        own = gram(self.tangents, self.tangents)
        self._normal = linalg.cho_factor(own + (self.prior**2 + 1e-300) * np.eye(len(own)))
        self.target = self.without(residual[:, None])[:, 0]

    def without(self, columns: Array) -> Array:
        """(m + p, k) columns (m, k), and a row for the prior of each unknown, without what the unknowns can do."""
        move = linalg.cho_solve(self._normal, gram(self.tangents, columns))
        return np.vstack([columns - times(self.tangents, move), -self.prior * move])

    def held_out(self, columns: Array | None = None) -> Array:
        """(m,) residual of each block of time, predicted by a refit without the blocks of its fold.

        Args:
            columns: (m, k) tangents of what is added.
        """
        added = np.empty((len(self.residual), 0)) if columns is None else columns
        # Everything that a refit needs to know of a block is its share of the normal equations.
        both = np.column_stack([self.tangents, self._scaled(added), self.residual])
        owner = _block_of_row(self.observations)
        out = self.residual.copy()
        for blocks, move in self._folds(_block_grams(self.observations, both), _folds(self.observations)):
            rows = np.isin(owner, blocks)
            out[rows] += both[rows, :-1] @ move
        return out

    def _scaled(self, columns: Array) -> Array:
        return columns / np.sqrt(np.mean(columns**2, 0)).clip(1e-300)

    def _folds(self, grams: Array, fold: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Blocks of each fold, and the move (p,) that fits the others best."""
        own, p = self.tangents.shape[1], grams.shape[1] - 1
        ridge = np.diag(np.append(np.full(own, self.prior**2), np.full(p - own, 1e-9 * len(self.residual))))
        total = grams.sum(0)
        for k in np.unique(fold):
            blocks = np.flatnonzero(fold == k)
            rest = total - grams[blocks].sum(0)
            yield blocks, -np.linalg.solve(rest[:p, :p] + ridge, rest[:p, p])


def determined(misfit: Misfit) -> NDArray[np.bool_]:
    """(m,) where the motion says what friction does, see `Observation.determined`; all where it never does."""
    found = np.concatenate([o.determined for o in misfit.observations])
    return found if found.any() else ~found


def cross_validated(misfit: Misfit, vector: Array) -> HeldOut:
    """What is left of each block of time by a refit without the blocks of its fold.

    The refit is one step of least squares from the solution, as far as it really helps the blocks it may see. The
    squares of a block count for at most ten times those that the fit leaves of it. All are divided by the share of the
    command that the drive delivers, see `Misfit.delivered`.

    Args:
        misfit, vector: a problem and its solution.
    """
    residual = misfit.residual(vector)
    model = LinearModel(misfit, vector, residual)
    grams = _block_grams(model.observations, np.column_stack([model.tangents, model.residual]))
    lower, upper = misfit.bounds
    owner, out = _block_of_row(model.observations), np.empty(len(residual))
    for blocks, move in model._folds(grams, _folds(misfit.observations)):
        best, chosen = np.inf, residual
        for share in (0.0, 0.1, 0.3, 1.0):
            moved = vector.copy()
            moved[model.columns] += share * move * model.reach
            there = misfit.residual(np.clip(moved, lower, upper)) if share else residual
            squares = block_sums(model.observations, (there * model.determined) ** 2, BLOCK)
            seen = squares.sum() - squares[blocks].sum()
            if seen < best:
                best, chosen = seen, there
        rows = np.isin(owner, blocks)
        out[rows] = chosen[rows]
    out *= model.determined * np.sqrt(_believed(out * model.determined, model.residual, misfit.observations))[owner]
    return HeldOut(out / math.sqrt(misfit.delivered(vector)), misfit.observations)


def _believed(left: Array, fitted: Array, observations: Sequence[Seen]) -> Array:
    """(blocks,) share of the squared residual (m,) of a block not seen that is believed, given that of the whole fit.

    What a block alone determines is predicted by chance, and may outweigh all others.
    """
    held_out, own = (block_sums(observations, x**2, BLOCK) for x in (left, fitted))
    return np.minimum(_BLOWN_UP * np.asarray(own) / np.maximum(held_out, 1e-300), 1.0)


def _folds(observations: Sequence[Seen]) -> NDArray[np.intp]:
    """(blocks,) number of the fold of each block of time: those that are left out together.

    Every fifth; of a servo all of one payload and gain, where there are several: an effect has to hold where the fit
    has not been, and runs of one condition share what is particular to it.
    """
    owner = np.repeat(np.arange(len(observations)), [len(o.index) for o in observations])
    starts = np.concatenate([[0], np.flatnonzero(np.diff(_block_of_row(observations))) + 1])
    conditions = [o.condition if isinstance(o, ServoObservation) else None for o in observations]
    kinds = sorted({c for c in conditions if c is not None})
    if len(kinds) < 2:
        return np.arange(len(starts)) % FOLDS
    return np.array([kinds.index(conditions[i]) for i in owner[starts]])


def _block_of_row(observations: Sequence[Seen]) -> NDArray[np.intp]:
    """(m,) number of the block of time that each row belongs to."""
    lengths = block_sums(observations, np.ones(sum(len(o.index) for o in observations)), BLOCK).astype(int)
    return np.repeat(np.arange(len(lengths)), lengths)


def _block_grams(observations: Sequence[Seen], columns: Array) -> Array:
    """(blocks, p, p) products of the columns, summed over each block of time."""
    ends = np.cumsum(block_sums(observations, np.ones((len(columns), 1)), BLOCK)[:, 0].astype(int))
    return np.stack([gram(c, c) for c in np.split(columns, ends[:-1])])


def _laws_aside(plant: Plant) -> tuple[str, ...]:
    """Laws of friction that are no candidates beside those of a plant.

    `gms` and `lugre` are general forms: beside them the others have nothing of their own to add. These two are no small
    change of anything else, and a plant without them was chosen so.
    """
    general = ("gms", "lugre")
    return (*general, "coulomb", "stribeck", "dahl") if any(name in plant for name in general) else general


# Effects that a frequency response cannot show: it has no clock, no load, and no place on the revolution; and what
# differs between the directions is in the mean and the even harmonics, while the fundamental has the mean of both.
_NEED_RECORDS = (
    "thermal_drift", "load_dependent_friction", "encoder_eccentricity", "position_dependent_friction",
    "asymmetric_friction", "torque_offset",
)  # fmt: skip


# Drive effects that act on the goal of a servo as they act on the torque of an axis.
_ON_GOALS = ("delay", "least_duty")


def _on_servos(plant: Plant) -> list[type[Effect]]:
    """The effects that could be added to a servo: those on its shaft, a delay of its goal, and a least duty.

    Not those that need a temperature, or that put a part of the inertia behind a coupling.
    """
    known = [e for e in effects.CATALOGUE.values() if e.is_native and (e.name not in plant or grows(e))]
    known = [e for e in known if e.name not in (*_laws_aside(plant), "thermal_drift")]
    known = [e for e in known if not any(p.unit == "kg m^2" for p in e.parameters)]
    return known + [effects.find(n) for n in _ON_GOALS if n not in plant]


def applicable(plant: Plant, observations: Sequence[Seen] = ()) -> list[type[Effect]]:
    """The effects of the catalogue that could be added to a plant.

    Not those that it has, unless one more harmonic can be added; not those contained in its friction; on a slide joint
    none that counts revolutions; and from frequency responses alone none that they cannot show.
    """
    if any(isinstance(o, ServoObservation) for o in observations):
        return _on_servos(plant)
    contained = _laws_aside(plant)
    if observations and all(isinstance(o, FrfObservation) for o in observations):
        sizes = np.abs(np.concatenate([o.torque for o in observations if isinstance(o, FrfObservation)]))
        one_level = sizes.max() < 2 * sizes.min()  # a limit is then a gain like any other
        contained = (*contained, *_NEED_RECORDS, *(["torque_saturation"] if one_level else []))
    out = [e for name, e in effects.CATALOGUE.items() if name not in contained and (name not in plant or grows(e))]
    out = [e for e in out if e.kind != "controller"]  # a record of torque says nothing about one
    return [e for e in out if plant.kind == "hinge" or not has_phase(e)]
