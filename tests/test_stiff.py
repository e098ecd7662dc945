"""Implicit friction: joints far too stiff for an explicit step, against a small step; and what acts on them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from axes import AXIS, DRY

from gms_mujoco import batched, effects, engine
from gms_mujoco.plant import Plant

ARM = Path(__file__).resolve().parent.parent / "models" / "arm.xml"
POSE = [0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2]
FREQUENCY = np.array([1120, 960, 800, 640, 480, 320, 160])  # of the joints on the springs of their friction [Hz]
SHARE = np.array([0.1, 0.2, 0.3, 0.4])


def stiff_arm(h, integration="auto", level=(20, 20, 20, 20, 6, 6, 6), damping=0.0):
    """The seven-joint arm with bearings of 160 to 1120 Hz, damped by a part of critical; its data in POSE, its torques
    of gravity, its travel from full slip to full slip."""
    spec = mujoco.MjSpec.from_file(str(ARM))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    mujoco.mj_forward(model, data)
    inertia = np.zeros((7, 7))
    mujoco.mj_fullM(model, data, inertia)
    plants, travel = {}, []
    for i, top in enumerate(level):
        rate = 2 * np.pi * FREQUENCY[i]
        stiffness = np.array([8, 4, 2, 1]) / 15 * inertia[i, i] * rate**2
        law = effects.GMS(
            stiffness=stiffness, fraction=SHARE, coulomb=top / 1.2, static=top, stribeck_velocity=0.05,
            attraction=30.0 * top,
        )
        drag = effects.Viscous(coefficient=2 * damping * inertia[i, i] * rate)
        plants[model.joint(i).name] = Plant.axis() + law + drag
        travel.append(2 * (SHARE * top / 1.2 / stiffness).max())
    spec = engine.attach(ARM, plants, integration)
    spec.option.timestep = h
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    mujoco.mj_forward(model, data)
    return model, data, data.qfrc_bias.copy(), np.array(travel), np.array(level, float)


@pytest.mark.parametrize(("load", "damping"), [(0.6, 0.0), (0.95, 0.2)])
def test_seven_stiff_joints_at_2_ms_stay_within_half_a_percent(load, damping):
    """A slow load that no joint gives way to, taken at the end of each step as backward Euler does, against a step
    of 10 us. A load held over a step lags by that step, in MuJoCo as in any controller: no error of the friction.

    Close to break-away each element that gives way rings the joint at up to 1120 Hz, and what rings slips further.
    Undamped, that goes on in the small step, and the long one, which cannot carry it, is off by 0.6 to 3.6 %; where
    the bearing damps it the error is again that of a first-order step."""

    def motion(h, integration):
        model, data, gravity, travel, level = stiff_arm(h, integration, damping=damping)
        out = []
        for k in range(round(0.4 / h)):
            t = (k + 1) * h
            rise = 0.5 - 0.5 * np.cos(np.pi * min(1, t / 0.2))
            data.ctrl[:] = gravity + load * level * np.sin(2 * np.pi * 2 * t) * rise
            mujoco.mj_step(model, data)
            if (k + 1) % round(2e-3 / h) == 0:
                out.append(data.qpos.copy())
        return np.array(out), travel

    reference, travel = motion(1e-5, "explicit")
    error = np.abs(motion(2e-3, "auto")[0] - reference).max(axis=0) / travel
    assert (error < 0.005).all(), error


@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_stiff_arm_slides_and_stops_without_chatter(h):
    """Pushed past break-away and let go all joints stop, but for what they vibrate within their bearings."""
    model, data, gravity, travel, level = stiff_arm(h)
    end = []
    for k in range(round(1 / h)):
        data.ctrl[:] = gravity + (1.5 * level if k * h < 0.2 else 0)
        mujoco.mj_step(model, data)
        for i in range(7):
            reading = engine.friction(model, data, model.joint(i).name)
            assert (np.abs(reading.states["gms"][::2]) <= SHARE * level[i] * (1 + 1e-9)).all()
        if k * h > 0.2:
            mujoco.mj_forward(model, data)
            gravity = data.qfrc_bias.copy()
        if k * h > 0.8:
            end.append(data.qpos.copy())
    assert not any(w.number for w in data.warning)
    assert np.abs(np.subtract(data.qpos, POSE)).max() > 50 * travel.max(), "the joints must slide"
    assert (np.ptp(end, axis=0) < 0.05 * travel).all()


@pytest.mark.parametrize(("load", "damping"), [(0.95, 0.0), (2.0, 0.2)])
def test_the_torque_over_a_step_is_that_of_the_law_at_its_end(load, damping):
    """Of joints that stick too, beside joints that slide: what the elements carry the joint feels. One that was solved
    for before its neighbour gave way wound up by up to a sixth of its torque."""
    model, data, gravity, _, level = stiff_arm(2e-3, damping=damping)
    names = [model.joint(i).name for i in range(7)]
    layout = batched.lay_out(model)
    drag = [layout.parameters[layout.column(name, "viscous.coefficient")][0] for name in names]
    slid = 0
    for k in range(250):
        data.ctrl[:] = gravity + load * level * np.sin(2 * np.pi * (k + 1) * 2e-3)
        mujoco.mj_step(model, data)
        for i, name in enumerate(names):
            reading = engine.friction(model, data, name)
            force, slip = reading.states["gms"].reshape(-1, 2).T
            carried = -force.sum() - drag[i] * data.qvel[i]
            assert abs(reading.torque - carried) < 1e-4 * level[i], (k, name)
            slid += slip.any()
    assert slid > 100


def test_coupled_static_friction_solves_the_inclusion():
    """Each joint either holds, with a torque inside its level, or slides at its level against the motion."""
    level = np.array([20.0, 15, 10, 8, 3, 2, 1])
    rng = np.random.default_rng(0)
    plants = {}
    names = [j.name for j in mujoco.MjSpec.from_file(str(ARM)).joints]
    for name, top in zip(names, level, strict=True):
        plants[name] = Plant.axis() + effects.Coulomb(coulomb=float(top))
    model = engine.attach(ARM, plants).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    held = slid = 0
    for k in range(400):
        if k % 20 == 0:
            load = 1.6 * level * rng.uniform(-1, 1, 7)
        mujoco.mj_forward(model, data)
        data.ctrl[:] = data.qfrc_bias + load
        mujoco.mj_step(model, data)
        f, v = data.qfrc_passive, data.qvel
        holds = np.abs(v) < 1e-9
        assert (np.abs(f[holds]) <= level[holds] * (1 + 1e-9)).all()
        assert np.allclose(f[~holds], -level[~holds] * np.sign(v[~holds]), rtol=1e-6)
        held, slid = held + holds.sum(), slid + (~holds).sum()
    assert held > 200 and slid > 200


WAYS = {
    "forcerange": '<actuator><motor name="drive" joint="shaft" gear="2" forcerange="-1.7e-3 1.7e-3"/></actuator>',
    "joint range": '<actuator><motor name="drive" joint="shaft"/></actuator>',
    "tendon": '<tendon><fixed name="t" actuatorfrclimited="true" actuatorfrcrange="-3.4e-3 3.4e-3">'
    '<joint joint="shaft" coef="1"/></fixed></tendon><actuator><motor name="drive" tendon="t"/></actuator>',
    "dcmotor": '<actuator><dcmotor name="drive" joint="shaft" motorconst="0.1" resistance="10" '
    'cogging="1e-3 8 0.5"/></actuator>',
    "position": '<actuator><position name="drive" joint="shaft" kp="3e-3" kv="1e-4"/></actuator>',
}


@pytest.mark.parametrize("way", WAYS)
def test_friction_knows_what_the_actuators_end_up_with(way):
    """Gears, limits of force, tendons, motors: static friction of 4 mN m carries what comes through, exactly."""
    xml = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', WAYS[way])
    if way == "joint range":
        xml = xml.replace('<joint name="shaft"', '<joint name="shaft" actuatorfrcrange="-3.4e-3 3.4e-3"')
    model = engine.attach(xml, {"shaft": DRY}).compile()
    data = mujoco.MjData(model)
    for k in range(300):
        data.ctrl[0] = {"dcmotor": 0.2, "position": 1.0}.get(way, 0.1) * np.sin(0.05 * k)
        mujoco.mj_step(model, data)
        assert abs(data.qpos[0]) < 1e-15
        assert data.qfrc_passive[0] == pytest.approx(-data.qfrc_actuator[0], abs=1e-15)
    assert np.abs(data.qfrc_actuator).max() < 4e-3


def test_friction_waits_for_actuators_of_other_plugins():
    for path in (Path(mujoco.__file__).parent / "plugin").glob("*actuator*"):
        mujoco.mj_loadPluginLibrary(str(path))
    pid = (
        '<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="3e-3"/></instance>'
        '</plugin></extension><actuator><plugin joint="shaft" plugin="mujoco.pid" instance="pid"/></actuator>'
    )
    xml = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', pid)
    try:
        model = engine.attach(xml, {"shaft": DRY}).compile()
    except ValueError:
        pytest.skip("this mujoco ships no actuator plug-in")
    data = mujoco.MjData(model)
    for k in range(300):
        data.ctrl[0] = np.sin(0.05 * k)
        mujoco.mj_step(model, data)
        assert abs(data.qpos[0]) < 1e-15


def test_gravity_compensation_by_the_actuators_is_known():
    xml = AXIS
    for old, new in (
        ('gravity="0 0 0"', 'gravity="0 -9.81 0"'),
        ('name="rotor"', 'name="rotor" gravcomp="1"'),
        ('<joint name="shaft"', '<joint name="shaft" actuatorgravcomp="true"'),
        ('<inertial pos="0 0 0"', '<inertial pos="1 0 0"'),
    ):
        xml = xml.replace(old, new)
    model = engine.attach(xml, {"shaft": DRY}).compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.qfrc_actuator[0] == pytest.approx(9.81)
    assert abs(data.qpos[0]) < 1e-12 and abs(data.qfrc_passive[0]) < 1e-9


def test_explicit_is_chosen_where_it_is_stable():
    """Automatic: the trajectory of the explicit step up to (w h)^2 = 2, of the implicit one above."""
    for wh, same in ((1.3, "explicit"), (1.5, "implicit")):
        inertia, h = 1e-3, 1e-3
        law = effects.GMS(
            stiffness=[inertia * (wh / h) ** 2], fraction=[1.0], coulomb=0.1, static=0.1, stribeck_velocity=1.0,
            attraction=1.0,
        )
        joint = (Plant.axis() + law).joint()
        torque = 0.05 * np.sin(np.arange(300) * 0.1)
        motion = [joint.simulate(inertia, h, torque, integration=way).position for way in ("auto", same)]
        assert np.array_equal(*motion)
        assert np.isfinite(motion[0]).all() and np.abs(motion[0]).max() < 1


@pytest.mark.parametrize("seed", [4, 8])
@pytest.mark.parametrize("softness", [0.05, 0.25, 0.95])
def test_coupled_joints_that_are_solved_alone_come_to_rest(softness, seed):
    """A chain of seven light and heavy links, each joint's friction of so many h slope / inertia: from 0.3 to 1 the
    coupling is that of the mass matrix, below that of the last step. It neither gains energy nor chatters on."""
    rng, h = np.random.default_rng(seed), 2e-3
    link = (
        '<body pos="{} 0 0"><joint name="j{}" axis="0 0 1"/>'
        '<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass="{}" contype="0"/>'
    )
    chain = "".join(link.format(0.2 * (i > 0), i, 10 ** rng.uniform(-1.5, 0.5)) for i in range(7)) + "</body>" * 7
    text = f'<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody>{chain}</worldbody></mujoco>'
    plants = {}
    for i, weight in enumerate(mujoco.MjModel.from_xml_string(text).dof_invweight0):
        k = softness / (h * h * weight)
        level = 5e-3 / (h * h * weight)
        plants[f"j{i}"] = Plant.axis() + effects.GMS(
            stiffness=k * SHARE[::-1], fraction=SHARE, coulomb=level, static=1.2 * level, stribeck_velocity=0.8,
            attraction=60 * level,
        )  # fmt: skip
    model = engine.attach(text, plants, "implicit").compile()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, energy = mujoco.MjData(model), []
    data.qvel[:] = rng.normal(size=7)
    for _ in range(2000):
        mujoco.mj_step(model, data)
        energy.append(data.energy[1])
    assert max(energy) < 1.02 * energy[0]
    assert max(energy[-100:]) < 0.05 * energy[0]


@pytest.mark.parametrize(("wh", "tolerance"), [(0.1, 0), (3, 1e-3)])
def test_each_of_many_implicit_joints_moves_as_it_does_alone(wh, tolerance):
    """Forty rotors that do not touch, more than are solved for on the stack; stiff ones as near as a solution comes."""

    def motion(load):
        body = '<body><joint name="j{}" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        bodies = "".join(body.format(i) for i in range(load.shape[1]))
        text = f'<mujoco><option timestep="1e-3" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
        law = effects.GMS(
            stiffness=np.array([8, 4, 2, 1]) / 15 * (wh / 1e-3) ** 2, fraction=SHARE, coulomb=4.5, static=5.4,
            stribeck_velocity=0.8, attraction=300,
        )  # fmt: skip
        model = engine.attach(text, {"*": Plant.axis(1.0) + law}, "implicit").compile()
        data, q = mujoco.MjData(model), []
        for row in load:
            data.qfrc_applied[:] = row
            mujoco.mj_step(model, data)
            q.append(data.qpos.copy())
        return np.array(q)

    load = 8 * np.sin(0.02 * np.arange(1000)[:, None] * np.random.default_rng(0).uniform(0.5, 2, 40))
    together = motion(load)
    for j in (0, 17, 39):
        alone = motion(load[:, [j]])[:, 0]
        assert np.abs(together[:, j] - alone).max() <= tolerance * np.ptp(alone)
