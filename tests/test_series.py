"""The native series against what NumPy and SciPy make of the same numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from gms_mujoco.native import series


def integrated(instants: np.ndarray, torque: np.ndarray, k: int) -> float:
    """Mean of a broken line with the weight 1 - |t - k|, by Simpson's rule, exact for the cubic that it is."""
    edges = instants[(instants >= k - 1) & (instants <= k + 1)]
    middle = (edges[:-1] + edges[1:]) / 2

    def weighed(t: np.ndarray) -> np.ndarray:
        return np.interp(t, instants, torque) * (1 - np.abs(t - k))

    return float(np.sum(np.diff(edges) / 6 * (weighed(edges[:-1]) + 4 * weighed(middle) + weighed(edges[1:]))))


@given(st.integers(2, 9), st.lists(st.floats(0.01, 0.99), max_size=12), st.integers(0, 2**32 - 1))
def test_the_mean_is_the_integral_with_a_triangle(last: int, between: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    instants = np.union1d(np.arange(last + 1.0), [x + rng.integers(last) for x in between])
    torque = rng.standard_normal((len(instants), 3))
    found = series.mean(instants, torque)
    assert np.array_equal(found[[0, -1]], torque[[0, -1]])
    for column in range(3):
        expected = [integrated(instants, torque[:, column], k) for k in range(1, last)]
        assert np.allclose(found[1:-1, column], expected, rtol=0, atol=1e-12)
        assert np.allclose(series.mean(instants, torque[:, column]), found[:, column], rtol=0, atol=1e-14)


@pytest.mark.parametrize("columns", [1, 2, 4, 7, 9])
@pytest.mark.parametrize(("taps", "stride"), [(3, 1), (21, 4), (67, 3)])
def test_a_band_is_a_filter_and_every_so_many_samples_of_it(columns: int, taps: int, stride: int) -> None:
    x = np.random.default_rng(0).standard_normal((400, columns))
    kernel = signal.firwin(taps, 0.2)
    count, first = (400 - 5 - taps) // stride + 1, 5
    expected = np.array([np.convolve(c[first:], kernel, "valid")[::stride][:count] for c in x.T])
    assert np.allclose(series.band(x, kernel, first, stride, count), expected, rtol=0, atol=1e-13)
    one = series.band(x[:, 0], kernel, first, stride, count)
    assert one.shape == (count,) and np.allclose(one, expected[0], rtol=0, atol=1e-13)
