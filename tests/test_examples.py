"""The figures that the examples print."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples"))

import arm_friction
import compensated_axis
import free_response
import transfer


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
