"""Error of the virgin curve from frequency responses: maximum likelihood, describing function, secant, local slope.

Random axes: inertia 2.4e-5 kg m^2, six Maxwell-slip elements, break-away distances log-uniform from 1e-4 to 1e-2 rad,
shares of the level of 4.5 mN m uniform on the simplex. Error: rms of the difference over rms of the true curve, on
300 distances from 0 to the largest amplitude; the table gives the median over the axes, with the quartiles.

- ideal: frequency and loss factor of the describing function at 12 amplitudes, half the smallest to twice the largest
  break-away distance, exact or with independent normal errors of 3 % on both.
- stepped sines: simulated at 2 kHz through an encoder of 10^6 counts with 0.02 mN m of torque noise; 8 amplitudes
  (at held position as above but at least 16 counts; at held torque 5 to 150 % of the level) and 20 frequencies.
- Stribeck: the same axes with a Coulomb level a sixth below the static one, which only the likelihood models.
- speed: 8 amplitudes of 60 frequencies; time of the fit, also in units of one replay of the plant along all points.

The column "likelihood" is `fit` on every point, started by the describing function, with six elements; on resonances
alone there is nothing to refine.

Seeds: axis i of every row comes from default_rng([7, i]). Run: python benchmarks/virgin_curve.py [axes] [swept axes]
"""

import math
import time

import numpy as np
from arguments import arguments

from gms_mujoco import effects
from gms_mujoco.dahl_resonance import (
    DahlReading,
    describing_function,
    identify_dahl,
    read_resonances,
    virgin_curve,
)
from gms_mujoco.fit import baseline, fit
from gms_mujoco.frf import FRF
from gms_mujoco.identification.observe import observe
from gms_mujoco.plant import Plant
from gms_mujoco.responses.resonance import Resonance, secant_curve, slope_curve
from gms_mujoco.sweep import stepped_sine

J, LEVEL, COUNT = 2.4e-5, 4.5e-3, 2 * math.pi / 1e6
Set = tuple[np.ndarray, np.ndarray]


def axis(rng: np.random.Generator) -> Set:
    """Stiffnesses and break-away distances."""
    distance = np.sort(np.exp(rng.uniform(math.log(1e-4), math.log(1e-2), 6)))
    return LEVEL * rng.dirichlet(np.ones(6)) / distance, distance


def plant_of(true: Set, coulomb: float = LEVEL) -> Plant:
    k, x = true
    gms = effects.find("gms")(
        stiffness=k, fraction=k * x / LEVEL, coulomb=coulomb, static=LEVEL, stribeck_velocity=0.8, attraction=0.3
    )
    return Plant.axis(J) + gms + effects.find("viscous")(coefficient=2e-5)


def ideal(true: Set, noise: float, rng: np.random.Generator) -> list[Resonance]:
    size = np.geomspace(0.5 * true[1].min(), 2 * true[1].max(), 12)
    k = describing_function(*true, size)
    omega = np.sqrt(k.real / J) * (1 + noise * rng.standard_normal(12))
    loss = k.imag / k.real * (1 + noise * rng.standard_normal(12))
    return [Resonance(a, w / 2 / math.pi, e * J * w * w) for a, w, e in zip(size, omega, loss, strict=True)]


def swept(true: Set, held: str, seed: int, coulomb: float = LEVEL, points: int = 20) -> list[FRF]:
    bench = {"resolution": COUNT, "torque_noise": 2e-5, "seed": seed, "held": held, "substeps": 8}
    plant, out = plant_of(true, coulomb), []
    stuck = math.sqrt(true[0].sum() / J) / (2 * math.pi)
    if held == "torque":
        for u in np.geomspace(0.05, 1.5, 8) * LEVEL:
            out.append(stepped_sine(plant, np.geomspace(0.1 * stuck, min(4 * stuck, 450), points), u, **bench))
        return out
    for a in np.geomspace(max(0.5 * true[1].min(), 16 * COUNT), 2 * true[1].max(), 8):
        own = math.sqrt(describing_function(*true, np.array([a])).real[0] / J) / (2 * math.pi)
        out.append(stepped_sine(plant, np.geomspace(0.6 * own, min(8 * own, 450), points), a, **bench))
    return out


