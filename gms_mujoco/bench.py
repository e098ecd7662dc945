"""A bench in simulation: excites an axis, open loop or inside a position loop, and keeps what the estimates need.

    wave = Excitation.multisine(5e-4, period=2.0, low=2.0, high=300.0, rms=2e-3, seed=1)
    frf = measure(plant, wave.realisations(4, seed=2), resolution=COUNT).frf()
    loop = measure(plant, wave, controller=lambda: PID(inertia, 5e-4, bandwidth=20.0))
    frf = loop.frf()                                    # indirect: without the bias of feedback

The drive holds its torque for a sample, the encoder reads counts at its beginning, as on a real bench. In open loop
the axis is that of `simulate`; inside a loop it is the plug-in in MuJoCo, with the friction that users of MuJoCo get.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .axis import Mechanism
from .errors import DataError, is_number, listing
from .excitation import Excitation
from .frf import FRF, estimate_frf
from .plant import Plant
from .record import Record
from .responses.distortion import Distortion, find_distortion
from .sampling import generator
from .simulate import expect_bench, simulate

Array = NDArray[np.float64]
Controller = Callable[[Array], float]  # an observation of ServoTracking to a torque, as in `gms_mujoco.control`

ENTERS = ("torque", "reference")
_UNLIMITED = 1e9  # N m
_RAMP = 0.75  # of the transient: a signal that sets in at once would leave springs that slip off their centre


@dataclass(frozen=True)
class Measurement:
    """Records of one experiment and what is needed to evaluate them; a frozen value.

    Attributes:
        records: one for each realisation of the excitation.
        excitations: (n,) for each record, the signal that was put in: a torque [N m] or a reference [rad].
        lines: (m,) excited, in multiples of 1 / period.
        period: [s].
        transient: periods to discard.
        closed: whether a loop was closed, so that torque and noise of the encoder depend on each other.
        kind: of the joint.
    """

    records: tuple[Record, ...]
    excitations: tuple[Array, ...]
    lines: NDArray[np.int64]
    period: float
    transient: int
    closed: bool = False
    kind: str = "hinge"

    def frf(self, output: str = "position", **options: Any) -> FRF:
        """From torque to `output`, on the excited lines; H1 in open loop, inside a loop the indirect estimate.

        Args:
            output: a signal of the records.
            **options: what `estimate_frf` takes beside, such as `name`.

        Raises:
            DataError: see `estimate_frf`.
        """
        way: dict[str, Any] = {"method": "indirect", "reference": list(self.excitations)} if self.closed else {}
        given = {"period": self.period, "transient": self.transient, "kind": self.kind, **way, **options}
        found = estimate_frf(list(self.records), "torque", output, **given)
        numbers = np.round(found.frequency * self.period).astype(int)
        return found.where(np.isin(numbers, self.lines))

    def distortion(self, signal: str = "position") -> Distortion:
        """Noise, even and odd distortion of one record, from the lines that are not excited; see `find_distortion`."""
        return find_distortion(self.records[0], self.lines, self.period, self.transient, signal)


def measure(
    plant: Plant,
    excitation: Excitation | Sequence[Excitation],
    *,
    periods: int = 6,
    transient: int = 2,
    controller: Callable[[], Controller] | None = None,
    enters: str = "torque",
    seed: int | None = None,
    name: str = "bench",
    **bench: Any,
) -> Measurement:
    """Excites a simulated axis with whole periods of a signal.

    Args:
        plant: every parameter set.
        excitation: one, or several realisations with the same lines, each a run of its own.
        periods: to evaluate.
        transient: before them, to discard; the signal rises during the first three quarters of them.
        controller: makes a controller for each run, such as `lambda: control.PID(J, h)`; None: open loop.
        enters: whether the excitation is a "torque" [N m], added to that of the controller, or its "reference" [rad].
        seed: of the noise.
        name: of the records.
        **bench: what `simulate` and `run_loop` take: resolution, torque_noise, position_noise, substeps, position.

    Raises:
        DataError: an unknown way in, a reference without a controller, or realisations that do not belong together.
    """
    waves = [excitation] if isinstance(excitation, Excitation) else list(excitation)
    if enters not in ENTERS:
        raise DataError(f"enters must be one of {listing(ENTERS)}; {enters!r} given")
    if enters == "reference" and controller is None:
        raise DataError("a reference needs a controller that follows it; give one, or let the excitation be a torque")
    if not waves:
        raise DataError("no excitation; at least one is needed")
    for what, count, least in (("periods", periods, 1), ("transient", transient, 0)):
        if not is_number(count, Integral) or count < least:
            raise DataError(f"{what} must be a whole number from {least} on; {count!r} given")
    first = waves[0]
    for w in waves:
        if len(w.wave) != len(first.wave) or w.sample_time != first.sample_time or not np.array_equal(
            w.lines, first.lines
        ):
            raise DataError("realisations must have equal period, sample time and lines; see Excitation.realisations")
    records, signals = [], []
    for i, wave in enumerate(waves):
        n = (periods + transient) * len(wave.wave)
        # Two samples more: the velocity of a reference at its end is one-sided, which would not be periodic.
        longer = wave.repeat(periods + transient + 1, _RAMP * transient)[: n + 2]
        kept: dict[str, Any] = {"seed": None if seed is None else seed + i}
        kept["name"] = f"{name} {i + 1}" if len(waves) > 1 else name
        if controller is None:
            record = simulate(plant, longer[:n], wave.sample_time, **kept, **bench)
        else:
            still = np.full(n + 2, float(bench.get("position", 0.0)))
            reference, torque = (still, longer) if enters == "torque" else (still + longer, None)
            record = run_loop(plant, controller(), reference, wave.sample_time, added=torque, **kept, **bench)
        records.append(record.slice(0, n))
        signals.append(longer[:n])
    return Measurement(
        tuple(records), tuple(signals), first.lines, first.period, transient, controller is not None, plant.kind
    )


def run_loop(
    plant: Plant,
    controller: Controller,
    reference: Array,
    sample_time: float,
    *,
    added: Array | None = None,
    position: float = 0.0,
    substeps: int = 8,
    resolution: float | None = None,
    torque_limit: float = math.inf,
    torque_noise: float = 0.0,
    position_noise: float = 0.0,
    seed: int | None = None,
    name: str = "loop",
    use: str = "fit",
) -> Record:
    """Runs the axis in MuJoCo under a controller and returns what a bench would log.

    At each sample the encoder is read, the controller answers at once, and the drive holds its torque until the next.

    Args:
        plant: every parameter set.
        controller: an observation of `ServoTracking` (8,) to a torque [N m], as those of `gms_mujoco.control`.
        reference: (n,) position to follow [rad].
        sample_time: [s].
        added: (n,) torque put in beside that of the controller [N m].
        position: at the first sample [rad].
        substeps: time steps of MuJoCo in a sample.
        resolution: position of one encoder count [rad]; None: not quantised.
        torque_limit: of the drive [N m]; the torque logged is the one within it.
        torque_noise: standard deviation of white noise on the torque that is logged [N m].
        position_noise: the same on the reading, which the controller sees too [rad].
        seed: of the noise.
        name, use: of the record.

    Raises:
        ModelError: a parameter has no value.
        DataError: the signals differ in length, or the motion runs away.
    """
    expect_bench(position_noise, resolution, torque_noise, substeps)
    if not isinstance(torque_limit, Real) or not torque_limit > 0:
        raise DataError(f"torque_limit must be positive [N m]; {torque_limit!r} given")
    reference = np.asarray(reference, float)
    n = len(reference)
    extra = np.zeros(n) if added is None else np.asarray(added, float)
    if extra.shape != reference.shape:
        raise DataError(f"{name}: the torque added has shape {extra.shape}, the reference {reference.shape}")
    limit = min(torque_limit, _UNLIMITED)
    model = Mechanism(plant).build(plant.complete(), sample_time / substeps, limit)
    data = mujoco.MjData(model)
    data.qpos[0] = position
    time = np.asarray(sample_time * np.arange(n), float)
    sensors = [e for e in plant.effects if e.kind == "sensor"]
    rng = generator(seed)
    noise = position_noise * rng.standard_normal(n)
    speed = np.gradient(reference, sample_time)
    observed = np.column_stack([  # in the order of ServoTracking
        np.zeros(n), reference, speed, np.gradient(speed, sample_time), np.append(reference[1:], reference[-1]),
        np.zeros((n, 3)),
    ])  # fmt: skip
    torque, readings = np.empty(n), np.empty(n)
    last, held = math.nan, 0.0
    half = sample_time / substeps / 2  # MuJoCo's position runs half a time step ahead of its velocity
    for k in range(n):
        seen = data.qpos[0] - half * data.qvel[0]
        for e in sensors:
            seen = float(e.read(time[k : k + 1], np.array([seen]))[0])
        seen += noise[k]
        if resolution:
            seen = round(seen / resolution) * resolution
        if not abs(seen) < math.inf:
            raise DataError(f"{name}: the motion runs away at {time[k]:.4g} s; is the loop stable?")
        row = observed[k]
        row[0], row[5], row[7] = seen, reference[k] - seen, held
        row[6] = 0.0 if k == 0 else (seen - last) / sample_time
        last = readings[k] = seen
        held = torque[k] = min(max(float(controller(row)) + extra[k], -limit), limit)
        data.ctrl[0] = held
        mujoco.mj_step(model, data, substeps)
    if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or np.abs(readings).max() > 1e6:
        raise DataError(f"{name}: the motion runs away; is the loop stable?")
    torque += torque_noise * rng.standard_normal(n)
    return Record(name, time, {"torque": torque, "position": readings}, use, resolution, kind=plant.kind)
