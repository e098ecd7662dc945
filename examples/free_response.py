"""The free response of a servo axis: the case study of Yoon and Trumper, Mechatronics 24 (2014), figure 2.

Two runs in MuJoCo with the axis of models/: a current pulse of 0.05 A for 70 ms, and a spin by hand with the coils
open. In both the shaft coasts against a nearly constant drag, stops, and oscillates at tens of Hz with a period that
shrinks as the amplitude falls: friction as a spring that is stiffer for smaller displacements.

Prints the figures beside the paper's. With a file name it draws them: python examples/free_response.py out.png
"""

import sys
from dataclasses import dataclass

import mujoco
import numpy as np

from gms_mujoco import engine
from gms_mujoco.files import MODELS
from gms_mujoco.plant import Plant

TORQUE_CONSTANT = 0.1916  # N m/A, from the figures of the pulse: see models/servo_axis.toml
STEP = 1e-4  # s


@dataclass(frozen=True)
class Response:
    """One free response.

    Attributes:
        time, position, velocity: (n,) [s], [rad], [rad/s].
        release: when the drive lets go [s].
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    release: float

    @property
    def turned(self) -> float:
        """Where the shaft comes to rest [rad]."""
        return float(self.position[-1])

    @property
    def peak_speed(self) -> float:
        """[rad/s]"""
        return float(self.velocity.max())

    @property
    def drag(self) -> np.ndarray:
        """Deceleration while the shaft coasts at more than a fifth of its peak speed [rad/s^2]."""
        coasting = (self.time > self.release) & (self.velocity > 0.2 * self.peak_speed)
        return -np.diff(self.velocity[coasting]) / STEP

    @property
    def frequencies(self) -> np.ndarray:
        """Frequency of each half period of the oscillation at rest, in order [Hz]."""
        late = self.time > self.release
        v, t = self.velocity[late], self.time[late]
        k = np.flatnonzero(v[:-1] * v[1:] < 0)
        crossing = t[k] - v[k] * STEP / (v[k + 1] - v[k])
        return 0.5 / np.diff(crossing)[:8]


def run(torque: np.ndarray, release: float) -> Response:
    """The axis with its friction under (n,) torque [N m], one value per time step."""
    plant = Plant.load(MODELS / "servo_axis.toml")
    spec = engine.attach(MODELS / "servo_axis.xml", {"shaft": plant})
    spec.option.timestep = STEP
    model = spec.compile()
    data = mujoco.MjData(model)
    rows = []
    for u in torque:
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        rows.append((data.time, data.qpos[0], data.qvel[0]))
    return Response(*np.array(rows).T, release)


def pulse() -> Response:
    """0.05 A for 70 ms, open loop."""
    t = np.arange(round(0.5 / STEP)) * STEP
    return run(np.where(t < 0.07 - 1e-9, 0.05 * TORQUE_CONSTANT, 0.0), 0.07)


def hand_spin() -> Response:
    """A push by hand: assumed a half sine of 120.2 ms that reaches the paper's peak speed, then nothing."""
    t = np.arange(round(0.6 / STEP)) * STEP
    return run(np.where(t < 0.1202, 7.85e-3 * np.sin(np.pi * t / 0.1202), 0.0), 0.1202)


def main() -> None:
    runs = {"current pulse": (pulse(), 1.17, 15.4), "spin by hand": (hand_spin(), 0.55, 7.6)}
    for name, (r, turned, speed) in runs.items():
        drag = r.drag
        print(f"{name}: turned {r.turned:.3f} rad (paper about {turned}), peak {r.peak_speed:.2f} rad/s ({speed})")
        print(f"  drag while turning {drag.mean():.0f} rad/s^2, within {np.ptp(drag) / drag.mean():.0%} of constant")
        print("  at rest, each half period: " + ", ".join(f"{f:.1f}" for f in r.frequencies) + " Hz")
    if len(sys.argv) > 1:
        draw(runs, sys.argv[1])


def draw(runs: dict[str, tuple[Response, float, float]], path: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(9, 7), layout="constrained")
    for column, (name, (r, _, _)) in zip(axes.T, runs.items(), strict=True):
        column[0].plot(r.time, r.position)
        column[0].set(title=name, ylabel="position [rad]")
        column[1].plot(r.time, r.velocity)
        column[1].set(ylabel="velocity [rad/s]", xlabel="time [s]")
        stop = r.time[(r.time > r.release) & (r.velocity < 0)][0]
        rest = r.time > stop - 0.01
        column[2].plot(r.time[rest], (r.position[rest] - r.turned) * 1e3)
        column[2].set(ylabel="at rest [mrad]", xlabel="time [s]", xlim=(stop - 0.01, stop + 0.2))
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
