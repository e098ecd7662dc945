"""What a servo that closes its own position loop lacks, in runs that MuJoCo made, and through the commands."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import servos

from gms_mujoco import cli
from gms_mujoco.dataset import load, save
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.identification.candidates import applicable
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant


def test_a_hidden_delay_is_named_and_parameters_come_back(servo_diagnosis: Diagnosis) -> None:
    d = servo_diagnosis
    assert d.verdict == "explained" and [e.name for e in d] == ["delay"]
    before, after = (s.validate_error for s in d.steps)
    assert after is not None and before is not None and after < 0.2 * before
    loop = d.plant["position_loop"]
    assert d.plant["delay"].time == pytest.approx(servos.DELAY, rel=0.05)
    assert loop.stall_torque == pytest.approx(servos.STALL, rel=0.05)
    assert loop.duty_per_rad == pytest.approx(servos.DUTY, rel=0.05)
    assert loop.goal_speed == pytest.approx(servos.SPEED, rel=0.05)
    # While the bridge is on the two drags are one.
    assert loop.electrical_drag == pytest.approx(servos.DRAG + servos.DAMPING, rel=0.05)
    assert "the power goes off" in d.steps[-1].result.undetermined["viscous.coefficient"]
    low, high = d.plant.uncertainty["delay.time"]
    assert low < servos.DELAY < high < 1.1 * servos.DELAY
    assert set(d.plant.covariance) == set(d.plant.uncertainty)


def test_what_is_found_is_told_in_radians(servo_diagnosis: Diagnosis) -> None:
    table = servo_diagnosis.to_dict()
    assert (table["error_of"], table["error_unit"]) == ("position", "rad")
    assert table["noise_floor"] == pytest.approx(1e-3 * np.sqrt(2 / np.pi), rel=0.1)
    assert table["steps"][1]["parameters"]["delay.time"]["ci95"]
    assert "[mrad]" in str(servo_diagnosis) and "position error falls" in servo_diagnosis.steps[1].evidence


def test_a_servo_that_has_all_it_needs_is_adequate(tmp_path: Path) -> None:
    save(tmp_path, servos.bench(delay=0.0))
    found = diagnose(load(tmp_path), servos.POOR)
    assert found.verdict == "adequate" and not found.found


def test_what_is_known_not_to_be_there_is_not_looked_at(servo_set: Path) -> None:
    names = tuple(e.name for e in applicable(servos.POOR, observe(load(servo_set).fit)))
    assert {"delay", "least_duty", "load_dependent_friction", "spring"} <= set(names) and "gms" not in names
    found = diagnose(load(servo_set), servos.POOR, without=names)
    assert not found.found and not found.candidates and found.verdict == "unexplained"
    with pytest.raises(ModelError, match="no effect is called 'springs'"):
        diagnose(load(servo_set), servos.POOR, without=["springs"])


def test_a_torque_of_ones_own_is_no_candidate_for_a_servo(servo_set: Path) -> None:
    with pytest.raises(DataError, match="a servo's log has no torque"):
        diagnose(load(servo_set), servos.POOR, candidates=[lambda t, q, v: q])


def test_the_commands_serve_a_servo_as_any_axis(
    servo_set: Path, servo_diagnosis: Diagnosis, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    model, scores = tmp_path / "model.toml", tmp_path / "scores.json"
    assert cli.main(["fit", str(servo_set), "-o", str(model), "--effects", "coulomb,delay"]) == 0
    said = capsys.readouterr().out
    assert "mean absolute position error" in said and "rad" in said.split("validate error")[1].splitlines()[0]
    plant = Plant.load(model)
    assert [e.name for e in plant.effects] == ["position_loop", "coulomb", "delay"] and plant.covariance
    page = tmp_path / "page.html"
    command = ["compare", str(model), str(servo_set), "--json", str(scores), "--report", str(page)]
    assert cli.main(command) == 0
    assert "validate: position error" in capsys.readouterr().out
    assert json.loads(scores.read_text())["by_use"]["validate"]["position_error"] < 0.003
    assert "Run by run" in page.read_text()
    monkeypatch.setattr(sys.modules["gms_mujoco.diagnose"], "diagnose", lambda *_, **__: servo_diagnosis)
    assert cli.main(["diagnose", str(servo_set), "-o", str(tmp_path / "out")]) == 0
    assert "[mrad]" in capsys.readouterr().out
    written = {p.name for p in (tmp_path / "out").iterdir()}
    assert written == {"diagnosis.json", "baseline.toml", "model.toml", "report.html", "recording.rrd"}
    assert cli.main(["compare", str(tmp_path / "out" / "model.toml"), str(servo_set)]) == 0
    assert cli.main(["frf", str(servo_set)]) == 2


def test_what_is_found_attaches_to_mujoco_as_a_motor_whose_control_is_the_goal(servo_diagnosis: Diagnosis) -> None:
    r = servos.run(np.repeat([0.0, 0.8, -0.3], 60), gain=24.0, start=0.0)
    moved = servos.in_mujoco(servo_diagnosis.plant, r)
    spec = servos.pendulum(servos.INERTIA)
    servo_diagnosis.plant.attach(spec, joint="j")
    assert [a.name for a in spec.actuators] == ["j"] and spec.actuators[0].delay > 0
    truth = servos.in_mujoco(servos.TRUE, r)
    assert np.mean(np.abs(moved - truth)) < 0.01 < np.ptp(truth)
