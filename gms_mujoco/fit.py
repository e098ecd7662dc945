"""fit: the parameters of a plant from records, by least squares on the torque along the measured motion."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .coordinates import Coordinates
from .errors import DataError
from .inverse import Observation
from .plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


class Misfit:
    """Torque residuals of plants built like one template, over observations, as a function of one vector.

    The vector holds the free parameters, then for each observation the state of the effects before its first
    sample: nobody measured where the elements stood when the recording began.
    """

    def __init__(self, template: Plant, observations: Sequence[Observation], fixed: Collection[str] = ()) -> None:
        self.coordinates = Coordinates(template, fixed)
        self.observations = tuple(observations)
        self.n_memory = template.joint().n_memory
        self.splits = np.cumsum([len(o.index) for o in self.observations])[:-1]

    @property
    def size(self) -> int:
        return self.coordinates.size + self.n_memory * len(self.observations)

    @property
    def bounds(self) -> tuple[Array, Array]:
        lower, upper = self.coordinates.bounds
        ones = np.ones(self.n_memory * len(self.observations))
        return np.append(lower, -ones), np.append(upper, ones)

    def memory(self, x: Array, i: int) -> Array:
        """(n_memory,) state before observation i."""
        start = self.coordinates.size + i * self.n_memory
        return x[start : start + self.n_memory]

    def vector(self, plant: Plant, memories: Sequence[Array] | None = None) -> Array:
        """The vector of a plant whose elements have never moved, or stand as given."""
        rest = np.zeros(self.n_memory * len(self.observations)) if memories is None else np.concatenate(memories)
        return np.append(self.coordinates.encode(plant), rest)

    def settle(self, x: Array, levels: int = 5, sweeps: int = 2) -> Array:
        """`x` with better states before the first sample, by a search over each of them.

        An element forgets its state when it first slips, so the cost has flat parts and steps where a gradient
        is blind; a coarse search per element is not.
        """
        x = x.copy()
        plant = self.coordinates.decode(x[: self.coordinates.size])
        for i in range(len(self.observations) if self.n_memory else 0):
            memory = self.memory(x, i)  # a view into x
            best = _cost(self._one(plant, i, memory))
            for _ in range(sweeps):
                for k in range(self.n_memory):
                    for level in np.linspace(-1, 1, levels):
                        kept, memory[k] = memory[k], level
                        cost = _cost(self._one(plant, i, memory))
                        if cost < best:
                            best = cost
                        else:
                            memory[k] = kept
        return x

    def _one(self, plant: Plant, i: int, memory: Array) -> Array:
        o = self.observations[i]
        return o.applied(plant) - o.needed(plant, memory)

    def residual(self, x: Array) -> Array:
        """(m,) applied torque minus the torque the plant needs, over all observations [N m]."""
        plant = self.coordinates.decode(x[: self.coordinates.size])
        return np.concatenate([self._one(plant, i, self.memory(x, i)) for i in range(len(self.observations))])

    def jacobian(self, x: Array, base: Array | None = None) -> Array:
        """(m, size) derivative of the residual, by forward differences."""
        n = self.coordinates.size
        base = self.residual(x) if base is None else base
        out = np.zeros((len(base), self.size))
        scale = np.where(self.coordinates.is_linear, np.maximum(np.abs(x[:n]), self._typical), 1.0)
        upper = self.bounds[1]
        for j in range(n):
            step = 1e-6 * scale[j]
            if x[j] + step > upper[j]:
                step = -step
            moved = x.copy()
            moved[j] += step
            out[:, j] = (self.residual(moved) - base) / (moved[j] - x[j])
        plant = self.coordinates.decode(x[:n])
        for i, part in enumerate(np.split(base, self.splits)):
            rows = slice(self.splits[i - 1] if i else 0, (self.splits[i - 1] if i else 0) + len(part))
            for k in range(self.n_memory):
                moved = self.memory(x, i).copy()
                step = 1e-6 if moved[k] < 1 else -1e-6
                moved[k] += step
                out[rows, n + i * self.n_memory + k] = (self._one(plant, i, moved) - part) / step
        return out

    @cached_property
    def _typical(self) -> Array:
        """Size at which each linear coordinate matters, from its unit."""
        scales = Scales.of(self.observations)
        return np.array([scales[b.parameter.unit] for b in self.coordinates.blocks for _ in range(b.size)])


def _cost(r: Array) -> float:
    return float(r @ r)


@dataclass(frozen=True)
class Scales:
    """Typical sizes in a set of observations, from which typical sizes of parameters follow by their unit."""

    torque: float
    position: float
    velocity: float
    acceleration: float
    sample_time: float

    @classmethod
    def of(cls, observations: Sequence[Observation]) -> Scales:
        def pooled(values: list[Array]) -> float:
            return float(np.sqrt(np.mean([np.mean(v**2) for v in values]))) or 1.0

        none = Plant.axis(1.0)
        return cls(
            pooled([o.applied(none) for o in observations]),
            pooled([o.position - o.position.mean() for o in observations]),
            pooled([o.velocity for o in observations]),
            pooled([o.acceleration for o in observations]),
            float(np.mean([o.record.sample_time for o in observations])),
        )

    def __getitem__(self, unit: str) -> float:
        t, v = self.torque, self.velocity
        return {
            "N m": t,
            "N m/rad": t / self.position,
            "N m s/rad": t / v,
            "N m s^2/rad^2": t / v**2,
            "N m/s": t * v / self.position,
            "kg m^2": t / self.acceleration,
            "rad": 1.0,
            "rad/s": v,
            "s": self.sample_time,
        }.get(unit, 1.0)


def solve(misfit: Misfit, start: Array, max_steps: int = 40, tolerance: float = 1e-5) -> Array:
    """The vector of least squares near `start`.

    Levenberg-Marquardt on the normal equations, with the parameters that press against a bound held there: many
    of the unknowns (states before the first sample, shares) end on a bound, where interior methods crawl.
    """
    lower, upper = misfit.bounds
    x = np.clip(start, lower, upper)
    r = misfit.residual(x)
    cost, damping = _cost(r), 1e-3
    stalled = 0
    for _ in range(max_steps if misfit.size else 0):
        jacobian = misfit.jacobian(x, r)
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        held = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0)) | (np.diag(hessian) == 0)
        free = np.flatnonzero(~held)
        scale = np.sqrt(np.diag(hessian)[free])
        if not len(free):
            break
        normal = hessian[np.ix_(free, free)] / np.outer(scale, scale)
        before = cost
        for _ in range(12):
            step = np.linalg.solve(normal + damping * np.eye(len(free)), gradient[free] / scale) / scale
            trial = x.copy()
            trial[free] = np.clip(x[free] - np.clip(step, -3, 3), lower[free], upper[free])
            r_trial = misfit.residual(trial)
            cost_trial = _cost(r_trial)
            if cost_trial < cost:
                x, r, cost, damping = trial, r_trial, cost_trial, max(damping / 5, 1e-9)
                break
            damping *= 4
        stalled = stalled + 1 if before - cost <= tolerance * before else 0
        if stalled == 2 or cost == before:
            break
    return x
