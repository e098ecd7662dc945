"""The units of a frequency response in a file: declared, stated in the file, told by the values, or an error.

A guess between Hz and rad/s would be wrong by 6.3 and look right, one between deg and rad by 57.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, listing
from ..logs import units

Array = NDArray[np.float64]
Raw = Mapping[str, tuple[Array, str]]  # quantity: values, and name in the file

UNITS = {
    "frequency": {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / math.pi, "rpm": 1 / 60},
    "phase": {"rad": 1.0, "deg": math.pi / 180},
    "magnitude": {"abs": 0.0, "dB": 20.0, "log10": 1.0},
    "sigma": {"abs": 0.0, "dB": 20.0},
    "coherence": {"1": 1.0, "%": 0.01},
}
KEYS = ("frequency", "magnitude", "phase", "sigma", "coherence", "input", "output", "amplitude")
_AKA = {
    "hertz": "Hz", "hz": "Hz", "khz": "kHz", "rad/s": "rad/s", "rads": "rad/s", "rad/sec": "rad/s", "rads^-1": "rad/s",
    "rads-1": "rad/s", "rads⁻¹": "rad/s", "rpm": "rpm", "rad": "rad", "radian": "rad", "radians": "rad", "deg": "deg",
    "degree": "deg", "degrees": "deg", "°": "deg", "abs": "abs", "linear": "abs", "lin": "abs", "db": "dB",
    "log10": "log10", "%": "%", "1": "1",
}  # fmt: skip
_MEASURED = ("torque", "load", "current", "position", "velocity")
_OTHERS = {  # of quantities that a record does not have
    "acceleration": ({"rad/s^2": 1.0, "deg/s^2": math.pi / 180}, {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": 9.80665}),
    "voltage": ({"V": 1.0, "mV": 1e-3},) * 2,
    "reference": ({"1": 1.0},) * 2,
}
_TURNS = 60.0  # rad: nobody keeps ten turns of phase in rad, nearly everybody several in degrees


def plain(name: str) -> tuple[str, str]:
    """The words of a column's name without its unit, in lower case, and the unit as it is written, or ""."""
    text = name.strip()
    if part := re.fullmatch(r"(.+)\.(real|imag)", text, re.IGNORECASE):
        return part[2].lower(), plain(part[1])[1]
    if re.fullmatch(r"[\w.]+\w", text):
        text = text.split(".")[-1]
    unit = ""
    for pattern in (r"(.*?)[\s_]*\[\s*([^\[\]]*?)\s*\]", r"(.*?)[\s_]*\(\s*((?:[^()]|\([^()]*\))*?)\s*\)",
                    r"(.*?)\s*,\s*(\S+)", r"(.+?)[\s_]+(hz|khz|rad/s|rads|rad/sec|rpm|deg|rad|db|abs|lin)"):
        if match := re.fullmatch(pattern, text, re.IGNORECASE):
            text, unit = match[1], match[2]
            break
    word = text.lower()
    if not unit:
        unit = {"hz": "Hz", "db": "dB", "deg": "deg", "radps": "rad/s", "omega": "rad/s", "w": "rad/s", "ω": "rad/s"} \
            .get(word, "")
    return word.replace("_", " ").strip(" .:="), unit


def of(key: str, raw: Raw, declared: Mapping[str, Any], file: Mapping[str, str]) -> str:
    """The unit of frequency, magnitude, phase, sigma or coherence, one of `UNITS`.

    Args:
        key: which quantity.
        raw: values and name in the file of every quantity.
        declared: the user's units.
        file: units that the file states by column.

    Raises:
        DataError: nothing says what the unit is, or the values contradict it.
    """
    known, (values, at) = UNITS[key], raw[key]
    unit = ""
    if key in declared:
        unit = _known(declared[key], known)
        if not unit:
            raise DataError(f"units.{key} must be one of {listing(known)}; {declared[key]!r} given")
    else:
        stated = stated_of(at, file)
        unit = _known(stated, known)
        if not unit and key == "magnitude" and stated:
            unit = "dB" if re.match("db", stated, re.IGNORECASE) else "abs"  # of a ratio, which `response_factor` reads
        elif not unit and stated:
            raise DataError(f"{key}: {stated!r} is none of the units {listing(known)}; write units = {{ {key} = ... }}")
    if not unit and key == "sigma" and ("real" in raw or of("magnitude", raw, declared, file) != "dB"):
        unit = "abs"
    unit = unit or _told(key, values)
    if unit == "rad" and np.ptp(values) > _TURNS:
        raise DataError(f"phase goes over {np.ptp(values):.0f} rad, {np.ptp(values) / 2 / math.pi:.0f} turns; is it "
                        'deg? Write units = { phase = "deg" }, or take the turns out where it is rad')
    if key == "coherence" and (wrong := values * UNITS[key][unit]).size and (wrong.max() > 1.001 or wrong.min() < 0):
        raise DataError(f'coherence is {values[np.abs(wrong).argmax()]:g}, and lies between 0 and 1; in percent? Write '
                        'units = { coherence = "%" }')
    return unit


