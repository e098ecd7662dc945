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

from . import native
from .frf_observation import Seen
from .grid import Grid
from .inverse import Observation, delivered
from .native import series
from .plant import Plant

Array = NDArray[np.float64]

TOLD = "time_steps"  # in the provenance of a plant: [rows that the torque of a step, and the friction, are late]
_FINE = 8  # parts of a step in which the drive's torque is followed


@dataclass(frozen=True)
class TimeSteps(Observation):
    """A record of which every row is a time step.

    Attributes:
        late: rows by which the torque of a step comes after the position that it set out from: 0 where both are
            logged before the step, 1 where the position is that after it.
        ahead: 1 where friction is taken at the end of the step, as MuJoCo takes damping and its constraints; else 0.
    """

    late: int = 0
    ahead: int = 0

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

    @cached_property
    def sparse(self) -> Grid:
        """All samples: a step that is left out is none."""
        return Grid(np.arange(len(self.record), dtype=float))

    def changes(
        self, plant: Plant, joints: Sequence[native.Joint], memories: Sequence[Array | None], grid: Grid | None = None,
        effect: int = 0, apart: int = 0,
    ) -> Array:  # fmt: skip
        """As for an `Observation`, but that friction and other effects of one joint are not told apart."""
        grid = grid or self.grid(plant, memories[0])
        ahead = self.ahead if all(kind == "friction" for kind in joints[0].kinds) else 0
        first = int(self.index[0]) - self._half + ahead
        band = series.Band(self._kernel, first, self.stride, len(self.index))
        known = [m for m in memories if m is not None]
        return self._path(plant, grid).changes(joints, known or None, band, effect, apart)

    def replay(self, plant: Plant, memory: Array | None = None, grid: Grid | None = None) -> Array:
        """As for an `Observation`; the grid has no say."""
        return super().replay(plant, memory)

    def _banded(self, grid: Grid, torque: Array) -> Array:
        return self.band(_moved(torque, self.ahead))

    def _mean(self, joint: native.Joint, memory: Array | None, finer: float = 1.0) -> tuple[Array, Array]:
        r, rubs = self.record, [kind == "friction" for kind in joint.kinds]
        apart = bool(self.ahead) and not all(rubs)
        signals = r.get("load"), r.get("temperature")
        found = joint.replay(r.time, self.position, self.velocity, *signals, memory, parts=apart)
        if found.parts is None:
            torque = _moved(found.torque, self.ahead)
        else:
            torque = _moved(found.parts[:, rubs].sum(1), self.ahead) + found.parts[:, np.logical_not(rubs)].sum(1)
        return torque, np.arange(len(r), dtype=float)

    def delivered(self, plant: Plant) -> Array:
        """(n,) mean torque that the drive of a plant delivered over each step [N m]."""
        return _moved(delivered(plant, self.record, _FINE).reshape(-1, _FINE).mean(1), self.late)

    _delivered = delivered

    @property
    def _mean_command(self) -> Array:
        return _moved(self.record.torque, self.late)


def _moved(x: Array, rows: int) -> Array:
    """A series (n, ...) so many rows later."""
    return np.concatenate([x[rows:], np.repeat(x[-1:], rows, axis=0)]) if rows else x


def in_steps(seen: Sequence[Seen], late: int, ahead: int) -> list[Seen]:
    """Observations, of which the records are time steps."""
    return [
        TimeSteps(o.record, o.bandwidth, o._cutoff, False, late, ahead) if isinstance(o, Observation) else o
        for o in seen
    ]


def as_fitted(seen: Sequence[Seen], provenance: Mapping[str, Any]) -> list[Seen]:
    """Observations as those that a plant was fitted to, by its provenance."""
    told = provenance.get(TOLD)
    return in_steps(seen, *map(int, told)) if told else list(seen)


def steps_of(seen: Sequence[Seen]) -> tuple[int, int] | None:
    """`late` and `ahead` of the records among observations, where they are time steps."""
    return next(((o.late, o.ahead) for o in seen if isinstance(o, TimeSteps)), None)
