"""The curves of a plant: closed forms, and what a recording of them holds."""

from pathlib import Path

import numpy as np
import pytest
from recordings import last_values

import gms_mujoco as gms
from gms_mujoco import dahl_resonance as dahl
from gms_mujoco.identification.motion import break_away_distance, virgin_curve
from gms_mujoco.views import portrait
from gms_mujoco.views.page import conditions

AXIS = gms.Plant.load("servo_axis")
REACH = break_away_distance(AXIS, 10.0)


def test_steady_friction_is_the_stribeck_curve() -> None:
    speed = np.geomspace(1e-3, 1e2, 20)
    law = AXIS["gms"]
    curve = law.coulomb + (law.static - law.coulomb) * np.exp(-((speed / law.stribeck_velocity) ** 1.0))
    expected = curve + AXIS["viscous"].coefficient * speed
    for direction in portrait.steady_friction(AXIS, speed, REACH):
        np.testing.assert_allclose(direction, expected, rtol=2e-3)


def test_asymmetric_friction_parts_the_directions() -> None:
    plant = gms.Plant.axis(1e-3) + gms.effects.Coulomb(coulomb=2.0) + gms.effects.AsymmetricFriction(level=0.1)
    forward, backward = portrait.steady_friction(plant, np.array([0.1, 1.0]), 0.0)
    np.testing.assert_allclose(forward, 2.2)
    np.testing.assert_allclose(backward, 1.8)


def test_a_loop_is_the_virgin_curve_twice_as_large() -> None:
    """Masing's rule, from the loop's lower to its upper turn."""
    plant = AXIS.friction.without("viscous")
    ((position,), (friction,)) = portrait.hysteresis(plant, np.array([0.3 * REACH]))
    low, high = np.argmin(position), np.argmax(position)
    upward = np.arange(low, high + len(position) - 1) % (len(position) - 1)
    distance, virgin = virgin_curve(plant, 0.4 * REACH, 4000)
    gone = position[upward] - position[low]
    expected = friction[low] + 2 * np.interp(gone / 2, np.r_[0, distance], np.r_[0, virgin])
    np.testing.assert_allclose(friction[upward], expected, atol=3e-3 * np.ptp(friction))


def test_the_dahl_resonance_is_that_of_the_describing_function() -> None:
    gms_ = AXIS["gms"]
    amplitude = REACH * np.geomspace(1e-3, 1.0, 9)
    k = np.array(gms_.stiffness)
    inphase = dahl.describing_function(k, gms_.static * np.array(gms_.fraction) / k, amplitude).real
    expected = np.sqrt(inphase / AXIS.inertia) / (2 * np.pi)
    np.testing.assert_allclose(portrait.dahl_resonance(AXIS, amplitude), expected, rtol=5e-3)


def test_cogging_shows_in_a_slow_turn() -> None:
    plant = AXIS + gms.effects.Cogging(harmonics=[8], amplitude=[1e-3], phase=[0.4])
    position, there, back = portrait.slow_turn(plant)
    first, second = slice(0, 256), slice(256, None)
    for torque, turned in ((there, second), (back, first)):  # the half before has the reversal in it
        amplitude = 2 * np.mean(torque[turned] * np.exp(-8j * position[turned]))
        assert abs(amplitude) == pytest.approx(1e-3, rel=0.02)
    assert there.mean() > 0 > back.mean()


@pytest.mark.parametrize("name", sorted(p.stem for p in gms.MODELS.glob("*.toml")))
def test_every_plant_that_comes_along_can_be_drawn(name: str, tmp_path: Path) -> None:
    plant = gms.Plant.load(name)
    gms.view.write_portrait(tmp_path / "plant.rrd", plant)
    rows = last_values(tmp_path / "plant.rrd")
    drawn = {entity: (np.array(v["x"]), np.array(v["y"])) for entity, v in rows.items() if "/data/" in entity}
    assert "/speed/data/forward" in drawn
    assert ("/virgin/data/virgin_curve" in drawn) == ("gms" in plant)
    for x, y in drawn.values():
        assert x.shape == y.shape and x.size > 10 and np.isfinite(x).all() and np.isfinite(y).all()
    assert all(name in rows["/parameters/text"]["text"][0][0] for name in plant.numbers())


def test_a_curve_says_under_which_load_and_temperature_it_is_drawn() -> None:
    load = gms.effects.LoadDependentFriction(coefficient=0.1)
    drift = gms.effects.ThermalDrift(amplitude=0.3, time_constant=60.0)
    bare = gms.Plant.axis(1.0) + gms.effects.Coulomb(coulomb=1.0)
    measured = drift.replace(temperature_scale=10.0)
    assert [conditions(p) for p in (bare, bare + drift)] == ["", ""]
    assert conditions(bare + load + measured) == ", without load, at 20 degC"


def test_an_axis_without_friction_has_its_parameters(tmp_path: Path) -> None:
    gms.view.write_portrait(tmp_path / "plant.rrd", gms.Plant.axis(1e-3) + gms.effects.TorqueOffset(torque=0.1))
    assert "inertia" in last_values(tmp_path / "plant.rrd")["/parameters/text"]["text"][0][0]


def test_a_plant_without_parameters_cannot_be_drawn(tmp_path: Path) -> None:
    with pytest.raises(gms.GmsError, match="no value yet"):
        gms.view.write_portrait(tmp_path / "plant.rrd", gms.baseline())
    assert not list(tmp_path.iterdir())
