"""Frequency responses: the value `FRF`, and its estimation from records, measured or simulated.

The drive holds its torque for a whole sample while the encoder reads at one instant. An axis on its mass line
answers a held torque with `hold_factor` times what it answers a continuous one (half a sample of delay, and a little
of magnitude); an estimate from torque is divided by it, so that it stands beside continuous formulas. The factor is
exact on the mass line; off it the position errs by less than 6 (f / sample rate)^4 of the mass line, a velocity by
3.3 (f / sample rate)^2. A torque that a sensor read at the samples, as the encoder does, is not held.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, listing
from .record import UNITS, USES, Record
from .responses.spectra import add_quantisation, find_noisy_period, periodic, repeats, welch

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# What a response leads from and to, with the units of a hinge joint.
INPUTS: Mapping[str, str] = {"torque": "N m", "current": "A", "voltage": "V", "reference": "1", "load": "N m"}
OUTPUTS: Mapping[str, str] = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2"}
METHODS = ("h1", "indirect")
KINDS = ("hinge", "slide")
_RANGES = {
    "excitation": (1e-300, math.inf, "positive"), "amplitude": (1e-300, math.inf, "positive"),
    "sigma": (0.0, math.inf, "0 or more"), "sigma_noise": (0.0, math.inf, "0 or more"),
    "coherence": (0.0, 1 + 1e-9, "from 0 to 1"),
}  # fmt: skip
_HOLD_ERROR = {"position": (6.0, 4), "velocity": (3.3, 2)}  # times (f / sample rate)^..: left of a hold off the mass


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
        DataError: lengths differ, a value is not finite or cannot be, a frequency is not positive or does not rise, or
            the unit is not in SI.
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
        for key in ("frequency", "response", *_OF_OUTPUT, *_OF_POINT):
            given = getattr(self, key)
            if given is not None or key in ("frequency", "response"):
                try:
                    value = _complex(given) if key == "response" else _real(given)
                except (TypeError, ValueError):
                    raise DataError(f"{self.name}: {key} must be numbers; {given!r} given") from None
                object.__setattr__(self, key, value)
        if self.frequency.ndim != 1:
            raise DataError(f"{self.name}: frequency must be a row of numbers; {self.frequency.ndim} dimensions given")
        n = len(self.frequency)
        for key in ("response", "coherence", "sigma", "sigma_noise", "excitation", "amplitude"):
            value = getattr(self, key)
            if value is None:
                continue
            if key != "response" and np.ndim(value) == 0:
                value = np.broadcast_to(value, (n,))
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
        for key, (least, most, words) in _RANGES.items():
            value = getattr(self, key)
            if value is not None and len(wrong := value[(value < least) | (value > most)]):
                raise DataError(f"{self.name}: {key} must be {words}; {wrong[0]:g} given")
        units = [response_unit(self.input, self.output, kind) for kind in KINDS]
        alike = [u for u in units if letters(u) == letters(self.unit)] if self.unit else units
        if not alike:
            raise DataError(f"{self.name}: a response is given in SI, {units[0]} or of a slide joint {units[1]}; "
                            f"{self.unit!r} given")
        object.__setattr__(self, "unit", alike[0])
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

    @property
    def kind(self) -> str:
        """Of the joint, "hinge" or "slide", as the unit says."""
        return "hinge" if "rad" in self.unit else "slide"

    def of_kind(self, kind: str) -> FRF:
        """Itself; raises DataError where it is the response of the other kind of joint."""
        if self.kind != kind:
            raise DataError(f"{self.name}: a response in {self.unit}, of a {self.kind} joint, where a {kind} joint is "
                            "asked for")
        return self

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
        unit = response_unit(self.input, "position", self.kind)
        return replace(self, response=self.response / by, output="position", unit=unit, **scaled)

    def band(self, low: float = 0.0, high: float = math.inf) -> FRF:
        """The points from `low` to `high` [Hz]."""
        keep = (self.frequency >= low) & (self.frequency <= high)
        return self.where(keep)

    def where(self, keep: NDArray[np.bool_]) -> FRF:
        """The points where `keep` (n,) holds."""
        cut: dict[str, Any] = {k: None if (v := getattr(self, k)) is None else v[keep] for k in _OF_OUTPUT + _OF_POINT}
        return replace(self, frequency=self.frequency[keep], response=self.response[keep], **cut)


def _real(given: Any) -> Array:
    value = np.asarray(given)
    if np.iscomplexobj(value):
        raise TypeError
    return value.astype(float)


def _complex(given: Any) -> Complex:
    return np.asarray(given).astype(complex)


def letters(unit: str) -> str:
    """A unit without what may be written otherwise: blanks, parentheses and signs of a product."""
    return re.sub(r"[\s()·*]", "", unit)


_OF_OUTPUT = ("sigma", "sigma_noise", "amplitude")
_OF_POINT = ("coherence", "excitation")


def to_csv(frfs: Sequence[FRF]) -> str:
    """Responses as a table with a row per point; they are numbered from 1, and comments give their names.

    Columns: response, frequency [Hz], magnitude [abs], phase [rad] and, where one has them, coherence, sigma,
    excitation, amplitude and sine (1 or 0). Magnitudes are in the unit that the comment states. The header has the
    units of excitation and amplitude where all responses have the same. [[frf]] reads it back.
    """
    optional = ("coherence", "sigma", "excitation", "amplitude", "sine")
    extra = [k for k in optional if any(getattr(f, k) is not None for f in frfs)]
    lines = []
    for i, f in enumerate(frfs, 1):
        what = f"{f.output} over {f.input} [{f.unit}]"
        told = [note.removeprefix(what).strip() for note in f.notes]  # of a file they begin with it
        lines.append(" ".join(f"# {i}: {f.name}: {'; '.join([what, *told])}".split()))
    heads = ["response", "frequency [Hz]", "magnitude [abs]", "phase [rad]"]
    inputs = {drive_unit(f.input, f.kind) for f in frfs}
    outputs = {response_unit("reference", f.output, f.kind) for f in frfs}
    for key in extra:
        found = {"excitation": inputs, "amplitude": outputs}.get(key, ())
        heads.append(f"{key} [{listing(found)}]" if len(found) == 1 else key)
    lines.append(",".join(heads))
    for i, f in enumerate(frfs, 1):
        columns: list[list[Any]] = [x.tolist() for x in (f.frequency, np.abs(f.response), np.angle(f.response))]
        for value in (getattr(f, k) for k in extra):
            columns.append([""] * len(f) if value is None else np.broadcast_to(value + 0.0, len(f)).tolist())
        lines += [",".join([str(i), *map(str, row)]) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def drive_unit(input: str, kind: str = "hinge") -> str:
    """The unit of an input in SI, such as "N m"; of a slide joint "N"."""
    return INPUTS[input] if kind == "hinge" else INPUTS[input].replace("N m", "N")


def response_unit(input: str, output: str, kind: str = "hinge") -> str:
    """The unit of a response in SI, such as "rad/(N m)"; of a slide joint "m/N"."""
    over = OUTPUTS[output] if kind == "hinge" else OUTPUTS[output].replace("rad", "m")
    under = drive_unit(input, kind)
    return over if under == "1" else f"{over}/({under})" if " " in under else f"{over}/{under}"


def hold_factor(frequency: Array, sample_time: float, output: str = "position") -> Complex:
    """(n,) response of an inertia to a torque held for each sample over that to a continuous one, at the samples.

    From J (q[k+1] - 2 q[k] + q[k-1]) / h^2 = (u[k-1] + u[k]) / 2, or J (v[k+1] - v[k]) / h = u[k] of the velocity,
    which are exact.
    """
    half = math.pi * np.asarray(frequency, float) * sample_time
    each = half / np.sin(half)
    return np.exp(-1j * half) * each * (np.cos(half) * each if output == "position" else 1.0)


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
    hold: bool | None = None,
    kind: str = "hinge",
    name: str | None = None,
) -> FRF:
    """Estimates a frequency response.

    Where the input repeats itself, whole periods are averaged, after the first ones are discarded; the points are the
    excited lines, those that stand above the noise by which periods differ. Otherwise averaged windowed segments are
    used (Welch). Both are H = S_yr / S_ur with r = u ("h1") or r the reference of a closed loop ("indirect", without
    the bias that feedback of noise gives h1).
    One strong line with weak ones beside it is a sine that the loop or the drive distorts: it gives one point. What
    still moves freely beside it is taken off, and its noise is read from the lines between its harmonics (see
    `find_free_motion`), where three on each side can be told apart.
    Several records are realisations of one experiment (the same amplitude; other phases or noise): they are averaged,
    and with periods in each of them noise and nonlinear distortion are told apart (best linear approximation:
    Pintelon and Schoukens, System Identification, 2nd ed., chapters 3 and 4).

    Args:
        records: one, or several with equal sample time.
        input, output: signals of the records; output "velocity" is taken as it was recorded.
        method: "h1" or "indirect".
        reference: (n,) for each record, for "indirect"; None: the signal of that name.
        period: of the excitation [s], a whole number of samples; None: found from the input (`find_noisy_period`).
        transient: periods discarded at the start; None: one, or a quarter of the shortest record where that is more.
        segment: length of Welch segments [s] for excitation without period; None: an eighth of the shortest record.
        hold: the input is held from sample to sample by the drive; the response is corrected for it. None: unless the
            records say that it was read at the samples (`Record.sensed`).
        kind: of the joint, "hinge" or "slide", for the unit of the result.
        name: of the result; default: that of the first record.

    Raises:
        DataError: an unknown method or signal, no reference, too few periods, a period with which the input does not
            repeat, no excitation, or torques of which some are held and some were read.
    """
    runs = [records] if isinstance(records, Record) else list(records) if isinstance(records, Iterable) else [records]
    for r in runs:
        if not isinstance(r, Record):
            raise DataError(f"records are expected, as those of gms.load(...).records; {type(r).__name__} given")
    if not runs:
        raise DataError("no records; expected at least one to estimate a frequency response from")
    if kind not in KINDS:
        raise DataError(f"kind must be one of {listing(KINDS)}; {kind!r} given")
    if method not in METHODS:
        raise DataError(f"method must be one of {listing(METHODS)}; {method!r} given")
    if method == "indirect" and reference is None:
        logged = [r.get("reference") for r in runs]
        if any(x is None for x in logged):
            raise DataError(
                "method indirect needs the reference of the loop: a signal of each record (in dataset.toml columns = "
                "{ reference = ... }), or one array for each"
            )
        reference = logged[0] if isinstance(records, Record) else [x for x in logged if x is not None]
    if hold is None:
        read = [r for r in runs if r.sensed]
        if read and len(read) < len(runs):
            other = next(r for r in runs if not r.sensed)
            raise DataError(f"the torque of {read[0].name} was read at the samples, that of {other.name} is held "
                            "between them; estimate them apart, or say hold = True or False")
        hold = not read
    for word, number in (("period", period), ("segment", segment)):
        if number is not None and not 0 < number < math.inf:
            raise DataError(f"{word} must be a positive time [s]; {number!r} given")
    if transient is not None and not (transient >= 0 and transient == int(transient)):
        raise DataError(f"transient must be a number of whole periods, 0 or more; {transient!r} given")
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
        found = {find_noisy_period(x) for x in references}
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
        for r, x in zip(runs, references, strict=True):
            if period is not None and not repeats(x[int(transient) * samples :], samples):
                found_at = find_noisy_period(x)
                better = f", but with one of {found_at * h:g} s" if found_at else "; leave it out, or give another"
                raise DataError(f"{r.name}: the input does not repeat with a period of {period:g} s{better}")
        found_ = periodic(title, inputs, outputs, references, samples, transient, h)
        if output == "position" and (count := max(r.resolution or 0.0 for r in runs)):
            add_quantisation(found_[2], count, samples)
    else:
        found_ = welch(title, inputs, outputs, references, segment, h)
    frequency, response, values, note = found_
    notes: tuple[str, ...] = (note,)
    if hold and input == "torque":
        factor = hold_factor(frequency, h, output)
        response = response / factor
        for key in ("sigma", "sigma_noise"):
            if values.get(key) is not None:
                values[key] = values[key] / np.abs(factor)
        if "sigma" in values:  # the factor is exact on the mass line alone
            times, power = _HOLD_ERROR[output]
            values["sigma"] = np.hypot(values["sigma"], times * (frequency * h) ** power * np.abs(response))
        notes += ("corrected for a torque held from sample to sample",)
    alone = samples is not None and len(frequency) == 1
    unit = response_unit(input, output, kind)
    return FRF(title, frequency, response, input, output, unit, sine=alone, use=runs[0].use, notes=notes,
               **values)


def with_amplitude(frf: FRF) -> FRF:
    """The response from torque to position; raises DataError where it is none or its amplitude is not known."""
    f = frf.compliance()
    if f.amplitude is None:
        unit = drive_unit(f.input, f.kind)
        raise DataError(f"{f.name}: the amplitude of the excitation is not known; give it as amplitude = ... [{unit}], "
                        "of a current [A]")
    return f


def usable(frf: FRF) -> FRF:
    """The response from torque to position; raises DataError where it does not say how torque and motion belong."""
    f = frf.compliance()
    if f.sine is False:
        raise DataError(
            f"{f.name}: measured with many frequencies at once, where friction has no amplitude of its own for "
            "each; measure one sine at a time, or fit the records in time"
        )
    return with_amplitude(f)


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


def _signal(record: Record, key: str) -> Array:
    value = record.get(key)
    if value is None or key not in (INPUTS if key in INPUTS else OUTPUTS):
        names = [k for k in record.signals if k in UNITS]
        raise DataError(f"{record.name}: no signal {key!r} for a frequency response; it has {listing(names)}")
    return value
