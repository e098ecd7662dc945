"""Lines in time: one that all records have is found, with what it carries, and what each has of its own is not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.time_spectrum import line
from gms_mujoco.record import Record

T = np.arange(0, 4, 1e-3)


def _seen(*motions: np.ndarray) -> list[Observation]:
    return [Observation(Record(f"run {k}", T, {"position": q, "torque": q}), 100.0) for k, q in enumerate(motions)]


WANDERING = _seen(*(np.cumsum(np.random.default_rng(k).standard_normal(len(T))) for k in range(3)))


def _along(seen: list[Observation], *series: np.ndarray) -> list[np.ndarray]:
    return [x[o.index] for o, x in zip(seen, series, strict=True)]


@given(st.floats(3, 90), st.integers(0, 10**6))
def test_a_line_in_all_records_is_found_whatever_its_phases(frequency: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sines = [np.sin(2 * np.pi * frequency * T + rng.uniform(0, 6)) for _ in WANDERING]
    noise = [0.5 * rng.standard_normal(len(T)) for _ in WANDERING]
    found = line(WANDERING, _along(WANDERING, *(s + n for s, n in zip(sines, noise, strict=True))), 4)
    assert found.frequency == pytest.approx(frequency, abs=0.03)
    assert found.share == pytest.approx(0.5 / 0.75, abs=0.1) and found.moved[0] < 0.2


def test_lines_that_records_have_of_their_own_carry_a_part() -> None:
    sines = [np.sin(2 * np.pi * f * T) for f in (7.0, 11.0, 17.0)]
    assert line(WANDERING, _along(WANDERING, *sines), 4).share < 0.4


@pytest.mark.parametrize("sense", [np.ones_like, np.sign])
def test_a_sign_by_the_velocity_is_taken_into_account(sense: np.ufunc) -> None:
    """With the other sense little of the line is one."""
    signs = [np.asarray(sense(o.velocity)) for o in WANDERING]
    series = _along(WANDERING, *(np.sin(2 * np.pi * 9 * T) * s for s in signs))
    shares = {s: line(WANDERING, series, 4, s).share for s in (np.ones_like, np.sign)}
    assert shares.pop(sense) > 0.9 and max(shares.values()) < 0.4


@pytest.mark.parametrize("number", [1, 2, 3, 5])
def test_what_the_motion_has_itself_is_said(number: int) -> None:
    swinging = _seen(*(np.sin(2 * np.pi * 3 * T + k) for k in range(2)))
    found = line(swinging, _along(swinging, *2 * [np.sin(2 * np.pi * 3 * number * T)]), 4)
    assert found.frequency == pytest.approx(3 * number, abs=0.03)
    assert int(np.argmax(found.moved)) + 1 in (number, number / 2)  # the speed has twice the frequency
    assert found.moved.max() > 0.8


def test_records_that_are_too_short_have_none() -> None:
    assert line(WANDERING, _along(WANDERING, T, T, T), 1000).frequency == 0
