"""Uneven time stamps: an even grid that keeps what the drive gave, and where the axis was."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.logs.timing import by_another_clock, evenly, strays_from_rows

H, N = 1e-3, 400


def _uneven(seed: int, share: float = 0.3) -> np.ndarray:
    """(N,) rising times, off from even steps by up to a share of one."""
    return H * (np.arange(N) + share * np.random.default_rng(seed).uniform(-1, 1, N))


@given(st.integers(0, 1000), st.floats(0.05, 0.45))
def test_as_much_torque_acts_as_the_drive_gave(seed: int, share: float) -> None:
    time, torque = _uneven(seed, share), np.random.default_rng(seed).normal(size=N)
    even, signals, note, _ = evenly(time, {"torque": torque})
    given_until = np.append(0.0, np.cumsum(torque[:-1] * np.diff(time)))
    step = even[1] - even[0]
    inside = even + step <= time[-1]
    expected = np.interp(even + step, time, given_until)
    assert np.cumsum(signals["torque"] * step)[inside] == pytest.approx(expected[inside], abs=1e-12)
    assert note is not None and "torque held" in note


@given(st.integers(0, 1000))
def test_the_axis_was_where_it_was(seed: int) -> None:
    """Within what a cubic tells of a sine of 30 Hz, a hundredth of what a chord does."""
    time = _uneven(seed)
    position = np.sin(2 * np.pi * 30 * time)
    even, signals, *_ = evenly(time, {"position": position, "torque": position})
    inner = slice(5, -5)
    true = np.sin(2 * np.pi * 30 * even)
    off, chord = (np.abs(x - true)[inner].max() for x in (signals["position"], np.interp(even, time, position)))
    assert off < 0.03 * chord


def test_a_torque_that_was_read_is_what_lies_between_two_readings() -> None:
    time = _uneven(0)
    even, signals, note, _ = evenly(time, {"torque": np.cos(200 * time)}, sensed=True)
    assert signals["torque"] == pytest.approx(np.interp(even, time, np.cos(200 * time)))
    assert note is not None and "all interpolated" in note


@pytest.mark.parametrize(("share", "other"), [(0.0, False), (0.04, False), (0.2, True)])
def test_a_loop_of_the_drive_itself_strays_by_little(share: float, other: bool) -> None:
    assert by_another_clock(_uneven(0, share)) == other


def test_every_fifth_row_of_a_loop_that_is_now_and_then_the_one_beside_it_is_of_another_clock() -> None:
    """As the joints of a UR10e are read at 100 Hz from 500."""
    rows = 5 * np.arange(N) + np.random.default_rng(0).choice([-1, 0, 0, 0, 0, 0, 1], N)
    assert by_another_clock(0.002 * rows)


@given(st.integers(0, 1000), st.floats(0.05, 0.4), st.floats(1.0, 20.0))
def test_a_position_tells_whether_its_rows_were_read_when_their_stamps_say(
    seed: int, share: float, frequency: float
) -> None:
    stamps = _uneven(seed, share)
    by_rows, by_stamps = (np.sin(2 * np.pi * frequency * t) for t in (H * np.arange(N), stamps))
    assert strays_from_rows(stamps, by_rows) is True and strays_from_rows(stamps, by_stamps) is False
    assert strays_from_rows(H * np.arange(N), by_stamps) is False  # nothing strays


@given(st.integers(0, 1000))
def test_a_position_that_moves_by_less_than_its_counts_tells_nothing_and_others_do(seed: int) -> None:
    stamps, count = _uneven(seed, 0.1), 1e-2
    position = np.round(np.sin(2 * np.pi * 0.5 * H * np.arange(N)) / count) * count
    assert strays_from_rows(stamps, position) is None
    even, signals, note, _ = evenly(stamps, {"position": position, "torque": position}, strays=True)
    assert note is not None and "in other records" in note
    assert np.ptp(np.diff(even)) < 1e-12 and np.array_equal(signals["torque"], position)
    assert "resampled" in str(evenly(stamps, {"position": position})[2])
