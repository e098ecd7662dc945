"""Units that a measurement may come in, and their factors into SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from ..errors import DataError, listing

_REV = 2 * math.pi
_LBF, _INCH, _FOOT = 4.4482216152605, 0.0254, 0.3048
COUNTS = ("count", "counts", "inc")  # encoder counts: their size is a property of the axis

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "100ns": 1e-7, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": _REV / 360, "mdeg": _REV / 360e3, "arcmin": _REV / 21600,
          "arcsec": _REV / 1296000, "gon": _REV / 400, "rev": _REV, "turn": _REV}
_LENGTH = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": _INCH, "ft": _FOOT}
_TORQUE = {"Nm": 1.0, "kNm": 1e3, "daNm": 10.0, "cNm": 1e-2, "mNm": 1e-3, "uNm": 1e-6, "Ncm": 1e-2, "Nmm": 1e-3,
           "kgfm": 9.80665, "kgfcm": 0.0980665, "kgm": 9.80665, "kgcm": 0.0980665, "gcm": 9.80665e-5,
           "lbfft": _LBF * _FOOT, "lbfin": _LBF * _INCH, "ozfin": _LBF * _INCH / 16,
           "lbft": _LBF * _FOOT, "lbin": _LBF * _INCH, "ozin": _LBF * _INCH / 16}
_FORCE = {"N": 1.0, "kN": 1e3, "daN": 10.0, "mN": 1e-3, "kgf": 9.80665, "lbf": _LBF}
_CURRENT = {"A": 1.0, "mA": 1e-3, "uA": 1e-6}
_PER_MINUTE = dict.fromkeys(("rpm", "rev/min", "1/min"), _REV / 60)
_SPEED = {f"{unit}/s": factor for unit, factor in _ANGLE.items()} | _PER_MINUTE | {"rps": _REV}
_RATE = {f"{unit}/s": factor for unit, factor in _LENGTH.items()}

# Unit tables of each column: of a hinge joint, of a slide joint.
_TABLES: Mapping[str, tuple[Mapping[str, float], Mapping[str, float]]] = {
    "time": (_TIME, _TIME),
    "position": (_ANGLE, _LENGTH),
    "reference": (_ANGLE, _LENGTH),
    "velocity": (_SPEED, _RATE),
    "torque": (_TORQUE, _FORCE),
    "load": (_TORQUE, _FORCE),
    "rigid_torque": (_TORQUE, _FORCE),
    "inertia_change": ({"kgm^2": 1.0}, {"kg": 1.0}),
    "transmitted_torque": (_TORQUE, _FORCE),
    "current": (_CURRENT, _CURRENT),
}
_COUNTED = ("position", "reference", "velocity")
_CELSIUS, _FAHRENHEIT = (1.0, 0.0), (5 / 9, -160 / 9)  # factor, offset
_TEMPERATURE = {"degC": _CELSIUS, "C": _CELSIUS, "K": (1.0, -273.15), "degF": _FAHRENHEIT, "F": _FAHRENHEIT}


_AKA = {  # units written out, in lower case, and what else is meant by one alone
    "s": ("sec", "secs", "second", "seconds"), "ms": ("msec", "millisecond", "milliseconds"),
    "us": ("usec", "microsecond", "microseconds"), "min": ("minute", "minutes"), "h": ("hour", "hours"),
    "d": ("day", "days"), "rad": ("radian", "radians"), "deg": ("degree", "degrees", "grad"), "rpm": ("u/min",),
    "rev": ("revs", "revolution", "revolutions", "umdr", "umdrehung", "umdrehungen"), "turn": ("turns",),
    "counts": ("cts", "cnt", "cnts", "ticks", "incs", "incr", "increments", "pulses"),
    "A": ("amp", "amps", "ampere", "amperes"), "mA": ("milliamp", "milliamps", "milliampere"),
    "Nm": ("newtonmeter", "newtonmeters", "newtonmetre", "newtonmetres"), "m": ("meter", "meters", "metre", "metres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "lbft": ("ftlb", "ftlbs", "lbsft"), "lbfft": ("ftlbf",), "lbin": ("inlb", "inlbs", "lbsin"), "lbfin": ("inlbf",),
    "ozin": ("inoz",), "ozfin": ("inozf",),
}  # fmt: skip
_MEANT = {word: unit for unit, words in _AKA.items() for word in (*words, unit) if len(word) > 2} | {"NM": "Nm"}

_MULTIPLE = re.compile(r"(\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*[*·]?\s*([^\W\d_].*|°.*)")  # "0.001°"
_KIND = re.compile(r"([mu\N{MICRO SIGN}k]?A)[\s_]*\(?(?:(rms|RMS|eff|EFF)|(?:pk|peak|PK))\)?")  # "A rms", of a current
_ONLY_IN_UNITS = re.compile(r"[%‰°^²³·Ω]")
_SHORT = re.compile(r"(?:\d[\d.,]*\s*)?[^\W\d_]{1,4}(?:[\s*./_-]+[^\W\d_]{1,4})*")  # "Mp", "kp m"
_NO_FACTORS = frozenset(("percent", "permille", "promille", "prozent", "volts", "units", "steps", "digits", "rated"))
_LABEL = re.compile(  # a short word in brackets that says which signal it is, or of what, and not how much
    "act|set|ref|cmd|des|goal|tgt|raw|fbk?|meas|est|obs|pred|filt|lp|avg|mean|sum|diff|err|max|min|abs|rel|ist|soll|"
    "in|out|new|old|orig|main|aux|test|sim|real|data|log|sp|pv|pre|post|pos|neg|fwd|bwd|up|down|low|high|top|"
    "arm|leg|hip|knee|foot|toe|hand|neck|head|base|pan|tilt|roll|yaw|axis|ax|jnt|link|lead|left|lhs|rhs|load|side|tool|"
    "mot|mtr|enc|gear|drv|ctrl|ctl|plc|cnc|nc|adc|dac|dsp|can|ecat|pdo|sdo|opc|ros|imu|ff|pid|"
    "vel|spd|acc|tq|trq|torq|cur|curr|time|[xyzq]|iq|dq|ch|n/a|none|nan|null|utc|gmt|cest|cet|mez|iso"
)


def may_be(text: str, column: str) -> bool:
    """Whether what stands in brackets beside a column is its unit, known or not, and no word about the column."""
    if is_unit(text) or measures(text, column) or _ONLY_IN_UNITS.search(text):
        return True
    words = [text, *re.findall(r"[^\W\d_]+", text)]
    labels = [w for w in words if _LABEL.fullmatch(w.lower())]
    if any(w.lower() in _NO_FACTORS or (len(w) > 1 and w not in labels and measures(w, column)) for w in words):
        return True
    return not labels and _SHORT.fullmatch(text) is not None


def kind_of_current(unit: str) -> str:
    """Which amperes of a sine a unit of current counts, "rms" or "peak"; "" where it does not say."""
    found = _KIND.fullmatch(unit.strip())
    return "" if found is None else "rms" if found[2] else "peak"


def into_si(unit: str, column: str, kind: str, count: float | None) -> tuple[float, float]:
    """Factor and offset that turn a number in `unit` into SI.

    Args:
        unit: as written in `dataset.toml` or in the file; blanks, "*", "." and "-" between its parts do not matter,
            "µ" is "u" and "°" is "deg", many may be written out ("seconds"), and a number before it is a factor.
        column: the column it belongs to, "position", "torque" ...
        kind: joint kind, "hinge" or "slide".
        count: one encoder count [rad or m], None where unknown.

    Raises:
        DataError: an unknown unit, or a unit of something else.
    """
    known, spelled = units_of(column, kind), in_column(unit, column, kind)
    if spelled in known:
        return known[spelled]
    if multiple := _MULTIPLE.fullmatch(unit):
        factor, offset = into_si(multiple[2], column, kind, count)
        return float(multiple[1].replace(",", ".")) * factor, offset
    if column in _COUNTED and spelled.removesuffix("/s") in COUNTS:
        if spelled.endswith("/s") != (column == "velocity"):
            raise DataError(f"{unit!r} does not measure {column}; expected one of {listing(known)}")
        if count is None:
            key = "encoder_counts_per_rev" if kind == "hinge" else "encoder_resolution"
            raise DataError(f"{unit!r} needs axis.{key}, which is not given")
        return count, 0.0
    for other in (*_TABLES, "temperature"):
        for joint in ("hinge", "slide"):
            if spelled in units_of(other, joint):
                what = f"{other} of a {joint} joint"
                raise DataError(f"{unit!r} measures {what}, not {column} of a {kind} joint; expected {listing(known)}")
    takes = [*known, *(["counts" + "/s" * (column == "velocity")] if column in _COUNTED else [])]
    raise DataError(f"unknown unit {unit!r}; {column} of a {kind} joint takes {listing(takes)}")


def in_column(unit: str, column: str, kind: str) -> str:
    """A unit as it is spelled here; in another case too where that has one meaning in this column: "mnm" is "mNm"."""
    if column == "current" and (of_kind := _KIND.fullmatch(unit.strip())):
        unit = of_kind[1]
    known, spelled = units_of(column, kind), _spelled(unit)
    alike = [u for u in known if u.lower() == spelled.lower()]
    return alike[0] if spelled not in known and len(alike) == 1 else spelled


def is_unit(text: str) -> bool:
    """Whether it is a unit of anything that a record may have."""
    spelled = _spelled(text)
    known = (units_of(column, kind) for column in (*_TABLES, "temperature") for kind in ("hinge", "slide"))
    return spelled.removesuffix("/s") in COUNTS or any(spelled in units for units in known)


def measures(unit: str, column: str) -> bool:
    """Whether it is a unit of a column, of a hinge or of a slide joint."""
    spelled = _spelled(unit)
    counted = column in _COUNTED and spelled.endswith("/s") == (column == "velocity")
    known = any(in_column(unit, column, kind) in units_of(column, kind) for kind in ("hinge", "slide"))
    return known or (counted and spelled.removesuffix("/s") in COUNTS)


def is_si(unit: str, column: str, kind: str) -> bool:
    """Whether it is what a column is taken for where nobody says its unit."""
    return units_of(column, kind).get(in_column(unit, column, kind)) == (1.0, 0.0)


def _spelled(unit: str) -> str:
    unit = re.sub(r"[ *·.]|(?<=[A-Za-z])-(?=[A-Za-z])", "", unit)
    unit = unit.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u").replace("°", "deg")
    whole = _MEANT.get(unit, _MEANT.get(unit.lower()))
    return whole or "/".join(_MEANT.get(part, _MEANT.get(part.lower(), part)) for part in unit.split("/"))


def units_of(column: str, kind: str) -> Mapping[str, tuple[float, float]]:
    """The units of a column, each with its factor and offset into SI."""
    if column == "temperature":
        return _TEMPERATURE
    return {unit: (factor, 0.0) for unit, factor in _TABLES.get(column, ({}, {}))[kind == "slide"].items()}
