"""Friction on MuJoCo Warp is the native friction, in each of many worlds."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

pytest.importorskip("mujoco_warp", reason="pip install 'gms-mujoco[warp]'")

import mujoco_warp as mjw
import warp as wp
from axes import AXIS, BEARING, DRY, FC, FS, WELD, axis, stick_slip
from worlds import EVERY, catalogue, expected, motion

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco import warp as gms_warp
from gms_mujoco.errors import ModelError

N = 3  # worlds
wp.config.log_level = wp.LOG_WARNING


@pytest.fixture(scope="module")
def bearing():
    return axis()[0]


def put(model):
    m, friction = gms_warp.put_model(model, nworld=N)
    return m, mjw.make_data(model, nworld=N), friction


def drive(m, d, torque):
    """(n, N) positions before each step under torques (n,) or (n, N)."""
    rows = []
    for u in torque:
        d.ctrl.assign(np.full((N, 1), np.reshape(u, (-1, 1)), np.float32))
        rows.append(d.qpos.numpy()[:, 0].copy())
        mjw.step(m, d)
    return np.array(rows)


def test_every_effect_is_the_native_replay_along_a_motion():
    model = catalogue()
    m, d, friction = put(model)
    found = [np.zeros(len(friction.joints))]
    for t, q, v, load in zip(*(x.tolist() for x in motion()), strict=True):
        d.time.fill_(t)
        d.qpos.fill_(q)
        d.qvel.fill_(v)
        d.qfrc_actuator.assign(np.tile(load - found[-1], (N, 1)).astype(np.float32))  # friction takes of it
        for _ in range(2):  # repeated evaluation changes nothing
            d.qfrc_passive.zero_()
            friction(m, d)
        found.append(friction.torque.numpy()[-1].copy())
        np.testing.assert_array_equal(d.qfrc_passive.numpy()[-1], np.float32(found[-1]))
    for joint, torque in zip(friction.joints, np.array(found[1:]).T, strict=True):
        truth = expected(joint, *motion())
        np.testing.assert_allclose(torque, truth, atol=1e-6 * np.abs(truth).max(), err_msg=joint)
    assert set(friction.joints) == set(EVERY)


@pytest.mark.parametrize("plant", [BEARING, BEARING + effects.LoadDependentFriction(coefficient=50.0)])
def test_a_servo_axis_moves_as_under_the_plugin(plant):
    rotor = AXIS.replace('name="shaft"', 'name="shaft" armature="1e-5"')  # what rotor and damping take is no load
    model = gms.attach(rotor, {"shaft": plant}).compile()
    model.dof_damping[:] = 1e-5
    data = mujoco.MjData(model)
    m, d, _ = put(model)
    torque = stick_slip(600)
    found = drive(m, d, torque)
    truth = []
    for u in torque:
        truth.append(data.qpos[0])
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    assert np.ptp(truth) > 0.05
    np.testing.assert_allclose(found, np.tile(truth, (N, 1)).T, atol=1e-6)


def test_an_arm_moves_as_under_the_plugin():
    model = gms.attach(gms.MODELS / "arm.xml", {"*": gms.Plant.load("arm_joint")}).compile()
    m, d, friction = put(model)
    data = mujoco.MjData(model)
    amplitude, rate = np.array([30, 60, 20, 30, 8, 8, 6.0]), np.array([0.7, 0.5, 1.1, 0.9, 1.3, 1.7, 2.1])
    for k in range(250):  # half a second
        data.ctrl[:] = amplitude * np.sin(2 * np.pi * rate * k * 0.002)
        d.ctrl.assign(np.tile(data.ctrl, (N, 1)).astype(np.float32))
        mjw.step(m, d)
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos).min() > 0.002 and np.abs(data.qpos).max() > 1
    np.testing.assert_allclose(d.qpos.numpy(), np.tile(data.qpos, (N, 1)), atol=2e-6)
    last = [gms.friction(model, data, joint).torque for joint in friction.joints]
    np.testing.assert_allclose(friction.torque.numpy()[0], last, atol=1e-3)  # of 47 N m, by velocities of 4e-6 rad/s


def test_repeated_forward_changes_nothing(bearing):
    m, d, friction = put(bearing)
    drive(m, d, stick_slip(100))
    mjw.forward(m, d)
    seen = [x.numpy().copy() for x in (friction.state, friction.torque, d.qfrc_passive, d.qacc)]
    for _ in range(3):
        mjw.forward(m, d)
    for x, was in zip((friction.state, friction.torque, d.qfrc_passive, d.qacc), seen, strict=True):
        np.testing.assert_array_equal(x.numpy(), was)


def test_a_world_that_is_reset_begins_anew_and_the_others_go_on(bearing):
    m, d, friction = put(bearing)
    torque = stick_slip(300)
    whole = drive(m, d, torque)
    m, d, friction = put(bearing)
    first = drive(m, d, torque[:150])
    mask = np.array([False, True, False])
    mjw.reset_data(m, d, wp.array(mask, dtype=bool))  # friction.reset is not needed: its time goes back
    later = torque[150:, None] * ~mask + torque[:150, None] * mask
    second = drive(m, d, later)
    np.testing.assert_array_equal(np.concatenate([first[:, 0], second[:, 0]]), whole[:, 0])
    np.testing.assert_array_equal(second[:, 1], whole[:150, 1])
    for worlds in ([2], np.array([False, False, True])):
        before = friction.state.numpy().copy()
        friction.reset(worlds)
        after = friction.state.numpy()
        np.testing.assert_array_equal(after[:2], before[:2])
        assert np.isnan(after[2]).any() and (np.nan_to_num(after[2]) == 0).all()


def test_worlds_have_parameters_of_their_own(bearing):
    factors = np.array([0.5, 1.0, 2.0])
    m, d, friction = put(bearing)
    assert friction.get("shaft", "gms.static").shape == (1, 1)
    friction.set("shaft", {"viscous.coefficient": 3e-5})
    assert friction.get("shaft", "gms.static").shape == (1, 1)
    stiffness = np.outer(factors, BEARING["gms"].stiffness)
    friction.set("shaft", {"gms.static": FS * factors, "gms.coulomb": FC * factors, "gms.stiffness": stiffness})
    np.testing.assert_allclose(friction.get("shaft", "gms.coulomb")[:, 0], FC * factors)
    found = drive(m, d, stick_slip(200))
    for world, factor in enumerate(factors):
        bent = BEARING["gms"].replace(coulomb=FC * factor, static=FS * factor, stiffness=stiffness[world])
        model, data = axis(BEARING.replace(bent).replace(BEARING["viscous"].replace(coefficient=3e-5)))
        truth = []
        for u in stick_slip(200):
            truth.append(data.qpos[0])
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(found[:, world], truth, atol=1e-6)


def test_a_fork_goes_on_as_the_run_it_came_from(bearing):
    m, d, friction = put(bearing)
    torque = stick_slip(200)
    drive(m, d, torque[:100])
    kept = {name: wp.clone(getattr(d, name)) for name in ("time", "qpos", "qvel", "qacc_warmstart")}
    state = wp.clone(friction.state)
    went = drive(m, d, torque[100:])
    for name, array in kept.items():
        wp.copy(getattr(d, name), array)
    wp.copy(friction.state, state)
    np.testing.assert_array_equal(drive(m, d, torque[100:]), went)


def test_a_run_of_mujoco_is_taken_over_with_its_friction(bearing):
    _, data = axis()
    torque = stick_slip(300)
    for u in torque[:150]:
        data.ctrl[:] = u
        mujoco.mj_step(bearing, data)
    m, friction = gms_warp.put_model(bearing, nworld=N)
    d = mjw.put_data(bearing, data, nworld=N)
    friction.put_state(bearing, data)
    found = drive(m, d, torque[150:])
    truth = []
    for u in torque[150:]:
        truth.append(data.qpos[0])
        data.ctrl[:] = u
        mujoco.mj_step(bearing, data)
    np.testing.assert_allclose(found, np.tile(truth, (N, 1)).T, atol=1e-6)
    other, fresh = axis(BEARING.without("gms"))
    with pytest.raises(ModelError, match="joint 'shaft' of the data has other friction"):
        friction.put_state(other, fresh)


def test_a_static_law_sticks_and_slips_as_under_the_plugin():
    """An axis at rest is held by whatever that takes, within single precision."""
    model, data = axis(DRY)
    m, d, friction = put(model)
    torque = stick_slip(400)
    truth, moves = [], []
    for u in torque:
        truth.append(data.qpos[0])
        moves.append(abs(data.qvel[0]) > 1e-9)
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(drive(m, d, torque)[:, 0], truth, atol=1e-6)
    assert np.ptp(truth) > 0.3 and 100 < np.sum(moves) < 300
    assert abs(friction.torque.numpy()).max() <= DRY["coulomb"].coulomb
    mjw.forward(m, d)
    state = friction.state.numpy().copy()
    mjw.forward(m, d)  # repeated evaluation changes nothing
    np.testing.assert_array_equal(friction.state.numpy(), state)


def test_a_load_that_hangs_on_a_weld_is_held():
    """By what the weld did in the last step: without, it slid by 20 cm."""
    plant = gms.Plant.axis(kind="slide") + effects.Coulomb(coulomb=30.0)
    model = gms.attach(WELD.format(h=2e-3, integrator="implicitfast"), {"j": plant}).compile()
    m, d, _ = put(model)
    for _ in range(500):
        mjw.step(m, d)
    assert np.abs(d.qpos.numpy()[:, 0]).max() < 1e-3


def test_worlds_have_static_friction_of_their_own():
    """The weakest slides where the strongest holds, each as under the plug-in; one that is reset begins anew."""
    factors = np.array([0.5, 1.0, 2.0])
    m, d, friction = put(axis(DRY)[0])
    law = DRY["coulomb"]
    friction.set("shaft", {"coulomb.coulomb": law.coulomb * factors})
    torque = stick_slip(200)
    found = drive(m, d, torque)
    assert np.ptp(found[:, 0]) > 2 * np.ptp(found[:, 2])
    for world, factor in enumerate(factors):
        model, data = axis(DRY.replace(law.replace(coulomb=law.coulomb * factor)))
        truth = []
        for u in torque:
            truth.append(data.qpos[0])
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(found[:, world], truth, atol=1e-6)
    mjw.reset_data(m, d, wp.array([False, True, False], dtype=bool))
    np.testing.assert_array_equal(drive(m, d, torque)[:, 1], found[:, 1])


def test_static_joints_of_an_arm_are_solved_for_together():
    """Each holds, with a torque inside its level, or slides at its level, and all move as under the plug-in."""
    level = np.array([20.0, 15, 10, 8, 3, 2, 1])
    names = [j.name for j in mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml")).joints]
    plants = {x: gms.Plant.axis() + effects.Coulomb(coulomb=float(f)) for x, f in zip(names, level, strict=True)}
    model = gms.attach(gms.MODELS / "arm.xml", plants).compile()
    model.dof_damping[:] = 0.5
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2]
    m, friction = gms_warp.put_model(model, nworld=1)
    d = mjw.make_data(model, nworld=1)
    d.qpos.assign(np.float32(data.qpos)[None])
    rng = np.random.default_rng(0)
    held = slid = 0
    for k in range(150):
        if k % 15 == 0:
            load = 1.6 * level * rng.uniform(-1, 1, 7)
        mujoco.mj_forward(model, data)
        data.ctrl[:] = data.qfrc_bias + load
        d.ctrl.assign(np.float32(data.ctrl)[None])
        mujoco.mj_step(model, data)
        mjw.step(m, d)
        f, v = friction.torque.numpy()[0], d.qvel.numpy()[0]
        holds = np.abs(v) < 1e-5
        assert (np.abs(f) <= level * (1 + 1e-9)).all()
        np.testing.assert_allclose(f[~holds], -level[~holds] * np.sign(v[~holds]), rtol=1e-3)
        held, slid = held + holds.sum(), slid + (~holds).sum()
    np.testing.assert_allclose(d.qpos.numpy()[0], data.qpos, atol=3e-6)
    assert held > 200 and slid > 200


def test_stiff_joints_of_an_arm_move_as_under_the_plugin_as_far_as_single_precision_tells():
    """Elements of joints that stick and slide give way after 2 to 40 urad; whether one does in a step may hang on the
    last digit of a position: the measure is what rounding its own state after each step does to the plug-in."""
    level, share = np.array([20.0, 15, 10, 8, 3, 2, 1]), np.array([0.2, 0.3, 0.3, 0.2])
    stiffness = share / [2e-6, 5e-6, 15e-6, 40e-6]
    names = [j.name for j in mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml")).joints]
    plants = {
        x: gms.Plant.axis() + effects.GMS(
            stiffness=f * stiffness, fraction=share, coulomb=f, static=1.2 * f, stribeck_velocity=0.1, attraction=20 * f
        )
        for x, f in zip(names, level, strict=True)
    }  # fmt: skip
    model = gms.attach(gms.MODELS / "arm.xml", plants).compile()
    model.dof_damping[:] = 0.5
    pose = np.float32([0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2])

    def plugin(torque, rng=None):
        data, out = mujoco.MjData(model), []
        data.qpos[:] = pose
        for u in torque:
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
            out.append(data.qpos.copy())
            for x in (data.qpos, data.qvel) if rng else ():
                x *= 1 + 2.0**-24 * rng.uniform(-1, 1, 7)
        return np.array(out)

    m, friction = gms_warp.put_model(model, nworld=1)
    assert len(friction.joints) == 7 and friction.solve
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        torque = np.float32(data.qfrc_bias + 1.6 * level * np.repeat(rng.uniform(-1, 1, (10, 7)), 15, axis=0))
        d, found = mjw.make_data(model, nworld=1), []
        d.qpos.assign(pose[None])
        for u in torque:
            d.ctrl.assign(u[None])
            mjw.step(m, d)
            found.append(d.qpos.numpy()[0].copy())
        truth = plugin(torque)
        spread = max(np.abs(plugin(torque, np.random.default_rng(k)) - truth).max() for k in range(8))
        assert np.ptp(truth, axis=0).min() > 4e-5 and spread < 5e-5
        assert np.abs(found - truth).max() < 2 * spread


def test_refuses_what_it_cannot_do(bearing):
    dry, _ = axis(DRY)
    dry.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    with pytest.raises(ModelError, match=r"joint 'shaft': its friction is too stiff .+ enable actuation"):
        gms_warp.put_model(dry)
    with pytest.raises(ModelError, match="Euler, implicit, implicitfast or discrete; RK4 given"):
        gms_warp.put_model(axis(integrator="RK4")[0])
    m, friction = gms_warp.put_model(bearing, nworld=1)
    with pytest.raises(ModelError, match="the data has 3 worlds, the friction was put for 1"):
        friction(m, mjw.make_data(bearing, nworld=N))
    with pytest.raises(ModelError, match=r"a mask of worlds has shape \(1,\); \(3,\) given"):
        friction.reset(np.zeros(3, bool))


def test_the_page_runs_as_printed(capsys):
    page = Path(__file__).resolve().parent.parent / "docs" / "pages" / "worlds.md"
    exec(compile(re.search(r"```python\n(.*?)```", page.read_text(), re.S)[1], page.name, "exec"), {})
    assert "(4, 7)" in capsys.readouterr().out
