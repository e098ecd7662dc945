"""What the diagnosis makes of logs of friction that does not bend: as most scripts have it, and stiff machines.

Random axes with Coulomb friction that stops the axis in the step in which it can, by semi-implicit Euler in plain
Python; one step to a row or ten; with positions to the last digit, or behind encoders of 16 to 20 bits with a torque
reading that hisses by 0.2 to 1 % of the friction. Nothing is hidden, or an effect of 12 % of the friction, a delay of
three rows or a drive that saturates at twice the friction. A level that differs between the directions is the same
torque as an offset while the axis moves: a name that is said to be confusable with the hidden one is right.

Seeds: axis i comes from default_rng([78, i]). Run: python benchmarks/rigid_friction.py [axes]
"""

import itertools
import math
import time
from pathlib import Path

import numpy as np
from arguments import arguments
from simulated_logs import course, errors

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.record import Record

HIDDEN = ("", "gravity", "", "cogging", "", "torque_offset", "", "spring", "", "delay", "", "torque_saturation")
STRENGTH = 0.12
SECONDS = 5.0
ROWS_LATE = 3


class Axis:
    """An axis whose friction holds it still by whatever it takes, up to its level.

    Args:
        hidden: name of the effect that it has beside it, "" for none.
        inertia, level: [kg m^2], [N m].
        step: of the simulation [s].
        late: steps by which a delay puts the torque off.
        rng: draws the phase of what depends on the place.
    """

    def __init__(
        self, hidden: str, inertia: float, level: float, step: float, late: int, rng: np.random.Generator
    ) -> None:
        self.hidden, self.inertia, self.level, self.step = hidden, inertia, level, step
        self.phase, self.teeth = float(rng.uniform(-3, 3)), int(rng.integers(3, 12))
        self.position = self.velocity = 0.0
        self.on_the_way = [0.0] * late * (hidden == "delay")

    def go(self, torque: float) -> None:
        """One step under a torque [N m]."""
        q, v, size, h = self.position, self.velocity, STRENGTH * self.level, self.step
        self.on_the_way.append(torque)
        u = self.on_the_way.pop(0)
        if self.hidden == "torque_saturation":
            u = min(max(u, -2 * self.level), 2 * self.level)
        u -= {
            "gravity": size * math.sin(q + self.phase), "cogging": size * math.sin(self.teeth * q + self.phase),
            "torque_offset": size, "spring": 0.5 * size * q,
        }.get(self.hidden, 0.0)  # fmt: skip
        free = v + h * (u - 0.005 * self.level * v) / self.inertia
        most = h * self.level / self.inertia
        self.velocity = free - min(max(free, -most), most)
        self.position += h * self.velocity


def logged(axis: Axis, parts: int, count: float, hiss: float, rng: np.random.Generator) -> list[Record]:
    """Two runs of torques and one in a loop, for each use, with so many steps to a row."""
    h = parts * axis.step
    t = h * np.arange(round(SECONDS / h))
    out = []
    for use, (i, (highest, size)) in itertools.product(
        ("fit", "validate"), enumerate(((40.0, 0.6), (20.0, 1.5), (0.8, 0.0)))
    ):
        wave = course(t, 25, highest, size * axis.level if size else 2.0, rng)
        position, torque = np.empty(len(t)), np.empty(len(t))
        axis.position = axis.velocity = wrong = 0.0
        for k, x in enumerate(wave.tolist()):
            read = count * round(axis.position / count) if count else axis.position
            u = x
            if not size:
                before, wrong = wrong, x - read
                u = axis.inertia * (38.0**2 * wrong + 76.0 * (wrong - before) / h * (k > 0))
                u = min(max(u, -6 * axis.level), 6 * axis.level)
            position[k], torque[k] = read, u
            for _ in range(parts):
                axis.go(u)
        torque += hiss * rng.standard_normal(len(t))
        out.append(Record(f"{use}_{i}", t, {"torque": torque, "position": position}, use, count or None))
    return out


def main(axes: int) -> None:
    right = 0
    print("hidden             row    steps  bits  verdict            error before, after, floor [%]   named")
    for i in range(axes):
        rng = np.random.default_rng([78, i])
        hidden, bits = HIDDEN[i % len(HIDDEN)], int(rng.choice([16, 18, 20])) * (i // 2 % 2)
        row, parts = float(rng.choice([5e-4, 1e-3, 2e-3])), int(rng.choice([1, 10]))
        inertia = 10 ** rng.uniform(-4, -2)
        level = inertia * rng.uniform(60, 300)
        hiss = level * float(rng.choice([2e-3, 1e-2])) * bool(bits)
        axis = Axis(hidden, inertia, level, row / parts, ROWS_LATE * parts, rng)
        begun = time.process_time()
        runs = logged(axis, parts, 2 * math.pi / 2**bits if bits else 0.0, hiss, rng)
        d = gms.diagnose(Dataset(Path(), tuple(runs), "hinge", inertia))
        named = [{step.effect, *step.confusable_with} for step in d.steps[1:]]
        right += len(named) == bool(hidden) and all(hidden in names for names in named)
        said = ", ".join(" or ".join(sorted(names)) for names in named) or "-"
        print(
            f"{hidden or '-':17}  {1e3 * row:3.1f} ms  {parts:4}  {bits or '-':>4}  {d.verdict:17}  "
            f"{errors(d)}   {said}   {time.process_time() - begun:.0f} s",
            flush=True,
        )
    print(f"named what is hidden, and nothing else: {right} of {axes}")


if __name__ == "__main__":
    main(**arguments(__doc__, axes=24))
