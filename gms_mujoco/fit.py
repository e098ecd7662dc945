"""fit: the parameters of a plant from records, by least squares on the torque along the measured motion."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from . import effects
from .coordinates import Coordinates
from .errors import DataError
from .inverse import Observation
from .noise import Noise, choose_bandwidth, estimate_noise, floor_residual, refine_noise
from .plant import Plant
from .record import Record
from .scales import Scales
from .starts import starts, visible_limits
from .tall import gram
from .version import __version__

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


# Of the derivatives. A reversal that a smaller step moves across a sample would make them huge and meaningless.
_STEP = 1e-4
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
        self, template: Plant, observations: Sequence[Observation], fixed: Collection[str] = (), memory: bool = True
    ) -> None:
        self.coordinates = Coordinates(template, fixed)
        self.observations = tuple(observations)
        self.n_memory = template.joint().n_memory if memory else 0
        self.n_skew = 1 if self.coordinates.size else 0
        self.splits = np.cumsum([len(o.index) for o in self.observations])[:-1]

    @property
    def n_common(self) -> int:
        """Unknowns that concern all observations."""
        return self.coordinates.size + self.n_skew

    @property
    def size(self) -> int:
        return self.n_common + self.n_memory * len(self.observations)

    @property
    def bounds(self) -> tuple[Array, Array]:
        lower, upper = self.coordinates.bounds
        lower, upper = np.maximum(lower, self._visible[0]), np.minimum(upper, self._visible[1])
        rest = np.ones(self.size - self.coordinates.size)
        rest[: self.n_skew] = 0.0 if "delay" in self.coordinates.template else _SKEW * self._shortest
        return np.append(lower, -rest), np.append(upper, rest)

    @cached_property
    def _shortest(self) -> float:
        return min(o.record.sample_time for o in self.observations)

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
        if not self.n_memory:
            return None
        start = self.n_common + i * self.n_memory
        return x[start : start + self.n_memory]

    def memories(self, x: Array, n: int) -> list[Array]:
        """States before each observation, made n long with zeros for effects that this plant does not have yet."""
        known = [self.memory(x, i) for i in range(len(self.observations))]
        return [np.append(np.empty(0) if m is None else m, np.zeros(n - self.n_memory)) for m in known]

    def vector(self, plant: Plant, memories: Sequence[Array] | None = None, skew: float = 0.0) -> Array:
        """The vector of a plant whose elements have never moved, or stand as given."""
        rest = np.zeros(self.n_memory * len(self.observations)) if memories is None else np.concatenate(memories)
        return np.concatenate([self.coordinates.encode(plant), np.full(self.n_skew, skew), rest])

    def settle(self, x: Array) -> Array:
        """`x` with better states before the first sample, by a search over each of them.

        An element forgets its state when it first slips, so the cost has flat parts and steps where a gradient
        is blind; a coarse search per element is not. The opening of a record is enough for it.
        """
        x = x.copy()
        plant, skew = self.coordinates.decode(x[: self.coordinates.size]), self.skew(x)

        for i in range(len(self.observations) if self.n_memory else 0):
            o, memory = self.observations[i].opening(_OPENING), self.memory(x, i)  # a view into x
            assert memory is not None
            applied = o.applied(plant, skew)
            best = _cost(applied - o.needed(plant, memory))
            for level in (*_LEVELS, *_LEVELS):
                for k in range(self.n_memory):
                    kept, memory[k] = memory[k], level
                    cost = _cost(applied - o.needed(plant, memory))
                    if cost < best:
                        best = cost
                    else:
                        memory[k] = kept
        return x

    def _one(self, plant: Plant, i: int, x: Array) -> Array:
        o = self.observations[i]
        return o.applied(plant, self.skew(x)) - o.needed(plant, self.memory(x, i))

    def residual(self, x: Array) -> Array:
        """(m,) applied torque minus the torque the plant needs, over all observations [N m]."""
        plant = self.coordinates.decode(x[: self.coordinates.size])
        return np.concatenate([self._one(plant, i, x) for i in range(len(self.observations))])

    def cost(self, x: Array) -> float:
        """Squared residual [N^2 m^2]."""
        return _cost(self.residual(x))

    def jacobian(self, x: Array, base: Array | None = None, columns: NDArray[np.intp] | None = None) -> Array:
        """(m, size) derivative of the residual, by forward differences; other `columns` than those asked for are 0."""
        n = self.coordinates.size
        base = self.residual(x) if base is None else base
        parts = np.split(base, self.splits)
        starts = np.append(0, self.splits)
        out = np.zeros((len(base), self.size))
        scale = np.where(self.coordinates.is_linear, np.maximum(np.abs(x[:n]), self._typical), 1.0)
        upper = self.bounds[1]
        plant = self.coordinates.decode(x[:n])

        for column in range(self.size) if columns is None else columns:
            common = column < self.n_common
            step = _STEP * (scale[column] if column < n else self._shortest if common else 1.0)
            if x[column] + step > upper[column]:
                step = -step
            moved = x.copy()
            moved[column] += step
            step = moved[column] - x[column]
            # A state before the first sample concerns one observation; a parameter concerns all.
            where = range(len(parts)) if common else [(column - self.n_common) // self.n_memory]
            there = self.coordinates.decode(moved[:n]) if column < n else plant
            for i in where:
                rows = slice(starts[i], starts[i] + len(parts[i]))
                out[rows, column] = (self._one(there, i, moved) - parts[i]) / step
        return out

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


def _cost(r: Array) -> float:
    return float(r @ r)


def solve(
    misfit: Misfit, start: Array, max_steps: int = 40, tolerance: float = 1e-4, columns: NDArray[np.intp] | None = None
) -> Array:
    """The vector of least squares near `start`.

    Levenberg-Marquardt on the normal equations, with the parameters that press against a bound held there: many
    of the unknowns (states before the first sample, shares) end on a bound, where interior methods crawl.

    Args:
        misfit: the problem.
        start: (size,) where to begin.
        max_steps: at most so many derivatives.
        tolerance: stops when the cost has fallen by a smaller share in two steps.
        columns: the unknowns to move; None: all.
    """
    lower, upper = misfit.bounds
    columns = np.arange(misfit.size) if columns is None else columns
    x = np.clip(start, lower, upper)
    r = misfit.residual(x)
    cost, damping = _cost(r), 1e-3
    stalled = 0
    for _ in range(max_steps if len(columns) else 0):
        jacobian = misfit.jacobian(x, r, columns)[:, columns]
        gradient, hessian = gram(jacobian, r), gram(jacobian, jacobian)
        push = np.zeros(misfit.size)
        push[columns] = gradient
        free = np.flatnonzero(~misfit.held(x, push)[columns] & (np.diag(hessian) > 0))
        if not len(free):
            break
        moving = columns[free]
        scale = np.sqrt(np.diag(hessian)[free])
        normal = hessian[np.ix_(free, free)] / np.outer(scale, scale)
        before = cost
        for _ in range(12):
            step = np.linalg.solve(normal + damping * np.eye(len(free)), gradient[free] / scale) / scale
            trial = x.copy()
            trial[moving] = np.clip(x[moving] - np.clip(step, -3, 3), lower[moving], upper[moving])
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


@dataclass(frozen=True)
class FitResult:
    """What a fit found.

    Attributes:
        plant: with its parameters, their 95 % intervals and their provenance.
        error: rms of the torque residual over rms of the torque, pooled over the records.
        floor: the same from sensor noise alone, for a perfect model.
        status: one sentence.
        misfit, vector: the least-squares problem and its solution.
        noise: of the sensors, from which the floor follows.
    """

    plant: Plant
    error: float
    floor: float
    status: str
    misfit: Misfit
    vector: Array
    noise: Noise


def observe(
    records: Sequence[Record], inertia: float | None = None, bandwidth: float | None = None
) -> list[Observation]:
    """The records seen through one band, chosen from their noise unless given [Hz].

    Raises:
        DataError: there is no record.
    """
    if not records:
        raise DataError("no records to look at; a measurement set needs at least one with use = \"fit\"")
    bandwidth = bandwidth or choose_bandwidth(records, inertia)
    return [Observation(r, bandwidth) for r in records]


def relative_error(residuals: Sequence[Array], torques: Sequence[Array]) -> float:
    """Rms of the residuals over rms of the torques, records of equal weight."""
    above = np.mean([np.mean(r**2) for r in residuals])
    below = np.mean([np.mean(t**2) for t in torques])
    return float(np.sqrt(above / below)) if below > 0 else float("nan")


def baseline(inertia: float | None = None, kind: str = "hinge", elements: int = 8) -> Plant:
    """The default baseline, not yet identified: inertia, GMS friction with its Stribeck level, viscous drag."""
    return Plant.axis(inertia, kind) + effects.find("gms")(elements) + effects.find("viscous")()


def fit(
    plant: Plant,
    records: Sequence[Record],
    *,
    fixed: Collection[str] = (),
    bandwidth: float | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Identifies the free parameters of a plant.

    Least squares on the difference of applied torque and torque needed along the measured motion, over all
    records together, in the band that the sensors allow. Parameters that have no value yet are started from the
    data; the others start where they are.

    Args:
        plant: with or without values; a known inertia stays as it is.
        records: the runs to fit, SI units.
        fixed: names "effect.parameter" to leave as they are.
        bandwidth: [Hz]; None: chosen from the noise of the records.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: no records.
        ModelError: a parameter has no value and cannot be identified.
    """
    report = progress or (lambda done, message: None)
    report(0.0, "looking at the records")
    observations = observe(records, plant.inertia, bandwidth)
    found = fit_observations(plant, observations, fixed, report)
    report(1.0, found.status)
    return found


