"""simulate: a record of an axis, from the same effects that run in MuJoCo."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, ModelError, listing
from .plant import Plant
from .record import Record

Array = NDArray[np.float64]


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
) -> Record:
    """Runs the axis under a torque command and returns what a bench would log.

    Args:
        plant: every parameter set.
        torque: (n,) command, held from each sample to the next [N m].
        sample_time: [s].
        position, velocity: at the first sample [rad], [rad/s].
        substeps: time steps per sample.
        resolution: position of one encoder count [rad]; None: not quantised.
        torque_noise, position_noise: standard deviations of white noise on what is logged [N m], [rad].
        seed: of the noise.
        load, temperature: (n,) held like the torque [N m], [degC].
        name, use: of the record.

    Raises:
        ModelError: a parameter has no value, or a load is heavier than the axis that it is a part of.
        DataError: the motion runs away.
    """
    plant.complete().torque_driven()
    if plant.driven_inertia <= 0:
        loads = listing(e.name for e in plant.effects if e.hidden_inertia)
        raise ModelError(f"{loads} must have less inertia than the axis, {plant.inertia:g}, of which it is a part")
    command = np.asarray(torque, float)
    time = np.asarray(sample_time * np.arange(len(command)), float)
    # A drive effect shapes the torque inside a sample: it acts at every time step.
    parts = substeps if plant.drive else 1
    delivered = plant.delivered(command, sample_time, parts)
    motion = plant.joint().simulate(
        plant.driven_inertia, sample_time / parts, delivered, position, velocity, substeps // parts,
        load=None if load is None else np.repeat(load, parts),
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
    read = seen + position_noise * rng.standard_normal(len(time))
    if resolution:
        read = np.round(read / resolution) * resolution
    signals = {"torque": command + torque_noise * rng.standard_normal(len(time)), "position": read}
    signals |= {k: v for k, v in {"load": load, "temperature": temperature}.items() if v is not None}
    return Record(name, time, signals, use, resolution)
