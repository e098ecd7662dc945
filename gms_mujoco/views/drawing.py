"""Curves with a labelled grid for the rerun viewer, which plots over time only: drawn into a box of a 2-D view."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from .. import files
from ..errors import GmsError
from .figure import Band, Curve, decades, largest, placed, prefixed, span, spread, thin, ticks

Array = NDArray[np.float64]

BOX = (2.3, 1.0)  # width and height into which every drawing is scaled
_GREY, _GRID, _SHADE = (150, 150, 150), (70, 70, 70), (95, 95, 95)
_THIN, _BROAD = -0.9, -2.2  # radii; negative: in points of the screen
_MOST = 4000  # points of one curve
_COLUMNS = 320  # that shade a band
_LETTER = 0.042  # width of a letter of a label in a view of a sixth of the screen, about
_ROW = 0.15  # from one row above the box to the next, and to the box
_PATIENCE = 60.0  # s, until what is on its way to a file has arrived
_BEHIND, _ABOVE = 5.0, 30.0  # draw orders: lines have 20


def draw(
    stream: rr.RecordingStream,
    entity: str,
    curves: Sequence[Curve],
    x_label: str,
    x_unit: str,
    y_label: str,
    y_unit: str,
    *,
    bands: Sequence[Band] = (),
    log: tuple[bool, bool] = (False, False),
    band_name: str = "99 % of sensor noise",
) -> None:
    """Logs curves over common axes: `ENTITY/NAME` in the box, `ENTITY/axes` the frame, grid and labels.

    `ENTITY/data/NAME` has the numbers themselves, as (n, 2) points in the units that were given.
    """
    x_scale, x_unit = prefixed(largest([c.x for c in curves]), x_unit)
    y_scale, y_unit = prefixed(largest([c.y for c in curves]), y_unit)
    x0, x1 = span([placed(c.x, x_scale, log[0]) for c in curves])
    ys = [placed(c.y, y_scale, log[1]) for c in curves]
    if not log[1]:
        ys += [placed(v, y_scale, False) for b in bands for v in (b.low, b.high)]
        ys += [np.zeros(1)] if any(c.style == "stems" for c in curves) else []
    y0, y1 = span(ys)

    def box(x: Array, y: Array) -> Array:
        """(n, 2) points of the box; rerun's y points down."""
        across = (placed(x, x_scale, log[0]) - x0) / (x1 - x0) * BOX[0]
        up = (np.clip(placed(y, y_scale, log[1]), y0, y1) - y0) / (y1 - y0) * BOX[1]
        return np.column_stack([across, BOX[1] - up])

    for k, b in enumerate(bands):
        low, high = box(b.x, b.low), box(b.x, b.high)
        across = np.linspace(low[0, 0], low[-1, 0], _COLUMNS)
        bottom, top = (np.interp(across, e[:, 0], e[:, 1]) for e in (low, high))
        strips = np.stack([np.column_stack([across, bottom]), np.column_stack([across, top])], 1)
        shade = rr.LineStrips2D(strips, colors=[_SHADE], radii=0.55 * (across[1] - across[0]), draw_order=_BEHIND)
        stream.log(f"{entity}/band{k or ''}", shade, static=True)
    zero = np.zeros(1) if not log[1] else np.full(1, y_scale * 10**y0)
    for c in curves:
        i = spread(len(c.y), _MOST) if c.style == "points" else thin(c.y, _MOST)
        at, colour = box(c.x[i], c.y[i]), rgb(c.colour)
        place = f"{entity}/{part(c.name)}"
        if c.style == "points":
            stream.log(place, rr.Points2D(at, colors=[colour], radii=-1.2), static=True)
        elif c.style == "stems":
            base = np.column_stack([at[:, 0], np.full(len(at), box(c.x[:1], zero)[0, 1])])
            stems = rr.LineStrips2D(np.stack([base, at], 1), colors=[colour], radii=-1.5)
            stream.log(place, stems, static=True)
        else:
            radius = _BROAD if c.style == "under" else _THIN
            stream.log(place, rr.LineStrips2D([at], colors=[colour], radii=radius), static=True)
            if c.style == "steps":
                stream.log(f"{place}/bins", rr.Points2D(at, colors=[colour], radii=-2.0), static=True)
        numbers = rr.AnyValues(x=c.x, y=c.y)
        stream.log(f"{entity}/data/{part(c.name)}", numbers, static=True)
    _axes(stream, entity, (x0, x1), (y0, y1), log)
    titles = [f"{y_label} [{y_unit}]" if y_unit != "1" else y_label]
    titles.append(f"{x_label} [{x_unit}]" if x_unit != "1" else x_label)
    names = [(c.name, rgb(c.colour)) for c in curves] + ([(band_name, _GREY)] if bands else [])
    titled, *widths = (_LETTER * (len(n) + 3) for n in [titles[0], *(n for n, _ in names)])
    # A title that the legend would stand on goes above it.
    above = _ROW if len(names) < 2 or 0.15 + titled / 2 < BOX[0] - sum(widths) else 2 * _ROW
    stream.log(f"{entity}/axes/labels", labels([(0.15, -above), (BOX[0] / 2, BOX[1] + 0.13)], titles), static=True)
    if len(names) > 1:
        places = [(BOX[0] - sum(widths[k:]) + w / 2, -_ROW) for k, w in enumerate(widths)]
        legend = rr.Points2D(places, labels=[n for n, _ in names], colors=[c for _, c in names], radii=-3.0,
                             show_labels=True, draw_order=_ABOVE)  # fmt: skip
        stream.log(f"{entity}/axes/legend", legend, static=True)


