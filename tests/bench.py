"""A simulated bench for the tests of the measuring side: a small servo axis and short runs of it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.effect import Effect
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.refine import refine
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

J = 2.4e-5  # kg m^2
LEVEL = 4.5e-3  # N m
COUNT = 2 * np.pi / 1e6  # rad
TORQUE_NOISE = 2e-5  # N m
SAMPLE_TIME = 1e-3  # s

GMS = effects.GMS(
    stiffness=[0.5, 0.12], fraction=[0.45, 0.55], coulomb=LEVEL, static=5e-3, stribeck_velocity=0.5, attraction=0.5
)
HEALTHY = Plant.axis(J) + GMS + effects.Viscous(coefficient=2e-5)
UNKNOWN = Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous()

# Effects of a size that matters, for an axis to hide.
HIDDEN: dict[str, Effect] = {
    "cogging": effects.Cogging(harmonics=[6], amplitude=[0.2 * LEVEL], phase=[0.4]),
    "gravity": effects.Gravity(amplitude=0.3 * LEVEL, phase=1.0),
    "torque_offset": effects.TorqueOffset(torque=0.15 * LEVEL),
    "delay": effects.Delay(time=1.5 * SAMPLE_TIME),
    "quadratic_drag": effects.QuadraticDrag(coefficient=0.3 * LEVEL / 30**2),
}

# Lowest and highest frequency of the torque [Hz], and its rms in friction levels: pre-sliding, break-away, turning.
REGIMES = ((1.0, 60.0, 0.4), (0.5, 40.0, 1.5), (0.3, 15.0, 4.0))


def slow(*values: object) -> list[object]:
    """Values of a parameter of a test, or tuples of those of several, that the usual run leaves out."""
    return [pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=pytest.mark.slow) for v in values]


def run(plant: Plant, torque: np.ndarray, seed: int = 0, sample_time: float = SAMPLE_TIME, **bench: object) -> Record:
    """One run as a good bench logs it; `bench` changes what `simulate` takes."""
    good = {"substeps": 50, "resolution": COUNT, "torque_noise": TORQUE_NOISE, "seed": seed}
    return simulate(plant, torque, sample_time, **{**good, **bench})  # type: ignore[arg-type]


def runs(plant: Plant, use: str = "fit", seconds: float = 3.0, seed: int = 0, **bench: object) -> list[Record]:
    """A run in each regime."""
    out = []
    for i, (low, high, rms) in enumerate(REGIMES):
        rng = np.random.default_rng([seed, i, len(use)])
        torque = multisine(round(seconds / SAMPLE_TIME), SAMPLE_TIME, low, high, rms * LEVEL, rng)
        start = float(rng.uniform(0, 6))
        noise = int(rng.integers(2**31))
        out.append(run(plant, torque, noise, position=start, name=f"{use}_{i}", use=use, **bench))
    return out


@cache
def baseline_fit(hidden: str = "") -> FitResult:
    """The fit of the baseline to runs of the healthy axis, or of one with a hidden effect."""
    return fit(UNKNOWN, runs(HEALTHY + HIDDEN[hidden] if hidden else HEALTHY))


def fitted_sticking(plant: Plant, seed: int) -> FitResult:
    """Friction that does not slip back, fitted to runs of a plant whose friction does or does not."""
    template = plant.replace(plant["gms"].replace(slips_back=0.0))
    misfit = Misfit(template, observe(runs(plant, seconds=6.0, seed=seed), J))
    return refine(misfit, misfit.vector(template))


def dataset(plant: Plant, seconds: float = 3.0, select: bool = False, **bench: object) -> Dataset:
    """Runs to fit, to validate and, where asked for, to select."""
    uses = ("fit", "select", "validate") if select else ("fit", "validate")
    records = [r for i, use in enumerate(uses) for r in runs(plant, use, seconds, i, **bench)]
    return Dataset(Path(), tuple(records), plant.kind, plant.inertia)


def in_mujoco(model: mujoco.MjModel, torque: np.ndarray, substeps: int = 1) -> np.ndarray:
    """(n + 1,) positions of a joint whose first motor holds each of n torques for so many time steps: before each, and
    after the last."""
    data, position = mujoco.MjData(model), np.empty(len(torque) + 1)
    for k, u in enumerate(torque):
        position[k] = data.qpos[0]
        data.ctrl[0] = u
        mujoco.mj_step(model, data, substeps)
    position[-1] = data.qpos[0]
    return position


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def driven(r: Record, torque: np.ndarray) -> Record:
    """The record of an axis that goes the same way under another torque (n,)."""
    return replace(r, signals={**r.signals, "torque": torque})


def worn(r: Record) -> Record:
    """The record of an axis whose friction begins half as strong again, and runs in over 20 rad."""
    v = Observation(r, 100.0).velocity
    gone = np.abs(v).cumsum() * r.sample_time
    return driven(r, r.torque + 0.5 * np.exp(-gone / 20) * (r.torque - J * np.gradient(v, r.time)))
