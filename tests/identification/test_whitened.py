"""whitened: how a residual changes over as much as the data leave open, along directions that they tell apart."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from bench import HEALTHY, J, runs
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.identification.intervals import covariance
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.whitened import whitened

rng = np.random.default_rng(3)
MATRIX = np.column_stack([np.ones(400), rng.uniform(0.5, 2.0, 400)])
TARGET = MATRIX @ [1.0, 2.0] + rng.standard_normal(400)
OFF = rng.uniform(-0.5, 0.5, 400)  # of a stair, that each row is off: they jump one after the other


def problem(step: float, seen: float, bound: float = np.inf) -> tuple[Misfit, np.ndarray]:
    """A linear problem that goes up in stairs of so much, with a derivative that sees so much of their slope; and its
    solution without them. An unknown goes no further than `bound` from there."""
    x = np.linalg.lstsq(MATRIX, TARGET, rcond=None)[0]
    made: Any = SimpleNamespace(
        observations=[SimpleNamespace(rows_per_block=lambda duration: 10, jumps=True)], splits=[], size=2, n_common=2,
        prior=np.zeros(2), reach=np.ones_like, bounds=(x - bound, x + bound), jacobian=lambda x: -seen * MATRIX,
        residual=lambda x: TARGET - np.round(MATRIX @ x / step + OFF) * step,
    )  # fmt: skip
    return cast(Misfit, made), x


def test_slopes_are_those_of_the_stairs_and_not_of_one_of_them() -> None:
    """A derivative at the point is 0 or a spike; here it is wrong by a third."""
    smooth, x = problem(1e-9, 1.0)
    steps, _ = problem(0.05, 0.67)
    half = [np.sqrt(np.diag(covariance(p, x)[0])) for p in (smooth, steps)]
    np.testing.assert_allclose(half[1], half[0], rtol=0.1)
    around = whitened(steps, x)
    np.testing.assert_allclose(np.linalg.norm(around.slopes, axis=0), 1 / 0.67, rtol=0.1)
    np.testing.assert_allclose(around.normal, around.slopes.T @ around.slopes, rtol=1e-6)


def test_no_look_goes_beyond_a_bound() -> None:
    """At one the derivative at the point is all there is."""
    free, x = problem(1e-9, 0.5)
    np.testing.assert_allclose(np.linalg.norm(whitened(free, x).slopes, axis=0), 2.0, rtol=1e-3)
    held, _ = problem(1e-9, 0.5, bound=0.0)
    np.testing.assert_allclose(np.linalg.norm(whitened(held, x).slopes, axis=0), 1.0, rtol=1e-6)
    near, _ = problem(1e-9, 0.5, bound=0.01)
    asked = []
    within, residual = near.bounds, near.residual
    near.residual = lambda x: asked.append(x) or residual(x)  # type: ignore[method-assign, func-returns-value]
    whitened(near, x)
    assert len(asked) > 1 and all(np.all((x >= within[0] - 1e-12) & (x <= within[1] + 1e-12)) for x in asked)


@pytest.fixture(scope="module")
def healthy() -> tuple[Misfit, np.ndarray]:
    misfit = Misfit(HEALTHY, observe(runs(HEALTHY, seconds=1.0), J))
    return misfit, misfit.vector(HEALTHY)


@given(st.floats(0.01, 0.1))
def test_no_look_goes_below_a_least_value_by_a_rounding(small: float) -> None:
    """An effect refuses what is less, by however little."""
    problem_, x = problem(1e-9, 0.5)
    made, here = cast(Any, problem_), np.array([small, 1.0])
    told = made.residual

    def residual(there: np.ndarray) -> np.ndarray:
        assert np.all(there >= 0)
        return np.asarray(told(x + there - here))

    made.residual, made.bounds = residual, (np.zeros(2), np.full(2, np.inf))
    assert np.isfinite(whitened(problem_, here).slopes).all()


def test_states_before_a_record_follow_the_parameters(healthy: tuple[Misfit, np.ndarray]) -> None:
    """And what is left to them moves no parameter."""
    misfit, x = healthy
    around, n = whitened(misfit, x), misfit.n_common
    assert n < misfit.size
    assert np.abs(around.root[:n, n:]).max() < 1e-9 * np.abs(around.root[:n, :n]).max()
    np.testing.assert_allclose(around.slopes[:, n:], around.jacobian @ around.root[:, n:])
    states = around.jacobian[:, n:]
    normal = states.T @ states + np.diag(around.prior[n:])
    coupled = states.T @ around.jacobian[:, :n] @ around.root[:n, :n] + normal @ around.root[n:, :n]
    assert np.abs(coupled).max() < 1e-6 * np.sqrt(np.diag(normal).max())  # nothing is gained by another state


def test_slopes_are_the_same_on_any_number_of_threads(
    healthy: tuple[Misfit, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    for threads in ("1", "3"):
        monkeypatch.setenv("GMS_MUJOCO_THREADS", threads)
        found.append(whitened(*healthy).slopes)
    np.testing.assert_array_equal(*found)
