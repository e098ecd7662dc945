"""The native control callback over the instances of the plug-in."""

import ctypes
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from axes import AXIS, BEARING, DRY, stick_slip
from mujoco.batch import Batch

from gms_mujoco import EngineError, engine, install_callback, remove_callback
from gms_mujoco.plant import Plant

MODELS = Path(__file__).resolve().parent.parent / "models"
BARE = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', "")
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
COMMAND = stick_slip(1500)

INTEGRATIONS = pytest.mark.parametrize("integration", ["explicit", "implicit"])
MODELS_OF_AN_AXIS = pytest.mark.parametrize("xml", [AXIS, BARE], ids=["actuator", "bare"])


@pytest.fixture(autouse=True)
def none_left():
    yield
    remove_callback()
    mujoco.set_mjcb_control(None)


def made(xml, integration="implicit", plant=BEARING):
    model = engine.attach(xml, {"shaft": plant}, integration).compile()
    return model, mujoco.MjData(model)


def driven(model, data, command=COMMAND):
    """Positions under a torque set before each step."""
    out = []
    for u in command:
        (data.ctrl if model.nu else data.qfrc_applied)[:] = u
        mujoco.mj_step(model, data)
        out.append((data.qpos[0], data.qvel[0]))
    return np.array(out)


def sway(m, d):
    """A control callback that drives joints without actuators."""
    d.qfrc_applied[0] = 3e-3 * np.sin(30 * d.time)


@INTEGRATIONS
@MODELS_OF_AN_AXIS
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_callback_changes_no_bit_where_no_callback_drives(xml, integration, integrator):
    option = f'<option integrator="{integrator}" '
    model, data = made(xml.replace("<option ", option), integration)
    alone = driven(model, data)
    install_callback()
    mujoco.mj_resetData(model, data)
    assert np.array_equal(driven(model, data), alone)
    remove_callback()
    mujoco.mj_resetData(model, data)
    assert np.array_equal(driven(model, data), alone)


def test_friction_answers_a_torque_that_a_callback_sets_in_the_same_step():
    """Static friction holds exactly; the plug-in alone is a step late."""
    model, data = made(BARE, plant=DRY)
    mujoco.set_mjcb_control(sway)
    mujoco.mj_step(model, data, 2000)
    assert 1e-6 < abs(data.qpos[0]) < 1e-3
    install_callback()
    mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, 2000)
    assert abs(data.qpos[0]) < 1e-15
    remove_callback()
    assert mujoco.get_mjcb_control() is sway


@pytest.mark.parametrize("control", [None, sway])
def test_repeated_forward_changes_nothing(control):
    for plant in (BEARING, DRY):
        model, data = made(BARE, plant=plant)
        mujoco.set_mjcb_control(control)
        install_callback()
        data.qfrc_applied[0] = 6e-3
        mujoco.mj_step(model, data, 300)
        mujoco.mj_forward(model, data)
        state, passive, qacc = data.plugin_state.copy(), data.qfrc_passive.copy(), data.qacc.copy()
        assert passive[0] == engine.friction(model, data, "shaft").torque != 0
        for _ in range(3):
            mujoco.mj_forward(model, data)
            mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 0)  # the callback alone again
            assert np.array_equal(data.plugin_state, state)
            assert np.array_equal(data.qfrc_passive, passive) and np.array_equal(data.qacc, qacc)
        mujoco.set_mjcb_control(None)


def test_torque_of_others_that_comes_in_between_is_kept():
    def passive(m, d):
        d.qfrc_passive[0] += 1e-3

    model, data = made(BARE, plant=DRY)
    install_callback()
    mujoco.set_mjcb_passive(passive)
    try:
        data.qfrc_applied[0] = 2e-3
        mujoco.mj_step(model, data, 500)
        assert abs(data.qpos[0]) < 1e-15
        assert data.qfrc_passive[0] == pytest.approx(1e-3 - 3e-3)
    finally:
        mujoco.set_mjcb_passive(None)


@MODELS_OF_AN_AXIS
def test_rollout_from_mid_run_and_batch_reproduce_a_trajectory(xml):
    model, data = made(xml)
    driven(model, data, COMMAND[:700])
    start = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, start, FULL)
    expected = driven(model, data, COMMAND[700:])

    install_callback()
    spare = [mujoco.MjData(model) for _ in range(2)]
    controls = np.tile(COMMAND[700:, None], (4, 1, 1))
    kind = mujoco.mjtState.mjSTATE_CTRL if model.nu else mujoco.mjtState.mjSTATE_QFRC_APPLIED
    states, _ = mujoco.rollout.rollout(model, spare, np.tile(start, (4, 1)), controls, control_spec=int(kind))
    assert np.array_equal(states[3, :, 1:3], expected)

    for nthread in (1, 2):
        batch = Batch(model, 3, nthread, True)
        history = []
        for u in COMMAND:
            (batch.ctrl if model.nu else batch.qfrc_applied)[:] = u
            batch.step()
            history.append((batch.qpos[2, 0], batch.qvel[2, 0]))
        assert np.array_equal(history[700:], expected)


