"""simulate: a record of an axis, from the same effects that run in MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from .effect import LOADED
from .errors import DataError
from .identification.servo_observation import expect_servo, simulate_run
from .plant import Plant
from .record import Record
from .servo_run import ServoRun

Array = NDArray[np.float64]


@overload
def simulate(
    plant: Plant,
    torque: ServoRun,
    *,
    resolution: float | None = None,
    position_noise: float = 0.0,
    seed: int | None = None,
) -> ServoRun: ...


@overload
def simulate(
    plant: Plant,
    torque: Array,
    sample_time: float,
    *,
    position: float = 0.0,
    velocity: float = 0.0,
    substeps: int = 8,
    resolution: float | None = None,
    torque_noise: float = 0.0,
    position_noise: float = 0.0,
    seed: int | None = None,
    load: Array | None = None,
    temperature: Array | None = None,
    name: str = "simulated",
    use: str = "fit",
) -> Record: ...


def simulate(
    plant: Plant,
    torque: Array | ServoRun,
    sample_time: float | None = None,
    *,
    position: float = 0.0,
    velocity: float = 0.0,
    substeps: int = 8,
    resolution: float | None = None,
    torque_noise: float = 0.0,
    position_noise: float = 0.0,
    seed: int | None = None,
    load: Array | None = None,
    temperature: Array | None = None,
    name: str = "simulated",
    use: str = "fit",
) -> Record | ServoRun:
    """Runs the axis under a torque command, or a servo towards its goal, and returns what a bench would log.

    Args:
        plant: every parameter set.
        torque: (n,) command, held from each sample to the next [N m]; or for a servo that closes its own position loop
            a run, whose goal, power, payload and first position count: it comes back with the position simulated. Of
            the others, only resolution, position noise and seed are for a run.
        sample_time: [s].
        position, velocity: at the first sample [rad], [rad/s].
        substeps: time steps per sample.
        resolution: position of one encoder count [rad]; None: not quantised.
        torque_noise, position_noise: standard deviations of white noise on what is logged [N m], [rad].
        seed: of the noise.
        load, temperature: (n,) held like the torque [N m], [degC]. Friction that grows with a load does with the torque
            where none is given.
        name, use: of the record.

    Raises:
        ModelError: a parameter has no value, a load is heavier than the axis that it is a part of, or the plant takes a
            goal and a torque is given, or the other way round.
        DataError: the motion runs away, or there is no sample time.
    """
    plant.complete()
    if isinstance(torque, ServoRun):
        rng = np.random.default_rng(seed)
        reached = simulate_run(expect_servo(plant), torque)
        return replace(torque, position=_read(reached, position_noise, resolution, rng))
    plant.torque_driven()
    if sample_time is None:
        raise DataError("a torque needs its sample_time [s]")
    plant.light_loads()
    command = np.asarray(torque, float)
    time = np.asarray(sample_time * np.arange(len(command)), float)
    # A drive effect shapes the torque inside a sample: it acts at every time step.
    parts = substeps if plant.drive else 1
    delivered = plant.delivered(command, sample_time, parts)
    carried = delivered if LOADED in plant else None
    motion = plant.joint().simulate(
        plant.driven_inertia, sample_time / parts, delivered, position, velocity, substeps // parts,
        load=carried if load is None else np.repeat(load, parts),
        temperature=None if temperature is None else np.repeat(temperature, parts),
    )  # fmt: skip
    reached, speed = motion.position[::parts], motion.velocity[::parts]
    if not np.isfinite(reached).all():
        raise DataError(f"{name}: the motion runs away under this torque; the plant or the time step cannot be right")
    rng = np.random.default_rng(seed)
    # The time steps add h v to the position with the v at their end: it runs half a step ahead of the velocity.
    seen = reached - sample_time / substeps / 2 * (speed - velocity)
    for effect in plant.effects:
        seen = effect.read(time, seen)
    read = _read(seen, position_noise, resolution, rng)
    signals = {"torque": command + torque_noise * rng.standard_normal(len(time)), "position": read}
    signals |= {k: v for k, v in {"load": load, "temperature": temperature}.items() if v is not None}
    return Record(name, time, signals, use, resolution)


def _read(position: Array, noise: float, resolution: float | None, rng: np.random.Generator) -> Array:
    """(n,) what a noisy encoder makes of a position."""
    read = position + noise * rng.standard_normal(len(position))
    return np.round(read / resolution) * resolution if resolution else read
