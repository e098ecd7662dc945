"""A diagnosis as a rerun recording, and the viewer to look at it."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from . import files
from .compare_frf import decibel, degrees
from .errors import DataError, GmsError
from .figure import spread, thin, worst_stretch
from .page import worst_first
from .report import step_names

if TYPE_CHECKING:
    from .diagnose import Diagnosis
    from .learn import Training

Array = NDArray[np.float64]

RECORDING = "recording.rrd"
_MEASURED = (76, 114, 176)
_STEPS = ((196, 78, 82), (184, 134, 11), (129, 114, 179), (42, 157, 92))
_GREY = (128, 128, 128)
_LOADING = 8.0  # s from the first frame until notices have gone and all data is drawn
_MOST = 4000  # samples of one record in the time plots
_THIN = -0.75  # radius of a line; negative: in points of the screen
_BOX = (2.4, 1.0)  # rerun has no x-y plot: curves are scaled into a box of this width and height


def write_recording(path: str | Path, diagnosis: Diagnosis) -> None:
    """Writes the recording of a diagnosis.

    Entities: `verdict` (text), `errors` (bars), and for each validate record `records/NAME/torque/...`,
    `residual/...` (in time), `loop`, `over_position`, `over_velocity` (drawn); for each frequency response
    `responses/NAME/magnitude`, `phase` and their errors.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    table = diagnosis.to_dict()
    names = step_names(table)
    with files.whole(path) as temporary, rr.RecordingStream("gms_mujoco") as stream:
        stream.save(temporary)
        stream.log("verdict", rr.TextDocument(_text(table, names), media_type="text/markdown"), static=True)
        _errors(stream, table, names)
        order = worst_first(diagnosis.comparisons[0]) if diagnosis.comparisons else []
        tabs = [_record(stream, diagnosis, names, i) for i in order]
        responses = diagnosis.comparisons[0].frfs if diagnosis.comparisons else ()
        tabs += [_response(stream, diagnosis, names, i) for i in range(len(responses))]
        bounds = rrb.VisualBounds2D(x_range=[-0.2, _BOX[0] + 0.2], y_range=[-0.2, max(0.3 * len(names) + 0.2, 0.8)])
        overview = rrb.Horizontal(
            rrb.TextDocumentView(origin="verdict", name="verdict"),
            rrb.Spatial2DView(origin="errors", name="error on validate records", visual_bounds=bounds),
            name="overview",
        )
        rows = rrb.Vertical(overview, rrb.Tabs(*tabs), row_shares=[1, 2]) if tabs else overview
        stream.send_blueprint(
            rrb.Blueprint(rows, rrb.TimePanel(state="collapsed", timeline="time"), collapse_panels=True)
        )
        stream.flush()
        stream.disconnect()


def write_training(path: str | Path, training: Training) -> None:
    """Writes the recording of a training: `curve/...` drawn over generations, `test/position/...`, `test/error/...`.

    Raises:
        GmsError: the folder does not exist or cannot be written.
    """
    with files.whole(path) as temporary, rr.RecordingStream("gms_mujoco") as stream:
        stream.save(temporary)
        stream.log("summary", rr.TextDocument(str(training)), static=True)
        below = -np.log10(training.curve)
        curves = [("mean candidate", below[:, 0], _STEPS[0]), ("best candidate", below[:, 1], _STEPS[-1])]
        at = np.arange(1.0, len(below) + 1)
        _drawing(stream, "curve", at, curves, "generation", "log10 of PID error over that of the candidate", True)
        reference, *others = training.traces
        _series(stream, "test/position/reference", "reference", training.time, reference, _GREY)
        for name, value, colour in zip(("PID", "policy"), others, (_STEPS[0], _STEPS[-1]), strict=True):
            _series(stream, f"test/position/{name}", name, training.time, value, colour)
            _series(stream, f"test/error/{name}", name, training.time, reference - value, colour)
        frame = rrb.VisualBounds2D(x_range=[-0.1, _BOX[0] + 0.1], y_range=[-0.2, _BOX[1] + 0.2])
        curve = rrb.Spatial2DView(origin="curve", name="red: mean, green: best candidate", visual_bounds=frame)
        runs = rrb.Vertical(
            rrb.TimeSeriesView(origin="test/position", name="first test episode, position"),
            rrb.TimeSeriesView(origin="test/error", name="tracking error"),
        )
        summary = rrb.TextDocumentView(origin="summary", name="test")
        left = rrb.Vertical(curve, summary, row_shares=[3, 1])
        stream.send_blueprint(rrb.Blueprint(rrb.Horizontal(left, runs), collapse_panels=True))
        stream.flush()
        stream.disconnect()


