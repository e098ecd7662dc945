"""Frequency responses: the value `FRF`, and its estimation from records, measured or simulated.

The drive holds its torque for a whole sample while the encoder reads at one instant. An axis on its mass line
answers a held torque with `hold_factor` times what it answers a continuous one (half a sample of delay, and a little
of magnitude); an estimate from torque to position is divided by it, so that it stands beside continuous formulas. The
factor is exact on the mass line and off it errs by less than 6 (f / sample rate)^4 of the mass line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, listing
from .record import UNITS, USES, Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# What a response leads from and to, with the units of a hinge joint.
INPUTS: Mapping[str, str] = {"torque": "N m", "current": "A", "voltage": "V", "reference": "1", "load": "N m"}
OUTPUTS: Mapping[str, str] = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2"}
METHODS = ("h1", "indirect")
_SINE = 0.3  # the input is one sine where every other line is below this part of the strongest
_LINE = 0.02  # a line is excited where its input is above this part of the strongest line


@dataclass(frozen=True)
class FRF:
    """One frequency response of an axis; a frozen value.

    Attributes:
        name: where it comes from, for messages and plots.
        frequency: (n,) [Hz], positive and rising.
        response: (n,) complex, output over input [`unit`], for continuous signals of the form exp(+i w t).
        input, output: of `INPUTS` and `OUTPUTS`.
        unit: of the response, such as "rad/(N m)".
        coherence: (n,) between 0 and 1, None where unknown.
        sigma: (n,) standard deviation of the response: E|error|^2 = sigma^2 [`unit`], None where unknown.
        sigma_noise: (n,) the part of `sigma` that comes from noise, the rest being nonlinear distortion [`unit`];
            None where the two were not told apart.
        excitation: (n,) amplitude of the input at each frequency [N m], None where unknown.
        amplitude: (n,) amplitude of the output at each frequency [rad], None where unknown.
        sine: whether each point was measured with a sine of its own, so that `amplitude` is that of the whole motion;
            False: many frequencies at once; None: unknown.
        use: "fit", "select" or "validate".
        notes: how it was read or estimated, one sentence each.

    Raises:
        DataError: lengths differ, a value is not finite, a frequency is not positive or does not rise.
    """

    name: str
    frequency: Array
    response: Complex
    input: str = "torque"
    output: str = "position"
    unit: str = ""
    coherence: Array | None = None
    sigma: Array | None = None
    sigma_noise: Array | None = None
    excitation: Array | None = None
    amplitude: Array | None = None
    sine: bool | None = None
    use: str = "fit"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for side, what, names in (("input", self.input, INPUTS), ("output", self.output, OUTPUTS)):
            if what not in names:
                raise DataError(f"{self.name}: {side} must be one of {listing(names)}; {what!r} given")
        if self.use not in USES:
            raise DataError(f"{self.name}: use must be one of {listing(USES)}; {self.use!r} given")
        object.__setattr__(self, "frequency", np.asarray(self.frequency, float))
        object.__setattr__(self, "response", np.asarray(self.response, complex))
        n = len(self.frequency)
        for key in ("response", "coherence", "sigma", "sigma_noise", "excitation", "amplitude"):
            value = getattr(self, key)
            if value is None:
                continue
            if key != "response":
                value = np.broadcast_to(np.asarray(value, float), (n,)) if np.ndim(value) == 0 else np.asarray(value)
                object.__setattr__(self, key, value)
            if value.shape != (n,):
                raise DataError(f"{self.name}: {key} has shape {value.shape}, frequency has {(n,)}")
            if not np.isfinite(value).all():
                at = int(np.flatnonzero(~np.isfinite(value))[0])
                raise DataError(f"{self.name}: {key} is not a finite number at {self.frequency[at]:g} Hz")
        if n < 1:
            raise DataError(f"{self.name}: no frequencies")
        if not (np.isfinite(self.frequency).all() and self.frequency[0] > 0 and np.all(np.diff(self.frequency) > 0)):
            raise DataError(f"{self.name}: frequencies must be positive and rise from one point to the next")
        if np.any(self.response == 0):
            raise DataError(f"{self.name}: the response is 0 at {self.frequency[self.response == 0][0]:g} Hz")
        if not self.unit:
            object.__setattr__(self, "unit", response_unit(self.input, self.output))
        if self.excitation is not None and self.amplitude is None:
            object.__setattr__(self, "amplitude", self.excitation * np.abs(self.response))
        if self.amplitude is not None and self.excitation is None:
            object.__setattr__(self, "excitation", self.amplitude / np.abs(self.response))

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def omega(self) -> Array:
        """(n,) angular frequency [rad/s]."""
        return 2 * math.pi * self.frequency

    def compliance(self) -> FRF:
        """The same response from torque to position; raises DataError where it starts from something else."""
        if self.input not in ("torque", "load"):
            raise DataError(f"{self.name}: a response from {self.input} to {self.output}; torque to position is needed")
        power = list(OUTPUTS).index(self.output)
        if power == 0:
            return self
        by = (1j * self.omega) ** power
        size = np.abs(by)
        scaled: dict[str, Any] = {k: None if (v := getattr(self, k)) is None else v / size for k in _OF_OUTPUT}
        kind = "hinge" if "rad" in self.unit else "slide"
        unit = response_unit(self.input, "position", kind)
        return replace(self, response=self.response / by, output="position", unit=unit, **scaled)

    def band(self, low: float = 0.0, high: float = math.inf) -> FRF:
        """The points from `low` to `high` [Hz]."""
        keep = (self.frequency >= low) & (self.frequency <= high)
        return self.where(keep)

    def where(self, keep: NDArray[np.bool_]) -> FRF:
        """The points where `keep` (n,) holds."""
        cut: dict[str, Any] = {k: None if (v := getattr(self, k)) is None else v[keep] for k in _OF_OUTPUT + _OF_POINT}
        return replace(self, frequency=self.frequency[keep], response=self.response[keep], **cut)


_OF_OUTPUT = ("sigma", "sigma_noise", "amplitude")
_OF_POINT = ("coherence", "excitation")


def to_csv(frfs: Sequence[FRF]) -> str:
    """Responses as a table with a row per point; they are numbered from 1, and comments give their names.

    Columns: response, frequency [Hz], magnitude [abs], phase [rad] and, where all have them, coherence, sigma,
    excitation and amplitude. Magnitudes are in the unit that the comment states.
    """
    optional = ("coherence", "sigma", "excitation", "amplitude")
    extra = [k for k in optional if all(getattr(f, k) is not None for f in frfs)]
    lines = []
    for i, f in enumerate(frfs, 1):
        what = " ".join(f"{f.name}: {f.output} over {f.input} [{f.unit}]; {'; '.join(f.notes)}".split())
        lines.append(f"# {i}: {what}")
    lines.append(",".join(["response", "frequency [Hz]", "magnitude [abs]", "phase [rad]", *extra]))
    for i, f in enumerate(frfs, 1):
        columns = [f.frequency, np.abs(f.response), np.angle(f.response), *(getattr(f, k) for k in extra)]
        lines += [",".join([str(i), *map(repr, row)]) for row in zip(*(c.tolist() for c in columns), strict=True)]
    return "\n".join(lines) + "\n"


def response_unit(input: str, output: str, kind: str = "hinge") -> str:
    """The unit of a response in SI, such as "rad/(N m)"; of a slide joint "m/(N)"."""
    unit = f"{OUTPUTS[output]}/({INPUTS[input]})" if INPUTS[input] != "1" else OUTPUTS[output]
    return unit if kind == "hinge" else unit.replace("N m", "N").replace("rad", "m")


def hold_factor(frequency: Array, sample_time: float) -> Complex:
    """(n,) response of an inertia to a torque held for each sample over that to a continuous one, at the samples.

    From J (q[k+1] - 2 q[k] + q[k-1]) / h^2 = (u[k-1] + u[k]) / 2, which is exact.
    """
    half = math.pi * np.asarray(frequency, float) * sample_time
    return np.exp(-1j * half) * np.cos(half) * (half / np.sin(half)) ** 2


def estimate_frf(
    records: Record | Sequence[Record],
    input: str = "torque",
    output: str = "position",
    *,
    method: str = "h1",
    reference: Array | Sequence[Array] | None = None,
    period: float | None = None,
    transient: int | None = None,
    segment: float | None = None,
    hold: bool = True,
    kind: str = "hinge",
    name: str | None = None,
) -> FRF:
    """Estimates a frequency response.

    Where the input repeats itself, whole periods are averaged, after the first ones are discarded; the points are the
    excited lines. Otherwise averaged windowed segments are used (Welch). Both are H = S_yr / S_ur with r = u ("h1")
    or r the reference of a closed loop ("indirect", without the bias that feedback of noise gives h1).
    One strong line with weak ones beside it is a sine that the loop or the drive distorts: it gives one point.
    Several records are realisations of one experiment (the same amplitude; other phases or noise): they are averaged,
    and with periods in each of them noise and nonlinear distortion are told apart (best linear approximation:
    Pintelon and Schoukens, System Identification, 2nd ed., chapters 3 and 4).

    Args:
        records: one, or several with equal sample time.
        input, output: signals of the records; output "velocity" is taken as it was recorded.
        method: "h1" or "indirect".
        reference: (n,) for each record, for "indirect".
        period: of the excitation [s], a whole number of samples; None: found from the input (`find_period`).
        transient: periods discarded at the start; None: one, or a quarter of the shortest record where that is more.
        segment: length of Welch segments [s] for excitation without period; None: an eighth of the shortest record.
        hold: the input is held from sample to sample by the drive; the response is corrected for it.
        kind: of the joint, "hinge" or "slide", for the unit of the result.
        name: of the result; default: that of the first record.

    Raises:
        DataError: an unknown method or signal, no reference, too few periods, or no excitation.
    """
    runs = [records] if isinstance(records, Record) else list(records)
    if not runs:
        raise DataError("no records; expected at least one to estimate a frequency response from")
    if method not in METHODS:
        raise DataError(f"method must be one of {listing(METHODS)}; {method!r} given")
    if method == "indirect" and reference is None:
        raise DataError("method indirect needs the reference of the loop, one array for each record")
    h = runs[0].sample_time
    for r in runs:
        if abs(r.sample_time - h) > 1e-6 * h:
            raise DataError(f"{r.name}: sample time {r.sample_time:g} s, but {runs[0].name} has {h:g} s")
    inputs = [_signal(r, input) for r in runs]
    outputs = [_signal(r, output) for r in runs]
    if reference is None:
        references = inputs
    else:
        given = [reference] if isinstance(records, Record) else list(reference)
        references = [np.asarray(x, float) for x in given]
        for r, x in zip(runs, references, strict=False):
            if x.shape != r.time.shape:
                raise DataError(f"{r.name}: the reference has shape {x.shape}, time has {r.time.shape}")
        if len(references) != len(runs):
            raise DataError(f"{len(references)} references for {len(runs)} records; one each is needed")
    if period is None and segment is None:
        found = {find_period(x) for x in references}
        samples = found.pop() if len(found) == 1 else None
    else:
        samples = None if period is None else round(period / h)
        if period is not None and (samples or 0) < 4:
            raise DataError(f"a period of {period:g} s is shorter than four samples of {h:g} s")
        if samples is not None and period is not None and abs(samples - period / h) > 1e-3:
            raise DataError(f"period {period:g} s is not a whole number of samples of {h:g} s")
    title = name or runs[0].name
    if samples is not None:
        if transient is None:
            transient = max(1, math.ceil(0.25 * min(map(len, inputs)) / samples - 0.01))
        found_ = _periodic(title, inputs, outputs, references, samples, transient, h)
        if output == "position" and (count := max(r.resolution or 0.0 for r in runs)):
            _add_quantisation(found_[2], count, samples)
    else:
        found_ = _welch(title, inputs, outputs, references, segment, h)
    frequency, response, values, note = found_
    notes: tuple[str, ...] = (note,)
    if hold and input == "torque":
        factor = hold_factor(frequency, h)
        response = response / factor
        for key in ("sigma", "sigma_noise"):
            if values.get(key) is not None:
                values[key] = values[key] / np.abs(factor)
        notes += ("corrected for a torque held from sample to sample",)
    alone = samples is not None and len(frequency) == 1
    unit = response_unit(input, output, kind)
    return FRF(title, frequency, response, input, output, unit, sine=alone, use=runs[0].use, notes=notes,
               **values)


def join_sines(frfs: Sequence[FRF], tolerance: float = 0.02) -> list[FRF]:
    """Responses of one point each, measured with the same amplitude of torque or of position, as one.

    Args:
        frfs: in any order; those of several points stay as they are.
        tolerance: within which amplitudes are the same, relative.
    """
    out = [f for f in frfs if not (f.sine and len(f) == 1)]
    left = [f for f in frfs if f.sine and len(f) == 1]
    while left:
        same: list[FRF] = []
        for key in ("excitation", "amplitude"):
            size = getattr(left[0], key)[0]
            alike = [f for f in left if abs(getattr(f, key)[0] / size - 1) < tolerance and f.use == left[0].use]
            alike = [f for f in alike if (f.input, f.output) == (left[0].input, left[0].output)]
            same = max(same, alike, key=len)
        by_frequency = {f.frequency[0]: f for f in reversed(same)}  # one that comes again waits for the next turn
        same = [by_frequency[k] for k in sorted(by_frequency)]
        left = [f for f in left if not any(f is s for s in same)]
        out.append(_joined(same))
    return out


def _joined(frfs: Sequence[FRF]) -> FRF:
    if len(frfs) == 1:
        return frfs[0]
    values: dict[str, Any] = {}
    for key in ("frequency", "response", *_OF_OUTPUT, *_OF_POINT):
        parts = [getattr(f, key) for f in frfs]
        values[key] = None if any(p is None for p in parts) else np.concatenate(parts)
    notes = (f"{len(frfs)} sines, {frfs[0].name} to {frfs[-1].name}", *frfs[0].notes)
    return replace(frfs[0], name=f"{frfs[0].name} and {len(frfs) - 1} more", notes=notes, **values)


def find_antiresonance(
    frf: FRF, low: float = 0.0, high: float = math.inf, draws: int = 400, seed: int = 0
) -> tuple[float, float, float]:
    """Where the magnitude has its deepest dip, with a 95 % interval.

    The numerator is followed by a complex quadratic in w^2 through the eight points about the least one, with weights
    from sigma. The interval comes from the scatter of the fit, sigma or the misfit whichever is larger, by redrawing
    the points; it is at least as wide as a tenth of the distance between points, which the shape of the curve may hide.

    Args:
        frf: with at least eight points from `low` to `high` [Hz].
        draws, seed: of the interval.

    Returns:
        Frequency, and the ends of its interval [Hz].

    Raises:
        DataError: too few points, or the magnitude has no dip inside the band.
    """
    part = frf.band(low, high) if np.any((frf.frequency >= low) & (frf.frequency <= high)) else None
    if part is None or len(part) < 8:
        raise DataError(f"{frf.name}: fewer than 8 points from {low:g} to {high:g} Hz")
    size = np.abs(part.response)
    at = int(size.argmin())
    if at in (0, len(part) - 1):
        raise DataError(f"{frf.name}: no antiresonance from {low:g} to {high:g} Hz; the magnitude has no dip there")
    first = min(max(at - 4, 0), len(part) - 8)
    near = slice(first, first + 8)
    f, g = part.frequency[near], part.response[near]
    x = (f / part.frequency[at]) ** 2 - 1
    weight = 1 / np.maximum(np.full(8, 0.02 * size[near].max()) if part.sigma is None else part.sigma[near], 1e-300)
    powers = np.vander(x, 3) * weight[:, None]
    inverse = np.linalg.pinv(powers)
    fine = np.linspace(x[0], x[-1], 2001)

    def dip(values: Complex) -> float:
        least = int(np.abs(np.polyval(inverse @ (values * weight), fine)).argmin())
        return float(part.frequency[at] * math.sqrt(1 + fine[least]))

    left = np.abs(g * weight - powers @ (inverse @ (g * weight)))
    scatter = math.sqrt(max(float(np.sum(left**2)) / 5, 0.0 if part.sigma is None else 1.0)) / weight
    rng = np.random.default_rng(seed)
    noise = (rng.standard_normal((draws, 8)) + 1j * rng.standard_normal((draws, 8))) / math.sqrt(2)
    center = dip(g)
    margin = 0.05 * float(part.frequency[at + 1] - part.frequency[at - 1]) / 2
    ends = np.percentile([dip(g + scatter * e) for e in noise], (2.5, 97.5))
    return center, float(min(ends[0], center) - margin), float(max(ends[1], center) + margin)


def find_period(x: Array) -> int | None:
    """Samples after which a signal (n,) repeats itself, None where it does not, or less than twice."""
    x = x - x.mean()
    n = len(x)
    if not x.any():
        return None
    spectrum = np.fft.rfft(x, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[: n // 2 + 1]
    energy = np.append(0.0, np.cumsum(x**2))
    lag = np.arange(n // 2 + 1)
    both = energy[n - lag] + energy[n] - energy[lag]
    likeness = 2 * product / np.maximum(both, 1e-300)
    away = np.flatnonzero(likeness < 0.8)
    if not len(away):
        return None
    later = likeness[away[0] :]
    best = later.max()
    if best < 0.995:
        return None
    peaks = np.flatnonzero(later > 1 - 2 * (1 - best) - 1e-9) + away[0]
    p = int(peaks[0])
    p, exact = _climb(likeness, p)
    # A period that is no whole number of samples, as of most sines: its multiples tell it ever better, and several
    # periods together come close to a whole number.
    many = 1
    while round(2 * many * exact) < len(likeness) - 1:
        many *= 2
        exact = _climb(likeness, round(many * exact))[1] / many
    most = max(int(n / 3 / exact), 1)
    off = np.array([abs(m * exact - round(m * exact)) for m in range(1, most + 1)])
    share = off / (exact * np.arange(1, most + 1))
    good = np.flatnonzero((off < 0.2 / many) | (share < 1e-5))
    m = int(good[0] if len(good) else share.argmin()) + 1
    return round(m * exact) if m * exact >= 4 else None


def _climb(y: Array, at: int) -> tuple[int, float]:
    """The local maximum near `at`: its index, and where the parabola through its neighbours has its own."""
    at = min(max(at, 1), len(y) - 1)
    while at + 1 < len(y) and y[at + 1] > y[at]:
        at += 1
    while at > 1 and y[at - 1] > y[at]:
        at -= 1
    if not 0 < at < len(y) - 1:
        return at, float(at)
    bend = y[at - 1] - 2 * y[at] + y[at + 1]
    return at, at + (0.5 * (y[at - 1] - y[at + 1]) / bend if bend < 0 else 0.0)


Found = tuple[Array, Complex, dict[str, Array], str]


def _signal(record: Record, key: str) -> Array:
    value = record.get(key)
    if value is None or key not in (INPUTS if key in INPUTS else OUTPUTS):
        names = [k for k in record.signals if k in UNITS]
        raise DataError(f"{record.name}: no signal {key!r} for a frequency response; it has {listing(names)}")
    return value


def period_spectra(x: Array, n: int, transient: int) -> Complex:
    """(periods, n // 2 + 1) complex amplitudes of each whole period of a signal, after the first ones."""
    count = len(x) // n
    kept = x[transient * n : count * n].reshape(-1, n)
    if len(kept) > 1:  # an axis without a spring creeps; a straight drift would leak over all lines
        middle = np.arange(len(kept)) - (len(kept) - 1) / 2
        kept = kept - (middle @ kept.mean(1)) / (middle @ middle) / n * (np.arange(n) - (n - 1) / 2)
    return np.asarray(np.fft.rfft(kept, axis=1) * (2 / n))


def _periodic(
    name: str, us: list[Array], ys: list[Array], rs: list[Array], n: int, transient: int, h: float
) -> Found:
    if min(map(len, us)) < (transient + 1) * n:
        raise DataError(f"{name}: {min(map(len, us))} samples; {transient + 1} periods of {n} are needed")
    U, Y, R = ([period_spectra(x, n, transient) for x in xs] for xs in (us, ys, rs))
    strength = np.sqrt(np.mean([np.mean(np.abs(r) ** 2, 0) for r in R], 0))
    strength[0] = 0
    lines = np.flatnonzero(strength > _LINE * strength.max()) if strength.max() > 0 else np.zeros(0, int)
    lines = lines[lines < n / 2]
    if len(lines) > 1 and np.sort(strength)[-2] < _SINE * strength.max():
        lines = lines[[int(np.argmax(strength[lines]))]]
    if not len(lines):
        raise DataError(f"{name}: the input does not vary; nothing is excited")
    U, Y, R = ([x[:, lines] for x in xs] for xs in (U, Y, R))
    um, ym, rm = ([x.mean(0) for x in xs] for xs in (U, Y, R))
    weight = sum(np.abs(r) ** 2 for r in rm)
    su = sum(u * r.conj() for u, r in zip(um, rm, strict=True))
    sy = sum(y * r.conj() for y, r in zip(ym, rm, strict=True))
    response = sy / su
    count = sum(len(u) for u in U)
    values: dict[str, Array] = {
        "excitation": np.sqrt(np.mean([np.abs(u) ** 2 for u in um], 0)),
        "amplitude": np.sqrt(np.mean([np.abs(y) ** 2 for y in ym], 0)),
    }
    if count > len(U):  # of a record with several periods the scatter about their mean is noise
        noise = sum(
            np.sum(np.abs((y - y.mean(0)) - response * (u - u.mean(0))) ** 2, 0) for u, y in zip(U, Y, strict=True)
        ) / (count - len(U))
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
    return lines / (n * h), response, values, note


def _add_quantisation(values: dict[str, Array], count: float, n: int) -> None:
    """Widens sigma: periods that repeat are rounded alike, which averaging does not see.

    The rounding of n different samples errs by count / sqrt(12) each; in a motion of less than two counts all err
    together.
    """
    rounding = np.where(values["amplitude"] < 2 * count, count, count / math.sqrt(3 * n))
    values["sigma"] = np.hypot(values.get("sigma", 0.0), rounding / values["excitation"])


def _welch(name: str, us: list[Array], ys: list[Array], rs: list[Array], segment: float | None, h: float) -> Found:
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
    return frequency, response, values, f"{len(U)} half-overlapped Hann segments of {n * h:g} s"
