"""A diagnosis as one HTML page that needs no network: for a screen, a phone and paper."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from . import figure
from .figure import COLOURS, Curve
from .plant import Plant

if TYPE_CHECKING:
    from .compare import Comparison, RecordComparison
    from .diagnose import Diagnosis

_VERDICTS = {
    "adequate": "The baseline model explains the data down to the noise. Nothing was added.",
    "explained": "The added effects bring the error down to the noise.",
    "partly_explained": "The added effects lower the error; something remains that they do not explain.",
    "unexplained": "The error is above the noise and no known effect earns its place. None is named.",
}

_STYLE = """
:root { color-scheme: light dark }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 940px; margin: 0 auto; padding: 1rem }
h1 { font-size: 1.5rem; margin: .5rem 0 } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem } h3 { font-size: 1rem }
.verdict { border-left: 6px solid #2a9d5c; padding: .2rem 1rem; background: #8881 }
.verdict.partly_explained, .verdict.unexplained { border-color: #c44e52 }
.verdict b { font-size: 1.2rem }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem }
.wide { overflow-x: auto } th, td { text-align: left; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid #8884 }
td.n, th.n { text-align: right } svg { width: 100%; height: auto; display: block }
svg text { font-size: 12px; fill: currentColor } .grid { stroke: #8885; stroke-width: .6; fill: none }
.cloud { stroke-width: 2.5; stroke-linecap: round; opacity: .45 }
.legend { margin: 0 0 1rem; font-size: .85rem } .legend span { margin-right: 1.2rem; white-space: nowrap }
.legend i { display: inline-block; width: 1rem; height: .3rem; margin-right: .4rem; vertical-align: middle }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(330px, 1fr)); gap: .5rem 1.5rem }
@media print { body { max-width: none; font-size: 11pt } .plots > div, tr { break-inside: avoid } }
"""


def html_page(title: str, body: str) -> str:
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head>'
        f"<body>\n{body}\n</body></html>\n"
    )


def render(diagnosis: Diagnosis) -> str:
    """The page as text."""
    table = diagnosis.to_dict()
    title = "What this axis is missing"
    parts = [f"<h1>{title}</h1>", _verdict(table), _steps(table), _figures(diagnosis, table)]
    parts += [_candidates(table), _parameters(diagnosis.plant), _provenance(diagnosis.plant)]
    return html_page(title, "\n".join(p for p in parts if p))


def step_names(table: dict[str, Any]) -> list[str]:
    """What each step of `diagnosis.json` is called on a figure."""
    return ["baseline" if s["effect"] is None else f"+ {s['effect']}" for s in table["steps"]]


def parameter_rows(plant: Plant) -> list[tuple[str, str, str, str]]:
    """Name, value, 95 % interval and unit of every parameter."""
    return [
        (name, f"{value:.5g}", _interval(value, plant.uncertainty.get(name)), unit)
        for name, (value, unit) in plant.numbers().items()
    ]


def _interval(value: float, interval: tuple[float, float] | None) -> str:
    if interval is None:
        return ""
    low, high = interval
    if not high - low < 1e3 * abs(value) and value != 0:
        return "not seen by this data"
    return f"[{low:.4g}, {high:.4g}]"


def _verdict(table: dict[str, Any]) -> str:
    verdict = str(table["verdict"])
    added = [s["effect"] for s in table["steps"] if s["effect"]]
    found = f"<p>Added: {_e(', '.join(added))}.</p>" if added else ""
    left = table.get("remainder")
    found += f"<p>What remains: {_e(left)}.</p>" if left else ""
    following = table.get("next_experiment")
    hint = f"<p>Measure next: {_e(following)}</p>" if following else ""
    return (
        f'<section class="verdict {_e(verdict)}"><p><b>{_e(verdict.replace("_", " "))}</b></p>'
        f"<p>{_e(_VERDICTS.get(verdict, ''))}</p>{found}{hint}</section>"
    )


def _steps(table: dict[str, Any]) -> str:
    names = step_names(table)
    rows = "".join(
        f"<tr><td>{_e(name)}</td><td class=n>{_number(s.get('fit_error'))}</td>"
        f"<td class=n>{_number(s.get('validate_error'))}</td><td>{_e(s.get('evidence') or '')}"
        + (f" Could be confused with {_e(', '.join(s['confusable_with']))}." if s.get("confusable_with") else "")
        + "</td></tr>"
        for name, s in zip(names, table["steps"], strict=True)
    )
    key, which = "validate_error", "on records that decided nothing"
    if any(s.get(key) is None for s in table["steps"]):
        key, which = "fit_error", "on the records it was fitted to: none was held out"
    heights = [(n, float(s[key])) for n, s in zip(names, table["steps"], strict=True)]
    picture = figure.bars(heights, table.get("noise_floor"))
    return (
        "<section><h2>The falling error</h2><p>Torque that the model does not account for, as a share of the torque's "
        f"rms, {which}.</p>{picture}<div class=wide><table><tr><th>step</th>"
        f"<th class=n>fit</th><th class=n>validate</th><th>evidence</th></tr>{rows}</table></div></section>"
    )


def _figures(diagnosis: Diagnosis, table: dict[str, Any]) -> str:
    """Each validate record: torque in time, residual over time, position and velocity, first and last model."""
    steps: list[Comparison] = list(diagnosis.comparisons)
    if not steps:
        return ""
    names = step_names(table)
    first, last = steps[0], steps[-1]
    rotary = diagnosis.plant.kind == "hinge"
    torque, angle = ("torque [N m]", "rad") if rotary else ("force [N]", "m")
    parts = ["<h2>Where the models fail</h2>"]
    for i in worst_first(first):
        record = first.records[i]
        shown = [(names[0], record, COLOURS[1])]
        if len(steps) > 1:
            shown.append((names[-1], last.records[i], COLOURS[2]))
        near = figure.worst_stretch(_left(record))
        needed = [Curve(n, r.time[near], r.needed[near], c) for n, r, c in shown]
        needed.append(Curve("measured", record.time[near], record.measured[near], COLOURS[0]))
        left = [Curve(n, r.time, _left(r), c) for n, r, c in shown]
        plots = [
            figure.plot(needed, "time [s], where the baseline fails most", torque),
            figure.plot(left, "time [s]", f"left over, {torque}"),
        ]
        for label, x in ((f"position [{angle}]", "position"), (f"velocity [{angle}/s]", "velocity")):
            clouds = [Curve(n, getattr(r, x), _left(r), c, points=True) for n, r, c in shown]
            plots.append(figure.plot(clouds, label, f"left over, {torque}"))
        cells = "".join(f"<div>{p}</div>" for p in plots)
        parts.append(f'<section><h3>{_e(record.name)}</h3><div class="plots">{cells}</div></section>')
    return "".join(parts)


def worst_first(comparison: Comparison) -> list[int]:
    """Numbers of the records, the one that the plant explains least first."""
    return sorted(range(len(comparison.records)), key=lambda i: -comparison.records[i].torque_error)


def _left(record: RecordComparison) -> Any:
    return np.asarray(record.measured) - np.asarray(record.needed)


def _candidates(table: dict[str, Any]) -> str:
    if not table.get("candidates"):
        return ""
    rows = "".join(
        f"<tr><td>{_e(c['effect'])}</td><td class=n>{_number(c.get('validate_error'))}</td>"
        f"<td class=n>{_number(c.get('p_value'))}</td></tr>"
        for c in table["candidates"]
    )
    return (
        "<section><h2>Effects that were tried and not added</h2><div class=wide><table><tr><th>effect</th>"
        f"<th class=n>validate error</th><th class=n>p value</th></tr>{rows}</table></div></section>"
    )


def _parameters(plant: Plant) -> str:
    rows = "".join(
        f"<tr><td>{_e(n)}</td><td class=n>{_e(v)}</td><td>{_e(i)}</td><td>{_e(u)}</td></tr>"
        for n, v, i, u in parameter_rows(plant)
    )
    return (
        "<section><h2>The final plant</h2><div class=wide><table><tr><th>parameter</th><th class=n>value</th>"
        f"<th>95 % interval</th><th>unit</th></tr>{rows}</table></div></section>"
    )


def _provenance(plant: Plant) -> str:
    if not plant.provenance:
        return ""
    rows = "".join(
        f"<tr><td>{_e(k)}</td><td>{_e(', '.join(map(str, v)) if isinstance(v, list | tuple) else v)}</td></tr>"
        for k, v in plant.provenance.items()
    )
    return f"<section><h2>Where the numbers come from</h2><div class=wide><table>{rows}</table></div></section>"


def _e(text: Any) -> str:
    return html.escape(str(text))


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, int | float) else "-"
