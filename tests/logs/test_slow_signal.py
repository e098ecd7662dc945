"""slow_signal: rows between two readings of a position are left out, and what is left is the same motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco import effects, formats
from gms_mujoco.dataset import Dataset, load
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import baseline, fit
from gms_mujoco.logs.slow_signal import Readings
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

ROWS = np.arange(4000)
PLANT = Plant.axis(0.02) + effects.find("coulomb")(coulomb=0.4) + effects.find("viscous")(coefficient=0.02)


def moves(at: np.ndarray) -> np.ndarray:
    """Where an axis is at some rows."""
    return np.sin(2 * np.pi * at / 750) + 0.3 * np.sin(2 * np.pi * at / 205)


def held(every: float, first: float, jitter: float = 0.0) -> np.ndarray:
    """What rows show of a position that is read at some of them."""
    at = first + every * np.arange(len(ROWS) / every + 1)
    shown = at + jitter * np.random.default_rng(0).uniform(-1, 1, len(at))
    return np.asarray(moves(at)[np.maximum(np.searchsorted(shown, ROWS, side="right") - 1, 0)])


@given(st.integers(2, 20), st.integers(0, 19))
def test_one_clock_is_found_to_the_row(every: int, first: int) -> None:
    readings = Readings.of(held(every, first % every))
    assert readings is not None and (readings.every, readings.first) == (every, first % every)
    kept = readings.kept({"position": held(every, first % every), "torque": ROWS, "time": ROWS}, "position")
    assert np.array_equal(kept["position"], moves(kept["time"]))
    assert np.allclose(kept["torque"], kept["time"] + (every - 1) / 2), "its mean over the rows that follow"


@given(st.floats(2.1, 12.0), st.floats(0.0, 1.0), st.floats(0.0, 0.1))
def test_readings_by_a_clock_of_their_own_are_found_within_a_row(every: float, first: float, jitter: float) -> None:
    position = held(every, first, jitter)
    readings = Readings.of(position)
    assert readings is not None and abs(readings.every / every - 1) < 1e-3
    kept = readings.kept({"position": position, "time": ROWS}, "position")
    late = np.linalg.lstsq(np.gradient(moves(kept["time"]), every)[:, None], kept["position"] - moves(kept["time"]))[0]
    assert abs(float(late[0])) < 1.05


@pytest.mark.parametrize(
    "position",
    [
        moves(ROWS.astype(float)),
        np.floor(ROWS / 3.0),  # a coarse encoder, at constant speed
        np.floor(ROWS / 3.1),
        np.floor(np.cumsum(np.sin(ROWS / 500.0))),
        np.ones(len(ROWS)),
        np.random.default_rng(0).normal(size=len(ROWS)),
    ],
)  # fmt: skip
def test_what_is_read_at_every_row_is_left_alone(position: np.ndarray) -> None:
    assert Readings.of(position) is None


def logged(folder: Path, record: Record, position: np.ndarray) -> Dataset:
    """A log of a record, in which the position is another."""
    formats.write(folder / "run.csv", {"time": record.time, "torque": record.torque, "position": position})
    (folder / "dataset.toml").write_text('[[record]]\nfile = "run.csv"\n')
    return load(folder)


@pytest.mark.parametrize("rows", [2, 5])
def test_the_axis_is_found_as_from_a_log_of_the_lower_rate(rows: int, tmp_path: Path) -> None:
    command = multisine(16000, 5e-4, 0.3, 20.0, 1.0, np.random.default_rng(1))
    run = simulate(PLANT, command, 5e-4, resolution=2 * np.pi / 2**20, torque_noise=5e-3, seed=1)
    position = np.repeat(run.position[::rows], rows)[: len(run)]
    runs = logged(tmp_path, run, position)
    told = f"changes at every {rows} rows only, as one that is read at {2000 / rows:.4g} Hz"
    assert any(told in note for note in runs.notes)
    assert sum(map(len, runs.records)) == pytest.approx(len(run) / rows, abs=2)
    found = fit(baseline(), runs.fit)
    assert found.error < 5e-3
    assert found.plant.inertia == pytest.approx(0.02, rel=0.01)
    low, high = found.plant.uncertainty["viscous.coefficient"]
    assert low < 0.02 < high  # friction that weakens over all speeds may do a part of it
