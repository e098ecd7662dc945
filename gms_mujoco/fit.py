"""fit: the parameters of a plant from measurements, by least squares on the torque along the measured motion."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import effects
from .candidates import is_open, joined
from .effect import Effect
from .errors import ModelError
from .frf_observation import FrfObservation, Seen, without_outliers
from .intervals import covariance
from .inverse import Observation
from .least_squares import agreed, approach, nudge, solve
from .linear_model import determined
from .misfit import Misfit
from .noise import Noise, believable, floor_residual, noise_of
from .observe import Data, driven, observe
from .placement import placed
from .plant import Plant
from .progress import Progress
from .rough import begun, best_start
from .score import Score
from .screen import Screen
from .servo_observation import ServoObservation, errors_of
from .starts import other_weakenings
from .tall import squared
from .threads import one_blas_thread
from .time_steps import RESTS, TOLD, TimeSteps, in_steps, steps_of, without_rests
from .undetermined import left_open, never_slips, undetermined
from .version import __version__

Array = NDArray[np.float64]

_FINER = 10.0  # than the instants that a replay takes, for the last steps
_SHARP = 0.3  # of the variance of a row: a cost that falls by less moves no parameter by much of its interval
_LAST_STEPS = 10  # of each solve at the end
_EARNED, EARLY_SHARE = 0.05, 0.2  # of the squared error, and of that above the floor: less is no habit of a log
_HABITS = 3  # of a log that are asked for, one after the other: early, time steps, and what those take when
_STEPS_SHARE = 0.5  # of the squared error above the floor, that time steps have to take
_RESTS_SHARE, _SHARPER = 0.5, 0.5  # of the squared error, that rests have to hold; times the error, left without them
_NEAR_FLOOR = 1.2  # times the noise floor: hardly more than the sensors leave


@dataclass(frozen=True)
class FitResult:
    """What a fit found.

    Attributes:
        plant: with its parameters, their 95 % intervals and their provenance.
        error: rms of the torque residual over rms of the torque, pooled over the records; of a servo the mean absolute
            error of its position [rad].
        floor: the same from sensor noise alone, for a perfect model.
        status: what was found, and a sentence on friction elements that never slipped.
        misfit, vector: the least-squares problem and its solution.
        noise: of the sensors, from which the floor follows.
        floor_rows: (m,) residual that sensor noise alone leaves, one draw, over all observations [N m].
        negligible: squared residual that is too little to have a cause [N^2 m^2].
    """

    plant: Plant
    error: float
    floor: float
    status: str
    misfit: Misfit
    vector: Array
    noise: Noise
    floor_rows: Array
    negligible: float

    def floor_under(self, noise: Noise, most: Array | None = None) -> Array:
        """(m,) residual that another noise than that found would leave through this plant [N m].

        Args:
            most: (m,) it is no louder than this; None: than what is left.
        """
        left = self.misfit.residual(self.vector) if most is None else most
        return np.concatenate(_floor_rows(self.misfit, self.vector, left, noise))

    @property
    def habit(self) -> str:
        """Sentences on how the records were logged, where that was allowed for; else ""."""
        return _habit(self.misfit, self.vector)

    @property
    def score(self) -> Score:
        """What the error is of."""
        return self.misfit.observations[0].score

    @property
    def undetermined(self) -> dict[str, str]:
        """Parameters that the data do not determine, with the experiment that would."""
        return undetermined(self.plant)


def baseline(
    inertia: float | None = None, kind: str = "hinge", elements: int = 8, controller: str | None = None
) -> Plant:
    """The default baseline, not yet identified: inertia, GMS friction with its Stribeck level, viscous drag.

    Args:
        inertia: [kg m^2]; None: to be identified.
        kind: "hinge" or "slide".
        elements: of GMS.
        controller: "position" for a servo that closes its own position loop: inertia, loop and motor, dry and viscous
            friction.
    """
    if controller == "position":
        bare = Plant.axis(inertia, kind) + effects.find("position_loop")()
        return bare + effects.find("coulomb")() + effects.find("viscous")()
    return Plant.axis(inertia, kind) + effects.find("gms")(elements) + effects.find("viscous")()


@one_blas_thread()
def fit(
    plant: Plant,
    data: Sequence[Data],
    *,
    fixed: Collection[str] = (),
    bandwidth: float | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Identifies the free parameters of a plant.

    Least squares on the difference of applied torque and torque needed along the measured motion, over all
    records together, in the band that the sensors allow, and over every point of frequency responses, each weighed by
    its uncertainty (`frf_observation`). Of a servo that closes its own position loop it is the position, simulated from
    the goal (`servo_observation`). Parameters that have no value yet are started from the
    data; the others start where they are. Of several starts the one that leaves the least after a few steps goes on;
    where it ends above the noise floor it goes on with the weakening of friction that each of them began with, until
    one comes down to the floor. One that does not takes no place: beside an effect that the plant lacks, the lowest is
    the friction that has bent furthest to hide it.

    Records are worked on side by side, on every core that the process may use or on as many threads as the environment
    variable GMS_MUJOCO_THREADS says; the result is the same to the last bit.

    Args:
        plant: with or without values; a known inertia stays as it is.
        data: records and frequency responses, or runs of a servo, SI units.
        fixed: names "effect.parameter" to leave as they are.
        bandwidth: of the runs [Hz]; None: chosen from the noise of the records.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: nothing to fit, or a response that cannot be used alone.
        ModelError: a parameter has no value and cannot be identified, the plant has none of a name in `fixed`, or it
            takes a goal and the data have torques, or the other way round.
    """
    report = progress or (lambda done, message: None)
    driven(plant, data).expect_names(fixed)
    report(0.0, "looking at the records")
    observations = observe(data, plant.inertia, bandwidth)
    misfit, x = _by_its_habits(plant, observations, fixed, report)
    found = _weakened_otherwise(_finished(misfit, x), plant, fixed, report)
    report(1.0, found.status)
    return found


