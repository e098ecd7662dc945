"""The part of an HTML page that shows frequency responses."""

from __future__ import annotations

import math

import numpy as np

from ..comparison.compare_frf import FrfComparison, decibel, degrees, quantities, turned
from ..comparison.noise_band import Z
from . import figure
from .figure import Band, Curve
from .page import NOISE, Shown, escape, percent, table

_OPEN = 4  # responses that are shown unfolded


def responses(shown: Shown) -> str:
    """Resonance and damping against amplitude, and each response, the one explained least first."""
    rows = shown[0][1].frfs
    if not rows:
        return ""
    order = sorted(range(len(rows)), key=lambda i: -rows[i].torque_error)
    cells = [_response(shown, i) for i in order]
    folded = f"<details><summary>{len(cells) - _OPEN} more responses</summary>{''.join(cells[_OPEN:])}</details>"
    key = figure.legend([("measured", figure.COLOURS[0]), *((n, colour) for n, _, colour in shown)], NOISE)
    folded = folded if len(cells) > _OPEN else ""
    return (
        f"<section><h2>Frequency responses</h2><p>Position over {shown[0][1].score.word}. The model is taken at the "
        f"amplitude of the motion measured.</p>{_resonances(shown)}{key}{''.join(cells[:_OPEN])}{folded}"
        "</section>"
    )


def _resonances(shown: Shown) -> str:
    """The Dahl resonance at each amplitude, measured and of each model."""
    rows = []
    for i in sorted(range(len(shown[0][1].frfs)), key=lambda i: float(np.median(shown[0][1].frfs[i].amplitude))):
        first = shown[0][1].frfs[i]
        found = [first.resonance, *(c.frfs[i].model_resonance for _, c, _ in shown)]
        if first.resonance is not None:
            cells = ["-" if r is None else f"{r.frequency:.4g}" for r in found]
            cells += ["-" if r is None else f"{0.5 * r.loss(first.inertia):.3g}" for r in found]
            rows.append([escape(first.name), f"{first.resonance.amplitude:.3g}", *cells])
    if not rows:
        return ""
    names = ["measured", *(escape(n) for n, _, _ in shown)]
    unit = "rad" if shown[0][1].plant.kind == "hinge" else "m"
    heads = ["response", f"amplitude [{unit}]", *(f"resonance [Hz], {n}" for n in names)]
    heads += [f"damping ratio, {n}" for n in names]
    return table(heads, rows, range(1, len(heads)))


def _response(shown: Shown, i: int) -> str:
    rows: list[tuple[str, FrfComparison, str]] = [(name, c.frfs[i], colour) for name, c, colour in shown]
    first, last = rows[0][1], rows[-1][1]
    x = first.frequency
    level = Z / math.sqrt(2) * last.deviation
    pictures, called = [], quantities(shown[0][1].plant.kind)
    for what, unit, of, gap, factor in (
        ("magnitude", "dB", decibel, "magnitude_error", 20 / math.log(10)),
        ("phase", "deg", degrees, "phase_error", 180 / math.pi),
    ):
        drawn = [Curve("measured", x, of(first.response), figure.COLOURS[0], "under")]
        drawn += [Curve(n, x, turned(of(r.model), of(first.response), unit), colour) for n, r, colour in rows]
        left = [Curve(n, x, getattr(r, gap), colour) for n, r, colour in rows]
        band = [Band(x, -factor * level, factor * level)]
        pictures += [
            f"<h4>{what.capitalize()}</h4>"
            + figure.plot(drawn, "frequency", "Hz", called[what], unit, log=(True, False)),
            f"<h4>{what.capitalize()}, measured less model</h4>"
            + figure.plot(left, "frequency", "Hz", "difference", unit, log=(True, False), bands=band),
        ]
    errors = ", ".join(f"{escape(n)} {percent(r.torque_error)}" for n, r, _ in rows)
    cells = "".join(f"<div>{p}</div>" for p in pictures)
    said = f"{shown[0][1].score.name} {errors}; noise floor {percent(last.noise_floor)}"
    return (
        f"<h3>{escape(first.name)} <small>{said}</small></h3>"
        f'<div class="plots">{cells}</div>'
    )
