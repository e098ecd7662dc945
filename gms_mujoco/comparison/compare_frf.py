"""compare, for frequency responses: residual with phase, and how resonance and damping drift with amplitude."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frf import FRF, response_unit
from ..identification.frf_observation import FrfObservation
from ..identification.noise import Noise, floor_residual
from ..native import Joint
from ..plant import Plant
from ..responses.harmonics import SAMPLES, fundamental
from ..responses.resonance import Resonance, find_resonance
from .score import WEIGHED

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

PERIODS = 16  # of a forward simulation, the later half of which is judged
_MOST = 16  # times those, until the motion is steady: what moves freely beside the sine may die slowly
_STEADY = 1e-3  # of the response: what periods differ by in a motion that is steady
_RAMP = 6  # periods: a sine that sets in at once would leave the springs off their centre
_SUBSTEPS = 4  # of a simulation per sample


@dataclass(frozen=True)
class FrfComparison:
    """One frequency response against the plant.

    Attributes:
        name, use: of the response.
        torque_error: rms of measured minus needed torque over rms of measured torque, each point of both divided by
            its standard deviation; where good points fit it may be small while bad ones are far off.
        simulation_error: rms of the relative difference of the response and that of a forward simulation under the
            same torque from rest, once its motion is steady.
        noise_floor: the torque error that the uncertainty of the response alone leaves, one draw: it comes near an
            error that is noise, from above as from below, and is scaled down where it is far above what is left.
        frequency: (n,) [Hz].
        amplitude: (n,) of the position [rad].
        response: (n,) measured [rad/(N m)].
        model: (n,) of the plant at the same amplitude of motion [rad/(N m)].
        deviation: (n,) relative standard deviation of the response.
        resonance, model_resonance: where position lags torque by a quarter of a turn, measured and of the plant; None
            where there is none among the points.
        inertia: of the plant [kg m^2].
        measured, needed, floor: (2 n,) rows, see `FrfObservation` [N m].
    """

    name: str
    use: str
    torque_error: float
    simulation_error: float
    noise_floor: float
    frequency: Array
    amplitude: Array
    response: Complex
    model: Complex
    deviation: Array
    resonance: Resonance | None
    model_resonance: Resonance | None
    inertia: float
    measured: Array
    needed: Array
    floor: Array

    @property
    def error(self) -> float:
        """The torque error."""
        return self.torque_error

    @property
    def residual(self) -> Array:
        """(2 n,) rows of measured minus needed torque [N m]."""
        return self.measured - self.needed

    @property
    def magnitude_error(self) -> Array:
        """(n,) of the measured response over the plant's [dB]."""
        return np.asarray(20 * np.log10(np.abs(self.response / self.model)))

    @property
    def phase_error(self) -> Array:
        """(n,) of the measured response less that of the plant's [deg]."""
        return np.asarray(np.degrees(np.angle(self.response / self.model)))

    @property
    def band_db(self) -> Array:
        """(n,) half width of the 95 % band of the magnitude error that the uncertainty of the response sets [dB]."""
        return np.asarray(1.96 / math.sqrt(2) * 20 / math.log(10) * self.deviation)

    @property
    def band_deg(self) -> Array:
        """(n,) half width of the 95 % band of the phase error [deg]."""
        return np.degrees(1.96 / math.sqrt(2) * self.deviation)

    def to_dict(self) -> dict[str, Any]:
        """As `compare --json` writes it."""

        def shown(r: Resonance | None) -> dict[str, float] | None:
            if r is None:
                return None
            return {"frequency_hz": r.frequency, "damping_ratio": 0.5 * r.loss(self.inertia), "amplitude": r.amplitude}

        return {
            "name": self.name,
            "use": self.use,
            "torque_error": self.torque_error,
            "simulation_error": self.simulation_error,
            "noise_floor": self.noise_floor,
            "resonance": shown(self.resonance),
            "model_resonance": shown(self.model_resonance),
            "frequency_hz": self.frequency.tolist(),
            "magnitude_error_db": self.magnitude_error.tolist(),
            "phase_error_deg": self.phase_error.tolist(),
            "band95_db": self.band_db.tolist(),
            "band95_deg": self.band_deg.tolist(),
        }


def compare_frf(plant: Plant, o: FrfObservation, rng: np.random.Generator) -> FrfComparison:
    """A response against a plant with every parameter set."""
    assert plant.inertia is not None
    o = o.settled(plant)
    measured, needed = o.applied(plant), o.needed(plant)
    floor = floor_residual(o, plant, None, Noise(0.0, 0.0, 0.0), rng, measured - needed)  # as a fit tells it
    model = o.model_response(plant)
    size = float(np.sqrt(np.mean(measured**2)))
    f = o.frf
    return FrfComparison(
        o.name,
        o.use,
        float(np.sqrt(np.mean((measured - needed) ** 2))) / size,
        float(np.sqrt(np.mean(np.abs(simulated_response(plant, o) / f.response - 1) ** 2))),
        float(np.sqrt(np.mean(floor**2))) / size,
        f.frequency,
        o.size,
        f.response,
        model,
        o.deviation / np.abs(o.torque),
        find_resonance(f),
        _resonance(f, model),
        plant.inertia,
        measured,
        needed,
        floor,
    )


