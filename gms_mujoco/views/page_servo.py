"""The part of an HTML page that shows runs of a servo: goal, measured and simulated position, and their error."""

from __future__ import annotations

import numpy as np

from ..comparison.noise_band import Z
from . import figure
from .figure import Band, Curve
from .page import NOISE, Shown, escape, grid, view_figure, worst_first

_OPEN = 4  # runs that are shown unfolded
GOAL = "#999999"  # colour
_SHORT = 800  # samples, above which the worst stretch is shown beside the whole run


def servo_runs(shown: Shown) -> str:
    """Each run, the one simulated worst first."""
    first = shown[0][1]
    cells = [_run(shown, i) for i in worst_first(first)]
    folded = f"<details><summary>{len(cells) - _OPEN} more runs</summary>{''.join(cells[_OPEN:])}</details>"
    names = [("goal", GOAL), ("measured", figure.COLOURS[0]), *((n, colour) for n, _, colour in shown)]
    return (
        "<section><h2>Run by run</h2><p>The one simulated worst stands first. Without power no goal is drawn."
        f"</p>{figure.legend(names, NOISE)}{''.join(cells[:_OPEN])}{folded if len(cells) > _OPEN else ''}"
        "</section>"
    )


def _run(shown: Shown, i: int) -> str:
    rows = [(name, c.servos[i], colour) for name, c, colour in shown]
    first, last = rows[0][1], rows[-1][1]
    o, score = first.observation, shown[0][1].score
    powered = o.run.powered[o.index] > 0.5
    pictures = []
    parts = [("Position over time", slice(None))]
    if len(first.time) > _SHORT:
        parts.append((f"Where {escape(rows[0][0])} fails most", figure.worst_stretch(first.residual)))
    for title, near in parts:
        curves = [Curve("goal", first.time[near][powered[near]], first.goal[near][powered[near]], GOAL)]
        curves += [Curve("measured", first.time[near], first.position[near], figure.COLOURS[0], "under")]
        curves += [Curve(n, r.time[near], r.simulated[near], colour) for n, r, colour in rows]
        pictures.append(f"<h4>{title}</h4>" + figure.plot(curves, "time", "s", "position", "rad"))
    left = [Curve(n, r.time, r.residual, colour) for n, r, colour in rows]
    level = Z * float(np.sqrt(np.mean(last.floor**2)))
    ends = last.time[[0, -1]]
    pictures.append(
        "<h4>Residual over time <small>measured less simulated</small></h4>"
        + figure.plot(left, "time", "s", "residual", "rad", bands=[Band(ends, np.full(2, -level), np.full(2, level))])
    )
    harmonics = shown[0][1].view("time_harmonic", first.name)
    if harmonics:
        pictures.append(view_figure(shown, harmonics))
    errors = ", ".join(f"{escape(n)} {score.told(r.error)}" for n, r, _ in rows)
    said = f"gain {o.run.gain:g}, payload {o.run.weight:.3g} N m, {o.run.inertia:.3g} kg m^2"
    return (
        f"<h3>{escape(first.name)} <small>{said}; {score.name} {errors}; noise floor "
        f"{score.told(last.noise_floor)}</small></h3>{grid(pictures)}"
    )