def _told(key: str, values: Array) -> str:
    """What the values alone tell of a unit that nobody stated."""
    if key == "coherence":
        return "1"
    if key == "magnitude" and values.min() < 0:
        return "dB"  # an absolute value is never negative
    if key == "phase" and np.ptp(values) > _TURNS:
        return "deg"
    known = list(UNITS[key])
    choices = " or ".join(known[:3:2] if key == "frequency" else known[:2])
    raise DataError(f"{key}: {choices}? The file does not say; write units = {{ {key} = ... }} with one of "
                    f"{listing(known)}")


def _known(unit: Any, known: Mapping[str, float]) -> str:
    if not isinstance(unit, str):
        return ""
    found = _AKA.get(re.sub(r"[\s·*]", "", unit).lower(), "")
    return found if found in known else ""


def stated_of(at: str, file: Mapping[str, str]) -> str:
    """The unit that the file states for a column, "" where it states none or that it has none."""
    unit = (file.get(at, "") or plain(at)[1]).strip()
    return "" if unit in ("-", "1") else unit


def quantity_factor(
    unit: Any, side: str, quantity: str, kind: str = "hinge", count: float | None = None
) -> float:
    """What turns a number in `unit` of the input or the output of a response into SI.

    Raises:
        DataError: no such unit, or one of something else.
    """
    if not isinstance(unit, str):
        raise DataError(f"units.{side} must be a unit in quotes; {unit!r} given")
    if quantity in _MEASURED:
        return units.into_si(unit, quantity, kind, count)[0]
    known = _OTHERS[quantity][kind == "slide"]
    spelled = re.sub(r"[\s·*()]", "", unit).replace("°", "deg")
    spelled = re.sub(r"s(2|²|\N{REPLACEMENT CHARACTER})$", "s^2", spelled)  # what pyuff makes of a ² in a header
    if spelled not in known:
        raise DataError(f"unknown unit {unit!r}; {quantity} of a {kind} joint takes {listing(known)}")
    return known[spelled]


def response_factor(
    raw: Raw, file: Mapping[str, str], input: str, output: str, kind: str, count: float | None
) -> tuple[float, str]:
    """What turns a response in the unit that the file states into SI, and that unit; 1 and "" where it states none.

    Raises:
        DataError: the unit is not one of this output over this input.
    """
    stated = [stated_of(raw[k][1], file) for k in ("real", "imag", "magnitude") if k in raw]
    stated = [_bare(re.sub(r"^db\b[\s,:]*(re\b\s*1?)?", "", s, flags=re.IGNORECASE)) for s in stated]
    stated = [s for s in stated if s and not _known(s, UNITS["magnitude"])]
    if len(set(stated)) > 1:
        raise DataError(f"the file states real and imaginary part in {listing(stated)}; they must have one unit")
    if not stated:
        return 1.0, ""
    text, why = stated[0], ""
    source = output if input == "reference" else input  # a reference is one of the output
    for over, under in _ratios(text):
        try:
            below = quantity_factor(under, "input", source, kind, count) if under else 1.0
            return quantity_factor(over, "output", output, kind, count) / below, text
        except DataError as error:
            why = why or str(error)
    raise DataError(f"the file states the response in {text!r}, which is not {output} over {input}: {why}; say "
                    "units = { input = ..., output = ... }, or scale = ...")


def _ratios(text: str) -> list[tuple[str, str]]:
    """Every way to read a text as one unit over another, the likeliest first; at last as a unit alone."""
    if inverse := re.fullmatch(r"\(1/(.+?)\)\s*\*\s*\((.+)\)", text):  # as some universal files have it
        return [(_bare(inverse[2]), _bare(inverse[1]))]
    cuts = [i for i, c in enumerate(text) if c == "/" and text[:i].count("(") == text[:i].count(")")]
    return [(_bare(text[:i]), _bare(text[i + 1 :])) for i in reversed(cuts)] + [(text, "")]


def _bare(text: str) -> str:
    """Without the parentheses around all of it."""
    inside = re.fullmatch(r"\(((?:[^()]|\([^()]*\))*)\)", text.strip())
    return (inside[1] if inside else text).strip()
