"""What a fit amounts to: its noise floor, and whether that says anything."""

from dataclasses import replace

import numpy as np
import pytest
from bench import GMS, HEALTHY, HIDDEN, UNKNOWN, J, runs

from gms_mujoco.diagnosis.judgement import at_floor
from gms_mujoco.fit import fit
from gms_mujoco.fit_result import FitResult, result_of
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe

COARSE = 2 * np.pi / 4096  # rad


def _stiffer(times: float, resolution: float) -> FitResult:
    """What a plant with friction so many times stiffer than that of the axis leaves."""
    plant = HEALTHY.replace(GMS.replace(stiffness=times * np.asarray(GMS.stiffness)))
    misfit = Misfit(plant, observe(runs(HEALTHY, resolution=resolution), J))
    return result_of(misfit, misfit.vector(plant))


def _claiming_all(result: FitResult) -> FitResult:
    """The same, with all that it leaves for noise."""
    return replace(result, floor=result.error, floor_rows=result.misfit.residual(result.vector))


@pytest.mark.parametrize("resolution", [COARSE / 16, COARSE])
def test_friction_that_makes_the_noise_itself_is_at_no_floor(resolution: float) -> None:
    stiff = _claiming_all(_stiffer(300.0, resolution))
    assert stiff.rattles and not stiff.is_near_floor
    assert not at_floor(stiff, cross_validated(stiff.misfit, stiff.vector))


@pytest.mark.parametrize("resolution", [COARSE / 16, COARSE])
def test_friction_as_stiff_as_that_of_the_axis_is(resolution: float) -> None:
    true = _claiming_all(_stiffer(1.0, resolution))
    assert not true.rattles and true.is_near_floor
    assert at_floor(true, cross_validated(true.misfit, true.vector))


@pytest.mark.parametrize("hidden", ["", *HIDDEN])
def test_no_fit_from_the_data_rattles(hidden: str) -> None:
    plant = HEALTHY + HIDDEN[hidden] if hidden else HEALTHY
    assert not fit(UNKNOWN, runs(plant)).rattles
