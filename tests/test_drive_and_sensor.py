"""What drive, sensor, spring and warm-up do, against independent solutions."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gms_mujoco import effects, engine
from gms_mujoco.compare import compare
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

J = 2.4e-5
H = 5e-4
DRY = Plant.axis(J) + effects.Coulomb(coulomb=2e-3) + effects.Viscous(coefficient=3e-5)
MOTOR = f"""<mujoco><option timestep="{H}" gravity="0 0 0"/><worldbody><body><joint name="j" armature="{J}"/>
    <geom size="0.001" mass="1e-6"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def command(n=4000, seed=1, rms=1e-2):
    return multisine(n, H, 1.0, 100.0, rms, np.random.default_rng(seed))


def delivered_by_mujoco(plant, u):
    """(n,) torque that the joint gets in each step."""
    model = engine.attach(MOTOR, {"j": plant}).compile()
    data = mujoco.MjData(model)
    out = np.zeros(len(u))
    for i, x in enumerate(u):
        data.ctrl[0] = x
        mujoco.mj_step(model, data)
        out[i] = data.qfrc_actuator[0]
    return out


# ------------------------------------------------------------------------------------------- current_loop_lag


@pytest.mark.parametrize("lag", [1e-5, 3e-4, 4e-3])
def test_lag_is_the_mean_of_the_exact_response(lag):
    u = command(40)
    got = effects.CurrentLoopLag(time=lag).deliver(H * np.arange(len(u)), u)
    torque, means = u[0], []
    for x in u:
        law = lambda t, y, x=x: [(x - y[0]) / lag, y[0]]  # noqa: E731
        s = solve_ivp(law, (0, H), [torque, 0.0], rtol=1e-10, atol=1e-14, method="LSODA")
        torque = s.y[0, -1]
        means.append(s.y[1, -1] / H)
    assert np.allclose(got, means, rtol=0, atol=1e-7)


def test_no_lag_is_no_change_and_a_small_one_looks_like_a_delay():
    u = command()
    t = H * np.arange(len(u))
    assert effects.CurrentLoopLag(time=0.0).deliver(t, u) is u
    lag, delay = effects.CurrentLoopLag(time=1e-7).deliver(t, u) - u, effects.Delay(time=1e-7).deliver(t, u) - u
    assert np.allclose(lag, delay, atol=1e-3 * np.abs(delay).max())


def test_lag_in_mujoco_is_right_to_half_a_step():
    u = command(2000)
    lag = effects.CurrentLoopLag(time=2e-3)
    got = delivered_by_mujoco(Plant.axis(J) + lag, u)
    fine = np.arange(2000 * 8) * H / 8
    torque = lag.deliver(fine, np.repeat(np.append(0, u[:-1]), 8)).reshape(-1, 8)  # from rest
    early, late = got[:-1], torque[1:, -1]
    assert np.abs(early - late).max() < 0.1 * np.abs(u).max()
    assert np.sqrt(np.mean((early - u[:-1]) ** 2)) > 3 * np.sqrt(np.mean((early - late) ** 2))


@pytest.mark.parametrize(
    "actuator, message",
    [
        ("", "needs an actuator"),
        ('<position name="m" joint="j" kp="1"/>', "needs a motor"),
        ('<general name="m" joint="j" dyntype="filter" dynprm="0.1"/>', "dynamics of its own .filter."),
    ],
)
def test_lag_says_where_it_cannot_act(actuator, message):
    xml = MOTOR.replace('<motor name="m" joint="j"/>', actuator)
    with pytest.raises(ModelError, match=message):
        engine.attach(xml, {"j": Plant.axis(J) + effects.CurrentLoopLag(time=1e-3)})
    engine.attach(xml, {"j": Plant.axis(J) + effects.CurrentLoopLag(time=0.0)})


# ------------------------------------------------------------------------------------------ torque_saturation


def test_saturation_clips_alike_in_simulation_and_mujoco():
    u = command()
    plant = Plant.axis(J) + effects.TorqueSaturation(limit=8e-3)
    got = plant.effects[0].deliver(H * np.arange(len(u)), u)
    assert np.abs(got).max() == 8e-3 and np.array_equal(got[np.abs(u) < 8e-3], u[np.abs(u) < 8e-3])
    assert np.array_equal(delivered_by_mujoco(plant, u), got)


def test_tighter_limit_of_the_model_stays():
    xml = MOTOR.replace('name="j"', 'name="j" actuatorfrcrange="-0.002 0.5"')
    joint = engine.attach(xml, {"j": Plant.axis(J) + effects.TorqueSaturation(limit=8e-3)}).joint("j")
    assert np.allclose(joint.actfrcrange, [-0.002, 0.008])


