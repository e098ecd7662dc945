"""Where the fit of a servo starts, and what its runs cannot tell."""

from dataclasses import replace

import numpy as np
import pytest
import servos

from gms_mujoco.effects import find
from gms_mujoco.errors import ModelError
from gms_mujoco.fit import baseline
from gms_mujoco.identification.servo_observation import ServoObservation, observe_servos
from gms_mujoco.identification.servo_starts import servo_starts, untold
from gms_mujoco.plant import Plant


@pytest.fixture(scope="module")
def seen() -> list[ServoObservation]:
    return observe_servos(servos.bench(delay=0.0))


def _left(plant: Plant, seen: list[ServoObservation]) -> float:
    return float(np.mean([np.mean(np.abs(o.applied(plant) - o.simulated(plant))) for o in seen]))


@pytest.mark.parametrize("size", [0.05, 1.0, 20.0], ids=["micro", "hobby", "robot"])
def test_a_servo_of_any_size_finds_a_start(seen: list[ServoObservation], size: float) -> None:
    """Torques and inertias of one that is so many times as strong, with a payload to match, move alike."""
    scaled = [replace(o, run=replace(o.run, weight=size * o.run.weight, inertia=size * o.run.inertia)) for o in seen]
    starts = servo_starts(baseline(controller="position"), scaled)
    assert all(not p.unset for p in starts)
    moved = float(np.mean([np.std(o.position) for o in seen]))
    assert _left(starts[0], scaled) < 0.3 * moved
    assert starts[0]["position_loop"].stall_torque == pytest.approx(size * servos.STALL, rel=2.0)


def test_what_has_values_is_left_alone(seen: list[ServoObservation]) -> None:
    plant = servo_starts(baseline(controller="position"), seen)[0]
    assert servo_starts(plant, seen) == [plant]


def test_what_runs_do_not_tell_must_be_given(seen: list[ServoObservation]) -> None:
    plant = baseline(controller="position") + find("stribeck")()
    with pytest.raises(ModelError, match=r"stribeck\.\w+ has no value"):
        servo_starts(plant, seen)


def test_drag_of_motor_and_gear_are_told_apart_without_power_only(seen: list[ServoObservation]) -> None:
    plant = baseline(controller="position")
    assert untold(plant, seen) == ["viscous.coefficient"]
    assert untold(plant.without("viscous"), seen) == []
    off = replace(seen[0], run=replace(seen[0].run, powered=(seen[0].run.time < 1).astype(float)))
    assert untold(plant, [*seen, off]) == []
