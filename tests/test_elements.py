"""The number of elements follows the data, and what they cannot tell is said."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.elements import choose_elements
from gms_mujoco.errors import ModelError
from gms_mujoco.frf import FRF
from gms_mujoco.plant import Plant
from gms_mujoco.sweep import stepped_sine

J, LEVEL = 2.4e-5, 4.5e-3
UNKNOWN = Plant.axis(J) + effects.GMS(elements=1) + effects.Viscous()


def sweep(gms: effects.GMS, levels: np.ndarray) -> list[FRF]:  # type: ignore[name-defined]
    plant = Plant.axis(J) + gms + effects.Viscous(coefficient=4e-5)
    bench = {"resolution": 2 * np.pi / 1e6, "torque_noise": 2e-5}
    return [stepped_sine(plant, np.geomspace(9, 300, 10), u, held="torque", **bench) for u in levels * LEVEL]  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [1, 2])
def test_as_many_elements_as_the_axis_has(count: int) -> None:
    shares = [1.0] if count == 1 else [0.4, 0.6]
    gms = effects.GMS(
        stiffness=[1.0, 0.2][:count], fraction=shares, coulomb=LEVEL, static=LEVEL, stribeck_velocity=1.0,
        attraction=0.5,
    )  # fmt: skip
    found = choose_elements(UNKNOWN, sweep(gms, np.geomspace(0.15, 2, 5)), (1, 2, 3))
    assert found.plant["gms"].elements == count


def test_only_friction_without_values_has_its_elements_chosen() -> None:
    with pytest.raises(ModelError, match="whose stiffness has no value yet"):
        choose_elements(Plant.axis(J) + effects.Viscous(), [])
