"""intervals: as wide as estimates scatter, from few blocks too."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from bench import HEALTHY, SAMPLE_TIME, runs
from scipy import signal, stats

from gms_mujoco.identification.intervals import _freedom, blocks, correlation, covariance
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.misfit import Misfit


def linear(matrix: np.ndarray, target: np.ndarray, per_block: int) -> tuple[Misfit, np.ndarray]:
    """A linear problem in the place of one of friction, with blocks of so many rows, and its solution."""
    x = np.linalg.lstsq(matrix, target, rcond=None)[0]
    problem: Any = SimpleNamespace(
        observations=[SimpleNamespace(rows_per_block=lambda duration: per_block, jumps=False)], splits=[],
        prior=np.zeros(len(x)), reach=np.ones_like, residual=lambda x: target - matrix @ x, jacobian=lambda x: -matrix,
        size=len(x), n_common=len(x),
    )  # fmt: skip
    problem.with_steps = lambda x, deviation: problem
    return cast(Misfit, problem), x


def half_widths(problem: Misfit, x: np.ndarray) -> np.ndarray:
    whole, deviations = covariance(problem, x)
    return np.asarray(deviations * np.sqrt(np.diag(whole)))


def test_the_interval_of_a_mean_is_that_of_student() -> None:
    y = np.random.default_rng(0).standard_normal(12)
    problem, x = linear(np.ones((12, 1)), y, 1)
    half = half_widths(problem, x)[0]
    assert half == pytest.approx(stats.t.ppf(0.975, 11) * y.std(ddof=1) / np.sqrt(12), rel=1e-6)


def test_intervals_hold_the_truth_from_few_blocks() -> None:
    rng = np.random.default_rng(1)
    matrix = np.column_stack([np.ones(40), rng.uniform(0.2, 2.0, 40)])
    held = []
    for _ in range(2000):
        problem, x = linear(matrix, rng.standard_normal(40), 5)
        held.append(np.abs(x) < half_widths(problem, x))
    assert np.all(np.abs(np.mean(held, 0) - 0.95) < 0.025)


@pytest.mark.parametrize("size", [1e-6, 1e-12, 1e-17])
def test_what_is_hardly_seen_leaves_the_rest_as_sure_as_it_is(size: float) -> None:
    """Alone, or as a part of what another does; the covariance has no direction of a negative variance."""
    rng = np.random.default_rng(2)
    matrix, target = rng.uniform(0.2, 2.0, (60, 2)), rng.standard_normal(60)
    for beside in (size * rng.standard_normal(60), matrix[:, 0] + size * rng.standard_normal(60)):
        problem, x = linear(np.column_stack([matrix, beside]), target, 1)
        whole, _ = covariance(problem, x)
        assert np.linalg.eigvalsh(whole).min() > -1e-9 and 0 < np.diag(whole).max() < 1.1e6
        alone, _ = covariance(*linear(matrix, target, 1))
        assert whole[1, 1] == pytest.approx(alone[1, 1], rel=0.1)


def test_blocks_that_weigh_the_same_leave_one_degree_of_freedom_less_than_they_are() -> None:
    share = np.full((9, 1, 1), 1 / 9)
    assert _freedom(np.eye(1), share, share) == pytest.approx(8)


def test_the_correlation_time_of_a_first_order_process() -> None:
    a = 0.9
    x = signal.lfilter([1.0], [1.0, -a], np.random.default_rng(0).standard_normal(200_000))
    assert correlation(x) == pytest.approx((1 + a**2) / (1 - a**2), rel=0.25)
    assert correlation(np.zeros(10)) == 1.0


def test_blocks_hold_every_row_once_and_are_long_where_the_residual_is_slow() -> None:
    observations = [Observation(r, 100.0) for r in runs(HEALTHY, seconds=6.0)]
    rng, m = np.random.default_rng(0), [len(o.index) for o in observations]
    noise = [rng.standard_normal(n) for n in m]
    slow = np.sin(2 * np.pi * 0.5 * observations[0].stride * SAMPLE_TIME * np.arange(m[0]))
    found = list(blocks(observations, [slow, *noise[1:]]))
    assert [a for a, _, _ in found] == [0, *(b for _, b, _ in found[:-1])] and found[-1][1] == sum(m)
    own = [[(b - a, power) for a, b, power in found if start <= a < start + n] for start, n in zip(
        np.cumsum([0, *m[:-1]]), m, strict=True)]  # fmt: skip
    assert len(own[0]) == 2 and {p for _, p in own[0]} == {1.0}  # half a record each
    assert all(len(o) > 8 and {p for _, p in o} == {0.5} for o in own[1:])


def test_what_the_data_do_not_see_may_be_anything() -> None:
    """Also beside a parameter that they determine, whose interval does not change."""
    rng = np.random.default_rng(4)
    matrix, target = np.ones((60, 1)), rng.standard_normal(60)
    seen, x = linear(matrix, target, 6)
    blind, y = linear(np.column_stack([matrix, np.zeros(60)]), target, 6)
    widths = half_widths(blind, y)
    assert np.isinf(widths[1]) and widths[0] == pytest.approx(half_widths(seen, x)[0])
    assert np.isfinite(covariance(blind, y)[0]).all()