def open_recording(path: str | Path, screenshot: str | Path | None = None) -> None:
    """Opens a recording in the rerun viewer, bound to this machine only.

    Args:
        path: a `.rrd` file, or the folder of a diagnosis.
        screenshot: a `.png` to write instead of opening a window.

    Raises:
        DataError: no recording there.
        GmsError: the viewer cannot run, for example without a graphics driver.
    """
    file = Path(path) / RECORDING if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise DataError(f"{file}: no such recording; expected a .rrd file or a folder with {RECORDING}")
    if file.suffix != ".rrd":
        raise DataError(f"{file}: not a recording; expected a .rrd file or a folder with {RECORDING}")
    port = _free_port()
    command = [sys.executable, "-m", "rerun", str(file), "--bind", "127.0.0.1", "--port", str(port)]
    if screenshot is not None:
        files.write_bytes(screenshot, _picture(command, port))
    elif subprocess.run(command).returncode:
        raise GmsError("the rerun viewer ended with an error; its messages stand above")


def _picture(command: list[str], port: int) -> bytes:
    """PNG of a viewer without a window."""
    from rerun.experimental import ViewerClient

    command = [*command, "--headless", "--window-size", "1600x1000"]
    with tempfile.TemporaryFile() as log:
        viewer = subprocess.Popen(command, stdout=log, stderr=log)
        last = "no answer"
        try:
            for _ in range(40):  # until it listens
                time.sleep(0.5)
                if viewer.poll() is not None:
                    break
                try:
                    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                    client.take_screenshot(max_size=64)  # answers once the first frame is painted
                    time.sleep(_LOADING)
                    return client.take_screenshot()
                except Exception as error:  # whatever it is, the viewer is not up yet
                    last = str(error)
            log.seek(0)
            said = log.read().decode(errors="replace").strip().splitlines() or [last]
            raise GmsError(
                f"the rerun viewer made no picture ({said[-1][:160]}); it needs a Vulkan driver, "
                "on Debian the package mesa-vulkan-drivers"
            )
        finally:
            viewer.kill()
            viewer.wait()


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def _text(table: dict[str, Any], names: list[str]) -> str:
    lines = [f"# {str(table['verdict']).replace('_', ' ')}", "", "| step | fit | validate |", "|---|---|---|"]
    for name, s in zip(names, table["steps"], strict=True):
        lines.append(f"| {name} | {_number(s.get('fit_error'))} | {_number(s.get('validate_error'))} |")
    lines += [f"| noise floor | | {_number(table.get('noise_floor'))} |", ""]
    lines += [f"{s['evidence']}\n" for s in table["steps"] if s["effect"] and s.get("evidence")]
    if table.get("remainder"):
        lines.append(f"**What remains:** {table['remainder']}\n")
    if table.get("next_experiment"):
        lines.append(f"**Measure next:** {table['next_experiment']}")
    return "\n".join(lines)


