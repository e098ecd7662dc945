"""Misfit: what a plant leaves of the measured torque, as a function of one vector of unknowns."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .coordinates import Coordinates
from .frf_observation import Seen
from .grid import Grid
from .plant import Plant
from .scales import Scales
from .starts import visible_limits

Array = NDArray[np.float64]


_STEP = 1e-3  # of the derivatives
_SPIKE = 8.0  # times its root mean square, above which a derivative is looked at from the other side too
_OPENING = 2.0  # s of a record from which the states before it are guessed
_SKEW = 0.1  # of a sample
_LEVELS = (-1.0, 0.0, 1.0, -0.5, 0.5)


class Misfit:
    """Torque residuals of plants built like one template, over observations, as a function of one vector.

    The vector holds the free parameters; then the skew between the clocks of torque and position, which no log
    keeps to better than a fraction of a sample (held at zero where a delay is identified, which contains it); then for
    each observation the state of the effects before its first sample: nobody measured where the elements stood when
    the recording began.
    """

    def __init__(
        self, template: Plant, observations: Sequence[Seen], fixed: Collection[str] = (), memory: bool = True
    ) -> None:
        self.coordinates = Coordinates(template, fixed)
        self.observations = tuple(observations)
        self.n_memory = template.joint().n_memory if memory else 0
        # Where the states before each observation begin and end; a frequency response has none.
        ends = self.n_memory * np.cumsum([0, *(o.has_memory for o in self.observations)])
        self._states = [(int(a), int(b)) for a, b in pairwise(ends)]
        self.n_skew = 1 if self.coordinates.size and any(o.skews for o in self.observations) else 0
        self.splits = np.cumsum([len(o.index) for o in self.observations])[:-1]

    @property
    def n_common(self) -> int:
        """Unknowns that concern all observations."""
        return self.coordinates.size + self.n_skew

    @property
    def size(self) -> int:
        return self.n_common + self._states[-1][1]

    @property
    def bounds(self) -> tuple[Array, Array]:
        lower, upper = self.coordinates.bounds
        lower, upper = np.maximum(lower, self._visible[0]), np.minimum(upper, self._visible[1])
        rest = np.ones(self.size - self.coordinates.size)
        if self.n_skew:
            rest[0] = 0.0 if "delay" in self.coordinates.template else _SKEW * self._shortest
        return np.append(lower, -rest), np.append(upper, rest)

    @cached_property
    def _shortest(self) -> float:
        return min(o.sample_time for o in self.observations if o.skews)

    def skew(self, x: Array) -> float:
        """By which the clock of the torque runs ahead of that of the position [s]."""
        if not self.n_skew:
            return float(self.coordinates.template.provenance.get("clock_skew", 0.0))
        return float(x[self.coordinates.size])

    def held(self, x: Array, gradient: Array) -> NDArray[np.bool_]:
        """(size,) which unknowns press against a bound, for the gradient of the squared residual at `x`."""
        lower, upper = self.bounds
        return ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))

    def memory(self, x: Array, i: int) -> Array | None:
        """(n_memory,) state before observation i; None: the elements have never moved."""
        begin, end = self._states[i]
        return x[self.n_common + begin : self.n_common + end] if end > begin else None

    def memories(self, x: Array, n: int) -> list[Array]:
        """States before each observation, made n long with zeros for effects that this plant does not have yet."""
        out = []
        for i, o in enumerate(self.observations):
            known = self.memory(x, i)
            more = np.zeros(n - self.n_memory if o.has_memory else 0)
            out.append(more if known is None else np.append(known, more))
        return out

    def vector(self, plant: Plant, memories: Sequence[Array] | None = None, skew: float = 0.0) -> Array:
        """The vector of a plant whose elements have never moved, or stand as given."""
        rest = np.zeros(self._states[-1][1]) if memories is None else np.concatenate(memories)
        return np.concatenate([self.coordinates.encode(plant), np.full(self.n_skew, skew), rest])

    def settle(self, x: Array) -> Array:
        """`x` with better states before the first sample, by a search over each of them; and motions of frequency
        responses with the harmonics that they have at `x`.

        An element forgets its state when it first slips, so the cost has flat parts and steps where a gradient
        is blind; a coarse search per element is not. The opening of a record is enough for it.
        """
        x = x.copy()
        plant, skew = self.coordinates.decode(x[: self.coordinates.size]), self.skew(x)
        self.observations = tuple(o.settled(plant) for o in self.observations)
        for i in range(len(self.observations)):
            o, memory = self.observations[i].opening(_OPENING), self.memory(x, i)  # a view into x
            if memory is None:
                continue
            applied = o.applied(plant, skew)
            best = squared(applied - o.needed(plant, memory))
            for level in (*_LEVELS, *_LEVELS):
                for k in range(self.n_memory):
                    kept, memory[k] = memory[k], level
                    cost = squared(applied - o.needed(plant, memory))
                    if cost < best:
                        best = cost
                    else:
                        memory[k] = kept
        return x

    def _one(self, plant: Plant, i: int, x: Array, grid: Grid | None = None) -> Array:
        o = self.observations[i]
        return o.applied(plant, self.skew(x)) - o.needed(plant, self.memory(x, i), grid)

    def residual(self, x: Array) -> Array:
        """(m,) applied torque minus the torque the plant needs, over all observations [N m]."""
        plant = self.coordinates.decode(x[: self.coordinates.size])
        return np.concatenate([self._one(plant, i, x) for i in range(len(self.observations))])

    def cost(self, x: Array) -> float:
        """Squared residual [N^2 m^2]."""
        return squared(self.residual(x))

    def jacobian(self, x: Array, base: Array | None = None, columns: NDArray[np.intp] | None = None) -> Array:
        """(m, size) derivative of the residual, by forward differences; other `columns` than those asked for are 0."""
        n = self.coordinates.size
        base = self.residual(x) if base is None else base
        parts = np.split(base, self.splits)
        starts = np.append(0, self.splits)
        out = np.zeros((len(base), self.size))
        scale = np.where(self.coordinates.is_linear, np.maximum(np.abs(x[:n]), self._typical), 1.0)
        lower, upper = self.bounds
        plant = self.coordinates.decode(x[:n])
        grids = [o.grid(plant, self.memory(x, i)) for i, o in enumerate(self.observations)]

        def difference(column: int, step: float, i: int) -> Array:
            moved = x.copy()
            moved[column] += step
            there = self.coordinates.decode(moved[:n]) if column < n else plant
            return (self._one(there, i, moved, grids[i]) - parts[i]) / (moved[column] - x[column])

        for column in range(self.size) if columns is None else columns:
            common = column < self.n_common
            step = _STEP * (scale[column] if column < n else self._shortest if common else 1.0)
            step = step if x[column] + step <= upper[column] else -step
            # A state before the first sample concerns one observation; a parameter concerns all.
            for i in range(len(parts)) if common else [self._owner(column - self.n_common)]:
                slope = difference(column, step, i)
                # Now and then an element just slips or just does not, and takes another way from there. Such a jump is
                # on one side only.
                within = lower[column] <= x[column] - step <= upper[column]
                if column < n and within and np.abs(slope).max() > _SPIKE * np.sqrt(np.mean(slope**2)):
                    slope = _lesser(slope, difference(column, -step, i))
                out[starts[i] : starts[i] + len(parts[i]), column] = slope
        return out

    def _owner(self, state: int) -> int:
        return next(i for i, (begin, end) in enumerate(self._states) if begin <= state < end)

    def reach(self, x: Array) -> Array:
        """(size,) how far each unknown may plausibly move from `x`, where a linear model of it still says something."""
        n = self.coordinates.size
        near = np.where(self.coordinates.is_linear, np.maximum(np.abs(x[:n]), self._typical), 0.5)
        return np.append(near, 0.5 * self.bounds[1][n:])

    @cached_property
    def _visible(self) -> tuple[Array, Array]:
        """Bounds of each coordinate inside which the observations say something about it."""
        lower, upper = np.full(self.coordinates.size, -np.inf), np.full(self.coordinates.size, np.inf)
        limits = visible_limits(self.coordinates.template, self.observations)
        for i, label in enumerate(self.coordinates.labels):
            if label in limits:
                lower[i], upper[i] = np.log(limits[label])
        return lower, upper

    @cached_property
    def _typical(self) -> Array:
        """Size at which each linear coordinate matters, from its unit."""
        scales = Scales.of(self.observations)
        return np.array([scales[b.parameter.unit] for b in self.coordinates.blocks for _ in range(b.size)])


def squared(r: Array) -> float:
    """r @ r."""
    return float(r @ r)


def _lesser(a: Array, b: Array) -> Array:
    """The one nearer to zero, zero where their signs differ."""
    return np.where(a * b > 0, np.where(np.abs(a) < np.abs(b), a, b), 0.0)
