"""mkdocs hook: a page per effect, and their overview, from what the effect files declare."""

from __future__ import annotations

import math
import re

from effect_pictures import picture
from mkdocs.structure.files import File, Files

from gms_mujoco.effect import KINDS, Effect
from gms_mujoco.effects import CATALOGUE

OF_KIND = {
    "friction": "Friction",
    "drive": "Drive: between the commanded torque and the joint",
    "mechanics": "Mechanics",
    "sensor": "Sensor: between the joint and the recorded position",
    "controller": "Controller: of a servo that is told where to go",
}


def on_files(files: Files, config: object) -> Files:
    files.append(File.generated(config, "effects.md", content=overview()))  # type: ignore[arg-type]
    for effect in CATALOGUE.values():
        files.append(File.generated(config, f"effects/{effect.name}.md", content=page(effect)))  # type: ignore[arg-type]
    return files


def overview() -> str:
    """All effects by kind, with what a person sees when one is missing."""
    lines = [
        "# Effects",
        "",
        "One physical cause each, the same for simulation, identification and diagnosis. The name is what stands in "
        "`model.toml`, behind `--effects` and in a diagnosis.",
    ]
    for kind in KINDS:
        lines += ["", f"## {OF_KIND[kind]}", "", "| effect | what you see when the model lacks it |", "|---|---|"]
        for e in CATALOGUE.values():
            if e.kind == kind:
                lines.append(f"| [{e.name}](effects/{e.name}.md) | {escaped(e.signature)} |")
    return "\n".join(lines) + "\n"


def page(effect: type[Effect]) -> str:
    """One effect: equation, source, signature, experiment, parameters, use."""
    body, _, source = effect.doc.partition("Source")
    lines = [f"# {effect.name}", "", escaped(" ".join(body.split()))]
    if source:
        lines += ["", f"**Source{'s' * source.startswith('s')}**: {escaped(' '.join(source.lstrip('s:').split()))}"]
    lines += ["", "**What you see when the model lacks it**: " + escaped(effect.signature)]
    lines += ["", picture(effect)]
    lines += ["", "**What to measure to bring it out**: " + escaped(effect.experiment)]
    lines += ["", "| parameter | unit | default | range | meaning |", "|---|---|---|---|---|"]
    for p in effect.parameters:
        default = "identified" if math.isnan(p.default) else "equal shares" if p.share else f"{p.default:g}"
        several = ", one per element" if p.per_element else ""
        meaning = f"{escaped(p.doc)}{several}{'' if p.free else '; not identified'}"
        lines.append(f"| `{p.name}` | {escaped(p.unit)} | {default} | {interval(p.lower, p.upper)} | {meaning} |")
    given = ", ".join(f"{p.name}=..." for p in effect.parameters if math.isnan(p.default) or p.default == 0)
    lines += ["", "```python", f"plant + gms.effects.{effect.__name__}({given})", "```"]
    where = "the friction plug-in" if effect.is_native else "the model itself (`Effect.edit`)"
    if effect.is_native or effect.edit is not Effect.edit:
        lines += ["", f"In MuJoCo it is done by {where}."]
    else:
        lines += ["", "In MuJoCo it has no place: commands and positions are exact there."]
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Text as Markdown that shows it as it is; names in backquotes stay."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(s if s.startswith("`") else re.sub(r"([\\*_\[\]<>|])", r"\\\1", s) for s in parts)


def interval(lower: float, upper: float) -> str:
    """A range as people write it."""
    if math.isinf(lower) and math.isinf(upper):
        return "any"
    if math.isinf(upper):
        return f"from {lower:g}"
    return f"up to {upper:g}" if math.isinf(lower) else f"{lower:g} to {upper:g}"
