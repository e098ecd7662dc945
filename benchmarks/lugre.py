"""GMS against LuGre on axes whose friction is GMS: both identified in the frequency domain from the same responses.

Random axes as in virgin_curve.py (six Maxwell-slip elements, 4.5 mN m), without and with a Stribeck curve (Fs 20 %
above Fc), which LuGre gets from runs at constant velocity and the Maxwell-slip reading does not know. 2 kHz, encoder of
10^6 counts, 0.02 mN m of torque noise; stepped sines at 8 held position amplitudes, of which LuGre takes the smallest
(Hensen) and GMS all.

- stiffness error: |J w^2 of the model over that of the axis - 1| at the torque held and position amplitude of each
  level, from sines on the simulated models; at the smallest level and the worst of all.
- amplitude drift: largest less smallest of that ratio over the levels.
- R^2: of the friction torque replayed along a pre-sliding motion of the true axis (a multisine of half the level).
- drift per cycle: creep under 0.6 + 0.2 sin of the level, in break-away distances of the axis.

Seeds: default_rng([7, i]). Run: python benchmarks/lugre.py [axes]
"""

import math
import sys

import numpy as np
from arguments import arguments
from virgin_curve import COUNT, LEVEL, J, axis, plant_of, swept

from gms_mujoco import control
from gms_mujoco.bench import run_loop
from gms_mujoco.dahl_resonance import describing_function, identify_dahl
from gms_mujoco.excitation import Excitation
from gms_mujoco.hensen import constant_velocity, identify_lugre
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate
from gms_mujoco.sweep import stepped_sine

H = 5e-4
SPEEDS = (0.1, 0.2, 0.4, 0.6, 0.8, 1.2, 2.0, 4.0)  # rad/s


def sliding(plant: Plant, seed: int) -> tuple[np.ndarray, np.ndarray]:
    runs = []
    for i, speed in enumerate(SPEEDS):
        reference = speed * H * np.arange(2000)
        bench = {"resolution": COUNT, "torque_noise": 2e-5, "seed": 100 * seed + i}
        runs.append(run_loop(plant, control.PID(J, H, bandwidth=25.0), reference, H, **bench))  # type: ignore[arg-type]
    return constant_velocity(runs)


def stiffness(plant: Plant, frequency: float, amplitude: float) -> float:
    """In-phase stiffness of friction at a position amplitude, from a sine far above the resonance, where all hold."""
    frf = stepped_sine(plant, [frequency], amplitude, substeps=16, tolerance=2e-3)
    return float((1 / frf.response).real[0] + J * frf.omega[0] ** 2)


def r_squared(true: Plant, model: Plant) -> float:
    wave = Excitation.multisine(H, 1.0, 1, 80, 0.35 * LEVEL, 3)
    record = simulate(true, wave.repeat(3, 1), H, substeps=16)
    speed = np.gradient(record.position, H)
    torque, said = (p.joint().replay(record.time, record.position, speed).torque[2000:] for p in (true, model))
    return 1 - float(np.sum((torque - said) ** 2) / np.sum((torque - torque.mean()) ** 2))


def creep(plant: Plant, reach: float) -> float:
    time = H * np.arange(6000)
    record = simulate(plant, (0.6 + 0.2 * np.sin(2 * math.pi * 5 * time)) * LEVEL * np.clip(time, 0, 1), H, substeps=16)
    return float((record.position[5999 - 1] - record.position[5999 - 1 - 1200]) / 3 / reach)


def scores(i: int, coulomb: float) -> dict[str, list[float]]:
    true = axis(np.random.default_rng([7, i]))
    plant = plant_of(true, coulomb)
    frfs = swept(true, "position", i, coulomb)
    models = {"GMS (identify_dahl)": identify_dahl(frfs, J).plant,
              "LuGre (Hensen)": identify_lugre(frfs, *sliding(plant, i), J).plant}  # fmt: skip
    sizes = [float(np.median(f.amplitude)) for f in frfs]  # type: ignore[arg-type]
    tone = [3 * math.sqrt(describing_function(*true, np.array([a])).real[0] / J) / (2 * math.pi) for a in sizes]
    truth = [stiffness(plant, f, a) for f, a in zip(tone, sizes, strict=True)]
    out = {}
    for name, model in models.items():
        ratio = []
        for f, a, k in zip(tone, sizes, truth, strict=True):
            try:
                ratio.append(stiffness(model, f, a) / k)
            except Exception as error:  # the amplitude cannot be held on this model
                print(f"  axis {i}, {name}, {a:.2g} rad: {error}", file=sys.stderr)
        error = 100 * np.abs(np.array(ratio) - 1)
        out[name] = [error[0], error.max(), 100 * np.ptp(ratio), r_squared(plant, model), creep(model, true[1].max())]
    out["the axis itself"] = [0, 0, 0, 1, creep(plant, true[1].max())]
    return out


def main(axes: int) -> None:
    for what, coulomb in (("without", LEVEL), ("with", LEVEL / 1.2)):
        table = [scores(i, coulomb) for i in range(axes)]
        print(f"{f'median, {axes} axes':22} {'stiffness error [%]':>22}  {'amplitude':>10}  {'':>8}  {'drift per':>10}")
        print(f"{f'{what} Stribeck':22} {'smallest':>10} {'worst':>11}  {'drift [%]':>10}  {'R^2':>8}  {'cycle':>10}")
        for name in table[0]:
            m = np.median([t[name] for t in table], axis=0)
            print(f"{name:22} {m[0]:10.2f} {m[1]:11.2f}  {m[2]:10.2f}  {m[3]:8.4f}  {m[4]:10.1e}", flush=True)


if __name__ == "__main__":
    main(**arguments(__doc__, axes=10))
