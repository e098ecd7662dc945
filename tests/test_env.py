"""The servo environments keep Gymnasium's contract and their own: bit-equal, reproducible, restorable."""

import dataclasses
import math
import os
import pickle
import warnings

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from axes import J
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import gms_mujoco as gms
from gms_mujoco import env as environments
from gms_mujoco.errors import ModelError
from gms_mujoco.files import MODELS
from gms_mujoco.plant import Plant
from gms_mujoco.servo import Axes
from gms_mujoco.tasks import N_EPISODES, TASKS, Scale, draw, scale_of, scatter

IDS = ("GmsMujoco/ServoTracking-v0", "GmsMujoco/ServoExcitation-v0")
COUNT = 2 * math.pi / 1e6
ARM = MODELS / "arm.xml"


def actions(n: int, steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.3, 0.3, (steps, n, 1)).astype(np.float32)


def play(env, moves):
    return [env.step(a) for a in moves]


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize(
    "options",
    [{}, {"plant": "arm_joint", "model": ARM, "joint": "elbow"}, {"memory": "random", "split": "held_out_friction"}],
    ids=["axis", "joint of a model", "history"],
)
def test_check_env_has_nothing_to_say(id, options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(id, **options)
        check_env(env.unwrapped, skip_render_check=True)
        env.close()


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("n", [1, 3])
def test_the_vector_environment_is_the_single_one_to_the_last_bit_over_episodes(id, n):
    options = {"num_envs": n, "episode_steps": 60}
    ours, theirs = gym.make_vec(id, **options), gym.make_vec(id, vectorization_mode="sync", **options)
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    assert ours.observation_space == theirs.observation_space and ours.action_space == theirs.action_space
    rows = [[env.reset(seed=7), *play(env, actions(n, 150))] for env in (ours, theirs)]
    for a, b in zip(*rows, strict=True):
        for x, y in zip(a[:-1], b[:-1], strict=True):
            np.testing.assert_array_equal(x, y)
            assert x.dtype == y.dtype
        for key in b[-1]:
            np.testing.assert_array_equal(a[-1][key], b[-1][key])
    assert sum(r[3].sum() for r in rows[0][1:]) == 2 * n, "two episodes ended by time"


@pytest.mark.parametrize("id", IDS)
def test_a_state_restores_physics_friction_task_and_random_numbers(id):
    env, other = (gym.make(id, episode_steps=80).unwrapped for _ in range(2))
    env.reset(seed=3)
    moves = actions(1, 120)[:, 0]
    play(env, moves[:40])
    kept = env.get_state()

    def onward(e):
        return [*play(e, moves[40:]), e.reset(), *play(e, moves[:5])]

    first = onward(env)
    env.set_state(kept)
    other.set_state(kept)
    for e in (env, other):
        for a, b in zip(first, onward(e), strict=True):
            np.testing.assert_array_equal(a[0], b[0])
            assert a[1:] == b[1:]


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: gym.make(IDS[1], episode_steps=20), "another environment ServoExcitation, here ServoTracking"),
        (lambda: gym.make(IDS[0], episode_steps=30), "another episode_steps 30, here 20"),
        (lambda: gym.make(IDS[0], episode_steps=20, rate=500.0, torque_limit=1.0), "sample_time 0.002.*torque_limit"),
        (lambda: gym.make(IDS[0], episode_steps=20, plant=Plant.axis(J)), "another plant; another torque_limit"),
        (lambda: gym.make_vec(IDS[0], num_envs=1, episode_steps=20), "another environment ServoTrackingVector"),
    ],
)  # fmt: skip
def test_a_state_of_another_environment_is_refused_and_changes_nothing(made, message):
    env, other = gym.make(IDS[0], episode_steps=20).unwrapped, made().unwrapped
    env.reset(seed=0)
    other.reset(seed=1)
    play(env, actions(1, 5)[:, 0])
    kept, place = env.get_state(), env.axes.position[0]
    with pytest.raises(ModelError, match=message) as error:
        env.set_state(other.get_state())
    assert "\n" not in str(error.value)
    for nothing in (None, {}, kept["axis"]):
        with pytest.raises(ModelError, match="a state of get_state is expected"):
            env.set_state(nothing)
    assert env.axes.position[0] == place and env.axes.step_number[0] == 5
    few, many = (gym.make_vec(IDS[0], num_envs=n).unwrapped for n in (2, 3))
    for envs in (few, many):
        envs.reset(seed=0)
    with pytest.raises(ModelError, match="another num_envs 3, here 2"):
        few.set_state(many.get_state())


@pytest.mark.parametrize("make", [lambda: gym.make(IDS[0]), lambda: gym.make_vec(IDS[0], num_envs=2)])
def test_without_an_episode_there_is_no_step(make):
    env = make().unwrapped
    with pytest.raises(ModelError, match="reset the environment first"):
        env.step(np.zeros(env.action_space.shape))


