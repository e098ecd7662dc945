"""A diagnosis as a rerun recording, a guided tour from the baseline to the error that has fallen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from .. import effects
from ..comparison.compare_frf import decibel, degrees, quantities, turned
from ..comparison.score import Score
from ..identification.motion import break_away_distance, virgin_curve
from . import drawing
from .drawing import BOX, draw, labels, part, rgb, say, series, text
from .figure import COLOURS, Band, Curve, step_colour, worst_stretch
from .page import RESIDUAL, conditions, friction, percent, telling, worst_first
from .report import VERDICTS, step_names
from .tour_servo import servo_baseline, servo_run

if TYPE_CHECKING:
    from ..compare import Comparison, RecordComparison
    from ..diagnosis.findings import Diagnosis

Array = NDArray[np.float64]
Shown = list[tuple[str, "Comparison", str]]  # name, comparison and colour of each model

_GREY = (150, 150, 150)
_FIRST, _LAST = COLOURS[1], COLOURS[2]
_ROW = 0.3  # from bar to bar


def write_recording(path: str | Path, diagnosis: Diagnosis) -> None:
    """Writes the recording of a diagnosis.

    Entities: `verdict`, `baseline`, `fails`, `candidates`, `added/EFFECT` (texts); `errors` (bars);
    `fails/views/NAME`, `added/EFFECT/views/NAME`, `final/views/NAME` (residual views with their noise band),
    `reversal` and `virgin` (hysteresis); for each validate record `records/NAME/torque/...`, `residual/...` (over
    time), `loop` (drawn), and for each run of a servo `records/NAME/position/...`, `residual/...`, `followed` (drawn);
    for each frequency response `responses/NAME/magnitude`, `phase` and their errors. Drawn
    numbers stand unscaled in `.../data/CURVE`.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    facts = diagnosis.to_dict()
    names = step_names(facts)
    named = enumerate(zip(names, diagnosis.comparisons, strict=False))
    models = [(n, c, step_colour(k, len(names))) for k, (n, c) in named]
    with drawing.recording(path) as stream:
        tabs = [_verdict(stream, models, facts, names, diagnosis.score)]
        if models and models[0][1].timed:
            begun = (servo_baseline if models[0][1].servos else _baseline)(stream, models, diagnosis)
            tabs += [begun, _fails(stream, models)]
        if facts.get("candidates"):
            tabs.append(_candidates(stream, models, facts, diagnosis.score))
        tabs += [_added(stream, models, facts, k) for k in range(1, len(models))]
        if models and models[0][1].timed:
            one = servo_run if models[0][1].servos else _record
            order = worst_first(models[0][1])
            tabs += [_final(stream, models)] if len(models) > 1 else []
            tabs.append(rrb.Tabs(*(one(stream, models, i) for i in order), name="record by record"))
        if models and models[0][1].frfs:
            found = (_response(stream, models, i) for i in range(len(models[0][1].frfs)))
            tabs.append(rrb.Tabs(*found, name="frequency responses"))
        blueprint = rrb.Blueprint(
            rrb.Tabs(*tabs, active_tab=0), rrb.TimePanel(state="hidden", timeline="time"), collapse_panels=True
        )
        stream.send_blueprint(blueprint)


def _verdict(
    stream: rr.RecordingStream, models: Shown, facts: dict[str, Any], names: list[str], score: Score
) -> rrb.Container:
    told = score.told
    lines = [f"# {str(facts['verdict']).replace('_', ' ')}", "", VERDICTS.get(facts["verdict"], ""), ""]
    lines += ["| step | fit | validate |", "|---|---|---|"]
    for name, s in zip(names, facts["steps"], strict=True):
        lines.append(f"| {name} | {told(s.get('fit_error'))} | {told(s.get('validate_error'))} |")
    lines += [f"| noise floor | {told(facts.get('fit_noise_floor'))} | {told(facts.get('noise_floor'))} |", ""]
    if models and models[0][1].where:
        lines.append(f"**Where the baseline fails:** {models[0][1].where.replace(chr(10), '; ')}.\n")
    lines += [f"{s['evidence']}\n" for s in facts["steps"] if s.get("evidence")]
    if facts.get("remainder"):
        lines.append(f"**What remains:** {facts['remainder']}\n")
    if facts.get("next_experiment"):
        lines.append(f"**Measure next:** {facts['next_experiment']}\n")
    lines.append("The tabs above lead from the baseline to the error that has fallen.")
    say(stream, "verdict", lines)
    held_out = all(s.get("validate_error") is not None for s in facts["steps"])
    errors = [float(s["validate_error" if held_out else "fit_error"]) for s in facts["steps"]]
    rows = [(n, e, step_colour(k, len(names))) for k, (n, e) in enumerate(zip(names, errors, strict=True))]
    bars = _bars(stream, "errors", rows, facts.get("noise_floor"), told)
    bars.name = f"{score.name} on {'validate' if held_out else 'fit'} records"
    if not models or not models[0][1].timed:
        return rrb.Horizontal(text("verdict", "verdict"), bars, name="verdict")
    # What the whole is about in three pictures: the errors, where the baseline failed most, and that in time.
    best = _views(stream, "verdict/views", _ends(models), models[0][1], 1, columns=1)
    c = models[0][1]
    worst = c.timed[worst_first(c)[0]].name
    unit = _units(c)[0 if c.records else 1]
    residual = rrb.TimeSeriesView(
        origin=f"records/{part(worst)}/residual", name=f"residual over time, {worst} [{unit}]"
    )
    right = rrb.Vertical(bars, best, residual, row_shares=[3, 4, 3])
    return rrb.Horizontal(text("verdict", "verdict"), right, column_shares=[2, 3], name="verdict")


