"""Torque between samples: the mean of every effect is that of a replay in tiny steps, whatever happens in between."""

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, rms, runs

from gms_mujoco import effects, native
from gms_mujoco.effect import Effect
from gms_mujoco.identification.grid import Grid
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

H = 2e-3
FINE = 500  # parts of a sample, for the reference
FRICTION: list[Effect] = [
    HEALTHY["gms"],
    effects.find("coulomb")(coulomb=LEVEL),
    effects.find("stribeck")(coulomb=LEVEL, static=1.2 * LEVEL, stribeck_velocity=0.5),
    effects.find("dahl")(stiffness=0.6, coulomb=LEVEL),
    effects.find("lugre")(stiffness=0.6, damping=1e-3, coulomb=LEVEL, static=1.1 * LEVEL, stribeck_velocity=0.5),
    effects.find("viscous")(coefficient=2e-4),
    effects.find("flexible_coupling")(inertia=1e-5, frequency=60.0, damping=0.1),
    effects.find("backlash")(inertia=1e-5, gap=4e-3, frequency=80.0, damping=1.0),
]


def _motion(t: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Strokes below and above the break-away distances, with reversals at any place between samples."""
    out = np.zeros_like(t)
    for amplitude, frequency, phase in ((0.02, 7.3, 0.3), (0.006, 31.0, 1.0), (0.05, 1.1, 2.0)):
        w = 2 * np.pi * frequency
        out += amplitude * w**derivative * np.sin(w * t + phase + derivative * np.pi / 2)
    return out


def _record(n: int = 600) -> tuple[Record, np.ndarray, np.ndarray]:
    t = H * np.arange(n)
    return Record("made", t, {"torque": np.ones(n), "position": _motion(t)}), _motion(t), _motion(t, 1)


def _reference(joint: native.Joint, n: int) -> np.ndarray:
    """(n,) triangular means of a replay in tiny steps along the true motion."""
    t = H / FINE * np.arange(FINE * (n - 1) + 1)
    torque = joint.replay(t, _motion(t), _motion(t, 1)).torque
    weight = (1 - np.abs(np.arange(1 - FINE, FINE)) / FINE) / FINE
    mean = torque[::FINE].copy()
    mean[1:-1] = np.convolve(torque, weight, "same")[FINE:-1:FINE]
    return mean


@pytest.mark.parametrize("effect", FRICTION, ids=lambda e: e.name)
def test_the_mean_torque_is_that_of_tiny_steps(effect: Effect) -> None:
    record, position, velocity = _record()
    joint = (Plant.axis(J) + effect).joint()
    true = _reference(joint, len(position))
    size = rms(true)
    coarse, fine = (joint.mean(record.time, position, velocity, tolerance=x * size)[0] for x in (np.inf, 1e-4))
    # A jump stands where the cubic between the samples has its turning point, which is not quite the motion's.
    assert rms(fine - true) < (2e-2 if effect.name in ("coulomb", "stribeck") else 4e-3) * size
    assert rms(fine - true) < 0.2 * rms(coarse - true)


def test_without_bends_the_mean_is_that_of_straight_lines() -> None:
    record, _, _ = _record()
    speed = 0.3 + 0.1 * np.sin(record.time)  # no reversal
    position = 0.3 * record.time - 0.1 * np.cos(record.time)
    joint = (Plant.axis(J) + effects.find("viscous")(coefficient=2e-4)).joint()
    mean, instants = joint.mean(record.time, position, speed, tolerance=1e-6)
    f = joint.replay(record.time, position, speed).torque
    np.testing.assert_allclose(mean[1:-1], (f[:-2] + 4 * f[1:-1] + f[2:]) / 6, rtol=1e-12)
    np.testing.assert_array_equal(instants, np.arange(len(f)))


@pytest.mark.parametrize("effect", FRICTION, ids=lambda e: e.name)
def test_a_replay_on_the_grid_gives_the_mean_it_was_made_for(effect: Effect) -> None:
    record, position, velocity = _record()
    joint = (Plant.axis(J) + effect).joint()
    mean, instants = joint.mean(record.time, position, velocity, tolerance=1e-3 * LEVEL)
    assert set(range(len(mean))) <= set(instants) and np.all(np.diff(instants) > 0)
    grid = Grid(instants)
    again = grid.mean(grid.path(record, position, velocity).torque(joint))
    np.testing.assert_allclose(again, mean, atol=1e-7 * np.abs(mean).max())


def test_the_grid_is_as_fine_as_the_torque_asks_for() -> None:
    record, position, velocity = _record()
    joint = (Plant.axis(J) + HEALTHY["gms"]).joint()
    sizes = [len(joint.mean(record.time, position, velocity, tolerance=x * LEVEL)[1]) for x in (1e-1, 1e-2, 1e-3, 1e-9)]
    assert len(position) < sizes[0] < sizes[1] < sizes[2] < sizes[3] <= 24 * len(position)  # and comes to an end


def test_on_one_grid_a_torque_is_smooth_in_the_parameters() -> None:
    """Where each set of parameters has its own, the derivative is full of the instants that come and go."""
    o = Observation(runs(HEALTHY)[1], 100.0)
    grid = o.grid(HEALTHY)
    np.testing.assert_allclose(o.replay(HEALTHY, grid=grid), o.replay(HEALTHY), atol=1e-9 * LEVEL)

    def slope(step: float) -> np.ndarray:
        gms = HEALTHY["gms"]
        moved = HEALTHY.replace(gms.replace(stiffness=np.asarray(gms.stiffness) * (1 + step)))
        return (o.replay(moved, grid=grid) - o.replay(HEALTHY, grid=grid)) / step

    small, smaller = slope(1e-4), slope(1e-5)
    assert rms(small - smaller) < 0.02 * rms(small)
