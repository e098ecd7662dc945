"""Misfit: what a plant leaves of the measured torque, as a function of one vector of unknowns."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect
from ..plant import Plant
from ..recent import kept
from ..threads import each
from .coordinates import Coordinates
from .derivatives import jacobian
from .first_state import search_state
from .frf_observation import FrfObservation, Seen, Together, settled
from .grid import Grid
from .inverse import SKEW, Observation
from .noise import Noise
from .scales import Scales
from .servo_observation import ServoObservation
from .servo_starts import untold
from .starts import visible_limits
from .tall import squared

Array = NDArray[np.float64]


ROUNDING = 1e-9  # of the residual: what a move of its whole reach changes by less, the data do not see
_STEP = 1e-3  # of the derivatives
_LEAST_STEP, _MOST_STEP = 0.03, 10.0  # times the usual one
_IMPOSSIBLE = 1e3  # times the torque


class Misfit:
    """Torque residuals of plants built like one template, over observations, as a function of one vector.

    The vector holds the free parameters; then the skew between the clocks of torque and position, which no log
    keeps to better than a fraction of a sample (held at zero where a delay is identified, which contains it); then for
    each observation the state of the effects before its first sample: nobody measured where the elements stood when
    the recording began.

    Args:
        template: which effects there are, and what a fit leaves as it is.
        observations: to explain.
        fixed: see `Coordinates`; also what these observations cannot tell from something else.
        memory: whether the states before the records are unknowns; else nothing has ever moved.
        coarse: torques are looked at where band-limited values stand alone, for a first look at a part of the price.
        freed: see `Coordinates`.
    """

    def __init__(
        self,
        template: Plant,
        observations: Sequence[Seen],
        fixed: Collection[str] = (),
        memory: bool = True,
        coarse: bool = False,
        freed: Collection[str] = (),
    ) -> None:
        self.coordinates = Coordinates(template, (*fixed, *untold(template, observations)), freed=freed)
        self.coarse = coarse
        self.set_grids: list[Grid | None] | None = None
        self.slope_grids: list[Grid | None] | None = None
        self.set_steps: Array | None = None
        self._looked: tuple[Array, list[Grid | None]] = np.empty(0), []
        self._before: dict[tuple[str, bool, bool], list[Array]] = {}  # pieces at `_looked`, for `change`
        self.observe(observations)
        self.n_memory = template.joint().n_memory if memory else 0
        # Where the states before each observation begin and end; a frequency response has none.
        ends = self.n_memory * np.cumsum([0, *(o.has_memory for o in self.observations)])
        self._states = [(int(a), int(b)) for a, b in pairwise(ends)]
        self.n_skew = 1 if self.coordinates.size and any(o.skews for o in self.observations) else 0
        self.splits = np.cumsum([len(o.index) for o in self.observations])[:-1]

    def observe(self, observations: Sequence[Seen]) -> None:
        """Sets what is to be explained; frequency responses that follow each other are worked on together."""
        self.observations = tuple(observations)
        self._residuals: dict[bytes, Array] = {}
        self.floors: dict[bytes, tuple[Noise, list[Array]]] = {}  # see `result_of`
        # Each with the number of its first observation.
        self.pieces: list[tuple[int, Observation | ServoObservation | Together]] = []
        for is_frf, group in groupby(enumerate(self.observations), lambda o: isinstance(o[1], FrfObservation)):
            some = list(group)
            if is_frf:
                self.pieces.append((some[0][0], Together(tuple(o for _, o in some if isinstance(o, FrfObservation)))))
            else:
                self.pieces += [(i, o) for i, o in some if not isinstance(o, FrfObservation)]

    @property
    def n_common(self) -> int:
        """Unknowns that concern all observations."""
        return self.coordinates.size + self.n_skew

    @property
    def size(self) -> int:
        return self.n_common + self._states[-1][1]

    @cached_property
    def prior(self) -> Array:
        """(size,) one over the variance that each unknown has before the data: a state is anywhere from -1 to 1."""
        return np.append(np.zeros(self.n_common), np.full(self.size - self.n_common, 3.0))

    @property
    def bounds(self) -> tuple[Array, Array]:
        lower, upper = self.coordinates.bounds
        lower, upper = np.maximum(lower, self._visible[0]), np.minimum(upper, self._visible[1])
        rest = np.ones(self.size - self.coordinates.size)
        below, above = -rest, rest.copy()
        if self.n_skew:
            within = [o.skews_within for o in self.observations if isinstance(o, Observation)]
            free = self._shortest * ("delay" not in self.coordinates.template)
            below[0], above[0] = min(a for a, _ in within) * free, max(b for _, b in within) * free
        return np.append(lower, below), np.append(upper, above)

    @cached_property
    def _shortest(self) -> float:
        return min(o.sample_time for o in self.observations if o.skews)

    @property
    def most_skew(self) -> float:
        """That no log keeps its clocks better than [s]."""
        return SKEW * self._shortest

    def skew(self, x: Array) -> float:
        """By which the clock of the torque runs ahead of that of the position [s]."""
        if not self.n_skew:
            return float(self.coordinates.template.provenance.get("clock_skew", 0.0))
        return float(x[self.coordinates.size])

    def held(self, x: Array, gradient: Array) -> NDArray[np.bool_]:
        """(size,) which unknowns press against a bound, for the gradient of the squared residual at `x`."""
        lower, upper = self.bounds
        return ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))

    def states(self, i: int) -> tuple[int, int]:
        """Where the state before observation i begins and ends in the vector."""
        begin, end = self._states[i]
        return self.n_common + begin, self.n_common + end

    def memory(self, x: Array, i: int) -> Array | None:
        """(n_memory,) state before observation i; None: the elements have never moved."""
        begin, end = self.states(i)
        return x[begin:end] if end > begin else None

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

    def onto(
        self, plant: Plant, x: Array, observations: Sequence[Seen] | None = None, fixed: Collection[str] = (),
        skew: float | None = None, freed: Collection[str] = (),
    ) -> tuple[Misfit, Array]:  # fmt: skip
        """The problem of another plant, and its vector where everything else is as at `x`.

        Args:
            plant: with at least the effects of this one, at their places.
            x: a vector of this problem.
            observations: as many as this one's, in their order; its own if None.
            fixed: names "effect.parameter" to leave as they are.
            skew: of its clocks [s]; as at `x` if None.
            freed: names of what is an unknown, too.
        """
        out = Misfit(plant, self.observations if observations is None else observations, fixed, freed=freed)
        return out, out.vector(plant, self.memories(x, out.n_memory), self.skew(x) if skew is None else skew)

    def loudest(self, x: Array) -> list[int]:
        """The numbers of the observations, of which most is left first."""
        left = [squared(r) for r in np.split(self.residual(x), self.splits)]
        return sorted(range(len(left)), key=lambda i: -left[i])

    def part(self, x: Array, some: Sequence[int]) -> tuple[Misfit, Array]:
        """The problem of some of the observations by themselves, by number, and its vector where all is as at `x`."""
        plant = self.plant(x)
        out, memories = Misfit(plant, [self.observations[i] for i in some]), self.memories(x, self.n_memory)
        return out, out.vector(plant, [memories[i] for i in some], self.skew(x))

    def settle(self, x: Array) -> Array:
        """`x` with better states before the first sample, by a search over each of them; and motions of frequency
        responses with the harmonics that they have at `x`.
        """
        x = x.copy()
        plant, skew = self.plant(x), self.skew(x)
        if frfs := [o for o in self.observations if isinstance(o, FrfObservation)]:
            there = iter(settled(frfs, plant))
            self.observe([next(there) if isinstance(o, FrfObservation) else o for o in self.observations])

        def one(i: int) -> None:
            memory = self.memory(x, i)  # a view into x
            if memory is not None:
                search_state(self.observations[i], plant, skew, memory)

        each(one, range(len(self.observations)))
        return x

    def residual(self, x: Array) -> Array:
        """(m,) applied torque minus the torque the plant needs, over all observations [N m]; not to be written to.

        Where the bodies behind couplings are more than the whole axis it is very large: there is no such plant.
        """
        return kept(self._residuals, x.tobytes(), lambda: self._look(x))

    def _look(self, x: Array) -> Array:
        """The residual, and at which instants it was taken."""
        plant, skew = self.plant(x), self.skew(x)
        impossible = plant.driven_inertia <= 0

        def one(k: int) -> tuple[Array, Grid | None]:
            i, o = self.pieces[k]
            memory = self.memory(x, i)
            grid = o.sparse if self.set_grids is None else self.set_grids[k]
            if impossible:
                return _IMPOSSIBLE * o.applied(plant, skew), None
            if self.coarse or self.set_grids is not None:
                needed = o.needed(plant, memory, grid)
            else:
                needed, grid = o.look(plant, memory)
            return o.applied(plant, skew) - needed, grid

        parts = each(one, range(len(self.pieces)))
        self._looked, self._before = (x.copy(), [grid for _, grid in parts]), {}
        out = np.concatenate([r for r, _ in parts])
        out.flags.writeable = False
        return out

    def _unseen(self) -> Misfit:
        """The same problem, not looked at yet."""
        out = copy(self)
        out._looked, out._before, out._residuals, out.floors = (np.empty(0), []), {}, {}, {}
        return out

    def coarsely(self) -> Misfit:
        """The same problem for a first look, see `coarse`."""
        out = self._unseen()
        out.coarse = True
        return out

    def on_grids(self, x: Array, finer: float) -> Misfit:
        """The same problem with torques taken at the instants that `x` needs for an error so many times smaller.

        Chosen anew for every `x`, the instants would make the residual jump by more than the last steps of a fit are.
        Its derivatives, which say where to go and not how far, are taken at the usual ones.
        """
        plant, out = self.plant(x), self._unseen()

        def needed(error: float) -> list[Grid | None]:
            return each(lambda t: t[1].grid(plant, self.memory(x, t[0]), error), self.pieces)

        out.slope_grids, out.set_grids = needed(1.0), needed(finer)
        return out

    def cost(self, x: Array) -> float:
        """Squared residual [N^2 m^2]."""
        return squared(self.residual(x))

    def delivered(self, x: Array) -> float:
        """Share of the commanded torque's variance that the drive of the plant at `x` delivers, at most 1.

        A drive that delivers less leaves less to explain, at a limit of zero nothing: squared residuals of plants with
        different drives are compared after division by it.
        """
        plant = self.plant(x)
        if not plant.drive:
            return 1.0
        undriven = replace(plant, effects=tuple(e for e in plant.effects if e not in plant.drive))
        powers = [(np.var(o.applied(plant)), np.var(o.applied(undriven))) for o in self.observations]
        delivered, commanded = np.sum(powers, 0)
        return float(np.clip(delivered / commanded, 1e-9, 1.0)) if commanded > 0 else 1.0

    def plant(self, x: Array) -> Plant:
        """The plant at a vector."""
        return self.coordinates.decode(x[: self.coordinates.size])

    def grids(self, x: Array) -> list[Grid | None]:
        """The instants at which the torques of each observation are taken at `x`."""
        if not np.array_equal(self._looked[0], x):
            self._look(x)
        return self._looked[1]

    def change(self, x: Array, there: Plant, name: str) -> Array:
        """(m,) change of the residual where one effect of the plant at `x` is changed or added.

        Args:
            there: the plant with that effect changed or added, everything else as at `x`.
            name: of the effect.
        """
        here, grids, whole = self.plant(x), self.grids(x), there.part(name) is there
        drives = any(e.name == name for e in there.drive)
        if name not in here and not whole:  # what is new may jump at other instants
            grids = [None] * len(grids)
        numbers = range(len(grids))
        key = name if name in here else "", whole, drives
        if key not in self._before:
            self._before[key] = each(lambda i: self.piece(i, here, name, x, grids[i], whole, drives), numbers)
        after = each(lambda i: self.piece(i, there, name, x, grids[i], whole, drives), numbers)
        return np.concatenate(after) - np.concatenate(self._before[key])

    def changes(self, x: Array, without: Plant, there: Sequence[Plant], name: str) -> Array:
        """(m, k) the same for several plants with one effect more, which is weak; in one pass over each record.

        Args:
            without: a plant that has the effect at a strength of zero.
            there: (k,) plants that have it with as many elements.
            name: of the effect.
        """
        native = without[name].is_native and all(p.unit != "kg m^2" for p in without[name].parameters)
        if not native or not all(isinstance(o, Observation) for _, o in self.pieces):
            return np.stack([self.change(x, plant, name) for plant in there], 1)
        grids, parts = self.grids(x), [plant.part(name) for plant in (without, *there)]
        joints = [part.joint() for part in parts]

        def one(k: int) -> Array:
            i, o = self.pieces[k]
            assert isinstance(o, Observation)
            return o.changes(parts[0], joints, [self.memory_of(part, x, i) for part in parts], grids[k])

        return np.concatenate(each(one, range(len(grids))), axis=1).T

    def piece(
        self, k: int, plant: Plant, name: str, x: Array, grid: Grid | None, whole: bool = False, drives: bool = False
    ) -> Array:
        """(m,) what of the residual of piece k an effect has a hand in; "" for the inertia.

        Torques of effects add: what a change does can be seen where it acts alone. In a simulated motion they do not.

        Args:
            whole: it acts on all others.
            drives: it acts on the torque applied.
        """
        i, o = self.pieces[k]
        part = plant.part(name) if o.additive and not whole else plant
        needed = o.needed(part, self.memory_of(part, x, i), grid)
        return o.applied(plant, self.skew(x)) - needed if drives else -needed

    def memory_of(self, part: Plant, x: Array, i: int) -> Array | None:
        """State of some effects before observation i; None where there are no states."""
        known = self.memory(x, i)
        return None if known is None else part.carried(self.coordinates.template, known)

    def jacobian(self, x: Array, columns: NDArray[np.intp] | None = None) -> Array:
        """(m, size) derivative of the residual, by differences; other `columns` than those asked for are 0."""
        wanted = np.full(self.size, columns is None)
        if columns is not None:
            wanted[columns] = True
        return jacobian(self, x, wanted, self._steps(x) if self.set_steps is None else self.set_steps)

    def _steps(self, x: Array) -> Array:
        """(size,) small steps of each unknown, from its scale."""
        n = self.coordinates.size
        scale = np.where(self.coordinates.is_linear, self._sizes(x), 1.0)
        steps = _STEP * np.concatenate([scale, np.ones(self.size - n)])
        steps[n : self.n_common] *= self._shortest if self.n_skew else 1.0
        return np.asarray(steps)

    def with_steps(self, x: Array, deviation: Array | float) -> Misfit:
        """The same problem with derivatives over steps (size,) about as large as what matters, not much off the usual.

        Slips begin and end at other instants for every parameter: a difference over less than what the data can tell
        sees too few of them, over more it leaves what the data tell apart.
        """
        out, usual = copy(self), self._steps(x)
        out.set_steps = np.clip(deviation, _LEAST_STEP * usual, _MOST_STEP * usual)
        return out

    def of_elements(self, x: Array, effect: Effect, parent: NDArray[np.intp]) -> Array:
        """(elements, m) what each element of a separable effect does to the residual.

        Args:
            x: a vector; the effect stands in the place of that of its name.
            parent: (elements,) the element of the plant at `x` in whose state each begins a record.
        """
        here = self.plant(x)
        part, own = here.replace(effect).part(effect.name), here.memory_places[effect.name]
        place, joint, number = part.memory_places[effect.name], part.joint(), part.number_in_joint(effect.name)

        def one(k: int) -> Array:
            i, o = self.pieces[k]
            memory, before = self.memory(x, i), None
            if memory is not None:
                before = np.zeros(joint.n_memory)
                before[place] = memory[own][parent]
            return o.elements(part, joint, number, before)

        return np.concatenate(each(one, range(len(self.pieces))), axis=1)

    def reach(self, x: Array) -> Array:
        """(size,) how far each unknown may plausibly move from `x`, where a linear model of it still says something."""
        n = self.coordinates.size
        near = np.where(self.coordinates.is_linear, self._sizes(x), 0.5)
        return np.append(near, 0.5 * self.bounds[1][n:])

    def _sizes(self, x: Array) -> Array:
        """(coordinates,) size of each linear coordinate, at least that at which it matters."""
        own = np.where(self.coordinates.is_wave_number, 0.0, np.abs(x[: self.coordinates.size]))
        return np.asarray(np.maximum(own, self._typical))

    @cached_property
    def _visible(self) -> tuple[Array, Array]:
        """Bounds of each coordinate inside which the observations say something about it."""
        lower, upper = np.full(self.coordinates.size, -np.inf), np.full(self.coordinates.size, np.inf)
        limits = visible_limits(self.coordinates.template, self.observations)
        for i, label in enumerate(self.coordinates.labels):
            if label in limits:
                linear = self.coordinates.is_linear[i]
                with np.errstate(divide="ignore"):  # a bound of 0 is none for a logarithm
                    lower[i], upper[i] = limits[label] if linear else np.log(limits[label])
        return lower, upper

    @cached_property
    def _typical(self) -> Array:
        """Size at which each linear coordinate matters, from its unit."""
        scales = Scales.of(self.observations)
        return np.array([scales[b.parameter.unit] for b in self.coordinates.blocks for _ in range(b.size)])
