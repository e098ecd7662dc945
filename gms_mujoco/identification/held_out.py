"""Whether an effect helps where it says that it acts, on blocks of data that its fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from .frf_observation import Seen
from .intervals import block_starts, block_sums
from .inverse import Observation

Array = NDArray[np.float64]

_HARDLY = 0.01  # of all that an effect changes, in the blocks together in which it changes least
BLOCK = 0.5  # s; residuals further apart than this are taken as independent, whatever they look like
_CORRELATED = 0.1  # autocorrelation that counts as none
_APART = 3  # times the lag of that, over which sums are taken as independent
_FEWEST_ROWS = 4  # in a stretch
_ENOUGH = 8  # stretches of a record that say how loud it is by itself
_FEW = 0.05  # of the blocks, that may hold most of what is left and say nothing of what is missing elsewhere
_LEAST = 1e-12  # so far out the tail of a distribution says nothing


@dataclass(frozen=True)
class HeldOut:
    """What a plant leaves of the torque on blocks that its fit has not seen.

    Attributes:
        rows: (m,) residual of all observations, each block predicted without it, for a drive that delivers everything
            [N m].
        observations: that they belong to.
    """

    rows: Array
    observations: Sequence[Seen]

    @cached_property
    def squares(self) -> Array:
        """(blocks,) squared residual of each block of time [N^2 m^2]."""
        return np.asarray(block_sums(self.observations, self.rows**2, BLOCK))

    @cached_property
    def total(self) -> float:
        """Squared residual of all [N^2 m^2]."""
        return float(np.einsum("i,i", self.rows, self.rows))

    def moments(self, noise: float = 0.0) -> NDArray[np.intp]:
        """Numbers of the few blocks that hold most of what is left; none where that is spread, or of a simulated
        motion, which stays off where it once is.

        Args:
            noise: squared residual that is none of it [N^2 m^2].
        """
        few = np.argsort(-self.squares)[: int(_FEW * len(self.squares))]
        timed = all(isinstance(o, Observation) for o in self.observations)
        most = self.squares[few].sum() - _FEW * noise > (self.total - noise) / 2
        return few[: len(few) * (timed and most)]

    @property
    def by_record(self) -> list[float]:
        """Squared residual of each observation [N^2 m^2]."""
        ends = np.cumsum([len(o.index) for o in self.observations])[:-1]
        return [float(r @ r) for r in np.split(self.rows, ends)]


def block_of_row(observations: Sequence[Seen]) -> NDArray[np.intp]:
    """(m,) number of the block of time that each row belongs to."""
    starts = block_starts(observations, BLOCK)
    return np.repeat(np.arange(len(starts)), np.diff(starts, append=sum(len(o.index) for o in observations)))


def p_value(before: HeldOut, after: HeldOut) -> float:
    """Of the hypothesis that what is added between the two does not help where it acts.

    What the added effect changes in the prediction of a block follows from the other blocks alone. If it is real, that
    change says by which share the squared error of each stretch of time falls; if not, the error rises by chance as
    often as not. The fall is regressed on the one predicted, through zero, by a one-sided t-test with errors that may
    differ from stretch to stretch (HC3; MacKinnon and White, J. Econometrics 29, 1985) and the degrees of freedom of
    the stretches that count. So an effect that acts in one record or at reversals only is judged there. Stretches are
    as long as what is left stays correlated with the change, at most `BLOCK`. Never less than 1e-12.
    """
    change = before.rows - after.rows
    lengths = _lengths(after.observations, change * after.rows)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(int)
    b, a, d = (np.add.reduceat(r**2, starts) for r in (before.rows, after.rows, change))
    asked = np.add.reduceat(after.rows != 0, starts)  # of rows that nothing is asked of nothing is left
    moved = d > 1e-18 * (a + b)  # where the axis stands still nothing is said
    if np.count_nonzero(moved) < 3:
        return 1.0
    noise = asked * _loudness(after.observations, lengths, asked, a)
    b, a, d, noise = b[moved], a[moved], d[moved], noise[moved]
    predicted, fallen = d / (d + 2 * noise), (b - a) / (b + a)
    power = float(predicted @ predicted)
    slope = float(predicted @ fallen) / power
    left = (fallen - slope * predicted) / np.maximum(1 - predicted**2 / power, 1e-9)
    error = float(np.sqrt(np.sum((predicted * left) ** 2))) / power
    freedom = max(power**2 / float(np.sum(predicted**4)) - 1, 0.5)
    return max(float(scipy.stats.t.sf(slope / max(error, 1e-12), freedom)), _LEAST)


def scatter(before: HeldOut, after: HeldOut, floor: Array) -> float:
    """By how much what is added between the two acts more or less than it predicts, from one block to the next.

    In a block where the added effect changes the prediction by d and e is left, least squares sees it 1 + d e / d^2
    times as large as predicted. Pooled over blocks, each with its weight d^2, the root mean square of d e / d^2 is near
    0 for an effect that is real, also beside others that are not known. One that stands for something else is now too
    large and now too small, at about its own size, although on the whole it helps. Blocks in which it hardly acts tell
    what else is left there, and nothing of it.

    Args:
        floor: (m,) residual that sensor noise alone leaves, whose share of the scatter is taken off [N m].
    """
    change = before.rows - after.rows
    weight = block_sums(after.observations, change**2, BLOCK)
    total = float(weight.sum())
    if total <= 0:
        return 0.0

    order = np.argsort(weight)
    acts = order[np.cumsum(weight[order]) > _HARDLY * total]

    def square(rows: Array) -> float:
        common = block_sums(after.observations, change * rows, BLOCK)[acts]
        return float(np.sum(common**2 / weight[acts])) / total

    return float(np.sqrt(max(square(after.rows) - square(floor), 0.0)))


def _lengths(observations: Sequence[Seen], product: Array) -> NDArray[np.intp]:
    """(stretches,) rows of each, from how long the product of change and error stays correlated."""
    lag = correlated(product)
    out: list[int] = []
    for o in observations:
        most = o.rows_per_block(BLOCK)
        n = min(max(_APART * lag, _FEWEST_ROWS), most) if isinstance(o, Observation) else most
        count = max(len(o.index) // n, 1)
        out += [n] * (count - 1) + [len(o.index) - n * (count - 1)]
    return np.array(out)


def correlated(series: Array) -> int:
    """The first lag at which a series (m,) is hardly correlated with itself; m where it always is."""
    size = scipy.fft.next_fast_len(2 * len(series), real=True)
    power = np.abs(scipy.fft.rfft(series, size)) ** 2
    covariance = scipy.fft.irfft(power, size)[: len(series)]
    low = np.flatnonzero(covariance < _CORRELATED * covariance[0])
    return int(low[0]) if len(low) else len(series)


def _loudness(
    observations: Sequence[Seen], lengths: NDArray[np.intp], asked: NDArray[np.intp], squares: Array
) -> Array:
    """(stretches,) mean squared residual that is usual for the record of each: the median over its stretches."""
    mean, any_asked = squares / np.maximum(asked, 1), asked > 0
    owner = np.searchsorted(np.cumsum([len(o.index) for o in observations]), np.cumsum(lengths) - 1, side="right")
    out = np.full(len(mean), np.median(mean[any_asked]))
    for i in np.unique(owner):
        own = (owner == i) & any_asked
        if np.count_nonzero(own) >= _ENOUGH:
            out[own] = np.median(mean[own])
    return out