def test_a_vector_state_restores_too():
    env = gym.make_vec(IDS[0], num_envs=2, episode_steps=30).unwrapped
    env.reset(seed=1)
    moves = actions(2, 80)
    play(env, moves[:29])
    kept = env.get_state()
    first = play(env, moves[29:])
    env.set_state(kept)
    for a, b in zip(first, play(env, moves[29:]), strict=True):
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x, y)


def test_a_state_holds_the_forces_of_the_elements():
    """In pre-sliding the friction remembers where the axis came from: the same place, another torque."""
    axes = Axes(spread=1.0)
    axes.reset([0], [np.random.default_rng(0)])
    for _ in range(40):
        axes.step(np.array([0.05]))
    assert abs(axes.friction()) > 0.1 * axes.scale.level
    fresh = Axes(spread=1.0)
    fresh.set_state(0, axes.get_state(0))
    assert fresh.friction() == axes.friction()


def test_seeds_repeat_and_differ():
    env = gym.make(IDS[0])
    a, b, c = (env.reset(seed=s)[0] for s in (4, 4, 5))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_a_step_is_one_held_sample_of_the_plug_in_on_a_bare_axis():
    plant = Plant.load(MODELS / "servo_axis.toml")
    env = gym.make(IDS[1], plant=plant, spread=1.0).unwrapped
    env.reset(seed=0)
    moves = actions(1, 100)[:, 0]
    true = [r[4]["position"] for r in play(env, moves)]
    start = env.axes.start[0]
    torque = np.repeat(np.append(moves, 0).astype(float) * env.axes.torque_limit, 5)
    motion = plant.joint().simulate(J, 1e-4, torque, position=start)
    np.testing.assert_array_equal(true, motion.position[5:501:5])


def test_the_encoder_reads_whole_counts_and_the_drive_has_a_limit():
    env = gym.make(IDS[0], torque_limit=0.02).unwrapped
    env.reset(seed=0)
    for a in (5.0, -5.0, 0.25):
        observation, *_, info = env.step(np.array([a]))
        counts = observation[0] / COUNT
        assert abs(counts - round(counts)) < 1e-6 and abs(observation[0] - info["position"]) <= 0.501 * COUNT
        assert observation[7] == 0.02 * np.clip(a, -1, 1)


def test_observations_are_what_the_documentation_says():
    env = gym.make(IDS[0]).unwrapped
    old, _ = env.reset(seed=2)
    reference = env.axes.reference[0]
    assert old[0] == pytest.approx(old[1], abs=1e-12) and old[5] == 0 and old[6] == 0
    new, reward, *_, info = env.step(np.array([0.1]))
    np.testing.assert_array_equal(new[1:4], reference[1])
    assert new[4] == reference[2, 0] and old[4] == new[1]
    assert new[5] == new[1] - new[0] and new[6] == pytest.approx((new[0] - old[0]) * 2000)
    w = env.task.error_scale
    assert info["error"] == new[1] - info["position"] and reward == w / (w + abs(info["error"]))


def test_behind_an_encoder_that_is_off_centre_an_axis_begins_where_it_should_be():
    plant = Plant.load("servo_axis") + gms.effects.EncoderEccentricity(amplitude=0.05, phase=0.3)
    env = gym.make(IDS[0], plant=plant).unwrapped
    for seed in range(3):
        seen, info = env.reset(seed=seed)
        assert seen[0] == seen[1] and seen[5] == 0 and abs(info["error"]) <= COUNT / 2
        assert abs(seen[0] - info["position"]) > 1e-4, "the encoder itself is off"
        seen, reward, *_, info = env.step(np.zeros(1))
        assert reward == env.task.error_scale / (env.task.error_scale + abs(info["error"])) > 0.9


@pytest.mark.parametrize("resolution", [1e-3, None])
@pytest.mark.parametrize("amplitude", [0.0, 0.05])
def test_the_position_since_the_start_begins_at_zero_and_goes_in_whole_counts(resolution, amplitude):
    plant = Plant.load("servo_axis") + gms.effects.EncoderEccentricity(amplitude=amplitude, phase=0.3)
    env = gym.make(IDS[1], plant=plant, resolution=resolution).unwrapped
    for seed in range(3):
        assert env.reset(seed=seed)[0][0] == 0
        counts = play(env, np.full((40, 1), 0.2))[-1][0][0] / env.axes.resolution
        assert abs(counts) > 1 and abs(counts - round(counts)) < 1e-6


