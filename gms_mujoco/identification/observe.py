"""What a fit looks at: records seen through one band, and frequency responses beside them; or runs of a servo."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import numpy as np

from ..dahl_resonance import identify_dahl
from ..effect import LOADED
from ..errors import DataError, ModelError, is_number
from ..frf import FRF, usable
from ..logs.plausible import filled
from ..plant import Plant
from ..record import Record
from ..servo_run import ServoRun
from .between_samples import mean_torque
from .coordinates import Coordinates
from .frf_observation import FrfObservation, Seen, balanced, observe_frfs, rescaled
from .inverse import Observation
from .noise import choose_bandwidth, estimate_noise, rough_inertia, shows_noise
from .servo_observation import expect_servo, observe_servos

_LEAST_DEVIATION = 3e-3  # of the torque in records: no model of one is better


Data = Record | FRF | ServoRun


def driven(plant: Plant, data: Sequence[Data]) -> Plant:
    """Itself; raises ModelError where it takes a goal and the data have torques, or the other way round, where a load
    in it is heavier than its axis, and where it is no plant, DataError where the data are no measurements, are of the
    other kind of joint, or lack the temperature that an effect of it follows."""
    if not isinstance(plant, Plant):
        raise ModelError(f"a plant is expected before the data, as gms.baseline() is one; {_kind(plant)} given")
    if isinstance(data, str | Path) or not isinstance(data, Iterable):
        raise DataError("the data are a list of records, frequency responses or runs, as those of a measurement set "
                        f"are: gms.load(...).fit; {_kind(data)} given")
    for other in (d for d in data if not isinstance(d, Data)):
        raise DataError("the data are records, frequency responses or runs of a servo, as those of a measurement set "
                        f"are: gms.load(...).fit; {_kind(other)} among them")
    if any(isinstance(d, ServoRun) for d in data):
        return expect_servo(plant)
    for d in data:
        if isinstance(d, FRF | Record):
            d.of_kind(plant.kind)
    without = next((d.name for d in data if isinstance(d, Record) and d.get("temperature") is None), None)
    for effect in plant.effects if without is not None else ():
        if name := effect.thermometer:
            raise DataError(f"{without} has no temperature [degC], which {effect.name} follows where it has {name}; "
                            f"log it, or leave {name} away")
    return plant.torque_driven().light_loads()


def is_enough(observations: Sequence[Seen], plant: Plant, fixed: Collection[str] = ()) -> bool:
    """Whether these are as many numbers as a plant has unknowns."""
    return sum(len(o.index) for o in observations) >= Coordinates(plant, fixed).size


def expect_enough(observations: Sequence[Seen], plant: Plant, fixed: Collection[str] = ()) -> None:
    """Raises DataError where these are fewer numbers than a plant has unknowns."""
    if not is_enough(observations, plant, fixed):
        frfs = [o for o in observations if isinstance(o, FrfObservation)]
        points = f" at {sum(len(o.frf) for o in frfs)} frequencies of responses" if frfs else ""
        raise DataError(f"{', '.join(o.name for o in observations)}: {sum(len(o.index) for o in observations)} numbers"
                        f"{points}, and {Coordinates(plant, fixed).size} unknowns of the plant; measure at more "
                        "frequencies and amplitudes, or fit fewer elements")


def _kind(value: object) -> str:
    """What something is, for a message."""
    return repr(value) if isinstance(value, str) else type(value).__name__


def loaded(data: Sequence[Data], plant: Plant) -> list[Data]:
    """The data as a plant sees them whose friction may grow with a load: where a record knows of none the torque of the
    drive is taken for it, of which a gear transmits what the rotor leaves."""
    return [loaded_by_drive(d) if LOADED in plant and isinstance(d, Record) else d for d in data]


def loaded_by_drive(record: Record) -> Record:
    """The record of a gear that transmits the torque of the drive; itself where its load is known."""
    if record.get("load") is not None:
        return record
    return record.with_signals({"transmitted_torque": mean_torque(record)})


def observe(
    data: Sequence[Data],
    inertia: float | None = None,
    bandwidth: float | None = None,
    plant: Plant | None = None,
) -> list[Seen]:
    """Records and frequency responses, or runs of a servo, as observations of one fit, each weighed by its uncertainty.

    Args:
        data: in any order; records come first in the result, readings that were held filled in (`plausible.filled`).
            Beside others, a response that cannot be used (no amplitude, many frequencies at once, not from torque) is
            left out.
        inertia: [kg m^2]; None: unknown.
        bandwidth: of the records [Hz]; None: chosen from their noise.
        plant: what is known of the axis, every parameter set, for the harmonics of its motion under a sinusoidal
            torque; None: from a first reading of the responses.

    Raises:
        DataError: there is nothing to look at, nothing that moves, the band is none or narrower than the records can
            show, or no response can be used and why.
    """
    if bandwidth is not None and not (is_number(bandwidth) and 0 < bandwidth < math.inf):
        raise DataError(f"a bandwidth is a positive number of Hz; {bandwidth!r} given")
    servos = [d for d in data if isinstance(d, ServoRun)]
    if servos:
        if len(servos) < len(data):
            raise DataError("runs of a servo that takes a goal cannot stand beside records of torque")
        return list(observe_servos(servos))
    records = [filled(d)[0] for d in data if isinstance(d, Record)]
    frfs, refused = [], []
    for d in data:
        if isinstance(d, FRF):
            try:
                frfs.append(usable(d))
            except DataError as error:
                refused.append(error)
    if not records and not frfs:
        if refused:
            raise refused[0]
        raise DataError('no records to look at; a measurement set needs at least one with use = "fit"')
    if plant is None and not bandwidth and records and not frfs and not any(np.ptp(r.position) for r in records):
        names = ", ".join(r.name for r in records)
        raise DataError(f"{names}: the position never changes; nothing can be learnt from a joint that does not move")
    told = (np.ptp(r.torque) or r.get("rigid_torque") is not None for r in records)
    if inertia is None and records and not frfs and not any(told):
        names = ", ".join(r.name for r in records)
        raise DataError(f"{names}: the torque never changes, and no inertia is given: nothing tells how large it is; "
                        "is the torque the right column?")
    seen: list[Seen] = []
    scale = None
    if records:
        fastest = 0.5 / min(r.sample_time for r in records)
        bandwidth = min(bandwidth or choose_bandwidth(records, inertia), fastest)
        seen = [_through(r, bandwidth) for r in records]
        scale = _deviation(records, inertia, bandwidth) if frfs else None
    if not frfs:
        return seen
    return [*seen, *rescaled(_balanced(observe_frfs(frfs), inertia, plant), scale)]


def _deviation(records: Sequence[Record], inertia: float | None, bandwidth: float) -> float:
    """Of the torque in records through a band: of the two parts of a complex number together [N m]."""
    h = float(np.mean([r.sample_time for r in records]))
    noise = estimate_noise(records, inertia or rough_inertia(records)).torque * math.sqrt(2 * h * bandwidth)
    usual = math.sqrt(float(np.mean([np.mean(r.torque**2) for r in records])))
    return max(noise, _LEAST_DEVIATION * usual) * math.sqrt(2)


def _through(record: Record, bandwidth: float) -> Observation:
    """A record through a band [Hz]; DataError where it is too short for it."""
    seen = Observation(record, bandwidth)
    if not shows_noise(seen):
        long = record.time[-1] - record.time[0]
        raise DataError(f"{record.name}: {long:.3g} s in {len(record)} samples are too short "
                        f"for a bandwidth of {bandwidth:.3g} Hz; give more of it, or another bandwidth")
    return seen


def _balanced(
    observations: list[FrfObservation], inertia: float | None, plant: Plant | None
) -> list[FrfObservation]:
    try:
        near = plant or identify_dahl([o.frf for o in observations], inertia).plant
    except DataError:  # nothing that is read as friction: no harmonics to begin with
        return observations
    return balanced(observations, near) or observations
