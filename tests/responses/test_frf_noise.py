"""The noise that is told of responses without a deviation is the one that was added."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gms_mujoco.frf import FRF
from gms_mujoco.responses.frf_noise import beside, incoherence, roughness

J = 2.4e-5
FREQUENCY = np.geomspace(5, 200, 40)
OMEGA = 2j * np.pi * FREQUENCY
ONE_MASS = 1 / (J * OMEGA**2 + 3e-4 * OMEGA + 0.5)
TWO_MASSES = 1 / (J * OMEGA**2 + 3e-4 * OMEGA + 0.5 + 0.5 * J * OMEGA**2 / (1 + (OMEGA / 360) ** 2 + 3e-5 * OMEGA))
LEVELS = (2e-4, 1e-3, 5e-3)


def normal(rng: np.random.Generator) -> np.ndarray:
    """Complex, of variance 1."""
    return (rng.standard_normal(len(FREQUENCY)) + 1j * rng.standard_normal(len(FREQUENCY))) / math.sqrt(2)


def measured(response: np.ndarray, share: float = 0.0, position: float = 0.0, torque: float = 0.0) -> list[FRF]:
    """A linear axis at several amplitudes of torque, noise of each source added."""
    rng = np.random.default_rng(3)
    found = []
    for level in LEVELS:
        y = response * (1 + share * normal(rng) + torque / level * normal(rng)) + position / level * normal(rng)
        found.append(FRF("noisy", FREQUENCY, y, excitation=level, amplitude=level * np.abs(response)))
    return found


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_roughness_is_the_noise_of_a_response_with_a_resonance(share: float) -> None:
    for frf in measured(ONE_MASS, share):
        assert roughness(frf) == pytest.approx(share, rel=0.5)


def test_few_points_tell_no_roughness_and_clean_ones_none() -> None:
    clean = FRF("clean", FREQUENCY, ONE_MASS)
    assert roughness(clean) < 1e-3
    assert math.isnan(roughness(clean.where(FREQUENCY < 6.5)))


@pytest.mark.parametrize("response", [ONE_MASS, TWO_MASSES], ids=["one mass", "two masses"])
@pytest.mark.parametrize("source", [{"share": 0.01}, {"position": 4e-7}, {"torque": 4e-6}], ids=lambda s: next(iter(s)))
def test_each_source_is_told_beside_the_plant_that_was_measured(response: np.ndarray, source: dict[str, float]) -> None:
    """Also where its resonances bend the response between few points, and where noise is no part of the response."""
    frfs = measured(response, **source)
    true = {
        "share": lambda f: np.full(len(f), source["share"]),
        "position": lambda f: source["position"] / f.amplitude,
        "torque": lambda f: source["torque"] / f.excitation,
    }[next(iter(source))]
    told = beside(frfs, [response] * len(frfs))
    assert told is not None
    off = np.concatenate([np.log(t / true(f)) for t, f in zip(told, frfs, strict=True)])
    assert abs(np.median(off)) < 0.25 and np.quantile(np.abs(off), 0.9) < 0.5  # the outermost have few neighbours


def test_bad_points_count_for_little() -> None:
    frfs = measured(ONE_MASS, 0.01)
    bad = replace(frfs[0], response=np.where(np.arange(len(FREQUENCY)) == 20, 1.5, 1.0) * frfs[0].response)
    clean, dirty = (beside(f, [ONE_MASS] * len(LEVELS)) for f in (frfs, [bad, *frfs[1:]]))
    assert clean is not None and dirty is not None
    assert np.median(np.concatenate(dirty)) < 1.3 * np.median(np.concatenate(clean))


def test_points_of_less_coherence_are_worse_by_what_it_says() -> None:
    """The level stays that of the good points, so that nobody needs to know over how many averages it was told."""
    coherence = np.where(FREQUENCY > 100, 0.2, 0.99)
    worse = np.sqrt((1 - coherence) / coherence) / np.sqrt(0.01 / 0.99)
    rng = np.random.default_rng(5)
    good = measured(ONE_MASS, 0.01)
    bad = [replace(f, coherence=coherence, response=f.response * (1 + 0.01 * (worse - 1) * normal(rng))) for f in good]
    assert np.allclose(incoherence(bad[0]), worse) and np.all(incoherence(good[0]) == 1)
    assert np.all(incoherence(replace(bad[0], sigma=np.abs(ONE_MASS))) == 1)  # what was measured says more
    assert np.all(incoherence(replace(bad[0], coherence=np.where(FREQUENCY > 100, 0.9999, 1.0))) == 1)
    assert roughness(bad[0]) == pytest.approx(0.01, rel=0.5)
    told = beside(bad, [ONE_MASS] * len(LEVELS))
    assert told is not None
    assert all(abs(np.median(np.log(t / (0.01 * worse)))) < 0.3 for t in told)


def test_a_plant_that_lacks_a_resonance_tells_nothing_or_no_less_than_there_is() -> None:
    frfs = measured(TWO_MASSES, 0.002)
    told = beside(frfs, [ONE_MASS] * len(frfs))
    assert told is None or np.median(np.concatenate(told)) > 0.002


def test_too_few_points_tell_nothing() -> None:
    frf = measured(ONE_MASS, 0.01)[0].where(FREQUENCY < 6)
    assert beside([frf], [ONE_MASS[: len(frf)]]) is None and beside([], []) is None
