"""Parameter: what one number of an effect means."""

import math
from dataclasses import dataclass

from .errors import ModelError, is_number

KELVIN = "K"  # unit of a rise of temperature
DECELERATION = "rad/s^2"  # unit of what slows a body down
WAVES = "1/rev"  # unit of a harmonic: a whole number of periods per revolution; on a slide joint rad/m, any wave number


@dataclass(frozen=True)
class Parameter:
    """Declaration of one parameter.

    Attributes:
        name: as written in `model.toml`.
        unit: SI, for a hinge (a slide joint reads m for rad, N for N m and rad/m for 1/rev).
        default: value where none is given. A default of 0 marks a strength: with all strengths at 0 the effect is
            absent. NaN: none, a fit or the user must give it.
        lower, upper: closed bounds.
        free: whether a fit identifies it unless told otherwise.
        per_element: one value per element of the effect instead of one for the effect.
        share: the values of all elements sum to 1.
        at_least: name of another parameter of the effect that is a lower bound for this one.
        doc: symbol and meaning.

    Raises:
        ModelError: one of them is of another type, as where the order is another.
    """

    name: str
    unit: str
    default: float = float("nan")
    lower: float = float("-inf")
    upper: float = float("inf")
    free: bool = True
    per_element: bool = False
    share: bool = False
    at_least: str = ""
    doc: str = ""

    def __post_init__(self) -> None:
        for key in ("name", "unit", "default", "lower", "upper", "at_least", "doc"):
            value, is_text = getattr(self, key), key not in ("default", "lower", "upper")
            if not (isinstance(value, str) if is_text else is_number(value)):
                expected = "text" if is_text else "a number"
                raise ModelError(f"parameter {self.name!r}: {key} must be {expected}; {value!r} given, and "
                                 "the order is name, unit, default, lower, upper")

    @property
    def span(self) -> str:
        """The bounds as people write them: infinity is none of the values."""
        low = f"[{self.lower:g}" if math.isfinite(self.lower) else "(-inf"
        return f"{low}, {self.upper:g}]" if math.isfinite(self.upper) else f"{low}, inf)"

    @property
    def is_scale(self) -> bool:
        """Whether others are measured by it, a velocity, a deceleration or a rise of temperature, which may be any by
        orders of magnitude: zero is far from all of them, no unknown, and marks no strength."""
        return self.unit in ("rad/s", DECELERATION, KELVIN)
