"""Friction compensation on the servo axis, from PID to an oracle: rms tracking error in pre-sliding and at reversals.

Every controller is the same PID plus what it knows of the axis. The table shows encoder counts, the mean over seeds
and its standard error; "exact": the model has the friction of the axis; "20 % off": its parameters are off by up to a
factor of 1.2, another in each episode. The beginning of each episode, in which the integrator settles, counts too.
The stiffer the PID, the less friction matters, down to the half count that the encoder cannot see.

Run: python examples/compensate.py [seeds] [bandwidth of the PID in Hz]
"""

import argparse
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from gms_mujoco import control
from gms_mujoco.plant import Plant

PLANT = Plant.load("servo_axis")
H = 1 / 2000  # s
BANDWIDTH = 50.0  # of the PID [Hz]
STEPS = 1500  # samples of an episode
Make = Callable[[Any, int], control.Controller]  # from the axes and which of them


def pid() -> control.Controller:
    return control.PID(PLANT.inertia, H, BANDWIDTH)


def plain() -> control.Controller:
    return pid() + control.Feedforward(PLANT.inertia)


def coulomb_viscous() -> control.Controller:
    viscous = PLANT["viscous"].coefficient
    level = PLANT["gms"].coulomb
    return pid() + control.Feedforward(PLANT.inertia, viscous) + control.CoulombFeedforward(level, 0.2)


CONTROLLERS: dict[str, Make] = {
    "PID": lambda axes, k: pid(),
    "PID + feedforward": lambda axes, k: plain(),
    "PID + Coulomb-viscous feedforward": lambda axes, k: coulomb_viscous(),
    "PID + disturbance observer": lambda axes, k: plain() + control.DisturbanceObserver(PLANT.inertia, H),
    "PID + GMS feedforward": lambda axes, k: plain() + control.GMSFeedforward(PLANT, H),
    "PID + GMS observer": lambda axes, k: plain() + control.GMSObserver(PLANT, H),
    "PID + GMS and disturbance observers": lambda axes, k: (
        plain() + control.DisturbanceObserver(PLANT.inertia, H, known=control.GMSObserver(PLANT, H))
    ),
    "oracle": lambda axes, k: plain() + control.Oracle(lambda: axes.friction(k)),
}


def errors(make: Make, task: str, spread: float, seeds: int, steps: int = STEPS) -> np.ndarray:
    """(seeds,) rms of the true tracking error of an episode each [rad]."""
    envs = gym.make_vec(
        "GmsMujoco/ServoTracking-v0", num_envs=seeds, plant=PLANT, tasks=[task], spread=spread, episode_steps=steps
    )
    axes = envs.unwrapped.axes
    return control.follow(envs, lambda k: make(axes, k), seed=0).rms()


def main(seeds: int = 5) -> None:
    count = 2 * np.pi / 1e6
    columns = [(t, s) for t in ("slow_sine", "reversals") for s in (1.0, 1.2)]
    print(f"rms tracking error [encoder counts], {seeds} episodes, PID of {BANDWIDTH:g} Hz")
    names = [f"{t}, {'exact' if s == 1 else '20 % off'}" for t, s in columns]
    print(f"{'':36s}" + "".join(f"{n:>23s}" for n in names))
    for name, make in CONTROLLERS.items():
        cells = [errors(make, t, s, seeds) / count for t, s in columns]
        row = (f"{e.mean():.2f} +- {e.std(ddof=1) / np.sqrt(seeds):.2f}" for e in cells)
        print(f"{name:36s}" + "".join(f"{c:>23s}" for c in row), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="?", type=int, default=5, help="episodes of each (default: 5)")
    parser.add_argument("bandwidth", nargs="?", type=float, default=BANDWIDTH, help="of the PID [Hz] (default: 50)")
    given = parser.parse_args()
    BANDWIDTH = given.bandwidth
    main(given.seeds)
