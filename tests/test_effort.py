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


def test_a_replay_counts_its_elements_and_instants() -> None:
    plant = gms.Plant.axis(0.01) + gms.effects.GMS(4) + gms.effects.Viscous(coefficient=0.1)
    time = 1e-3 * np.arange(50)
    with effort.counted() as spent:
        plant.joint().replay(time, np.sin(time), np.cos(time))
    assert spent.spent == 50 * sum(plant.joint().counts)


def test_a_fit_counts_alike_at_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    records, counts = runs(HEALTHY, seconds=1.5), []
    for n in ("1", "2", "3"):
        monkeypatch.setenv(threads.VARIABLE, n)
        with effort.counted() as spent:
            gms.fit(UNKNOWN, records)
        counts.append(spent.spent)
    assert counts[0] == counts[1] == counts[2] > 0