# --------------------------------------------------------------------------------------- encoder_eccentricity

WOBBLE = effects.EncoderEccentricity(amplitude=2e-3, phase=0.7)


@pytest.mark.parametrize("amplitude", [0.0, 1e-4, 0.1, 0.5])
def test_correction_undoes_the_reading(amplitude):
    e = WOBBLE.replace(amplitude=amplitude)
    t, q = np.arange(1000.0), np.linspace(-30, 30, 1000)
    assert np.abs(e.correct(t, e.read(t, q)) - q).max() < 1e-12
    assert np.all(np.diff(e.read(t, q)) >= 0)


def test_other_effects_leave_the_reading_alone():
    t, q = np.arange(5.0), np.linspace(0, 1, 5)
    for name, kind in effects.CATALOGUE.items():
        if kind.kind != "sensor":
            e = effects.find(name)()
            assert e.read(t, q) is q and e.correct(t, q) is q, name


def test_plants_without_sensor_effects_cost_nothing_and_others_are_seen_once():
    record = simulate(DRY, command(), H)
    o = Observation(record, 100.0)
    assert o.seen_by(DRY) is o
    seen = o.seen_by(DRY + WOBBLE)
    assert seen is o.seen_by(DRY + WOBBLE) and seen is not o.seen_by(DRY + WOBBLE.replace(phase=0.8))
    assert np.allclose(seen.record.position, WOBBLE.correct(record.time, record.position))


def test_inverse_dynamics_takes_the_wobble_out_and_a_fit_finds_it():
    t = H * np.arange(8000)
    u = 0.03 * np.sign(np.sin(2 * np.pi * t)) + command(8000)
    record = simulate(DRY + WOBBLE, u, H, torque_noise=1e-5, seed=3)
    o = Observation(record, 100.0)
    right, blind = (np.std(o.applied(p) - o.needed(p)) for p in (DRY + WOBBLE, DRY))
    assert right < 0.2 * blind
    found = fit(DRY + WOBBLE.replace(amplitude=1e-3, phase=0.3), [record]).plant["encoder_eccentricity"]
    assert found.amplitude == pytest.approx(2e-3, rel=0.02) and found.phase == pytest.approx(0.7, abs=0.02)


def test_sensor_effects_are_left_out_of_mujoco_with_a_warning():
    with pytest.warns(UserWarning, match="encoder_eccentricity acts on the measurement alone"):
        spec = engine.attach(MOTOR, {"j": Plant.axis(J) + WOBBLE})
    assert not len(spec.plugins)


# ------------------------------------------------------------------------------------- spring, thermal_drift


def test_axis_on_a_spring_swings_about_its_rest():
    spring = effects.Spring(stiffness=0.5, preload=0.1)
    record = simulate(Plant.axis(J) + spring, np.zeros(400), 1e-4, substeps=20)
    w = np.sqrt(0.5 / J)
    assert np.allclose(record.position, 0.2 * (1 - np.cos(w * record.time)), atol=2e-3)


def test_drift_fades_from_the_cold_level_to_the_warm_one():
    t = np.linspace(0, 50, 5001)
    q = 1.5 * t
    plant = DRY.without("viscous") + effects.ThermalDrift(amplitude=0.6, time_constant=4.0)
    torque = plant.joint().replay(t, q, np.full(len(t), 1.5)).torque
    assert np.allclose(torque[1:], -2e-3 * (1 + 0.6 * np.exp(-t[1:] / 4)))


def test_the_drag_that_fades_is_a_viscous_one():
    t, speed = np.linspace(0, 50, 5001), 1.5
    motion = t, speed * t, np.full(len(t), speed)
    plant = DRY + effects.ThermalDrift(viscous=3e-3, time_constant=4.0)
    more = plant.joint().replay(*motion).torque - DRY.joint().replay(*motion).torque
    assert np.allclose(more, -3e-3 * speed * np.exp(-t / 4), atol=1e-12)


