"""From the columns of a file to an FRF: what is frequency, magnitude and phase, and repeats averaged.

What the file does not say and nothing declares is an error that tells how to declare it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, listing, several
from ..formats import LARGEST, Table, why_unusable
from ..frf import FRF, INPUTS, OUTPUTS, Complex, drive_unit, letters, response_unit
from . import frf_units
from .passivity import expect_passive
from .repeats import average_repeats, levels

Array = NDArray[np.float64]

COLUMNS = ("frequency", "magnitude", "phase", "real", "imag", "coherence", "excitation", "sigma")
_NAMES = {
    "frequency": r"f|freq|frequency|frequencies|w|omega|ω|hz|radps",
    "magnitude": r"mag|magnitude|gain|abs|amplitude ratio|\|[gh](\(.*\))?\||db",
    "phase": r"ph|phase|arg|angle|arg ?\(?[gh]\)?|∠[gh]?(\(.*\))?|deg",
    "real": r"re|real|real part",
    "imag": r"im|imag|imaginary|imag part|imaginary part",
    "coherence": r"coh|coherence|gamma2|γ²",
    "excitation": r"excitation|excitation amplitude|input amplitude",
    "sigma": r"sigma|std|standard deviation",
}
RESPONSE, SINE = "response", "sine"  # columns of several responses in one file: its number, and `FRF.sine` as 1 or 0
_SCATTERS = 0.3  # of the response: more than repeats differ
_OURS = re.compile(rf"# (\d+): .*?: ({'|'.join(OUTPUTS)}) over (\w+) \[(.*?)\](?:;.*)?$")  # a comment of `to_csv`
_FEW = 6  # quantities at most in a file that has a line for each


def from_table(table: Table, name: str, input: str, output: str, **more: Any) -> FRF:
    """The frequency response in a table, see `levels_from_table`; raises DataError where it has several levels."""
    found = levels_from_table(table, name, input, output, **more)
    if len(found) > 1:
        raise DataError(f"the table has {len(found)} levels of excitation; levels_from_table reads them all")
    return found[0]


def levels_from_table(
    table: Table,
    name: str,
    input: str,
    output: str,
    *,
    columns: Mapping[str, Any] | None = None,
    unit: Mapping[str, Any] | None = None,
    scale: float | None = None,
    amplitude: float | None = None,
    conjugate: bool = False,
    kind: str = "hinge",
    count: float | None = None,
    use: str = "fit",
) -> list[FRF]:
    """The frequency response in the raw columns of a file, or one for each level of excitation, from small to large.

    Points at the same frequency and excitation are repeats: their mean is robust against outliers (`robust_mean`).

    Args:
        table: of one row per frequency; a file without names and with few long lines has a line per quantity.
        name: of the result, for messages.
        input, output: what the response leads from and to.
        columns: names or numbers (from 0; of lines where there is a line per quantity) for `COLUMNS`.
        unit: of frequency, magnitude, phase, sigma and coherence, of input and output ("mNm", "deg"), and of
            `amplitude`. A sigma in dB is that of the magnitude.
        scale: multiplies the response; with it, or with a unit of input or output, that of the file does not count.
        amplitude: of the input during the measurement, in SI ([N m], of a current [A]) whatever unit the input has in
            the file, or in that of `unit`.
        conjugate: the file is for signals of the form exp(-i w t), in which a motion that lags has a positive phase.
        kind, count: joint kind and one encoder count [rad], for the units of input and output.
        use: of the result.

    Raises:
        DataError: a column is missing, ambiguous or holds what cannot be, or no axis answers a torque like that, and
            how to settle it.
    """
    for key, value, names in (("input", input, INPUTS), ("output", output, OUTPUTS)):
        if value not in names:
            raise DataError(f"{key} must be one of {listing(names)}; {value!r} given")
    chosen, declared = dict(columns or {}), dict(unit or {})
    for word, given, known in (("columns", chosen, COLUMNS), ("units", declared, frf_units.KEYS)):
        for key in given:
            if key not in known:
                raise DataError(f"unknown key {word}.{key}; expected {listing(known)}")
    sine = table.columns.get(SINE)
    per_line = _has_a_line_per_quantity(table)
    raw, notes = _raw(_turned(table) if per_line else table, chosen, per_line), []
    at_zero = raw["frequency"][0] == 0
    if at_zero.any() and len({len(v) for v, _ in raw.values()}) == 1:  # analysers write anything there
        raw = {k: (v[~at_zero], at) for k, (v, at) in raw.items()}
        table = table.rows(~at_zero)
        notes.append("the point at 0 Hz is left out")
    _check(table, raw, per_line)
    if not len(raw["frequency"][0]):
        raise DataError("no frequency above 0 Hz")
    found = {k: frf_units.of(k, raw, declared, table.units) for k in frf_units.UNITS if k in raw}
    frequency = raw["frequency"][0] * frf_units.UNITS["frequency"][found["frequency"]]
    if frequency.min() < 0:
        raise DataError(f"frequency is {frequency.min():g} Hz; expected positive numbers")
    sides = _Sides(input, output, kind, count)
    if scale is None and "output" not in declared:
        _expect_quantities(table, raw, input, output, response_unit(input, output, kind))
    factor, stated = _factor(raw, table.units, declared, sides, scale)
    response = factor * _response(raw, found)
    if conjugate:
        response = response.conj()
    extra = _beside(raw, table.units, declared, sides, found, np.abs(response), abs(factor))
    zero = np.flatnonzero(response == 0)
    if len(zero):
        raise DataError(f"the response is 0 at {frequency[zero[0]]:g} Hz; no measurement gives that")
    if found.get("phase") == "deg" and np.abs(raw["phase"][0]).max() <= math.pi and np.ptp(raw["phase"][0]) > 1:
        notes.append(f"the phase stays within {np.abs(raw['phase'][0]).max():.2f} deg; is it rad?")
    if amplitude is not None and "excitation" in raw:
        raise DataError("amplitude is given, and the file has the excitation in column "
                        f"{raw['excitation'][1]!r}; leave one of them out")
    amplitude, told = _amplitude(amplitude, declared, sides)
    notes += told
    read = [f"{k} [{found[k]}]" for k in ("frequency", "magnitude", "phase") if k in found]
    how = ", ".join(read) + (" and real and imaginary part" if "real" in raw else "")
    if stated and factor != 1:
        how += f", stated in {stated}"
    if conjugate:
        how += ", of exp(-i w t)"
    unit_ = response_unit(input, output, kind)
    what = f"{output} over {input} [{unit_}] from {how}"
    masks = levels(frequency, extra["excitation"]) if "excitation" in extra else [np.ones(len(frequency), bool)]
    out = []
    for here in masks:
        where, mean, said, values = _averaged(frequency[here], response[here], {k: v[here] for k, v in extra.items()})
        if amplitude is not None:
            values["excitation"] = np.full(len(where), amplitude)
        label, told = "", notes
        if len(masks) > 1:
            label = f" at {np.median(values['excitation']):.3g} {drive_unit(input, kind)}"
            told = [*notes, f"one of {len(masks)} levels of excitation in the file"]
        single = None if sine is None else bool(sine[here].all() if len(sine) == len(here) else sine.all())
        f = FRF(name + label, where, mean, input, output, unit_, use=use, sine=single, notes=(what, said, *told),
                **values)
        out.append(expect_passive(f, *other_ways(scale, conjugate)) if input in ("torque", "load") else f)
    return out


def other_ways(scale: float | None, conjugate: bool) -> tuple[str, str]:
    """What turns the sign of a response that was read so, and that of its phase."""
    return f"scale = {-(scale or 1):g}", f"conjugate = {str(not conjugate).lower()}"


def _averaged(
    frequency: Array, response: Complex, extra: Mapping[str, Array]
) -> tuple[Array, Complex, str, dict[str, Any]]:
    """Frequencies, robust means of the repeats at each, a sentence, and what else is known of them."""
    where, mean, sigma, repeats, rejected = average_repeats(frequency, response)
    values: dict[str, Any] = {k: _medians(frequency, v, where) for k, v in extra.items()}
    if sigma is not None or "sigma" not in values:  # what repeats show comes first
        values["sigma"] = sigma
    said = f"{len(where)} frequencies, {where[0]:.4g} to {where[-1]:.4g} Hz"
    if repeats.max() > 1:
        few, many = int(repeats.min()), int(repeats.max())
        said += f", mean of {few if few == many else f'{few} to {many}'} repeats ({rejected} outliers without weight)"
        share = float(np.median(np.asarray(sigma * np.sqrt(repeats) / np.abs(mean))[repeats > 1]))
        if share > _SCATTERS:
            said += (f"; they differ by {100 * share:.0f} %: are they levels of excitation? Name its column: columns = "
                     "{ excitation = ... }")
    return where, mean, said, values


def _expect_quantities(table: Table, raw: frf_units.Raw, input: str, output: str, unit: str) -> None:
    """Raises DataError where the file says that it holds the response of something else."""
    over, under = table.quantities.get(raw["real" if "real" in raw else "magnitude"][1], ("", ""))
    if over not in ("", output) or (under in OUTPUTS and input != "reference"):
        is_ = f"{over or 'something'} over {under or 'something'}"
        raise DataError(f"the file says that it is {is_}; {output} over {input} was asked for: say what it is in input "
                        "and output, or the unit of a response whose file is wrong, as in units = { output = ... }")
    ours = [m for line in table.remarks if (m := _OURS.match(line))]
    for m in ours if RESPONSE in table.columns else []:
        if float(m[1]) in table.columns[RESPONSE] and (m[2], m[3], letters(m[4])) != (output, input, letters(unit)):
            raise DataError(f"the file says that response {m[1]} is {m[2]} over {m[3]} [{m[4]}]; {output} over {input} "
                            f"[{unit}] was asked for: input, output or axis.kind are others")


def parts(table: Table, chosen: Any = None) -> list[tuple[str, Table]]:
    """Every response of a file by its number in a column "response", as `to_csv` writes them: a label, and its rows.

    Args:
        table: of the whole file; without such a column it is one response, with no label.
        chosen: the number of the only one that is asked for.

    Raises:
        DataError: there is none of that number.
    """
    number = table.columns.get(RESPONSE)
    numbers = [] if number is None or np.any(number % 1) else np.unique(number).tolist()  # else it may be a magnitude
    if chosen is None and len(numbers) <= 1:
        return [("", table)]
    if chosen is not None and (isinstance(chosen, bool) or chosen not in numbers):
        has = f"its column {RESPONSE!r} has {', '.join(f'{n:g}' for n in numbers)}" if numbers else \
            f"it has no column {RESPONSE!r}"
        raise DataError(f"response = {chosen!r}: the file has no such response; {has}")
    out = []
    for n in numbers if chosen is None else [chosen]:
        rows = table.rows(number == n)
        told = {k: v for k, v in rows.columns.items() if not np.isnan(v).all()}  # others have what this one has not
        out.append((f" response {n:g}", replace(rows, columns=told)))
    return out


def from_control(
    frd: Any,
    input: str = "torque",
    output: str = "position",
    *,
    entry: tuple[int, int] = (0, 0),
    name: str | None = None,
    amplitude: float | None = None,
    kind: str = "hinge",
    use: str = "fit",
) -> FRF:
    """A frequency response from one of python-control (`FrequencyResponseData`, or `frd` of a model).

    Args:
        frd: anything with `omega` (n,) [rad/s] and `frdata` (outputs, inputs, n), in SI.
        input, output: what the response leads from and to.
        entry: which output and which input, from 0.
        name: default: that of `frd`.
        amplitude: of the input during the measurement [N m].
        kind: of the joint, for the unit of the result.
        use: of the result.

    Raises:
        DataError: no such object or entry, or values that no measurement gives.
    """
    try:
        omega, data = np.asarray(frd.omega, float), np.asarray(frd.frdata, complex)
    except (AttributeError, TypeError, ValueError):
        raise DataError(f"expected an object of python-control with omega and frdata; {type(frd).__name__} given") \
            from None
    if data.ndim != 3 or omega.shape != data.shape[2:]:
        raise DataError(f"frdata has shape {data.shape}, omega {omega.shape}; expected (outputs, inputs, frequencies)")
    if not (0 <= entry[0] < data.shape[0] and 0 <= entry[1] < data.shape[1]):
        raise DataError(f"entry {entry} of a response with {data.shape[0]} outputs and {data.shape[1]} inputs, from 0")
    g = data[entry]
    table = Table({"frequency": omega, "real": g.real.copy(), "imag": g.imag.copy()})
    title = name or str(getattr(frd, "name", None) or "frd")
    try:
        return from_table(
            table, title, input, output, unit={"frequency": "rad/s"}, amplitude=amplitude, kind=kind, use=use
        )
    except DataError as error:
        raise DataError(f"{title}: {error}") from None


def _has_a_line_per_quantity(table: Table) -> bool:
    sizes = {len(v) for v in table.columns.values()}
    return not table.named and len(sizes) == 1 and 2 <= min(sizes) <= _FEW < len(table.columns)


def _turned(table: Table) -> Table:
    if table.unusable:
        column, why = next(iter(table.unusable.items()))
        raise DataError(f"number {column} of each line: {why}")
    lines = np.array(list(table.columns.values())).T
    return Table({str(i): line for i, line in enumerate(lines)}, named=False, units=table.units)


def _raw(table: Table, chosen: Mapping[str, Any], per_line: bool) -> dict[str, tuple[Array, str]]:
    """Values and name in the file of every quantity."""
    names = list(table.names)
    what = "line" if per_line else "column"
    if not table.named and not chosen:
        raise DataError(
            f"the file does not name its {len(names)} {what}s; number them from 0, "
            "as in columns = { frequency = 0, magnitude = 1, phase = 2 }"
        )
    out: dict[str, tuple[Array, str]] = {}
    for key, at in chosen.items():
        if isinstance(at, bool) or not isinstance(at, int | str):
            raise DataError(f"columns.{key} must be the name or the number of a {what}; {at!r} given")
        if isinstance(at, int):
            if not 0 <= at < len(names):
                raise DataError(f"columns.{key}: no {what} {at}; there are {len(names)}, counted from 0")
            at = names[at]
        if at in table.unusable:
            raise DataError(f"column {at!r}: {table.unusable[at]}")
        if at not in table.columns:
            raise DataError(f"columns.{key}: no column {at!r}; the file has {listing(names)}")
        if twice := [k for k, (_, there) in out.items() if there == at]:
            raise DataError(f"columns.{twice[0]} and columns.{key} are both {what} {at!r}; each has one of its own")
        out[key] = (table.columns[at], at)
    other = out["real"][1].removesuffix("real") + "imag" if "real" in out and "imag" not in out else ""
    if other.endswith(".imag") and other in table.columns:  # of one complex column
        out["imag"] = (table.columns[other], other)
    if table.named:
        _detect(table, out)
    if "frequency" not in out:
        in_time = any(n.lower().startswith("time") for n in names)
        timed = "; what was measured in time belongs under [[record]]" if in_time else ""
        raise DataError(
            f"no column for the frequency among {listing(names)}; name it: columns = {{ frequency = ... }}{timed}"
        )
    polar, cartesian = {"magnitude", "phase"} & set(out), {"real", "imag"} & set(out)
    if len(cartesian) == 2 and not any(k in chosen for k in polar):
        for key in polar:
            out.pop(key)
    elif len(polar) == 2 and not cartesian & set(chosen):
        for key in cartesian:
            out.pop(key)
    else:
        lost = "".join(f"; {k!r} is left out, for {why}" for k, why in list(table.unusable.items())[:3])
        raise DataError(
            f"found {listing(out)} among {listing(names)}; a response is magnitude and phase, or real and imag: "
            f"name them with columns = {{ magnitude = ..., phase = ... }}{lost}"
        )
    return {k: out[k] for k in COLUMNS if k in out}


def _detect(table: Table, out: dict[str, tuple[Array, str]]) -> None:
    taken = {at for _, at in out.values()}
    plain = {name: frf_units.plain(name)[0] for name in [*table.columns, *table.unusable]}
    for key, pattern in _NAMES.items():
        if key in out:
            continue
        fits = [n for n, p in plain.items() if n not in taken and re.fullmatch(pattern, p)]
        if len(fits) > 1:
            raise DataError(f"columns {listing(fits)} may each be the {key}; choose: columns = {{ {key} = ... }}")
        if fits and fits[0] in table.unusable:
            raise DataError(f"column {fits[0]!r}: {table.unusable[fits[0]]}")
        if fits:
            out[key] = (table.columns[fits[0]], fits[0])


def _check(table: Table, raw: Mapping[str, tuple[Array, str]], per_line: bool) -> None:
    sizes = {k: len(v) for k, (v, _) in raw.items()}
    if len(set(sizes.values())) > 1:
        raise DataError("columns differ in length: " + ", ".join(f"{k} has {n}" for k, n in sizes.items()))
    for key, (values, at) in raw.items():
        large, positive = np.abs(values) < LARGEST, values > 0 if key == "excitation" else np.ones(len(values), bool)
        for right in (large, positive):
            bad = np.flatnonzero(~right)
            if len(bad):
                expected = why_unusable(values[bad[0]]) if right is large else "not a positive amplitude"
                place = f"line {int(at) + 1}, number {bad[0] + 1}" if per_line else table.place(int(bad[0]))
                raise DataError(f"{place}: {key} is {values[bad[0]]}, {expected} ({len(bad)} such); leave "
                                f"{'them' if len(bad) > 1 else 'it'} out of the file")


def _response(raw: Mapping[str, tuple[Array, str]], found: Mapping[str, str]) -> Complex:
    if "real" in raw:
        return raw["real"][0] + 1j * raw["imag"][0]
    size, base = raw["magnitude"][0], frf_units.UNITS["magnitude"][found["magnitude"]]
    if base:
        if np.abs(size).max() > 30 * base:
            raise DataError(f"magnitude reaches {np.abs(size).max():g} {found['magnitude']}; is it abs?")
        size = 10 ** (size / base)
    elif size.min() <= 0:
        raise DataError(f"magnitude is {size.min():g}, and abs is positive; dB? Write units = {{ magnitude = \"dB\" }}")
    return size * np.exp(1j * frf_units.UNITS["phase"][found["phase"]] * raw["phase"][0])


@dataclass(frozen=True)
class _Sides:
    """What a response leads from and to, and what its units depend on."""

    input: str
    output: str
    kind: str
    count: float | None

    def factor(self, side: str, unit: Any) -> float:
        quantity = self.output if side == "output" else self.input
        return frf_units.quantity_factor(unit, side, quantity, self.kind, self.count)


def _factor(
    raw: frf_units.Raw, file: Mapping[str, str], declared: Mapping[str, Any], sides: _Sides, scale: float | None
) -> tuple[float, str]:
    """What turns the response into SI, and the unit where the file states it."""
    own = [side for side in ("input", "output") if side in declared]
    if scale is None and not own:
        return frf_units.response_factor(raw, file, sides.input, sides.output, sides.kind, sides.count)
    factor = 1.0 if scale is None else scale
    for side in own:
        try:
            size = sides.factor(side, declared[side])
        except DataError as error:
            raise DataError(f"units.{side}: {error}") from None
        factor = factor * size if side == "output" else factor / size
    return factor, ""


def _amplitude(value: float | None, declared: Mapping[str, Any], sides: _Sides) -> tuple[float | None, list[str]]:
    """The amplitude of the input in SI, and what is to be said where it may have been meant in another unit."""
    if value is None:
        if "amplitude" in declared:
            raise DataError("units.amplitude is of amplitude, which is not given")
        return None, []
    si = drive_unit(sides.input, sides.kind)
    if "amplitude" in declared:
        try:
            return abs(value) * sides.factor("amplitude", declared["amplitude"]), []
        except DataError as error:
            raise DataError(f"units.amplitude: {error}") from None
    unit = declared.get("input", si)
    if sides.factor("input", unit) == 1:
        return abs(value), []
    return abs(value), [f"the amplitude is taken as {abs(value):g} {si}; where it is {abs(value):g} {unit}, as the "
                        f'input is, say units = {{ amplitude = "{unit}" }}']


def _beside(
    raw: frf_units.Raw, file: Mapping[str, str], declared: Mapping[str, Any], sides: _Sides, found: Mapping[str, str],
    size: Array, factor: float,
) -> dict[str, Array]:
    """Coherence, excitation and standard deviation in SI, where the file has them; `size` is that of the response."""
    out = {k: raw[k][0] for k in ("coherence", "excitation", "sigma") if k in raw}
    if "coherence" in out:
        out["coherence"] = np.minimum(out["coherence"] * frf_units.UNITS["coherence"][found["coherence"]], 1)
    if "excitation" in out:
        unit = declared.get("input") or frf_units.stated_of(raw["excitation"][1], file)
        try:
            out["excitation"] = out["excitation"] * (sides.factor("input", unit) if unit else 1.0)
        except DataError as error:
            raise DataError(f"unit of the excitation: {error}; say units = {{ input = ... }}") from None
    if "sigma" in out:  # in dB it is that of the magnitude, half of the variance of both parts
        each = math.sqrt(2) * math.log(10) / 20 * size if found["sigma"] == "dB" else factor
        out["sigma"] = np.abs(out["sigma"]) * each
    return out


def _medians(frequency: Array, values: Array, where: Array) -> Array:
    group = np.abs(frequency[:, None] - where).argmin(1)
    return np.array([np.median(values[group == i]) for i in range(len(where))])


def listed(frfs: Sequence[FRF]) -> list[str]:
    """What each response is and how it was read, those that were read alike in one line."""
    alike: dict[str, list[str]] = {}
    for f in frfs:
        alike.setdefault("; ".join(f.notes), []).append(f.name)
    return [f"{several(names)}: {said}" for said, names in alike.items()]
