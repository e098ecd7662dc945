"""How often the diagnosis names a hidden effect: random axes, one effect each, and healthy axes.

    python benchmarks/hidden_effects.py [CASES PER EFFECT] [FIRST SEED]

The truth is simulated by the package's own effects, so this measures the search, not the physics. Reported seeds start
at 1000; seeds below 100 were used while the rules were made.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np

import gms_mujoco as gms
from gms_mujoco import demo, effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.effect import Effect
from gms_mujoco.plant import Plant


def hidden(name: str, plant: Plant, rng: np.random.Generator) -> Effect | None:
    """An effect of a size that matters beside the friction of the plant: a tenth to a third of its level."""
    if name == "none":
        return None
    level, inertia = float(plant["gms"].coulomb), float(plant.inertia or 0)  # type: ignore[arg-type]
    size, phase = float(rng.uniform(0.1, 0.3)), float(rng.uniform(-math.pi, math.pi))
    values: dict[str, dict[str, object]] = {
        "cogging": {"harmonics": [int(rng.integers(3, 13))], "amplitude": [size * level], "phase": [phase]},
        "gravity": {"amplitude": size * level, "phase": phase},
        "torque_offset": {"torque": math.copysign(size * level, phase)},
        "spring": {"stiffness": size * level / 10, "preload": 0.0},
        "asymmetric_friction": {"level": math.copysign(size, phase)},
        "position_dependent_friction": {"harmonics": [int(rng.integers(1, 6))], "amplitude": [size], "phase": [phase]},
        "thermal_drift": {"amplitude": 2 * size, "time_constant": float(rng.uniform(0.5, 2))},
        "quadratic_drag": {"coefficient": size * level / 30.0**2},
        "delay": {"time": float(rng.uniform(0.5, 2)) * demo.SAMPLE_TIME},
        "current_loop_lag": {"time": float(rng.uniform(0.5, 2)) * demo.SAMPLE_TIME},
        "torque_saturation": {"limit": float(rng.uniform(1.5, 2.5)) * 4 * level},
        "encoder_eccentricity": {"amplitude": 0.02 * size, "phase": phase},
        "flexible_coupling": {"inertia": 0.4 * inertia, "frequency": float(rng.uniform(20, 80)), "damping": 0.05},
        "backlash": {"inertia": 0.4 * inertia, "gap": 0.1 * size, "frequency": 80.0, "damping": 1.0},
    }
    return effects.find(name)(**values[name])


NAMES = (
    "none", "cogging", "gravity", "torque_offset", "spring", "asymmetric_friction", "position_dependent_friction",
    "thermal_drift", "quadratic_drag", "delay", "current_loop_lag", "torque_saturation", "encoder_eccentricity",
    "flexible_coupling", "backlash",
)  # fmt: skip


def main() -> None:
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    print(f"{'hidden':27} {'seed':>5}  {'verdict':17} {'base':>6} {'final':>6} {'floor':>6} {'s':>4}  found (like)")
    right = 0
    for i, name in enumerate(NAMES * cases):
        rng = np.random.default_rng(first + i)
        plant = demo.axis(rng)
        effect = hidden(name, plant, rng)
        truth = plant if effect is None else plant + effect
        records = tuple(demo.records(truth, rng))
        began = time.perf_counter()
        d = gms.diagnose(Dataset(Path("."), records, inertia=plant.inertia))
        took = time.perf_counter() - began
        found = [f"{s.effect}" + "".join(f" ({other})" for other in s.confusable_with) for s in d.steps[1:]]
        named = d.steps[1].effect if len(d.steps) > 1 else "none"
        right += named == name
        figures = [100 * float(x or 0) for x in (d.steps[0].validate_error, d.steps[-1].validate_error, d.noise_floor)]
        print(
            f"{name:27} {first + i:5}  {d.verdict:17} "
            f"{figures[0]:6.2f} {figures[1]:6.2f} {figures[2]:6.2f} {took:4.0f}  "
            f"{'' if named == name else '! '}{', '.join(found) or 'nothing'}",
            flush=True,
        )
    print(f"named first: {right} of {len(NAMES) * cases}; errors in % of the torque on validate records")


if __name__ == "__main__":
    main()