def test_friction_that_heats_itself_cools_at_rest():
    """Turning at 1.5 rad/s for a while, resting for as long, turning again: theta goes to 1.5 / V and back to 0."""
    t = np.linspace(0, 30, 30001)
    moves = (t <= 10) | (t > 20)
    q = np.where(t <= 20, 1.5 * np.minimum(t, 10), 1.5 * (t - 10))
    drift = effects.ThermalDrift(amplitude=0.6, viscous=1e-3, time_constant=2.0, speed=0.5)
    torque = (DRY.without("viscous") + drift).joint().replay(t, q, np.where(moves, 1.5, 0.0)).torque
    warm = 1.5 / 0.5 * (1 - np.exp(-10 / 2.0))
    theta = np.where(t <= 10, 3 * (1 - np.exp(-t / 2)), warm * np.exp(-(t - 10) / 2))
    theta = np.where(t > 20, 3 + (warm * np.exp(-5) - 3) * np.exp(-(t - 20) / 2), theta)
    expected = -2e-3 * (1 + 0.6 * np.exp(-theta)) - 1e-3 * 1.5 * np.exp(-theta)
    inside = moves & (np.abs(t - 20) > 2e-3) & (t > 2e-3)
    assert torque[inside] == pytest.approx(expected[inside], rel=1e-3)
    assert np.abs(torque[20002]) > 0.98 * np.abs(torque[5]) > 1.2 * np.abs(torque[9990])


def test_friction_follows_a_temperature_with_a_lag():
    """From where it is found; 20 degC is theta = 0, where the joint is that nobody measured."""
    drift = effects.ThermalDrift(amplitude=0.6, viscous=1e-3, time_constant=2.0, temperature_scale=15.0)
    t = np.linspace(0, 10, 10001)
    joint, motion = (DRY.without("viscous") + drift).joint(), (t, 1.5 * t, np.full(len(t), 1.5))
    theta = np.where(t < 5, 1.0, 2.0 - np.exp(-(t - 5) / 2))
    torque = joint.replay(*motion, temperature=np.where(t < 5, 35.0, 50.0)).torque
    assert torque[1:] == pytest.approx(-2e-3 - (0.6 * 2e-3 + 1.5e-3) * np.exp(-theta[1:]), rel=1e-3)
    assert joint.replay(*motion).torque[1:] == pytest.approx(-2e-3 * 1.6 - 1.5e-3)


def test_a_record_without_the_temperature_that_friction_follows_is_refused():
    plant = DRY + effects.ThermalDrift(amplitude=0.6, time_constant=2.0, temperature_scale=15.0)
    record = simulate(plant, 0.01 * np.sin(np.arange(800) / 50), 1e-3)
    said = "no temperature .degC., which thermal_drift follows where it has temperature_scale"
    for verb in (fit, compare):
        with pytest.raises(DataError, match=said):
            verb(plant, [record])


def test_drift_follows_the_time_stamps_of_a_part_of_a_record():
    plant = DRY + effects.ThermalDrift(amplitude=0.6, time_constant=2.0)
    t = H * np.arange(8000)
    motion = t, np.sin(3 * t), 3 * np.cos(3 * t)
    joint = plant.joint()
    part = joint.replay(*(x[4000:] for x in motion)).torque
    assert np.array_equal(part[1:], joint.replay(*motion).torque[4001:])


def test_drift_that_begins_anew_with_a_record_is_as_by_a_clock_that_does():
    drift = effects.ThermalDrift(amplitude=0.6, viscous=1e-3, time_constant=2.0)
    t = H * np.arange(8000)
    motion = np.sin(3 * t), 3 * np.cos(3 * t)
    by_clock, anew = (DRY + d for d in (drift, drift.replace(anew=1.0)))
    expected = by_clock.joint().replay(t, *motion).torque
    assert anew.joint().replay(t + 3600.0, *motion).torque == pytest.approx(expected, rel=1e-9, abs=1e-15)
    warm = (DRY + drift.replace(amplitude=0.0, viscous=0.0)).joint().replay(t, *motion).torque
    assert by_clock.joint().replay(t + 3600.0, *motion).torque == pytest.approx(warm, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("drive", [effects.CurrentLoopLag(time=4e-4), effects.Delay(time=1.6e-3)], ids=lambda e: e.name)
def test_inside_a_sample_the_drive_delivers_what_it_does_over_the_sample(drive: effects.Effect) -> None:
    """Where parts of a sample are whole in the delay, their mean is exactly that of the sample."""
    h, parts = 1e-3, 10
    command = np.random.default_rng(0).standard_normal(200)
    fine = (Plant.axis(1.0) + drive).delivered(command, h, parts)
    coarse = drive.deliver(h * np.arange(200), command)
    assert fine.reshape(-1, parts).mean(1) == pytest.approx(coarse, abs=1e-12)
    assert np.ptp(fine.reshape(-1, parts), axis=1).max() > 0.1


def test_without_a_drive_effect_the_command_is_delivered() -> None:
    assert Plant.axis(1.0).delivered(np.array([1.0, 2.0]), 1e-3, 3).tolist() == [1, 1, 1, 2, 2, 2]
