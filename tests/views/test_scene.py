"""A model in motion, read back from what rerun gets: bodies where MuJoCo has them, friction as the plug-in says."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import rerun as rr
from recordings import last_values, series

import gms_mujoco as gms
from gms_mujoco.views.scene import Scene, joints_with_friction

STEPS = 100


@pytest.fixture(scope="module")
def arm() -> mujoco.MjModel:
    plants = {"elbow": gms.Plant.load("arm_joint"), "shoulder_lift": gms.Plant.load("arm_joint")}
    return gms.attach(str(gms.MODELS / "arm.xml"), plants).compile()


def _fall(model: mujoco.MjModel, to: Path | rr.RecordingStream, rate: float = 1e4) -> list[tuple[float, ...]]:
    """A leaning arm is let go; returns time, friction torque and place of the hand at each step."""
    data = mujoco.MjData(model)
    data.joint("elbow").qpos = 1.0
    mujoco.mj_forward(model, data)
    rows = []
    with gms.view.stream(model, data, to, rate) as look:
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            look(gap=2 * data.time)
            now = gms.friction(model, data, "elbow")
            rows.append((data.time, now.torque, *now.forces, *now.slips, *data.body("hand").xpos))
    look.close()
    return rows


def test_a_recording_has_the_numbers_of_the_simulation(arm: mujoco.MjModel, tmp_path: Path) -> None:
    truth = np.array(_fall(arm, tmp_path / "arm.rrd"))
    seen = series(tmp_path / "arm.rrd")
    time, torque = seen["/friction/elbow/torque"]
    np.testing.assert_allclose(time, truth[:, 0], atol=1e-9)
    np.testing.assert_allclose(torque, truth[:, 1])
    n = len(gms.Plant.load("arm_joint")["gms"].stiffness)
    for k in range(n):
        np.testing.assert_allclose(seen[f"/friction/elbow/elements/{k + 1}"][1], -truth[:, 2 + k])
        changes, states = seen[f"/friction/elbow/slips/{k + 1}"]
        said = states[np.searchsorted(changes, truth[:, 0] + 1e-9) - 1] != "sticks"
        np.testing.assert_array_equal(said, truth[:, 2 + n + k] != 0)
    _, place = seen["/robot/bodies/hand"]
    np.testing.assert_allclose(place[-STEPS:], truth[:, -3:], atol=1e-6)
    np.testing.assert_allclose(seen["/values/gap"][1], 2 * truth[:, 0])
    loop = last_values(tmp_path / "arm.rrd")["/loop/elbow/data/friction"]
    np.testing.assert_allclose(np.ravel(loop["y"]), -truth[:, 1])
    assert set(joints_with_friction(arm, mujoco.MjData(arm))) == {"elbow", "shoulder_lift"}
    assert not any("wrist" in k for k in seen if k.startswith("/friction"))


def test_looks_are_no_more_often_than_asked_for(arm: mujoco.MjModel, tmp_path: Path) -> None:
    _fall(arm, tmp_path / "arm.rrd", rate=50.0)
    time, _ = series(tmp_path / "arm.rrd")["/friction/elbow/torque"]
    np.testing.assert_allclose(np.diff(time), 0.02)


def test_a_stream_of_ones_own_gets_all(arm: mujoco.MjModel) -> None:
    with rr.RecordingStream("test") as stream:
        memory = stream.memory_recording()
        _fall(arm, stream)
        assert len(memory.drain_as_bytes()) > 10_000


def test_a_model_without_friction_is_shown_too(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(gms.MODELS / "servo_axis.xml"))
    with pytest.warns(UserWarning, match="nothing moves"):  # it stands in the plane
        gms.view.record_motion(tmp_path / "axis.rrd", model, 0.02)
    assert not [k for k in series(tmp_path / "axis.rrd") if k.startswith("/friction")]


def test_time_goes_on_after_a_reset(arm: mujoco.MjModel, tmp_path: Path) -> None:
    data = mujoco.MjData(arm)
    look = gms.view.stream(arm, data, tmp_path / "arm.rrd")
    for _ in range(2):
        mujoco.mj_resetData(arm, data)
        for _ in range(20):
            mujoco.mj_step(arm, data)
            look()
    look.close()
    time, _ = series(tmp_path / "arm.rrd")["/friction/elbow/torque"]
    assert np.all(np.diff(time) > 0) and time[-1] == pytest.approx(0.032 + 0.01 + 0.032)


def test_a_rate_must_be_positive(arm: mujoco.MjModel) -> None:
    with pytest.raises(gms.ModelError, match="rate must be positive"), rr.RecordingStream("test") as stream:
        Scene(arm, mujoco.MjData(arm), stream, rate=0)


@pytest.mark.parametrize("rate", [0, float("nan"), "fast"])
def test_a_rate_that_cannot_be_opens_no_file(rate: float, arm: mujoco.MjModel, tmp_path: Path) -> None:
    with pytest.raises(gms.ModelError, match="rate must be positive"):
        gms.view.stream(arm, mujoco.MjData(arm), tmp_path / "arm.rrd", rate)
    assert not (tmp_path / "arm.rrd").exists()
