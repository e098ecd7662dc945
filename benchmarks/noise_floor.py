"""Whether the noise floor is what a perfect model leaves.

Random axes with GMS friction and one effect more are simulated in steps of a hundredth of a sample, read at 2 kHz
through an encoder of 2^18 to 2^20 counts, the torque with noise or without. Then `compare` sets the very plant beside
those records: what it leaves comes from sensors, counts and sampling alone, and the floor has to say how much that is.
Printed is, for each effect, what is left, the floor (medians, % of the torque), and their ratio: median and the range
over the axes. Above 1.2 a diagnosis that has found all there is would still be called `partly_explained`.

Seeds: axis i comes from default_rng([81, i]). Run: python benchmarks/noise_floor.py [axes]
"""

import math

import numpy as np
from arguments import arguments
from numpy.typing import NDArray
from simulated_logs import course

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

Array = NDArray[np.float64]

RATE, SECONDS, SUBSTEPS = 2000, 6.0, 100
# Of each run: the highest frequency of the torque [Hz], and its deviation over the friction level.
RUNS = ((40.0, 0.3), (40.0, 0.8), (15.0, 1.2), (6.0, 2.0))
NOISE = (0.0, 0.002)  # of the torque, over its deviation; axes take turns


def friction(rng: np.random.Generator) -> Plant:
    inertia = float(np.exp(rng.uniform(np.log(3e-6), np.log(3e-4))))
    level = inertia * float(rng.uniform(80, 300))
    stiffness = inertia * (2 * math.pi * rng.uniform(25, 70)) ** 2
    share = rng.dirichlet(np.full(4, 4.0))
    reach = np.geomspace(0.3, 2.0, 4) * level / stiffness
    return (
        Plant.axis(inertia)
        + effects.GMS(
            stiffness=share * level / reach, fraction=share, coulomb=level, static=1.2 * level,
            stribeck_velocity=float(rng.uniform(0.3, 2)), attraction=60 * level,
        )
        + effects.Viscous(coefficient=0.2 * level / 20)
    )  # fmt: skip


def hidden(plant: Plant, rng: np.random.Generator) -> dict[str, Effect | None]:
    """One effect of each kind, of a fifth of the friction level."""
    inertia, level = float(plant.inertia or 0), float(plant["gms"].coulomb)
    phase, sign = float(rng.uniform(-3, 3)), float(rng.choice([-1, 1]))
    return {
        "nothing": None,
        "asymmetric, as a whole": effects.AsymmetricFriction(level=0.2 * sign),
        "asymmetric, level alone": effects.AsymmetricFriction(level=0.2 * sign, stiffening=0.0),
        "asymmetric, carried over": effects.AsymmetricFriction(level=0.2 * sign, stiffening=0.0, dropping=0.0),
        "cogging": effects.Cogging(harmonics=[7], amplitude=[0.2 * level], phase=[phase]),
        "torque_offset": effects.TorqueOffset(torque=0.2 * level),
        "delay": effects.Delay(time=0.8e-3),
        "flexible_coupling": effects.FlexibleCoupling(inertia=0.3 * inertia, frequency=120.0, damping=0.05),
        "backlash": effects.Backlash(inertia=0.3 * inertia, gap=0.02, frequency=250.0, damping=0.2),
    }


def records(plant: Plant, level: float, noise: float, rng: np.random.Generator) -> list[Record]:
    t = np.arange(round(SECONDS * RATE)) / RATE
    count = 2 * math.pi / 2 ** int(rng.integers(18, 21))
    found = []
    for highest, size in RUNS:
        torque = course(t, 12, highest, size * level, rng)
        found.append(
            gms.simulate(
                plant, torque, 1 / RATE, substeps=SUBSTEPS, resolution=count, torque_noise=noise * size * level,
                seed=int(rng.integers(1 << 30)), name=f"to {highest:g} Hz, {size:g} of the level",
            )
        )  # fmt: skip
    return found


def main() -> None:
    axes = arguments(__doc__, axes=8)["axes"]
    left: dict[str, list[tuple[float, float]]] = {}
    for i in range(axes):
        rng = np.random.default_rng([81, i])
        plain = friction(rng)
        level = float(plain["gms"].coulomb)
        for name, effect in hidden(plain, rng).items():
            plant = plain if effect is None else plain + effect
            found = gms.compare(plant, records(plant, level, NOISE[i % len(NOISE)], rng))
            left.setdefault(name, []).append((100 * found.torque_error, 100 * found.noise_floor))
    print(f"{axes} axes{'':22s}left   floor   left/floor")
    for name, rows in left.items():
        error, floor = np.array(rows).T
        ratio = error / floor
        print(
            f"{name:26s}{np.median(error):8.3f}{np.median(floor):8.3f}   {np.median(ratio):.2f} "
            f"({ratio.min():.2f}-{ratio.max():.2f})"
        )


if __name__ == "__main__":
    main()
