"""The plug-in and the control callback inside MuJoCo."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from axes import AXIS, BEARING, DRY, FC, FS, J, axis, gms, run, stick_slip
from mujoco.batch import Batch

from gms_mujoco import effects, engine
from gms_mujoco.plant import Plant

MODELS = Path(__file__).resolve().parent.parent / "models"
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS


INTEGRATIONS = pytest.mark.parametrize("integration", ["explicit", "implicit"])


def test_plugin_torque_is_the_replayed_torque_to_the_last_bit():
    t, q, v, torque = run(*axis(), stick_slip(6000)).T
    assert np.count_nonzero(np.diff(np.sign(v))) > 10
    assert np.array_equal(BEARING.joint().replay(t, q, v).torque, torque)


@INTEGRATIONS
def test_axis_simulation_is_the_plugin_trajectory(integration):
    command = stick_slip(6000)
    _, q, v, torque = run(*axis(integration=integration), command).T
    motion = BEARING.joint().simulate(J, 5e-4, command, integration=integration)
    if integration == "explicit":
        assert np.array_equal(motion.position, q) and np.array_equal(motion.velocity, v)
        assert np.array_equal(motion.friction, torque)
    else:
        assert np.allclose(motion.position, q, atol=1e-10) and np.allclose(motion.friction, torque, atol=1e-10)


@INTEGRATIONS
def test_repeated_forward_changes_nothing(integration):
    model, data = axis(integration=integration)
    run(model, data, stick_slip(777))
    mujoco.mj_forward(model, data)
    state, force = data.plugin_state.copy(), data.qacc.copy()
    for _ in range(5):
        mujoco.mj_forward(model, data)
        assert np.array_equal(data.plugin_state, state) and np.array_equal(data.qacc, force)
    mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 0)
    assert np.array_equal(data.plugin_state, state) and np.array_equal(data.qacc, force)


def test_a_time_step_that_changes_counts_for_every_data_of_the_model():
    """What a model says of a joint is kept once for all of them, until it says something else."""
    stiff, command = Plant.axis(J) + gms((80.0, 40.0, 20.0, 10.0)), stick_slip(600)
    model, data = axis(stiff, timestep=1e-4)
    others = [mujoco.MjData(model) for _ in range(3)]
    for d in (data, *others):
        run(model, d, command[:100])
    state = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, state, FULL)
    model.opt.timestep = 2e-3
    coarse, alone = axis(stiff, timestep=2e-3)
    mujoco.mj_setState(coarse, alone, state, FULL)
    expected = run(coarse, alone, command[100:])
    assert np.abs(expected[:, 3]).max() < 2 * FS  # no explicit step holds that
    for d in (data, *others):
        assert np.array_equal(run(model, d, command[100:]), expected)


def test_of_a_step_no_more_is_noted_than_is_read():
    """A batch copies it in every step."""
    loaded = BEARING + effects.LoadDependentFriction(coefficient=0.3)
    size = {i: axis(integration=i)[0].npluginstate for i in ("explicit", "auto", "implicit")}
    assert size["explicit"] == 2 + 8 + 3 and size["auto"] == size["implicit"] == size["explicit"] + 6
    assert axis(loaded, "explicit")[0].npluginstate == size["explicit"] + 1
    warm = BEARING + effects.ThermalDrift(viscous=1e-5, time_constant=1.0, temperature_scale=10.0)
    assert axis(warm, "explicit")[0].npluginstate == size["explicit"] + 1  # its heat, and no load


@INTEGRATIONS
@pytest.mark.parametrize("plant", [BEARING, DRY])
def test_from_the_first_step_on_every_number_of_a_state_is_finite(integration, plant):
    model, data = axis(plant, integration)
    for _ in range(3):
        mujoco.mj_step(model, data)
        state = np.empty(mujoco.mj_stateSize(model, FULL))
        mujoco.mj_getState(model, data, state, FULL)
        assert np.isfinite(state).all()


@INTEGRATIONS
def test_save_reload_copy_reset_and_set_state_reproduce_a_trajectory(integration, tmp_path):
    command = stick_slip(2000)
    model, data = axis(integration=integration)
    first = run(model, data, command[:900])
    state = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, state, FULL)
    copy = mujoco.MjData(model)
    mujoco.mj_copyData(copy, model, data)
    rest = run(model, data, command[900:])
    assert np.array_equal(run(model, copy, command[900:]), rest)

    other = mujoco.MjData(model)
    mujoco.mj_setState(model, other, state, FULL)
    assert np.array_equal(run(model, other, command[900:]), rest)

    mujoco.mj_resetData(model, data)
    assert np.array_equal(run(model, data, command[:900]), first)

    spec = engine.attach(AXIS, {"shaft": BEARING}, integration)
    spec.compile()
    reloaded = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert np.array_equal(run(reloaded, mujoco.MjData(reloaded), command[:900]), first)

    binary = str(tmp_path / "axis.mjb")
    mujoco.mj_saveModel(model, binary)
    loaded = mujoco.MjModel.from_binary_path(binary)
    assert np.array_equal(run(loaded, mujoco.MjData(loaded), command[:900]), first)


@pytest.mark.parametrize("integration", ["explicit", "implicit"])
def test_each_simulation_of_a_batch_has_the_friction_of_its_own_model(integration):
    servo = (
        '<mujoco><option timestep="0.0005"/><worldbody><body><joint name="shaft" axis="0 0 1" armature="3e-5"/>'
        '<geom size=".01" mass="1e-6"/></body></worldbody><actuator><motor joint="shaft"/></actuator></mujoco>'
    )
    models = []
    for level in (2e-3, 4e-3, 8e-3):
        law = effects.GMS(
            stiffness=[1e3 * level] * 2, fraction=[0.5, 0.5], coulomb=level, static=1.1 * level,
            stribeck_velocity=0.5, attraction=1.0,
        )  # fmt: skip
        models.append(engine.attach(servo, {"shaft": Plant.axis(3e-5) + law}, integration=integration).compile())
    command, alone = 0.01 * np.sin(0.05 * np.arange(600)), []
    for model in models:
        data = mujoco.MjData(model)
        for u in command:
            data.ctrl[0] = u
            mujoco.mj_step(model, data)
        alone.append(data.qpos[0])
    batch = Batch(models[0], 3, 2, True)
    batch.set_models(models)
    for u in command:
        batch.ctrl[:] = u
        batch.step()
    assert np.array_equal(np.ravel(batch.qpos), alone) and len(set(alone)) == 3


@INTEGRATIONS
def test_rollout_from_mid_run_and_batch_reproduce_a_trajectory(integration):
    command = stick_slip(1500)
    model, data = axis(integration=integration)
    run(model, data, command[:700])
    start = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, start, FULL)
    expected = []
    for u in command[700:]:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        expected.append((data.qpos[0], data.qvel[0]))
    expected = np.array(expected)

    spare = [mujoco.MjData(model) for _ in range(2)]
    controls = np.tile(command[700:, None], (4, 1, 1))
    states, _ = mujoco.rollout.rollout(model, spare, np.tile(start, (4, 1)), controls)
    assert np.array_equal(states[3, :, 1:3], expected)

    for nthread in (1, 2):
        for persistent in (False, True):
            batch = Batch(model, 3, nthread, persistent)
            history = []
            for u in command:
                batch.ctrl[:] = u
                batch.step()
                history.append((batch.qpos[2, 0], batch.qvel[2, 0]))
            assert np.array_equal(np.array(history)[700:], expected)


def test_friction_sees_controls_that_a_callback_sets():
    """The friction answers the torque of the same step."""
    model, data = axis(DRY)

    def control(m, d):
        d.ctrl[0] = 3e-3 * np.sin(30 * d.time)

    mujoco.set_mjcb_control(control)
    try:
        mujoco.mj_step(model, data, 2000)
    finally:
        mujoco.set_mjcb_control(None)
    assert abs(data.qpos[0]) < 1e-15


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("timestep", [1e-4, 1e-3, 5e-3])
def test_static_friction_holds_without_creep(integrator, timestep):
    model, data = axis(DRY, timestep=timestep, integrator=integrator)
    load = 1.7e-3 + 1.2e-3 * np.sin(2 * np.pi * 5 * np.arange(int(1 / timestep)) * timestep)
    rows = run(model, data, load)
    assert np.abs(rows[:, 1]).max() < 1e-15
    assert np.allclose(rows[:, 3], -load, atol=1e-12)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("timestep", [1e-4, 1e-3, 5e-3])
def test_friction_that_creeps_gives_way_as_its_curve_says(integrator, timestep):
    """A steady load tau below the level Fc moves the joint at V0 atanh(tau / Fc)."""
    level, creep = 4e-3, 0.02
    plant = Plant.axis(J) + effects.Stribeck(coulomb=level, static=level, stribeck_velocity=1.0, creep_velocity=creep)
    model, data = axis(plant, timestep=timestep, integrator=integrator)
    for share in (0.3, -0.9):
        velocity = run(model, data, np.full(400, share * level))[-1, 2]
        assert velocity == pytest.approx(creep * np.arctanh(share), rel=1e-6)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
def test_gms_holds_without_creep(integrator):
    """After the transient the joint returns to the same place in each period of a load below break-away."""
    model, data = axis(integrator=integrator)
    period = 400
    load = 2.5e-3 + 1.5e-3 * np.sin(2 * np.pi * np.arange(60 * period) / period)
    q = run(model, data, load)[:, 1]
    assert abs(q[-1] - q[-1 - 10 * period]) < 1e-9 * np.ptp(q)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("timestep", [1e-4, 5e-4, 2e-3, 5e-3])
def test_hold_test_of_the_peers(integrator, timestep):
    """Break-away 0.34 N m under 0.15 + 0.10 sin(2 pi 5 t) N m, after the transient: MuJoCo's frictionloss creeps
    by 23,563 urad/s, its LuGre by 2,440 urad/s."""
    law = effects.GMS(
        stiffness=[40, 20, 10, 5], fraction=[0.1, 0.2, 0.3, 0.4], coulomb=0.28, static=0.34, stribeck_velocity=0.1,
        attraction=10.0,
    )
    xml = AXIS.replace(str(J), "1e-3")
    spec = engine.attach(xml, {"shaft": Plant.axis() + law + effects.Viscous(coefficient=0.02)})
    spec.option.timestep = timestep
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = spec.compile()
    period = round(0.2 / timestep)
    load = 0.15 + 0.10 * np.sin(2 * np.pi * np.arange(20 * period) / period)
    q = run(model, mujoco.MjData(model), load)[:, 1]
    creep = abs(q[-1] - q[-1 - 5 * period]) / 1.0  # rad/s
    assert creep < 1e-9


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("wh", [3.0, 100.0])
def test_stiff_joint_is_bounded_under_every_integrator(integrator, wh):
    stiffness = np.array([8, 4, 2, 1]) / 15 * J * (wh / 2e-3) ** 2
    model, data = axis(Plant.axis(J) + gms(stiffness), timestep=2e-3, integrator=integrator)
    rows = run(model, data, stick_slip(1000, 2e-3, 0.7 * FS))
    assert np.abs(rows[:, 3]).max() < 0.75 * FS
    assert np.abs(rows[:, 1]).max() < 0.4 * FS / stiffness[3]


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
def test_500_hz_joint_runs_at_2_ms_under_every_integrator(integrator):
    """In parts of the travel from full slip to full slip, against steps of 1 us."""
    stiffness, h = np.array([8, 4, 2, 1]) / 15 * J * (2 * np.pi * 500) ** 2, 2e-3
    plant, torque = Plant.axis(J) + gms(stiffness), 0.6 * FS * np.sin(2 * np.pi * 3 * h * np.arange(500))
    reference = plant.joint().simulate(J, h, torque, substeps=2000, integration="explicit").position
    q = run(*axis(plant, timestep=h, integrator=integrator), torque)[:, 1]
    assert np.abs(q - reference).max() < 0.02 * 2 * 0.4 * FS / stiffness[3]


def test_actuation_disabled_and_models_without_actuators():
    for xml in (AXIS, AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', "")):
        model = engine.attach(xml, {"shaft": DRY}).compile()
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 3.9e-3
        mujoco.mj_step(model, data, 500)
        assert abs(data.qpos[0]) < 1e-15
        data.qfrc_applied[0] = 5e-3
        mujoco.mj_step(model, data, 500)
        assert data.qvel[0] == pytest.approx(1e-3 / J * 0.25, rel=1e-9)


def test_holds_against_an_external_wrench():
    model, data = axis(DRY)
    data.xfrc_applied[1, 5] = 3.5e-3
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qpos[0]) < 1e-15


@INTEGRATIONS
@pytest.mark.parametrize("rotor", [0.0, 0.4])
def test_load_dependent_friction_follows_the_transmitted_torque(integration, rotor):
    """What the drive gives, less what friction and the rotor take: less when it drives, more when it brakes."""
    f0, c = 1e-3, 100.0
    plant = Plant.axis() + effects.Coulomb(coulomb=f0) + effects.LoadDependentFriction(coefficient=c)
    spec = engine.attach(AXIS, {"shaft": plant}, integration)
    spec.joint("shaft").armature = rotor / (1 - rotor) * J
    model = spec.compile()
    data = mujoco.MjData(model)
    for drive in (3e-3, -3e-3, 1e-3):
        data.qvel[0] = 50.0
        data.ctrl[0] = drive
        mujoco.mj_step(model, data, 30)
        assert data.qvel[0] > 10
        # Friction f and the drive u share their torque out: the link gets L = (1 - rotor) (u - f), f = f0 (1 + c |L|).
        driven = 1 if drive > f0 else -1
        share = driven * (1 - rotor) * f0 * c
        assert -data.qfrc_passive[0] == pytest.approx((f0 + share * drive) / (1 + share), rel=1e-6)


def test_repeated_evaluations_of_load_dependent_friction_agree():
    plant = Plant.axis() + gms() + effects.LoadDependentFriction(coefficient=100.0)
    model, data = axis(plant)
    run(model, data, stick_slip(500))
    mujoco.mj_forward(model, data)
    once = data.qfrc_passive.copy()
    mujoco.mj_forward(model, data)
    mujoco.mj_inverse(model, data)
    assert np.array_equal(data.qfrc_passive, once)


def test_setting_the_position_after_a_reset_is_no_motion():
    model, data = axis()
    for q in (0.0, 1.0, -2.0):
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        assert engine.friction(model, data, "shaft").torque == 0


def test_finite_differences_see_the_stiffness_and_leave_the_state():
    model, data = axis(Plant.axis(J) + gms())
    run(model, data, np.full(3000, 1e-3))  # at rest in pre-sliding
    before = data.plugin_state.copy()
    A = np.empty((2, 2))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, None, None, None)
    assert np.array_equal(data.plugin_state, before)
    tangent = -(A[1, 0]) * J / model.opt.timestep
    assert 0.1 < tangent <= 1.5 * (1 + 1e-6)


def test_inverse_dynamics_knows_the_friction():
    model, data = axis()
    data.ctrl[0] = 6e-3
    mujoco.mj_step(model, data, 300)
    mujoco.mj_forward(model, data)
    mujoco.mj_inverse(model, data)
    assert data.qfrc_inverse[0] == pytest.approx(6e-3, rel=1e-9)


def inverse_of(model, data, acceleration):
    """Torque [N m] that mj_inverse asks for in a copy of the data, whose state no mj_forward has seen."""
    copy = mujoco.MjData(model)
    mujoco.mj_copyData(copy, model, data)
    copy.qacc[:] = acceleration
    mujoco.mj_inverse(model, copy)
    return copy.qfrc_inverse.copy()


@INTEGRATIONS
def test_inverse_dynamics_of_a_state_that_no_forward_has_seen(integration):
    """The friction is that of the acceleration asked for: what mj_forward finds for the torque that leads there."""
    model, data = axis(integration=integration)
    worst = 0.0
    for u in stick_slip(1500):
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        seen = mujoco.MjData(model)
        mujoco.mj_copyData(seen, model, data)
        seen.ctrl[0] = 1.05 * u
        mujoco.mj_forward(model, seen)
        worst = max(worst, abs(inverse_of(model, data, seen.qacc)[0] - 1.05 * u))
    assert worst < 3e-3 * FS, "as closely as the implicit step is solved"


def test_inverse_dynamics_of_static_friction():
    """In motion its level; at rest no acceleration tells the torque: the last that held stays, within the level."""
    model, data = axis(DRY)
    data.ctrl[0] = 3e-3
    mujoco.mj_step(model, data, 10)
    assert inverse_of(model, data, 0.0)[0] == pytest.approx(3e-3, rel=1e-9)
    assert inverse_of(model, data, 50.0)[0] == pytest.approx(J * 50 + 4e-3, rel=1e-9)
    assert inverse_of(model, data, -50.0)[0] == pytest.approx(-J * 50 - 4e-3, rel=1e-9)


def test_inverse_dynamics_of_stiff_coupled_joints(arm_plant):
    model = engine.attach(MODELS / "arm.xml", {"*": arm_plant}, "implicit").compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2]
    for k in range(100):
        data.ctrl[:] = 8 * np.sin(0.1 * k + np.arange(7))
        mujoco.mj_step(model, data)
        seen = mujoco.MjData(model)
        mujoco.mj_copyData(seen, model, data)
        mujoco.mj_forward(model, seen)
        needed = inverse_of(model, data, seen.qacc)
        assert np.abs(needed - data.ctrl).max() < 0.02 * 5.0


@INTEGRATIONS
def test_transition_derivatives_are_those_of_the_step(integration):
    """mjd_transitionFD against differences of steps from the saved state, in pre-sliding and while turning."""
    for load in (1e-3, 8e-3):
        model, data = axis(integration=integration)
        run(model, data, np.full(60, load))
        A, B = np.empty((2, 2)), np.empty((2, 1))
        mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)

        def end(dq, dv, du, data=data, model=model, load=load):
            copy = mujoco.MjData(model)
            mujoco.mj_copyData(copy, model, data)
            copy.qpos[0] += dq
            copy.qvel[0] += dv
            copy.ctrl[0] = load + du
            mujoco.mj_step(model, copy)
            return np.array([copy.qpos[0], copy.qvel[0]])

        columns = [(end(*e) - end(*-e)) / 2e-6 for e in 1e-6 * np.eye(3)]
        assert np.allclose(np.column_stack([A, B]), np.transpose(columns), rtol=1e-4, atol=1e-6 * np.abs(B).max())


@INTEGRATIONS
def test_a_sleeping_joint_gathers_no_torque_and_its_neighbour_notices_nothing(integration):
    """Two rotors share an instance: one comes to rest, sleeps and is woken, the other is driven all along."""
    body = '<body><joint name="{}" axis="0 0 1"/><geom size="0.1" mass="0" contype="0"/>' + (
        f'<inertial pos="0 0 0" mass="1" diaginertia="{J} {J} {J}"/></body>'
    )
    plant, runs = Plant.axis(J) + gms() + effects.Viscous(coefficient=3e-4), {}
    for sleep in ("enable", "disable"):
        text = (
            f'<mujoco><option timestep="5e-4" gravity="0 0 0" sleep_tolerance="1e-3"><flag sleep="{sleep}"/></option>'
            f'<worldbody>{body.format("calm")}{body.format("busy")}</worldbody></mujoco>'
        )
        model = engine.attach(text, {"*": plant}, integration).compile()
        data, rows = mujoco.MjData(model), []
        data.qvel[0] = 3
        for k in range(6000):
            data.qfrc_applied[:] = 1.3 * FS * np.sin(4e-3 * max(k - 4000, 0)), 1.5 * FS * np.sin(0.01 * k)
            mujoco.mj_step(model, data)
            rows.append((*data.qpos, engine.friction(model, data, "calm").torque, data.tree_asleep[0] >= 0))
        runs[sleep] = np.array(rows).T
        assert model.nplugin == 1
    calm, busy, torque, asleep = runs["enable"]
    assert asleep[3000:4000].all() and not asleep[4100:].any()
    assert np.ptp(torque[3000:4000]) == 0 and abs(torque[3000]) < FS
    assert np.array_equal(busy, runs["disable"][1])
    assert np.abs(calm - runs["disable"][0]).max() < 0.01 * np.ptp(calm)


# ------------------------------------------------------------------------------------------ against MuJoCo's own


def twin(attributes, plant, torque, option="", elements="", speed=0.0, integration="auto", timestep=2e-4):
    """(2, n) positions of two equal joints, ours on the first and MuJoCo's element on the second."""
    body = (
        '<body><joint name="{0}" axis="0 0 1" {1}/><inertial pos="0 0 0" mass="1" '
        f'diaginertia="{J} {J} {J}"/></body>'
    )
    xml = (
        f'<mujoco><option timestep="{timestep}" gravity="0 0 0">{option}</option><worldbody>'
        f'{body.format("ours", "")}{body.format("theirs", attributes)}</worldbody>{elements}</mujoco>'
    )
    model = engine.attach(xml, {"ours": plant}, integration).compile()
    data = mujoco.MjData(model)
    data.qvel[:] = speed
    history = []
    for u in torque:
        data.qfrc_applied[:] = u
        mujoco.mj_step(model, data)
        history.append(data.qpos.copy())
    return np.array(history).T


