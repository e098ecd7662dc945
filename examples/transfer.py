"""Carry friction from a machine into a robot model: identify it on one axis, use it in another MJCF.

A servo axis is simulated like a bench would log it. The plant identified from that log goes onto the elbow of an arm,
at the arm's own time step. The drive then turns the elbow slowly to and fro; printed is how far the friction torque
there is from that of the axis on the same motion.
"""

import mujoco
import numpy as np

import gms_mujoco as gms
from gms_mujoco.excitation import multisine

SAMPLE_TIME = 1e-3  # s


def identified(truth: gms.Plant) -> gms.Plant:
    """What a bench would find out about an axis."""
    rng = np.random.default_rng(0)
    level = float(truth["gms"].coulomb)
    torques = (multisine(4000, SAMPLE_TIME, 0.5, 60.0, size * level, rng) for size in (0.35, 1.5, 4.0))
    log = [gms.simulate(truth, u, SAMPLE_TIME, resolution=2 * np.pi / 1e6, torque_noise=2e-5, seed=1) for u in torques]
    return gms.fit(gms.baseline(truth.inertia), log).plant


def torques(plant: gms.Plant, motion: np.ndarray) -> np.ndarray:
    """(n,) torque of the friction of a plant on the elbow of the arm, moved along (n,) positions [N m]."""
    spec = gms.attach(str(gms.MODELS / "arm.xml"), {"elbow": plant})
    model = spec.compile()
    data = mujoco.MjData(model)
    elbow = model.joint("elbow").qposadr[0]
    out = []
    for position in motion:
        data.qpos[elbow] = position
        mujoco.mj_step(model, data)
        out.append(gms.friction(model, data, "elbow").torque)
    return np.array(out)


def main() -> None:
    truth = gms.Plant.load("servo_axis")
    plant = identified(truth)
    motion = 0.2 * np.sin(np.linspace(0, 20, 4000)) * np.linspace(0.05, 1, 4000)
    real, carried = torques(truth, motion), torques(plant, motion)
    error = np.sqrt(np.mean((carried - real) ** 2) / np.mean(real**2))
    print(f"identified and carried to the elbow: friction torque within {100 * error:.2f} % rms of the real one")


if __name__ == "__main__":
    main()