def _errors(stream: rr.RecordingStream, table: dict[str, Any], names: list[str]) -> None:
    """A bar per step and a line at the noise floor."""
    held_out = all(s.get("validate_error") is not None for s in table["steps"])
    errors = [s["validate_error" if held_out else "fit_error"] for s in table["steps"]]
    rows = list(zip(names, errors, strict=True))
    floor = table.get("noise_floor")
    scale = _BOX[0] / max(*(v for _, v in rows), floor or 0.0, 1e-12)
    for i, (name, value) in enumerate(rows):
        bar, at = [[(0.0, 0.3 * i), (value * scale, 0.3 * i)]], [(0.5 * _BOX[0], 0.3 * i + 0.04)]
        label = f"{name}  {value:.4f}"
        stream.log(f"errors/{i}", rr.LineStrips2D(bar, colors=[_colour(i, len(rows))], radii=0.03), static=True)
        stream.log(f"errors/{i}/label", _labels(at, [label]), static=True)
    if floor:
        x, low = floor * scale, 0.3 * len(rows) - 0.1
        stream.log("errors/floor", rr.LineStrips2D([[(x, -0.1), (x, low)]], colors=[_GREY], radii=_THIN), static=True)
        stream.log("errors/floor/label", _labels([(x, low)], [f"noise floor  {floor:.4f}"]), static=True)


def _record(stream: rr.RecordingStream, diagnosis: Diagnosis, names: list[str], i: int) -> rrb.Container:
    """Logs one validate record under every model and returns the tab that shows it."""
    steps = [c.records[i] for c in diagnosis.comparisons]
    first = steps[0]
    rotary = diagnosis.plant.kind == "hinge"
    torque, angle = ("N m", "rad") if rotary else ("N", "m")
    root = f"records/{_part(first.name)}"
    _series(stream, f"{root}/torque/measured", "measured", first.time, first.measured, _MEASURED)
    for k, (name, r) in enumerate(zip(names, steps, strict=False)):
        colour = _colour(k, len(steps))
        _series(stream, f"{root}/torque/{_part(name)}", name, r.time, r.needed, colour)
        _series(stream, f"{root}/residual/{_part(name)}", name, r.time, r.measured - r.needed, colour)
    shown = [(names[0], steps[0], _colour(0, 2))] + ([(names[-1], steps[-1], _colour(1, 2))] if len(steps) > 1 else [])
    near = worst_stretch(first.measured - first.needed)
    loops = [*((n, r.needed[near], c) for n, r, c in shown), ("measured", first.measured[near], _MEASURED)]
    _drawing(stream, f"{root}/loop", first.position[near], loops, f"position [{angle}]", f"torque [{torque}]", True)
    left = [(n, r.measured - r.needed, c) for n, r, c in shown]
    _drawing(stream, f"{root}/over_position", first.position, left, f"position [{angle}]", f"left over [{torque}]")
    _drawing(stream, f"{root}/over_velocity", first.velocity, left, f"velocity [{angle}/s]", f"left over [{torque}]")
    frame = rrb.VisualBounds2D(x_range=[-0.1, _BOX[0] + 0.1], y_range=[-0.2, _BOX[1] + 0.2])
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.TimeSeriesView(origin=f"{root}/torque", name=f"torque [{torque}]"),
            rrb.TimeSeriesView(origin=f"{root}/residual", name=f"left over: measured - model [{torque}]"),
        ),
        rrb.Vertical(
            rrb.Spatial2DView(origin=f"{root}/loop", name="loops where the baseline fails most", visual_bounds=frame),
            rrb.Spatial2DView(origin=f"{root}/over_position", name="left over, over position", visual_bounds=frame),
            rrb.Spatial2DView(origin=f"{root}/over_velocity", name="left over, over velocity", visual_bounds=frame),
        ),
        column_shares=[5, 3],
        name=first.name,
    )


