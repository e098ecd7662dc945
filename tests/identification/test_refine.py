"""The last steps of a fit."""

import pytest
from bench import GMS, HEALTHY, LEVEL, J, runs

from gms_mujoco.fit_result import FitResult, result_of
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import gone_on
from gms_mujoco.plant import Plant

SEEN = observe(runs(HEALTHY, seconds=4.0, seed=4), J)


def _at(plant: Plant) -> FitResult:
    misfit = Misfit(plant, SEEN)
    return result_of(misfit, misfit.vector(plant))


@pytest.mark.parametrize("off", [1.003, 0.997])
def test_a_fit_that_ended_beside_its_best_is_gone_on_with_to_the_noise_floor(off: float) -> None:
    beside = _at(HEALTHY.replace(GMS.replace(coulomb=off * LEVEL, static=5e-3 * off)))
    assert 1.5 * beside.floor < beside.error < 5 * beside.floor
    there = gone_on(beside)
    assert there.error < 1.1 * there.floor and there.error < 0.7 * beside.error
    assert gone_on(there) is there


def test_a_fit_that_leaves_many_times_the_noise_is_left_where_it_is() -> None:
    """Something else is missing there."""
    astray = _at(HEALTHY.replace(GMS.replace(coulomb=2 * LEVEL, static=2.5 * LEVEL)))
    assert astray.error > 5 * astray.floor and gone_on(astray) is astray
