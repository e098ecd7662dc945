"""Repeats are averaged without their outliers, and levels of excitation are told from them."""

import numpy as np
import pytest

from gms_mujoco.errors import DataError
from gms_mujoco.responses.repeats import average_repeats, levels, robust_mean

F = np.geomspace(1, 300, 40)
G = 1 / (0.5 + 1e-3j * 2 * np.pi * F - 2.4e-5 * (2 * np.pi * F) ** 2)


def test_levels_are_told_from_repeats() -> None:
    rng = np.random.default_rng(0)
    f = np.tile(F, 3)
    repeats = rng.uniform(0.95, 1.05, len(f))
    assert len(levels(f, repeats)) == len(levels(F, np.abs(G))) == 1  # at one frequency alike, or one of each
    size = np.repeat([1.0, 1.2, 5.0], len(F)) * rng.uniform(0.99, 1.01, len(f))
    order = rng.permutation(len(f))
    found = levels(f[order], size[order])
    assert [round(float(np.median(size[order][x])), 1) for x in found] == [1.0, 1.2, 5.0]
    assert np.sum(found, 0).tolist() == [1] * len(f)
    assert [len(x) for x in (levels(np.full(3, 5.0), np.array([1.0, 2.0, 3.0])),)] == [3]  # of one frequency each
    with pytest.raises(DataError, match=r"at .* Hz stand excitations of .* number the responses"):
        levels(f, size / np.tile(np.abs(G), 3))



def test_outliers_among_repeats_have_no_weight() -> None:
    rng = np.random.default_rng(0)
    repeats = G[:, None] * (1 + 0.01 * (rng.standard_normal((40, 12)) + 1j * rng.standard_normal((40, 12))))
    repeats[:, 3] *= 40
    repeats[::2, 8] *= -1
    where, mean, sigma, count, _ = average_repeats(np.repeat(F, 12), repeats.ravel())
    assert np.allclose(where, F) and (count == 12).all() and sigma is not None
    z = np.abs(mean - G) / sigma
    assert np.abs(mean / G - 1).max() < 0.02 and np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.35)


def test_mean_of_few_repeats() -> None:
    assert robust_mean(np.array([1 + 1j])) == (1 + 1j, 0.0, 1)
    assert robust_mean(np.array([1.0, 3.0]))[0] == 2
    assert robust_mean(np.array([1.0, 1.0, 50.0]))[::2] == (1, 2)
