"""Controllers follow, and what knows the friction follows better."""

import compensate
import gymnasium as gym
import numpy as np
import pytest
from axes import J

import gms_mujoco as gms
from gms_mujoco import control
from gms_mujoco.plant import Plant, plant_of

H = 1 / 2000
COUNT = 2 * np.pi / 1e6
PLANT = plant_of("servo_axis")


def observation(**values: float) -> np.ndarray:
    out = np.zeros(8)
    for name, value in values.items():
        out[getattr(control, name.upper())] = value
    return out


def test_the_names_of_an_observation_are_those_of_the_environment():
    env = gym.make("GmsMujoco/ServoTracking-v0").unwrapped
    env.reset(seed=0)
    seen = [env.step(np.array([0.05]))[0] for _ in range(50)][-1]
    r = env.axes.reference[0]
    assert seen[control.REFERENCE] == r[50, 0] and seen[control.AHEAD] == r[51, 0]
    assert seen[control.VELOCITY] == r[50, 1] and seen[control.ACCELERATION] == r[50, 2]
    assert seen[control.ERROR] == r[50, 0] - seen[control.POSITION]
    assert seen[control.TORQUE] == pytest.approx(0.05 * env.axes.torque_limit)
    assert seen[control.SPEED] == pytest.approx(env.axes.velocity()[0])


def test_controllers_add():
    both = control.Feedforward(2.0) + control.CoulombFeedforward(3.0, 1e-9)
    assert both(observation(acceleration=5.0, velocity=1.0)) == 13.0
    assert control.Feedforward(2.0, 0.5)(observation(velocity=4.0)) == 2.0
    for half in (0.5 * both, both * 0.5, sum([0.25 * both, 0.25 * both])):
        assert half(observation(acceleration=5.0, velocity=1.0)) == 6.5
    assert (both + (lambda seen: 1.0))(observation()) == 1.0
    for wrong in (lambda: both + 1, lambda: 1 + both, lambda: both * None, lambda: both * both):
        with pytest.raises(TypeError, match="unsupported operand"):
            wrong()


def test_pid_has_its_three_poles_at_the_bandwidth():
    pid = control.PID(J, H, 20.0)
    w = 2 * np.pi * 20.0
    np.testing.assert_allclose([pid.d / J, pid.p / J, pid.i / J], [3 * w, 3 * w**2, w**3])
    assert control.PID(J, H, 20.0)(observation(error=1e-3)) == pytest.approx(1e-3 * (pid.p + pid.i * H))
    pid = control.PID(J, H, 20.0, limit=1e-6)
    for _ in range(100):
        pid(observation(error=1e-3))
    assert pid.integral == 1e-6


@pytest.mark.parametrize("value", [0, -1.0, np.nan, None])
def test_a_number_of_a_controller_is_positive(value):
    for make in (
        lambda: control.PID(value, H),
        lambda: control.PID(J, value),
        lambda: control.PID(J, H, bandwidth=value),
        lambda: control.ADRC(J, H, observer=value),
        lambda: control.DisturbanceObserver(J, H, bandwidth=value),
        lambda: control.GMSObserver(PLANT, value),
        lambda: control.CoulombFeedforward(1.0, value),
        lambda: control.ILC(lambda: pid(0), H, bandwidth=value),
    ):
        with pytest.raises(gms.ModelError, match="of a controller must be a positive number"):
            make()


def test_a_follower_is_the_replay_step_by_step():
    t = np.arange(400) * H
    q = 0.02 * np.sin(2 * np.pi * 5 * t) + 1.0
    follower = control.Follower(PLANT, H)
    ahead, torque = [], []
    for x, after in zip(q, np.append(q[1:], 0), strict=True):
        torque.append(follower.to(x))
        ahead.append(follower.ahead(after))
    assert ahead[:-1] == torque[1:], "looking ahead changes nothing"
    replay = PLANT.joint().replay(t, q, np.append(0, np.diff(q) / H)).torque
    np.testing.assert_allclose(torque, replay, atol=1e-9 * np.abs(replay).max())


def test_a_follower_takes_the_name_of_a_plant():
    assert control.GMSObserver("servo_axis", H).follower.joint.n_state == PLANT.joint().n_state
    with pytest.raises(gms.ModelError, match="a Plant, the path of a model"):
        control.GMSFeedforward(3, H)
    with pytest.raises(gms.ModelError, match="needs a plant with lugre"):
        control.LuGreObserver("servo_axis", H)


@pytest.mark.parametrize("speed", [0.0, 5.0], ids=["time", "heat"])
def test_a_follower_knows_what_time_it_is(speed):
    plant = PLANT + gms.effects.ThermalDrift(amplitude=-0.5, time_constant=0.2, speed=speed)
    t = np.arange(1000) * H
    follower = control.Follower(plant, H)
    replay = plant.joint().replay(t, 2 * t, np.append(0, np.diff(2 * t) / H)).torque
    np.testing.assert_allclose([follower.to(2 * x) for x in t], replay, atol=1e-6 * np.abs(replay).max())