def error(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))


def distances(reading: DahlReading) -> np.ndarray:
    return np.linspace(0, reading.amplitude[1], 301)[1:]


def scores(true: Set, reading: DahlReading, resonances: list[Resonance], plant: Plant | None = None) -> list[float]:
    """Likelihood, describing function, secant, local slope."""
    x = distances(reading)
    curve = virgin_curve(*true, x)
    fitted = np.full(len(x), np.nan) if plant is None else plant_curve(plant, x)
    return [error(c, curve) for c in (fitted, reading.virgin_curve(x), secant_curve(resonances, J, x),
                                      slope_curve(resonances, J, x))]  # fmt: skip


def plant_curve(plant: Plant, x: np.ndarray) -> np.ndarray:
    """The virgin curve of the friction of a plant."""
    gms = plant["gms"]
    k = np.array(gms.stiffness)
    return virgin_curve(k, np.array(gms.fraction) * gms.static / k, x)


def row(name: str, values: list[list[float]]) -> None:
    low, middle, high = np.percentile(100 * np.array(values), (25, 50, 75), axis=0)
    cells = "  ".join(
        f"{'-':>24}" if math.isnan(m) else f"{m:7.2f} ({a:5.2f} to {b:6.2f})"
        for a, m, b in zip(low, middle, high, strict=True)
    )
    print(f"{name:48} {cells}", flush=True)


def main(axes: int, swept_axes: int) -> None:
    print(f"virgin-curve error [%], median (quartiles) over {axes} axes, {swept_axes} with stepped sines")
    print(f"{'':48} {'likelihood':24}  {'describing function':24}  {'secant':24}  {'local slope':24}")
    for noise in (0.0, 0.03):
        table = []
        for i in range(axes):
            rng = np.random.default_rng([7, i])
            true = axis(rng)
            found = ideal(true, noise, rng)
            table.append(scores(true, read_resonances(found, J), found))
        row("ideal resonances" if not noise else f"frequency and loss with {100 * noise:g} % noise", table)
    for held, coulomb in (("position", LEVEL), ("torque", LEVEL), ("position", LEVEL / 1.2)):
        known, free, inertia, read = [], [], [], []
        for i in range(swept_axes):
            true = axis(np.random.default_rng([7, i]))
            frfs = swept(true, held, i, coulomb)
            reading, given = identify_dahl(frfs), identify_dahl(frfs, J)
            found = fit(baseline(elements=6), frfs).plant
            known.append(scores(true, given, list(given.resonances), fit(baseline(J, elements=6), frfs).plant))
            free.append(scores(true, reading, list(reading.resonances), found))
            inertia.append(abs(found.inertia / J - 1))
            read.append(abs(reading.inertia / J - 1))
        what = f"stepped sines, held {held}" + ("" if coulomb == LEVEL else ", Stribeck")
        row(f"{what}, inertia known", known)
        row(f"{what}, inertia identified", free)
        print(f"    inertia error [%]: likelihood median {100 * np.median(inertia):.3f}, "
              f"worst {100 * max(inertia):.3f}; "
              f"describing function median {100 * np.median(read):.3f}, worst {100 * max(read):.3f}", flush=True)
    speed(min(swept_axes, 3))


def speed(axes: int) -> None:
    """Time of the fit from 8 amplitudes of 60 frequencies."""
    spent, ratio, points = [], [], 0
    for i in range(axes):
        true = axis(np.random.default_rng([7, i]))
        frfs = swept(true, "position", i, LEVEL / 1.2, 60)
        points = sum(map(len, frfs))
        start = time.process_time()
        plant = fit(baseline(elements=6), frfs).plant
        spent.append(time.process_time() - start)
        seen = observe(frfs)
        start = time.process_time()
        for _ in range(5):
            for o in seen:
                o.needed(plant)
        ratio.append(spent[-1] / ((time.process_time() - start) / 5))
    print(f"identified from {points} points in {np.median(spent):.2f} s of one core, {np.median(ratio):.0f} replays")


if __name__ == "__main__":
    main(**arguments(__doc__, axes=50, swept_axes=10))