@pytest.mark.parametrize("task", list(TASKS))
@pytest.mark.parametrize("rate", [2000, 100])
def test_what_is_observed_of_the_reference_is_never_clipped(task, rate):
    env = environments.ServoTracking(tasks=task, episode_steps=30 * rate, rate=rate, substeps=2000 // rate)
    for seed in range(3):
        env.reset(seed=seed)
        assert (np.abs(env.axes.reference[0]).max(axis=0) < env.task.bounds[1:4]).all()


@pytest.mark.parametrize("id", IDS)
def test_running_away_terminates(id):
    env = gym.make(id)
    env.reset(seed=0)
    for _ in range(1500):
        _, _, terminated, truncated, _ = env.step(np.array([1.0]))
        if terminated:
            break
    assert terminated and not truncated


def test_fixed_splits_are_the_same_for_everybody_and_held_out_friction_lies_outside():
    plant = Plant.load(MODELS / "servo_axis.toml")
    nominal = plant["gms"].coulomb
    for split in ("test", "held_out_friction"):
        env = gym.make(IDS[0], split=split).unwrapped
        first, _ = env.reset(seed=0, options={"episode": 5})
        again, _ = env.reset(seed=99, options={"episode": 5})
        np.testing.assert_array_equal(first, again)
    factors = {}
    for split in ("train", "test", "held_out_friction"):
        axes = Axes(split=split)
        drawn = [axes._draw(np.random.default_rng(i), None).plant["gms"] for i in range(40)]
        factors[split] = np.array([abs(np.log(g.coulomb / nominal)) / np.log(1.4) for g in drawn])
        assert np.allclose([g.static / g.coulomb for g in drawn], plant["gms"].static / nominal)
    assert factors["train"].max() <= 1 and factors["test"].max() <= 1
    assert factors["held_out_friction"].min() >= 1 and factors["held_out_friction"].max() <= 2
    envs = gym.make_vec(IDS[0], num_envs=3, split="test")
    o, _ = envs.reset(options={"episode": [5, 6, 5]})
    np.testing.assert_array_equal(o[0], o[2])


def test_spread_of_one_keeps_the_friction():
    plant = Plant.load(MODELS / "servo_axis.toml")
    assert scatter(plant, np.random.default_rng(0), 1.0) == plant
    assert scatter(plant, np.random.default_rng(0), 1.2) != plant


def test_other_friction_comes_back_as_often_in_a_revolution():
    varies = gms.effects.PositionDependentFriction(harmonics=[1, 3], amplitude=[0.1, 0.2], phase=[0.3, 0.4])
    drawn = scatter(Plant.load(MODELS / "servo_axis.toml") + varies, np.random.default_rng(0), 1.5)
    assert drawn["position_dependent_friction"].values["harmonics"] == (1, 3)


@pytest.mark.parametrize("task", list(TASKS))
def test_references_are_smooth_start_at_rest_and_stay_in_their_range(task):
    plant = Plant.load(MODELS / "servo_axis.toml")
    scale = scale_of(plant, COUNT)
    h = 5e-4
    for seed in range(8):
        r = draw(plant, scale, np.random.default_rng(seed), 1002, h, (task,), 1.4).reference
        assert r.shape == (1002, 3) and r[0, 1] == 0
        assert np.abs(r[:, 2]).max() <= 1.001 * scale.acceleration
        np.testing.assert_allclose(np.diff(r[:, 0]), h * (r[1:, 1] + r[:-1, 1]) / 2, atol=1e-3 * np.ptp(r[:, 0]))
        if task == "slow_sine":
            assert 0.09 < np.ptp(r[:, 0]) / scale.breakaway < 2.01


def test_scales_come_from_the_friction():
    plant = Plant.axis(J) + gms.effects.Coulomb(coulomb=4e-3) + gms.effects.Cogging(harmonics=[8], amplitude=[1.0])
    assert scale_of(plant, COUNT) == Scale(4e-3, 50 * COUNT, pytest.approx(3 * 4e-3 / J))
    assert scale_of(Plant.axis(J), COUNT).level > 0


@pytest.mark.parametrize(
    "plant",
    [
        Plant.axis(0.5, kind="slide") + gms.effects.Coulomb(coulomb=2.0),
        Plant.axis(J) + gms.effects.Viscous(coefficient=1e-4),
        Plant.axis(J) + gms.effects.FlexibleCoupling(inertia=1e-5, frequency=80.0) + gms.effects.Coulomb(coulomb=4e-3),
        Plant.axis(J) + gms.effects.EncoderEccentricity(amplitude=1e-3) + gms.effects.Coulomb(coulomb=4e-3),
    ],
    ids=["slide", "viscous", "coupling", "eccentric"],
)
def test_any_plant_runs(plant):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for id in IDS:
            env = gym.make(id, plant=plant)
            observation, _ = env.reset(seed=0)
            for a in actions(1, 20)[:, 0]:
                observation, reward, *_ = env.step(a)
            assert observation in env.observation_space and math.isfinite(reward)


def test_a_joint_of_a_model_has_its_inertia_and_weight():
    env = gym.make(IDS[0], plant="arm_joint", model=ARM, joint="elbow", spread=1.0).unwrapped
    full = mujoco.MjModel.from_xml_path(str(ARM))
    data = mujoco.MjData(full)
    mujoco.mj_forward(full, data)
    mass = np.zeros((full.nv, full.nv))
    mujoco.mj_fullM(full, data, mass)
    elbow = full.joint("elbow").dofadr[0]
    assert env.axes.plant.inertia == pytest.approx(mass[elbow, elbow])
    observation, _ = env.reset(seed=0)
    assert observation[0] == 0.0, "where the model begins"
    arm = sum(full.body(b).mass[0] for b in ("forearm", "forearm_roll", "wrist", "hand")) * 9.81
    assert 0.1 * arm < env.axes.torque_limit - 10 * env.axes.scale.level < 0.5 * arm, "the drive can carry the arm"
    axes = Axes(plant="arm_joint", model=ARM, joint="elbow", spread=1.0, torque_limit=100.0)
    axes.reset([0], [np.random.default_rng(0)])
    for _ in range(40):
        axes.step(np.array([1.0]))
    # The same joint in the whole model, the others held by an inertia that nothing here moves.
    spec = mujoco.MjSpec.from_file(str(ARM))
    for j in spec.joints:
        if j.name != "elbow":
            j.armature = 1e12
    Plant.load(MODELS / "arm_joint.toml").attach(spec, "elbow")
    spec.option.timestep = 1e-4
    whole = spec.compile()
    data = mujoco.MjData(whole)
    data.ctrl[whole.actuator("elbow").id] = 100.0
    mujoco.mj_step(whole, data, 200)
    assert axes.position[0] > 1e-2
    assert axes.position[0] == pytest.approx(data.qpos[whole.joint("elbow").qposadr[0]], rel=1e-6)


@pytest.mark.parametrize("joints", ["*", "elbow", "wrist_flex"])
@pytest.mark.parametrize("form", ["spec", "text", "file"])
def test_friction_that_the_robot_has_already_makes_no_difference(joints, form, tmp_path):
    arm = Plant.load("arm_joint")
    spec = gms.attach(ARM, {joints: arm}, sensors=["torque"])
    (tmp_path / "arm.xml").write_text(spec.to_xml())
    model = {"spec": spec, "text": spec.to_xml(), "file": tmp_path / "arm.xml"}[form]
    found = [
        play(env, actions(1, 20)[:, 0])[-1][0]
        for env in (gym.make(IDS[0], plant=arm, model=m, joint="elbow").unwrapped for m in (ARM, model))
        if env.reset(seed=0)
    ]
    np.testing.assert_allclose(*found, rtol=1e-6)  # numbers of an MJCF text have fewer digits
    assert spec.compile().nplugin, "the robot of the user stays as it is"


def test_a_mechanism_that_cannot_be_is_told_in_one_line(tmp_path):
    body = '<mujoco>{}<worldbody><body><joint name="j"/>{}</body></worldbody></mujoco>'
    mesh = body.format('<asset><mesh name="m" file="nope.stl"/></asset>', '<geom type="mesh" mesh="m"/>')
    heavy = gms.effects.FlexibleCoupling(inertia=J, frequency=80.0)
    axis = Plant.load("servo_axis")
    for options, message in (
        ({"model": body.format("", ""), "joint": "j"}, "does not compile: .*mass and inertia"),
        ({"model": mesh, "joint": "j"}, "does not compile: .*nope.stl"),
        ({"plant": axis + heavy}, "flexible_coupling must have less inertia than the axis"),
        ({"plant": dataclasses.replace(axis, inertia=1e-300)}, "does not compile: .*mass and inertia"),
    ):
        with pytest.raises(ModelError, match=message) as error:
            environments.ServoTracking(**options)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("share", [1 / 3, 0.7, 1 / 7])
def test_a_load_of_an_axis_is_taken_off_without_a_warning(share):
    coupling = gms.effects.FlexibleCoupling(inertia=share * J, frequency=80.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environments.ServoTracking(plant=Plant.axis(J) + gms.effects.Coulomb(coulomb=4e-3) + coupling)


def test_random_memory_begins_at_rest_with_elements_loaded_against_each_other():
    plant = Plant.load(MODELS / "servo_axis.toml")
    found = []
    for seed in range(3):
        axes = Axes(memory="random", spread=1.0)
        axes.reset([0], [np.random.default_rng(seed)])
        start = axes.position[0]
        forces = gms.friction(axes.models[0], axes.batch.get_data(0), "shaft")
        state = forces.states["gms"][::2]
        assert np.abs(state).sum() > 0.1 * plant["gms"].coulomb
        assert abs(state.sum()) < 0.02 * np.abs(state).sum(), "at rest they sum to nothing"
        for _ in range(100):
            axes.step(np.zeros(1))
        assert abs(axes.position[0] - start) < 0.05 * axes.scale.breakaway
        found.append(state)
    assert not np.allclose(found[0], found[1])
    one, many = Axes(memory="random"), Axes(3, memory="random")
    one.reset([0], [np.random.default_rng(5)])
    many.reset(range(3), [np.random.default_rng(k) for k in (4, 5, 6)])
    for _ in range(20):
        one.step(np.full(1, 0.1))
        many.step(np.full(3, 0.1))
    assert one.position[0] == many.position[1] != many.position[0]


def pendulum(mass: float, more: str = "") -> str:
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body>'
        f'<joint name="j" axis="0 1 0" {more}/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="{mass}"/>'
        "</body></worldbody></mujoco>"
    )


@pytest.mark.parametrize(
    "options",
    [
        {"plant": (gms.effects.FlexibleCoupling(inertia=8e-6, frequency=20.0, damping=0.02),)},
        {"plant": (gms.effects.Backlash(inertia=8e-6, gap=1e-3, frequency=100.0, damping=0.1),)},
        {"plant": (gms.effects.Gravity(amplitude=2e-3, phase=0.3),)},
        {"plant": (gms.effects.Spring(stiffness=1e-2, preload=1e-3),)},
        {"plant": (gms.effects.ThermalDrift(amplitude=-0.5, time_constant=10.0),)},
        {"plant": "arm_joint", "model": ARM, "joint": "elbow"},
        {"plant": "arm_joint", "model": pendulum(2.0), "joint": "j"},
        {"plant": "arm_joint", "model": pendulum(0.5, 'stiffness="3" springref="0.5"'), "joint": "j"},
    ],
    ids=["soft coupling", "backlash", "gravity", "spring", "heat", "arm", "weight", "spring of the model"],
)
def test_random_memory_begins_at_rest_whatever_acts_on_the_axis(options):
    plant = options["plant"]
    if not isinstance(plant, str):
        options = {"plant": dataclasses.replace(p := Plant.load("servo_axis"), effects=(*p.effects, *plant))}
    axes = Axes(memory="random", spread=1.0, **options)
    for seed in range(3):
        axes.reset([0], [np.random.default_rng(seed)])
        start = axes.position[0]
        for _ in range(200):
            axes.step(np.zeros(1))
        assert abs(axes.position[0] - start) < 0.02 * axes.scale.breakaway


def test_another_plant_begins_at_rest_in_the_same_place_with_the_same_inertia():
    plant = Plant.load("servo_axis") + gms.effects.Gravity(amplitude=2e-3, phase=0.3)
    other = plant.replace(plant["gms"].replace(coulomb=5e-3, static=5.5e-3))
    axes = Axes(plant=plant, memory="random", spread=1.0)
    axes.reset([0], [np.random.default_rng(2)])
    start = axes.position[0]
    axes.exchange(0, dataclasses.replace(other, inertia=None))
    assert axes.position[0] == start
    for _ in range(200):
        axes.step(np.zeros(1))
    assert abs(axes.position[0] - start) < 0.02 * axes.scale.breakaway
    with pytest.raises(ModelError, match=r"needs the inertia of the axis, 2\.4e-05; 4\.8e-05 given"):
        axes.exchange(0, dataclasses.replace(plant, inertia=2 * J))


@pytest.mark.parametrize("limits", [(0.0, 0.05), (-0.003, 0.2), (-1.0, 0.0), (-0.5, 0.5)])
@pytest.mark.parametrize("memory", ["virgin", "random"])
def test_references_stay_in_the_range_of_the_joint(limits, memory):
    text = f'<inertial pos="0 0 0" mass=".1" diaginertia="{J} {J} {J}"/>'
    text = f'<joint name="j" axis="0 0 1" range="{limits[0]} {limits[1]}" limited="true"/>{text}'
    text = f'<mujoco><compiler angle="radian"/><worldbody><body>{text}</body></worldbody></mujoco>'
    axes = Axes(model=text, joint="j", memory=memory, episode_steps=1000)
    moved = 0
    for seed in range(12):
        axes.reset([0], [np.random.default_rng(seed)])
        r = axes.reference[0]
        assert limits[0] - COUNT <= r[:, 0].min() and r[:, 0].max() <= limits[1] + COUNT
        assert r[0, 1] == 0 and np.abs(r[:, 2]).max() <= 1.001 * axes.scale.acceleration
        np.testing.assert_allclose(np.diff(r[:, 0]), 5e-4 * (r[1:, 1] + r[:-1, 1]) / 2, atol=1e-3 * np.ptp(r[:, 0]))
        moved += np.ptp(r[:, 0]) > 0.02 * axes.scale.breakaway
    assert moved == 12


@pytest.mark.parametrize(
    ("effects", "least"),
    [
        ([gms.effects.Viscous(coefficient=1e-3)], 0.0),
        ([gms.effects.Viscous(coefficient=2.4e-3), gms.effects.Coulomb(coulomb=1e-5)], 0.0),
        ([gms.effects.QuadraticDrag(coefficient=1e-5)], 0.0),
        ([gms.effects.Coulomb(coulomb=4e-3), gms.effects.Gravity(amplitude=0.1, phase=0.3)], 0.1399),
        ([gms.effects.Coulomb(coulomb=4e-3), gms.effects.Spring(stiffness=1e-2)], 2e-2 * math.pi + 0.0399),
    ],
    ids=["drag", "drag and friction", "quadratic drag", "gravity", "spring"],
)
def test_the_drive_is_strong_enough_for_what_it_is_asked(effects, least):
    axes = Axes(plant=Plant(J, tuple(effects)), spread=1.0)
    assert axes.torque_limit >= least
    load = Plant(J, tuple(effects)).joint()
    for seed in range(20):
        axes.reset([0], [np.random.default_rng(seed)])
        q, v, a = axes.reference[0].T
        need = np.abs(J * a - load.replay(np.arange(len(q)) * 5e-4, q, v).torque).max()
        assert need < axes.torque_limit


def test_of_an_axis_whose_friction_is_dry_the_limit_is_ten_times_that():
    axes = Axes()
    assert axes.torque_limit == 10 * axes.scale.level


def test_friction_may_be_drawn_from_the_intervals_of_a_fit():
    plant = Plant.load(MODELS / "servo_axis.toml")
    intervals = {"gms.coulomb": (4e-3, 5e-3), "gms.static": (4.1e-3, 6e-3), "gms.fraction[2]": (0.02, 0.04)}
    plant = dataclasses.replace(plant, uncertainty=intervals)
    rng = np.random.default_rng(0)
    drawn = [scatter(plant, rng, "uncertainty")["gms"] for _ in range(60)]
    levels = np.array([g.coulomb for g in drawn])
    assert 4e-3 <= levels.min() < levels.max() <= 5e-3 and 1.5e-4 < levels.std() < 3e-4
    assert all(g.static >= g.coulomb and sum(g.fraction) == pytest.approx(1) for g in drawn)
    assert all(g.stiffness == plant["gms"].stiffness for g in drawn), "what has no interval stays"
    outside = [scatter(plant, rng, "uncertainty", held_out=True)["gms"].coulomb for _ in range(60)]
    further = math.sqrt(5 / 4)  # half the interval, in logarithms
    assert all(not 4e-3 < x < 5e-3 and 4e-3 / further <= x <= 5e-3 * further for x in outside)
    env = gym.make(IDS[0], plant=plant, spread="uncertainty").unwrapped
    env.reset(seed=0)
    assert 4e-3 <= env.plant["gms"].coulomb <= 5e-3


def test_threads_and_models_of_many_axes_do_not_mix():
    runs = []
    for threads in (1, 2):
        axes = Axes(12, spread=1.4, episode_steps=50, threads=threads)
        for round in range(3):  # episodes that end before their first step too
            axes.reset(range(12), [np.random.default_rng([round, k]) for k in range(12)])
        axes.reset([3], [np.random.default_rng(9)])
        for _ in range(30):
            axes.step(np.linspace(-0.2, 0.2, 12))
        runs.append(axes.position.copy())
    np.testing.assert_array_equal(*runs)
    for k in (3, 7):
        alone = Axes(1, spread=1.4, episode_steps=50)
        alone.reset([0], [np.random.default_rng(9) if k == 3 else np.random.default_rng([2, k])])
        for _ in range(30):
            alone.step(np.linspace(-0.2, 0.2, 12)[[k]])
        assert alone.position[0] == runs[0][k]


def test_an_episode_may_start_anew_in_the_same_step():
    options = {"num_envs": 3, "episode_steps": 20}
    at_once = gym.make_vec(IDS[0], autoreset_mode="SameStep", **options)
    later = gym.make_vec(IDS[0], **options)
    rows = [env.reset(seed=7)[0] for env in (at_once, later)]
    np.testing.assert_array_equal(*rows)
    for a in actions(3, 20):
        (o, _, _, t, info), (p, *_) = at_once.step(a), later.step(a)
    assert t.all() and info["_final_obs"].all()
    np.testing.assert_array_equal(np.stack(list(info["final_obs"])), p)
    np.testing.assert_array_equal(o, later.step(actions(3, 1)[0])[0])
    theirs = gym.make_vec(
        IDS[0], vectorization_mode="sync", vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}, **options
    )
    theirs.reset(seed=7)
    for a in actions(3, 20):
        q, *_, their_info = theirs.step(a)
    np.testing.assert_array_equal(o, q)
    np.testing.assert_array_equal(their_info["final_obs"][1], info["final_obs"][1])
    for key, value in their_info["final_info"].items():
        np.testing.assert_array_equal(info["final_info"][key], value)
        assert info["final_info"][key].dtype == value.dtype
    with pytest.raises(ModelError, match="autoreset_mode must be one of"):
        gym.make_vec(IDS[0], autoreset_mode="Never", num_envs=1)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.nan, "a finite number, torque over its limit; nan given for axis 0"),
        (None, "nan given for axis 0"),
        (-np.inf, "-inf given for axis 0"),
        ([0.1, 0.2, 0.3], "a number for each of 2 axes"),
        ("much", "a number for each of 2 axes; 'much' given"),
    ],
)
def test_an_action_is_a_finite_number(action, message):
    envs = gym.make_vec(IDS[0], num_envs=2).unwrapped
    envs.reset(seed=0)
    with pytest.raises(ModelError, match=message) as error:
        envs.step([[action], [0.1]] if np.ndim(action) == 0 and not isinstance(action, str) else action)
    assert "\n" not in str(error.value)
    assert not envs.axes.step_number.any(), "nothing has moved"