def test_viscous_is_joint_damping():
    ours, theirs = twin(
        'damping="3e-4"',
        Plant.axis() + effects.Viscous(coefficient=3e-4),
        stick_slip(5000, 2e-4),
        '<flag eulerdamp="disable"/>',
    )
    assert np.abs(ours - theirs).max() < 1e-12 * np.ptp(theirs)


def test_coulomb_brakes_like_frictionloss():
    """MuJoCo's is a soft constraint and creeps at rest; coasting to a stop they agree."""
    law = Plant.axis() + effects.Coulomb(coulomb=2e-3)
    ours, theirs = twin('frictionloss="2e-3"', law, np.zeros(2000), speed=20.0)
    assert ours[-1] == pytest.approx(20**2 * J / (2 * 2e-3), rel=2e-3)
    assert np.abs(ours - theirs).max() < 2e-3 * np.ptp(theirs)


@pytest.mark.parametrize("timestep", [5e-4, 2e-3])
@pytest.mark.parametrize("solver", ["", 'solreffriction="0.008 1" solimpfriction="0.8 0.9 0.001 0.5 2"'])
def test_frictionloss_is_that_of_mujoco(timestep, solver):
    """MuJoCo takes the velocity at the beginning of a step, we at its end: a time step less of creep time."""
    time, least, most = (0.008, 0.8, 0.9) if solver else (0.02, 0.9, 0.95)
    ahead, level = time * most / 2, 2e-3
    soft = effects.Frictionloss(
        coulomb=level, creep_velocity=level * ahead * (1 - least) / (least * J), creep_time=ahead - timestep
    )
    torque = 3e-3 * np.sin(2 * np.pi * 4 * timestep * np.arange(round(1 / timestep)))
    ours, theirs = twin(f'frictionloss="{level}" {solver}', Plant.axis() + soft, torque, timestep=timestep)
    assert np.ptp(theirs) > 0.1, "the joint must slide"
    assert np.abs(ours - theirs).max() < 1e-5 * np.ptp(theirs)


