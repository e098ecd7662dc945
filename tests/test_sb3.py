"""stable-baselines3 takes the native vector environments."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="pip install 'gms-mujoco[rl]'")

from stable_baselines3 import PPO, SAC

from gms_mujoco.control import follow
from gms_mujoco.errors import ModelError
from gms_mujoco.sb3 import Compensation, Learned, SB3Vector

ID = "GmsMujoco/ServoTracking-v0"


def made(n=3, steps=20, **options):
    return SB3Vector(gym.make_vec(ID, num_envs=n, episode_steps=steps, autoreset_mode="SameStep", **options))


def test_it_steps_as_the_environment_does_and_tells_the_last_observation():
    ours, theirs = made(), gym.make_vec(ID, num_envs=3, episode_steps=20, autoreset_mode="SameStep")
    ours.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset(seed=5)[0])
    rng = np.random.default_rng(0)
    for k in range(40):
        a = rng.uniform(-0.2, 0.2, (3, 1)).astype(np.float32)
        seen, reward, ended, infos = ours.step(a)
        o, r, _, t, info = theirs.step(a)
        np.testing.assert_array_equal(seen, o)
        np.testing.assert_allclose(reward, r, rtol=1e-6)
        assert ended.tolist() == t.tolist() == [k % 20 == 19] * 3
        last = info["final_info"] if ended.any() else info
        np.testing.assert_array_equal([i["error"] for i in infos], last["error"])
        if ended.any():
            assert infos[1]["TimeLimit.truncated"]
            np.testing.assert_array_equal(infos[1]["terminal_observation"], info["final_obs"][1])


def test_options_are_those_of_the_next_reset():
    envs = made(3, split="test")
    envs.set_options({"episode": 5})
    first = envs.reset()
    np.testing.assert_array_equal(first, envs.envs.reset(options={"episode": 5})[0])
    envs.set_options([{"episode": 5}, {"episode": 6}, {}])
    np.testing.assert_array_equal(envs.reset()[0], first[0])
    envs.set_options({"task": "reversals"})
    with pytest.raises(ModelError, match="reset has no option 'task'"):
        envs.reset()


def test_what_is_no_native_vector_of_its_kind_is_refused():
    with pytest.raises(ModelError, match="SameStep"):
        SB3Vector(gym.make_vec(ID, num_envs=2))
    with pytest.raises(ModelError, match="a vector ServoTracking or ServoExcitation is expected"):
        SB3Vector(gym.make(ID))
    other = gym.make_vec("GmsMujoco/ServoExcitation-v0", num_envs=2, autoreset_mode="SameStep")
    with pytest.raises(ModelError, match="a vector ServoTracking is expected"):
        Compensation(SB3Vector(other))


@pytest.mark.parametrize("bandwidth", [None, 50.0])
def test_a_policy_acts_the_same_in_training_and_as_a_controller(bandwidth):
    envs = Compensation(made(2, steps=30, split="test"), bandwidth)
    seen = envs.reset()
    assert seen.shape == (2, 15) and np.abs(seen).max() <= 10
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=16, seed=0, device="cpu")
    envs.seed(3)
    seen, torques = envs.reset(), []
    for _ in range(45):  # into the second episode
        action, _ = model.predict(seen, deterministic=True)
        seen, _, ended, infos = envs.step(action)
        torques.append(envs.axes.torque.copy())
        for i in np.flatnonzero(ended):
            assert infos[i]["terminal_observation"].shape == (15,)
    plain = gym.make_vec(ID, num_envs=2, episode_steps=30, split="test")
    trace = follow(plain, lambda k: Learned(model, plain.unwrapped.axes, bandwidth), seed=3)
    # after the last sample of an episode the next one has begun already
    np.testing.assert_allclose(trace.torque[:29], np.array(torques)[:29], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("kind", [PPO, SAC])
def test_ppo_and_sac_learn_on_it(kind):
    envs = Compensation(made(4))
    options = {"n_steps": 16, "batch_size": 32} if kind is PPO else {"learning_starts": 20, "batch_size": 16}
    model = kind("MlpPolicy", envs, seed=0, device="cpu", **options).learn(128)
    assert model.num_timesteps >= 128
