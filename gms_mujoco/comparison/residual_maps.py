"""Where a residual stands, as data: one view each with the band that noise fills, and the regimes of friction.

A view is computed once (`residuals`); texts, pages and recordings only show it. A comparison of frequency responses
brings views of the same kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SHARED = (
    "position", "revolution", "velocity", "acceleration", "torque", "torque_rate", "load", "temperature",
    "since_reversal", "time_since_reversal", "following_error", "goal_rate",
)  # fmt: skip
_FEW = 0.05  # of all bins: outside their band in a plant that is as good as its noise is known
_AT_FLOOR = 1.15  # times the floor: noise is known no better
_NOTABLE = 0.15  # share of the squared residual that is worth a word
_PERIODIC = 0.05  # by which a position may do better than the place on the revolution, its period
_LINE = 0.5  # share of one band of the spectrum that is called a line
_CROWDED = 1.3  # times as much of the squared residual as of the time


@dataclass(frozen=True)
class ResidualMap:
    """One view of a residual.

    Attributes:
        name: "time", "position", "revolution", "velocity", "acceleration", "torque", "torque_rate", "load",
            "temperature", "since_reversal", "time_since_reversal"; of a servo "following_error", "goal_rate";
            "revolution_harmonic", "time_harmonic", "frequency";
            "autocorrelation", "input_correlation".
        label, unit: of the horizontal axis.
        value_unit: of `mean`.
        centres: (b,) places.
        mean: (b,) mean residual there; of harmonics the amplitude, of frequencies the root of the spectral density, of
            correlations the coefficient.
        expected: (b,) what sensor noise alone makes of it.
        band: (b,) half width of the 99 % band about `expected`.
        count: (b,) samples.
        share: of the squared residual that is a function of this quantity: what means over every second stretch of
            the records predict of the others; of harmonics and frequencies, that of the greatest; else NaN.
        detail: where it is greatest, in words.
        record: name of the one record that is shown; "" where all are.
        along: the residual is counted along the motion, positive where the plant resists too little.
    """

    name: str
    label: str
    unit: str
    value_unit: str
    centres: Array
    mean: Array
    expected: Array
    band: Array
    count: Array
    share: float = float("nan")
    detail: str = ""
    record: str = ""
    along: bool = False

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(b,) where the residual leaves its band."""
        return np.abs(self.mean - self.expected) > self.band

    @property
    def stands_out(self) -> bool:
        """Whether what is greatest is worth a word, and more than noise."""
        return bool(self.share >= _NOTABLE and self.outside.any())

    @property
    def low(self) -> Array:
        """(b,) lower edge of the band; an amplitude is not negative."""
        return np.zeros(len(self.mean)) if self.name.endswith("_harmonic") else self.expected - self.band

    @property
    def high(self) -> Array:
        """(b,) upper edge of the band."""
        return self.expected + self.band

    @property
    def style(self) -> str:
        """How it is drawn: "steps" (a mean in each bin), "stems" or "line"."""
        if self.name.endswith(("_harmonic", "correlation")):
            return "stems"
        return "line" if self.name == "frequency" else "steps"

    @property
    def log(self) -> tuple[bool, bool]:
        """Which axes are logarithmic."""
        return self.name in ("frequency", "since_reversal", "time_since_reversal"), self.name == "frequency"

    @property
    def value_label(self) -> str:
        """Of the vertical axis."""
        if self.name.endswith("correlation"):
            return "coefficient"
        return "amplitude" if self.name.endswith("_harmonic") else "residual"

    @property
    def title(self) -> str:
        """Of a figure."""
        what = {
            "autocorrelation": "autocorrelation of the residual",
            "input_correlation": f"correlation of the residual with the {self.label.removeprefix('lag behind the ')}",
            "frequency": "spectrum of the residual",
            "revolution_harmonic": "residual, harmonics of the revolution",
            "time_harmonic": "residual, harmonics of the excitation",
        }.get(self.name, f"residual{' along the motion' if self.along else ''} over {self.label}")
        return what + (f", {self.record}" if self.record else "")

    def to_dict(self) -> dict[str, Any]:
        """As `compare --json` shows it."""
        return {
            "name": self.name,
            "record": self.record or None,
            "x": f"{self.label} [{self.unit}]",
            "unit": self.value_unit,
            "along_motion": self.along,
            "share": self.share,
            "detail": self.detail,
            "outside": int(self.outside.sum()),
            "centres": self.centres.tolist(),
            "mean": self.mean.tolist(),
            "expected": self.expected.tolist(),
            "band": self.band.tolist(),
            "count": self.count.tolist(),
        }


@dataclass(frozen=True)
class Regime:
    """One regime of friction over all records.

    Attributes:
        name: "pre-sliding", "reversal" or "sliding"; of a servo "at rest", "moving" or "without power".
        time_share: of the samples.
        square_share: of the squared residual.
        error, floor: rms of the residual, and of what noise leaves, over the rms of the torque of all records; of a
            servo their mean absolute sizes [rad].
    """

    name: str
    time_share: float
    square_share: float
    error: float
    floor: float

    def to_dict(self) -> dict[str, Any]:
        return {k: getattr(self, k) for k in ("name", "time_share", "square_share", "error", "floor")}


def where(
    views: Sequence[ResidualMap],
    regimes: Sequence[Regime],
    excess: float,
    offset: float,
    offset_share: float,
    unit: str,
) -> str:
    """Where a residual leaves its noise band most, in one or two lines.

    Args:
        views, regimes: of the residual.
        excess: rms of the residual over that of the floor.
        offset: mean of the residual [unit].
        offset_share: of the squared residual, that of its mean.
    """
    means = [m for m in views if not m.record and m.name in _SHARED]
    if not means:
        return "the records are too short to say where the residual stands"
    out, bins = sum(int(m.outside.sum()) for m in means), sum(len(m.mean) for m in means)
    best = max(means, key=lambda m: m.share + (_PERIODIC if m.name == "revolution" else 0.0))
    counted = f"({out} of {bins} bins outside, {0.01 * bins:.0f} by chance)"
    if out <= _FEW * bins:
        return f"the residual stays within its noise band {counted}"
    if excess < _AT_FLOOR and best.share < _NOTABLE:
        return f"the residual is at its noise floor and leaves the band by little {counted}"
    line = next((m for m in views if m.name == "frequency" and m.share > _LINE), None)
    if offset_share > max(best.share, _NOTABLE):
        most = f"mostly as an offset of {offset:.3g} {unit} ({100 * offset_share:.0f} % of its square)"
    elif line is not None and line.share > best.share:
        most = f"mostly {line.detail} ({100 * line.share:.0f} % of its square)"
    elif best.share < _NOTABLE:
        most = f"in {out} of {bins} bins, with no single quantity"
    else:
        most = f"mostly with {best.label} ({_place(best, views)}, {100 * best.share:.0f} % of its square)"
    says = f"the residual leaves its noise band {most}"
    worst = max(regimes, key=lambda g: g.square_share / g.time_share)
    if worst.square_share > _CROWDED * worst.time_share and worst.square_share > _NOTABLE:
        says += (
            f"\n{100 * worst.square_share:.0f} % of its square stands in {worst.name}, "
            f"{100 * worst.time_share:.0f} % of the time"
        )
    return says


def _place(best: ResidualMap, views: Sequence[ResidualMap]) -> str:
    tone = next((m for m in views if m.name == "revolution_harmonic"), None)
    return tone.detail if best.name == "revolution" and tone and tone.share > 0.5 * best.share else best.detail
