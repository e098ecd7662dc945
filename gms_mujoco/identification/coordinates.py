"""Coordinates: the free parameters of a plant as one vector that an optimiser can move.

Parameters without a natural zero (stiffness, level, velocity) move on a logarithmic scale; those that vanish when
the effect is absent, or that have another as their lower bound, move linearly (from that bound); shares that sum
to 1 move as log-ratios to the last share.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..parameter import WAVES, Parameter
from ..plant import Plant

Array = NDArray[np.float64]

_OPEN = np.log(1e3)  # half an interval of a logarithm
_DIGITS = 1e-13  # of a sum that cancels
_INERTIA = Parameter("inertia", "kg m^2", lower=0.0, doc="J")


@dataclass(frozen=True)
class _Block:
    """The coordinates of one parameter: `size` of them, for `count` values."""

    effect: str  # "" for the inertia
    parameter: Parameter
    count: int

    @cached_property
    def scale(self) -> str:
        if self.parameter.share:
            return "share"
        if self.parameter.at_least:
            return "above"
        if self.is_wave_number:
            return "linear"
        orders = self.parameter.default != 0 or self.parameter.is_scale
        return "log" if self.parameter.lower >= 0 and orders else "linear"

    @property
    def is_wave_number(self) -> bool:
        """Whether it says how fast a phase grows with the place; its size says nothing of how far it may move."""
        return self.parameter.unit == WAVES

    @property
    def reference(self) -> str:
        """Label of the parameter that bounds this one from below."""
        return f"{self.effect}.{self.parameter.at_least}"

    @property
    def size(self) -> int:
        return self.count - 1 if self.scale == "share" else self.count

    @property
    def label(self) -> str:
        return f"{self.effect}.{self.parameter.name}" if self.effect else self.parameter.name

    @property
    def labels(self) -> list[str]:
        return [self.label] if self.count == 1 else [f"{self.label}[{i}]" for i in range(self.count)]

    def encode(self, value: Array) -> Array:
        if self.scale in ("linear", "above"):
            return value
        z = np.log(np.maximum(value, 1e-300))
        return z[:-1] - z[-1] if self.scale == "share" else z

    def decode(self, x: Array) -> Array:
        if self.scale in ("linear", "above"):
            return x
        if self.scale == "log":
            value = np.exp(np.minimum(np.maximum(x, -690), 690))
            return np.minimum(np.maximum(value, self.parameter.lower), self.parameter.upper)
        z = np.append(x, 0.0)
        share = np.exp(z - z.max())
        return share / share.sum()

    def bounds(self) -> tuple[float, float]:
        lower, upper = self.parameter.lower, self.parameter.upper
        if self.scale == "share":
            return -12.0, 12.0  # a share of 6e-6 is none
        if self.scale == "above":
            return 0.0, np.inf
        if self.scale == "log":
            return np.log(max(lower, 1e-300)), np.log(upper)
        return lower, upper


class Coordinates:
    """The free parameters of plants built like `template`.

    Args:
        template: fixes which effects there are and how many elements they have.
        fixed: names "effect.parameter" (or "inertia") to leave as they are.
        free_only: leave out what no fit moves unasked.
        freed: names of what moves all the same.
    """

    def __init__(
        self, template: Plant, fixed: Collection[str] = (), free_only: bool = True, freed: Collection[str] = ()
    ) -> None:
        self.template = template
        blocks = [] if template.inertia_known else [_Block("", _INERTIA, 1)]
        for e in template.effects:
            # What comes back in a revolution does so a whole number of times, which no fit moves; a pitch may be any.
            moves = [p.free or not free_only or (template.kind == "slide" and p.unit == WAVES) for p in e.parameters]
            chosen = [p for p, free in zip(e.parameters, moves, strict=True) if free or f"{e.name}.{p.name}" in freed]
            own = [_Block(e.name, p, e.elements if p.per_element else 1) for p in chosen]
            blocks += [b for b in own if not (b.parameter.is_scale and e.values[b.parameter.name] == 0)]
        self.blocks = [b for b in blocks if b.label not in fixed and b.size > 0]
        self.size = sum(b.size for b in self.blocks)

    @property
    def labels(self) -> list[str]:
        """Name of each coordinate."""
        return [label for b in self.blocks for label in b.labels[: b.size]]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bound of each coordinate."""
        pairs = [b.bounds() for b in self.blocks for _ in range(b.size)]
        return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])

    @property
    def is_linear(self) -> NDArray[np.bool_]:
        """Which coordinates are in the unit of their parameter."""
        return np.array([b.scale in ("linear", "above") for b in self.blocks for _ in range(b.size)], bool)

    @property
    def is_wave_number(self) -> NDArray[np.bool_]:
        """Which coordinates are the wave numbers of an effect on a slide joint."""
        return np.array([b.is_wave_number for b in self.blocks for _ in range(b.size)], bool)

    def encode(self, plant: Plant) -> Array:
        """(size,) coordinates of a plant."""
        parts = []
        for b in self.blocks:
            given = plant[b.effect].values[b.parameter.name] if b.effect else plant.inertia
            value = np.atleast_1d(np.asarray(given, float))
            if b.scale == "above":
                value = value - np.asarray(plant[b.effect].values[b.parameter.at_least], float)
            parts.append(b.encode(value))
        return np.concatenate(parts) if parts else np.empty(0)

    def values(self, x: Array, effect: str | None = None) -> dict[str, Array]:
        """The values of each free parameter, by label of the parameter; of one effect ("": the inertia), or of all."""
        out, at = {}, 0
        for b in self.blocks:
            if effect in (None, b.effect):
                out[b.label] = b.decode(x[at : at + b.size])
                if b.scale == "above":
                    out[b.label] = out[b.label] + self._bound(b, out)
            at += b.size
        return out

    def _bound(self, block: _Block, values: dict[str, Array]) -> Array:
        fixed = self.template[block.effect].values[block.parameter.at_least]
        return values.get(block.reference, np.atleast_1d(np.asarray(fixed)))

    def decode(self, x: Array, beside: tuple[Plant, str] | None = None) -> Plant:
        """The plant at these coordinates.

        Args:
            x: (size,).
            beside: a plant that is there already but for one effect ("": the inertia), and the name of that.
        """
        plant, only = beside or (self.template, None)
        values = self.values(x, only)
        changed: dict[str, dict[str, object]] = {}
        for b in self.blocks:
            if (value := values.get(b.label)) is None:
                continue
            if not b.effect:
                plant = replace(plant, inertia=float(value[0]))
            else:
                changed.setdefault(b.effect, {})[b.parameter.name] = value if b.parameter.per_element else value[0]
        for name, new in changed.items():
            plant = plant.replace(plant[name].replace(**new))
        return plant

    def intervals(
        self, x: Array, covariance: Array, deviations: Array | float = 1.96
    ) -> dict[str, tuple[float, float]]:
        """Interval of each value, by its name, from the covariance of the coordinates.

        Where it would be as wide as six decades, or as the line, it is all that the parameter may be, often [0, inf]:
        the local expansion that it comes from says nothing then but that the data leave it open.

        Args:
            deviations: standard deviations in half an interval, of each coordinate (size,) or of all; infinite for one
                that is open.
        """
        out: dict[str, tuple[float, float]] = {}
        values, at = self.values(x), 0
        widths = np.broadcast_to(np.asarray(deviations, float), (self.size,))
        for b in self.blocks:
            here = slice(at, at + b.size)
            at += b.size
            value = b.decode(x[here])
            if b.scale == "share":
                slope = np.diag(value)[:, :-1] - np.outer(value, value[:-1])
                own = covariance[here, here]
                lost = _DIGITS * np.diag(np.abs(slope) @ np.abs(own) @ np.abs(slope.T))  # to rounding: not known better
                sigma = np.sqrt(np.maximum(np.diag(slope @ own @ slope.T), lost))
                known = widths[here][np.isfinite(widths[here])]
                half = known.max(initial=1.96) * sigma  # the last share has no coordinate of its own
                lower, upper = np.clip(value - half, 0, 1), np.clip(value + half, 0, 1)
            else:
                half = widths[here] * np.sqrt(np.maximum(np.diag(covariance)[here], 0))
                least, most = b.bounds()
                lower, upper = (b.decode(np.clip(x[here] + d, least, most)) for d in (-half, half))
                is_open = ~np.isfinite(half) | (half > _OPEN if b.scale == "log" else False)
                whole = (0.0, np.inf) if b.scale == "above" else (b.parameter.lower, b.parameter.upper)
                lower, upper = (np.where(is_open, w, end) for w, end in zip(whole, (lower, upper), strict=True))
                if b.scale == "above":
                    lower, upper = lower + self._bound(b, values), upper + self._bound(b, values)
            out |= {n: (float(lo), float(hi)) for n, lo, hi in zip(b.labels, lower, upper, strict=True)}
        return out


def all_labels(plant: Plant) -> list[str]:
    """Names of everything that could move in a fit of `plant`."""
    return ["inertia", *(f"{e.name}.{p.name}" for e in plant.effects for p in e.parameters)]
