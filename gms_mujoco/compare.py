"""compare: where a plant and measurements disagree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .comparison.compare_frf import FrfComparison, compare_frf, table
from .comparison.compare_servo import ServoComparison, compare_servo
from .comparison.compare_servo import table as servo_table
from .comparison.residual_maps import Regime, ResidualMap
from .comparison.residuals import Residuals
from .comparison.score import POSITION, TORQUE, Score, relative_error
from .comparison.servo_residuals import ServoResiduals
from .identification.coordinates import all_labels
from .identification.frf_observation import FrfObservation, Seen
from .identification.inverse import Observation
from .identification.least_squares import solve
from .identification.misfit import Misfit
from .identification.noise import Noise, floor_residual, inertia_along, noise_of, sampling_residual
from .identification.observe import Data, driven, loaded, observe
from .identification.servo_observation import ServoObservation
from .identification.time_steps import TOLD, as_fitted
from .plant import Plant
from .record import USES
from .threads import each

Array = NDArray[np.float64]

_RESTS = 0.5  # of the squared error, that is left where friction is determined: else most stands elsewhere
WINDOW = 0.05  # s, over which a forward simulation is judged


@dataclass(frozen=True)
class RecordComparison:
    """One record against the plant.

    Attributes:
        name, use: of the record.
        torque_error: rms of measured minus needed torque over rms of measured torque.
        simulation_error: rms of simulated minus measured change of position over windows of `WINDOW`, each started
            from the measured state, over the rms of that change.
        noise_floor: the torque error that sensor noise, quantisation and sampling alone leave.
        time: (m,) [s].
        position, velocity: (m,) smoothed [rad], [rad/s].
        measured: (m,) band-limited torque that was applied [N m].
        needed: (m,) band-limited torque that the plant needs along the measured motion [N m].
        floor: (m,) residual that sensors and sampling alone leave, one draw [N m].
        memory: state of the effects before the first sample, estimated on the record; None: there is none.
        sampling: (m,) the part of `floor` that is known, not drawn: what sampling does to the needed torque [N m].
        observation: the record through its band, where the joint was given the plant's sensor effects.
    """

    name: str
    use: str
    torque_error: float
    simulation_error: float
    noise_floor: float
    time: Array
    position: Array
    velocity: Array
    measured: Array
    needed: Array
    floor: Array
    memory: Array | None = None
    sampling: Array = field(kw_only=True, repr=False)
    observation: Observation = field(kw_only=True, repr=False)

    @property
    def error(self) -> float:
        """The torque error."""
        return self.torque_error

    @property
    def residual(self) -> Array:
        """(m,) measured minus needed torque [N m]."""
        return self.measured - self.needed


@dataclass(frozen=True)
class Comparison:
    """A plant against records, pooled with equal weights.

    Attributes:
        plant: what was compared.
        records: one comparison per record.
        frfs: one per frequency response.
        servos: one per run of a servo, which has no records and responses beside it.
        torque_error, simulation_error, noise_floor: as for one record or response, pooled; no torque error of a servo.
        bandwidth: up to which torques are compared [Hz].
    """

    plant: Plant
    records: tuple[RecordComparison, ...]
    torque_error: float
    simulation_error: float
    noise_floor: float
    bandwidth: float
    frfs: tuple[FrfComparison, ...] = ()
    servos: tuple[ServoComparison, ...] = ()

    @property
    def rows(self) -> tuple[RecordComparison | FrfComparison | ServoComparison, ...]:
        """All comparisons, records first."""
        return (*self.records, *self.frfs, *self.servos)

    @property
    def loudest(self) -> str:
        """Name of the record or response that most of the squared error stands in."""
        return max(self.rows, key=lambda r: float(r.residual @ r.residual)).name

    @property
    def timed(self) -> tuple[RecordComparison | ServoComparison, ...]:
        """Those of what was measured in time."""
        return self.records or self.servos

    @property
    def score(self) -> Score:
        """What the error and the floor are of, and how they are told."""
        return POSITION if self.servos else TORQUE.of_kind(self.plant.kind)

    @property
    def position_error(self) -> float:
        """Mean absolute error of the position of a servo, simulated from the goal [rad]; NaN of records of torque."""
        return POSITION.pooled([r.residual for r in self.servos], [r.measured for r in self.servos])

    @property
    def error(self) -> float:
        """The torque error, or of a servo the position error [rad]."""
        return self.position_error if self.servos else self.torque_error

    @cached_property
    def determined(self) -> tuple[float, float]:
        """The part of the error, and of the noise floor, where the motion determines what friction does; see
        `Observation.determined`. All of both where it never does."""
        if not self.records:
            return self.error, self.noise_floor
        told = [r.observation.determined for r in self.records] + [np.ones(len(r.residual), bool) for r in self.frfs]
        if not any(t.any() for t in told):
            return self.error, self.noise_floor
        measured = [r.measured for r in self.rows]

        def part(of: Sequence[Array]) -> float:
            return relative_error([rows * t for rows, t in zip(of, told, strict=True)], measured)

        return part([r.residual for r in self.rows]), part([r.floor for r in self.rows])

    @cached_property
    def _residuals(self) -> Residuals:
        return ServoResiduals(self.plant, self.servos) if self.servos else Residuals(self.plant, self.records)

    @cached_property
    def views(self) -> tuple[ResidualMap, ...]:
        """The residual over time, position, velocity, reversals, frequency ..., each with its noise band."""
        return self._residuals.views() if self.timed else ()

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """The error in pre-sliding, after reversals and in sliding; of a servo at rest, moving and without power."""
        return self._residuals.regimes() if self.timed else ()

    @cached_property
    def where(self) -> str:
        """Where the residual leaves its noise band most, in a few lines."""
        said = self._residuals.where(self.views, self.regimes) if self.timed else ""
        return "\n".join(filter(None, (said, self._at_rest)))

    @property
    def _at_rest(self) -> str:
        """A sentence where most of the error stands where the axis does not move; else empty."""
        error, floor = self.determined
        if not self.records or error**2 >= _RESTS * self.error**2:
            return ""
        rest = 1 - np.mean(np.concatenate([r.observation.determined for r in self.records]))
        return (
            f"in {100 * rest:.0f} % of the time the axis moves less than its encoder resolves, and friction is "
            f"whatever holds it: elsewhere the {self.score.name} is {100 * error:.2f} %, the noise floor "
            f"{100 * floor:.2f} %"
        )

    @cached_property
    def after_reversal(self) -> tuple[Array, Array, Array] | None:
        """Friction along the motion after a reversal, measured and of the plant; see `Residuals.after_reversal`."""
        return self._residuals.after_reversal()

    def by_use(self) -> dict[str, dict[str, float]]:
        """Errors pooled over the records of each use."""
        found = {}
        for use in USES:
            rows = [r for r in self.rows if r.use == use]
            if rows:
                measured = [r.measured for r in rows]
                found[use] = {
                    f"{self.score.of}_error": self.score.pooled([r.residual for r in rows], measured),
                    "noise_floor": self.score.pooled([r.floor for r in rows], measured),
                    "simulation_error": float(np.sqrt(np.mean([r.simulation_error**2 for r in rows]))),
                }
        return found

    def view(self, name: str, record: str = "") -> ResidualMap | None:
        """The view of that name, of all records or of one; None where these records do not have it."""
        return next((m for m in self.views if (m.name, m.record) == (name, record)), None)

    def to_dict(self) -> dict[str, Any]:
        """What `compare --json` writes."""
        return {
            "schema": 1,
            "bandwidth_hz": self.bandwidth,
            "simulation_window_s": None if self.servos else WINDOW,  # a servo is simulated over the whole run
            "torque_error": None if self.servos else self.torque_error,
            "position_error": self.position_error if self.servos else None,
            "error_of": self.score.of,
            "error_unit": self.score.unit,
            "simulation_error": self.simulation_error,
            "noise_floor": self.noise_floor,
            "records": [
                {
                    "name": r.name,
                    "use": r.use,
                    "torque_error": r.torque_error,
                    "simulation_error": r.simulation_error,
                    "noise_floor": r.noise_floor,
                }
                for r in self.records
            ]
            + [r.to_dict() for r in self.servos],
            "where": self.where,
            "regimes": [g.to_dict() for g in self.regimes],
            "views": [m.to_dict() for m in self.views],
            "frfs": [r.to_dict() for r in self.frfs],
        }

    def __str__(self) -> str:
        if self.servos:
            pooled = (self.error, self.noise_floor, self.simulation_error)
            return f"{servo_table(self.servos, pooled)}\n{self.where}"
        shown = [table(self.frfs, self.score.word)] if self.frfs else []
        if not self.records:
            pooled = (self.torque_error, self.noise_floor, self.simulation_error)
            return "\n".join([*shown, "pooled: {} {:.2f}, floor {:.2f}, simulation {:.2f} %".format(
                self.score.word, *(100 * e for e in pooled))])
        width, what = max([len(r.name) for r in self.records] + [6]), self.score.word
        lines = [
            *shown,
            f"{what} up to {self.bandwidth:.0f} Hz, simulation over {1000 * WINDOW:.0f} ms windows; errors in % of rms",
            f"{'record':{width}}  {'use':8}  {what:>8}  {'floor':>8}  {'simulation':>10}",
        ]
        rows = [(r.name, r.use, r.torque_error, r.noise_floor, r.simulation_error) for r in self.records]
        rows.append(("pooled", "", self.torque_error, self.noise_floor, self.simulation_error))
        for name, use, torque, floor, simulation in rows:
            lines.append(
                f"{name:{width}}  {use:8}  {100 * torque:8.2f}  {100 * floor:8.2f}  {100 * simulation:10.2f}"
            )
        return "\n".join([*lines, self.where])


def compare(plant: Plant, data: Sequence[Data], *, bandwidth: float | None = None) -> Comparison:
    """Measured torque against the torque that the plant needs along the measured motion, and forward simulation.

    Of a servo that closes its own position loop the position, simulated from the goal alone, against the measured one.

    Only the unknown state of the effects before the first sample is estimated on the records; the plant stays as
    it is.

    Args:
        plant: every parameter set.
        data: records and frequency responses, or runs of a servo, SI units.
        bandwidth: of records [Hz]; None: that of the plant's fit, or chosen from the noise of the records.

    Raises:
        ModelError: a parameter has no value, a load is heavier than the axis that it is a part of, or the plant takes a
            goal and the data have torques, or the reverse.
        DataError: there is nothing to compare with, it is of the other kind of joint, or the bandwidth is no positive
            number.
    """
    driven(plant, data).complete()
    if bandwidth is None:
        bandwidth = plant.provenance.get("bandwidth")
    observations = observe(loaded(data, plant), plant.inertia, bandwidth, plant)
    found = compare_observations(plant, observations)
    if TOLD not in plant.provenance:
        return found
    # What was identified from a simulation may be compared with a machine, whose log has no time steps.
    provenance = {k: v for k, v in plant.provenance.items() if k != TOLD}
    return min(found, compare_observations(replace(plant, provenance=provenance), observations), key=lambda c: c.error)


def compare_observations(plant: Plant, observations: Sequence[Seen], noise: Noise | None = None) -> Comparison:
    """`compare` on records that are already seen through a band."""
    assert plant.inertia is not None
    observations = as_fitted(observations, plant.provenance)
    frfs = [o for o in observations if isinstance(o, FrfObservation)]
    records = [o for o in observations if isinstance(o, Observation)]
    memories = each(lambda o: _memory(plant, o), records)
    if noise is None:  # as a fit of this plant would estimate it
        left = [_applied(plant, o) - o.needed(plant, m) for o, m in zip(records, memories, strict=True)]
        noise = noise_of(records, left, plant.inertia)
    rng = np.random.default_rng(0)
    servos = tuple(compare_servo(plant, o, rng) for o in observations if isinstance(o, ServoObservation))
    draws = rng.spawn(len(records) + len(frfs))
    todo = zip(records, memories, draws[: len(records)], strict=True)
    judged = tuple(each(lambda t: _compare_one(plant, noise, *t), todo))
    responses = tuple(compare_frf(plant, o, draw) for o, draw in zip(frfs, draws[len(records) :], strict=True))
    rows: tuple[RecordComparison | FrfComparison | ServoComparison, ...] = (*judged, *responses, *servos)
    measured, score = [r.measured for r in rows], observations[0].score
    return Comparison(
        plant,
        judged,
        float("nan") if servos else relative_error([r.residual for r in rows], measured),
        float(np.sqrt(np.mean([r.simulation_error**2 for r in rows]))),
        score.pooled([r.floor for r in rows], measured),
        max(o.bandwidth for o in observations),
        responses,
        servos,
    )


def quick_error(plant: Plant, observations: Sequence[Seen], near: Comparison) -> float:
    """Pooled error of a plant close to one that was compared, with that one's states before the records."""
    if near.servos:
        servos = [o for o in observations if isinstance(o, ServoObservation)]
        wrong = each(lambda o: o.applied(plant) - o.simulated(plant), servos)
        return POSITION.pooled(wrong, wrong)
    observations = as_fitted(observations, plant.provenance)
    skew = float(plant.provenance.get("clock_skew", 0.0))
    applied = [o.applied(plant, skew) for o in observations]
    memories = [plant.carried(near.plant, r.memory) for r in near.records]
    memories += [np.empty(0)] * len(near.frfs)
    pairs = zip(observations, memories, strict=True)
    needed = each(lambda pair: pair[0].needed(plant, pair[1] if len(pair[1]) else None), pairs)
    return relative_error([a - n for a, n in zip(applied, needed, strict=True)], applied)


