"""Derivatives of what a plant leaves of the measured torque, those by one effect in one pass over the motion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..native import Joint
from ..plant import Plant
from ..threads import at_hand, each
from .frf_observation import Together
from .inverse import Observation

if TYPE_CHECKING:
    from .misfit import Misfit

Array = NDArray[np.float64]

_SPIKE = 8.0  # times its root mean square, above which a derivative is looked at from the other side too


def jacobian(misfit: Misfit, x: Array, wanted: NDArray[np.bool_], steps: Array) -> Array:
    """(m, size) derivative of the residual at `x`; other columns than those `wanted` (size,) are 0.

    Args:
        steps: (size,) of each unknown.
    """
    lower, upper = misfit.bounds
    steps = np.where(x + steps <= upper, steps, -steps)
    both = (np.arange(misfit.size) < misfit.coordinates.size) & (x - steps >= lower) & (x - steps <= upper)
    lengths = [len(o.index) for _, o in misfit.pieces]
    out = np.zeros((misfit.size, sum(lengths))).T  # column after column, as they are made
    around = _Around(misfit, x, steps, both)
    parts = np.split(out, np.cumsum(lengths)[:-1])
    todo = [(k, *some) for k in range(len(parts)) for some in around.shared_out(k, wanted)]
    if len(parts) == 1 and isinstance(misfit.pieces[0][1], Together):  # many points at a time as it is
        for t in todo:
            around.fill(*t, parts[0])
    else:
        each(lambda t: around.fill(*t, parts[t[0]]), todo)
    out[:, ~wanted] = 0
    return out


class _Around:
    """The plant at a vector and those beside it.

    Args:
        steps: (size,) of each unknown.
        both: (size,) which may be looked at on the other side too.
    """

    def __init__(self, misfit: Misfit, x: Array, steps: Array, both: NDArray[np.bool_]) -> None:
        self.misfit, self.x, self.steps, self.both = misfit, x, steps, both
        self.here, self.grids = misfit.plant(x), misfit.slope_grids or misfit.grids(x)
        self._plants: dict[tuple[int, float], Plant] = {}
        # Name of the effect of each coordinate, then of each state before a record.
        places = misfit.coordinates.template.memory_places
        self._owners = [b.effect for b in misfit.coordinates.blocks for _ in range(b.size)]
        self._owners += [name for name, s in places.items() for _ in range(s.stop - s.start)]

    def moved(self, column: int, side: float) -> tuple[Array, Plant]:
        """The vector with one unknown moved by its step to one side, 1 or -1, and the plant there."""
        there = self.x.copy()
        there[column] += side * self.steps[column]
        if column >= self.misfit.coordinates.size:
            return there, self.here
        if (column, side) not in self._plants:
            coordinates = self.misfit.coordinates
            beside = self.here, self._owners[column]
            self._plants[column, side] = coordinates.decode(there[: coordinates.size], beside)
        return there, self._plants[column, side]

    def shared_out(self, k: int, wanted: NDArray[np.bool_]) -> list[tuple[str | None, list[int]]]:
        """The columns of piece k, by the effect that they belong to ("": the inertia; None: the skew); in halves where
        fewer pieces are left than threads."""
        misfit, (i, o) = self.misfit, self.misfit.pieces[k]
        n, common, (begin, end) = misfit.coordinates.size, misfit.n_common, misfit.states(i)
        own: dict[str | None, list[int]] = {}
        for column in map(int, np.flatnonzero(wanted)):
            if column < n or begin <= column < end:  # not the state before another observation
                own.setdefault(self._owners[column if column < n else n + column - begin], []).append(column)
            elif column < common:
                own[None] = [column]
        n_threads, n_pieces = at_hand(), len(misfit.pieces)
        if k < n_pieces - n_pieces % n_threads or isinstance(o, Together):
            return list(own.items())
        return [(name, half) for name, columns in own.items() for half in self._halves(name, columns) if half]

    def _halves(self, name: str | None, columns: list[int]) -> tuple[list[int], list[int]]:
        """The columns of an effect in two parts that take about as long, those of its elements together."""
        n, middle = self.misfit.coordinates.size, len(columns) // 2
        if not name or not self.here[name].separable:
            return columns[:middle], columns[middle:]
        of_elements = [b.parameter.per_element for b in self.misfit.coordinates.blocks for _ in range(b.size)]
        apart = [c for c in columns if c >= n or of_elements[c]]
        return apart, [c for c in columns if c not in apart]

    def fill(self, k: int, name: str | None, columns: list[int], rows: Array) -> None:
        """Fills in some columns of those (m_k, size) of piece k, which belong to one effect, see `shared_out`."""
        i, o = self.misfit.pieces[k]
        if name is None:
            skew, step = self.misfit.skew(self.x), self.steps[columns[0]]
            rows[:, columns[0]] = (o.applied(self.here, skew + step) - o.applied(self.here, skew)) / step
        elif name and self.here[name].is_native and isinstance(o, Observation | Together):
            _OfEffect(self, k, i, o, name, columns).fill(rows)
        else:
            self._one_by_one(k, name, columns, rows)

    def _one_by_one(self, k: int, name: str, columns: list[int], rows: Array) -> None:
        misfit, grid = self.misfit, self.grids[k]
        drives = any(e.name == name for e in self.here.drive)
        base = misfit.piece(k, self.here, name, self.x, grid, drives=drives)
        for column in columns:

            def slope(side: float, column: int = column) -> Array:
                there, plant = self.moved(column, side)
                after = misfit.piece(k, plant, name, there, grid, drives=drives)
                return (after - base) / (there[column] - self.x[column])

            found = slope(1.0)
            if misfit.pieces[k][1].jumps and self.both[column] and _jumps(found):
                found = _lesser(found, slope(-1.0))
            rows[:, column] = found


class _OfEffect:
    """Derivatives by what belongs to one native effect, all in one pass over the motion of a piece.

    Of a separable effect what belongs to one element moves at the same time for all of them.

    Attributes:
        blocks: coordinates of one parameter of all elements, their place among its parameters, and whether they are
            shares.
        states: of the elements before the record.
        columns: the other unknowns.
    """

    def __init__(
        self, around: _Around, k: int, i: int, seen: Observation | Together, name: str, columns: list[int]
    ) -> None:
        misfit = around.misfit
        self.around, self.seen, self.grid, self.name = around, seen, around.grids[k], name
        self.part, self.effect, self.number_of_record = around.here.part(name), around.here[name], i
        self.memory = misfit.memory_of(self.part, around.x, i)
        self.native = [e for e in self.part.effects if e.is_native]
        self.blocks: list[tuple[slice, slice, bool]] = []
        self.states: slice | None = None
        rest, at = set(columns), 0
        if self.effect.separable:
            for b in misfit.coordinates.blocks:
                own, at = slice(at, at + b.size), at + b.size
                together = b.effect == name and b.parameter.per_element and b.scale in ("log", "share")
                if together and rest & {*range(own.start, own.stop)}:
                    self.blocks.append((own, self.effect.index(b.parameter.name), b.scale == "share"))
                    rest -= {*range(own.start, own.stop)}
            begin, place = misfit.states(i)[0], misfit.coordinates.template.memory_places[name]
            states = slice(begin + place.start, begin + place.stop)
            if self.memory is not None and max(rest, default=0) >= states.start:
                self.states = states
                rest -= {*range(states.start, states.stop)}
        self.columns = sorted(rest)

    def fill(self, rows: Array) -> None:
        """Fills in the columns (m_k, size)."""
        of_blocks, of_states, of_columns = self._look(1.0, list(range(len(self.blocks))), self.columns, self.states)
        if self.states is not None:
            rows[:, self.states] = of_states.T
        if self.seen.jumps:
            some = [j for j, slope in enumerate(of_blocks) if _jumps(slope).any()]
            few = [j for j, c in enumerate(self.columns) if self.around.both[c] and _jumps(of_columns[j])]
            if some or few:
                blocks, _, columns = self._look(-1.0, some, [self.columns[j] for j in few], None)
                for slopes, which, others in ((of_blocks, some, blocks), (of_columns, few, columns)):
                    for j, other in zip(which, others, strict=True):
                        there = _jumps(slopes[j])
                        slopes[j][there] = _lesser(slopes[j][there], other[there])
        for (own, place, shares), slope in zip(self.blocks, of_blocks, strict=True):
            if shares:  # log-ratios to the last share
                slope = (slope - self.effect.packed[place][:, None] * slope.sum(0))[:-1]
            rows[:, own] = slope.T
        for c, slope in zip(self.columns, of_columns, strict=True):
            rows[:, c] = slope

    def _look(
        self, side: float, blocks: list[int], columns: list[int], states: slice | None
    ) -> tuple[Array, Array, Array]:
        """Slopes on one side, 1 or -1: of some blocks (blocks, elements, m_k), of the states (elements, m_k), and of
        some columns (columns, m_k)."""
        around, effect, steps = self.around, self.effect, self.around.steps
        base = self.part.joint()
        joints, memories, widths = [base], [self.memory], []
        for j in blocks:
            own, place, _ = self.blocks[j]
            widths.append(side * float(np.median(np.abs(steps[own]))))
            factor = np.ones(len(effect.packed))
            factor[place] = math.exp(widths[-1])
            packed = [e.packed * (factor if e is effect else 1.0) for e in self.native]
            joints.append(Joint([(e.name, e.elements, p) for e, p in zip(self.native, packed, strict=True)]))
            memories.append(self.memory)
        if states is not None:
            assert self.memory is not None
            stood = self.memory.copy()
            stood[self.part.memory_places[self.name]] += steps[states]
            joints.append(base)
            memories.append(stood)
        parts = []
        for c in columns:
            there, plant = around.moved(c, side)
            parts.append(plant.part(self.name))
            joints.append(parts[-1].joint())
            memories.append(around.misfit.memory_of(parts[-1], there, self.number_of_record))
        apart, number = len(blocks) + (states is not None), self.part.number_in_joint(self.name)
        found = self.seen.changes(self.part, joints, memories, self.grid, number, apart)
        split = apart * effect.elements
        by_element, whole = found[:split].reshape(apart, effect.elements, found.shape[1]), found[split:]
        of_blocks = by_element[: len(blocks)]
        of_blocks /= np.reshape(widths, (-1, 1, 1))
        of_states = by_element[len(blocks) :].reshape(-1, found.shape[1])
        if states is not None:
            of_states /= steps[states][:, None]
        for slope, c, part in zip(whole, columns, parts, strict=True):
            hidden = part.driven_inertia - self.part.driven_inertia
            if hidden:
                slope -= hidden * self.seen.accelerated(self.part)
            slope /= side * steps[c]
        return of_blocks, of_states, whole


def _jumps(slope: Array) -> NDArray[np.bool_]:
    """(...,) whether derivatives (..., m) have what an element does that just slips or just does not.

    Now and then one takes another way from there. Such a jump is on one side only: where there is one, and the other
    side may be looked at, the lesser of the two slopes counts.
    """
    most = np.maximum(slope.max(-1), -slope.min(-1))
    return np.asarray(most**2 * slope.shape[-1] > _SPIKE**2 * np.einsum("...i,...i", slope, slope))


def _lesser(a: Array, b: Array) -> Array:
    """The one nearer to zero, zero where their signs differ."""
    return np.where(a * b > 0, np.where(np.abs(a) < np.abs(b), a, b), 0.0)