def _response(stream: rr.RecordingStream, diagnosis: Diagnosis, names: list[str], i: int) -> rrb.Container:
    """Logs one frequency response under the first and the last model and returns the tab that shows it."""
    steps = [c.frfs[i] for c in diagnosis.comparisons]
    first = steps[0]
    root = f"responses/{_part(first.name)}"
    shown = [(names[0], steps[0], _colour(0, 2))] + ([(names[-1], steps[-1], _colour(1, 2))] if len(steps) > 1 else [])
    x = np.log10(first.frequency)
    frame = rrb.VisualBounds2D(x_range=[-0.1, _BOX[0] + 0.1], y_range=[-0.2, _BOX[1] + 0.2])
    views = []
    for part, unit, of in (("magnitude", "dB", decibel), ("phase", "deg", degrees)):
        curves = [*((n, of(r.model), c) for n, r, c in shown), ("measured", of(first.response), _MEASURED)]
        left = [(n, r.magnitude_error if unit == "dB" else r.phase_error, c) for n, r, c in shown]
        for entity, drawn, what in ((part, curves, part), (f"{part}_error", left, f"measured - model, {part}")):
            _drawing(stream, f"{root}/{entity}", x, drawn, "log10 of the frequency [Hz]", f"{what} [{unit}]", True)
            views.append(rrb.Spatial2DView(origin=f"{root}/{entity}", name=f"{what} [{unit}]", visual_bounds=frame))
    return rrb.Horizontal(rrb.Vertical(*views[::2]), rrb.Vertical(*views[1::2]), name=first.name)


def _series(
    stream: rr.RecordingStream, entity: str, name: str, seconds: Array, value: Array, colour: tuple[int, int, int]
) -> None:
    i = thin(value, _MOST)
    stream.log(entity, rr.SeriesLines(colors=[colour], names=[name]), static=True)
    stream.send_columns(entity, [rr.TimeColumn("time", duration=seconds[i])], rr.Scalars.columns(scalars=value[i]))


def _drawing(
    stream: rr.RecordingStream,
    entity: str,
    x: Array,
    curves: list[tuple[str, Array, tuple[int, int, int]]],
    x_label: str,
    y_label: str,
    lines: bool = False,
) -> None:
    """Curves over a common x in a framed box; the corners carry the scale."""
    low = np.array([x.min(), min(y.min() for _, y, _ in curves)])
    high = np.array([x.max(), max(y.max() for _, y, _ in curves)])
    span = np.where(high > low, high - low, 1.0)
    for name, y, colour in curves:
        i = thin(y, _MOST) if lines else spread(len(y), _MOST)
        at = (np.column_stack([x[i], y[i]]) - low) / span * _BOX
        at[:, 1] = _BOX[1] - at[:, 1]  # rerun's y points down
        line, cloud = rr.LineStrips2D([at], colors=[colour], radii=_THIN), rr.Points2D(at, colors=[colour], radii=-1.2)
        stream.log(f"{entity}/{_part(name)}", line if lines else cloud, static=True)
    w, h = _BOX
    corners = [(0, 0), (0, h), (w, h), (w, 0), (0, 0)]
    stream.log(f"{entity}/frame", rr.LineStrips2D([corners], colors=[_GREY], radii=_THIN), static=True)
    ranges = [f"up: {y_label} {low[1]:.3g} to {high[1]:.3g}", f"across: {x_label} {low[0]:.4g} to {high[0]:.4g}"]
    stream.log(f"{entity}/scale", _labels([(w / 2, -0.16), (w / 2, h)], ranges), static=True)


def _labels(at: list[tuple[float, float]], texts: list[str]) -> rr.Points2D:
    """Texts that hang below points."""
    return rr.Points2D(at, labels=texts, colors=[_GREY], radii=0.0, show_labels=True)


def _colour(step: int, steps: int) -> tuple[int, int, int]:
    """Red for the baseline, green for the last model."""
    if step == 0:
        return _STEPS[0]
    return _STEPS[-1] if step == steps - 1 else _STEPS[1 + (step - 1) % 2]


def _part(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("_") or "unnamed"


def _number(value: Any) -> str:
    return f"{value:.4f}" if isinstance(value, int | float) else "-"