def _weakened_otherwise(found: FitResult, plant: Plant, fixed: Collection[str], report: Progress) -> FitResult:
    """The first fit that comes down to the noise floor, of that found and those from it with another weakening of
    friction, of which a few steps tell little; that found where none does."""
    misfit, x = found.misfit, found.vector
    others = other_weakenings(plant, found.plant, misfit.observations)
    for i, start in enumerate([] if near_floor(found) else others):
        report(0.8 + 0.2 * i / len(others), f"another weakening of friction, {i + 1} of {len(others)}")
        trial, there = misfit.onto(start, x, fixed=fixed)
        there = _refined(trial, there, below=_NEAR_FLOOR**2 * squared(found.floor_rows))
        if trial.cost(there) < misfit.cost(x) and near_floor(other := _finished(trial, there)):
            return other
    return found


def fit_observations(
    plant: Plant,
    observations: Sequence[Seen],
    fixed: Collection[str] = (),
    progress: Progress | None = None,
    below: float = math.inf,
) -> FitResult:
    """`fit` on records that are already seen through a band, near enough to judge it, from the start that promises
    most; see `refine` for `below`."""
    return _result(*_from_the_data(plant, observations, fixed, progress, below))


def fit_as_logged(plant: Plant, observations: Sequence[Seen], progress: Progress | None = None) -> FitResult:
    """`fit_observations`, of a log that is seen by its habits; see `as_logged`."""
    return _result(*_by_its_habits(plant, observations, (), progress))


def _by_its_habits(
    plant: Plant, observations: Sequence[Seen], fixed: Collection[str], progress: Progress | None
) -> tuple[Misfit, Array]:
    misfit, x = _from_the_data(plant, observations, fixed, progress)
    for _ in range(_HABITS):
        if not _may_be_logged_otherwise(misfit, x) or not (seen := as_logged(_result(misfit, x), fixed=fixed)):
            break
        misfit, x = _from_the_data(plant, seen, fixed)
    return misfit, x


