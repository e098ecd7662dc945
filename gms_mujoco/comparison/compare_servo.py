"""compare, for a servo that closes its own position loop: where the simulated position leaves the measured one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..identification.servo_observation import ServoObservation, errors_of
from ..plant import Plant

Array = NDArray[np.float64]

REGIMES = ("at rest", "moving", "without power")
_AT_REST = 0.05  # of the rms of the velocity


@dataclass(frozen=True)
class ServoComparison:
    """One run against the plant, whose motion is simulated from the goal.

    Attributes:
        name, use: of the run.
        position_error: mean absolute error of the simulated position [rad].
        simulation_error: rms of the same over the rms of the measured position about its mean.
        noise_floor: the position error that the measurement leaves by itself, see `observe_servos` [rad].
        time: (m,) [s].
        goal, position, simulated: (m,) [rad].
        velocity: (m,) of the measured position [rad/s].
        floor: (m,) error that the measurement leaves by itself, one draw [rad].
        observation: the run.
    """

    name: str
    use: str
    position_error: float
    simulation_error: float
    noise_floor: float
    time: Array
    goal: Array
    position: Array
    velocity: Array
    simulated: Array
    floor: Array
    observation: ServoObservation = field(repr=False)

    @property
    def error(self) -> float:
        """The position error [rad]."""
        return self.position_error

    @property
    def measured(self) -> Array:
        """(m,) position [rad]."""
        return self.position

    @property
    def residual(self) -> Array:
        """(m,) measured minus simulated position [rad]."""
        return self.position - self.simulated

    @property
    def sampling(self) -> Array:
        """(m,) zeros: no part of the floor is known."""
        return np.zeros(len(self.time))

    @property
    def regime(self) -> NDArray[np.intp]:
        """(m,) number in `REGIMES` of each sample."""
        usual = float(np.sqrt(np.mean(self.velocity**2)))
        powered = self.observation.run.powered[self.observation.index] > 0.5
        return np.where(~powered, 2, np.where(np.abs(self.velocity) > _AT_REST * usual, 1, 0))

    def to_dict(self) -> dict[str, Any]:
        """As `compare --json` writes it."""
        run = self.observation.run
        return {
            "name": self.name,
            "use": self.use,
            "position_error": self.position_error,
            "simulation_error": self.simulation_error,
            "noise_floor": self.noise_floor,
            "gain": run.gain,
            "payload_inertia": run.inertia,
            "payload_torque": run.weight,
        }


def compare_servo(plant: Plant, o: ServoObservation, rng: np.random.Generator) -> ServoComparison:
    """A run against a plant with every parameter set."""
    measured, simulated = o.applied(plant), o.simulated(plant)
    error = measured - simulated
    floor = errors_of(o.floor(rng))
    about = float(np.std(measured))
    return ServoComparison(
        o.name,
        o.use,
        float(np.mean(np.abs(error))),
        float(np.sqrt(np.mean(error**2))) / about if about > 0 else float("nan"),
        float(np.mean(np.abs(floor))),
        o.time,
        o.run.goal[o.index],
        measured,
        o.velocity[o.index],
        simulated,
        floor,
        o,
    )


def table(rows: Sequence[ServoComparison], pooled: tuple[float, float, float]) -> str:
    """Errors of each run and pooled, as text."""
    width = max([len(r.name) for r in rows] + [6])
    lines = [
        "mean absolute error of the position simulated from the goal [mrad]; simulation: rms in % of the position's",
        f"{'record':{width}}  {'use':8}  {'gain':>6}  {'payload [N m]':>13}  {'position':>8}  {'floor':>8}  "
        f"{'simulation':>10}",
    ]
    for r in rows:
        run = r.observation.run
        lines.append(f"{r.name:{width}}  {r.use:8}  {run.gain:6g}  {run.weight:13.3g}  {1e3 * r.position_error:8.2f}  "
                     f"{1e3 * r.noise_floor:8.2f}  {100 * r.simulation_error:10.2f}")
    lines.append(f"{'pooled':{width}}  {'':8}  {'':6}  {'':13}  {1e3 * pooled[0]:8.2f}  {1e3 * pooled[1]:8.2f}  "
                 f"{100 * pooled[2]:10.2f}")
    return "\n".join(lines)


