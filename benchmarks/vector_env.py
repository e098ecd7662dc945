"""Throughput of the servo environment: env-steps per second of Gymnasium's Sync and Async and of ours.

A step is one servo sample: five time steps of MuJoCo with eight friction elements. Random torques; episodes end and
begin as they would in training. The three take turns in short rounds; the figure is the median over the rounds. Async
has a process for each environment and is left out above 64.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/vector_env.py [largest size] [seconds per figure]
"""

import statistics
import time

import gymnasium as gym
import numpy as np
from arguments import arguments

import gms_mujoco as gms

ID = "GmsMujoco/ServoTracking-v0"
MODES = {"Sync": "sync", "Async": "async", "ours": "vector_entry_point"}
ROUNDS = 3
LARGEST_ASYNC = 64  # processes


def rate(env: gym.vector.VectorEnv, seconds: float) -> float:
    """Env-steps per second."""
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (64, env.num_envs, 1)).astype(np.float32)
    steps, start = 0, time.perf_counter()
    while True:
        env.step(actions[steps % 64])
        steps += 1
        spent = time.perf_counter() - start
        if spent > seconds:
            return steps * env.num_envs / spent


def main(largest: int, seconds: float) -> None:
    print(f"env-steps/s, median of {ROUNDS} rounds; {ID} with its defaults, gms_mujoco {gms.__version__}")
    print(f"{'size':>6s}" + "".join(f"{m:>12s}" for m in MODES) + f"{'ours over the better one':>28s}")
    size = 1
    while size <= largest:
        envs = {}
        for name, mode in MODES.items():
            if name != "Async" or size <= LARGEST_ASYNC:
                envs[name] = gym.make_vec(ID, num_envs=size, vectorization_mode=mode)
                envs[name].reset(seed=0)
        found: dict[str, list[float]] = {name: [] for name in envs}
        for _ in range(ROUNDS):
            for name, env in envs.items():
                found[name].append(rate(env, seconds / ROUNDS))
        for env in envs.values():
            env.close()
        rates = {name: statistics.median(r) for name, r in found.items()}
        cells = "".join(f"{rates[m]:12.0f}" if m in rates else f"{'-':>12s}" for m in MODES)
        print(f"{size:6d}{cells}{rates['ours'] / max(v for k, v in rates.items() if k != 'ours'):28.2f}", flush=True)
        size *= 4


if __name__ == "__main__":
    main(**arguments(__doc__, largest=4096, seconds=1.0))
