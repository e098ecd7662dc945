"""The native series against what NumPy and SciPy make of the same numbers, and changes of torques against replays."""

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from gms_mujoco import effects
from gms_mujoco.native import Joint, series
from gms_mujoco.plant import Plant

LAWS = [
    Plant.axis(J) + HEALTHY["gms"],
    Plant.axis(J) + effects.find("lugre")(
        stiffness=0.6, damping=1e-3, coulomb=LEVEL, static=1.1 * LEVEL, stribeck_velocity=0.5
    ),
    Plant.axis(J) + HEALTHY["gms"] + effects.find("asymmetric_friction")(level=0.2) + HEALTHY["viscous"],
]  # fmt: skip


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


def _motion(n: int = 900) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A motion that reverses, and stands still for a while."""
    t = 1e-3 * np.arange(n)
    q = 0.03 * np.sin(40 * t) + 0.004 * np.sin(310 * t + 1)
    q[300:320] = q[300]
    return t, q, np.gradient(q, t)


def _joints(plant: Plant, count: int) -> list[Joint]:
    """Joints that differ by less than their static level is above the other."""
    rng = np.random.default_rng(3)
    return [
        Joint([(e.name, e.elements, e.packed * rng.uniform(0.98, 1.02, len(e.packed))) for e in plant.effects])
        for _ in range(count)
    ]


def _band(torque: np.ndarray, band: series.Band) -> np.ndarray:
    series_ = torque if band.instants is None else series.mean(band.instants, torque)
    series_ = series_ if band.asked is None else series_ * band.asked
    rows = [band.first + k * band.stride for k in range(band.count)]
    return np.array([band.kernel @ series_[k : k + len(band.kernel)] for k in rows])


@pytest.mark.parametrize("plant", LAWS, ids=lambda p: "+".join(e.name for e in p.effects))
@pytest.mark.parametrize("count", [2, 5, 40])
@pytest.mark.parametrize("between", [False, True], ids=["samples", "instants"])
@pytest.mark.parametrize("some", [False, True], ids=["all", "some"])
def test_many_joints_change_as_each_does(plant: Plant, count: int, between: bool, some: bool) -> None:
    motion = t, q, v = _motion()
    instants = None
    if between:  # every sample, and some instants between them
        instants = np.sort(np.append(np.arange(len(t)), [10.25, 10.5, 400.125, 777.5])).astype(float)
        motion = tuple(np.interp(instants, np.arange(len(t)), x) for x in (t, q, v))
    asked = np.random.default_rng(5).integers(0, 2, len(t)).astype(float) if some else None
    band = series.Band(np.hanning(33)[1:-1] / 16, 7, 3, 250, instants, asked)
    joints = _joints(plant, count)
    memories = list(np.random.default_rng(4).uniform(-1, 1, (count, joints[0].n_memory)))
    torque = [_band(j.replay(*motion, memory=m).torque, band) for j, m in zip(joints, memories, strict=True)]
    found = series.changes(joints, *motion, None, None, memories, band)
    assert found.shape == (count - 1, band.count)
    np.testing.assert_allclose(found, torque[1:] - torque[0], rtol=0, atol=1e-13 * np.abs(torque).max())


@pytest.mark.parametrize("apart", [1, 3, 20])
def test_some_may_be_told_by_their_elements(apart: int) -> None:
    motion, band = _motion(), series.Band(np.ones(5) / 5, 0, 2, 400)
    joints = _joints(LAWS[0], apart + 3)
    parts = [j.elements(0, *motion) for j in joints]
    found = series.changes(joints, *motion, None, None, None, band, apart=apart)
    for j in range(1, apart + 1):
        n = parts[0].shape[1]
        for i in range(n):
            wanted = _band(parts[j][:, i] - parts[0][:, i], band)
            np.testing.assert_allclose(found[n * (j - 1) + i], wanted, rtol=0, atol=1e-13 * LEVEL)
    whole = [_band((parts[j] - parts[0]).sum(1), band) for j in (apart + 1, apart + 2)]
    np.testing.assert_allclose(found[-2:], whole, rtol=0, atol=1e-13 * LEVEL)
