"""Whether MuJoCo, with the friction identified from frequency responses, gives the same responses back.

Random servo axes (those of coverage_frf.py) are measured by stepped sines at 2 kHz through an encoder of 10^6 counts
with 0.02 mN m of torque noise, at 8 amplitudes of the position, 0.4 times the smaller break-away distance to 4 times
the larger, 10 frequencies each. `fit` identifies everything from that, inertia too, with four elements where the axis
has two. The identified axis then runs in MuJoCo, by the plug-in, with the torque at which it moves as far as was
measured.

`z` is the root mean square of the difference over a standard deviation, `within` the share of points inside its 95 %
circle (1.73 of them): first that which `fit` gives each point, the measured one and 0.3 % for what a drive and a sensor
do that nobody models; then the measured one alone, from the scatter of four windows. Beside it is the axis itself in
MuJoCo, which that noise, too, parts from its measurement. `off` is relative to the response, the largest one for the
axis itself as well: near break-away, below resonance, half a per cent more torque can double the amplitude (the
response folds), no held torque gives the amplitude in between, and a point that fell there is none of steady state.

Seeds: axis i comes from default_rng([31, i]). Run: python benchmarks/round_trip.py [axes]
"""

from itertools import chain

import numpy as np
from arguments import arguments
from coverage_frf import axis

import gms_mujoco as gms
from gms_mujoco.bench import run_loop
from gms_mujoco.excitation import Excitation
from gms_mujoco.frf import FRF
from gms_mujoco.identification.frf_observation import observe_frfs
from gms_mujoco.plant import Plant

H, COUNT, NOISE = 5e-4, 2 * np.pi / 1e6, 2e-5
AMPLITUDES, POINTS = 8, 10
SUBSTEPS = 20
SETTLED = 4.0  # s, in which what sets in with the sine dies away
CIRCLE = np.sqrt(-np.log(0.05))  # of a complex normal with E|e|^2 = 1


def measured(plant: Plant, seed: int) -> list[FRF]:
    law = plant["gms"]
    breakaway = np.array(law.fraction) * law.static / np.array(law.stiffness)
    out = []
    for i, size in enumerate(np.geomspace(0.4 * breakaway.min(), 4 * breakaway.max(), AMPLITUDES)):
        springs = np.sum(np.array(law.stiffness) * np.minimum(1, breakaway / size))
        middle = np.sqrt(springs / plant.inertia) / (2 * np.pi)
        grid = np.geomspace(0.5, 5, POINTS) * middle
        bench = {"resolution": COUNT, "torque_noise": NOISE, "seed": 1000 * seed + 20 * i, "substeps": SUBSTEPS}
        out.append(gms.stepped_sine(plant, grid, size, **bench))
    return out


def in_mujoco(plant: Plant, frequency: float, torque: float, amplitude: float) -> complex:
    """The response of the axis at an amplitude of the position, by the plug-in, with neither noise nor encoder."""
    tried: list[tuple[float, float]] = []
    size = torque
    for _ in range(8):
        sine = Excitation.sine(H, frequency, size, max(8, int(np.ceil(16 * frequency * H))))
        n = len(sine.wave)
        windows = max(4, int(np.ceil(SETTLED / (n * H))))
        wave = sine.repeat(windows, 0.5 * windows)
        record = run_loop(plant, lambda row: 0.0, np.zeros(len(wave)), H, added=wave, substeps=SUBSTEPS)
        frf = gms.estimate_frf(record, period=n * H, transient=windows - 1)
        g = complex(frf.response[np.argmin(np.abs(frf.frequency - sine.frequency[0]))])
        tried.append((np.log(size), np.log(abs(g) * size / amplitude)))
        if abs(tried[-1][1]) < 2e-5:
            break
        if len(tried) > 1:
            (a, fa), (b, fb) = tried[-2:]
            step = -fb * (b - a) / (fb - fa) if fb != fa else 0.0
        else:
            step = -tried[-1][1] / 2
        size = np.exp(tried[-1][0] + np.clip(step, -0.1, 0.1))
    return g


def main(axes: int) -> None:
    table: list[list[list[float]]] = [[] for _ in range(AMPLITUDES)]
    for k in range(axes):
        plant = axis(np.random.default_rng([31, k]))
        frfs = measured(plant, k)
        found = gms.fit(gms.baseline(elements=4), frfs).plant
        for row, seen in zip(table, observe_frfs(frfs), strict=True):
            frf, stated = seen.frf, seen.deviation / np.abs(seen.torque)
            points = (frf.frequency, frf.excitation, frf.amplitude, frf.response, frf.sigma, stated)
            for f, u, a, g, s, t in zip(*points, strict=True):
                gap, own = (abs(in_mujoco(p, float(f), float(u), float(a)) - g) for p in (found, plant))
                row.append([gap / (t * abs(g)), gap / s, own / s, gap / abs(g), own / abs(g)])
    print(f"{axes} axes, {AMPLITUDES} amplitudes; the identified axis in MuJoCo beside the responses it was found from")
    print(f"{'':17}{'as fitted':>16}{'as measured':>16}{'axis itself':>16}{'off [%]':>18}{'axis':>9}")
    print(f"{'amplitude':>9}{'points':>8}" + f"{'z':>7}{'within':>9}" * 3 + f"{'median':>9}" + f"{'largest':>9}" * 2)
    for i, row in enumerate([*table, list(chain(*table))]):
        values = np.array(row)
        name = str(i + 1) if i < AMPLITUDES else "all"
        cells = [f"{np.sqrt(np.mean(z**2)):7.2f}{100 * np.mean(z < CIRCLE):7.0f} %" for z in values.T[:3]]
        off, own = 100 * values.T[3:]
        print(f"{name:>9}{len(row):8}{''.join(cells)}{np.median(off):9.3f}{off.max():9.3f}{own.max():9.3f}")


if __name__ == "__main__":
    main(**arguments(__doc__, axes=2))