def test_gms_without_stribeck_is_a_set_of_yielding_tendons():
    stiffness, fraction = (0.8, 0.4, 0.2, 0.1), (0.1, 0.2, 0.3, 0.4)
    law = effects.GMS(
        stiffness=stiffness, fraction=fraction, coulomb=FC, static=FC, stribeck_velocity=1.0, attraction=1e9
    )
    tendons = "".join(
        f'<fixed stiffness="{k}" springyield="{a * FC / k}" springlength="0"><joint joint="theirs" coef="1"/></fixed>'
        for k, a in zip(stiffness, fraction, strict=True)
    )
    ours, theirs = twin(
        "", Plant.axis() + law, stick_slip(5000, 2e-4, 1.5 * FC), elements=f"<tendon>{tendons}</tendon>",
        integration="explicit",
    )
    assert np.ptp(ours) > 0.5, "the joint must slide"
    assert np.abs(ours - theirs).max() < 1e-12 * np.ptp(theirs)


def dcmotor(friction):
    return (
        '<actuator><dcmotor joint="theirs" input="none" motorconst="0" resistance="1" '
        f'{friction}/></actuator>'
    )


def test_lugre_is_that_of_dcmotor():
    """Theirs enters the torque one step late, which feeds the oscillation: the difference falls with the step."""
    law = Plant.axis() + effects.LuGre(
        stiffness=1.5, damping=1e-4, coulomb=FC, static=FS, stribeck_velocity=0.8, stribeck_exponent=2
    )
    elements = dcmotor(f'lugre="1.5 1e-4 {FC} {FS} 0.8"')
    error = []
    for h in (2e-4, 5e-5):
        torque = stick_slip(round(1 / h), h, 1.2 * FS)
        ours, theirs = twin("", law, torque, elements=elements, integration="explicit", timestep=h)
        error.append(np.abs(ours - theirs).max() / np.ptp(theirs))
    assert error[1] < 0.01 and error[1] < 0.35 * error[0]