def _resonance(frf: FRF, model: Complex) -> Resonance | None:
    if not (np.isfinite(model).all() and np.all(model != 0)):
        return None
    return find_resonance(replace(frf, response=model, excitation=None, sigma=None, sigma_noise=None))


def simulated_response(plant: Plant, o: FrfObservation) -> Complex:
    """(n,) response of a forward simulation from rest under the torques of an observation, once it is steady."""
    torque = o.torque * o.drive_response(plant)
    # Held over a sample, a torque acts half a sample late.
    late = np.exp(1j * math.pi / SAMPLES) / np.sinc(1 / SAMPLES)
    joint, inertia = plant.joint(), plant.driven_inertia
    moved = [_steady(joint, inertia, f, u) for f, u in zip(o.frf.frequency.tolist(), torque.tolist(), strict=True)]
    return np.asarray(np.array(moved) * late / o.torque, complex)


def _steady(joint: Joint, inertia: float, frequency: float, torque: complex) -> complex:
    """First harmonic of the position under a sine that rises from nothing [rad]."""
    step = 1 / (SAMPLES * frequency)
    there: dict[str, Any] = {}
    found = complex(math.nan)
    for k in range(_MOST):
        wave = k * PERIODS + np.arange(SAMPLES * PERIODS + 1) / SAMPLES
        rise = 0.5 - 0.5 * np.cos(math.pi * np.minimum(wave / _RAMP, 1))
        driven = rise * np.real(torque * np.exp(2j * math.pi * wave))
        moved = joint.simulate(
            inertia, step, driven, substeps=_SUBSTEPS, start=wave[0] / frequency, states=True, **there
        )
        if not np.isfinite(moved.position).all():  # of what runs away the error is not a number
            return complex(math.nan)
        there = {"position": moved.position[-1], "velocity": moved.velocity[-1]}
        if moved.states is not None and moved.states.shape[1]:
            there["state"] = moved.states[-1]
        lead = 0.5 * step / _SUBSTEPS * moved.velocity  # see simulate
        periods = (moved.position - lead)[:-1].reshape(PERIODS, SAMPLES)[PERIODS // 2 :]
        drift = np.polyfit(np.arange(len(periods)), periods.mean(1), 1)[0] / SAMPLES
        each = fundamental(periods - drift * np.arange(SAMPLES))
        found = complex(each.mean())
        if np.abs(each - found).max() < _STEADY * abs(found):
            break
    return found


def table(rows: tuple[FrfComparison, ...], what: str = "torque") -> str:
    """Errors in percent, and resonance and damping ratio, measured and of the plant, from small amplitude to large."""
    width = max([len(r.name) for r in rows] + [8])
    lines = [f"{what} error in % of the {what}, {WEIGHED}",
             f"{'response':{width}}  {'use':8}  {what:>8}  {'floor':>8}  {'simulation':>10}  "
             f"{'resonance [Hz]':>18}  {'damping ratio':>17}   measured / plant"]
    for r in sorted(rows, key=lambda r: float(np.median(r.amplitude))):
        both = (r.resonance, r.model_resonance)
        tuned = " / ".join("-" if x is None else f"{x.frequency:.4g}" for x in both)
        damped = " / ".join("-" if x is None else f"{0.5 * x.loss(r.inertia):.3g}" for x in both)
        lines.append(f"{r.name:{width}}  {r.use:8}  {100 * r.torque_error:8.2f}  {100 * r.noise_floor:8.2f}  "
                     f"{100 * r.simulation_error:10.2f}  {tuned:>18}  {damped:>17}")
    return "\n".join(lines)


def quantities(kind: str) -> dict[str, str]:
    """What magnitude and phase are called on an axis, for a joint of a kind: a magnitude in dB is that of a ratio."""
    return {"magnitude": f"magnitude re 1 {response_unit('torque', 'position', kind)}", "phase": "phase"}


def decibel(response: Complex) -> Array:
    """(n,) magnitude of a response [dB]."""
    return np.asarray(20 * np.log10(np.abs(response)))


def degrees(response: Complex) -> Array:
    """(n,) phase of a response without jumps [deg]."""
    return np.asarray(np.degrees(np.unwrap(np.angle(response))))


def turned(value: Array, like: Array, unit: str) -> Array:
    """A phase by as many whole turns as bring it closest to another; anything else as it is."""
    return value + 360 * np.round((like[0] - value[0]) / 360) if unit == "deg" else value
