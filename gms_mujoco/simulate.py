"""simulate: a record of an axis, from the same effects that run in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import replace
from numbers import Integral
from typing import overload

import numpy as np
from numpy.typing import NDArray

from .effect import LOADED, passed
from .errors import DataError, ModelError, is_number
from .identification.servo_observation import expect_servo, simulate_run
from .plant import Plant
from .record import Record
from .sampling import generator
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
        seed: of the noise, drawn with `default_rng(seed)`: another than that of a torque that is drawn so.
        load, temperature: (n,) held like the torque [N m], [degC]. Friction that grows with a load does with the torque
            where none is given.
        name, use: of the record.

    Raises:
        ModelError: a parameter has no value, a load is heavier than the axis that it is a part of, or the plant takes a
            goal and a torque is given, or the other way round.
        DataError: the motion runs away, or an argument cannot be: a torque that is not finite, no sample time.
    """
    if not isinstance(plant, Plant):
        raise ModelError(f"a Plant is expected, as gms.Plant.load() reads one; {plant!r} given")
    plant.complete()
    expect_bench(position_noise, resolution, torque_noise, substeps)
    rng = generator(seed)
    if isinstance(torque, ServoRun):
        reached = simulate_run(expect_servo(plant), torque)
        return replace(torque, position=_read(reached, position_noise, resolution, rng))
    plant.torque_driven()
    if not is_number(sample_time) or not 0 < sample_time < math.inf:
        raise DataError(f"a torque needs its sample_time, a positive number [s]; {sample_time!r} given")
    plant.light_loads()
    for what, at in (("position", position), ("velocity", velocity)):
        if not is_number(at) or not math.isfinite(at):
            raise DataError(f"{what} must be a finite number; {at!r} given")
    for what, given in (("torque", torque), ("load", load), ("temperature", temperature)):
        if given is not None and np.iscomplexobj(given):
            raise DataError(f"{name}: {what} must be real numbers; complex ones given")
    try:
        command = np.asarray(torque, float)
    except (TypeError, ValueError):
        raise DataError(f"{name}: a torque is one number for each sample; {torque!r} given") from None
    if command.ndim != 1:
        raise DataError(f"{name}: the torque has shape {command.shape}; one number for each sample is expected")
    for what, given in (("torque", command), ("load", load), ("temperature", temperature)):
        if given is None:
            continue
        if np.shape(given) != command.shape:
            raise DataError(f"{name}: {what} has shape {np.shape(given)}, the torque {command.shape}")
        if not np.isfinite(given).all():
            k = int(np.argmin(np.isfinite(given)))
            raise DataError(f"{name}: {what} is {given[k]} at sample {k}, {sample_time * k:g} s; it must be finite")
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
    # The time steps add h v to the position with the v at their end: it runs half a step ahead of the velocity.
    seen = reached - sample_time / substeps / 2 * (speed - velocity)
    for effect in plant.effects:
        seen = passed(effect, "read", time, seen)
    read = _read(seen, position_noise, resolution, rng)
    signals = {"torque": command + torque_noise * rng.standard_normal(len(time)), "position": read}
    signals |= {k: v for k, v in {"load": load, "temperature": temperature}.items() if v is not None}
    return Record(name, time, signals, use, resolution, kind=plant.kind)


def expect_bench(position_noise: float, resolution: float | None, torque_noise: float, substeps: int) -> None:
    """Raises DataError where what is logged, or how finely, cannot be."""
    for name, value in {"position_noise": position_noise, "torque_noise": torque_noise}.items():
        if not is_number(value) or not 0 <= value < math.inf:
            raise DataError(f"{name} must not be negative; {value!r} given")
    if resolution is not None and (not is_number(resolution) or not 0 <= resolution < math.inf):
        raise DataError(f"resolution must not be negative, or None; {resolution!r} given")
    if not is_number(substeps, Integral) or substeps < 1:
        raise DataError(f"substeps must be a whole number from 1 on; {substeps!r} given")


def _read(position: Array, noise: float, resolution: float | None, rng: np.random.Generator) -> Array:
    """(n,) what a noisy encoder makes of a position."""
    read = position + noise * rng.standard_normal(len(position))
    return np.round(read / resolution) * resolution if resolution else read