def test_cogging_is_that_of_dcmotor():
    law = Plant.axis() + effects.Cogging(harmonics=[8], amplitude=[1e-3], phase=[0.4])
    ours, theirs = twin("", law, stick_slip(5000, 2e-4), elements=dcmotor('cogging="1e-3 8 0.4"'))
    assert np.abs(ours - theirs).max() < 1e-12 * np.ptp(theirs)


# ------------------------------------------------------------------------------------------------------ the arm


@pytest.fixture(scope="module")
def arm_plant():
    return Plant.load(MODELS / "arm_joint.toml")


def test_arm_converges_to_the_same_motion_at_any_step(arm_plant):
    """Seven coupled joints, explicit and implicit, against a small step."""

    def motion(h, integration):
        spec = engine.attach(MODELS / "arm.xml", {"*": arm_plant}, integration)
        spec.option.timestep = h
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = [0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2]
        mujoco.mj_forward(model, data)
        hold = data.qfrc_bias.copy()
        out = []
        for k in range(round(0.5 / h)):
            data.ctrl[:] = hold + 2.5 * np.sin(2 * np.pi * 2 * k * h)
            mujoco.mj_step(model, data)
            if (k + 1) % round(0.01 / h) == 0:
                out.append(data.qpos.copy())
        return np.array(out)

    reference = motion(1e-4, "explicit")
    span = np.ptp(reference, axis=0)
    for h, integration, tolerance in ((1e-3, "explicit", 0.02), (1e-3, "implicit", 0.12), (2e-3, "auto", 0.05)):
        assert (np.abs(motion(h, integration) - reference) < tolerance * span).all(), (h, integration)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_arm_with_stiff_joints_is_held_by_dry_friction(integrator):
    """Static friction on seven coupled joints carries the arm against gravity without creep."""
    plant = Plant.axis() + effects.Coulomb(coulomb=60.0)
    spec = engine.attach(MODELS / "arm.xml", {"*": plant})
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, 0.8, 0.2, 0.9, 0.1, 0.5, 0.2]
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 1000)
    assert np.abs(data.qpos - start).max() < 1e-7