def test_the_feedforward_of_an_identified_plant_is_its_friction_along_the_reference():
    plant = Plant.axis(J) + gms.effects.Viscous(coefficient=2.0)
    controller = control.GMSFeedforward(plant, H)
    controller(observation(reference=0.0, ahead=1e-3))
    assert controller(observation(reference=1e-3, ahead=4e-3)) == pytest.approx(2.0 * (1e-3 + 3e-3) / H / 2)


def test_the_disturbance_observer_finds_a_constant_torque():
    observer, speed = control.DisturbanceObserver(J, H), 0.0
    for _ in range(200):
        torque = observer(observation(speed=speed, torque=1e-3))
        speed += H * (1e-3 - 4e-3) / J
    assert torque == pytest.approx(4e-3, rel=1e-3)


def test_beside_a_model_the_disturbance_observer_finds_the_rest():
    known = control.CoulombFeedforward(3e-3, 1e-9)
    observer, speed, torque = control.DisturbanceObserver(J, H, known=known), 0.0, 0.0
    for _ in range(200):
        command = observer(observation(speed=speed, velocity=1.0, torque=torque))
        torque = command
        speed += H * (torque - 4e-3) / J
    assert command == pytest.approx(4e-3, rel=1e-3)
    assert observer.estimate == pytest.approx(-1e-3, rel=1e-2)


def test_the_oracle_knows_the_true_torque():
    env = gym.make("GmsMujoco/ServoTracking-v0").unwrapped
    env.reset(seed=0)
    for _ in range(30):
        env.step(np.array([0.08]))
    true = env.friction
    assert control.Oracle(lambda: env.friction)(observation()) == -true > 0
    forces = gms.friction(env.axes.models[0], env.axes.batch.get_data(0), "shaft")
    assert true == pytest.approx(forces.torque, rel=0.1), "that of the last time step, a tenth of a millisecond before"


def test_looking_at_the_true_friction_changes_nothing():
    runs = []
    for look in (False, True):
        env = gym.make("GmsMujoco/ServoTracking-v0").unwrapped
        env.reset(seed=0)
        for _ in range(50):
            env.step(np.array([0.1]))
            assert not look or env.friction < 0
        runs.append(env.axes.position[0])
    assert runs[0] == runs[1]


@pytest.mark.parametrize("task", ["slow_sine", "reversals"])
def test_the_gms_observer_beats_plain_feedforward_fivefold_and_nears_the_oracle(task):
    plain, observer, oracle = (
        compensate.errors(compensate.CONTROLLERS[name], task, 1.0, 2, steps=800).mean() / COUNT
        for name in ("PID + feedforward", "PID + GMS observer", "oracle")
    )
    assert observer < plain / 5, f"{observer:.2f} and {plain:.2f} counts"
    assert observer < 1.5 * oracle, f"{observer:.2f} and {oracle:.2f} counts"


def test_every_controller_of_the_example_follows_with_a_model_that_is_off():
    for name, make in compensate.CONTROLLERS.items():
        assert compensate.errors(make, "reversals", 1.2, 1, steps=300)[0] < 100 * COUNT, name


def test_a_lugre_observer_needs_lugre():
    lugre = gms.effects.LuGre(stiffness=1.0, damping=1e-4, coulomb=4e-3, static=4e-3, stribeck_velocity=0.1)
    plant = Plant.axis(J) + lugre
    observer = control.LuGreObserver(plant, H)
    for k in range(200):
        torque = observer(observation(position=1e-4 * k, reference=1e-4 * k, ahead=1e-4 * (k + 1)))
    assert torque == pytest.approx(4e-3, rel=0.05), "it slides"
    with pytest.raises(gms.ModelError, match=r"needs a plant with lugre; \['gms', 'viscous'\]"):
        control.LuGreObserver(PLANT, H)


def axis_under(controller, load, seconds=1.0):
    """Positions of a frictionless axis that a controller holds against a constant torque."""
    q = v = torque = 0.0
    last, out = 0.0, []
    for _ in range(round(seconds / H)):
        seen = observation(position=q, error=-q, speed=(q - last) / H, torque=torque)
        last = q
        torque = float(controller(seen))
        a = (torque + load) / J
        q, v = q + H * v + H**2 / 2 * a, v + H * a
        out.append(q)
    return np.array(out)


@pytest.mark.parametrize("observer", [80.0, 150.0])
def test_active_disturbance_rejection_takes_a_constant_load_off(observer):
    controller = control.ADRC(J, H, 30.0, observer)
    q = axis_under(controller, -1e-3)
    assert np.abs(q).max() > 1e-5 and abs(q[-1]) < 1e-3 * np.abs(q).max()
    assert controller.state[2] * J == pytest.approx(-1e-3, rel=1e-3)


def test_learning_from_repetition_lowers_the_error_from_trial_to_trial():
    options = {"num_envs": 1, "tasks": ["reversals"], "split": "test", "episode_steps": 600}
    envs = gym.make_vec("GmsMujoco/ServoTracking-v0", **options)
    ilc = control.ILC(lambda: control.PID(PLANT.inertia, H, 50.0), H)
    found = [control.follow(envs, [ilc if trial == 0 else ilc.again()], episodes=[3]).rms()[0] for trial in range(5)]
    assert found[4] < found[0] / 3 and found[4] < found[2] < found[1] < found[0], found


