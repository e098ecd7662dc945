"""The number of elements follows the data, and what they cannot tell is said."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.elements import choose_elements
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.fit import fit
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


@pytest.mark.filterwarnings('error')
def test_fewer_numbers_than_unknowns_are_refused() -> None:
    f = np.geomspace(9, 300, 12)
    frf = FRF("few", f, 1 / (0.5 + 1e-3j * 2 * np.pi * f - J * (2 * np.pi * f) ** 2), excitation=1e-3)
    with pytest.raises(ModelError, match="no number of elements to choose from"):
        choose_elements(UNKNOWN, [frf], ())
    with pytest.raises(DataError, match=r"few: 4 numbers at 2 frequencies of responses, and \d+ unknowns of the plant"):
        choose_elements(UNKNOWN, [frf.band(0, f[1])])
    with pytest.raises(DataError, match=r"few: 6 numbers at 3 frequencies of responses, and 1\d unknowns of the plant"):
        fit(UNKNOWN.replace(effects.GMS(elements=4)), [frf.band(0, f[2])])
    assert choose_elements(UNKNOWN, [frf.where(np.arange(12) % 3 == 0)], (1, 2, 8)).plant["gms"].elements <= 2
