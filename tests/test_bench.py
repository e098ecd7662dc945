"""Measurement in simulation: loop against `simulate`, responses against the closed form of a linear axis."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.bench import measure, run_loop
from gms_mujoco.control import PID
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import Excitation
from gms_mujoco.frf import FRF
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate
from gms_mujoco.sweep import stepped_sine

J, SPRING, DRAG, H, COUNT = 2.4e-5, 0.5, 1e-3, 5e-4, 2 * np.pi / 1e6
AXIS = Plant.axis(J) + effects.find("spring")(stiffness=SPRING) + effects.find("viscous")(coefficient=DRAG)
DRY = Plant.axis(J) + effects.GMS(
    stiffness=[0.5, 0.12], fraction=[0.45, 0.55], coulomb=4.5e-3, static=5e-3, stribeck_velocity=0.5, attraction=0.5
)
WAVE = Excitation.multisine(H, 0.5, 4, 300, 2e-3, 0, "odd_random")


def pid() -> PID:
    return PID(J, H, bandwidth=15.0)


def misfit(frf: FRF) -> np.ndarray:
    s = 2j * np.pi * frf.frequency
    return np.abs(frf.response * (J * s**2 + DRAG * s + SPRING) - 1)


@pytest.mark.parametrize(
    ("controller", "enters", "size"), [(None, "torque", 1.0), (pid, "torque", 1.0), (pid, "reference", 10.0)]
)
def test_a_linear_axis_gives_its_closed_form_open_or_closed(controller, enters: str, size: float) -> None:
    found = measure(AXIS, WAVE * size, controller=controller, enters=enters, substeps=32).frf()
    assert len(found) == len(WAVE.lines) and misfit(found).max() < 2e-3 and "periods of 0.5 s" in found.notes[0]


@pytest.mark.parametrize("plant", [AXIS, DRY + effects.Delay(time=1.5 * H), DRY + effects.TorqueSaturation(limit=4e-3)])
def test_the_loop_in_mujoco_is_the_simulation_under_the_torque_it_made(plant: Plant) -> None:
    record = run_loop(plant, pid(), 0.02 * np.sin(60 * H * np.arange(2000)), H, resolution=COUNT)
    still = np.zeros(4)  # a drive that was off before the loop closed
    again = simulate(plant, np.append(still, record.torque), H, resolution=COUNT)
    assert np.ptp(record.position) > 5e-3
    assert np.abs(again.position[4:] - record.position).max() <= 1.01 * COUNT


def test_the_loop_follows_its_reference_and_sees_the_noise() -> None:
    reference = 1.0 + 0.2 * np.sin(2 * np.pi * H * np.arange(3000))
    record = run_loop(AXIS, PID(J, H, bandwidth=60.0), reference, H, position=1.0, resolution=COUNT)
    assert np.abs(record.position - reference)[500:].max() < 0.02
    assert np.allclose(record.position / COUNT, np.round(record.position / COUNT), atol=1e-6)
    noisy = run_loop(AXIS, PID(J, H, bandwidth=60.0), reference, H, position=1.0, position_noise=1e-4, seed=1)
    assert np.std(np.diff(noisy.torque)[500:]) > 10 * np.std(np.diff(record.torque)[500:])
    limited = run_loop(AXIS, PID(J, H, bandwidth=60.0), reference, H, torque_limit=0.05)
    assert np.abs(limited.torque).max() == 0.05


def test_uncertainty_is_the_scatter_in_open_and_closed_loop() -> None:
    short = Excitation.multisine(H, 0.25, 8, 200, 3e-3, 0, lines=20)
    noise = {"resolution": COUNT, "position_noise": 2e-5, "torque_noise": 2e-5}
    for controller, runs in ((None, 60), (pid, 25)):
        truth = measure(AXIS, short, controller=controller).frf()
        z = []
        for i in range(runs):
            frf = measure(AXIS, short, controller=controller, seed=10 * i, **noise).frf()
            assert frf.sigma is not None
            z.append(np.abs(frf.response - truth.response) / frf.sigma)
        assert np.sqrt(np.median(np.square(z)) / np.log(2)) == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("held", ["torque", "position"])
def test_stepped_sines_hold_their_amplitude_inside_a_loop(held: str) -> None:
    amplitude = 1e-3 if held == "torque" else 2e-3
    frf = stepped_sine(AXIS, [20, 50, 120], amplitude, held=held, controller=pid, periods=4, windows=2, substeps=32)
    reached = frf.excitation if held == "torque" else frf.amplitude
    assert len(frf) == 3 and frf.sine and misfit(frf).max() < 3e-3
    assert np.allclose(reached, amplitude, rtol=2.1e-3)


def test_mistakes_of_the_bench_are_told() -> None:
    for change, words in (
        ({"enters": "voltage"}, "enters must be one of reference, torque"),
        ({"enters": "reference"}, "needs a controller"),
        ({"excitation": []}, "no excitation"),
        ({"excitation": [WAVE, Excitation.sine(H, 10, 1)]}, "realisations must have equal"),
        ({"transient": -1}, "transient must be a whole number from 0 on; -1 given"),
        ({"periods": 1.5}, "periods must be a whole number from 1 on"),
        ({"controller": pid, "torque_limit": np.nan}, "torque_limit must be positive"),
        ({"controller": pid, "substeps": 0}, "substeps must be a whole number from 1 on"),
        ({"controller": pid, "seed": -1}, "seed must be a whole number"),
        ({"controller": pid, "resolution": -1.0}, "resolution must not be negative"),
    ):
        with pytest.raises(DataError, match=words):
            measure(AXIS, **{"excitation": WAVE, **change})
    with pytest.raises(DataError, match="runs away"):
        run_loop(AXIS, lambda x: 50.0 * x[0], np.ones(4000), H, position=0.1)
    with pytest.raises(DataError, match="the torque added has shape"):
        run_loop(AXIS, pid(), np.ones(40), H, added=np.ones(3))
