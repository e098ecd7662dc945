"""Find the effect that a friction model lacks in a log: yours, or one that is made here.

    python examples/missing_effect.py [FOLDER WITH dataset.toml]

Without a folder the log is that of a simulated axis with a cogging torque that no friction model knows. Printed is the
error of the torque on a record that decided nothing, before and after what was found is added.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import gms_mujoco as gms
from gms_mujoco.dataset import save
from gms_mujoco.excitation import multisine

SAMPLE_TIME = 1e-3  # s


def log(folder: Path) -> None:
    """Writes a log: four runs of an axis with a motor that cogs eight times a revolution."""
    friction = gms.effects.GMS(stiffness=[1.2, 0.3], fraction=[0.5, 0.5], coulomb=4.5e-3, static=5e-3,
                               stribeck_velocity=0.5, attraction=0.5)  # fmt: skip
    cogging = gms.effects.Cogging(harmonics=[8], amplitude=[8e-4], phase=[0.4])
    axis = gms.Plant.axis(2.4e-5) + friction + gms.effects.Viscous(coefficient=2e-5) + cogging
    rng = np.random.default_rng(0)
    runs = []
    for use in ("fit", "validate"):
        for k, (low, high, size) in enumerate(((1, 60, 3e-3), (0.3, 15, 1.8e-2))):
            torque = multisine(1500, SAMPLE_TIME, low, high, size, rng)
            runs.append(gms.simulate(axis, torque, SAMPLE_TIME, resolution=2 * np.pi / 1e6, torque_noise=2e-5, seed=k,
                                     name=f"{use}_{k}", use=use))  # fmt: skip
    save(folder, runs, inertia=axis.inertia)


def main(folder: str | None = None) -> None:
    with tempfile.TemporaryDirectory() as made:
        if folder is None:
            log(Path(made))
        runs = gms.load(folder or made)
        found = gms.diagnose(runs, gms.baseline(runs.inertia, runs.kind, elements=3))
    print(f"{found.verdict}: {', '.join(effect.name for effect in found) or 'no effect is missing'}")
    for step in found.steps:
        print(f"  {step.effect or 'baseline':12} torque error {100 * step.validate_error:5.2f} %")
    print(f"  {'noise floor':12}              {100 * found.noise_floor:5.2f} %")


if __name__ == "__main__":
    main(*sys.argv[1:2])
