"""What a fit could not tell: said for responses and records alike."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import run

from gms_mujoco import effects
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.frf import FRF
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.undetermined import (
    by_experiment,
    hardly_slides,
    left_open,
    never_slips,
    undetermined,
)
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.sweep import stepped_sine

J, LEVEL = 2.4e-5, 4.5e-3
GMS = effects.GMS(
    stiffness=[1.0, 0.2], fraction=[0.3, 0.7], coulomb=LEVEL, static=1.2 * LEVEL, stribeck_velocity=0.6,
    attraction=0.5,
)  # fmt: skip
AXIS = Plant.axis(J) + GMS + effects.Viscous(coefficient=4e-5)
UNKNOWN = Plant.axis() + effects.GMS(elements=2) + effects.Viscous()
SLIDING = {"gms.coulomb", "gms.static", "gms.stribeck_velocity"}


def sweep(plant: Plant, sizes: list[float]) -> list[FRF]:
    grid = np.geomspace(9, 350, 12)
    return [stepped_sine(plant, grid, u * LEVEL, held="torque", torque_noise=2e-5) for u in sizes]


def test_what_pre_sliding_responses_cannot_tell_is_said_with_the_experiment_that_would(tmp_path: Path) -> None:
    small = fit(UNKNOWN, sweep(AXIS, [0.05, 0.1, 0.2]))
    assert "gms.stribeck_velocity" in small.undetermined and "sliding" in small.undetermined["gms.attraction"]
    small.plant.save(tmp_path / "model.toml")
    again = Plant.load(tmp_path / "model.toml")
    assert any(line.startswith("gms.attraction; what would tell it") for line in again.provenance["undetermined"])
    assert again.uncertainty["gms.attraction"] == (0, np.inf) and again.uncertainty == small.plant.uncertainty
    large = fit(UNKNOWN, sweep(AXIS, [0.15, 0.5, 1.0, 2.0, 4.0]))
    assert not SLIDING & set(large.undetermined)


def test_records_too_say_what_they_cannot_tell() -> None:
    rng = np.random.default_rng(1)

    def records(size: float) -> list[Record]:
        return [run(AXIS, multisine(4000, 5e-4, 1, 60, size * LEVEL, rng), i) for i in range(2)]

    known = Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous()
    small, large = fit(known, records(0.15)).undetermined, fit(known, records(3.0)).undetermined
    assert {"gms.stribeck_velocity", "gms.attraction"} <= set(small)
    assert not SLIDING & set(large)


def test_records_that_never_slide_say_so_and_those_that_do_say_nothing() -> None:
    rng = np.random.default_rng(1)
    law = effects.LuGre(stiffness=1.0, damping=1e-4, coulomb=LEVEL, static=LEVEL, stribeck_velocity=1.0)
    bristle = Plant.axis(J) + law + AXIS["viscous"]
    for plant, bends in ((AXIS, 1.2 * LEVEL / 1.2), (bristle, LEVEL)):
        small, large = (run(plant, multisine(2000, 5e-4, 1, 60, s * LEVEL, rng)) for s in (0.15, 3.0))
        assert f"bends by {bends:.2g} rad before it gives way" in hardly_slides(plant, observe([small], J))
        assert hardly_slides(plant, observe([small, large], J)) == ""
    assert hardly_slides(Plant.axis(J) + AXIS["viscous"], observe([small], J)) == ""


def test_the_level_of_elements_that_never_slipped_is_open_above() -> None:
    found = fit(Plant.axis(J) + effects.GMS(elements=4) + effects.Viscous(), sweep(AXIS, [0.05, 0.1, 0.2]))
    known = found.plant.uncertainty
    assert {"gms.coulomb", "gms.static"} <= set(found.undetermined) and "at least" in str(found.plant)
    assert known["gms.static"][0] <= 1.2 * LEVEL < known["gms.static"][1] == np.inf
    assert known["gms.coulomb"][0] <= LEVEL


def test_what_an_element_carried_without_slipping_is_the_least_of_its_level() -> None:
    """The first slips, the second breaks away at 18.9 mrad: a local expansion knows nothing of that."""
    narrow = {name: (0.99 * value, 1.01 * value) for name, (value, _) in AXIS.numbers().items()}
    plant = replace(AXIS, uncertainty=narrow)
    small, large = (observe(sweep(AXIS, s), J) for s in ([0.05, 0.1], [0.2, 3.0]))
    assert left_open(plant, large) == {} and left_open(Plant.axis(J), small) == {}
    open_ = left_open(plant, small)
    reach = max(float(f.amplitude.max()) for f in sweep(AXIS, [0.05, 0.1]))  # type: ignore[union-attr]
    assert 1.7e-3 < reach < 10e-3 and set(open_) == {"gms.coulomb", "gms.static", "gms.fraction[0]", "gms.fraction[1]"}
    first, second = 0.3 * GMS.static, 0.9 * reach * GMS.stiffness[1]
    assert open_["gms.static"] == (pytest.approx(first + second, rel=0.01), np.inf)
    assert open_["gms.fraction[0]"] == (0, pytest.approx(first / (first + second), rel=0.01))
    assert open_["gms.fraction[1]"] == (pytest.approx(second / (first + second), rel=0.01), 1)


def test_an_element_that_never_slipped_is_told_from_no_spring() -> None:
    small, large = (observe(sweep(AXIS, s), J) for s in ([0.1, 0.2], [0.2, 3.0]))
    said = never_slips(AXIS, small)
    assert "cannot tell it from a spring" in said and "several times that amplitude" in said
    assert never_slips(AXIS, large) == ""
    assert "the spring" in never_slips(AXIS + effects.Spring(stiffness=0.1), small)
    assert undetermined(AXIS) == {}  # nothing was fitted


def test_what_one_experiment_would_tell_stands_in_one_line() -> None:
    found = {"gms.fraction[0]": "a", "gms.fraction[3]": "a", "gms.coulomb": "b", "inertia": "b", "viscous[1]": "a"}
    assert by_experiment(found) == [("gms.fraction[0, 3], viscous[1]", "a"), ("gms.coulomb, inertia", "b")]
