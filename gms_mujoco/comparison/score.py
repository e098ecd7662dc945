"""What an error is of, and how it is told: the torque of an axis, or the position of a servo that takes a goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WEIGHED = "of responses each point weighed by its deviation"  # what their torque errors and noise floors are
NEAR_FLOOR = 1.2  # times the noise floor: hardly more than the sensors leave


@dataclass(frozen=True)
class Score:
    """One kind of error.

    Attributes:
        of: "torque" or "position", as files say it.
        unit: of the error, "1" or "rad".
        head: of a column of errors.
        meaning: a sentence.
        word: what people call it: of a slide joint "force".
    """

    of: str
    unit: str
    head: str
    meaning: str
    word: str

    @property
    def name(self) -> str:
        """As in "torque error"."""
        return f"{self.word} error"

    def of_kind(self, kind: str) -> Score:
        """The same of a joint of that kind, "hinge" or "slide"."""
        return FORCE if self is TORQUE and kind == "slide" else self

    def pooled(self, residuals: Sequence[Array], measured: Sequence[Array]) -> float:
        """The error of several records of equal weight.

        Args:
            residuals: (m,) of each, measured minus model.
            measured: (m,) of each.
        """
        if self.unit != "1":
            return float(np.mean([np.mean(np.abs(r)) for r in residuals])) if len(residuals) else float("nan")
        return relative_error(residuals, measured)

    def told(self, value: object) -> str:
        """An error with its unit; "-" where there is none."""
        if not isinstance(value, int | float):
            return "-"
        return f"{100 * value:.3g} %" if self.unit == "1" else f"{1e3 * value:.3g} mrad"

    def column(self, value: float | None) -> str:
        """The same in a column of a table of text, whose head has the unit."""
        return "-" if value is None else f"{(100 if self.unit == '1' else 1e3) * value:.2f}"


TORQUE = Score(
    "torque", "1", "torque error in % of the torque",
    "Torque that the model does not account for, as a share of the torque's rms", "torque",
)  # fmt: skip
FORCE = Score(
    "torque", "1", "force error in % of the force",
    "Force that the model does not account for, as a share of the force's rms", "force",
)  # fmt: skip
POSITION = Score(
    "position", "rad", "mean absolute error of the position [mrad]",
    "Mean absolute difference of the measured position from the one simulated from the goal", "position",
)  # fmt: skip


def relative_error(residuals: Sequence[Array], torques: Sequence[Array]) -> float:
    """Rms of the residuals over rms of the torques, records of equal weight."""
    above = np.mean([np.mean(r**2) for r in residuals])
    below = np.mean([np.mean(t**2) for t in torques])
    return float(np.sqrt(above / below)) if below > 0 else float("nan")


def above_floor(error: float, floor: float) -> str:
    """How far an error is above its noise floor, as in "1.3 times the noise floor"; "" where it is hardly."""
    if error <= NEAR_FLOOR * floor:
        return ""
    return f"{times(error, floor)} the noise floor" if floor > 0 and error < np.inf else "above the noise floor"


def times(one: float, other: float) -> str:
    """How often one number is another, to two digits, as in "1.3 times"."""
    ratio = one / other
    return f"{ratio:.2g} times" if ratio < 100 else f"{float(f'{ratio:.2g}'):.0f} times"
