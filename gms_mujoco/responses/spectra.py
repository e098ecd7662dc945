"""Spectra of records: whole periods of a signal, or windowed segments, and the response between two of them."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import DataError
from .free_motion import FreeMotion, find_free_motion

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Found = tuple[Array, Complex, dict[str, Array], str]
"""Frequencies [Hz], responses, what else is known of each (sigma, coherence ...), and a sentence on how."""

NO_PERIOD = "no period was found in the input"
_REPEATS = 0.005  # of its energy, but for which a signal repeats itself
_MOST_NOISE = 0.1  # of the energy of a signal whose period is looked for
_SINE = 0.3  # the input is one sine where every other line is below this part of the strongest
_ALIKE = 0.9  # times how well a signal repeats with its best period: a period that is another
_HARDLY = 0.05  # correlation of a signal that does not repeat at all
_LINE = 0.02  # a line is excited where its input is above this part of the strongest line, and no noise
_NEAR = 31  # lines about one that tell its noise
_CHANCE = 0.01  # that any line of noise alone is taken for an excited one


def find_period(x: Array) -> int | None:
    """Samples after which a signal (n,) repeats itself, None where it does not, or less than twice."""
    likeness = _likeness(x)
    return None if likeness is None else _period(likeness, len(x), _REPEATS)


def find_noisy_period(x: Array) -> int | None:
    """The same of a signal that may have white noise of up to a tenth of its energy: then it repeats but for that."""
    likeness = _likeness(x)
    if likeness is None:
        return None
    if clean := _period(likeness, len(x), _REPEATS):
        return clean
    share = _white_share(x)
    if not 0 < share < _MOST_NOISE:
        return None
    allowed = share + 4 * math.sqrt(share / len(x))
    return _period(likeness, len(x), _REPEATS + allowed, allowed)


def _white_share(x: Array) -> float:
    """Of the energy of a signal (n,): what every frequency has, as the median of the spectrum tells it."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x))))[1:] ** 2
    return float(np.median(power) / math.log(2) / max(power.mean(), 1e-300)) if len(power) else 0.0


def _period(likeness: Array, n: int, worst: float, jagged: float = 0.0) -> int | None:
    """The first period with which a signal of n samples repeats but for `worst` of its energy.

    Args:
        likeness: of the signal, see `_likeness`.
        n: samples of it.
        worst: share of its energy.
        jagged: how far a maximum of `likeness` must fall off to be told from noise.
    """
    away = np.flatnonzero(likeness < 0.8)
    if not len(away):
        return None
    later = likeness[away[0] :]
    best = later.max()
    if best < 1 - worst:
        return None
    peaks = np.flatnonzero(later > 1 - 2 * (1 - best) - 1e-9) + away[0]
    p = int(peaks[0])
    p, exact = _climb(likeness, p, jagged)
    # A period that is no whole number of samples, as of most sines: its multiples tell it ever better, and several
    # periods together come close to a whole number.
    many = 1
    while round(2 * many * exact) < len(likeness) - 1:
        many *= 2
        exact = _climb(likeness, round(many * exact), jagged)[1] / many
    most = max(int(n / 3 / exact), 1)
    off = np.array([abs(m * exact - round(m * exact)) for m in range(1, most + 1)])
    share = off / (exact * np.arange(1, most + 1))
    good = np.flatnonzero((off < 0.2 / many) | (share < 1e-5))
    m = int(good[0] if len(good) else share.argmin()) + 1
    return round(m * exact) if m * exact >= 4 else None


def repeats(x: Array, period: int) -> bool:
    """Whether a signal (n,) repeats with a period [samples] about as well as with any; true of less than two periods.

    Noise makes every period worse, the right one too.
    """
    if len(x) < 2 * period or (likeness := _likeness(x)) is None:
        return True
    away = np.flatnonzero(likeness < 0.8)
    best = float(likeness[away[0] :].max()) if len(away) else 1.0
    return bool(likeness[period] > max(_ALIKE * best - 4 / math.sqrt(len(x)), _HARDLY))


