"""Small figures as SVG text: lines, points, stems, bands and bars, with axes that a person can read."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLOURS = ("#4c72b0", "#c44e52", "#2a9d5c", "#8172b3", "#b8860b")  # measured, first model, last model, others
STYLES = ("line", "under", "points", "stems", "steps")  # "under": broad and pale, for others to lie on
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 14, 10, 40  # margins in px
_MOST = 1500  # points of one curve: more cannot be seen
_PREFIXES = ((1e-6, "µ"), (1e-3, "m"), (1.0, ""), (1e3, "k"))
# Units that take a prefix.
_SCALED = ("N m", "N", "rad", "m", "s", "N m/s", "N/s", "rad/s", "m/s", "N m/sqrt(Hz)", "N/sqrt(Hz)")


@dataclass(frozen=True)
class Curve:
    """(n,) against (n,) with a name, drawn in one of `STYLES`."""

    name: str
    x: Array
    y: Array
    colour: str
    style: str = "line"


@dataclass(frozen=True)
class Band:
    """(n,) range from `low` to `high` that is shaded behind the curves."""

    x: Array
    low: Array
    high: Array


def plot(
    curves: Sequence[Curve],
    x_label: str,
    x_unit: str,
    y_label: str,
    y_unit: str,
    *,
    bands: Sequence[Band] = (),
    log: tuple[bool, bool] = (False, False),
    width: int = 440,
    height: int = 240,
) -> str:
    """An SVG figure of curves over common axes, in units with a prefix where that makes the numbers short."""
    curves = [c for c in curves if len(c.x)]
    x_scale, x_unit = prefixed(largest([c.x for c in curves]), x_unit)
    y_scale, y_unit = prefixed(largest([c.y for c in curves]), y_unit)
    xs = [placed(c.x, x_scale, log[0]) for c in curves]
    ys = [placed(c.y, y_scale, log[1]) for c in curves]
    edges = [
        (placed(b.x, x_scale, log[0]), placed(b.low, y_scale, log[1]), placed(b.high, y_scale, log[1])) for b in bands
    ]
    zero = [np.zeros(1)] if not log[1] and any(c.style == "stems" for c in curves) else []
    x0, x1 = span(xs)
    y0, y1 = span([*ys, *zero, *([e for _, low, high in edges for e in (low, high)] if not log[1] else [])])
    sx, sy = (width - _LEFT - _RIGHT) / (x1 - x0), (height - _TOP - _BOTTOM) / (y1 - y0)

    def px(x: Array) -> Array:
        return _LEFT + (x - x0) * sx

    def py(y: Array) -> Array:
        return height - _BOTTOM - (np.clip(y, y0, y1) - y0) * sy

    body = [_axes(x0, x1, y0, y1, width, height, _labelled(x_label, x_unit), _labelled(y_label, y_unit), log)]
    for x, low, high in edges:
        outline = _path(np.concatenate([px(x), px(x)[::-1]]), np.concatenate([py(high), py(low)[::-1]]))
        body.append(f'<polygon points="{outline}" class="band"/>')
    for c, x, y in zip(curves, xs, ys, strict=True):
        i = spread(len(y)) if c.style == "points" else thin(y)
        body.append(_drawn(c, px(x[i]), py(y[i]), float(py(np.zeros(1))[0]) if not log[1] else height - _BOTTOM))
    return _svg(body, width, height, f"{y_label} over {x_label}")


def bars(
    rows: Sequence[tuple[str, float]], floor: float | None, told: Callable[[float], str], width: int = 620
) -> str:
    """Horizontal bars, one per row, with their value as `told` and a dashed line at `floor`."""
    left, height = 190, 34 * len(rows) + 24
    most = max([v for _, v in rows if math.isfinite(v)] + [floor or 0.0, 1e-12])
    scale = (width - left - 80) / most
    body = []
    for i, (name, value) in enumerate(rows):
        y = 34 * i + 8
        long, colour = scale * value if math.isfinite(value) else 0.0, step_colour(i, len(rows))
        body.append(f'<rect x="{left}" y="{y}" width="{long:.1f}" height="22" rx="2" fill="{colour}"/>')
        body.append(_text(left - 8, y + 16, name, "end"))
        body.append(_text(left + long + 6, y + 16, told(value), "start"))
    if floor is not None and math.isfinite(floor):
        x = left + scale * floor
        body.append(f'<path d="M{x:.1f},2V{height - 20}" stroke="currentColor" stroke-dasharray="4 3"/>')
        body.append(_text(x, height - 5, f"noise floor {told(floor)}", "middle" if x > left + 60 else "start"))
    return f'<div class="bars" style="max-width:{width}px">{_svg(body, width, height, "errors after each step")}</div>'


def step_colour(step: int, steps: int) -> str:
    """Of a model among those of a diagnosis: red for the baseline, green for the last."""
    if step in (0, steps - 1):
        return COLOURS[1 if step == 0 else 2]
    return COLOURS[(4, 3)[(step - 1) % 2]]


def legend(items: Sequence[tuple[str, str]], band: str = "") -> str:
    """HTML line that names the colours, and what the shaded band is."""
    marks = [f'<span><i style="background:{colour}"></i>{html.escape(name)}</span>' for name, colour in items]
    marks += [f'<span><i class="band"></i>{html.escape(band)}</span>'] if band else []
    return f'<p class="legend">{"".join(marks)}</p>'


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a number of that size is between 1 and 1000: (1e-3, "mN m")."""
    if unit not in _SCALED or not size > 0:
        return 1.0, unit
    factor, prefix = next(((f, p) for f, p in reversed(_PREFIXES) if size >= 0.999 * f), _PREFIXES[0])
    if prefix == "k" and unit != "N":
        return 1.0, unit
    return factor, prefix + unit


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


