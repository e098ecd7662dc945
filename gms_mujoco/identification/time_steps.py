"""TimeSteps: a log whose rows are the time steps of a simulation, seen as that simulation took them.

Most simulators, MuJoCo's Euler among them, move an axis by semi-implicit Euler, v += h a, q += h v, and who logs every
step has in the differences of his positions the accelerations themselves, without a mean over anything:

    J (q[k+1] - 2 q[k] + q[k-1]) / h^2 = u[k] + f(q[k], v[k]),  v[k] = (q[k] - q[k-1]) / h.

Seen as a motion that goes on between its samples (`inverse`) such an axis is off by half a step of everything: of
MuJoCo's default of 2 ms by half a percent of the torque, which no effect explains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..native import series
from ..plant import Plant
from .between_samples import delivered, moved
from .frf_observation import Seen
from .grid import Grid
from .inverse import FINE, Observation

Array = NDArray[np.float64]

TOLD = "time_steps"  # in the provenance of a plant: `late`, and the two of `ahead`
RESTS = "rests_unasked"  # whether nothing was asked where the axis rests within what its encoder resolves
_DAMPING = ("viscous", "quadratic_drag")  # what simulators take at the end of a step though not friction
_STATE_APART = 0.01  # of the torque


@dataclass(frozen=True)
class TimeSteps(Observation):
    """A record of which every row is a time step.

    Attributes:
        late: rows by which the torque of a step comes after the position that it set out from: 0 where both are
            logged before the step, 1 where the position is that after it.
        ahead: of friction, and of damping: 1 where it is taken at the end of the step, as MuJoCo takes damping and
            constraints, -1 where it was at the end of the step before, as a state that an actuator integrates; else 0.
    """

    late: int = 0
    ahead: tuple[int, int] = (0, 0)

    substeps = 1  # as it was simulated

    @property
    def negligible(self) -> float:  # type: ignore[override]
        """As for an `Observation`; of friction that a simulation integrates only the state is followed so closely."""
        return _STATE_APART if self.ahead[0] < 0 else super().negligible

    @property
    def skews_within(self) -> tuple[float, float]:
        """As for an `Observation`; time steps have no clock that could run ahead."""
        return 0.0, 0.0

    def acting_early(self) -> TimeSteps:
        """Itself."""
        return self

    @cached_property
    def velocity(self) -> Array:
        """(n,) velocity with which each step ended [rad/s]."""
        v = np.diff(self.position) / self.record.sample_time
        return np.append(v[:1], v)

    def _asked_beside(self, still: NDArray[np.bool_]) -> Array:
        return np.where(still, 0.0, 1.0)  # steps that end at rest, each of which stands alone

    @cached_property
    def sparse(self) -> Grid:
        """All samples: a step that is left out is none."""
        return Grid(np.arange(len(self.record), dtype=float))

    def changes(
        self, plant: Plant, joints: Sequence[native.Joint], memories: Sequence[Array | None], grid: Grid | None = None,
        effect: int = 0, apart: int = 0,
    ) -> Array:  # fmt: skip
        """As for an `Observation`, but that the effects of one joint are not told apart."""
        grid = grid or self.grid(plant, memories[0])
        rows = max(self._rows(joints[0]), key=abs)
        first = int(self.index[0]) - self._half + rows
        asked = None if self._asked is None else moved(self._asked, -rows)
        band = series.Band(self._kernel, first, self.stride, len(self.index), asked=asked)
        known = [m for m in memories if m is not None]
        return self._path(plant, grid).changes(joints, known or None, band, effect, apart)

    def replay(
        self, plant: Plant, memory: Array | None = None, grid: Grid | None = None, finer: float = 1.0
    ) -> Array:
        """As for an `Observation`; the grid has no say, nor what error there may be."""
        return super().replay(plant, memory)

    def _banded(self, grid: Grid, torque: Array) -> Array:
        return self.band(moved(torque, self.ahead[0]))  # of friction elements, the only ones that are asked for

    def _mean(self, joint: native.Joint, memory: Array | None, finer: float = 1.0) -> tuple[Array, Array]:
        r, rows = self.record, self._rows(joint)
        signals = r.get("load"), r.get("temperature")
        parts = joint.replay(r.time, self.position, self.velocity, *signals, memory, parts=True).parts
        assert parts is not None
        torque = sum((moved(f, k) for f, k in zip(parts.T, rows, strict=True)), np.zeros(len(r)))
        return torque, np.arange(len(r), dtype=float)

    def _rows(self, joint: native.Joint) -> list[int]:
        """By how many rows each effect of a joint is taken ahead."""
        friction, damping = self.ahead
        return [
            damping if name in _DAMPING else friction if kind == "friction" else 0
            for name, kind in zip(joint.names, joint.kinds, strict=True)
        ]

    def driven(self, plant: Plant) -> Array:
        """As for an `Observation`."""
        return moved(delivered(plant, self.record, FINE).reshape(-1, FINE).mean(1), self.late)

    def _mean_torque(self, plant: Plant) -> Array:
        return self.driven(plant) if plant.drive else moved(self.record.torque, self.late)


def in_steps(seen: Sequence[Seen], late: int, ahead: tuple[int, int]) -> list[Seen]:
    """Observations, of which the records are time steps; those that are already stay as they are."""
    if steps_of(seen) == (late, ahead):
        return list(seen)
    return [
        TimeSteps(o.record, o.bandwidth, o._cutoff, asked=o.asked, late=late, ahead=ahead)
        if isinstance(o, Observation)
        else o
        for o in seen
    ]


def without_rests(seen: Sequence[Seen]) -> list[Seen]:
    """Observations, of which nothing is asked where an axis rests."""
    return [o.without_rests() if isinstance(o, Observation) else o for o in seen]


def as_fitted(seen: Sequence[Seen], provenance: Mapping[str, Any]) -> list[Seen]:
    """Observations as those that a plant was fitted to, by its provenance."""
    if provenance.get(RESTS):
        seen = without_rests(seen)
    if TOLD not in provenance:
        return list(seen)
    late, friction, damping = map(int, provenance[TOLD])
    return in_steps(seen, late, (friction, damping))


def steps_of(seen: Sequence[Seen]) -> tuple[int, tuple[int, int]] | None:
    """`late` and `ahead` of the records among observations, where they are time steps."""
    return next(((o.late, o.ahead) for o in seen if isinstance(o, TimeSteps)), None)
