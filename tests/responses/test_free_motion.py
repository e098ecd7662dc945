"""What moves beside a sine: against the spectrum of a known transient, and against the closed form of a linear axis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gms_mujoco import effects
from gms_mujoco.frf import estimate_frf
from gms_mujoco.plant import Plant
from gms_mujoco.responses.free_motion import find_free_motion
from gms_mujoco.simulate import simulate
from gms_mujoco.sweep import stepped_sine

PERIODS, CYCLES, N = 4, 8, 4000
CENTER = PERIODS * CYCLES
T = np.arange(N) / N  # in records
SINE = np.sin(2 * np.pi * CENTER * T)
RESPONSE = 0.3 - 0.8j


def answer() -> np.ndarray:
    return np.asarray(np.imag(RESPONSE * np.exp(2j * np.pi * CENTER * T)))


def line(x: np.ndarray, k: int = CENTER) -> complex:
    return complex(np.fft.rfft(x)[k] * 2 / N)


@settings(max_examples=40)
@given(st.floats(0.5, 60), st.floats(0, 20), st.floats(0, 6), st.floats(0.01, 1))
def test_a_decaying_oscillation_is_taken_off(cycles: float, decay: float, phase: float, size: float) -> None:
    if np.hypot(cycles - CENTER, decay / (2 * np.pi)) < 1.2:  # cannot be told from the sine
        cycles = CENTER + 1.2
    free = size * np.exp(-decay * T) * np.cos(2 * np.pi * cycles * T + phase)
    found = find_free_motion(SINE, answer() + free, PERIODS, CYCLES)
    assert found is not None
    assert abs(found.at_sine - line(free)) < 2e-4 * size + 0.02 * abs(line(free))


def test_what_decays_without_swinging_is_taken_off_within_a_loop_too() -> None:
    y, u = 0.5 * np.exp(-3 * T), 0.2 * np.exp(-5 * T)  # a loop has its transient in both
    found = find_free_motion(SINE + u, answer() + y, PERIODS, CYCLES)
    assert found is not None
    response = (line(answer() + y) - found.at_sine) / line(SINE + u)
    plain = line(answer() + y) / line(SINE + u)
    assert abs(response - RESPONSE) < 1e-5 < 0.02 * abs(plain - RESPONSE)


def test_the_noise_between_the_lines_is_that_of_the_response() -> None:
    rng = np.random.default_rng(0)
    errors, stated = [], []
    for _ in range(400):
        noise = 0.1 * rng.standard_normal(N)
        found = find_free_motion(SINE, answer() + noise, PERIODS, CYCLES)
        assert found is not None and found.doubt <= found.noise
        errors.append(abs(line(noise) - found.at_sine) ** 2)
        stated.append(found.noise)
    assert np.mean(stated) == pytest.approx(0.1**2 * 4 / N, rel=0.05)
    assert np.mean(errors) == pytest.approx(np.mean(stated), rel=0.2)


def test_a_sine_that_fits_no_whole_number_of_times_is_not_taken_for_free_motion() -> None:
    t = T * (1 + 2e-3 / CENTER)
    u, y = np.sin(2 * np.pi * CENTER * t), np.imag(RESPONSE * np.exp(2j * np.pi * CENTER * t))
    found = find_free_motion(u, y, PERIODS, CYCLES)
    assert found is not None
    assert abs((line(y) - found.at_sine) / line(u) - RESPONSE) < 2e-3


def test_with_few_lines_between_the_harmonics_nothing_is_said() -> None:
    assert find_free_motion(SINE, answer(), 1, 3) is None
    assert find_free_motion(SINE, answer(), 1, N // 2 - 2) is None


J, H = 1e-2, 5e-4


@pytest.mark.parametrize(
    ("drag", "spring", "frequency"),
    [(1e-3, 0.0, [2.5, 5, 20]), (1e-3, 3.0, [1.0, 2.5, 3.0, 5, 10]), (0.0, 3.0, [1.0, 2.5, 3.0, 5, 10])],
)
def test_where_only_drag_damps_the_closed_form_is_found_without_waiting(
    drag: float, spring: float, frequency: list[float]
) -> None:
    """The free motion lasts 2 J / drag = 20 s, or for ever; a window is 8 periods, and two of them are discarded."""
    late = 1e-3
    plant = Plant.axis(J) + effects.find("spring")(stiffness=spring) + effects.find("delay")(time=late)
    if drag:
        plant += effects.find("viscous")(coefficient=drag)
    frf = stepped_sine(plant, frequency, 0.01, held="torque", substeps=32)
    s = 2j * np.pi * frf.frequency
    exact = np.exp(-late * s) / (J * s**2 + drag * s + spring)
    off = frf.response / exact
    assert np.abs(off - 1).max() < 1e-4
    assert np.all(np.abs(np.angle(off) / (2 * np.pi * frf.frequency)) < 2e-3 * late)


def test_a_measured_sine_of_any_frequency_is_the_closed_form() -> None:
    spring, drag = 3.0, 1e-3
    plant = Plant.axis(J) + effects.find("spring")(stiffness=spring) + effects.find("viscous")(coefficient=drag)
    for f in (3.17, 7.313, 23.9):
        t = H * np.arange(round(40 / f / H))
        frf = estimate_frf(simulate(plant, 0.01 * np.minimum(1, t * f / 8) * np.sin(2 * np.pi * f * t), H))
        s = 2j * np.pi * f
        assert frf.sine and abs(frf.response[0] * (J * s**2 + drag * s + spring) - 1) < 1e-4
