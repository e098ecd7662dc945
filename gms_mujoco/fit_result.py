"""FitResult: what a fit found, how well, and what a perfect model would leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .comparison.score import NEAR_FLOOR, WEIGHED, Score, above_floor
from .identification.frf_observation import FrfObservation
from .identification.intervals import covariance
from .identification.inverse import Observation
from .identification.misfit import Misfit
from .identification.noise import Noise, floor_residual, noise_of
from .identification.servo_observation import errors_of
from .identification.tall import squared
from .identification.time_steps import RESTS, TOLD, steps_of
from .identification.undetermined import left_open, never_slips, undetermined
from .identification.whitened import Whitened
from .plant import Plant
from .recent import kept
from .threads import each
from .version import __version__

Array = NDArray[np.float64]

_LOUD = 0.05  # of the torque
_PASSED_ON = 4.0  # times the noise floor without friction: none but one that is too stiff makes so much of it


@dataclass(frozen=True)
class FitResult:
    """What a fit found.

    Attributes:
        plant: with its parameters, their 95 % intervals and their provenance.
        error: rms of the torque residual over rms of the torque, pooled over the records, of responses each point
            weighed by its deviation; of a servo the mean absolute error of its position [rad].
        floor: the same from sensors and sampling alone, for a perfect model.
        status: what was found, and a sentence on friction elements that never slipped.
        misfit, vector: the least-squares problem and its solution.
        noise: of the sensors, from which the floor follows.
        floor_rows: (m,) residual that sensors and sampling alone leave, one draw, over all observations [N m].
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
            most: (m,) it is hardly louder than this, see `believable`; None: than what is left.
        """
        left = self.misfit.residual(self.vector) if most is None else most
        return np.concatenate(_floor_rows(self.misfit, self.vector, left, noise))

    @property
    def nearly_noise(self) -> float:
        """A squared residual that is hardly more than what the sensors leave [N^2 m^2]."""
        return max(NEAR_FLOOR**2 * squared(self.floor_rows), self.negligible)

    @property
    def is_near_floor(self) -> bool:
        """Whether no more than that is left, and the noise says so."""
        return self.misfit.cost(self.vector) <= self.nearly_noise and not self.rattles

    @cached_property
    def rattles(self) -> bool:
        """Whether the noise floor is loud, and friction makes nearly all of it of little noise.

        Friction that is far stiffer than that of the axis may turn over at every count of the encoder, and claims what
        it leaves for noise, whatever the axis lacks. Such a floor is no reason to look no further.
        """
        if self.score.of != "torque" or self.floor <= _LOUD:
            return False
        observations = self.misfit.observations
        alone = replace(self.plant, effects=tuple(e for e in self.plant.effects if e.kind != "friction"))
        drawn = list(zip(observations, np.random.default_rng(0).spawn(len(observations)), strict=True))
        rows = each(lambda t: floor_residual(t[0], alone, None, self.noise, t[1]), drawn)
        applied = [o.applied(self.plant) for o in observations]
        return bool(self.floor > _PASSED_ON * self.score.pooled(rows, applied))

    @property
    def habit(self) -> str:
        """Sentences on how the records were logged, where that was allowed for; else ""."""
        return _habit(self.misfit, self.vector)

    @property
    def score(self) -> Score:
        """What the error is of."""
        return self.misfit.observations[0].score.of_kind(self.plant.kind)

    @property
    def undetermined(self) -> dict[str, str]:
        """Parameters that the data do not determine, with the experiment that would."""
        return undetermined(self.plant)


def result_of(misfit: Misfit, x: Array) -> FitResult:
    """What a problem and its solution amount to; without intervals, see `with_covariance`."""
    plant = misfit.plant(x)
    residual, observations = misfit.residual(x), misfit.observations
    applied = [o.applied(plant) for o in observations]
    score = observations[0].score.of_kind(plant.kind)
    error = score.pooled(_told(score, np.split(residual, misfit.splits)), applied)

    def floored() -> tuple[Noise, list[Array]]:
        assert plant.inertia is not None
        noise = noise_of(observations, np.split(residual, misfit.splits), plant.inertia)
        return noise, _floor_rows(misfit, x, residual, noise)

    noise, floor_rows = kept(misfit.floors, x.tobytes(), floored)
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
        status = f"{score.name} {100 * error:.2f} % of the {score.word} up to {bandwidth:.0f} Hz"
        status += f", {WEIGHED}" if any(isinstance(o, FrfObservation) for o in observations) else ""
        status += f", noise floor {100 * floor:.2f} %"
    else:
        status = f"mean absolute position error {score.told(error)}, noise floor {score.told(floor)}"
    if above := above_floor(error, floor):
        status += f". That is {above}: `diagnose` looks for what is missing"
    if habit := _habit(misfit, x):
        status += f". {habit}"
    if stuck := never_slips(plant, observations):
        status += f". {stuck}"
    negligible = sum(o.negligible**2 * squared(a) for o, a in zip(observations, applied, strict=True))
    return FitResult(plant, error, floor, status, misfit, x, noise, np.concatenate(floor_rows), negligible)


def with_covariance(found: FitResult, around: Whitened | None = None) -> FitResult:
    """The same fit with the covariance of what was identified, and what the data leave open; see `covariance`."""
    misfit, x, n = found.misfit, found.vector, found.misfit.coordinates.size
    whole, deviations = covariance(misfit, x, around)
    scatter = whole[:n, :n]
    intervals = misfit.coordinates.intervals(x[:n], scatter, deviations[:n])
    together = dict(zip(misfit.coordinates.labels, map(tuple, scatter.tolist()), strict=True))
    plant = replace(found.plant, uncertainty=intervals, covariance=together)
    plant = replace(plant, uncertainty=intervals | left_open(plant, misfit.observations))
    if missing := undetermined(plant):
        said = [f"{name}; what would tell it: {how}" for name, how in missing.items()]
        plant = replace(plant, provenance={**plant.provenance, "undetermined": said})
    return replace(found, plant=plant)


def _told(score: Score, rows: Sequence[Array]) -> list[Array]:
    """The errors that rows of least squares stand for."""
    return [errors_of(r) for r in rows] if score.of == "position" else list(rows)


def _floor_rows(misfit: Misfit, x: Array, residual: Array, noise: Noise) -> list[Array]:
    """Of each observation the residual that noise like this would leave, see `floor_residual`."""
    plant, left = misfit.plant(x), np.split(residual, misfit.splits)
    draws = np.random.default_rng(0).spawn(len(left))

    def one(i: int) -> Array:
        return floor_residual(misfit.observations[i], plant, misfit.memory(x, i), noise, draws[i], left[i])

    return each(one, range(len(left)))


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
    return f"Torques acted {by} before their rows say, as those do that are logged after they have acted: allowed for"
