"""Screening: what each effect of the catalogue could still explain, at the price of a few replays.

An effect that is weak adds its tangent to the torque: the derivative by its strength at strength zero, for each
value of its other parameters. What a joint refit would gain follows from these tangents once everything that the
plant itself could do (its own tangents) is projected out of them; a regression on the leftover residual is not the
same, because the plant has already bent to hide the effect (score test; Rao 1948).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..logs.encoder import count_size
from ..parameter import DECELERATION
from ..plant import Plant
from ..threads import each
from .candidates import (
    ORDERS,
    at_strengths,
    grows,
    has_phase,
    is_continuous,
    joined,
    longest_way,
    merged,
    shapes,
    strengths,
    units_of,
    valued,
    width_of,
    widths,
    with_strengths,
)
from .held_out import HeldOut
from .inverse import Observation
from .linear_model import LinearModel
from .misfit import Misfit
from .place_spectrum import standing_out
from .scales import Scales
from .tall import gram, squared

Array = NDArray[np.float64]

_FINER = (1.41, 1.19)  # factors between the values of a grid
_TOGETHER = 6  # harmonics that may be added at once
_STANDS_OUT = 0.2  # of what the others leave of the squared residual, which one more must take
_MOST_ORDERS = 4000  # per revolution
_FEWEST_COUNTS = 6  # of the encoder in a period
_SLOW = 0.2  # of the time, at least, in which a harmonic must be slow enough for the band
_LENGTHS, _PERIODS = 8, 3  # of the travel, which waves on a slide joint are a whole number of, and they in the travel
_MOSTLY = 0.5  # of the squared residual, which several together must not leave
_SHOWS = 0.1  # of the squared residual, which a play has to take for its width to be looked for closely
_RIVALS, _MOST_PLAYS = 0.5, 2  # of what the best takes; so many other widths are of interest
_APART = 0.25  # ratio of widths, less 1, from which they are others
_AT_ONCE = 7  # choices of an effect's other parameters that are looked at in one pass over the records
_STEP = 1e-3  # of the typical strength, for the derivative


@dataclass(frozen=True)
class Candidate:
    """An effect that could be added.

    Attributes:
        effect: with the values from which a joint fit starts.
        gain: share of the squared residual that it explains, after a joint linear refit.
        held_out: what is left of each block, predicted without that block.
        strong: the same at a strength that is not small, for an effect that does then nothing like its tangent.
        columns: (m, k) what it does to the residual.
        others: the same with other widths of a play at which it explains much, from which a joint fit may start too.
        gliding: of a load with dry friction of its own the best without; None of what has none.
    """

    effect: Effect
    gain: float
    held_out: HeldOut
    strong: Effect | None = None
    columns: Array | None = None
    others: tuple[Effect, ...] = ()
    gliding: Candidate | None = None


class _Tangents(NamedTuple):
    """What an effect does that is weak, with one choice of its other parameters.

    Attributes:
        shape: that choice.
        names: (k,) which strength and phase each tangent belongs to.
        columns, free: (m, k) derivatives of the residual, and (m + p, k) those without what the unknowns can do.
    """

    shape: dict[str, float]
    names: list[tuple[str, float]]
    columns: Array
    free: Array


@dataclass
class _Best:
    """The best so far by tangents, and at strengths that are not small: gain, effect, columns."""

    weak: tuple[float, Effect, Array] | None = None
    strong: tuple[float, Effect, Array] | None = None
    shape: dict[str, float] | None = None  # of the best by its tangents
    tried: list[_Tangents] = field(default_factory=list)
    out_of_bounds: Effect | None = None


def _is_apart(one: _Best, other: _Best, width: str | None) -> bool:
    """Whether two have widths of a play that no fit goes from one to the other."""
    if width is None or one.shape is None or other.shape is None:
        return False
    return abs(math.log(one.shape[width] / other.shape[width])) > _APART


class Screen:
    """Scores effects against one fitted plant.

    Every unknown of the plant may follow a candidate, but only as far as its tangent means something: unknowns
    that the data hardly sees would otherwise take any distance and hide what they cannot really do.

    Args:
        misfit, vector: the plant's least-squares problem and its solution.
    """

    def __init__(self, misfit: Misfit, vector: Array) -> None:
        self.misfit, self.vector = misfit, vector
        self.plant = misfit.plant(vector)
        self.residual = misfit.residual(vector)
        self.scales = Scales.of(misfit.observations, self.plant)
        self.model = LinearModel(misfit, vector, self.residual)
        self._left = float(self.model.residual @ self.model.residual)
        self._delivered = misfit.delivered(vector)
        self.held_out = self._predicted(None, 1.0)

    def candidates(self, effects: Iterable[type[Effect]]) -> list[Candidate]:
        """Those of some effects that could be added, of which a linear refit shows anything."""
        # Those that take longest first: who begins late is alone at the end.
        todo = sorted(effects, key=lambda e: (not grows(e), not e.modulates))
        return [c for c in each(self.candidate, todo) if c is not None]

    def candidate(self, effect: type[Effect], given: dict[str, float] | None = None) -> Candidate | None:
        """The best way to add an effect; None where the data cannot show it (no motion, signal missing).

        An effect of several elements that the plant has already is given one more.

        Args:
            given: values of parameters that are neither strengths nor phases, of which no others are tried.
        """
        found = self._candidate(effect, given or {}, {})
        rubs = next((p.name for p in effect.parameters if p.unit == DECELERATION), None)
        if found is None or given or rubs is None or not found.effect.values[rubs]:
            return found
        return replace(found, gliding=self._candidate(effect, {}, {rubs: 0.0}))

    def _candidate(self, effect: type[Effect], given: dict[str, float], form: dict[str, float]) -> Candidate | None:
        best = _Best()
        tried = [*shapes(effect, self.scales, self.misfit.observations, self.plant), *self._finer(effect)]
        todo = list({tuple((shape | given | form).items()): shape | given | form for shape in tried}.values())
        for tangents in self._in_turn(effect, todo):
            self._try(best, effect, tangents)
        found = [best, *self._plays(best, effect, given)]
        for one in found:
            self._closer(one, effect, given)
        best = max(found, key=lambda b: b.weak[0] if b.weak else -math.inf)
        others = tuple(b.weak[1] for b in found if b.weak and _is_apart(b, best, width_of(effect)))
        if best.weak is None and best.strong is None:
            # It can be seen, but every strength that is allowed makes things worse.
            return Candidate(best.out_of_bounds, 0.0, self.held_out) if best.out_of_bounds else None
        if best.weak is not None and grows(effect) and self._goes_round:
            best.weak = self._series(best, effect)
        gain, started, columns = max((s for s in (best.weak, best.strong) if s is not None), key=lambda s: s[0])
        share = max(gain, 0.0) / max(self._left, 1e-300)
        strong = best.strong[1] if best.strong else None
        return Candidate(started, share, self._predicted(columns, self._kept(started)), strong, columns, others)

    def _closer(self, best: _Best, effect: type[Effect], given: Collection[str]) -> None:
        """Goes between the values of the grid, as far as the best by its tangents leads."""
        for factor in _FINER:
            for name in [k for k in (best.shape or {}) if is_continuous(effect, k) and k not in given]:
                assert best.shape is not None
                around = best.shape
                for by in (factor, 1 / factor):
                    table = {p.name: p for p in effect.parameters}[name]
                    value = float(np.clip(around[name] * by, table.lower, table.upper))
                    self._try(best, effect, next(self._tangents(effect, [{**around, name: value}])))

    def _plays(self, best: _Best, effect: type[Effect], given: Collection[str]) -> list[_Best]:
        """The widths of a play at which it explains more than with those beside them, and about as much as the best."""
        if given or best.weak is None or best.weak[0] < _SHOWS * self._left:
            return []
        found = []
        assert best.shape is not None
        form = {p.name: best.shape[p.name] for p in effect.parameters if p.is_scale and p.name in best.shape}
        tried = [w | form for w in widths(effect, self.scales, self.misfit.observations, self.plant)]
        for tangents in self._in_turn(effect, tried):
            found.append(_Best())
            self._try(found[-1], effect, tangents)
        gains = np.array([0.0, *(b.weak[0] if b.weak else 0.0 for b in found), 0.0])
        peaks = (gains[1:-1] > gains[:-2]) & (gains[1:-1] > gains[2:]) & (gains[1:-1] > _RIVALS * best.weak[0])
        return [found[i] for i in sorted(np.flatnonzero(peaks), key=lambda i: -gains[i + 1])[:_MOST_PLAYS]]

    def started(self, effect: Effect) -> Effect | None:
        """An effect that the plant does not have with values for those that it lacks, from which a joint fit starts;
        None where the data cannot show it."""
        table = {p.name: p for p in effect.parameters}
        chosen = {k: v for k, v in effect.values.items() if not np.all(np.isnan(v) | np.equal(v, table[k].default))}
        if grows(type(effect)) and "harmonics" not in effect.unset:
            found: Effect | None = None
            for order in np.atleast_1d(effect.values["harmonics"]):
                if one := self.at(type(effect), {"harmonics": float(order)}):
                    found = merged(found, one[0]) if found else one[0]
            return found
        shape = {k: float(np.ravel(v)[0]) for k, v in chosen.items() if math.isnan(table[k].default)}
        best = self.candidate(type(effect), shape)
        return best.effect.replace(**chosen) if best else None

    def together(self, one: Candidate, other: Candidate) -> HeldOut:
        """What two candidates leave of each block, predicted without that block."""
        both = [c.columns for c in (one, other) if c.columns is not None]
        return self._predicted(np.column_stack(both), self._kept(one.effect) * self._kept(other.effect))

    def explained(self, one: Candidate, beside: Array) -> float:
        """Squared residual that a candidate explains together with torques (m, k) of which each has one strength."""
        assert one.columns is not None
        free = self.model.without(np.column_stack([one.columns, beside * self.model.determined[:, None]]))
        return _projected(free, self.model.target)

    def _predicted(self, columns: Array | None, kept: float) -> HeldOut:
        """What is left of each block with some columns more, for a drive that delivers everything."""
        rows = self.model.held_out(columns) / math.sqrt(self._delivered * kept)
        return HeldOut(rows, self.misfit.observations)

    @property
    def _goes_round(self) -> bool:
        """Whether a record turns once: on less, harmonics together are any curve over the position."""
        return self.plant.kind == "hinge" and longest_way(self.misfit.observations) >= 1

    def _finer(self, effect: type[Effect]) -> list[dict[str, float]]:
        """Harmonics that stand out of the residual over the place: on a hinge beyond those that are all tried."""
        runs = [o for o in self.misfit.observations if isinstance(o, Observation)]
        if not grows(effect) or not runs or len(runs) < len(self.misfit.observations):
            return []
        place = np.concatenate([o.position[o.index] for o in runs])
        speed = np.concatenate([o.velocity[o.index] for o in runs])
        slow = float(np.quantile(np.abs(speed[self.model.determined]), _SLOW))
        seen = min(2 * math.pi * o.bandwidth / max(slow, 1e-300) for o in runs)  # faster than the band follows
        read = min(2 * math.pi / (_FEWEST_COUNTS * max(count_size(o.record), 1e-300)) for o in runs)
        torque = self.model.residual * (np.sign(speed) if effect.modulates else 1.0)
        known = np.atleast_1d(self.plant[effect.name].values["harmonics"]) if effect.name in self.plant else ()
        least, turn = ORDERS + 1, 2 * math.pi
        if self.plant.kind == "slide":
            least, turn = _PERIODS * _LENGTHS, _LENGTHS * float(np.ptp(place))
        once = 2 * math.pi / turn  # as a wave number; 1 in a revolution
        most = int(min(seen / once, read / once, _MOST_ORDERS))
        found = [n * once for n in standing_out(place, torque, least, most, turn)]
        return [{"harmonics": n} for n in found if n not in known]

    def _series(self, best: _Best, effect: type[Effect]) -> tuple[float, Effect, Array]:
        """The harmonics that stand out, together, if most of what is missing is theirs; else the best one.

        With one of many a model is hardly better than with none, and where the others act it is worse. More of a series
        that is there already need not be most of what is missing.
        """
        assert best.shape is not None and best.weak is not None
        begun = effect.name in self.plant
        least = _STANDS_OUT / 4 if begun else _STANDS_OUT
        shape = best.shape
        chosen = [next(t for t in best.tried if t.shape == shape)]
        # Of thousands some stand out by chance beside a strong one: what is finer is looked at once that is there.
        finest = max(ORDERS, shape["harmonics"])
        others = [t for t in best.tried if t.shape != shape and t.shape["harmonics"] <= finest]
        while True:
            basis = scipy.linalg.orth(np.column_stack([t.free for t in chosen]))
            left = self.model.target - basis @ (basis.T @ self.model.target)
            if not others or len(chosen) == _TOGETHER:
                break
            gains = [_projected(t.free - basis @ (basis.T @ t.free), left) for t in others]
            k = int(np.argmax(gains))
            if gains[k] < least * float(left @ left):
                break
            chosen.append(others.pop(k))
        if len(chosen) == 1 or (not begun and float(left @ left) > _MOSTLY * self._left):
            return best.weak
        free, columns = np.column_stack([t.free for t in chosen]), np.column_stack([t.columns for t in chosen])
        strength = -_least_squares(free, self.model.target, (free**2).sum(0) > 0)
        found: Effect | None = None
        for t, pair in zip(chosen, strength.reshape(len(chosen), -1), strict=True):
            one = with_strengths(effect, t.shape, t.names, pair, self.scales)
            found = one if found is None else merged(found, one)
        assert found is not None
        return (self._left - float(left @ left), found, columns)

    def _try(self, best: _Best, effect: type[Effect], tangents: _Tangents) -> None:
        """Scores an effect with one choice of its other parameters; `best` keeps it where it is better."""
        shape, names, columns, free = tangents
        seen = _seen(free, columns)
        # What does nothing at a strength that would matter is nothing but rounding.
        typical = np.array([self.scales[u] for u in units_of(effect, names)])
        seen &= typical * np.sqrt((columns**2).sum(0)) > 1e-6 * math.sqrt(self._left)
        if not seen.any():
            return
        strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
        if strength.any() and not strength[seen].all():  # the others must do without those out of bounds
            seen &= strength != 0
            strength = self._allowed(effect, names, _least_squares(free, self.model.target, seen))
        seen &= strength != 0
        started = with_strengths(effect, shape, names, -strength, self.scales)
        best.out_of_bounds = best.out_of_bounds or started
        if seen.any():
            if grows(effect):
                best.tried.append(tangents)
            gain = self._compared(self._gain(free @ strength), started)
            if best.weak is None or gain > best.weak[0]:
                best.weak, best.shape = (gain, started, columns[:, seen]), shape
        for trial in at_strengths(effect, shape, self.scales):
            change = self._change(trial)[:, None]
            gain = self._compared(self._gain(-self.model.without(change)[:, 0]), trial)
            if np.isfinite(gain) and (best.strong is None or gain > best.strong[0]):
                best.strong = gain, trial, change

    def at(self, effect: type[Effect], shape: dict[str, float]) -> tuple[Effect, Array, HeldOut] | None:
        """An effect of one shape as strong as in a linear refit; what it does to the residual (m,), and what is left of
        each block not seen. None where it cannot be seen."""
        _, names, columns, free = next(self._tangents(effect, [shape]))
        seen = _seen(free, columns)
        if not seen.any():
            return None
        strength = -_least_squares(free, self.model.target, seen)
        started = with_strengths(effect, shape, names, strength, self.scales)
        return started, columns @ strength, self._predicted(columns, 1.0)

    def shape(self, torque: Array) -> tuple[float, float, HeldOut]:
        """Gain, strength, and what is left of each block not seen, of a torque (m,) that has one strength."""
        size = max(float(np.abs(torque).max()), 1e-300)  # of any strength: its square may be no number
        columns = (torque / size * self.model.determined)[:, None]
        free = self.model.without(columns)
        seen = _seen(free, columns)
        if not seen.any():
            return 0.0, 0.0, self.held_out
        strength = _least_squares(free, self.model.target, seen)
        gain = self._gain(free @ strength) / max(self._left, 1e-300)
        return gain, -float(strength[0]) / size, self._predicted(columns, 1.0)

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

    def _in_turn(self, effect: type[Effect], todo: Sequence[dict[str, float]]) -> Iterator[_Tangents]:
        """The tangents of an effect with many choices of its other parameters, some at a time."""
        for i in range(0, len(todo), _AT_ONCE):
            yield from self._tangents(effect, todo[i : i + _AT_ONCE])

    def _tangents(self, effect: type[Effect], some: Sequence[dict[str, float]]) -> Iterator[_Tangents]:
        """The tangents of an effect with each of several choices of its other parameters."""
        if not strengths(effect):  # absent only at the end of its range: its whole change
            names = [("", 0.0)]
            columns = np.stack([self._change(valued(effect, shape, {})) for shape in some], 1)
        else:
            phases = (0.0, math.pi / 2) if has_phase(effect) else (0.0,)
            names = [(p.name, phase) for p, phase in itertools.product(strengths(effect), phases)]
            table = {p.name: p for p in effect.parameters}
            steps = {name: _STEP * self.scales[table[name].unit] for name, _ in names}

            def plant(shape: dict[str, float], phase: float, strength: dict[str, float]) -> Plant:
                turned = {"phase": phase} if has_phase(effect) else {}
                return joined(self.plant, valued(effect, shape | turned, strength))

            without = plant(some[0], 0.0, dict.fromkeys(steps, 0.0))
            there = [plant(shape, phase, {name: steps[name]}) for shape in some for name, phase in names]
            columns = self.misfit.changes(self.vector, without, there, effect.name)
            columns = columns * self.model.determined[:, None] / np.tile([steps[name] for name, _ in names], len(some))
        free = np.asfortranarray(self.model.without(columns))
        for i, shape in enumerate(some):
            own = slice(i * len(names), (i + 1) * len(names))
            yield _Tangents(shape, names, columns[:, own], free[:, own])

    @staticmethod
    def _allowed(effect: type[Effect], names: Sequence[tuple[str, float]], strength: Array) -> Array:
        """Strengths that are outside their bounds do nothing; a phase makes either sign possible."""
        if has_phase(effect):
            return strength
        lower = {"": 0.0} | {p.name: p.lower for p in effect.parameters}
        return np.array([0.0 if -s < lower[name] else s for (name, _), s in zip(names, strength, strict=True)])


def _projected(columns: Array, target: Array) -> float:
    """Squared length of the target's part that lies in the span of columns (m, k)."""
    found = _least_squares(columns, target, (columns**2).sum(0) > 0)
    fitted = columns @ found
    return float(2 * fitted @ target - fitted @ fitted)


def _seen(free: Array, columns: Array) -> NDArray[np.bool_]:
    """Which columns are not what the unknowns of the plant do already, where `free` is the rest of them."""
    return np.asarray((free**2).sum(0) > 1e-12 * (columns**2).sum(0).clip(1e-300))


def _least_squares(columns: Array, target: Array, seen: NDArray[np.bool_]) -> Array:
    """Coefficients of `target` on the columns that are seen, zero for the others."""
    out = np.zeros(columns.shape[1])
    size = np.sqrt((columns[:, seen] ** 2).sum(0))
    scaled = columns[:, seen] / size
    out[seen] = np.linalg.lstsq(gram(scaled, scaled), gram(scaled, target), rcond=1e-12)[0] / size
    return out
