"""What a diagnosis has found, as a noun: steps, what was left out, and what it all comes to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..compare import Comparison
from ..comparison.score import Score
from ..effect import Effect
from ..plant import Plant
from .steps import Step


@dataclass(frozen=True)
class Rejected:
    """An effect that was tried on the final plant and did not earn its place.

    Attributes:
        effect: its name.
        p_value: how easily chance alone would lower the error on held-out blocks as much.
        validate_error: with it, from a joint fit where one was made, else from the linear refit that it was judged by,
            or without it where that leaves less; None where no records validate.
    """

    effect: str
    p_value: float
    validate_error: float | None = None


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes:
        verdict: "adequate" (the baseline is at the noise floor), "explained" (the effects added bring it there),
            "partly_explained" (they help, something remains) or "unexplained" (nothing known earns its place). Single
            moments of the fit records that no law explains count for nothing where the validate records have none.
        noise_floor: the error that a perfect model would have, of the torque, of a servo of its position [rad]; on the
            validate records where there are some.
        steps: the baseline, then one for each effect added.
        candidates: what was tried on the final plant and left out.
        remainder: what is left looks like this; empty where nothing is.
        next_experiment: what to measure next, None where there is nothing to settle.
        notes: a sentence on how the records were logged, where that matters, one on single moments that nothing
            explains, and one on each candidate of the user's.
        data: what the records are for, and what was done to them or may be wrong with them, as `load` says it.
    """

    verdict: str
    noise_floor: float
    steps: tuple[Step, ...]
    candidates: tuple[Rejected, ...] = ()
    remainder: str = ""
    next_experiment: str | None = None
    notes: tuple[str, ...] = ()
    data: tuple[str, ...] = ()

    @property
    def baseline(self) -> Plant:
        """The plant before anything was added."""
        return self.steps[0].result.plant

    @property
    def plant(self) -> Plant:
        """The final plant."""
        return self.steps[-1].result.plant

    @property
    def score(self) -> Score:
        """What the errors and the floor are of, and how they are told."""
        return self.steps[0].result.score

    @property
    def fit_noise_floor(self) -> float:
        """The error that a perfect model would have on the records that were fitted."""
        return self.steps[-1].result.floor

    @property
    def comparisons(self) -> list[Comparison]:
        """Each step on the validate records."""
        return [s.comparison for s in self.steps if s.comparison is not None]

    @property
    def found(self) -> tuple[Effect, ...]:
        """The effects that were added, with their parameters, in order."""
        return tuple(self.plant[s.effect] for s in self.steps if s.effect)

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.found)

    def to_dict(self) -> dict[str, Any]:
        """The contents of `diagnosis.json`."""
        return {
            "schema": 1,
            "verdict": self.verdict,
            "error_of": self.score.of,
            "error_unit": self.score.unit,
            "noise_floor": self.noise_floor,
            "fit_noise_floor": self.fit_noise_floor,
            "bandwidth_hz": max(o.bandwidth for o in self.steps[0].result.misfit.observations),
            "steps": [_step_dict(s, self.plant) for s in self.steps],
            "candidates": [
                {"effect": c.effect, "validate_error": c.validate_error, "p_value": c.p_value}
                for c in self.candidates
            ],
            "remainder": self.remainder or None,
            "notes": list(self.notes),
            "data": list(self.data),
            "next_experiment": self.next_experiment,
        }

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict.replace('_', ' ')}", ""]
        lines.append(f"{'model':32}  {'fit':>8}  {'validate':>8}   {self.score.head}")
        for s in self.steps:
            name = "baseline" if s.effect is None else f"+ {s.effect}"
            fitted, validate = map(self.score.column, (s.result.error, s.validate_error))
            lines.append(f"{name:32}  {fitted:>8}  {validate:>8}")
        scored = self.noise_floor if self.comparisons else None
        fitted, validate = map(self.score.column, (self.fit_noise_floor, scored))
        lines.append(f"{'noise floor':32}  {fitted:>8}  {validate:>8}")
        for s in self.steps:
            lines += ["", s.evidence] if s.evidence else []
            if s.confusable_with:
                lines.append(f"These records cannot tell it from {', '.join(s.confusable_with)}.")
        if self.remainder:
            lines += ["", f"What remains: {self.remainder}"]
        if self.notes:
            lines += ["", *self.notes]
        if self.next_experiment:
            lines += ["", f"Measure next: {self.next_experiment}"]
        return "\n".join(lines)


def _step_dict(step: Step, final: Plant) -> dict[str, Any]:
    out: dict[str, Any] = {
        "effect": step.effect,
        "fit_error": step.result.error,
        "validate_error": step.validate_error,
    }
    if step.effect:
        out["confusable_with"] = list(step.confusable_with)
        out["p_value"] = step.p_value
        out["parameters"] = final.table(step.effect)
    if step.evidence:
        out["evidence"] = step.evidence
    return out