def _likeness(x: Array) -> Array | None:
    """(n // 2 + 1,) correlation of a signal (n,) with itself, by the lag; None where it does not vary."""
    x = x - x.mean()
    n = len(x)
    if not x.any():
        return None
    spectrum = np.fft.rfft(x, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[: n // 2 + 1]
    energy = np.append(0.0, np.cumsum(x**2))
    lag = np.arange(n // 2 + 1)
    both = energy[n - lag] + energy[n] - energy[lag]
    return np.asarray(2 * product / np.maximum(both, 1e-300))


def _climb(y: Array, at: int, jagged: float = 0.0) -> tuple[int, float]:
    """The local maximum near `at`: its index, and where the parabola through its neighbours has its own.

    Where the curve is `jagged`, that of the hill about it, down to where it is lower by a few times as much.
    """
    at = min(max(at, 1), len(y) - 1)
    if jagged:
        return _hilltop(y, at, 4 * jagged)
    while at + 1 < len(y) and y[at + 1] > y[at]:
        at += 1
    while at > 1 and y[at - 1] > y[at]:
        at -= 1
    if not 0 < at < len(y) - 1:
        return at, float(at)
    bend = y[at - 1] - 2 * y[at] + y[at + 1]
    return at, at + (0.5 * (y[at - 1] - y[at + 1]) / bend if bend < 0 else 0.0)


def _hilltop(y: Array, at: int, low: float) -> tuple[int, float]:
    """The maximum of the parabola through a hill, down to `low` below its highest point."""
    left = right = top = at
    while True:  # where a way up is found the hill begins anew
        while left > 1 and y[left] > y[top] - low:
            left -= 1
        while right < len(y) - 1 and y[right] > y[top] - low:
            right += 1
        higher = left + int(y[left : right + 1].argmax())
        if higher == top:
            break
        left = right = top = higher
    index = np.arange(left, right + 1)
    if len(index) < 3:
        return top, float(top)
    bend, slope, _ = np.polyfit(index - top, y[index], 2)
    exact = top - slope / (2 * bend) if bend < 0 else float(top)
    exact = float(np.clip(exact, left, right))
    return round(exact), exact


def period_spectra(x: Array, n: int, transient: int) -> Complex:
    """(periods, n // 2 + 1) complex amplitudes of each whole period of a signal, after the first ones."""
    count = len(x) // n
    kept = x[transient * n : count * n].reshape(-1, n)
    return np.asarray(np.fft.rfft(kept - _drift(kept) * (np.arange(n) - (n - 1) / 2), axis=1) * (2 / n))


def _drift(periods: Array) -> float:
    """Per sample, of periods (p, n): an axis without a spring creeps; a straight drift would leak over all lines."""
    p, n = periods.shape
    middle = np.arange(p) - (p - 1) / 2
    return float(middle @ periods.mean(1) / (middle @ middle) / n) if p > 1 else 0.0


def periodic(
    name: str, us: list[Array], ys: list[Array], rs: list[Array], n: int, transient: int, h: float
) -> Found:
    if min(map(len, us)) < (transient + 1) * n:
        raise DataError(f"{name}: {min(map(len, us))} samples; {transient + 1} periods of {n} are needed")
    U, Y, R = ([period_spectra(x, n, transient) for x in xs] for xs in (us, ys, rs))
    strength = np.sqrt(np.mean([np.mean(np.abs(r) ** 2, 0) for r in R], 0))
    strength[0] = 0
    excited = (strength > _LINE * strength.max()) & _stand_out(R)
    excited[int(np.argmax(strength))] = strength.max() > 0
    lines = np.flatnonzero(excited)
    lines = lines[lines < n / 2]
    if len(lines) > 1 and np.sort(strength)[-2] < _SINE * strength.max():
        lines = lines[[int(np.argmax(strength[lines]))]]
    if not len(lines):
        raise DataError(f"{name}: the input does not vary; nothing is excited")
    U, Y, R = ([x[:, lines] for x in xs] for xs in (U, Y, R))
    um, ym, rm = ([x.mean(0) for x in xs] for xs in (U, Y, R))
    free = _free_motions(us, ys, n, transient, int(lines[0])) if len(lines) == 1 else []
    for y, f in zip(ym, free, strict=False):
        y -= f.at_sine
    weight = sum(np.abs(r) ** 2 for r in rm)
    su = sum(u * r.conj() for u, r in zip(um, rm, strict=True))
    sy = sum(y * r.conj() for y, r in zip(ym, rm, strict=True))
    response = sy / su
    count = sum(len(u) for u in U)
    values: dict[str, Array] = {
        "excitation": np.sqrt(np.mean([np.abs(u) ** 2 for u in um], 0)),
        "amplitude": np.sqrt(np.mean([np.abs(y) ** 2 for y in ym], 0)),
    }
    if free:
        noise = np.array([np.mean([f.noise * len(u) for f, u in zip(free, U, strict=True)])])
    elif count > len(U):  # of a record with several periods the scatter about their mean is noise
        noise = sum(
            np.sum(np.abs((y - y.mean(0)) - response * (u - u.mean(0))) ** 2, 0) for u, y in zip(U, Y, strict=True)
        ) / (count - len(U))
    else:
        noise = None
    if noise is not None:
        values["sigma"] = np.sqrt(noise / count * weight * len(U)) / np.abs(su)
        total = sum(np.sum(np.abs(y) ** 2, 0) for y in Y)
        values["coherence"] = np.clip(1 - noise * count / np.maximum(total, 1e-300), 0, 1)
    if len(U) > 1:  # realisations scatter by noise and by distortion
        gap = sum(np.abs((y - response * u) * r.conj()) ** 2 for u, y, r in zip(um, ym, rm, strict=True))
        spread = np.sqrt(gap * len(U) / (len(U) - 1)) / np.abs(su)
        if "sigma" in values:
            values["sigma_noise"] = values["sigma"]
            spread = np.maximum(spread, values["sigma"])
        values["sigma"] = spread
    note = f"mean of {count} periods of {n * h:g} s ({len(U)} records, the first {transient} periods of each discarded)"
    if any(f.at_sine for f in free):
        note += ", free motion taken off"
    return lines / (n * h), response, values, note


def _stand_out(periods: list[Complex]) -> NDArray[np.bool_]:
    """Which lines of a signal are more than noise, of which periods (p, lines) of each record tell: it differs from one
    to the next. All where no record has two.

    The noise is the usual one of the lines about each, so that few periods tell it too.
    """
    count = sum(len(x) for x in periods)
    if count == len(periods):
        return np.ones(periods[0].shape[1], bool)
    mean = sum(len(x) * np.abs(x.mean(0)) ** 2 for x in periods) / len(periods)
    free = count - len(periods)
    scatter = sum(np.sum(np.abs(x - x.mean(0)) ** 2, 0) for x in periods) / free
    near = min(_NEAR, len(scatter))
    noise = scipy.ndimage.median_filter(scatter, near, mode="nearest") / (scipy.special.gammaincinv(free, 0.5) / free)
    known = near * free / 2  # numbers that the noise is told by: of a median about half count
    return np.asarray(mean > noise * known * ((len(noise) / _CHANCE) ** (1 / known) - 1))  # F, of 2 and 2 known


def _free_motions(us: list[Array], ys: list[Array], n: int, transient: int, line: int) -> list[FreeMotion]:
    """Of each record; empty where its lines are too few."""
    found = []
    for u, y in zip(us, ys, strict=True):
        count = len(u) // n
        kept = [x[transient * n : count * n] for x in (u, y)]
        flat = [x - _drift(x.reshape(-1, n)) * np.arange(len(x)) for x in kept]
        found.append(find_free_motion(flat[0], flat[1], count - transient, line))
    return [f for f in found if f is not None] if None not in found else []


def add_quantisation(values: dict[str, Array], count: float, n: int) -> None:
    """Widens sigma: periods that repeat are rounded alike, which averaging does not see.

    The rounding of n different samples errs by count / sqrt(12) each; in a motion of less than two counts all err
    together.
    """
    rounding = np.where(values["amplitude"] < 2 * count, count, count / math.sqrt(3 * n))
    values["sigma"] = np.hypot(values.get("sigma", 0.0), rounding / values["excitation"])


def welch(name: str, us: list[Array], ys: list[Array], rs: list[Array], segment: float | None, h: float) -> Found:
    n = min(map(len, us)) // 8 if segment is None else round(segment / h)
    if not 16 <= n <= min(map(len, us)):
        raise DataError(f"{name}: a segment of {n} samples; expected 16 to {min(map(len, us))}")
    window = np.hanning(n + 1)[:-1]
    starts = [np.arange(0, len(u) - n + 1, max(n // 2, 1)) for u in us]

    def spectra(xs: list[Array]) -> Complex:
        cut = [x[s : s + n] for x, at in zip(xs, starts, strict=True) for s in at]
        # A straight line through each segment: drift of an integrating axis would leak over all lines.
        k = np.arange(n) - (n - 1) / 2
        flat = [x - x.mean() - k * (k @ x) / (k @ k) for x in cut]
        return np.fft.rfft(np.array(flat) * window, axis=1)[:, 2 : (n + 1) // 2]

    U, Y, R = spectra(us), spectra(ys), spectra(rs)
    if not U.any():
        raise DataError(f"{name}: the input does not vary; nothing is excited")
    count = len(U) / (1 + 2 / 36) if len(U) > 1 else 1.0  # half-overlapped Hann segments are correlated by 1/6
    su, sy = np.mean(U * R.conj(), 0), np.mean(Y * R.conj(), 0)
    suu, syy, srr = (np.mean(np.abs(x) ** 2, 0) for x in (U, Y, R))
    keep = srr > 1e-8 * srr.max()
    su, sy, suu, syy, srr = (x[keep] for x in (su, sy, suu, syy, srr))
    response = sy / su
    values: dict[str, Array] = {
        "coherence": np.clip(np.abs(sy) ** 2 / (srr * syy), 0, 1),
        "excitation": 2 / window.sum() * np.sqrt(suu),
        "amplitude": 2 / window.sum() * np.sqrt(syy),
    }
    if count > 2:
        left = np.mean(np.abs(Y[:, keep] - response * U[:, keep]) ** 2, 0) * len(U) / (len(U) - 1)
        values["sigma"] = np.sqrt(left * srr / count) / np.abs(su)
    frequency = (np.flatnonzero(keep) + 2) / (n * h)
    why = f"{NO_PERIOD}: " if segment is None else ""
    return frequency, response, values, f"{why}{len(U)} half-overlapped Hann segments of {n * h:g} s"