def fit_observations(
    plant: Plant, observations: Sequence[Observation], fixed: Collection[str] = (), progress: Progress | None = None
) -> FitResult:
    """`fit` on records that are already seen through a band."""
    report = progress or (lambda done, message: None)
    misfit, x = rough_fit(plant, observations, fixed, report)
    report(0.5, "refining")
    return refine(misfit, x, max_steps=40)


def rough_fit(
    plant: Plant, observations: Sequence[Observation], fixed: Collection[str] = (), progress: Progress | None = None
) -> tuple[Misfit, Array]:
    """The best of several starts after a few steps each, with states before the records that are only guessed."""
    report = progress or (lambda done, message: None)
    best: tuple[float, Plant] | None = None
    candidates = starts(plant, observations)
    for i, start in enumerate(candidates):
        report(0.1 + 0.4 * i / len(candidates), f"start {i + 1} of {len(candidates)}")
        misfit = Misfit(start, observations, fixed, memory=False)
        x = solve(misfit, misfit.vector(start), max_steps=10)
        cost = misfit.cost(x)
        if best is None or cost < best[0]:
            best = cost, misfit.coordinates.decode(x)
    assert best is not None
    misfit = Misfit(best[1], observations, fixed)
    return misfit, nudge(misfit, misfit.vector(best[1]))