def _baseline(stream: rr.RecordingStream, models: Shown, diagnosis: Diagnosis) -> rrb.Container:
    name, c, colour = models[0]
    torque, angle = _units(c)
    said = c.score.name.capitalize()
    lines = ["# The baseline", "", f"{said} {percent(c.torque_error)}, noise floor {percent(c.noise_floor)}.", ""]
    lines += ["| regime of friction | of the time | error | noise |", "|---|---|---|---|"]
    lines += [f"| {g.name} | {percent(g.time_share)} | {percent(g.error)} | {percent(g.floor)} |" for g in c.regimes]
    lines += ["", "| parameter | value | 95 % interval | unit |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in diagnosis.baseline.rows()]
    say(stream, "baseline", lines)
    span = max(float(np.ptp(r.position)) for r in c.records)
    if span > 0:
        far = min(4 * max(break_away_distance(m.plant, span) for _, m, _ in _ends(models)) or span, span)
        curves = [Curve(n, *virgin_curve(m.plant, far), col) for n, m, col in _ends(models)]
        draw(stream, "virgin", curves, "distance from rest", angle, "friction", torque, log=(True, False))
    found = [(n, m.after_reversal, col) for n, m, col in _ends(models)]
    curves = [Curve(n, f[0], f[2], col, "steps") for n, f, col in found if f is not None]
    if curves:
        last = found[-1][1] or found[0][1]
        assert last is not None
        curves.insert(0, Curve("measured", last[0], last[1], COLOURS[0], "under"))
        draw(stream, "reversal", curves, "distance since the reversal", angle, "friction along the motion", torque,
             log=(True, False))  # fmt: skip
    worst = c.records[worst_first(c)[0]]
    _loop(stream, "baseline/loop", [(name, c, colour)], worst.name)
    return rrb.Horizontal(
        text("baseline", "the baseline"),
        rrb.Vertical(
            drawing.view("baseline/loop", f"hysteresis where it fails most, {worst.name}"),
            drawing.view("reversal", "how friction turns round after a reversal"),
            drawing.view("virgin", f"virgin curve of the model{conditions(_ends(models)[-1][1].plant)}"),
        ),
        column_shares=[2, 3],
        name="baseline",
    )


def _fails(stream: rr.RecordingStream, models: Shown) -> rrb.Container:
    c = models[0][1]
    lines = ["# Where the baseline fails", "", *c.where.splitlines(), ""]
    lines += [
        f"Each drawing is the mean of the residual, {RESIDUAL[c.score.word]}, over one "
        "quantity. Within the grey band it may be sensor noise. Share: of the squared residual that is a function of "
        "this quantity.",
        "",
        "| view | outside | share |",
        "|---|---|---|",
    ]
    for m in c.views:
        if not m.record and m.style == "steps":
            lines.append(f"| {m.label} | {int(m.outside.sum())} of {len(m.mean)} | {100 * m.share:.0f} % |")
    say(stream, "fails", lines)
    grid = _views(stream, "fails/views", models[:1], c)
    return rrb.Horizontal(text("fails", "where it fails"), grid, column_shares=[1, 3], name="where it fails")


def _candidates(
    stream: rr.RecordingStream, models: Shown, facts: dict[str, Any], score: Score
) -> rrb.Container:
    ranked = sorted(facts["candidates"], key=lambda c: (c.get("p_value") is None, c.get("p_value")))
    lines = ["# Candidates that were not added", ""]
    lines += ["p value: how easily chance alone would lower the error on held-out blocks as much.", ""]
    lines += ["| effect | validate error | p value | what it would look like |", "|---|---|---|---|"]
    for c in ranked:
        signature = effects.find(c["effect"]).signature if c["effect"] in effects.CATALOGUE else ""
        signature = signature.replace("torque error", score.name)
        error = score.told(c.get("validate_error"))
        lines.append(f"| {c['effect']} | {error} | {_p(c.get('p_value'))} | {signature} |")
    say(stream, "candidates", lines)
    tried = text("candidates", "effects that were tried")
    if not models or not models[0][1].timed:
        return rrb.Horizontal(tried, name="candidates")
    left = _views(stream, "candidates/views", models[-1:], models[-1][1], 3, columns=1)
    return rrb.Horizontal(tried, left, column_shares=[3, 2], name="candidates")


def _added(stream: rr.RecordingStream, models: Shown, facts: dict[str, Any], k: int) -> rrb.Container:
    step = facts["steps"][k]
    (before, first, _), (after, last, _) = models[k - 1], models[k]
    root = f"added/{part(step['effect'])}"
    lines = [f"# {after}", "", step.get("evidence") or "", ""]
    score = last.score
    fallen = f"{score.told(first.error)} with {before}, {score.told(last.error)} with {after}"
    lines += [f"{score.name.capitalize()} {fallen}.", ""]
    if step.get("confusable_with"):
        lines += [f"These records cannot tell it from {', '.join(step['confusable_with'])}.", ""]
    lines += ["| parameter | value | 95 % interval | unit |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(r)} |" for r in last.plant.rows() if r[0].startswith(f"{step['effect']}.")]
    lines += ["", *(f"**{n}:** {c.where.replace(chr(10), '; ')}.\n" for n, c, _ in models[k - 1 : k + 1] if c.where)]
    say(stream, root, lines)
    if not last.timed:
        return rrb.Horizontal(text(root, after), name=after)
    shown = [(before, first, _FIRST), (after, last, _LAST)]
    grid = _views(stream, f"{root}/views", shown, first)
    return rrb.Horizontal(text(root, after), grid, column_shares=[1, 3], name=after)


def _final(stream: rr.RecordingStream, models: Shown) -> rrb.Container:
    """The errors and what the last model leaves over, at the scale of its noise."""
    grid = _views(stream, "final/views", models[-1:], models[-1][1])
    bars = rrb.Spatial2DView(origin="errors", name=models[-1][1].score.name, visual_bounds=_bar_bounds(len(models)))
    left = rrb.Vertical(bars, text("final", "what is left"), row_shares=[1, 1])
    c = models[-1][1]
    lines = ["# What is left", "", *c.where.splitlines(), "", "| regime | error | noise |", "|---|---|---|"]
    told = c.score.told
    say(stream, "final", lines + [f"| {g.name} | {told(g.error)} | {told(g.floor)} |" for g in c.regimes])
    return rrb.Horizontal(left, grid, column_shares=[1, 3], name="error falls")


def _record(stream: rr.RecordingStream, models: Shown, i: int) -> rrb.Container:
    """One validate record under every model: torque and residual over time, and the hysteresis."""
    first = models[0][1].records[i]
    torque, _ = _units(models[0][1])
    root = f"records/{part(first.name)}"
    series(stream, f"{root}/torque/measured", "measured", first.time, first.measured, COLOURS[0])
    for name, c, colour in models:
        r = c.records[i]
        series(stream, f"{root}/torque/{part(name)}", name, r.time, r.needed, colour)
        series(stream, f"{root}/residual/{part(name)}", name, r.time, r.residual, colour)
    _loop(stream, f"{root}/loop", _ends(models), first.name)
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.TimeSeriesView(origin=f"{root}/torque", name=f"{models[0][1].score.word} [{torque}]"),
            rrb.TimeSeriesView(origin=f"{root}/residual", name=f"residual: measured - model [{torque}]"),
        ),
        drawing.view(f"{root}/loop", "friction over position where the baseline fails most"),
        column_shares=[3, 2],
        name=first.name,
    )


