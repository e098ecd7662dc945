"""Harmonic balance, against a simulation that knows nothing of it; steady torques, against closed forms."""

import math

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.dahl_resonance import describing_function
from gms_mujoco.plant import Plant
from gms_mujoco.responses.harmonics import ORDERS, SAMPLES, balance, fundamental, motion

J = 2.4e-5
GMS = effects.GMS(
    stiffness=[1.2, 0.35, 0.12], fraction=[0.2, 0.35, 0.45], coulomb=4.5e-3, static=4.5e-3, stribeck_velocity=1.0,
    attraction=4.5e-3,
)  # fmt: skip


def first_harmonic(plant: Plant, size: list[float], frequency: list[float]) -> np.ndarray:
    omega = 2 * math.pi * np.array(frequency)
    return fundamental(plant.joint().cycle(1 / np.array(frequency), *motion(np.array(size), omega)))


def test_a_motion_has_the_harmonics_asked_for() -> None:
    size, omega = np.array([2.0, 3.0]), np.array([5.0, 7.0])
    extra = np.zeros((2, len(ORDERS)), complex)
    extra[:, 0] = [0.1, 0.2j]
    q, v = motion(size, omega, extra)
    t = np.arange(SAMPLES) / SAMPLES * 2 * math.pi / omega[:, None]
    wt = omega[:, None] * t
    assert np.allclose(q, size[:, None] * np.cos(wt) + (extra[:, :1] * np.exp(3j * wt)).real)
    rate = (1j * omega[:, None] * size[:, None] * np.exp(1j * wt)).real
    assert np.allclose(v, rate + (3j * omega[:, None] * extra[:, :1] * np.exp(3j * wt)).real)
    assert np.allclose(fundamental(q), size)


def test_the_steady_torque_of_maxwell_slip_is_its_describing_function() -> None:
    size = [1e-4, 6e-4, 1.5e-3, 1e-2, 0.1]
    found = -first_harmonic(Plant.axis(J) + GMS, size, [20.0] * 5) / size
    k = np.array(GMS.stiffness)
    exact = describing_function(k, np.array(GMS.fraction) * GMS.coulomb / k, np.array(size))
    assert np.all(np.abs(found - exact) < 3e-3 * np.abs(exact))


@pytest.mark.parametrize("damping", [0.01, 0.3, 1.5])
def test_a_load_behind_a_coupling_swings_as_after_a_long_time(damping: float) -> None:
    load = effects.FlexibleCoupling(inertia=0.4 * J, frequency=80.0, damping=damping)
    f = np.array([20.0, 40.0, 78.0, 200.0])
    w, w0 = 2j * math.pi * f, 2 * math.pi * 80.0
    passed = (2 * damping * w0 * w + w0**2) / (w**2 + 2 * damping * w0 * w + w0**2)
    found = first_harmonic(Plant.axis(J) + load, [1e-3] * 4, list(f))
    exact = -0.4 * J * w**2 * passed * 1e-3
    assert np.all(np.abs(found - exact) < 0.01 * np.abs(exact))


def test_the_balance_is_the_motion_that_a_simulation_finds() -> None:
    """Amplitude and phase at given torque, where harmonics change both by several percent."""
    plant, f, torque, n = Plant.axis(J) + GMS, 15.0, 3.5e-3, 512
    periods = 20
    driven = torque * np.minimum(np.arange(n * periods) / n / 6, 1) * np.cos(2 * np.pi * np.arange(n * periods) / n)
    moved = plant.joint().simulate(J, 1 / (f * n), driven, substeps=4).position
    spectrum = np.fft.rfft(moved[-n:]) * (2 / n)
    size, omega = np.array([abs(spectrum[1])]), np.array([2 * math.pi * f])
    found = balance(plant.joint(), J, size, omega)
    assert found.good.all()
    turned = spectrum[ORDERS] * np.exp(-1j * ORDERS * np.angle(spectrum[1]))
    assert np.abs(found.extra[0, :3] - turned[:3]).max() < 0.02 * np.abs(turned[0])
    needed = -J * omega**2 * size - found.first
    plain = -J * omega**2 * size - first_harmonic(plant, [float(size[0])], [f])
    assert abs(needed[0]) == pytest.approx(torque, rel=3e-3)
    assert abs(abs(plain[0]) / torque - 1) > 0.02


def test_a_point_without_balance_is_told() -> None:
    """Far below a sharp resonance, with a harmonic on it."""
    spring = Plant.axis(J) + effects.Spring(stiffness=1.0) + effects.Coulomb(coulomb=1e-3)
    own = math.sqrt(1.0 / J)
    found = balance(spring.joint(), J, np.array([2e-3, 2e-3]), np.array([own / 3, 3 * own]))
    assert list(found.good) == [False, True]
