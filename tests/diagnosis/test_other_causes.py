"""Causes that no effect of the catalogue is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gms_mujoco.diagnosis import other_causes
from gms_mujoco.diagnosis.other_causes import _along_revolution, _of_reading
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.record import Record


def test_the_work_of_an_inertia_that_varies_is_the_change_of_its_kinetic_energy() -> None:
    """Of any motion, for each of its harmonics: no friction is hidden in it."""
    t = np.arange(0, 4, 1e-3)
    q = 2 * np.sin(1.3 * t) + 0.7 * np.sin(4.1 * t + 1) + 0.5 * t**2
    v = 2.6 * np.cos(1.3 * t) + 2.87 * np.cos(4.1 * t + 1) + t
    a = -3.38 * np.sin(1.3 * t) - 11.767 * np.sin(4.1 * t + 1) + 1
    o = Observation(Record("any", t, {"position": q, "torque": np.sin(t)}), 100.0)
    torques = _along_revolution(o)
    power = (torques.inertia * a[:, None] + torques.torque) * v[:, None]
    work = np.cumsum((power[1:] + power[:-1]) / 2, 0) * 1e-3
    energy = torques.inertia * v[:, None] ** 2 / 2
    assert np.abs(energy[1:] - energy[0] - work)[:-50].max() < 1e-3 * np.abs(energy).max()


def test_a_reading_that_errs_takes_what_its_error_accelerates(monkeypatch: pytest.MonkeyPatch) -> None:
    """J times the second derivative of c cos(n q) + s sin(n q) less than J r'' is what the axis itself takes."""
    t, inertia, number = np.arange(0, 4, 1e-3), 0.3, 5.0
    q = 2 * np.sin(1.3 * t) + 0.7 * np.sin(4.1 * t + 1)
    o = Observation(Record("any", t, {"position": q, "torque": np.sin(t)}), 100.0)
    now: Any = SimpleNamespace(plant=SimpleNamespace(kind="hinge", driven_inertia=inertia),
                               misfit=SimpleNamespace(observations=[o]))  # fmt: skip
    monkeypatch.setattr(other_causes, "_waves_in", lambda *given: number)
    (torques,) = _of_reading(now)
    a = np.gradient(np.gradient(q, t), t)
    for k, wave in enumerate((np.cos, np.sin)):
        error = np.gradient(np.gradient(wave(number * q), t), t)
        taken = torques.inertia[:, k] * a + torques.torque[:, k]
        assert np.abs(taken + inertia * error)[50:-50].max() < 5e-3 * inertia * np.abs(error).max()
