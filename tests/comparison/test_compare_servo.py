"""compare, for a servo: its figures are those of the simulated position, in radians, under the contract's keys."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import servos

from gms_mujoco.compare import compare
from gms_mujoco.comparison.compare_servo import REGIMES
from gms_mujoco.dataset import load
from gms_mujoco.effects import Coulomb
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate


def test_the_error_is_the_mean_absolute_one_of_the_simulated_position(servo_set: Path) -> None:
    runs = load(servo_set)
    c = compare(servos.POOR, runs.all)
    left = [r.position - simulate(servos.POOR, r).position for r in runs.servos]
    assert [r.position_error for r in c.servos] == pytest.approx([np.mean(np.abs(e)) for e in left])
    assert c.position_error == c.error == pytest.approx(np.mean(np.abs(left)))
    assert c.servos[0].simulation_error == pytest.approx(np.std(left[0]) / np.std(runs.servos[0].position), rel=0.1)
    assert np.isnan(c.torque_error) and not c.records


def test_the_true_servo_is_at_the_floor_and_one_without_its_delay_is_not(servo_set: Path) -> None:
    poor, true = (compare(p, load(servo_set).all) for p in (servos.POOR, servos.TRUE))
    assert true.error < 1.4 * true.noise_floor < poor.error
    assert true.noise_floor == pytest.approx(poor.noise_floor) == pytest.approx(1e-3 * np.sqrt(2 / np.pi), rel=0.1)
    assert "mostly with velocity" in poor.where  # what comes late is behind in proportion to it


def test_what_is_told_has_its_unit(servo_set: Path) -> None:
    c = compare(servos.POOR, load(servo_set).all)
    table = c.to_dict()
    assert (table["error_of"], table["error_unit"]) == ("position", "rad")
    assert table["torque_error"] is None and table["position_error"] == c.position_error
    assert {"name", "use", "position_error", "simulation_error", "noise_floor"} <= set(table["records"][0])
    assert all(v["unit"] in ("rad", "1", "rad/sqrt(Hz)") for v in table["views"])
    assert "[mrad]" in str(c) and "run 5b.csv" in str(c) and "torque error" not in str(c)
    assert set(c.by_use()) == {"fit", "validate"} and set(c.by_use()["fit"]) == {
        "position_error", "simulation_error", "noise_floor"
    }  # fmt: skip


def test_a_run_rests_moves_or_is_without_power(servo_set: Path) -> None:
    r = load(servo_set).servos[2]
    off = replace(r, powered=np.where(r.time > 1.5, 0.0, 1.0))
    c = compare(servos.POOR, [off])
    where = c.servos[0].regime
    assert (where[r.time > 1.5] == REGIMES.index("without power")).all()
    assert {g.name for g in c.regimes} == set(REGIMES)
    assert sum(g.time_share for g in c.regimes) == pytest.approx(1)


def test_a_plant_and_data_that_do_not_belong_together_are_refused(servo_set: Path, small_set: Path) -> None:
    torque_driven = Plant.axis(2.4e-5) + Coulomb(coulomb=4e-3)
    runs, records = load(servo_set).fit, load(small_set).fit
    with pytest.raises(ModelError, match=r"needs a plant with position_loop"):
        compare(torque_driven, runs)
    with pytest.raises(ModelError, match="takes a goal, not a torque"):
        compare(servos.TRUE, records)
    with pytest.raises(DataError, match="cannot stand beside records of torque"):
        compare(servos.TRUE, [*runs, *records])
