"""A Record is evenly sampled, finite and complete, or it is not made."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.errors import DataError
from gms_mujoco.record import Record

TIME = np.arange(100) * 1e-3
SIGNALS = {"torque": np.sin(TIME), "position": np.cos(TIME)}


def test_sample_time_and_signals() -> None:
    r = Record("run", TIME, SIGNALS)
    assert len(r) == 100 and r.sample_time == pytest.approx(1e-3)
    assert r.get("load") is None and r.torque is SIGNALS["torque"]


def test_slice_is_a_record_of_those_samples() -> None:
    r = Record("run", TIME, SIGNALS, resolution=1e-3).slice(20, 60, use="validate")
    assert (len(r), r.use, r.resolution) == (40, "validate", 1e-3)
    assert np.array_equal(r.time, TIME[20:60]) and np.array_equal(r.position, SIGNALS["position"][20:60])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"use": "train"}, r"run: use must be one of fit, select, validate; 'train' given"),
        ({"signals": {"torque": TIME}}, r"run: no 'position' signal; it has torque"),
        ({"signals": {**SIGNALS, "speed": TIME}}, r"unknown signal 'speed'; the signals are .*velocity"),
        ({"signals": {**SIGNALS, "load": TIME[1:]}}, r"load has shape \(99,\), time has \(100,\)"),
        ({"signals": {**SIGNALS, "load": np.full(100, np.nan)}}, r"load is not a finite number at sample 0"),
        ({"time": TIME[::-1]}, r"time does not run forward at sample 1"),
        ({"time": TIME**2 + 1e-3 * TIME}, r"equally spaced"),
    ],
)
def test_what_is_wrong_is_named(changes: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Record(**{"name": "run", "time": TIME, "signals": SIGNALS, **changes})


def test_lists_of_numbers_will_do_and_text_will_not() -> None:
    assert Record("run", list(range(20)), {"torque": [0] * 20, "position": [0] * 20}).position.dtype == float
    with pytest.raises(DataError, match="must be numbers"):
        Record("run", TIME, {**SIGNALS, "load": ["a"] * 100})


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(DataError, match="at least 16"):
        Record("run", TIME[:3], {k: v[:3] for k, v in SIGNALS.items()})


@given(st.lists(st.floats(allow_nan=True), min_size=16, max_size=40))
def test_any_time_is_taken_or_refused(times: list[float]) -> None:
    zeros = np.zeros(len(times))
    try:
        assert Record("run", np.array(times), {"torque": zeros, "position": zeros}).sample_time > 0
    except DataError as error:
        assert "\n" not in str(error)


def test_dates_and_spans_of_numpy_are_seconds() -> None:
    spans = np.arange(100) * np.timedelta64(1_000_000, "ns")
    for stamps in (spans, np.datetime64("2026-11-29T05:00") + spans):
        assert Record("run", stamps, SIGNALS).time == pytest.approx(TIME)
