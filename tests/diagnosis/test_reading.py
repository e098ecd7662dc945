"""A torque reading that rings, beside an axis of which a part swings."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, SAMPLE_TIME, UNKNOWN, J, runs
from numpy.typing import NDArray
from scipy import signal

from gms_mujoco import effects
from gms_mujoco.diagnosis.judgement import AT_FLOOR, Trial
from gms_mujoco.diagnosis.reading import TorqueReading, as_shown, rung
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit_observations
from gms_mujoco.identification.held_out import HeldOut
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.tall import squared
from gms_mujoco.record import Record

FREQUENCY = 70.0  # Hz


def _read(record: Record, damping: float = 0.2) -> Record:
    """The torque of a record, as a sensor shows it that swings on its own compliance."""
    w = 2 * math.pi * FREQUENCY
    above, below, _ = signal.cont2discrete(([w**2], [1, 2 * damping * w, w**2]), SAMPLE_TIME)
    return replace(record, signals={**record.signals, "torque": signal.lfilter(above.ravel(), below, record.torque)})


def test_a_reading_that_rings_is_seen_at_its_frequency() -> None:
    result = fit_observations(UNKNOWN, observe([_read(r) for r in runs(HEALTHY)], J))
    found = rung(result.misfit, result.vector)
    assert found is not None
    misfit, x = found
    period = misfit.coordinates.decode(x[: misfit.coordinates.size])["torque_reading"].values["period"]
    assert 1 / (2 * math.pi * float(period)) == pytest.approx(FREQUENCY, rel=0.15)  # type: ignore[arg-type]
    assert misfit.cost(x) < 0.1 * result.misfit.cost(result.vector)


def test_what_is_left_behind_a_reading_is_told_as_the_sensor_shows_it() -> None:
    """A constant stays, a swing at the sensor's frequency grows to 1 / (2 zeta), what is far above falls as f^-2."""
    damping, n = 0.1, 4000
    observations = observe([runs(HEALTHY, seconds=n * SAMPLE_TIME)[0]], J)
    o, = observations
    assert isinstance(o, Observation)
    w = 2 * math.pi * 0.02 / o.step
    reading = TorqueReading(lag=2 * damping / w, period=1 / w)
    t = o.step * np.arange(len(o.index))
    for times, gain in ((0.0, 1.0), (1.0, 1 / (2 * damping)), (4.0, 1 / 15)):
        rows = np.cos(times * w * t)
        shown = as_shown(reading, HeldOut(rows, observations)) / squared(rows)
        assert math.sqrt(shown) == pytest.approx(gain, rel=0.25), times


def test_a_reading_whose_period_comes_to_nothing_does_not_ring(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no frequency that could be told of it."""

    def to_nothing(near: Misfit, x: NDArray[np.float64]) -> NDArray[np.float64]:
        plant = near.plant(x)
        return near.vector(plant.replace(plant["torque_reading"].replace(period=0.0)))

    result = fit_observations(UNKNOWN, observe([_read(r) for r in runs(HEALTHY)], J))
    monkeypatch.setattr("gms_mujoco.diagnosis.reading.nudge", to_nothing)
    assert rung(result.misfit, result.vector) is None


@pytest.mark.slow
def test_an_axis_of_which_a_part_swings_is_no_reading_that_rings() -> None:
    """One effect that swings and explains all is enough, however little another one does that swings too."""
    coupling = effects.FlexibleCoupling(inertia=0.3 * J, frequency=2 * FREQUENCY, damping=0.05)
    search = Search(observe(runs(HEALTHY + coupling), J), [], UNKNOWN)
    search.first(lambda done, message: None)
    friction = search.steps[0].result.plant

    def trial(effect: Effect, *fixed: str) -> Trial:
        result = fit_observations(friction + effect, search.seen, fixed)
        return Trial(effect.name, result, cross_validated(result.misfit, result.vector))

    true = trial(coupling)
    held = "flexible_coupling.inertia", "flexible_coupling.damping"
    other = trial(coupling.replace(inertia=0.05 * J, damping=0.3), *held)
    assert true.result.error < AT_FLOOR * true.result.floor < other.result.error
    assert search._reads_a_ring([other]), "what explains little has to beat a reading"
    assert not search._reads_a_ring([true, other])