def test_a_plant_may_be_a_file(tmp_path):
    plant = Plant.axis(J) + gms.effects.Coulomb(coulomb=4e-3)
    plant.save(tmp_path / "model.toml")
    assert gym.make(IDS[0], plant=tmp_path / "model.toml").unwrapped.axes.plant == plant
    assert gym.make(IDS[0], plant=str(tmp_path / "model.toml")).unwrapped.axes.plant == plant


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": "no_such.toml"}, "no such file"),
        ({"plant": Plant.axis(J) + gms.effects.GMS(elements=2)}, "no value yet"),
        ({"tasks": ["waltz"]}, "no task is called 'waltz'; the tasks are micro_steps"),
        ({"tasks": []}, "at least one task"),
        ({"split": "exam"}, "split must be one of held_out_friction, test, train"),
        ({"spread": 0.5}, "spread must be at least 1"),
        ({"spread": "wide"}, "spread must be at least 1, or 'uncertainty'; 'wide' given"),
        ({"spread": "uncertainty"}, "none has one"),
        ({"memory": "short"}, "memory must be one of random, virgin"),
        ({"plant": "servo_axle"}, "plants that come with the package are .*servo_axis"),
        ({"plant": "arm_joint"}, "no value yet: inertia"),
        ({"joint": "elbow"}, "model and joint go together"),
        ({"plant": "arm_joint", "model": ARM, "joint": "knee"}, "no joint is called 'knee'; the joints are elbow"),
        ({"plant": "arm_joint", "model": "no.xml", "joint": "knee"}, "no.xml: no such file"),
        ({"plant": "sts3215"}, "a plant with position_loop takes a goal, not a torque"),
        ({"rate": "2k"}, "rate must be positive; '2k' given"),
        ({"substeps": 0}, "substeps must be a whole number from 1 on; 0 given"),
        ({"episode_steps": 20.5}, "episode_steps must be a whole number from 1 on"),
        ({"torque_limit": -1}, "torque_limit must be positive"),
        ({"render_mode": "ascii"}, "render_mode must be one of human, rgb_array"),
        ({"threads": 1.5}, "threads must be a whole number from 0 on; 1.5 given"),
        ({"threads": -3}, "threads must be a whole number from 0 on; -3 given"),
        ({"threads": "x"}, "threads must be a whole number from 0 on; 'x' given"),
        ({"plant": 3}, "a Plant, the path of a model.toml or a name out of models/ is expected; 3 given"),
        ({"rate": True}, "rate must be positive; True given"),
        ({"substeps": True}, "substeps must be a whole number"),
        ({"resolution": -1e-3}, "resolution must be positive"),
        ({"torque_limit": "x"}, "torque_limit must be positive .*; 'x' given"),
        ({"torque_limit": math.nan}, "torque_limit must be positive"),
        ({"tasks": None}, "tasks are names out of .*; None given"),
        ({"spread": None}, "spread must be at least 1, or 'uncertainty'; None given"),
        ({"spread": True}, "spread must be at least 1"),
        ({"spread": 1, "split": "held_out_friction"}, "held out of the training needs a spread above 1"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_wrong_arguments_are_refused_in_one_line(options, message):
    with pytest.raises(ModelError, match=message) as error:
        environments.ServoTracking(**options)
    assert "\n" not in str(error.value)


def test_wrong_options_of_reset_are_refused():
    env = environments.ServoTracking(split="test")
    for options, message in (
        ({"seed": 1}, "no option 'seed'; its options are episode"),
        ({"episode": N_EPISODES}, r"must be a whole number in \[0, 63\]; 64 given"),
        ({"episode": 3.7}, "whole number in .*; 3.7 given"),
        ({"episode": "3"}, "whole number in .*; '3' given"),
        ({"episode": True}, "whole number in .*; True given"),
    ):
        with pytest.raises(ModelError, match=message):
            env.reset(options=options)
    with pytest.raises(ModelError, match="options of reset are a table"):
        env.reset(options=["episode"])
    with pytest.raises(ModelError, match="no numbered episodes"):
        environments.ServoTracking().reset(options={"episode": 1})
    with pytest.raises(ModelError, match="reset the environment first"):
        environments.ServoTracking().get_state()


def test_seeds_and_episodes_of_many_axes_are_one_or_one_for_each():
    envs = gym.make_vec(IDS[0], num_envs=3, split="test")
    seeds = (4, np.int64(4), [4, 5, 6], np.array([4, 5, 6]))
    first, *others = [envs.reset(seed=s)[0] for s in seeds]
    for seen in others:
        np.testing.assert_array_equal(seen, first)
    for given in ([4, 5], np.arange(4), []):
        with pytest.raises(ModelError, match=f"one seed for each of 3 axes is expected, or one; {len(given)} given"):
            envs.reset(seed=given)
        with pytest.raises(ModelError, match=f"one episode for each of 3 axes is expected, or one; {len(given)} given"):
            envs.reset(options={"episode": given})
    with pytest.raises(ModelError, match=r"seed is a whole number, or one for each of 3 axes; 1.5 given"):
        envs.reset(seed=1.5)
    with pytest.raises(ModelError, match="num_envs must be a whole number from 1 on; 0 given"):
        gym.make_vec(IDS[0], num_envs=0)
    with pytest.raises(ModelError, match=r"whole number in .*; 1.5 given"):
        envs.reset(options={"episode": [1, 1.5, 2]})


def test_a_recorder_shows_the_axis_at_its_speed():
    for rate in (2000.0, 100.0):
        assert gym.make(IDS[0], rate=rate, render_mode="rgb_array").metadata["render_fps"] == rate


def test_information_is_the_log_determinant_of_what_the_motion_tells():
    env = environments.ServoExcitation(spread=1.0)
    env.reset(seed=0)
    total, rows, task = 0.0, [], env.task
    for a in actions(1, 80)[:, 0]:
        before = task.at.copy(), task.speed.copy()
        _, reward, *_ = env.step(a)
        total += reward
        speed = (task.at - before[0]) * 2000
        acceleration = (speed - before[1]) * 2000 / env.axes.scale.acceleration
        rows.append([*(task.stops[0] / task.widths), speed[0] / 10, acceleration[0]])
    sign, logdet = np.linalg.slogdet(np.eye(10) + np.array(rows).T @ np.array(rows))
    assert sign == 1 and total == pytest.approx(logdet, rel=1e-6)


def test_moving_tells_more_than_standing():
    env = environments.ServoExcitation()
    gains = []
    for size in (0.0, 0.5):
        env.reset(seed=0)
        gains.append(sum(r[1] for r in play(env, size * actions(1, 200)[:, 0])))
    assert gains[1] > gains[0] + 1


def test_without_a_screen_it_is_told_where_the_run_may_go(monkeypatch):
    from gms_mujoco import view
    from gms_mujoco.errors import GmsError

    def headless(*_, **__):
        raise GmsError("the viewer does not start: give a .rrd file")

    monkeypatch.setattr(view, "stream", headless)
    env = gym.make(IDS[0], render_mode="human").unwrapped
    with pytest.raises(GmsError, match=r'give a \.rrd file, as in recording = "run\.rrd"$'):
        env.reset(seed=0)


def test_a_run_is_streamed_to_rerun_with_friction_reference_and_position(tmp_path):
    from recordings import series

    env = gym.make(IDS[0], render_mode="human", recording=tmp_path / "run.rrd", episode_steps=300).unwrapped
    torques = []
    for seed in (0, 1):  # the second with another friction
        env.reset(seed=seed)
        for _ in range(200):
            env.step(np.array([0.02]))
            torques.append(env.friction)
    env.close()
    env.close()
    seen = series(tmp_path / "run.rrd")
    time, torque = seen["/friction/shaft/torque"]
    assert len(time) == 2 * (1 + 200 // 5) and np.all(np.diff(time) > 0)  # 400 looks a second, one after each reset
    np.testing.assert_allclose(torque[1:41], torques[4:200:5])
    assert {"/values/reference", "/values/position", "/robot/bodies/rotor"} <= set(seen)


def test_a_state_can_be_kept_in_a_file():
    env = environments.ServoExcitation()
    env.reset(seed=0)
    moves = actions(1, 40)[:, 0]
    play(env, moves[:20])
    kept = pickle.loads(pickle.dumps(env.get_state()))
    first = play(env, moves[20:])
    other = environments.ServoExcitation()
    other.set_state(kept)
    for a, b in zip(first, play(other, moves[20:]), strict=True):
        np.testing.assert_array_equal(a[0], b[0])


@pytest.mark.skipif(os.environ.get("MUJOCO_GL") not in ("egl", "osmesa"), reason="set MUJOCO_GL=egl or osmesa to draw")
def test_a_picture_shows_the_axis_turn():
    env = gym.make(IDS[0], render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (480, 480, 3) and first.dtype == np.uint8 and first.std() > 5
    env.axes.position[0] += 1.0
    assert not np.array_equal(first, env.render())
    env.close()
    env.close()