def nudge(misfit: Misfit, x: Array, max_steps: int = 6) -> Array:
    """A few steps of the parameters alone: enough to see how good a fit will be."""
    return solve(misfit, misfit.settle(x), max_steps, tolerance=3e-3, columns=np.arange(misfit.n_common))


def refine(misfit: Misfit, x: Array, max_steps: int = 20) -> FitResult:
    """The fit next to a vector that is already close: first the few parameters, then all unknowns."""
    x = solve(misfit, misfit.settle(x), max_steps, columns=np.arange(misfit.n_common))
    return _result(misfit, solve(misfit, misfit.settle(x), max_steps // 2))


def _result(misfit: Misfit, x: Array) -> FitResult:
    n = misfit.coordinates.size
    plant = misfit.coordinates.decode(x[:n])
    residual, observations = misfit.residual(x), misfit.observations
    applied = [o.applied(plant) for o in observations]
    error = relative_error(np.split(residual, misfit.splits), applied)
    assert plant.inertia is not None
    noise = refine_noise(
        estimate_noise([o.record for o in observations], plant.inertia),
        observations,
        np.split(residual, misfit.splits),
    )
    rng = np.random.default_rng(0)
    floor = relative_error(
        [floor_residual(o, plant, misfit.memory(x, i), noise, rng) for i, o in enumerate(observations)], applied
    )
    intervals = misfit.coordinates.intervals(x[:n], covariance(misfit, x)[:n, :n])
    provenance = {
        "records": [o.record.name for o in observations],
        "bandwidth": float(observations[0].bandwidth),
        "error": error,
        "noise_floor": floor,
        "clock_skew": misfit.skew(x),
        "version": f"gms_mujoco {__version__}",
    }
    plant = replace(plant, uncertainty=intervals, provenance=provenance)
    status = (
        f"torque error {100 * error:.2f} % of the torque up to {observations[0].bandwidth:.0f} Hz, "
        f"noise floor {100 * floor:.2f} %"
    )
    return FitResult(plant, error, floor, status, misfit, x, noise)


def covariance(misfit: Misfit, x: Array, block: float = 0.25) -> Array:
    """Covariance of the vector that stays right when residuals are correlated and the model is not perfect.

    The sandwich estimate (Huber 1967; White 1980) with residuals summed over blocks of time.

    Args:
        block: length of a block [s].
    """
    residual, jacobian = misfit.residual(x), misfit.jacobian(x)
    scores = block_sums(misfit.observations, jacobian * residual[:, None], block)
    bread = _pseudo_inverse(gram(jacobian, jacobian))
    return bread @ (scores.T @ scores) @ bread * len(scores) / max(len(scores) - misfit.coordinates.size, 1)


def block_sums(observations: Sequence[Observation], rows: Array, block: float) -> Array:
    """(blocks, ...) sums of consecutive rows (m, ...), over blocks of time that end with their record [s]."""
    edges, start = [], 0
    for o in observations:
        length = max(int(block / (o.stride * o.record.sample_time)), 1)
        count = max(len(o.index) // length, 1)
        edges.append(start + length * np.arange(count))
        start += len(o.index)
    return np.add.reduceat(rows, np.concatenate(edges), axis=0)


def _pseudo_inverse(a: Array) -> Array:
    """Inverse of a symmetric matrix, scaled; directions that the data does not see get no spurious certainty."""
    scale = np.sqrt(np.maximum(np.diag(a), 1e-24 * max(np.diag(a).max(initial=0.0), 1e-200)))
    value, vector = np.linalg.eigh(a / np.outer(scale, scale))
    inverse = vector @ np.diag(1 / np.maximum(value, 1e-14)) @ vector.T
    return inverse / np.outer(scale, scale)