def decades(low: float, high: float) -> list[float]:
    """Logarithms of round numbers between two logarithms: powers of ten, with 2 and 5 where they are few."""
    for digits in ((1,), (1, 2, 5)):
        at = [k + math.log10(d) for k in range(math.floor(low), math.ceil(high) + 1) for d in digits]
        at = [v for v in at if low <= v <= high]
        if len(at) >= 3:
            break
    return at


def span(values: Sequence[Array]) -> tuple[float, float]:
    """Least and greatest of several arrays, with a margin."""
    low = min((float(v.min()) for v in values if len(v)), default=0.0)
    high = max((float(v.max()) for v in values if len(v)), default=1.0)
    margin = 0.04 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


def placed(v: Array, scale: float, logarithmic: bool) -> Array:
    """Where values stand on an axis in units of `scale`: themselves or their decimal logarithm."""
    return np.log10(np.maximum(v / scale, 1e-300)) if logarithmic else np.asarray(v) / scale


def largest(values: Sequence[Array]) -> float:
    """The largest size among arrays, of which some may be empty; 0 where all are."""
    return max((float(np.max(np.abs(v))) for v in values if len(v)), default=0.0)


def _labelled(label: str, unit: str) -> str:
    return f"{label} [{unit}]" if unit and unit != "1" else label


def _drawn(c: Curve, x: Array, y: Array, base: float) -> str:
    if c.style == "points":
        path = "".join(f"M{a:.1f},{b:.1f}h0" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        return f'<path d="{path}" class="cloud" stroke="{c.colour}"/>'
    if c.style == "stems":
        path = "".join(f"M{a:.1f},{base:.1f}V{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        return f'<path d="{path}" stroke="{c.colour}" stroke-width="3" opacity=".85"/>'
    width = 'stroke-width="4" opacity=".45"' if c.style == "under" else 'stroke-width="1.5"'
    line = f'<polyline points="{_path(x, y)}" fill="none" stroke="{c.colour}" {width}/>'
    if c.style == "steps":  # a mean in every bin: the places are shown too
        dots = "".join(f"M{a:.1f},{b:.1f}h0" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        line += f'<path d="{dots}" class="dots" stroke="{c.colour}"/>'
    return line


def _path(x: Array, y: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _axes(
    x0: float, x1: float, y0: float, y1: float, width: int, height: int, x_label: str, y_label: str,
    log: tuple[bool, bool],
) -> str:  # fmt: skip
    bottom, right = height - _BOTTOM, width - _RIGHT
    out = []
    for x in decades(x0, x1) if log[0] else ticks(x0, x1):
        px = _LEFT + (x - x0) / (x1 - x0) * (right - _LEFT)
        text = f"{10**x:.6g}" if log[0] else f"{x:.6g}"
        out.append(f'<path d="M{px:.1f},{_TOP}V{bottom}" class="grid"/>' + _text(px, bottom + 15, text, "middle"))
    for y in decades(y0, y1) if log[1] else ticks(y0, y1):
        py = bottom - (y - y0) / (y1 - y0) * (bottom - _TOP)
        text = f"{10**y:.6g}" if log[1] else f"{y:.6g}"
        out.append(f'<path d="M{_LEFT},{py:.1f}H{right}" class="grid"/>' + _text(_LEFT - 6, py + 4, text, "end"))
    out.append(_text((_LEFT + right) / 2, height - 6, x_label, "middle"))
    middle = (_TOP + bottom) / 2
    turned = f'transform="translate(12 {middle}) rotate(-90)" text-anchor="middle"'
    out.append(f"<text {turned}>{html.escape(y_label)}</text>")
    return "".join(out)


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(text)}</text>'


def _svg(body: Sequence[str], width: int, height: int, title: str) -> str:
    head = f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{html.escape(title)}">'
    return head + "".join(body) + "</svg>"
