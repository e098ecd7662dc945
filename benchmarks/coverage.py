"""How often the nominal 95 % intervals of a fit hold the true values: simulated experiments on random servo axes.

    python benchmarks/coverage.py [EXPERIMENTS] [FIRST SEED]

Each experiment draws an axis with two Maxwell-slip elements and measures it in three runs of 4 s at 1 kHz (below
break-away, around it, turning) through an encoder of 10^6 counts per turn and noise on the torque. The plant fitted
knows the inertia and the number of elements, nothing else. Every second experiment hides a weak cogging that the plant
lacks, 5 % of the friction; the truth stays that of the axis. Reported seeds start at 1000; seeds below 200 were used
while the rules were made.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict

import numpy as np

import gms_mujoco as gms
from gms_mujoco import demo, effects
from gms_mujoco.excitation import multisine
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

SAMPLES, H = 4000, 1e-3


def axis(rng: np.random.Generator) -> Plant:
    """A servo axis of the size of the demo's, with two elements far enough apart to be told from each other."""

    def around(value: float) -> float:
        return value * float(rng.uniform(0.7, 1.3))

    level, first = around(4.5e-3), float(rng.uniform(0.3, 0.7))
    fraction = np.array([first, 1 - first])
    breakaway = np.array([around(4e-3), around(2e-2)])  # rad
    friction = effects.find("gms")(
        stiffness=level * fraction / breakaway, fraction=fraction, coulomb=level,
        static=level * float(rng.uniform(1.05, 1.2)), stribeck_velocity=around(0.5), attraction=around(0.5),
    )  # fmt: skip
    return Plant.axis(around(2.4e-5)) + friction + effects.find("viscous")(coefficient=around(2e-5))


def measured(truth: Plant, level: float, rng: np.random.Generator) -> list[Record]:
    """One run in each regime of the demo."""
    out = []
    for name, low, high, size in demo.REGIMES:
        torque = multisine(SAMPLES, H, low, high, size * level, rng)
        out.append(
            simulate(
                truth, torque, H, position=float(rng.uniform(0, 6)), substeps=40, resolution=demo.RESOLUTION,
                torque_noise=demo.TORQUE_NOISE, seed=int(rng.integers(2**31)), name=name,
            )
        )
    return out


def main() -> None:
    experiments = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    held: dict[tuple[bool, str], list[bool]] = defaultdict(list)
    off: dict[tuple[bool, str], list[float]] = defaultdict(list)
    ratios: dict[bool, list[float]] = defaultdict(list)
    for k in range(experiments):
        rng, lacking = np.random.default_rng(first + k), k % 2 == 1
        plant = axis(rng)
        level = float(plant["gms"].coulomb)  # type: ignore[arg-type]
        phase = float(rng.uniform(-math.pi, math.pi))
        cogging = effects.find("cogging")(harmonics=[8], amplitude=[0.05 * level], phase=[phase])
        unknown = Plant.axis(plant.inertia) + effects.find("gms")(2) + effects.find("viscous")()
        found = gms.fit(unknown, measured(plant + cogging if lacking else plant, level, rng))
        ratios[lacking].append(found.error / found.floor)
        true, got = plant.numbers(), found.plant.numbers()
        for name, (low, high) in found.plant.uncertainty.items():
            value = true[name][0]
            held[lacking, name].append(low <= value <= high)
            off[lacking, name].append(abs(got[name][0] / value - 1))
    print(f"{'parameter':26} {'covered':>8} {'off':>7}   {'covered':>8} {'off':>7}")
    print(f"{'':26} {'healthy':>16}   {'with an effect more':>16}")
    for name in dict.fromkeys(n for _, n in held):
        cells = []
        for lacking in (False, True):
            share, error = held.get((lacking, name), []), off.get((lacking, name), [])
            cells.append(f"{100 * np.mean(share):6.1f} % {100 * np.median(error):5.2f} %" if share else f"{'-':>16}")
        print(f"{name:26} {'   '.join(cells)}")
    for lacking, label in ((False, "healthy"), (True, "with an effect more")):
        values = [x for (which, _), xs in held.items() if which is lacking for x in xs]
        if values:
            print(
                f"{label}: {100 * np.mean(values):.1f} % of {len(values)} intervals hold the truth; error over noise "
                f"floor {np.median(ratios[lacking]):.2f}"
            )


if __name__ == "__main__":
    main()
