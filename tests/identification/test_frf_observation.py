"""Responses as observations: the torque they say was applied is the one that the simulated plant needed."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF
from gms_mujoco.identification.frf_observation import (
    FrfObservation,
    balanced,
    observe_frfs,
    rescaled,
    tells_another_noise,
    usable,
)
from gms_mujoco.plant import Plant
from gms_mujoco.sweep import stepped_sine

J = 2.4e-5
GMS = effects.GMS(
    stiffness=[1.2, 0.35, 0.12], fraction=[0.2, 0.35, 0.45], coulomb=4.5e-3, static=5.2e-3, stribeck_velocity=0.6,
    attraction=0.4,
)  # fmt: skip
AXIS = Plant.axis(J) + GMS + effects.Viscous(coefficient=4e-5)
FREQUENCIES = [14.0, 25.0, 40.0, 60.0, 100.0, 160.0, 250.0]


def seen(plant: Plant, torque: float = 4e-3) -> FrfObservation:
    return balanced(observe_frfs([stepped_sine(plant, FREQUENCIES, torque, held="torque", substeps=32)]), plant)[0]


def off(plant: Plant, o: FrfObservation) -> np.ndarray:
    """Relative torque residual at each point."""
    return np.abs(o.complex(o.applied(plant) - o.needed(plant))) / np.abs(o.torque)


@pytest.mark.parametrize(
    "hidden",
    [
        effects.Delay(time=4e-4),
        effects.CurrentLoopLag(time=5e-4),
        effects.FlexibleCoupling(inertia=0.3 * J, frequency=120.0, damping=0.05),
        effects.Spring(stiffness=0.3),
        effects.Gravity(amplitude=0.3, phase=math.pi),
    ],
    ids=lambda e: e.name,
)
def test_the_plant_that_was_simulated_needs_the_torque_applied(hidden: Effect) -> None:
    o = seen(AXIS + hidden)
    assert np.median(off(AXIS + hidden, o)) < 4e-3 and np.median(off(AXIS, o)) > 3e-2


def test_drive_effects_have_their_transfer_functions() -> None:
    o, w = seen(AXIS), 2j * math.pi * np.array(FREQUENCIES)
    late = o.drive_response(AXIS + effects.Delay(time=3e-3))
    assert np.allclose(late, np.exp(-3e-3 * w), atol=3e-3)
    slow = o.drive_response(AXIS + effects.CurrentLoopLag(time=2e-2))
    assert np.allclose(slow, 1 / (1 + 2e-2 * w), atol=3e-3)


def test_a_sensor_effect_is_undone() -> None:
    """At small motion an encoder off centre has another gain."""
    o, tilted = seen(AXIS), AXIS + effects.EncoderEccentricity(amplitude=0.1, phase=0.0)
    gain = o.needed_torque(tilted)[-1] / o.needed_torque(AXIS)[-1]  # on the mass line
    assert gain == pytest.approx(1 / 1.1, rel=0.02)


def test_the_model_response_is_the_measured_one() -> None:
    o = seen(AXIS)
    assert np.allclose(o.model_response(AXIS), o.frf.response, rtol=0.02)


def test_the_elements_of_a_separable_effect_add_up_to_it() -> None:
    plant = AXIS + effects.AsymmetricFriction(level=0.2)
    o = seen(AXIS)
    part = plant.part("gms")
    number = [e.name for e in part.effects].index("gms")
    parts = o.elements(part, part.joint(), number)
    assert parts.shape == (plant["gms"].elements, len(o.index)) and np.ptp(parts, 0).min() > 0
    assert np.allclose(parts.sum(0), o.replay(part), rtol=0, atol=1e-9 * np.abs(parts).max())


def test_rows_hold_complex_torques() -> None:
    o = seen(AXIS)
    assert np.allclose(o.complex(o.applied(AXIS)), o.torque)
    assert len(o.index) == len(o.needed(AXIS)) == 2 * len(o.frf)


def test_rows_are_as_large_as_torques_and_as_good_as_their_sigma() -> None:
    frf = stepped_sine(AXIS, FREQUENCIES, 4e-3, held="torque")
    o = observe_frfs([replace(frf, sigma=0.05 * np.abs(frf.response))])[0]
    rows = o.applied(AXIS)
    assert np.sqrt(np.mean(rows**2) * 2) == pytest.approx(4e-3, rel=0.01)
    draws = [o.floor(np.random.default_rng(i)) for i in range(200)]
    assert np.sqrt(np.mean(np.square(draws)) / np.mean(rows**2)) == pytest.approx(0.05, rel=0.05)
    beside = rescaled([o], 1e-5)[0]
    assert np.std(beside.floor(np.random.default_rng(0))) == pytest.approx(1e-5 / math.sqrt(2), rel=0.4)


def noisy(levels: Sequence[float], noise: float) -> list[FRF]:
    """Responses of the axis at several torques, with an error of the position [rad] and without a deviation."""
    rng, found = np.random.default_rng(3), []
    for torque in levels:
        frf = stepped_sine(AXIS, list(np.geomspace(14, 250, 14)), torque, held="torque", substeps=32)
        error = rng.standard_normal((2, len(frf))) * noise / torque / math.sqrt(2)
        found.append(replace(frf, response=frf.response + error[0] + 1j * error[1], sigma=None))
    return found


def test_a_plant_tells_the_noise_of_responses_without_a_deviation() -> None:
    noise, rough = 3e-6, observe_frfs(noisy([2e-3, 4e-3, 6e-3], 3e-6))
    assert tells_another_noise(AXIS, rough)
    known = balanced(rough, AXIS)
    assert not tells_another_noise(AXIS, known)
    for o in known:
        told = o.deviation / np.abs(o.torque)
        true = np.hypot(noise / o.size, 3e-3 * math.sqrt(2))  # and what sampling and the balance may cost
        assert np.median(np.abs(np.log(told / true))) < 0.35


def test_a_deviation_that_was_measured_stays() -> None:
    frfs = [replace(f, sigma=0.02 * np.abs(f.response)) for f in noisy([2e-3, 6e-3], 3e-6)]
    seen = observe_frfs(frfs)
    assert not tells_another_noise(AXIS, seen)
    for o in balanced(seen, AXIS):
        assert np.median(o.deviation / np.abs(o.torque)) == pytest.approx(0.02, rel=0.1)


def test_a_response_that_cannot_be_used_says_why() -> None:
    frf = FRF("a", np.array([1.0, 2.0]), np.array([1.0, 0.5]))
    for bad, words in (
        (frf, "amplitude of the excitation is not known"),
        (replace(frf, excitation=1.0, sine=False), "many frequencies at once"),
        (replace(frf, input="voltage", unit=""), "torque to position is needed"),
    ):
        with pytest.raises(DataError, match=words):
            usable(bad)
