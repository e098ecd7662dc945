"""Waves over a part of the revolution: one is as good as several, where it is the right one."""

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, SAMPLE_TIME, J, run, runs

from gms_mujoco import effects
from gms_mujoco.diagnosis.waves import as_one_wave, known_in_part
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.record import Record

TRUE = effects.Cogging(harmonics=[9], amplitude=[0.3 * LEVEL], phase=[0.4])


def to_and_fro() -> list[Record]:
    """Two records of a part of the revolution."""
    time = np.arange(3000) * SAMPLE_TIME
    swells = 3 * LEVEL * (0.7 + 0.3 * np.sin(2 * np.pi * 0.5 * time))
    return [run(HEALTHY + TRUE, swells * np.cos(2 * np.pi * f * time), seed=k) for k, f in enumerate((7.0, 9.0))]


def fitted(records: list[Record], *harmonics: float) -> FitResult:
    """A fit to records with some harmonics, from the true friction."""
    n = len(harmonics)
    waves = effects.Cogging(harmonics=harmonics, amplitude=[0.1 * LEVEL] * n, phase=[0.3] * n)
    misfit = Misfit(HEALTHY + waves, observe(records, J))
    return refine(misfit, misfit.vector(HEALTHY + waves))


@pytest.mark.parametrize("harmonics", [(20.0, 30.0, 40.0), (18.0,)])
def test_the_wave_that_is_there_takes_the_place_of_others(harmonics: tuple[float, ...]) -> None:
    records = to_and_fro()
    assert 0.3 < np.ptp(np.concatenate([r.position for r in records])) * 9 / (2 * np.pi) < 1.5
    now = fitted(records, *harmonics)
    one = as_one_wave(now)
    assert one is not None and one.plant["cogging"].harmonics == pytest.approx([9])
    assert one.error < 1.1 * one.floor and one.error < now.error
    assert one.plant["cogging"].amplitude == pytest.approx(TRUE.amplitude, rel=0.02)


def test_the_right_wave_stays_and_so_do_several_that_are_there() -> None:
    assert as_one_wave(fitted(to_and_fro(), 9.0)) is None
    around = runs(HEALTHY + effects.Cogging(harmonics=[6, 11], amplitude=[0.2 * LEVEL] * 2, phase=[0.4, 1.0]))
    assert as_one_wave(fitted(around, 6.0, 11.0)) is None


def test_what_is_known_over_a_part_is_told_with_its_ends() -> None:
    records = to_and_fro()
    low, high = (f(np.concatenate([r.position for r in records])) for f in (np.min, np.max))
    said = known_in_part(fitted(records, 20.0, 30.0))
    assert said.startswith(f"cogging: known from {low:.3g} to {high:.3g} rad")
    assert not known_in_part(fitted(runs(HEALTHY + TRUE), 9.0))