def view(entity: str, name: str) -> rrb.Spatial2DView:
    """The view that shows a drawing, whole and without margins to search."""
    bounds = rrb.VisualBounds2D(x_range=[-0.35, BOX[0] + 0.1], y_range=[-0.35, BOX[1] + 0.3])
    return rrb.Spatial2DView(origin=entity, name=name, visual_bounds=bounds)


def labels(at: Sequence[tuple[float, float]], texts: Sequence[str]) -> rr.Points2D:
    """Texts that hang below points."""
    return rr.Points2D(at, labels=list(texts), colors=[_GREY], radii=0.0, show_labels=True, draw_order=_ABOVE)


def series(stream: rr.RecordingStream, entity: str, name: str, seconds: Array, value: Array, colour: str) -> None:
    """Logs a line over the timeline `time`."""
    i = thin(value, _MOST)
    stream.log(entity, rr.SeriesLines(colors=[rgb(colour)], names=[name]), static=True)
    stream.send_columns(entity, [rr.TimeColumn("time", duration=seconds[i])], rr.Scalars.columns(scalars=value[i]))


def part(name: str) -> str:
    """A name as a part of an entity path."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("_") or "unnamed"


def _axes(
    stream: rr.RecordingStream, entity: str, x: tuple[float, float], y: tuple[float, float], log: tuple[bool, bool]
) -> None:
    w, h = BOX
    across = decades(*x) if log[0] else ticks(*x, 4)
    up = decades(*y) if log[1] else ticks(*y, 4)
    px = [(v - x[0]) / (x[1] - x[0]) * w for v in across]
    py = [h - (v - y[0]) / (y[1] - y[0]) * h for v in up]
    lines = [[(p, 0.0), (p, h)] for p in px] + [[(0.0, p), (w, p)] for p in py]
    if lines:
        grid = rr.LineStrips2D(lines, colors=[_GRID], radii=-0.4, draw_order=1.0)
        stream.log(f"{entity}/axes/grid", grid, static=True)
    corners = [[(0, 0), (0, h), (w, h), (w, 0), (0, 0)]]
    stream.log(f"{entity}/axes/frame", rr.LineStrips2D(corners, colors=[_GREY], radii=-0.5), static=True)
    marks = [(p, h + 0.01) for p in px] + [(-0.13, p - 0.055) for p in py]
    texts = [_number(v, log[0]) for v in across] + [_number(v, log[1]) for v in up]
    if marks:
        stream.log(f"{entity}/axes/ticks", labels(marks, texts), static=True)


def _number(value: float, logarithmic: bool) -> str:
    return f"{10**value if logarithmic else value:.6g}"


def rgb(colour: str) -> tuple[int, int, int]:
    """Of "#rrggbb"."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


@contextmanager
def recording(path: str | Path) -> Iterator[rr.RecordingStream]:
    """A stream into a file, which is there, and whole, when the block ends well.

    Raises:
        GmsError: it cannot be written.
    """
    try:
        with files.whole(path) as temporary, rr.RecordingStream("gms_mujoco") as stream:
            stream.save(temporary)
            yield stream
            stream.flush(timeout_sec=_PATIENCE)
            stream.disconnect()
    except RuntimeError as error:  # of Rerun, whose writer has come to an end
        raise GmsError(f"{path}: cannot be written ({error})") from None


def say(stream: rr.RecordingStream, entity: str, lines: Sequence[str]) -> None:
    """Logs a text in Markdown as `ENTITY/text`."""
    stream.log(f"{entity}/text", rr.TextDocument("\n".join(lines), media_type="text/markdown"), static=True)


def text(entity: str, name: str) -> rrb.TextDocumentView:
    """The view of a text."""
    return rrb.TextDocumentView(origin=f"{entity}/text", name=name)
