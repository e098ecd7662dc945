"""Typical sizes of parameters, from those of the data."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, J, runs

from gms_mujoco.effects import LoadDependentFriction
from gms_mujoco.identification.candidates import at_strengths
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.scales import Scales


@pytest.mark.parametrize("logged", [None, 20.0])
def test_friction_under_load_is_tried_at_strengths_that_the_load_makes_felt(logged: float | None) -> None:
    """A load that was logged, in N m, or the torque of the drive, of thousandths of it: 10 and 30 % more friction."""
    data = runs(HEALTHY, seconds=1.0, seed=1)
    if logged is not None:
        data = [replace(r, signals={**r.signals, "load": np.full(len(r), logged)}) for r in data]
    scales = Scales.of(observe(data, J))
    typical = logged or float(np.sqrt(np.mean([np.mean(r.torque**2) for r in data])))
    tried = [e.coefficient * typical for e in at_strengths(LoadDependentFriction, {}, scales)]
    assert tried == pytest.approx([0.1, 0.3], rel=0.02)
    assert logged or typical < 10 * LEVEL