def _response(stream: rr.RecordingStream, models: Shown, i: int) -> rrb.Container:
    """One frequency response and that of the first and the last model, and by how much they differ."""
    shown = _ends(models)
    first = shown[0][1].frfs[i]
    root, f = f"responses/{part(first.name)}", first.frequency
    views = []
    for what, unit, of, spread in (
        ("magnitude", "dB", decibel, first.band_db), ("phase", "deg", degrees, first.band_deg)
    ):  # fmt: skip
        curves = [Curve("measured", f, of(first.response), COLOURS[0], "under")]
        turned_ = [(n, turned(of(c.frfs[i].model), of(first.response), unit), colour) for n, c, colour in shown]
        curves += [Curve(n, f, y, colour) for n, y, colour in turned_]
        left = [Curve(n, f, getattr(c.frfs[i], f"{what}_error"), colour, "steps") for n, c, colour in shown]
        for entity, drawn, label, bands in (
            (what, curves, quantities(shown[0][1].plant.kind)[what], []),
            (f"{what}_error", left, f"measured - model, {what}", [Band(f, -spread, spread)])
        ):  # fmt: skip
            draw(stream, f"{root}/{entity}", drawn, "frequency", "Hz", label, unit, bands=bands, log=(True, False),
                 band_name="95 % of the uncertainty")  # fmt: skip
            views.append(drawing.view(f"{root}/{entity}", label))
    return rrb.Horizontal(rrb.Vertical(*views[::2]), rrb.Vertical(*views[1::2]), name=first.name)


