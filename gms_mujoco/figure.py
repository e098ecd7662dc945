"""Small figures as SVG text: lines, clouds of points and bars, with axes that a person can read."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLOURS = ("#4c72b0", "#c44e52", "#2a9d5c", "#8172b3", "#b8860b")
_LEFT, _RIGHT, _TOP, _BOTTOM = 74, 12, 12, 40  # margins in px
_MOST = 1500  # points of one curve: more cannot be seen


@dataclass(frozen=True)
class Curve:
    """(n,) against (n,) with a name; drawn as a line or as points."""

    name: str
    x: Array
    y: Array
    colour: str
    points: bool = False


def plot(curves: Sequence[Curve], x_label: str, y_label: str, width: int = 440, height: int = 250) -> str:
    """An SVG figure of curves over common axes."""
    x0, x1 = _range([c.x for c in curves])
    y0, y1 = _range([c.y for c in curves])
    sx = (width - _LEFT - _RIGHT) / (x1 - x0)
    sy = (height - _TOP - _BOTTOM) / (y1 - y0)
    body = [_axes(x0, x1, y0, y1, width, height, x_label, y_label)]
    for c in curves:
        i = spread(len(c.y)) if c.points else thin(c.y)
        px, py = _LEFT + (c.x[i] - x0) * sx, height - _BOTTOM - (c.y[i] - y0) * sy
        where = [f"{a:.1f},{b:.1f}" for a, b in zip(px.tolist(), py.tolist(), strict=True)]
        if c.points:
            path = "".join(f"M{p}h0" for p in where)
            body.append(f'<path d="{path}" class="cloud" stroke="{c.colour}"/>')
        else:
            body.append(f'<polyline points="{" ".join(where)}" fill="none" stroke="{c.colour}" stroke-width="1.4"/>')
    return _svg(body, width, height, f"{y_label} over {x_label}") + legend([(c.name, c.colour) for c in curves])


def bars(rows: Sequence[tuple[str, float]], floor: float | None, width: int = 560) -> str:
    """Horizontal bars, one per row, with a dashed line at `floor`."""
    left, height = 170, 34 * len(rows) + 24
    most = max([v for _, v in rows if math.isfinite(v)] + [floor or 0.0, 1e-12])
    scale = (width - left - 70) / most
    body = []
    for i, (name, value) in enumerate(rows):
        y = 34 * i + 8
        long = scale * value if math.isfinite(value) else 0.0
        body.append(f'<rect x="{left}" y="{y}" width="{long:.1f}" height="22" rx="2" fill="{COLOURS[min(i, 1) + 1]}"/>')
        body.append(_text(left - 8, y + 16, name, "end"))
        body.append(_text(left + long + 6, y + 16, f"{value:.4f}", "start"))
    if floor is not None and math.isfinite(floor):
        x = left + scale * floor
        body.append(f'<path d="M{x:.1f},2V{height - 20}" stroke="currentColor" stroke-dasharray="4 3"/>')
        body.append(_text(x, height - 5, f"noise floor {floor:.4f}", "middle" if x > left + 60 else "start"))
    return f'<div style="max-width:{width}px">{_svg(body, width, height, "errors after each step")}</div>'


def legend(items: Sequence[tuple[str, str]]) -> str:
    """HTML line that names the colours."""
    marks = (f'<span><i style="background:{colour}"></i>{html.escape(name)}</span>' for name, colour in items)
    return f'<p class="legend">{"".join(marks)}</p>'


def thin(values: Array, most: int = _MOST) -> NDArray[np.intp]:
    """Indices of at most about `most` samples that keep the peaks: the least and greatest of each stretch."""
    n = len(values)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)[:-1]
    ends = np.append(edges[1:], n)
    picked = [a + f(values[a:b]) for a, b in zip(edges, ends, strict=True) for f in (np.argmin, np.argmax)]
    return np.unique(picked)


def spread(n: int, most: int = _MOST) -> NDArray[np.intp]:
    """Indices of at most about `most` of n samples, evenly spaced: a cloud keeps its density."""
    return np.arange(0, n, max(-(-n // most), 1))


def worst_stretch(residual: Array, share: float = 0.1, least: int = 100) -> slice:
    """The stretch of a tenth of a record in which the residual is largest."""
    n = len(residual)
    length = min(max(int(share * n), least), n)
    power = np.concatenate([[0.0], np.cumsum(np.asarray(residual) ** 2)])
    start = int(np.argmax(power[length:] - power[: n + 1 - length]))
    return slice(start, start + length)


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers between two values."""
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _range(values: Sequence[Array]) -> tuple[float, float]:
    low = min((float(v.min()) for v in values if len(v)), default=0.0)
    high = max((float(v.max()) for v in values if len(v)), default=1.0)
    margin = 0.04 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


def _axes(x0: float, x1: float, y0: float, y1: float, width: int, height: int, x_label: str, y_label: str) -> str:
    bottom, right = height - _BOTTOM, width - _RIGHT
    out = []
    for x in ticks(x0, x1):
        px = _LEFT + (x - x0) / (x1 - x0) * (right - _LEFT)
        out.append(f'<path d="M{px:.1f},{_TOP}V{bottom}" class="grid"/>' + _text(px, bottom + 15, f"{x:.6g}", "middle"))
    for y in ticks(y0, y1):
        py = bottom - (y - y0) / (y1 - y0) * (bottom - _TOP)
        out.append(f'<path d="M{_LEFT},{py:.1f}H{right}" class="grid"/>' + _text(_LEFT - 6, py + 4, f"{y:.4g}", "end"))
    out.append(_text((_LEFT + right) / 2, height - 6, x_label, "middle"))
    middle = (_TOP + bottom) / 2
    turned = f'transform="translate(11 {middle}) rotate(-90)" text-anchor="middle"'
    out.append(f"<text {turned}>{html.escape(y_label)}</text>")
    return "".join(out)


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(text)}</text>'


def _svg(body: Sequence[str], width: int, height: int, title: str) -> str:
    head = f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{html.escape(title)}">'
    return head + "".join(body) + "</svg>"