def _memory(plant: Plant, o: Observation) -> Array | None:
    misfit = Misfit(plant, [o], fixed=all_labels(plant))
    return solve(misfit, misfit.settle(misfit.vector(plant)), max_steps=10) if misfit.n_memory else None


def _applied(plant: Plant, o: Observation) -> Array:
    return o.applied(plant, float(plant.provenance.get("clock_skew", 0.0)))


def _compare_one(
    plant: Plant, noise: Noise, o: Observation, memory: Array | None, rng: np.random.Generator
) -> RecordComparison:
    measured = _applied(plant, o)
    needed = o.needed(plant, memory)
    sampling = sampling_residual(o, plant, memory)
    floor = floor_residual(o, plant, memory, noise, rng, measured - needed, sampling)
    return RecordComparison(
        o.record.name,
        o.record.use,
        relative_error([measured - needed], [measured]),
        _simulation_error(plant, o, memory),
        relative_error([floor], [measured]),
        o.time,
        o.seen_by(plant).position[o.index],
        o.seen_by(plant).velocity[o.index],
        measured,
        needed,
        floor,
        memory,
        sampling=sampling,
        observation=o.seen_by(plant),
    )


def _simulation_error(plant: Plant, o: Observation, memory: Array | None) -> float:
    r, o = o.record, o.seen_by(plant)
    parts, torque = o.substeps, o.driven(plant)
    joint = plant.joint()
    load, temperature = r.get("load"), r.get("temperature")
    fine_load, fine_temperature = (None if x is None else np.repeat(x, parts) for x in (load, temperature))
    states = joint.replay(r.time, o.position, o.velocity, load, temperature, memory, states=True).states
    assert states is not None
    inertia = np.broadcast_to(inertia_along(r, plant.driven_inertia), len(r))
    rigid = r.get("rigid_torque")
    torque = torque if rigid is None else torque - np.repeat(rigid, parts)
    if inertia.min() <= 0:  # an effect has taken more inertia behind a coupling than there is
        return float("nan")
    length = max(round(WINDOW / r.sample_time), 2)
    wrong, moved = [], []
    for a in range(int(o.index[0]), len(r) - length, length):
        here = slice(a * parts, (a + length) * parts + 1)
        motion = joint.simulate(
            float(inertia[a : a + length + 1].mean()), r.sample_time / parts, torque[here], float(o.position[a]),
            float(o.velocity[a]),
            start=float(r.time[a]), state=states[a],
            load=None if fine_load is None else fine_load[here],
            temperature=None if fine_temperature is None else fine_temperature[here],
        )  # fmt: skip
        # Half a time step of the velocity back: see simulate. What was simulated so itself is where it is.
        with np.errstate(over="ignore", invalid="ignore"):
            lead = 0.5 * r.sample_time / parts * (motion.velocity[-1] - motion.velocity[0]) if parts > 1 else 0.0
            simulated = motion.position[-1] - motion.position[0] - lead
        measured = o.position[a + length] - o.position[a]
        wrong.append(simulated - measured)
        moved.append(measured)
    below = float(np.sqrt(np.mean(np.square(moved)))) if moved else 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that runs away has an infinite error
        return float(np.sqrt(np.mean(np.square(wrong)))) / below if below > 0 else float("nan")
