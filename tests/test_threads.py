"""Threads change how long a fit takes and nothing else."""

import threading

import numpy as np
import pytest
from bench import HEALTHY, UNKNOWN, runs
from threadpoolctl import threadpool_info, threadpool_limits

import gms_mujoco as gms
from gms_mujoco import threads


@pytest.mark.parametrize("given", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv(threads.VARIABLE, given)
    with pytest.raises(gms.GmsError, match=f"whole number from 1 on; '{given}' given"):
        threads.each(abs, [1, 2])


def test_results_come_in_order_and_work_inside_work_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(threads.VARIABLE, "2")
    both = threading.Barrier(2, timeout=20)

    def inner(i: int) -> str:
        return threading.current_thread().name

    def outer(i: int) -> tuple[int, set[str]]:
        if i < 2:
            both.wait()  # two at a time, or this never ends
        return i, set(threads.each(inner, range(5))) | {threading.current_thread().name}

    found = threads.each(outer, range(20))
    assert [i for i, _ in found] == list(range(20))
    assert all(len(names) == 1 for _, names in found)  # what is inside runs on the same thread


def test_an_error_on_a_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(threads.VARIABLE, "2")
    with pytest.raises(ZeroDivisionError):
        threads.each(lambda i: 1 / i, [1, 0, 2])


def test_a_fit_is_the_same_to_the_last_bit_at_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    records = runs(HEALTHY, seconds=1.5)
    found, compared = [], []
    for n in ("1", "2", "3"):
        monkeypatch.setenv(threads.VARIABLE, n)
        found.append(gms.fit(UNKNOWN, records))
        compared.append(gms.compare(found[0].plant, records).to_dict())
    assert compared[0] == compared[1] == compared[2]
    for other in found[1:]:
        assert other.plant == found[0].plant and other.error == found[0].error
        assert other.noise == found[0].noise and np.array_equal(other.floor_rows, found[0].floor_rows)
        assert np.array_equal(other.vector, found[0].vector) and other.plant.uncertainty == found[0].plant.uncertainty


def test_a_fit_keeps_blas_to_one_thread_and_gives_it_back(monkeypatch: pytest.MonkeyPatch) -> None:
    def used() -> set[int]:
        return {int(lib["num_threads"]) for lib in threadpool_info() if lib["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        before, inside = used(), []
        gms.fit(UNKNOWN, runs(HEALTHY, seconds=1.0), progress=lambda done, message: inside.append(used()))
        assert inside and all(found == {1} for found in inside)
        assert used() == before
        with threads.one_blas_thread(), threads.one_blas_thread():
            pass
        assert used() == before
