"""Work is counted: inside what counts it, on every thread, and by any number of them alike."""

import numpy as np
import pytest
from bench import HEALTHY, UNKNOWN, runs

import gms_mujoco as gms
from gms_mujoco import effort, threads


def test_nothing_is_counted_outside_and_all_is_inside_also_by_what_is_around(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(threads.VARIABLE, "2")
    effort.add(1)
    with effort.counted() as outer:
        effort.add(2)
        with effort.counted() as inner:
            threads.each(effort.add, [10] * 100)
        effort.add(3)
    effort.add(4)
    assert inner.spent == 1000 and outer.spent == 1005


def _spent(law: gms.Effect, instants: int) -> int:
    time, joint = 1e-3 * np.arange(instants), (gms.Plant.axis(0.01) + law).joint()
    with effort.counted() as spent:
        joint.replay(time, np.sin(time), np.cos(time))
    return spent.spent


def test_a_replay_counts_its_elements_and_instants() -> None:
    level = {"coulomb": 1.0, "static": 1.0, "stribeck_velocity": 1.0, "attraction": 1.0}
    few, many = (gms.effects.GMS(stiffness=np.ones(n), fraction=np.full(n, 1 / n), **level) for n in (4, 9))
    assert _spent(few, 100) == 2 * _spent(few, 50)
    assert _spent(many, 50) - _spent(few, 50) == 50 * 5


def test_a_law_without_elements_is_more_work_than_a_drag() -> None:
    dahl = gms.effects.Dahl(stiffness=1.0, coulomb=1.0)
    assert _spent(dahl, 50) > 1.5 * _spent(gms.effects.QuadraticDrag(coefficient=1.0), 50)


def test_a_fit_counts_alike_at_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    records, counts = runs(HEALTHY, seconds=1.5), []
    for n in ("1", "2", "3"):
        monkeypatch.setenv(threads.VARIABLE, n)
        with effort.counted() as spent:
            gms.fit(UNKNOWN, records)
        counts.append(spent.spent)
    assert counts[0] == counts[1] == counts[2] > 0
