"""The identified axis in MuJoCo gives back the responses it was identified from."""

import axes
import mujoco
import numpy as np

from gms_mujoco import effects
from gms_mujoco.fit import fit
from gms_mujoco.frf import estimate_frf
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.sweep import stepped_sine

LEVEL, STEP, HELD = 4.5e-3, 5e-4, 10
TRUE = (
    Plant.axis(axes.J)
    + effects.GMS(stiffness=[1.2, 0.3, 0.12], fraction=[0.25, 0.35, 0.4], coulomb=LEVEL, static=1.2 * LEVEL,
                  stribeck_velocity=0.6, attraction=0.4)
    + effects.Viscous(coefficient=4e-5)
)  # fmt: skip


def response(plant: Plant, frequency: float, torque: float) -> complex:
    """Of the axis in MuJoCo at its default integrator, the torque held by the servo for some time steps."""
    model, data = axes.axis(plant, timestep=STEP / HELD)
    n = 8 * round(1 / (frequency * STEP))
    phase = 2 * np.pi * 8 / n * np.arange(5 * n)
    command = torque * np.minimum(np.arange(5 * n) / n, 1) * np.sin(phase)
    position = np.empty(5 * n)
    for k, u in enumerate(command):
        data.ctrl[:] = u
        position[k] = data.qpos[0]
        mujoco.mj_step(model, data, HELD)
    record = Record("mujoco", STEP * np.arange(5 * n), {"torque": command, "position": position})
    frf = estimate_frf(record, period=n * STEP, transient=3)
    return complex(frf.response[np.argmin(np.abs(frf.frequency - 8 / (n * STEP)))])


def test_at_every_amplitude() -> None:
    grid = np.geomspace(10, 160, 8)
    bench = {"resolution": 2 * np.pi / 1e6, "torque_noise": 2e-5}
    frfs = [
        stepped_sine(TRUE, grid, u, held="torque", seed=100 * i, **bench)  # type: ignore[arg-type]
        for i, u in enumerate(np.geomspace(0.1, 3, 6) * LEVEL)
    ]
    found = fit(Plant.axis() + effects.GMS(elements=3) + effects.Viscous(), frfs).plant
    for frf in frfs:
        assert frf.excitation is not None and frf.sigma is not None
        at = len(frf) // 2
        again = response(found, float(frf.frequency[at]), float(frf.excitation[at]))
        again *= np.exp(-1j * np.pi * frf.frequency[at] * STEP / HELD)  # semi-implicit Euler is half a step ahead
        assert abs(again / frf.response[at] - 1) < 3 * frf.sigma[at] / abs(frf.response[at]) + 2e-3
