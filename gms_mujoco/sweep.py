"""Stepped sines on a simulated axis, at held torque or held position amplitude: what a bench measures an FRF with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bench import Controller, measure
from .errors import DataError, listing
from .excitation import Excitation
from .frf import FRF, response_unit
from .plant import Plant, slide_unit

Array = NDArray[np.float64]

HELD = ("torque", "position")
_LEAST = 16  # samples of a window
_LATER = 4  # times the windows averaged: after which a motion that was not steady has left
_SURE = 6.0  # standard deviations


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
    controller: Callable[[], Controller] | None = None,
    seed: int = 0,
    **bench: Any,
) -> FRF:
    """Measures a frequency response one sine at a time on a simulated axis, in open loop or inside a position loop.

    Each sine lasts `transient + windows` windows of `periods` periods; its frequency is moved to the nearest one with
    a whole number of samples in a window (see `Excitation.sine`). The amplitude of the torque, or inside a loop of the
    reference, is adjusted between runs until the wanted one is held, as an operator does.

    Args:
        plant: every parameter set.
        frequency: (n,) [Hz], below a quarter of the sample rate.
        amplitude: of the torque [N m] or the position [rad], whichever is held.
        held: "torque" or "position".
        sample_time: [s].
        periods: in a window, the stretch that is averaged.
        windows: averaged.
        transient: windows discarded, during which the sine sets in. A free motion that lasts longer (where little but
            drag damps it, 2 inertia / drag) is taken off, except one at the frequency of the sine itself, to within
            1 over the time averaged: there discard more.
        tolerance: of the held amplitude, relative.
        controller: makes a controller for each run, such as `lambda: control.PID(J, h)`; None: open loop.
        seed: of the noise of the bench.
        **bench: what `measure` takes: resolution, torque_noise, position_noise, substeps.

    Returns:
        The response with the amplitudes reached. A frequency at which no steady motion holds the position within
        `tolerance` (the jump of a softening resonance), or at which the encoder sees nothing, is left out, and a note
        says so.

    Raises:
        DataError: an unknown `held`, a frequency out of reach, or no frequency at which the amplitude is held.
    """
    if held not in HELD:
        raise DataError(f"held must be one of {listing(HELD)}; {held!r} given")
    plant.torque_driven().complete()
    for name, value in (("amplitude", amplitude), ("sample_time", sample_time), ("tolerance", tolerance)):
        if not 0 < value < math.inf:
            raise DataError(f"{name} must be positive; {value:g} given")
    for name, count, least in (("periods", periods, 1), ("windows", windows, 1), ("transient", transient, 0)):
        if not count >= least:
            raise DataError(f"{name} must be {least} or more; {count!r} given")
    points: list[FRF] = []
    missed: list[float] = []
    open_torque = held == "torque" and controller is None
    size = amplitude
    for i, f in enumerate(sorted(float(x) for x in np.atleast_1d(frequency))):
        if not 0 < f < 0.25 / sample_time:
            raise DataError(f"{f:g} Hz is out of reach; expected more than 0 and less than {0.25 / sample_time:g} Hz, "
                            "a quarter of the sample rate")
        sine = Excitation.sine(sample_time, f, 1.0, max(periods, math.ceil(_LEAST * f * sample_time)))
        kept = {"periods": windows, "transient": transient, "controller": controller, "seed": seed + i, **bench}
        run = partial(_run, plant, sine, kept)
        if open_torque:
            try:
                points.append(run(amplitude))
            except DataError:  # less than a count: the encoder sees no motion
                missed.append(f)
            continue
        if not points and not missed:
            size = amplitude * _first_guess(plant, f) ** ((held == "position") - (controller is not None))
        later = partial(_run, plant, sine, {**kept, "transient": transient + _LATER * windows})
        found = _held(run, later, size, amplitude, held, tolerance)
        if found is None:
            missed.append(f)
        else:
            size = found[0]
            points.append(found[1])
    if not points:
        raise DataError(f"{held} amplitude {amplitude:g}: no motion seen, or not held, at any frequency")
    unit = "N m" if held == "torque" else "rad"
    unit = unit if plant.kind == "hinge" else slide_unit(unit)
    notes = [f"stepped sine, {held} amplitude held at {amplitude:.4g} {unit}"]
    if missed:
        why = "no motion seen" if open_torque else f"not held within {100 * tolerance:g} %"
        notes.append(f"{why} at {', '.join(f'{f:.4g}' for f in missed)} Hz")
    fields = ("frequency", "response", "coherence", "sigma", "excitation", "amplitude")
    rows = {k: [getattr(p, k) for p in points] for k in fields}
    joined = {k: None if any(v is None for v in row) else np.concatenate(row) for k, row in rows.items()}
    order = np.unique(np.concatenate([p.frequency for p in points]), return_index=True)[1]
    values: dict[str, Any] = {k: None if v is None else v[order] for k, v in joined.items()}
    own = response_unit("torque", "position", plant.kind)
    return FRF(f"{held} {amplitude:.3g} {unit}", **values, unit=own, sine=True, notes=tuple(notes))


def _run(plant: Plant, sine: Excitation, bench: dict[str, Any], size: float) -> FRF:
    """The response at the frequency that was driven; noise in the torque excites nothing."""
    enters = "torque" if bench["controller"] is None else "reference"
    return measure(plant, sine * size, enters=enters, **bench).frf()


def _first_guess(plant: Plant, frequency: float) -> float:
    """Torque per position on the mass line, or of the friction's springs below it [N m/rad]."""
    assert plant.inertia is not None
    springs = sum(float(np.sum(e.values["stiffness"])) for e in plant.effects if "stiffness" in e.values)
    return max(abs(springs - plant.inertia * (2 * math.pi * frequency) ** 2), 0.1 * springs, 1e-12)


def _held(
    run: Callable[[float], FRF],
    later: Callable[[float], FRF],
    size: float,
    amplitude: float,
    held: str,
    tolerance: float,
) -> tuple[float, FRF] | None:
    """The run whose held amplitude is the wanted one, and the size of its excitation.

    Secant steps in logarithms, halved where they overshoot. At the jump of a softening resonance a run may pass the
    wanted amplitude on its way to another: one that is not steady is looked at again `later`.
    """

    def gap_of(frf: FRF) -> float:
        reached = frf.amplitude if held == "position" else frf.excitation
        return math.log(float(reached[0]) / amplitude)  # type: ignore[index]

    tried: list[tuple[float, float]] = []
    for _ in range(14):
        frf = run(size)
        gap = gap_of(frf)
        tried.append((math.log(size), gap))
        if abs(gap) < tolerance:
            if _scatter(frf) > tolerance:
                again = later(size)
                if abs(gap_of(again) - gap) > tolerance + _SURE * _scatter(again):
                    return None
            return size, frf
        low = [t for t in tried if t[1] < 0]
        high = [t for t in tried if t[1] > 0]
        if low and high:  # regula falsi between the nearest on either side, kept away from its ends
            (a, fa), (b, fb) = max(low, key=lambda t: t[1]), min(high, key=lambda t: t[1])
            share = min(max(fa / (fa - fb), 0.1), 0.9)
            step = a + share * (b - a)
        else:
            step = tried[-1][0] - min(max(0.7 * gap, -1.5), 1.5)
        size = math.exp(step)
    return None


def _scatter(frf: FRF) -> float:
    """Standard deviation of a point, relative."""
    return 0.0 if frf.sigma is None else float(frf.sigma[0] / abs(frf.response[0]))