@pytest.mark.parametrize("integration", ["explicit", "implicit"])
def test_joint_limits_and_contacts_beside_friction(arm_plant, integration):
    """Driven against its limits and onto the floor the arm stays finite, and friction within its level."""
    model = engine.attach(MODELS / "arm.xml", {"*": arm_plant}, integration).compile()
    model.geom_contype[-1] = model.geom_conaffinity[-1] = 1  # the hand touches the floor
    data = mujoco.MjData(model)
    touched = 0
    for k in range(1500):
        data.ctrl[:] = [60, 60, 30, 60, 15, 15, 15] if k < 1000 else 0
        mujoco.mj_step(model, data)
        touched = max(touched, data.ncon + int(data.nefc > 0))
        for name in ("shoulder_lift", "wrist_roll"):
            reading = engine.friction(model, data, name)
            assert np.abs(reading.states["gms"][::2].sum()) <= 5.0 * (1 + 1e-12)
    assert touched, "nothing was touched"
    assert not any(w.number for w in data.warning)
    assert (np.abs(data.qvel) < 0.5).all()


def test_several_joints_models_and_data_at_once(arm_plant):
    """Threads that step different models and data get what each gets alone."""

    def job(k):
        if k % 2:
            model, data = axis(integration="implicit")
            return run(model, data, stick_slip(1500))[-1]
        model = engine.attach(MODELS / "arm.xml", {"*": arm_plant}, "implicit").compile()
        data = mujoco.MjData(model)
        data.qpos[1] = 0.5
        mujoco.mj_step(model, data, 500)
        return data.qpos.copy()

    alone = [job(0), job(1)]
    with ThreadPoolExecutor(4) as pool:
        for k, result in enumerate(pool.map(job, range(8))):
            assert np.array_equal(result, alone[k % 2])
