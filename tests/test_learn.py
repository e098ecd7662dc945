"""The learning baseline learns, remembers as friction does, and its results can be kept."""

import json

import gymnasium as gym
import numpy as np
import pytest

from gms_mujoco import cli, learn
from gms_mujoco.control import PID, follow
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.plant import Plant

SIZES = learn.Sizes(2.4e-5, 5e-4, 4.5e-3, 4e-3)


def test_features_are_of_order_one_and_remember_like_stop_operators():
    x = np.zeros((3, 8))
    features = learn.Features(SIZES)
    assert features(x).shape == (3, len(learn.NAMES)) and not features(x).any()
    x[:, 0] = [1e-3, -1e-3, 0.5]  # measured position
    first = features(x)[:, -len(learn.WIDTHS) :]
    expected = np.clip(x[:, [0]] / (SIZES.breakaway * np.array(learn.WIDTHS)), -1, 1)
    np.testing.assert_allclose(first, expected)
    x[:, 0] = 0.0
    again = features(x)[:, -len(learn.WIDTHS) :]
    np.testing.assert_allclose(again[0, 0], max(expected[0, 0] - 1e-3 / (SIZES.breakaway * learn.WIDTHS[0]), -1))
    features.forget([1], x)
    assert not features(x)[1].any() and features(x)[0].any()
    x[:, 3] = SIZES.level / SIZES.inertia  # reference acceleration
    np.testing.assert_allclose(features(x)[:, 0], 1.0)


def test_without_weights_the_policy_is_the_pid_alone_and_many_are_as_one():
    rng = np.random.default_rng(0)
    pid, many = PID(SIZES.inertia, SIZES.sample_time, 40.0), learn.Residual(SIZES, np.zeros((3, 12)), 40.0)
    weights = rng.normal(size=12)
    one, three = learn.Residual(SIZES, weights), learn.Residual(SIZES, np.tile(weights, (3, 1)))
    for _ in range(20):
        x = 1e-3 * rng.normal(size=8)
        assert many(np.tile(x, (3, 1))) == pytest.approx([pid(x)] * 3, rel=1e-12)
        assert three(np.tile(x, (3, 1))) == pytest.approx([one(x)] * 3, rel=1e-12)


def test_a_short_training_beats_the_pid_on_its_test_split_and_is_kept(tmp_path, capsys):
    said = []
    result = learn.train(
        4, population=12, episodes=2, episode_steps=300, seed=1, tasks=["reversals", "slow_sine"],
        progress=lambda share, message: said.append(share),
    )
    assert [r.split for r in result.runs] == ["test", "held_out_friction"]
    assert result.runs[0].ratio < 0.8 and result.curve[-1, 1] < 0.8
    assert said == sorted(said) and said[-1] == 1.0
    assert result.steps == 4 * 13 * 2 * 300
    result.policy.save(tmp_path / "policy.json")
    again = learn.Residual.load(tmp_path)
    np.testing.assert_array_equal(again.weights, result.policy.weights)
    options = {"episode_steps": 300, "tasks": ["reversals", "slow_sine"], "split": "test", "num_envs": 2}
    envs = gym.make_vec("GmsMujoco/ServoTracking-v0", **options)
    trace = follow(envs, lambda k: learn.Residual.load(tmp_path), episodes=[0, 1])
    np.testing.assert_allclose(trace.rms(), result.runs[0].policy[:2], rtol=1e-6)
    np.testing.assert_allclose(trace.error[:, 0], result.traces[0] - result.traces[2], atol=1e-12)


def test_the_same_seed_trains_the_same_policy():
    runs = [learn.train(2, population=4, episodes=1, episode_steps=50, seed=3).policy.weights for _ in range(2)]
    np.testing.assert_array_equal(*runs)


def test_a_file_that_is_no_policy_is_refused(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        learn.Residual.load(tmp_path)
    (tmp_path / "policy.json").write_text('{"sizes": {}}')
    with pytest.raises(DataError, match="not a policy"):
        learn.Residual.load(tmp_path)
    learn.Residual(SIZES, np.ones(12)).save(tmp_path / "policy.json")
    right = json.loads((tmp_path / "policy.json").read_text())
    for change, message in (
        ({"schema": 7}, r"schema and kind are \(7, 'residual'\)"),
        ({"kind": "other"}, "schema and kind are"),
        ({"weights": right["weights"] | {"drag": float("nan")}}, "a weight is not finite"),
        ({"sizes": right["sizes"] | {"sample_time": -1}}, "sample_time is -1, expected a positive number"),
        ({"bandwidth": 0}, "bandwidth is 0, expected a positive number"),
    ):
        (tmp_path / "policy.json").write_text(json.dumps(right | change))
        with pytest.raises(DataError, match=message):
            learn.Residual.load(tmp_path)


def test_a_policy_is_for_the_rate_it_was_trained_at(tmp_path):
    envs = gym.make_vec("GmsMujoco/ServoTracking-v0", num_envs=1, rate=1000.0, episode_steps=5)
    with pytest.raises(ModelError, match=r"samples of 0.0005 s is given, those of the environment last 0.001 s"):
        follow(envs, lambda k: learn.Residual(SIZES, np.zeros(12)))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_training_that_runs_away_says_so_and_has_no_trace_of_what_came_after(mode, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(learn, "TEST_EPISODES", 2)
    result = learn.train(
        1, population=2, episodes=1, episode_steps=300, bandwidth=3000.0, autoreset_mode=mode, tasks="point_to_point"
    )
    assert "ran away: the PID in 2, the policy in 2 of them" in str(result)
    assert result.to_dict()["test"]["ran_away"] == {"pid": 2, "policy": 2}
    for trace in result.traces:
        there = np.isfinite(trace)
        assert 0 < there.sum() < 300 and there[: there.sum()].all()
    monkeypatch.setattr(learn, "train", lambda *_, **__: result)
    assert cli.main(["train", "-o", str(tmp_path / "policy")]) == 2
    assert "the policy runs away in every test episode" in capsys.readouterr().err
    assert (tmp_path / "policy" / "recording.rrd").is_file()


def test_the_command_writes_policy_figures_and_recording(tmp_path, capsys, monkeypatch):
    short = learn.train

    def quick(generations, **options):
        return short(generations, population=4, episodes=1, episode_steps=40, **options)

    monkeypatch.setattr(learn, "train", quick)
    monkeypatch.setattr(learn, "TEST_EPISODES", 2)
    out = tmp_path / "policy"
    assert cli.main(["train", "-o", str(out), "--generations", "2"]) == 0
    assert "below the PID" in capsys.readouterr().out
    table = json.loads((out / "training.json").read_text())
    assert len(table["curve"]) == 2 and len(table["test"]["policy"]) == 2
    assert (out / "recording.rrd").stat().st_size > 1000
    for argv in (["--plant", "no_such"], ["--seed", "-1"], ["--generations", "0"], ["--bandwidth", "nan"],
                 ["--joint", "elbow"]):
        assert cli.main(["train", "-o", str(out), *argv]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_of_one_friction_alone_none_is_held_out():
    result = learn.train(1, population=2, episodes=1, episode_steps=30, spread=1)
    assert [r.split for r in result.runs] == ["test"]


def test_it_trains_on_any_plant():
    import gms_mujoco as gms

    plant = Plant.axis(0.5, kind="slide") + gms.effects.Coulomb(coulomb=2.0)
    result = learn.train(1, population=2, episodes=1, episode_steps=30, plant=plant)
    assert np.isfinite(result.runs[0].policy).all()
