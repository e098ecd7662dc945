"""A diagnosis or a comparison as one HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..compare import WINDOW
from ..comparison.score import WEIGHED, Score, above_floor
from ..version import __version__
from . import figure
from .figure import COLOURS
from .page import (
    Shown,
    escape,
    html_page,
    number,
    parameters,
    percent,
    provenance,
    records,
    table,
    where_it_fails,
)
from .page_frf import responses
from .page_servo import servo_runs

if TYPE_CHECKING:
    from ..compare import Comparison
    from ..diagnosis.findings import Diagnosis

VERDICTS = {
    "adequate": "The baseline model explains the data down to the noise. Nothing was added.",
    "explained": "The added effects bring the error down to the noise.",
    "partly_explained": "The added effects lower the error; something remains that they do not explain.",
    "unexplained": "The error is above the noise and no known effect earns its place. None is named.",
}


def render(diagnosis: Diagnosis) -> str:
    """The page of a diagnosis as text."""
    facts = diagnosis.to_dict()
    title = "What this axis is missing"
    comparisons = list(diagnosis.comparisons)
    weighed = any(c.frfs for c in comparisons)
    parts = [f"<h1>{title}</h1>", _verdict(facts), _steps(facts, diagnosis.score, weighed)]
    if comparisons:
        names = step_names(facts)
        shown = [(names[0], comparisons[0], COLOURS[1])]
        if len(comparisons) > 1:
            shown.append((names[-1], comparisons[-1], COLOURS[2]))
        parts += _in_time(shown)
        parts.append(responses(shown))
    parts += [_candidates(facts, diagnosis.score), parameters(diagnosis.plant, "The final plant")]
    parts += [_data(facts), provenance(diagnosis.plant)]
    return html_page(title, "\n".join(p for p in [*parts, _footer()] if p))


def _in_time(shown: Shown) -> list[str]:
    """Where the models fail on what was measured in time, and each record of it."""
    first = shown[0][1]
    return [where_it_fails(shown), servo_runs(shown) if first.servos else records(shown)] if first.timed else []


def render_comparison(comparison: Comparison, name: str = "model") -> str:
    """The page of a comparison as text.

    Args:
        name: what the plant is called on the figures.
    """
    title = "Where this model fails"
    shown, score = [(name, comparison, COLOURS[1])], comparison.score
    rows = [
        [escape(r.name), escape(r.use), score.told(r.error), score.told(r.noise_floor), percent(r.simulation_error)]
        for r in comparison.rows
    ]
    pooled = (score.told(comparison.error), score.told(comparison.noise_floor), percent(comparison.simulation_error))
    rows.append(["<b>pooled</b>", "", *(f"<b>{v}</b>" for v in pooled)])
    timed = "record" if comparison.timed else ""
    what = " or ".join(filter(None, (timed, "response" if comparison.frfs else "")))
    heads = (what, "use", score.name, "noise floor", "simulation error")
    simulated = [f"of the change of position over {1000 * WINDOW:.0f} ms"] if timed else []
    simulated += ["of a response under the same torque, once the motion is steady"] if comparison.frfs else []
    note = (
        f"<p>{_upper(score.name)}: rms of the residual up to {comparison.bandwidth:.0f} Hz over the rms of the "
        f"measured {score.word}{f', {WEIGHED}' if comparison.frfs else ''}. "
        f"Simulation error: {'; '.join(simulated)}.</p>"
    )
    if comparison.servos:
        note = (
            f"<p>Position error: {_lower(score.meaning)}. Simulation error: the rms of the same over that of the "
            "position about its mean. Noise floor: how far the measurement strays from its own repetitions, or where "
            "nothing is repeated the noise of the encoder alone.</p>"
        )
    above = above_floor(comparison.error, comparison.noise_floor)
    good, says, alone = not above, above or "at the noise floor", score.told(comparison.noise_floor)
    worst = max(comparison.rows, key=lambda r: r.error / r.noise_floor if r.noise_floor > 0 else 0.0)
    own = above_floor(worst.error, worst.noise_floor) if len(comparison.rows) > 1 else ""
    of_worst = f" {escape(worst.name)} alone leaves {own}." if own else ""
    verdict = (
        f'<section class="verdict{"" if good else " fails"}"><p><b>{says}</b></p><p>{_upper(score.name)} '
        f"{score.told(comparison.error)}; sensor noise alone would leave {alone}.{of_worst}</p>"
        f"{f'<p>{escape(_sentence(comparison.where))}</p>' if comparison.where else ''}</section>"
    )
    parts = [f"<h1>{title}</h1>", verdict, f"<section><h2>Errors</h2>{note}{table(heads, rows, (2, 3, 4))}</section>"]
    parts += _in_time(shown)
    parts += [responses(shown), parameters(comparison.plant, "The plant")]
    parts += [provenance(comparison.plant), _footer()]
    return html_page(title, "\n".join(p for p in parts if p))


def step_names(facts: dict[str, Any]) -> list[str]:
    """What each step of `diagnosis.json` is called on a figure."""
    return ["baseline" if s["effect"] is None else f"+ {s['effect']}" for s in facts["steps"]]


def _sentence(text: str) -> str:
    """Lines as one sentence."""
    return f"{_upper('; '.join(text.splitlines()))}."


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


def _verdict(facts: dict[str, Any]) -> str:
    verdict = str(facts["verdict"])
    added = [s["effect"] for s in facts["steps"] if s["effect"]]
    said = [VERDICTS.get(verdict, "")]
    said += [f"Added: {', '.join(added)}."] if added else []
    said += [f"What remains: {facts['remainder']}."] if facts.get("remainder") else []
    said += facts.get("notes") or []
    said += [f"Measure next: {facts['next_experiment']}"] if facts.get("next_experiment") else []
    lines = "".join(f"<p>{escape(line)}</p>" for line in said if line)
    return (
        f'<section class="verdict {escape(verdict)}"><p><b>{escape(verdict.replace("_", " "))}</b></p>{lines}</section>'
    )


def _steps(facts: dict[str, Any], score: Score, weighed: bool) -> str:
    names, rows, said = step_names(facts), [], ""
    for name, s in zip(names, facts["steps"], strict=True):
        evidence = escape(s.get("evidence") or "")
        if s.get("confusable_with"):
            evidence += f" Could be confused with {escape(', '.join(s['confusable_with']))}."
        rows.append([escape(name), score.told(s.get("fit_error")), score.told(s.get("validate_error"))])
        said += f"<p>{evidence}</p>" if evidence else ""
    scored = all(s.get("validate_error") is not None for s in facts["steps"])
    key, which = "validate_error", "on records that decided nothing"
    if not scored:
        key, which = "fit_error", "on the records it was fitted to: none was held out"
    floors = facts.get("fit_noise_floor"), facts.get("noise_floor") if scored else None
    rows.append(["noise floor", *map(score.told, floors)])
    picture = figure.bars(
        [(n, float(s[key])) for n, s in zip(names, facts["steps"], strict=True)], facts.get("noise_floor"), score.told
    )
    return (
        f"<section><h2>The falling error</h2><p>{score.meaning}{f', {WEIGHED}' if weighed else ''}, {which}.</p>"
        f"{picture}{table(('step', 'fit', 'validate'), rows, (1, 2))}{said}</section>"
    )


def _candidates(facts: dict[str, Any], score: Score) -> str:
    if not facts.get("candidates"):
        return ""
    ranked = sorted(facts["candidates"], key=lambda c: (c.get("p_value") is None, c.get("p_value")))
    rows = [[escape(c["effect"]), score.told(c.get("validate_error")), number(c.get("p_value"))] for c in ranked]
    return (
        "<section><h2>Effects that were tried and not added</h2><p>p value: how easily chance alone would lower the "
        "error on held-out blocks as much. A small one alone adds no effect: near the noise floor, or where it would "
        "take little of the error, none is added.</p>"
        f"{table(('effect', 'validate error', 'p value'), rows, (1, 2))}</section>"
    )


def _data(facts: dict[str, Any]) -> str:
    lines = "".join(f"<li>{escape(line)}</li>" for line in facts.get("data") or [])
    return f"<section><h2>The measurements</h2><ul>{lines}</ul></section>" if lines else ""


def _footer() -> str:
    return f"<footer>gms-mujoco {escape(__version__)}. This page needs no network.</footer>"
