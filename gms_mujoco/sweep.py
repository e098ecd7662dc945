"""Stepped sines on a simulated axis, at held torque or held position amplitude: what a bench measures an FRF with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, listing
from .frf import FRF, estimate_frf
from .plant import Plant
from .simulate import simulate

Array = NDArray[np.float64]

HELD = ("torque", "position")
_LEAST = 16  # samples of a window


def stepped_sine(
    plant: Plant,
    frequency: Sequence[float] | Array,
    amplitude: float,
    *,
    held: str = "position",
    sample_time: float = 5e-4,
    periods: int = 8,
    windows: int = 4,
    transient: int = 2,
    tolerance: float = 2e-3,
    seed: int = 0,
    **bench: Any,
) -> FRF:
    """Measures a frequency response one sine at a time, in open loop, on a simulated axis.

    Each sine lasts `transient + windows` windows of `periods` periods; its frequency is moved to the nearest one with
    a whole number of samples in a window (at most by 1 / (2 n) of itself, n samples in a window). At held position
    the torque amplitude is adjusted between runs, as an operator does.

    Args:
        plant: every parameter set.
        frequency: (n,) [Hz], below half the sample rate.
        amplitude: of the torque [N m] or the position [rad], whichever is held.
        held: "torque" or "position".
        sample_time: [s].
        periods: in a window, the stretch that is averaged.
        windows: averaged.
        transient: windows discarded.
        tolerance: of the held position amplitude, relative.
        seed: of the noise of the bench.
        **bench: what `simulate` takes: resolution, torque_noise, position_noise, substeps.

    Returns:
        The response with the amplitudes reached. A frequency at which the position cannot be held within
        `tolerance` (the jump of a softening resonance), or at which the encoder sees nothing, is left out, and a note
        says so.

    Raises:
        DataError: an unknown `held`, a frequency out of reach, or no frequency at which the amplitude is held.
    """
    if held not in HELD:
        raise DataError(f"held must be one of {listing(HELD)}; {held!r} given")
    if amplitude <= 0:
        raise DataError(f"amplitude must be positive; {amplitude:g} given")
    points: list[FRF] = []
    missed: list[float] = []
    torque = amplitude
    for i, f in enumerate(sorted(float(x) for x in frequency)):
        if not 0 < f < 0.25 / sample_time:
            raise DataError(f"{f:g} Hz is out of reach; expected more than 0 and less than {0.25 / sample_time:g} Hz")
        n = max(round(periods / (f * sample_time)), _LEAST)

        phase = 2 * math.pi * periods / n * np.arange(n * (windows + transient))
        # A sine that sets in at its full amplitude would leave the springs off their centre for long.
        ramp = np.clip(np.arange(len(phase)) / (n * transient * 0.75), 0, 1) if transient else np.ones(len(phase))
        kept = {"seed": seed + i, **bench}
        run = partial(_run, plant, ramp * np.sin(phase), n, periods, transient, sample_time, kept)
        if held == "torque":
            try:
                points.append(run(amplitude))
            except DataError:  # less than a count: the encoder sees no motion
                missed.append(f)
            continue
        if not points and not missed:
            torque = amplitude * _first_guess(plant, amplitude, f)
        found = _held(run, torque, amplitude, tolerance)
        if found is None:
            missed.append(f)
        else:
            points.append(found)
            torque = float(found.excitation[0])  # type: ignore[index]
    if not points:
        raise DataError(f"{held} amplitude {amplitude:g}: no motion seen, or not held, at any frequency")
    unit = "N m" if held == "torque" else "rad"
    notes = [f"stepped sine, {held} amplitude held at {amplitude:.4g} {unit}"]
    if missed:
        why = "no motion seen" if held == "torque" else f"not held within {100 * tolerance:g} %"
        notes.append(f"{why} at {', '.join(f'{f:.4g}' for f in missed)} Hz")
    fields = ("frequency", "response", "coherence", "sigma", "excitation", "amplitude")
    rows = {k: [getattr(p, k) for p in points] for k in fields}
    joined = {k: None if any(v is None for v in row) else np.concatenate(row) for k, row in rows.items()}
    order = np.unique(np.concatenate([p.frequency for p in points]), return_index=True)[1]
    values: dict[str, Any] = {k: None if v is None else v[order] for k, v in joined.items()}
    return FRF(f"{held} {amplitude:.3g} {unit}", **values, sine=True, notes=tuple(notes))


def _run(
    plant: Plant, wave: Array, n: int, periods: int, transient: int, sample_time: float, bench: Any, torque: float
) -> FRF:
    """The response at the frequency that was driven; noise in the torque excites nothing."""
    record = simulate(plant, torque * wave, sample_time, **bench)
    frf = estimate_frf(record, period=n * sample_time, transient=transient)
    frequency = periods / (n * sample_time)
    return frf.where(np.abs(frf.frequency / frequency - 1) < 1e-6)


def _first_guess(plant: Plant, amplitude: float, frequency: float) -> float:
    """Torque per position on the mass line, or of the friction's springs below it [N m/rad]."""
    assert plant.inertia is not None
    springs = sum(float(np.sum(e.values["stiffness"])) for e in plant.effects if "stiffness" in e.values)
    return max(abs(springs - plant.inertia * (2 * math.pi * frequency) ** 2), 0.1 * springs, 1e-12)


def _held(run: Callable[[float], FRF], torque: float, amplitude: float, tolerance: float) -> FRF | None:
    """The run whose position amplitude is the wanted one: secant steps in logarithms, halved where they overshoot."""
    tried: list[tuple[float, float]] = []
    for _ in range(14):
        frf = run(torque)
        gap = math.log(float(frf.amplitude[0]) / amplitude)  # type: ignore[index]
        tried.append((math.log(torque), gap))
        if abs(gap) < tolerance:
            return frf
        low = [t for t in tried if t[1] < 0]
        high = [t for t in tried if t[1] > 0]
        if low and high:  # regula falsi between the nearest on either side, kept away from its ends
            (a, fa), (b, fb) = max(low, key=lambda t: t[1]), min(high, key=lambda t: t[1])
            share = min(max(fa / (fa - fb), 0.1), 0.9)
            step = a + share * (b - a)
        else:
            step = tried[-1][0] - min(max(0.7 * gap, -1.5), 1.5)
        torque = math.exp(step)
    return None
