"""The views of a residual: means over position, velocity, reversals ..., harmonics, spectrum and correlations.

No fit is made: everything comes from the residual and from the floor that noise leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ..identification.folds import folds
from ..identification.motion import REGIMES, Swings, break_away_distance
from ..responses.spectra import find_period
from .noise_band import CONFIDENCE, NoiseBand, Z, bartlett, group_means, products
from .residual_maps import Regime, ResidualMap, where

if TYPE_CHECKING:
    from ..compare import RecordComparison
    from ..plant import Plant

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_BINS = {"time": 60, "position": 60, "revolution": 72}  # per view; of the others:
_OTHER_BINS = 40
_FEWEST = 12  # samples of a bin
_STRETCHES = 24  # of a record, of which one half predicts the other
_HARMONICS = 64  # per revolution
_TIME_HARMONICS = 15
_LAST = 5  # break-away distances: beyond, friction after a reversal is that of sliding
_BANDS = 24  # of the spectrum
_CORRELATED = 40  # lags of the correlation functions


class Residuals:
    """The residuals of records under one plant, and their views."""

    def __init__(self, plant: Plant, records: Sequence[RecordComparison]) -> None:
        self.plant, self.records = plant, list(records)
        self.torque, self.angle = ("N m", "rad") if plant.kind == "hinge" else ("N", "m")
        self.unit = self.torque  # of the residual
        self._parts = [r.residual for r in self.records]
        self._square = float(sum(p @ p for p in self._parts)) or 1e-300

    @cached_property
    def _swings(self) -> list[Swings]:
        return [Swings.of(r.observation) for r in self.records]

    @cached_property
    def _drawn(self) -> list[Array]:
        return [r.floor - r.sampling for r in self.records]

    @cached_property
    def _noise(self) -> NoiseBand:
        return NoiseBand.of(self._drawn)

    @cached_property
    def _break_away(self) -> float:
        span = max(float(np.ptp(r.position)) for r in self.records)
        return break_away_distance(self.plant, span) if span else 0.0

    def views(self) -> tuple[ResidualMap, ...]:
        """Every view that these records allow; those of all records first."""
        out = [self._mean(name, label, unit, along) for name, label, unit, along in self._quantities()]
        out += [self._revolution_harmonics(), self._frequency(), self._autocorrelation(), self._input_correlation()]
        for k in range(len(self.records)):
            out += [self._time(k), self._time_harmonics(k)]
        return tuple(m for m in out if m is not None)

    def regimes(self) -> tuple[Regime, ...]:
        """Error in pre-sliding, after reversals and in sliding; a regime that the records do not enter is left out."""
        where = np.concatenate([s.regime(self._break_away) for s in self._swings])
        torque = float(np.sqrt(np.mean(np.concatenate([r.measured for r in self.records]) ** 2))) or 1e-300
        return self._by_regime(REGIMES, where, lambda x: float(np.sqrt(np.mean(x**2))) / torque)

    def _by_regime(self, names: Sequence[str], where: Index, size: Callable[[Array], float]) -> tuple[Regime, ...]:
        """Error and floor by `size` where each regime is, of those that the records enter."""
        residual, floor = np.concatenate(self._parts), np.concatenate([r.floor for r in self.records])
        out = []
        for k, name in enumerate(names):
            here = where == k
            if here.any():
                e, f = (size(x[here]) for x in (residual, floor))
                share = float(np.sum(residual[here] ** 2)) / self._square
                out.append(Regime(name, float(here.mean()), share, e, f))
        return tuple(out)

    def where(self, views: Sequence[ResidualMap], regimes: Sequence[Regime]) -> str:
        """Where the residual leaves its noise band most, in one or two lines."""
        n = sum(map(len, self._parts))
        offset = sum(float(p.sum()) for p in self._parts) / n
        floor = math.sqrt(sum(float(r.floor @ r.floor) for r in self.records)) or 1e-300
        return where(views, regimes, math.sqrt(self._square) / floor, offset, n * offset**2 / self._square, self.unit)

    def after_reversal(self) -> tuple[Array, Array, Array] | None:
        """Friction along the motion after a reversal, in swings that end in sliding: the hysteresis as one curve.

        Returns:
            (b,) distance since the reversal [rad], mean of the measured torque less that of the inertia, and of what
            the plant needs less the same, both along the motion [N m]; None where too few swings slide.
        """
        far = self._break_away
        inertia = self.plant.driven_inertia
        x, measured, needed = (np.concatenate(parts) for parts in zip(*(
            (s.distance, s.direction * (r.measured - inertial), s.direction * (r.needed - inertial))
            for r, s in zip(self.records, self._swings, strict=True)
            for inertial in [inertia * r.observation.acceleration]
        ), strict=True))  # fmt: skip
        length = np.concatenate([s.length for s in self._swings])
        keep = (length >= far) & (x > 0) & (x < _LAST * far)
        n = min(_OTHER_BINS, int(keep.sum()) // _FEWEST)
        if n < 4:
            return None
        edges = np.quantile(x[keep], np.linspace(0, 1, n + 1)[1:-1])
        # A joint that holds is at one distance for long: where several edges lie there, nothing lies between them.
        held, group = np.unique(np.searchsorted(edges, x[keep]), return_inverse=True)
        x, measured, needed = (group_means(group, v[keep], len(held)) for v in (x, measured, needed))
        return x, measured, needed

    # Means over a quantity.

    def _quantities(self) -> list[tuple[str, str, str, bool]]:
        angle = self.angle
        out = [("position", "position", angle, False)]
        if self._turns:
            out.append(("revolution", "position on the revolution", "rev", False))
        out += [
            ("velocity", "velocity", f"{angle}/s", False),
            ("acceleration", "acceleration", f"{angle}/s^2", False),
            ("torque", "torque" if self.torque == "N m" else "force", self.torque, False),
            ("torque_rate", "rate of torque" if self.torque == "N m" else "rate of force", f"{self.torque}/s", False),
            ("load", "load", self.torque, True),
            ("temperature", "temperature", "degC", True),
            ("since_reversal", "distance since the reversal", angle, True),
            ("time_since_reversal", "time since the reversal", "s", True),
        ]
        return out

    @cached_property
    def _turns(self) -> bool:
        """Whether the records go round: only then does a period per revolution show."""
        if self.plant.kind != "hinge" or not self.records:
            return False
        return max(float(np.ptp(r.position)) for r in self.records) > 2 * math.pi

    def _quantity(self, name: str, k: int) -> Array | None:
        r = self.records[k]
        o = r.observation
        if name == "position":
            return r.position
        if name == "revolution":
            return np.mod(r.position / (2 * math.pi), 1.0)
        if name == "velocity":
            return r.velocity
        if name == "acceleration":
            return o.acceleration
        if name == "torque":
            return r.measured
        if name == "torque_rate":
            return np.gradient(r.measured, r.time)
        if name == "since_reversal":
            return self._swings[k].distance
        if name == "time_since_reversal":
            return self._swings[k].time
        x = o.record.get(name)
        return None if x is None else x[o.index]

    def _mean(self, name: str, label: str, unit: str, along: bool) -> ResidualMap | None:
        """Means of the residual in bins of one quantity: equal ones of the revolution, else equally filled ones."""
        found = [self._quantity(name, k) for k in range(len(self.records))]
        if all(x is None for x in found):
            return None
        xs = [np.full(len(p), np.nan) if x is None else x for x, p in zip(found, self._parts, strict=True)]
        x = np.concatenate(xs)
        known = np.isfinite(x)
        most = min(_BINS.get(name, _OTHER_BINS), int(known.sum()) // (2 * _FEWEST))
        if most < 4 or not np.ptp(x[known]) > 0:
            return None
        inner = np.linspace(0, 1, most + 1)[1:-1]
        edges = inner if name == "revolution" else np.unique(np.quantile(x[known], inner))
        groups = [np.where(np.isfinite(v), np.searchsorted(edges, v), -1) for v in xs]
        signs = [s.direction if along else np.ones(len(p)) for s, p in zip(self._swings, self._parts, strict=True)]
        values, sampled = ([p * s if along else p for p, s in zip(parts, signs, strict=True)]
                          for parts in (self._parts, [r.sampling for r in self.records]))
        mean, band, count = self._noise.means(groups, values, self._drawn, len(edges) + 1)
        expected = group_means(np.concatenate(groups), np.concatenate(sampled), len(edges) + 1)
        centres = group_means(np.concatenate(groups), x, len(edges) + 1)
        shown = count >= _FEWEST
        if shown.sum() < 4:
            return None
        shown &= np.isfinite(centres)
        at = int(np.argmax(np.where(shown, np.abs(mean - expected) - band, -np.inf)))
        return ResidualMap(
            name, label, unit, self.unit, centres[shown], mean[shown], expected[shown], band[shown],
            count[shown], _predicted(groups, values, len(edges) + 1), f"largest at {centres[at]:.3g} {unit}",
            along=along,
        )  # fmt: skip

    def _time(self, k: int) -> ResidualMap | None:
        r = self.records[k]
        n = min(_BINS["time"], len(r.time) // _FEWEST)
        if n < 4:
            return None
        group = (np.arange(len(r.time)) * n) // len(r.time)
        mean, band, count = self._noise.means([group], [r.residual], [self._drawn[k]], n)
        expected = group_means(group, r.sampling, n)
        return ResidualMap(
            "time", "time", "s", self.unit, group_means(group, r.time, n), mean,
            expected, band, count, record=r.name,
        )  # fmt: skip

    # Harmonics.

    def _revolution_harmonics(self) -> ResidualMap | None:
        if not self._turns:
            return None
        amplitude, band, share = self._harmonics(
            [r.position for r in self.records], range(len(self.records)), np.arange(1, _HARMONICS + 1)
        )
        at = int(np.argmax(share))
        return ResidualMap(
            "revolution_harmonic", "harmonic", "1/rev", self.unit, np.arange(1.0, _HARMONICS + 1), amplitude,
            np.zeros(_HARMONICS), band, np.full(_HARMONICS, sum(map(len, self._parts))), float(share[at]),
            f"{at + 1} per revolution",
        )  # fmt: skip

    def _time_harmonics(self, k: int) -> ResidualMap | None:
        """Of a periodic excitation. Odd ones speak of what is alike in both directions, even ones of what is not."""
        r = self.records[k]
        o = r.observation
        period = find_period(self._excitation(k))
        if period is None:
            return None
        base = 1 / (period * o.sample_time)
        orders = np.arange(1, min(_TIME_HARMONICS, int(o.bandwidth / base)) + 1)
        if len(orders) < 2:
            return None
        amplitude, band, share = self._harmonics([2 * math.pi * base * r.time], [k], orders)
        odd, even = float(share[::2].sum()), float(share[1::2].sum())
        return ResidualMap(
            "time_harmonic", f"harmonic of {base:.4g} Hz", "1", self.unit, orders.astype(float), amplitude,
            np.zeros(len(orders)), band, np.full(len(orders), len(r.time)), float(share.max()),
            f"odd harmonics {100 * odd:.0f} %, even {100 * even:.0f} %", r.name,
        )  # fmt: skip

    def _excitation(self, k: int) -> Array:
        """(n,) what drives a record, sample by sample."""
        return self.records[k].observation.commands

    def _harmonics(self, phases: list[Array], which: Sequence[int], orders: Index) -> tuple[Array, Array, Array]:
        """Amplitude of each harmonic by itself, its band under noise, and its share of the squared residual."""
        values, sampled = [self._parts[k] for k in which], [self.records[k].sampling for k in which]
        amplitude, band, share = np.zeros(len(orders)), np.zeros(len(orders)), np.zeros(len(orders))
        weights = _evenly(phases)
        values, sampled = (
            [x - sum(float(w @ v) for w, v in zip(weights, xs, strict=True)) / sum(map(np.sum, weights)) for x in xs]
            for xs in (values, sampled)
        )
        total = max(float(sum(w @ v**2 for w, v in zip(weights, values, strict=True))), 1e-300)
        for i, order in enumerate(orders):
            waves = [np.stack([np.cos(order * p), np.sin(order * p)], 1) for p in phases]
            even = [w * g[:, None] for w, g in zip(waves, weights, strict=True)]
            inverse = np.linalg.pinv(sum(w.T @ e for w, e in zip(waves, even, strict=True)), rcond=1e-6)
            right, known = (sum(e.T @ x for e, x in zip(even, xs, strict=True)) for xs in (values, sampled))
            noise = inverse @ sum(self._noise.covariance(e) for e in even) @ inverse
            # The square of a circular normal pair is exponential: P(a^2 > x) = exp(-x / E a^2).
            band[i] = math.sqrt(max(-math.log(1 - CONFIDENCE) * float(np.trace(noise)), 0.0))
            band[i] += float(np.hypot(*(inverse @ known)))
            amplitude[i], share[i] = float(np.hypot(*(inverse @ right))), float(right @ inverse @ right) / total
        return amplitude, band, share

    # Spectrum and correlation.

    def _frequency(self) -> ResidualMap | None:
        r0 = self.records[0].observation
        low = max(4 / float(np.ptp(r.time)) for r in self.records)
        edges = np.geomspace(low, r0.bandwidth, _BANDS + 1)
        total = np.zeros((3, _BANDS))
        for r in self.records:
            rate = 1 / (r.observation.step)
            f, left = scipy.signal.periodogram(r.residual, rate, "hann")
            noise = scipy.signal.periodogram(r.floor, rate, "hann")[1]
            group = np.where((f >= low) & (f <= r0.bandwidth), np.searchsorted(edges, f, "right") - 1, -1)
            group = np.minimum(group, _BANDS - 1)
            inside = group >= 0
            for row, x in zip(total, (np.ones_like(f), left, noise), strict=True):
                row += np.bincount(group[inside], x[inside], _BANDS)
        shown = total[0] > 0
        if shown.sum() < 4:
            return None
        count, left, noise = total[:, shown]
        freedom = np.maximum(2 * count / 1.5, 1.0)  # a Hann window shares power among neighbours
        expected = np.sqrt(noise / count)
        mean = np.sqrt(left / count)
        band = expected * (np.sqrt(scipy.stats.f.ppf(CONFIDENCE, freedom, freedom)) - 1)
        centres = np.sqrt(edges[1:] * edges[:-1])[shown]
        at = int(np.argmax(left))
        return ResidualMap(
            "frequency", "frequency", "Hz", f"{self.unit}/sqrt(Hz)", centres, mean, expected, band, count,
            float(left[at] / max(left.sum(), 1e-300)), f"near {centres[at]:.3g} Hz",
        )  # fmt: skip

    def _alike(self) -> list[RecordComparison]:
        """Records with the time step of the first."""
        step = [r.observation.step for r in self.records]
        return [r for r, s in zip(self.records, step, strict=True) if abs(s / step[0] - 1) < 1e-3]

    def _correlation(self, name: str, other: Callable[[RecordComparison], Array], first: int) -> ResidualMap | None:
        """Correlation of the residual with something that many samples before, and what noise makes of it."""
        records = self._alike()
        n = min(len(r.time) for r in records)
        last = min(_CORRELATED, n // 4)
        if last < 4:
            return None
        lags = np.arange(max(first, -last), last + 1)
        got, known = np.zeros(len(lags)), np.zeros(len(lags))
        squares = np.zeros(3)
        for r in records:
            y, x, e = (v - v.mean() for v in (r.residual, other(r), r.floor))
            got += products(y, x, lags)
            known += products(e, e, lags) if name == "autocorrelation" else products(r.sampling, x, lags)
            squares += [y @ y, x @ x, e @ e]
        total = sum(len(r.time) for r in records)
        value = got / max(math.sqrt(squares[0] * squares[1]), 1e-300)
        rho = self._noise.rho
        if name == "autocorrelation":
            expected = known / max(float(squares[2]), 1e-300)
            # Bartlett (1946); twice, since the floor's own is drawn as well.
            variance = 2 * bartlett(rho, lags) / total
        else:
            # The torque that was measured carries the noise that the residual carries.
            expected = known / max(math.sqrt(squares[0] * squares[1]), 1e-300)
            alike = math.sqrt(squares[2] / max(squares[1], 1e-300)) * np.interp(np.abs(lags), np.arange(len(rho)), rho)
            inputs = [other(r) - other(r).mean() for r in records]
            of_input = np.sum([products(v, v, np.arange(len(rho))) for v in inputs], axis=0)
            spread = rho @ np.where(np.arange(len(rho)) > 0, 2.0, 1.0) * (of_input / max(of_input[0], 1e-300))
            variance = max(float(np.sum(spread)), 1.0) / total + (alike / Z) ** 2
        step = records[0].observation.step
        push = "torque" if self.torque == "N m" else "force"
        label = "lag" if name == "autocorrelation" else f"lag behind the {push}"
        return ResidualMap(
            name, label, "s", "1", np.asarray(step * lags, float), value, expected, Z * np.sqrt(variance),
            np.full(len(lags), float(total)),
        )  # fmt: skip

    def _autocorrelation(self) -> ResidualMap | None:
        return self._correlation("autocorrelation", lambda r: r.residual, 1)

    def _input_correlation(self) -> ResidualMap | None:
        return self._correlation("input_correlation", lambda r: r.measured, -10)


def _evenly(phases: Sequence[Array], sectors: int = 72) -> list[Array]:
    """Weights with which every sector of the circle counts the same; where a joint dwells, all harmonics look alike."""
    group = [np.floor(np.mod(p / (2 * math.pi), 1.0) * sectors).astype(int) % sectors for p in phases]
    count = np.bincount(np.concatenate(group), minlength=sectors)
    weight = 1 / np.maximum(count, 0.2 * count.mean())
    return [weight[g] / weight.mean() for g in group]


def _predicted(groups: Sequence[Index], values: Sequence[Array], n: int) -> float:
    """Share of the square about the mean that bins of half of the stretches predict of the rest, and they of these."""
    group = np.concatenate(groups)
    inside = group >= 0
    halves = folds(_STRETCHES * len(groups), 2).reshape(len(groups), _STRETCHES)
    of_row = [half[np.arange(len(g)) * _STRETCHES // max(len(g), 1)] for half, g in zip(halves, groups, strict=True)]
    fold = np.concatenate(of_row)[inside]
    group, value = group[inside], np.concatenate(values)[inside]
    value = value - value.mean()
    left = 0.0
    for k in (0, 1):
        learn = fold == k
        mean = np.nan_to_num(group_means(group[learn], value[learn], n))
        left += float(np.sum((value[~learn] - mean[group[~learn]]) ** 2))
    return max(1 - left / max(float(value @ value), 1e-300), 0.0)