def _views(
    stream: rr.RecordingStream, root: str, shown: Shown, like: Comparison, most: int = 6, columns: int = 2
) -> rrb.Container:
    """The most telling views of the residual, each over the noise band of the last model."""
    cells = []
    for m in telling(like)[0][:most]:
        curves, bands = [], []
        for name, c, colour in shown:
            if (v := c.view(m.name)) is not None:
                keep = v.centres > 0 if v.log[0] else np.ones(len(v.centres), bool)
                curves.append(Curve(name, v.centres[keep], v.mean[keep], colour, v.style))
                bands = [Band(v.centres[keep], v.low[keep], v.high[keep])]
        entity = f"{root}/{m.name}"
        draw(stream, entity, curves, m.label, m.unit, m.value_label, m.value_unit, bands=bands, log=m.log)
        cells.append(drawing.view(entity, m.title))
    return rrb.Grid(*cells, grid_columns=columns)


def _loop(stream: rr.RecordingStream, entity: str, shown: Shown, record: str) -> None:
    """Friction over position, measured and of each model, in the stretch where the first model fails most."""
    torque, angle = _units(shown[0][1])
    found: list[tuple[str, Comparison, RecordComparison, str]] = [
        (n, c, r, colour) for n, c, colour in shown for r in c.records if r.name == record
    ]
    near = worst_stretch(found[0][2].residual)
    _, c, r, _ = found[-1]
    curves = [Curve("measured", r.position[near], friction(c, r)[0][near], COLOURS[0], "under")]
    curves += [Curve(n, r.position[near], friction(c, r)[1][near], colour) for n, c, r, colour in found]
    draw(stream, entity, curves, "position", angle, "friction", torque)


def _bars(
    stream: rr.RecordingStream, entity: str, rows: Sequence[tuple[str, float, str]], floor: float | None,
    told: Callable[[float], str],
) -> rrb.Spatial2DView:
    """A bar per row and a line at the noise floor."""
    known = [v for _, v, _ in rows if np.isfinite(v)]
    scale = BOX[0] / max(*known, floor or 0.0, 1e-12)
    for i, (name, value, colour) in enumerate(rows):
        bar = [[(0.0, _ROW * i), (max(value * scale, 0.0) if np.isfinite(value) else 0.0, _ROW * i)]]
        stream.log(f"{entity}/{i}", rr.LineStrips2D(bar, colors=[rgb(colour)], radii=0.03), static=True)
        said = labels([(0.3 * BOX[0], _ROW * i + 0.04)], [f"{name}   {told(value)}"])
        stream.log(f"{entity}/{i}/label", said, static=True)
    if floor:
        x, low = floor * scale, _ROW * len(rows) - 0.1
        line = rr.LineStrips2D([[(x, -0.1), (x, low)]], colors=[_GREY], radii=-0.9)
        stream.log(f"{entity}/floor", line, static=True)
        stream.log(f"{entity}/floor/label", labels([(x, low)], [f"noise floor   {told(floor)}"]), static=True)
    return rrb.Spatial2DView(origin=entity, visual_bounds=_bar_bounds(len(rows)))


def _bar_bounds(rows: int) -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[-0.2, BOX[0] + 0.2], y_range=[-0.2, max(_ROW * rows + 0.2, 0.8)])


def _ends(models: Shown) -> Shown:
    """The first model, and the last where there are several, red and green."""
    name, c, _ = models[0]
    first = (name, c, _FIRST)
    return [first] if len(models) == 1 else [first, (models[-1][0], models[-1][1], _LAST)]


def _units(c: Comparison) -> tuple[str, str]:
    return ("N m", "rad") if c.plant.kind == "hinge" else ("N", "m")


def _p(value: Any) -> str:
    return f"{value:.2g}" if isinstance(value, int | float) else "-"