@MODELS_OF_AN_AXIS
def test_plugin_alone_acts_where_mujoco_calls_no_callback(xml):
    """Disabled actuation leaves the callback out; so does whoever replaces it."""
    install_callback()
    model, data = made(xml, plant=DRY)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data.qfrc_applied[0] = 3.9e-3
    mujoco.mj_step(model, data, 500)
    assert abs(data.qpos[0]) < 1e-15
    model.opt.disableflags = 0
    mujoco.set_mjcb_control(None)
    mujoco.mj_step(model, data, 500)
    assert abs(data.qpos[0]) < 1e-15
    assert data.qfrc_passive[0] == pytest.approx(-3.9e-3)


def test_finite_differences_with_the_callback_leave_the_state():
    results = []
    for install in (False, True):
        if install:
            install_callback()
        model, data = made(BARE)
        driven(model, data, np.full(2000, 1e-3))
        before, A = data.plugin_state.copy(), np.empty((2, 2))
        mujoco.mjd_transitionFD(model, data, 1e-6, True, A, None, None, None)
        assert np.array_equal(data.plugin_state, before)
        results.append(A)
    assert np.allclose(*results, rtol=1e-12)


def test_several_joints_models_and_data_at_once():
    """Threads that step an arm, an axis and a model without friction get what each gets alone, callback or not."""
    arm = MODELS.joinpath("arm.xml").read_text()
    bare_arm = arm[: arm.index("<actuator>")] + "</mujoco>"
    plant = Plant.load(MODELS / "arm_joint.toml")

    def job(k):
        if k % 3 == 0:
            return driven(*made(BARE))[-1]
        spec = mujoco.MjSpec.from_string(bare_arm) if k % 3 == 1 else mujoco.MjSpec.from_string(arm)
        model = (engine.attach(spec, {"*": plant}, "implicit") if k % 3 == 1 else spec).compile()
        data = mujoco.MjData(model)
        data.qpos[1] = 0.5
        mujoco.mj_step(model, data, 300)
        return data.qpos.copy()

    alone = [job(k) for k in range(3)]
    install_callback()
    with ThreadPoolExecutor(4) as pool:
        for k, result in enumerate(pool.map(job, range(9))):
            assert np.array_equal(result, alone[k % 3])


def test_installing_and_removing_is_one_call_each():
    for _ in range(2):
        install_callback()
        install_callback()
        assert mujoco.get_mjcb_control() is not None
        remove_callback()
        remove_callback()
        assert mujoco.get_mjcb_control() is None


def test_callbacks_of_others_are_respected():
    batch = Batch(made(BARE)[0], 2, 1, True)
    mujoco.set_mjcb_control(sway)
    install_callback()
    install_callback()
    with pytest.raises(ValueError, match="Python function"):
        batch.step()
    mujoco.set_mjcb_control(sway)  # its owner takes it back
    remove_callback()
    assert mujoco.get_mjcb_control() is sway

    theirs = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda m, d: None)
    mujoco.set_mjcb_control(theirs)
    with pytest.raises(EngineError, match="another C function"):
        install_callback()
    remove_callback()
    assert mujoco.get_mjcb_control() is theirs


def test_error_in_a_callback_of_others_comes_through():
    def broken(m, d):
        raise KeyError("theirs")

    model, data = made(BARE)
    mujoco.set_mjcb_control(broken)
    install_callback()
    with pytest.raises(KeyError, match="theirs"):
        mujoco.mj_step(model, data)


def test_inverse_dynamics_without_actuators_has_the_friction_of_the_torque_that_is_applied():
    """mj_inverse calls passive forces alone, and without actuators a stiff joint answers what stands in qfrc_applied;
    with the callback it answers the acceleration asked for."""
    model, data = made(BARE, plant=DRY)
    for u in (3e-3, 1e-2, -6e-3):  # one that holds, two that break away
        data.qfrc_applied[0] = u
        mujoco.mj_step(model, data, 20)
        mujoco.mj_forward(model, data)
        found = data.qacc.copy(), data.qfrc_passive.copy()
        for acceleration in (0.0, 40.0, -40.0):
            data.qacc[0] = acceleration
            mujoco.mj_inverse(model, data)
            assert data.qfrc_passive[0] == found[1][0]
            assert data.qfrc_inverse[0] == pytest.approx(data.M[0] * acceleration - found[1][0], abs=1e-9)
        data.qacc[:] = found[0]
        mujoco.mj_inverse(model, data)
        assert data.qfrc_inverse[0] == pytest.approx(u, abs=1e-9)
    install_callback()
    data.qacc[0] = -2 * data.qvel[0] / model.opt.timestep  # turns back, and friction with it
    mujoco.mj_inverse(model, data)
    assert data.qfrc_passive[0] == pytest.approx(-found[1][0], rel=1e-9)
