"""Folds share the stretches evenly, and no motion keeps step with them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.identification.folds import folds


@given(st.integers(0, 200), st.integers(1, 9))
def test_of_those_that_follow_each_other_one_is_in_each_fold(stretches: int, count: int) -> None:
    fold = folds(stretches, count)
    assert len(fold) == stretches
    whole = fold[: stretches - stretches % count].reshape(-1, count)
    assert np.array_equal(np.sort(whole, 1), np.tile(np.arange(count), (len(whole), 1)))
    assert len(set(fold[len(whole) * count :])) == stretches % count


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("period", range(1, 31))
def test_every_phase_of_a_periodic_motion_is_seen_by_the_other_folds(period: int, count: int) -> None:
    """Of ten periods, whole stretches long, no phase falls into one fold alone."""
    fold = folds(10 * period, count).reshape(10, period)
    assert all(len(set(phase)) > 1 for phase in fold.T)
