"""Parameter files of Rhoban's BAM as plants: its laws written down a second time here, from the paper."""

import json
from pathlib import Path

import numpy as np
import pytest

from gms_mujoco.errors import ModelError
from gms_mujoco.plant import Plant

# Numbers that Rhoban/bam publishes: params/feetech_sts3215_7_4V/m1, mx64/m2, erob80_100/m3 (rounded).
M1 = {"kt": 1.1776, "R": 2.4787, "armature": 0.02608, "q_offset": -0.0506, "max_velocity": 5.288,
      "command_delay": 0.001047, "friction_base": 0.05152, "friction_viscous": 0.05989, "model": "m1",
      "actuator": "sts3215"}  # fmt: skip
M2 = {"kt": 1.6204, "R": 3.8944, "armature": 0.011924, "friction_base": 0.05612, "friction_stribeck": 0.08186,
      "dtheta_stribeck": 1.12025, "alpha": 3.0, "friction_viscous": 0.01918, "model": "m2",
      "actuator": "mx64"}  # fmt: skip
M3 = {"kt": 9.469, "armature": 0.9888, "friction_base": 4.832, "load_friction_base": 0.148, "friction_viscous": 7.395,
      "model": "m3", "actuator": "erob80_100"}  # fmt: skip
M4 = {**M2, "model": "m4", "load_friction_base": 0.1, "load_friction_stribeck": 0.1 * 0.08186 / 0.05612, "alpha": 9.9}
M4_ALL_STRIBECK = {**M4, "friction_base": 0.0, "load_friction_base": 0.0}
M5 = {**M2, "model": "m5", "load_friction_motor": 0.2, "load_friction_external": 0.02,
      "load_friction_motor_stribeck": 0.2, "load_friction_external_stribeck": 0.09}  # fmt: skip
M6 = {**M5, "model": "m6", "load_friction_motor_quad": 0.01, "load_friction_external_quad": 0.0}


def read(tmp_path: Path, table: object) -> Plant:
    (tmp_path / "m.json").write_text(json.dumps(table))
    return Plant.from_bam(tmp_path / "m.json")


def budget(p: dict, velocity: float, motor: float, external: float) -> float:
    """Largest friction torque of M1 to M4 with its viscous part [N m]."""
    s = np.exp(-(abs(velocity / p.get("dtheta_stribeck", 1.0)) ** p.get("alpha", 1.0)))
    load = abs(external - motor)
    dry = p["friction_base"] + s * p.get("friction_stribeck", 0.0)
    dry += p.get("load_friction_base", 0.0) * load + s * p.get("load_friction_stribeck", 0.0) * load
    return dry + p["friction_viscous"] * abs(velocity)


@pytest.mark.parametrize("table", [M1, M2, M3, M4, M4_ALL_STRIBECK], ids=lambda t: t["model"])
@pytest.mark.parametrize("load", [0.0, 0.7, -3.0])
def test_friction_is_that_of_the_law_at_every_speed_and_load_in_balance(table: dict, load: float, tmp_path) -> None:
    plant = read(tmp_path, table)
    assert plant.inertia == table["armature"]
    for velocity in (0.01, -0.3, 0.9, -2.0, 6.0):
        time = 1e-3 * np.arange(4)
        n = np.ones(4)
        torque = plant.joint().replay(time, velocity * time, velocity * n, load=load * n).torque[-1]
        expected = budget(table, velocity, motor=load, external=-load)
        assert torque == pytest.approx(-np.sign(velocity) * expected, rel=1e-6)


def test_motor_and_delay_are_kept(tmp_path) -> None:
    plant = read(tmp_path, M1)
    assert plant["delay"].time == M1["command_delay"]
    assert plant.provenance["bam_kt"] == M1["kt"] and plant.provenance["bam_R"] == M1["R"]
    assert "m1, actuator sts3215" in plant.provenance["source"] and "left_out" not in plant.provenance
    plant.save(tmp_path / "model.toml")
    again = Plant.load(tmp_path / "model.toml")
    assert again == plant and again.provenance == plant.provenance


@pytest.mark.parametrize(
    ("table", "terms"),
    [
        (M5, "load_friction_motor 0.2, load_friction_external 0.02"),
        (M6, "load_friction_motor_quad 0.01"),
        ({**M4, "load_friction_stribeck": 0.3}, "load_friction_base 0.1, load_friction_stribeck 0.3"),
        ({**M3, "friction_base": 0.0}, "load_friction_base 0.148"),
    ],
)
def test_terms_that_no_effect_expresses_are_left_out_and_named(table: dict, terms: str, tmp_path) -> None:
    with pytest.warns(UserWarning, match="load terms of m[3456] that no effect expresses are left out") as told:
        plant = read(tmp_path, table)
    assert terms in str(told[0].message) and terms in plant.provenance["left_out"][0]
    assert "load_dependent_friction" not in plant
    for velocity in (0.05, 1.0):  # without load it is the law still
        torque = plant.joint().replay(np.arange(3.0), velocity * np.arange(3), np.full(3, velocity)).torque[-1]
        assert torque == pytest.approx(-budget(table, velocity, 0.0, 0.0), rel=1e-6)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({**M1, "model": "m7"}, "model must be one of m1, m2, m3, m4, m5, m6, as BAM writes it; 'm7' given"),
        ([1, 2], "model must be one of .*; 'list' given"),
        ({k: v for k, v in M1.items() if k != "friction_base"}, "friction_base must be a number of at least 0; None"),
        ({**M2, "alpha": "two"}, "alpha must be a number of at least 0; 'two' given"),
        ({**M2, "alpha": 40.0}, "stribeck.stribeck_exponent must lie in"),
        ({**M1, "armature": -1.0}, "armature must be a number"),
        ({**M1, "command_delay": float("nan")}, "command_delay must be a number"),
    ],
)
def test_what_is_no_parameter_file_is_refused_in_one_line(table: object, message: str, tmp_path) -> None:
    with pytest.raises(ModelError, match=f"m.json: {message}") as error:
        read(tmp_path, table)
    assert "\n" not in str(error.value)


def test_damaged_files_are_refused(tmp_path) -> None:
    for name, content in (("none", None), ("cut", '{"model": "m1"'), ("deep", "[" * 100_000)):
        path = tmp_path / f"{name}.json"
        if content is not None:
            path.write_text(content)
        with pytest.raises(ModelError, match=f"{name}.json: (no such file|not a readable JSON file)"):
            Plant.from_bam(path)
