"""What a straight least squares says of an axis: whether it is there, how much of it, and which way it acts."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, SAMPLE_TIME, J, run, runs

from gms_mujoco import effects
from gms_mujoco.excitation import multisine
from gms_mujoco.frf import FRF
from gms_mujoco.logs.rough_inertia import (
    RoughInertia,
    rough_inertia,
    rough_inertia_of,
    rough_inertia_of_responses,
    rows_of,
)
from gms_mujoco.record import Record

TURNING = runs(HEALTHY)[2]


def of(record: Record, **factor: float) -> Record:
    """A record some of whose signals are so many times as large."""
    return record.with_signals({k: f * record.signals[k] for k, f in factor.items()})


def rough(*records: Record) -> RoughInertia | None:
    return rough_inertia([rows for r in records if (rows := rows_of(r)) is not None])


def test_an_axis_that_turns_tells_its_inertia_and_that_friction_takes_power() -> None:
    found = rough(TURNING)
    assert found is not None and found.is_told
    assert found.inertia == pytest.approx(J, rel=0.3) and found.power > 0
    assert rough_inertia_of([TURNING]) == found.inertia


@pytest.mark.parametrize("unit", [np.pi / 180, 1e3, -1.0])
@pytest.mark.parametrize("signal", ["torque", "position"])
def test_it_goes_with_the_units_and_the_signs_of_the_log(signal: str, unit: float) -> None:
    there, found = rough(of(TURNING, **{signal: unit})), rough(TURNING)
    assert there is not None and found is not None
    times = unit if signal == "torque" else 1 / unit
    exact = signal == "torque" or unit < 0  # of a position in another unit the sine of the revolution is another, too
    assert there.inertia == pytest.approx(times * found.inertia, rel=1e-6 if exact else 0.3)
    assert np.sign(there.power) == np.sign(unit)


def test_noise_alone_and_a_record_of_few_samples_tell_nothing() -> None:
    rng = np.random.default_rng(0)
    noise = TURNING.with_signals({"torque": rng.standard_normal(len(TURNING))})
    assert rough(noise) is None and rough_inertia_of([noise]) is None
    assert rows_of(TURNING.slice(0, 40)) is None and rough_inertia([]) is None
    zero = of(TURNING, torque=0.0)
    assert rough(zero) is None


def test_what_pre_sliding_shows_is_a_spring() -> None:
    """Far below its resonance, where an inertia takes next to nothing."""
    stiff = HEALTHY.replace(effects.GMS(stiffness=[40.0], fraction=[1.0], coulomb=LEVEL, static=LEVEL,
                                        stribeck_velocity=0.5, attraction=0.5))  # fmt: skip
    slow = multisine(2000, SAMPLE_TIME, 1.0, 20.0, 0.3 * LEVEL, np.random.default_rng(1))
    found = rough(run(stiff, slow))
    assert found is None or not found.is_told


def test_responses_tell_the_inertia_of_a_mass_on_a_spring_and_none_of_a_spring() -> None:
    f = np.geomspace(5, 200, 40)
    w = 2 * np.pi * f

    def measured(inertia: float) -> FRF:
        return FRF("f", f, 1 / (0.3 - inertia * w**2 + 1e-3j * w), input="torque", output="position")

    assert rough_inertia_of_responses([measured(J), measured(J)]) == pytest.approx(J, rel=0.05)
    assert rough_inertia_of_responses([measured(1e-12)]) is None
    assert rough_inertia_of_responses([replace(measured(J), input="reference", unit="")]) is None
