"""The figures that the examples print."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import arm_friction
import compensate
import compensated_axis
import free_response
import frf_to_parameters
import missing_effect
import numpy as np
import pytest
import train_policy
import transfer
import watch_arm

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


@pytest.mark.parametrize("name", ["emps", "odrive_cogging", "sts3215", "ur10e"])
def test_an_example_without_its_logs_says_which_it_reads(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path)])
    assert import_module(name).main(*sys.argv[1:] if name == "emps" else ()) == 2
    (said,) = capsys.readouterr().out.splitlines()
    assert re.fullmatch(rf"no \S+ in {tmp_path}: give the folder, or set GMS_MUJOCO_DATA", said)


@pytest.mark.parametrize(("run", "turned", "speed"), [("pulse", 1.17, 15.4), ("hand_spin", 0.55, 7.6)])
def test_free_response_reproduces_the_case_study(run, turned, speed):
    r = getattr(free_response, run)()
    assert r.turned == pytest.approx(turned, rel=0.02)
    assert r.peak_speed == pytest.approx(speed, rel=0.02)
    assert np.ptp(r.drag) < 0.05 * r.drag.mean(), "near-constant drag while turning"
    f = r.frequencies
    assert f.min() > 10 and f.max() < 100, "tens of Hz"
    assert (np.diff(f) > -0.05).all() and f[-1] > 1.5 * f[0], "the period shrinks as the shaft stops"


def test_friction_holds_the_joints_of_an_arm(capsys):
    arm_friction.main()
    moved = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    for joint in ("elbow", "wrist_flex"):
        free, held = float(moved[joint][1]), float(moved[joint][5])
        assert abs(free) > 20 and abs(held) < 0.5


def test_friction_is_carried_into_another_model(capsys):
    transfer.main()
    said = re.search(r"within ([\d.]+) %", capsys.readouterr().out)
    assert said and float(said[1]) < 2.0


def test_compensated_the_axis_is_a_bare_inertia_without_dahl_resonance():
    from gms_mujoco.control import GMSObserver

    axis = compensated_axis
    plain, compensated = (
        axis.axis_frf(make, 0.15) for make in (axis.Nothing, lambda: GMSObserver(axis.PLANT, axis.H))
    )
    height, at = axis.resonance(plain)
    assert height > 3 and 20 < at < 45 and axis.off_the_mass_line(plain) > 6
    assert axis.resonance(compensated)[0] == 0 and axis.off_the_mass_line(compensated) < 1


def test_a_model_of_the_friction_brings_the_tracking_near_the_oracle(capsys):
    compensate.main(3)
    rows = re.findall(r"^(\S.*?)  +(.*)$", capsys.readouterr().out, re.M)
    error = {name: [float(cell.split()[0]) for cell in re.findall(r"[\d.]+ \+- ", row)] for name, row in rows}
    exact = slice(0, None, 2)  # columns in which the model has the friction of the axis
    ratio = {n: np.array(error[n][exact]) / error["oracle"][exact] for n in ("PID + feedforward", "PID + GMS observer")}
    assert (ratio["PID + feedforward"] > 8).all() and (ratio["PID + GMS observer"] < 1.5).all()


def test_a_falling_arm_is_recorded(tmp_path, capsys):
    watch_arm.main(str(tmp_path / "arm.rrd"))
    assert (tmp_path / "arm.rrd").stat().st_size > 1e5
    assert float(re.search(r"sank by ([\d.]+) deg", capsys.readouterr().out)[1]) > 10


def test_parameters_come_out_of_frequency_responses(capsys):
    frf_to_parameters.main()
    off = [float(x) for x in re.findall(r"off by ([\d.]+) %", capsys.readouterr().out)]
    assert len(off) == 3 and max(off) < 6


def test_the_missing_effect_is_found_in_a_log(capsys):
    missing_effect.main()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "explained: cogging"
    baseline, added, floor = (float(line.split()[-2]) for line in lines[1:])
    assert baseline > 20 * added and added < 1.3 * floor


def test_a_universal_file_is_imported_with_its_units(capsys):
    pytest.importorskip("pyuff", reason="needs the extra uff")
    import import_uff

    import_uff.main()
    *levels, reading = capsys.readouterr().out.splitlines()
    assert len(levels) == 4 and all("torque to position [rad/(N m)]" in line for line in levels)
    assert [float(re.search(r"torque of ([\d.]+) mN m", line)[1]) for line in levels] == [0.8, 1.6, 2.8, 4.2]
    assert float(re.search(r"inertia (\S+) kg", reading)[1]) == pytest.approx(2.4e-5, rel=0.03)


def test_a_trained_policy_helps_the_pid(capsys):
    train_policy.main(3)
    times = [float(x) for x in re.findall(r"error ([\d.]+) times below the PID", capsys.readouterr().out)]
    assert len(times) == 2 and times[0] > 1.3


@pytest.mark.parametrize("name", ["compensate", "train_policy"])
def test_an_example_with_arguments_explains_them(name, tmp_path):
    script = str(EXAMPLES / f"{name}.py")
    for argument, code, words in (("--help", 0, "default: "), ("x", 2, "invalid int value: 'x'")):
        ended = subprocess.run([sys.executable, script, argument], capture_output=True, text=True, cwd=tmp_path)
        assert ended.returncode == code and words in ended.stdout + ended.stderr and "Traceback" not in ended.stderr


def test_the_free_response_runs_wherever_it_is_copied(tmp_path):
    copy = tmp_path / "free_response.py"
    copy.write_bytes((EXAMPLES / "free_response.py").read_bytes())
    subprocess.run([sys.executable, "-c", "import free_response; free_response.pulse()"], cwd=tmp_path, check=True)


def test_every_example_stands_in_the_table_of_the_documentation():
    page = (EXAMPLES.parent / "docs" / "pages" / "examples.md").read_text(encoding="utf-8")
    for script in EXAMPLES.glob("*.py"):
        assert f"`{script.name}`" in page, script.name
