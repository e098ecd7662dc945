"""The parts of an HTML page that needs no network: for a screen, a phone and paper."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..comparison.noise_band import Z
from ..comparison.score import POSITION, TORQUE
from ..effect import LOADED
from ..identification.undetermined import TELLS, by_experiment
from ..plant import Plant
from . import figure
from .figure import Band, Curve

if TYPE_CHECKING:
    from ..compare import Comparison, RecordComparison
    from ..comparison.residual_maps import ResidualMap

Shown = Sequence[tuple[str, "Comparison", str]]  # name, comparison and colour of each model on a figure

_UNITS = {"bandwidth": "Hz", "clock_skew": "s"}  # of what stands in a provenance
NOISE = "99 % of sensor noise"
_OPEN = 3  # records that are shown unfolded
_TELLING = 3  # views by their share of the residual that are shown unfolded, beside those that always are
_ALWAYS = ("revolution_harmonic", "frequency", "autocorrelation")

RESIDUAL = {  # in words, by what the error is of
    "torque": "measured torque less the torque that the model needs along the measured motion",
    "force": "measured force less the force that the model needs along the measured motion",
    "position": "measured position less the one simulated from the goal",
}

_STYLE = """
:root { color-scheme: light dark }
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1080px; margin: 0 auto; padding: 1rem }
h1 { font-size: 1.6rem; margin: .5rem 0 1rem } h2 { font-size: 1.2rem; margin: 2.2rem 0 .4rem }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem } h4 { font-size: .9rem; margin: .6rem 0 .1rem; font-weight: 600 }
p { margin: .4rem 0; max-width: 46rem } small { opacity: .75 }
.verdict { border-left: 6px solid #2a9d5c; border-radius: 4px; padding: .4rem 1rem; background: #8881 }
.verdict.partly_explained, .verdict.fails { border-color: #b8860b } .verdict.unexplained { border-color: #c44e52 }
.verdict b { font-size: 1.25rem }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem; margin: .4rem 0 }
.wide { overflow-x: auto } th, td { text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid #8884 }
th { font-weight: 600; vertical-align: bottom } td { vertical-align: top }
td.n, th.n { text-align: right } td.n, td.k { white-space: nowrap }
svg { width: 100%; height: auto; display: block }
svg text { font-size: 12px; fill: currentColor } .grid { stroke: #8884; stroke-width: .6; fill: none }
.cloud { stroke-width: 2.5; stroke-linecap: round; opacity: .45 } .dots { stroke-width: 4; stroke-linecap: round }
.band, i.band { fill: #8885; background: #8885 }
.legend { margin: .2rem 0 .6rem; font-size: .85rem } .legend span { margin-right: 1.2rem; white-space: nowrap }
.legend i { display: inline-block; width: 1rem; height: .35rem; margin-right: .4rem; vertical-align: middle }
.legend i.band { height: .8rem }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(420px, 100%), 1fr)); gap: .3rem 1.8rem }
details { margin: .6rem 0 } summary { cursor: pointer; font-weight: 600; padding: .2rem 0 }
footer { margin: 2.5rem 0 1rem; font-size: .8rem; opacity: .7 }
@media (max-width: 600px) {
  body { padding: .7rem } svg text { font-size: 13px } .bars svg text { font-size: 18px }
  table { font-size: .85rem } th, td { padding-right: .5rem }
}
@media print {
  body { max-width: none; font-size: 10pt; padding: 0 } h2, h3, h4 { break-after: avoid }
  .legend, h2 + p { break-after: avoid } details:not([open]) { display: none } footer { margin: 1rem 0 0 }
  .plots > div, tr, .verdict { break-inside: avoid } .plots { grid-template-columns: 1fr 1fr }
}
"""


def html_page(title: str, body: str) -> str:
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head>'
        f"<body>\n{body}\n</body></html>\n"
    )


def escape(text: Any) -> str:
    return html.escape(str(text))


def number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, int | float) else "-"


def percent(value: Any) -> str:
    return f"{100 * value:.3g} %" if isinstance(value, int | float) else "-"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """A table that scrolls where it is too wide; cells are HTML, columns in `numeric` are numbers."""

    def line(cells: Sequence[str], tag: str) -> str:
        kinds = ["n" if i in numeric else "k" if i == 0 else "" for i in range(len(cells))]
        return "".join(f'<{tag} class="{k}">{c}</{tag}>' for k, c in zip(kinds, cells, strict=True))

    top = f"<tr>{line(heads, 'th')}</tr>" if heads else ""
    body = "".join(f"<tr>{line(r, 'td')}</tr>" for r in rows)
    return f'<div class="wide"><table>{top}{body}</table></div>'


def parameters(plant: Plant, title: str) -> str:
    rows = [[escape(cell) for cell in row] for row in plant.rows()]
    return f"<section><h2>{title}</h2>{table(('parameter', 'value', '95 % interval', 'unit'), rows, (1,))}</section>"


def provenance(plant: Plant) -> str:
    if not plant.provenance:
        return ""
    rows = [(escape(k), escape(v)) for k, v in origin(plant)]
    return f"<section><h2>Where the numbers come from</h2>{table((), rows)}</section>"


def conditions(plant: Plant) -> str:
    """Where the curves of a plant are drawn that depend on more than the motion, for the end of a title; else empty."""
    said = ["without load"] if LOADED in plant else []
    said += ["at 20 degC"] if any(e.thermometer for e in plant.effects) else []
    return "".join(f", {s}" for s in said)


def origin(plant: Plant) -> list[tuple[str, str]]:
    """The provenance of a plant as people write it, with units."""
    out = dict(plant.provenance)
    score = POSITION if out.pop("error_of", None) else TORQUE
    for key in ("error", "noise_floor"):
        if key in out:
            out[key] = score.told(out[key])
    for key, unit in _UNITS.items():
        if key in out:
            out[key] = f"{said(out[key])} {unit}"
    if isinstance(open_ := out.pop("undetermined", None), list | tuple):
        told = dict(str(x).partition(TELLS)[::2] for x in open_)
        out["undetermined"] = "; ".join(f"{names}{TELLS}{what}" for names, what in by_experiment(told))
    return [(k.replace("_", " "), said(v)) for k, v in out.items()]


def said(value: Any) -> str:
    """A value of the provenance as people write it."""
    if isinstance(value, list | tuple):
        return ", ".join(map(said, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def where_it_fails(shown: Shown) -> str:
    """Regimes and views of the residual over all records, of one model or of the first and the last."""
    first = shown[0][1]
    lines = "".join(
        f"<p><b>{escape(name)}:</b> {escape(c.where).replace(chr(10), '; ')}.</p>" for name, c, _ in shown
    )
    key = figure.legend([(name, colour) for name, _, colour in shown], NOISE)
    most, rest = telling(first)
    parts = [lines, _regimes(shown), key, grid([view_figure(shown, m) for m in most])]
    if rest:
        more = key + grid([view_figure(shown, m) for m in rest])
        parts.append(f"<details><summary>{len(rest)} more views</summary>{more}</details>")
    return (
        f"<section><h2>Where it fails</h2><p>Mean of the residual, which is {RESIDUAL[first.score.word]}. A mean "
        "within the grey band may be sensor noise.</p>"
        + "".join(parts) + "</section>"
    )  # fmt: skip


def telling(c: Comparison) -> tuple[list[ResidualMap], list[ResidualMap]]:
    """The views of all records that tell most, and the others."""
    always = [m for n in _ALWAYS if (m := c.view(n))]
    means = [m for m in c.views if not m.record and m.name not in _ALWAYS]
    means.sort(key=lambda m: -np.nan_to_num(m.share, nan=-1.0))
    return [*means[:_TELLING], *always], means[_TELLING:]


def view_figure(shown: Shown, like: ResidualMap) -> str:
    """One view of the residual of each model, over the noise band of the last."""
    curves, bands, said = [], [], []
    for name, c, colour in shown:
        m = c.view(like.name, like.record)
        if m is None:
            continue
        keep = m.centres > 0 if m.log[0] else np.ones(len(m.centres), bool)
        curves.append(Curve(name, m.centres[keep], m.mean[keep], colour, m.style))
        bands = [Band(m.centres[keep], m.low[keep], m.high[keep])]
        if m.style == "steps" and np.isfinite(m.share):
            said.append(f"{escape(name)} {100 * m.share:.0f} %")
    note = f"{', '.join(said)} of its square" if said else like.detail if like.stands_out else ""
    note = f" <small>{note}</small>" if note else ""
    picture = figure.plot(
        curves, like.label, like.unit, like.value_label, like.value_unit, bands=bands, log=like.log
    )
    return f"<h4>{escape(like.title[:1].upper() + like.title[1:])}{note}</h4>{picture}"


def _regimes(shown: Shown) -> str:
    """Error of each model in each regime of friction."""
    names = [g.name for g in shown[0][1].regimes]
    rows = []
    for name in names:
        found = [next((g for g in c.regimes if g.name == name), None) for _, c, _ in shown]
        first, last = found[0], found[-1]
        told = shown[0][1].score.told
        cells = [told(g.error) if g else "-" for g in found]
        rows.append([name, percent(first.time_share) if first else "-", *cells, told(last.floor) if last else "-"])
    heads = ["regime", "of the time", *(f"error, {escape(name)}" for name, _, _ in shown), "noise floor"]
    return table(heads, rows, range(1, len(heads)))


def records(shown: Shown) -> str:
    """Each record: torque where the first model fails most, friction over position, residual in time."""
    first = shown[0][1]
    order = worst_first(first)
    cells = [_record(shown, i) for i in order]
    folded = f"<details><summary>{len(cells) - _OPEN} more records</summary>{''.join(cells[_OPEN:])}</details>"
    key = figure.legend([("measured", figure.COLOURS[0]), *((n, colour) for n, _, colour in shown)], NOISE)
    hysteresis = _after_reversal(shown)
    return (
        f"<section><h2>Record by record</h2><p>The one explained least stands first.</p>{key}{hysteresis}"
        f"{''.join(cells[:_OPEN])}{folded if len(cells) > _OPEN else ''}</section>"
    )


def _record(shown: Shown, i: int) -> str:
    rows = [(name, c.records[i], colour) for name, c, colour in shown]
    first, last = rows[0][1], rows[-1][1]
    torque, angle = _units(shown)
    near = figure.worst_stretch(first.residual)
    push = shown[0][1].score.word
    needed = [Curve("measured", first.time[near], first.measured[near], figure.COLOURS[0], "under")]
    needed += [Curve(n, r.time[near], r.needed[near], colour) for n, r, colour in rows]
    seen = friction(shown[-1][1], last)[0]
    loops = [Curve("measured", last.position[near], seen[near], figure.COLOURS[0], "under")]
    loops += [Curve(n, r.position[near], friction(c, r)[1][near], colour)
              for (n, r, colour), (_, c, _) in zip(rows, shown, strict=True)]  # fmt: skip
    left = [Curve(n, r.time, r.residual, colour) for n, r, colour in rows]
    level = Z * float(np.sqrt(np.mean(last.floor**2)))
    ends = last.time[[0, -1]]
    pictures = [
        f"<h4>{push.capitalize()} where {escape(rows[0][0])} fails most</h4>"
        + figure.plot(needed, "time", "s", push, torque),
        f"<h4>Friction over position, there <small>{push} less that of the inertia</small></h4>"
        + figure.plot(loops, "position", angle, "friction", torque),
        "<h4>Residual over time</h4>"
        + figure.plot(left, "time", "s", "residual", torque,
                      bands=[Band(ends, np.full(2, -level), np.full(2, level))]),
    ]  # fmt: skip
    harmonics = shown[0][1].view("time_harmonic", first.name)
    if harmonics:
        pictures.append(view_figure(shown, harmonics))
    errors = ", ".join(f"{escape(n)} {percent(r.torque_error)}" for n, r, _ in rows)
    said = f"{shown[0][1].score.name} {errors}; noise floor {percent(last.noise_floor)}"
    return f"<h3>{escape(first.name)} <small>{said}</small></h3>" + grid(pictures)


def _after_reversal(shown: Shown) -> str:
    """The hysteresis as one curve: friction along the motion over the distance since the reversal."""
    torque, angle = _units(shown)
    curves = []
    for name, c, colour in shown:
        if (found := c.after_reversal) is not None:
            curves.append(Curve(name, found[0], found[2], colour, "steps"))
    if not curves:
        return ""
    found = shown[-1][1].after_reversal
    if found is not None:
        curves.insert(0, Curve("measured", found[0], found[1], figure.COLOURS[0], "under"))
    picture = figure.plot(curves, "distance since the reversal", angle, "friction along the motion", torque,
                          log=(True, False))  # fmt: skip
    return grid([f"<h4>How friction turns round after a reversal <small>mean of all records</small></h4>{picture}"])


def friction(c: Comparison, r: RecordComparison) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measured and needed torque of a record, each less that of the inertia [N m]."""
    inertial = c.plant.driven_inertia * r.observation.acceleration
    return r.measured - inertial, r.needed - inertial


def worst_first(comparison: Comparison) -> list[int]:
    """Numbers of the records, the one that the plant explains least first."""
    return sorted(range(len(comparison.timed)), key=lambda i: -comparison.timed[i].error)


def _units(shown: Shown) -> tuple[str, str]:
    return ("N m", "rad") if shown[0][1].plant.kind == "hinge" else ("N", "m")


def grid(cells: Sequence[str]) -> str:
    """Figures side by side."""
    return f'<div class="plots">{"".join(f"<div>{c}</div>" for c in cells)}</div>'
