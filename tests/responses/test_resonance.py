"""Antiresonances of a response."""

import numpy as np
import pytest

from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF
from gms_mujoco.responses.resonance import antiresonances, find_antiresonance


def test_antiresonance_of_a_known_curve() -> None:
    f = np.geomspace(1, 30, 60)
    curve = (7.3**2 - f**2 + 0.2j * f) / (20**2 - f**2 + 2j * f)
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(40):
        noisy = curve + 0.003 * (rng.standard_normal(60) + 1j * rng.standard_normal(60))
        sigma = np.full(60, 0.003 * np.sqrt(2))
        found, low, high = find_antiresonance(FRF("a", f, noisy, sigma=sigma), 3, 15)
        assert found == pytest.approx(7.3, rel=0.02)
        inside += low < 7.3 < high
    assert inside >= 36
    with pytest.raises(DataError, match="no dip"):
        find_antiresonance(FRF("a", f, 1 / f + 0j), 3, 15)


def test_every_antiresonance_is_found_by_itself() -> None:
    f = np.geomspace(1, 100, 120)
    curve = (7.3**2 - f**2 + 0.2j * f) * (41**2 - f**2 + 1j * f) / (20**2 - f**2 + 2j * f) / (60**2 - f**2 + 2j * f)
    rng = np.random.default_rng(0)
    noise = 0.02 * (rng.standard_normal(120) + 1j * rng.standard_normal(120))
    found = antiresonances(FRF("a", f, curve * (1 + noise), sigma=0.03 * np.abs(curve)))
    assert len(found) == 2
    for (at, low, high), true in zip(found, (7.3, 41), strict=True):
        assert low < true < high and at == pytest.approx(true, rel=0.02)


def test_a_mass_line_has_no_antiresonance_in_its_noise() -> None:
    f = np.geomspace(1, 300, 60)
    curve = 1 / (0.5 + 6e-3j * f - 9.5e-4 * f**2)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = (rng.standard_normal(60) + 1j * rng.standard_normal(60)) / np.sqrt(2)
        assert antiresonances(FRF("a", f, curve + 0.03 * noise, sigma=np.full(60, 0.03))) == []
        assert antiresonances(FRF("a", f, curve * (1 + 0.1 * noise))) == []
    outlier = curve.copy()
    outlier[30] /= 10
    assert antiresonances(FRF("a", f, outlier)) == []


def test_a_dip_of_points_without_coherence_is_no_antiresonance() -> None:
    f = np.geomspace(1, 100, 120)
    line, dip = 1 / (0.5 + 6e-3j * f - 9.5e-4 * f**2), (7.3**2 - f**2 + 0.2j * f) / (20**2 - f**2 + 2j * f)
    hole = np.abs(np.log(f / 15)) < 0.06
    assert antiresonances(FRF("a", f, np.where(hole, 0.2, 1) * line)) != []
    assert antiresonances(FRF("a", f, np.where(hole, 0.2, 1) * line, coherence=np.where(hole, 0.3, 0.95))) == []
    (found,) = antiresonances(FRF("a", f, dip, coherence=np.where(np.abs(dip) < 0.03, 0.3, 0.95)))  # its flanks show it
    assert found[1] < 7.3 < found[2]
    assert antiresonances(FRF("a", f, dip, coherence=0.2)) == []
