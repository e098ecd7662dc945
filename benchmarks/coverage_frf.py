"""How often the 95 % intervals of a fit to frequency responses hold the truth.

An experiment: a random axis (inertia, two Maxwell elements with Stribeck level and lag, viscous drag, each around that
of a small servo motor), its response at 8 position amplitudes (0.4 times the smaller break-away distance to 4 times the
larger) of 20 frequencies, by harmonic balance, with an error of 1 % on each point, drawn anew. Inertia is identified
too; the fit starts at the truth. Rows:

- perfect: the fit has the model that made the data.
- lacks drag: the axis has quadratic drag too, a tenth of the friction at the highest speed, which the fit lacks. The
  truth is then what the same fit finds without noise: the parameters of the best approximation.

A cell is the share of experiments whose interval holds the truth. With 300 of them 95 % is measured to 2.5 %.

Seeds: experiment i comes from default_rng([31, i]); those from 1000 on were used while the rules were made.

    python benchmarks/coverage_frf.py [EXPERIMENTS] [FIRST]
"""

from dataclasses import replace

import numpy as np
from arguments import arguments

from gms_mujoco import effects
from gms_mujoco.fit import fit
from gms_mujoco.frf import FRF
from gms_mujoco.identification.frf_observation import FrfObservation
from gms_mujoco.plant import Plant
from gms_mujoco.responses.harmonics import balance

ERROR = 0.01
NAMES = ("inertia", "gms.stiffness[0]", "gms.stiffness[1]", "gms.fraction[0]", "gms.coulomb", "gms.static",
         "gms.stribeck_velocity", "gms.attraction", "viscous.coefficient")  # fmt: skip


def axis(rng: np.random.Generator) -> Plant:
    def around(value: float) -> float:
        return value * float(rng.uniform(0.7, 1.3))

    level, share = around(4.5e-3), float(rng.uniform(0.3, 0.6))
    gms = effects.find("gms")(
        stiffness=[around(1.2), around(0.2)], fraction=[share, 1 - share], coulomb=level,
        static=level * float(rng.uniform(1.1, 1.3)), stribeck_velocity=around(0.6), attraction=around(0.4),
    )  # fmt: skip
    plant = Plant.axis(around(2.4e-5)) + gms + effects.find("viscous")(coefficient=around(4e-5))
    return replace(plant, inertia_known=False)


def responses(plant: Plant) -> list[FRF]:
    gms = plant["gms"]
    assert plant.inertia is not None
    breakaway = np.array(gms.fraction) * gms.static / np.array(gms.stiffness)
    out = []
    for size in np.geomspace(0.4 * breakaway.min(), 4 * breakaway.max(), 8):
        middle = np.sqrt(np.sum(np.array(gms.stiffness) * np.minimum(1, breakaway / size)) / plant.inertia)
        omega, sizes = np.geomspace(0.4, 5, 20) * middle, np.full(20, size)
        found = balance(plant.joint(), plant.inertia, sizes, omega)
        frf = FRF(f"{size:.3g} rad", omega / (2 * np.pi), np.ones(20, complex), amplitude=sizes, sine=True)
        needed = FrfObservation(frf, np.ones(20), 1.0, found.extra).needed_torque(plant)
        exact = replace(frf, response=sizes / needed, excitation=np.abs(needed)).where(found.good)
        out.append(replace(exact, sigma=ERROR * np.abs(exact.response)))
    return out


def noisy(frf: FRF, rng: np.random.Generator) -> FRF:
    error = rng.standard_normal((2, len(frf))) / np.sqrt(2)
    response = frf.response * (1 + ERROR * (error[0] + 1j * error[1]))
    return replace(frf, response=response, excitation=None)


def experiment(i: int, lacking: bool) -> dict[str, bool]:
    rng = np.random.default_rng([31, i])
    plant = axis(rng)
    frfs = responses(plant)
    truth = plant
    if lacking:
        fastest = max(float((2 * np.pi * f.frequency * f.amplitude).max()) for f in frfs)
        drag = effects.find("quadratic_drag")(coefficient=0.1 * plant["gms"].coulomb / fastest**2)
        frfs = responses(plant + drag)
        truth = fit(plant, frfs).plant
    found = fit(truth, [noisy(f, rng) for f in frfs]).plant
    true = truth.numbers()
    return {n: found.uncertainty[n][0] <= true[n][0] <= found.uncertainty[n][1] for n in NAMES}


def main(experiments: int, first: int) -> None:
    print(f"share of 95 % intervals that hold the truth, {experiments} experiments")
    for name, lacking in (("perfect", False), ("lacks drag", True)):
        held = [experiment(i, lacking) for i in range(first, first + experiments)]
        print(f"{name}: all {100 * np.mean([list(h.values()) for h in held]):.1f} %")
        for n in NAMES:
            print(f"    {n:24} {100 * np.mean([h[n] for h in held]):5.1f} %", flush=True)


if __name__ == "__main__":
    main(**arguments(__doc__, experiments=300, first=0))
