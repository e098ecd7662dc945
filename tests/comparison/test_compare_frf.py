"""Frequency responses against a plant: a forward simulation is judged once it is steady."""

import numpy as np

from gms_mujoco import effects
from gms_mujoco.comparison.compare_frf import simulated_response
from gms_mujoco.frf import FRF
from gms_mujoco.identification.frf_observation import observe_frfs
from gms_mujoco.plant import Plant

J = 2.4e-5


def test_what_moves_freely_beside_the_sine_is_no_error_of_the_plant() -> None:
    """Far above a resonance it lasts for many periods of the sine."""
    f = np.geomspace(4, 200, 8)
    for spring, drag in ((0.5, 1e-4), (0.5, 1e-3), (0.0, 1e-4)):
        plant = Plant.axis(J) + effects.Viscous(coefficient=drag) + effects.Spring(stiffness=spring)
        s = 2j * np.pi * f
        frf = FRF("a", f, 1 / (J * s**2 + drag * s + spring), excitation=1e-3)
        error = np.abs(simulated_response(plant, observe_frfs([frf])[0]) / frf.response - 1)
        assert error.max() < 0.02, (spring, drag, error)