def test_following_many_axes_is_following_each_alone():
    options = {"tasks": ["slow_sine"], "split": "test", "episode_steps": 100}
    many = gym.make_vec("GmsMujoco/ServoTracking-v0", num_envs=3, **options)
    trace = control.follow(many, lambda k: control.PID(PLANT.inertia, H), episodes=[4, 5, 6])
    assert trace.error.shape == (100, 3) and trace.cost > 0 and not trace.ended.any()
    env = gym.make("GmsMujoco/ServoTracking-v0", **options).unwrapped
    seen, _ = env.reset(options={"episode": 5})
    pid = control.PID(PLANT.inertia, H)
    for step in range(100):
        seen, *_, info = env.step(np.array([pid(seen) / env.axes.torque_limit]))
        assert trace.error[step, 1] == info["error"] and trace.position[step, 1] == info["position"]


def test_an_axis_may_follow_its_episode_with_another_plant():
    envs = gym.make_vec("GmsMujoco/ServoTracking-v0", num_envs=2, spread=1.0, split="test", episode_steps=50)
    slippery = PLANT.replace(PLANT["gms"].replace(coulomb=1e-9, static=1e-9))
    runs = [
        control.follow(envs, lambda k: control.Feedforward(PLANT.inertia), episodes=[1, 1], prepare=prepare)
        for prepare in (None, lambda axes: axes.exchange(1, slippery))
    ]
    with pytest.raises(gms.ModelError, match="another plant needs the effects gms with 8, viscous with 1 elements"):
        envs.unwrapped.axes.exchange(0, Plant.axis(J))
    np.testing.assert_array_equal(runs[0].reference, runs[1].reference)
    np.testing.assert_array_equal(runs[0].position[:, 0], runs[1].position[:, 0])
    assert not np.array_equal(runs[0].position[:, 1], runs[1].position[:, 1])


def away(k: int):
    """A controller that runs away."""
    return lambda seen: 1.0


def pid(k: int):
    return control.PID(PLANT.inertia, H)


def test_the_last_sample_is_of_the_episode_that_ends_whenever_the_next_one_begins():
    options = {"num_envs": 3, "episode_steps": 30}
    traces = [
        control.follow(gym.make_vec("GmsMujoco/ServoTracking-v0", autoreset_mode=mode, **options), pid, seed=5)
        for mode in ("NextStep", "SameStep")
    ]
    for name in ("reference", "position", "reading", "torque"):
        np.testing.assert_array_equal(*(getattr(t, name) for t in traces))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_nothing_is_told_of_an_axis_once_it_has_run_away(mode):
    envs = gym.make_vec("GmsMujoco/ServoTracking-v0", num_envs=2, episode_steps=600, autoreset_mode=mode)
    trace = control.follow(envs, lambda k: away(k) if k else pid(k), seed=3)
    assert trace.ended.tolist() == [False, True] and trace.rms()[1] == np.inf > trace.rms()[0]
    last = np.isfinite(trace.error[:, 1]).sum() - 1
    assert 0 < last < 599 and np.isfinite(trace.error[:, 0]).all()
    assert abs(trace.error[last, 1]) > envs.unwrapped.task.most > np.abs(trace.error[:last, 1]).max()
    for rows in (trace.reference, trace.position, trace.reading, trace.torque):
        assert np.isnan(rows[last + 1 :, 1]).all()


@pytest.mark.parametrize(
    ("made", "make", "message"),
    [
        ({}, [pid(0)], "one controller for each of 2 axes is expected; 1 given"),
        ({}, [pid(0)] * 3, "one controller for each of 2 axes is expected; 3 given"),
        ({}, pid(0), "a controller of its own"),
        ({}, lambda k: lambda seen: float("nan"), "a finite number, torque over its limit; nan given for axis 0"),
        ({}, lambda k: lambda seen: None, "a finite number, torque over its limit; nan given for axis 0"),
        ({}, lambda k: 0.5 * (control.Feedforward(1.0) + control.GMSObserver(PLANT, 1e-3)), "for samples of 0.001 s"),
        ({"vectorization_mode": "sync"}, pid, "a vector ServoTracking is expected.*SyncVectorEnv given"),
        ({"id": "GmsMujoco/ServoExcitation-v0"}, pid, "a vector ServoTracking is expected.*ServoExcitationVector"),
    ],
)
def test_what_cannot_follow_is_refused_in_one_line(made, make, message):
    envs = gym.make_vec(**{"id": "GmsMujoco/ServoTracking-v0", "num_envs": 2, "episode_steps": 5} | made)
    with pytest.raises(gms.ModelError, match=message) as error:
        control.follow(envs, make, seed=0)
    assert "\n" not in str(error.value)


def test_a_single_environment_follows_nothing():
    with pytest.raises(gms.ModelError, match="a vector ServoTracking is expected"):
        control.follow(gym.make("GmsMujoco/ServoTracking-v0"), [pid(0)])
