"""The stations of a recording that show runs of a servo: goal, measured and simulated position, and their error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import rerun as rr
import rerun.blueprint as rrb

from . import drawing
from .drawing import draw, part, say, series, text
from .figure import COLOURS, Curve
from .page import percent, worst_first
from .page_servo import GOAL

if TYPE_CHECKING:
    from ..compare import Comparison
    from ..diagnosis.findings import Diagnosis

Shown = list[tuple[str, "Comparison", str]]  # name, comparison and colour of each model


def servo_baseline(stream: rr.RecordingStream, models: Shown, diagnosis: Diagnosis) -> rrb.Container:
    """The plant that a search begins with, and the run that it simulates worst."""
    name, c, colour = models[0]
    told = c.score.told
    lines = ["# The baseline", "", f"Position error {told(c.error)}, noise floor {told(c.noise_floor)}: mean absolute "
             "difference of the measured position from the one simulated from the goal.", ""]  # fmt: skip
    lines += ["| regime | of the time | error | noise |", "|---|---|---|---|"]
    lines += [f"| {g.name} | {percent(g.time_share)} | {told(g.error)} | {told(g.floor)} |" for g in c.regimes]
    lines += ["", "| parameter | value | 95 % interval | unit |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in diagnosis.baseline.rows()]
    say(stream, "baseline", lines)
    worst = c.servos[worst_first(c)[0]]
    curves = [
        Curve("goal", worst.time, worst.goal, GOAL),
        Curve("measured", worst.time, worst.position, COLOURS[0], "under"),
        Curve(name, worst.time, worst.simulated, colour),
    ]
    draw(stream, "baseline/run", curves, "time", "s", "position", "rad")
    left = [Curve(name, worst.time, worst.residual, colour, "line")]
    draw(stream, "baseline/error", left, "time", "s", "measured - simulated", "rad")
    return rrb.Horizontal(
        text("baseline", "the baseline"),
        rrb.Vertical(
            drawing.view("baseline/run", f"simulated worst: {worst.name}"),
            drawing.view("baseline/error", "its error"),
        ),
        column_shares=[2, 3],
        name="baseline",
    )


def servo_run(stream: rr.RecordingStream, models: Shown, i: int) -> rrb.Container:
    """One run under every model: position and error over time, and position over goal."""
    first = models[0][1].servos[i]
    root = f"records/{part(first.name)}"
    series(stream, f"{root}/position/goal", "goal", first.time, first.goal, GOAL)
    series(stream, f"{root}/position/measured", "measured", first.time, first.position, COLOURS[0])
    followed = [Curve("measured", first.goal, first.position, COLOURS[0], "under")]
    for name, c, colour in models:
        r = c.servos[i]
        series(stream, f"{root}/position/{part(name)}", name, r.time, r.simulated, colour)
        series(stream, f"{root}/residual/{part(name)}", name, r.time, r.residual, colour)
        followed.append(Curve(name, r.goal, r.simulated, colour))
    ends = followed[:2] + followed[2:][-1:]
    draw(stream, f"{root}/followed", ends, "goal", "rad", "position", "rad")
    run = first.observation.run
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.TimeSeriesView(origin=f"{root}/position", name="position [rad]"),
            rrb.TimeSeriesView(origin=f"{root}/residual", name="residual: measured - simulated [rad]"),
        ),
        drawing.view(f"{root}/followed", f"position over goal; gain {run.gain:g}, payload {run.weight:.3g} N m"),
        column_shares=[3, 2],
        name=first.name,
    )
