"""demo: a simulated servo axis hides an effect; the whole loop finds it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import effects
from .dataset import load, save
from .diagnose import diagnose
from .diagnosis.findings import Diagnosis
from .effect import Effect
from .errors import GmsError
from .excitation import multisine
from .plant import Plant
from .progress import Progress
from .record import Record
from .simulate import simulate

SAMPLES, SAMPLE_TIME = 5000, 1e-3  # per record, [s]
# Lowest and highest frequency of the torque [Hz], and its rms in Coulomb levels.
REGIMES = (("presliding", 1.0, 100.0, 0.35), ("breakaway", 0.5, 60.0, 1.5), ("turning", 0.3, 20.0, 4.0))
SUBSTEPS = 10
RESOLUTION = 2 * math.pi / 1e6  # one count of the encoder [rad]
TORQUE_NOISE = 2e-5  # N m


@dataclass(frozen=True)
class Demo:
    """What the demo hid, and what was found.

    Attributes:
        hidden: the effect that the simulated axis has and the baseline lacks.
        diagnosis: the whole loop on its records.
    """

    hidden: Effect
    diagnosis: Diagnosis

    def __str__(self) -> str:
        d = self.diagnosis
        found = ", ".join(e.name for e in d) or "nothing"
        first, last = d.steps[0].validate_error, d.steps[-1].validate_error
        assert first is not None and last is not None
        return (
            f"{d}\n\nhidden: {self.hidden.name}; found: {found}\n"
            f"validate error: {100 * first:.3g} % with the baseline, {100 * last:.3g} % with the final plant "
            f"({last / d.noise_floor:.2f} times the noise floor)"
        )


def axis(rng: np.random.Generator) -> Plant:
    """A servo axis of the size of the one in Yoon and Trumper (2014), every number drawn around theirs."""

    def around(value: float, share: float = 0.3) -> float:
        return value * float(rng.uniform(1 - share, 1 + share))

    level = around(4.5e-3)
    fraction = rng.dirichlet([6.0] * 4)
    breakaway = np.geomspace(1e-3, 2e-2, 4) * rng.uniform(0.8, 1.25, 4)  # rad
    gms = effects.find("gms")(
        stiffness=(level * fraction / breakaway).tolist(),
        fraction=(fraction / fraction.sum()).tolist(),
        coulomb=level,
        static=level * float(rng.uniform(1.05, 1.2)),
        stribeck_velocity=around(0.5),
        attraction=around(0.5),
    )
    return Plant.axis(around(2.4e-5)) + gms + effects.find("viscous")(coefficient=around(2e-5))


def hide(level: float, rng: np.random.Generator) -> Effect:
    """An effect that the baseline lacks, drawn at random with a size that matters [N m]."""

    def some(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    phase = some(-math.pi, math.pi)
    # An offset and asymmetric friction are left out: in sliding they are one and the same.
    drawn = (
        ("cogging", {"harmonics": [int(rng.integers(4, 13))], "amplitude": [some(0.1, 0.3) * level], "phase": [phase]}),
        ("gravity", {"amplitude": some(0.15, 0.4) * level, "phase": phase}),
        ("quadratic_drag", {"coefficient": some(0.2, 0.5) * level / 30.0**2}),  # 30 rad/s: reached when turning
        ("delay", {"time": some(1.0, 3.0) * SAMPLE_TIME}),
    )
    name, values = drawn[int(rng.integers(len(drawn)))]
    return effects.find(name)(**values)


def records(plant: Plant, rng: np.random.Generator) -> list[Record]:
    """Three runs to fit and three to validate: in pre-sliding, around break-away, and turning."""
    level = float(plant["gms"].coulomb)  # type: ignore[arg-type]
    runs = []
    for use in ("fit", "validate"):
        for name, low, high, size in REGIMES:
            torque = multisine(SAMPLES, SAMPLE_TIME, low, high, size * level, rng)
            runs.append(
                simulate(
                    plant, torque, SAMPLE_TIME, position=float(rng.uniform(0, 6)), substeps=SUBSTEPS,
                    resolution=RESOLUTION, torque_noise=TORQUE_NOISE, seed=int(rng.integers(2**31)),
                    name=f"{use}_{name}", use=use,
                )
            )  # fmt: skip
    return runs


def run(directory: str | Path, seed: int, progress: Progress | None = None) -> Demo:
    """Simulates an axis with a hidden effect, writes its records as a measurement set, and diagnoses that.

    Args:
        directory: gets `dataset.toml` and the records.
        seed: draws the axis, the effect and the noise.
        progress: called with a share in 0..1 and a message.
    """
    if seed < 0:
        raise GmsError(f"the seed must not be negative; {seed} given")
    rng = np.random.default_rng(seed)
    plant = axis(rng)
    hidden = hide(float(plant["gms"].coulomb), rng)  # type: ignore[arg-type]
    save(directory, records(plant + hidden, rng), inertia=plant.inertia)
    return Demo(hidden, diagnose(load(directory), progress=progress))
