"""What a search has found and left out on its way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..compare import Comparison
from ..fit_result import FitResult
from ..identification.held_out import HeldOut
from ..plant import Plant
from .judgement import Trial


@dataclass(frozen=True)
class Step:
    """One plant on the way: the baseline, or the plant before with one effect more.

    Attributes:
        effect: what was added; None for the baseline.
        result: the joint fit.
        comparison: on the validate records, made after every choice; None where there are none.
        evidence: one sentence that a person can check on a plot.
        confusable_with: effects that these records cannot tell from the one added.
        p_value: of the fall of the error on held-out blocks.
        held_out: what is left of each block of the fit records by a fit without it.
        others: fits with another effect in its place, which earned it as well.
    """

    effect: str | None
    result: FitResult
    comparison: Comparison | None = None
    confusable_with: tuple[str, ...] = ()
    p_value: float = float("nan")
    held_out: HeldOut = field(default_factory=lambda: HeldOut(np.empty(0), ()), repr=False)
    evidence: str = ""
    others: tuple[Trial, ...] = field(default=(), repr=False)

    @property
    def validate_error(self) -> float | None:
        """Pooled error on the validate records: of the torque, or of the position of a servo [rad]."""
        return None if self.comparison is None else self.comparison.error


class Tried(NamedTuple):
    """An effect that was looked at and left out.

    Attributes:
        name: of the effect.
        p_value: of the fall of the error on held-out blocks.
        plant: with the effect: fitted jointly, or where such a fit would begin.
        fitted: whether it was.
    """

    name: str
    p_value: float
    plant: Plant
    fitted: bool
