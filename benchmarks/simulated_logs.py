"""What the benchmarks of simulated logs share: courses drawn at random, and the errors of a diagnosis in a table."""

import numpy as np
from numpy.typing import NDArray

from gms_mujoco.diagnosis.findings import Diagnosis

Array = NDArray[np.float64]


def course(t: Array, sines: int, highest: float, size: float, rng: np.random.Generator) -> Array:
    """(n,) at times t (n,) [s]: so many sines, 0.1 Hz to the highest [Hz], of deviation `size`."""
    frequency, phase = rng.uniform(0.1, highest, sines)[:, None], rng.uniform(0, 2 * np.pi, sines)[:, None]
    wave = np.sin(2 * np.pi * frequency * t + phase).sum(0)
    return np.asarray(wave * (size / np.std(wave)))


def errors(d: Diagnosis) -> str:
    """On the validate records, before, after, and of noise alone [%], in columns."""
    found = (d.steps[0].validate_error, d.steps[-1].validate_error, d.noise_floor)
    return "  ".join(f"{100 * (e or 0.0):7.4f}" for e in found)
