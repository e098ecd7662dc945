"""What an axis has been through, along records."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gms_mujoco.diagnosis.history import faded, following, way

H = 1e-3  # s


def test_a_body_comes_up_to_a_speed_at_the_acceleration_that_friction_allows() -> None:
    """And follows as it is, carried by friction that is strong enough."""
    v = np.append(0.0, np.full(999, 2.0))
    (body,) = following([v], [H], np.array([4.0, 1e6]))
    assert body[:, 0] == pytest.approx(np.minimum(4.0 * H * np.arange(1000), 2.0))
    assert np.array_equal(body[:, 1], v)


@given(arrays(float, 200, elements=st.floats(-10, 10)), st.floats(0.01, 1e4))
def test_friction_on_a_body_gives_no_energy(v: np.ndarray, grip: float) -> None:
    """What the axis gives, force times its own velocity, is at least what the body gains."""
    (body,) = following([v], [H], np.array([grip]))
    force = np.diff(body[:, 0])
    assert np.sum(force * v[1:]) >= (body[-1, 0] ** 2 - body[0, 0] ** 2) / 2 - 1e-9


def test_records_of_any_length_are_followed_as_if_each_were_alone() -> None:
    rng = np.random.default_rng(0)
    records, steps, grips = [rng.normal(size=n) for n in (30, 100)], [H, 2 * H], np.array([1.0, 30.0])
    together = following(records, steps, grips)
    for v, h, body in zip(records, steps, together, strict=True):
        assert np.array_equal(following([v], [h], grips)[0], body)


def test_what_fades_is_left_to_a_third_after_its_way() -> None:
    v = np.sin(np.arange(0, 10, H))
    gone = way(v, H)
    assert gone[-1] == pytest.approx(2 * 3 + 1 + np.cos(10), rel=1e-3)
    left = faded(gone, np.array([2.0, 5.0]))
    assert left[np.argmin(np.abs(gone - 2.0)), 0] == pytest.approx(np.exp(-1), rel=1e-3)