def as_logged(found: FitResult, fixed: Collection[str] = (), share: float = EARLY_SHARE) -> list[Seen] | None:
    """The observations by another habit of the log, which is no physics, and no effect; None where none explains more.

    Args:
        found: a fit by the habit that is known so far.
        fixed: parameters that stay, as "effect.parameter".
        share: of the squared error above the noise floor, that torques before their rows have to take.
    """
    return _without_rests(found, fixed) or acting_early(found, fixed, share) or _as_time_steps(found, fixed)


def _may_be_logged_otherwise(misfit: Misfit, x: Array) -> bool:
    asks = any(isinstance(o, Observation) and (o.early or isinstance(o, TimeSteps)) for o in misfit.observations)
    return asks or "delay" in misfit.coordinates.template or bool(_pressing(misfit, x)) or _rests_press(misfit, x)


def _seen_as(seen: Sequence[Seen], found: FitResult, fixed: Collection[str]) -> FitResult:
    """A fit refined to its records as they are seen otherwise."""
    trial = Misfit(found.plant, seen, fixed)
    return refine(trial, trial.vector(found.plant, found.misfit.memories(found.vector, trial.n_memory)))


def _without_rests(found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """The observations, of which nothing is asked where the axis rests within a count of its encoder.

    Where most of what is left is left there, friction bends too little to be seen, and holds by whatever it has to.
    """
    misfit, x = found.misfit, found.vector
    if not _rests_press(misfit, x):
        return None
    seen = without_rests(misfit.observations)
    return seen if _seen_as(seen, found, fixed).error < _SHARPER * found.error else None


def _rests_press(misfit: Misfit, x: Array) -> bool:
    """Whether most of what is left is left where an axis rests within a count of its encoder."""
    if not any(isinstance(o, Observation) and o.rests for o in misfit.observations):
        return False
    rows = misfit.residual(x)
    return float(np.sum(rows[~determined(misfit)] ** 2)) > _RESTS_SHARE * squared(rows)


def _as_time_steps(found: FitResult, fixed: Collection[str]) -> list[Seen] | None:
    """The observations, of records whose rows are the time steps of a simulation.

    Their torques seem to act before their rows, by half a row or more, unless a delay puts them off.
    """
    misfit, x = found.misfit, found.vector
    records = [o for o in misfit.observations if isinstance(o, Observation)]
    known = steps_of(misfit.observations)
    asks = known or all(o.early for o in records) or "delay" in found.plant
    done = not known and near_floor(found)  # what is taken when shows in the last digits too
    if not records or not asks or any(o.record.sensed for o in records) or done:
        return None
    left = squared(misfit.residual(x))
    enough = max(_EARNED * left, _STEPS_SHARE * (left - squared(found.floor_rows)))

    def left_in(late: int, ahead: tuple[int, int]) -> float:
        again = _seen_as(in_steps(misfit.observations, late, ahead), found, fixed)
        return again.misfit.cost(again.vector)

    if known:  # found while the fit was still far off
        tried = {known: left}
    else:
        tried = {(late, ahead): left_in(late, ahead) for late in (0, 1) for ahead in ((0, 0), (1, 1))}
    late, _ = min(tried, key=lambda k: tried[k])
    tried |= {(late, a): left_in(late, a) for a in ((0, 0), (1, 1), (0, 1), (1, 0), (-1, 1)) if (late, a) not in tried}
    best = min(tried, key=lambda k: tried[k])
    return in_steps(misfit.observations, *best) if left - tried[best] > enough else None


def acting_early(found: FitResult, fixed: Collection[str] = (), share: float = EARLY_SHARE) -> list[Seen] | None:
    """The observations, with torques that acted before their rows; None where that explains too little more.

    A drive acts after it is told, and at most a tenth of a sample of skew is anybody's. But a torque that was measured
    is that of the interval just over, or of an instant in it, by the habits of the log: no physics, and no effect. One
    that is known to be read from a sensor (`Record.sensed`) may have been half a sample before or after the position.

    Args:
        found: a fit that holds the skew within what is anybody's.
        fixed: parameters that stay, as "effect.parameter".
        share: of the squared error above the noise floor, that torques before their rows have to take.
    """
    misfit, x, n = found.misfit, found.vector, found.misfit.coordinates.size
    side = _pressing(misfit, x)
    if not side:
        return None
    late = side > 0
    rows, residual = misfit.jacobian(x), misfit.residual(x)
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    others = np.delete(rows / scale, n, axis=1)
    column = rows[:, n] / scale[n]
    column = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    left = float(residual @ residual)
    enough = max(_EARNED * left, (EARLY_SHARE if late else share) * (left - float(found.floor_rows @ found.floor_rows)))
    if (column @ residual < 0) != late or (column @ residual) ** 2 < enough * (column @ column):
        return None
    early = [o.acting_early() if isinstance(o, Observation) else o for o in misfit.observations]
    again = refine(Misfit(found.plant, early, fixed), x)
    return early if left - float(np.sum(again.misfit.residual(again.vector) ** 2)) > enough else None


def _pressing(misfit: Misfit, x: Array) -> int:
    """-1 where torques would act earlier than their rows, if they might, 1 where ones that were read would later; 0."""
    sensed = any(isinstance(o, Observation) and o.record.sensed for o in misfit.observations)
    n, (lower, upper) = misfit.coordinates.size, misfit.bounds
    if not misfit.n_skew or lower[n] == 0 or lower[n] < -misfit.most_skew:
        return 0
    if sensed and x[n] >= 0.99 * upper[n]:
        return 1
    return -1 if x[n] <= 0.99 * lower[n] else 0


def _habit(misfit: Misfit, x: Array) -> str:
    """What was allowed for in how the records were logged, in sentences; "" where that was nothing."""
    rests = [float(np.mean(o.resting)) for o in misfit.observations if isinstance(o, Observation)]
    said = [_clock(misfit, x)]
    if any(rests):
        share = f"{100 * float(np.mean(rests)):.2g} % of the samples"
        said.append(f"Where the axis rests, in {share}, friction is whatever holds it: nothing is asked there")
    return ". ".join(filter(None, said))


def _clock(misfit: Misfit, x: Array) -> str:
    """A sentence on torques that acted at another instant than their rows say; "" where they did not."""
    sample = min((o.sample_time for o in misfit.observations if isinstance(o, Observation)), default=0.0)
    skew = misfit.skew(x)
    if steps := steps_of(misfit.observations):
        when = "before it" if steps[0] == 0 else "after it"
        said = f"Each row is a time step of a simulation (v += h a, q += h v) with the position {when}: taken as such"
        state = ", its friction, a state that was integrated step by step, to 1 % of the torque"
        return said + state * (steps[1][0] < 0)
    if not misfit.n_skew or abs(skew) <= misfit.most_skew:
        return ""
    by = f"{1e3 * abs(skew):.2g} ms ({abs(skew) / sample:.2f} samples)"
    if skew > 0:
        return f"Torques acted {by} after their rows say, as those do that are logged before they act: allowed for"
    return f"Torques acted {by} before their rows say, as those do that are measured after they have acted: allowed for"


def _doubting(misfit: Misfit, x: Array) -> list[Seen] | None:
    """The observations with less trust in points of responses that stand alone; None where none does."""
    seen = misfit.observations
    if not any(isinstance(o, FrfObservation) for o in seen):
        return None
    parts = np.split(misfit.residual(x), misfit.splits)
    frfs = [(o, r) for o, r in zip(seen, parts, strict=True) if isinstance(o, FrfObservation)]
    doubted = without_outliers([o for o, _ in frfs], [r for _, r in frfs])
    return [o for o in seen if not isinstance(o, FrfObservation)] + list(doubted) if doubted else None


def _from_the_data(
    plant: Plant,
    observations: Sequence[Seen],
    fixed: Collection[str],
    progress: Progress | None = None,
    below: float = math.inf,
) -> tuple[Misfit, Array]:
    """The fit that the best of several starts leads to, with the points of responses trusted as they deserve."""
    report = progress or (lambda done, message: None)
    if unknown := [e for e in plant.effects if is_open(e)]:
        return _begun_without(unknown, plant, observations, fixed, report, below)
    first = best_start(plant, observations, fixed, report, below)
    report(0.5, "refining")
    misfit, x = _to_end(*begun(first, observations, fixed), fixed, 40, below)
    if again := _doubting(misfit, x):
        misfit = Misfit(misfit.plant(x), again, fixed)
        x = _refined(misfit, x)
    return misfit, x


def _begun_without(
    unknown: Sequence[Effect], plant: Plant, observations: Sequence[Seen], fixed: Collection[str], report: Progress,
    below: float,
) -> tuple[Misfit, Array]:  # fmt: skip
    """The same for a plant with effects of which nothing is known: each begins with what it would explain best of what
    those before it leave, from there and, where that stays above the noise floor, with all others from the data.

    Raises:
        ModelError: the data cannot show one of them.
    """
    bare = replace(plant, effects=tuple(e for e in plant.effects if e not in unknown))
    misfit, x = _from_the_data(bare, observations, fixed, report)
    for e in unknown:
        report(0.5, f"looking for {e.name}")
        if (started := Screen(misfit, x).started(e)) is None:
            raise ModelError(f"{e.name} has no values yet, and these data show nothing of it; give them")
        bare = bare + started
        near, there = misfit.onto(joined(misfit.plant(x), started), x, fixed=fixed)
        near, there = _to_end(near, nudge(near, there), fixed, 20, below)
        if not near_floor(_result(near, there)):
            afresh, other = _from_the_data(bare, observations, fixed, below=min(below, near.cost(there)))
            near, there = (afresh, other) if afresh.cost(other) < near.cost(there) else (near, there)
        misfit, x = near, there
    return misfit, x


def near_floor(found: FitResult) -> bool:
    """Whether a fit leaves hardly more than the sensors."""
    return squared(found.misfit.residual(found.vector)) <= max(
        _NEAR_FLOOR**2 * squared(found.floor_rows), found.negligible
    )


def fit_to_end(
    misfit: Misfit, x: Array, fixed: Collection[str] = (), max_steps: int = 20, below: float = math.inf
) -> FitResult:
    """The fit that a rough one leads to, with friction elements where they do most; see `refine`."""
    return _result(*_to_end(misfit, x, fixed, max_steps, below))


def _to_end(misfit: Misfit, x: Array, fixed: Collection[str], max_steps: int, below: float) -> tuple[Misfit, Array]:
    x = _near(misfit, x, max_steps, below)
    better, there = placed(misfit, x, fixed)
    if better is not misfit:
        x = _near(better, there, max_steps, below)
    return better, agreed(better, x, max_steps // 2)


def refine(misfit: Misfit, x: Array, max_steps: int = 20, below: float = math.inf) -> FitResult:
    """The fit next to a vector that is already close, near enough to judge it; without intervals, see `finished`.

    Args:
        misfit, x: the problem, and where to start.
        max_steps: at most so many derivatives at a time.
        below: a squared residual that is of use [N^2 m^2]; a fit that does not get there may end anywhere.
    """
    return _result(misfit, _refined(misfit, x, max_steps, below))


def _refined(misfit: Misfit, x: Array, max_steps: int = 20, below: float = math.inf) -> Array:
    return agreed(misfit, _near(misfit, x, max_steps, below), max_steps // 2)


def _near(misfit: Misfit, x: Array, max_steps: int, below: float) -> Array:
    """A solution but for its last steps, on instants that are chosen anew in every one."""
    x = approach(misfit, misfit.settle(x), max_steps, below=below)
    # A residual with slips in it has steps of its own, at which derivatives over short ones lead a search to a halt.
    wide = misfit.with_steps(x, np.inf) if any(isinstance(o, Observation) for o in misfit.observations) else misfit
    return solve(wide, x, max_steps, below=below)


def finished(found: FitResult) -> FitResult:
    """The same fit, until no step would move it by much of an interval, with these intervals."""
    return _finished(found.misfit, found.vector)


def _finished(misfit: Misfit, x: Array) -> FitResult:
    if not any(isinstance(o, ServoObservation) for o in misfit.observations):
        for _ in range(2):
            x = solve(misfit.on_grids(x, _FINER), x, _LAST_STEPS, _SHARP / len(misfit.residual(x)))
        x = agreed(misfit, x, _LAST_STEPS)
    return with_covariance(_result(misfit, x))


def _told(score: Score, rows: Sequence[Array]) -> list[Array]:
    """The errors that rows of least squares stand for."""
    return [errors_of(r) for r in rows] if score.of == "position" else list(rows)


def _floor_rows(misfit: Misfit, x: Array, residual: Array, noise: Noise) -> list[Array]:
    """Of each observation the residual that noise like this would leave, no louder than what is left."""
    plant, rng = misfit.plant(x), np.random.default_rng(0)
    return [
        believable(floor_residual(o, plant, misfit.memory(x, i), noise, rng), left)
        for i, (o, left) in enumerate(zip(misfit.observations, np.split(residual, misfit.splits), strict=True))
    ]


def _result(misfit: Misfit, x: Array) -> FitResult:
    plant = misfit.plant(x)
    residual, observations = misfit.residual(x), misfit.observations
    applied = [o.applied(plant) for o in observations]
    score = observations[0].score
    error = score.pooled(_told(score, np.split(residual, misfit.splits)), applied)
    assert plant.inertia is not None
    noise = noise_of(observations, np.split(residual, misfit.splits), plant.inertia)
    floor_rows = _floor_rows(misfit, x, residual, noise)
    floor = score.pooled(_told(score, floor_rows), applied)
    bandwidth = max(float(o.bandwidth) for o in observations)
    provenance = {
        "records": [o.name for o in observations],
        "bandwidth": bandwidth,
        "error": error,
        "noise_floor": floor,
        "clock_skew": misfit.skew(x),
        "version": f"gms_mujoco {__version__}",
    }
    if steps := steps_of(observations):
        provenance[TOLD] = [steps[0], *steps[1]]
    if any(isinstance(o, Observation) and o.asked is not None for o in observations):
        provenance[RESTS] = True
    if score.of == "position":
        provenance["error_of"] = "position, mean absolute [rad]"
    plant = replace(plant, uncertainty={}, covariance={}, provenance=provenance)
    if score.of == "torque":
        status = f"torque error {100 * error:.2f} % of the torque up to {bandwidth:.0f} Hz"
        status += f", noise floor {100 * floor:.2f} %"
    else:
        status = f"mean absolute position error {score.told(error)}, noise floor {score.told(floor)}"
    if error > _NEAR_FLOOR * floor:
        status += f". That is {error / floor:.2g} times the floor: `diagnose` looks for what is missing"
    if habit := _habit(misfit, x):
        status += f". {habit}"
    if stuck := never_slips(plant, observations):
        status += f". {stuck}"
    negligible = sum(o.negligible**2 * squared(a) for o, a in zip(observations, applied, strict=True))
    return FitResult(plant, error, floor, status, misfit, x, noise, np.concatenate(floor_rows), negligible)


def with_covariance(found: FitResult) -> FitResult:
    """The same fit with the covariance of what was identified, and what the data leave open."""
    misfit, x, n = found.misfit, found.vector, found.misfit.coordinates.size
    whole, deviations = covariance(misfit, x)
    scatter = whole[:n, :n]
    intervals = misfit.coordinates.intervals(x[:n], scatter, deviations[:n])
    together = dict(zip(misfit.coordinates.labels, map(tuple, scatter.tolist()), strict=True))
    plant = replace(found.plant, uncertainty=intervals, covariance=together)
    plant = replace(plant, uncertainty=intervals | left_open(plant, misfit.observations))
    if missing := undetermined(plant):
        said = [f"{name}; what would tell it: {how}" for name, how in missing.items()]
        plant = replace(plant, provenance={**plant.provenance, "undetermined": said})
    return replace(found, plant=plant)
