"""The entries [[frf]] of a measurement set: files with one frequency response each, or with several by number."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import formats
from ..errors import DataError
from ..frf import FRF, INPUTS, drive_unit, response_unit
from ..logs import columns
from ..logs.columns import number, subtable
from ..logs.measured_axis import Axis
from . import frf_table
from .passivity import expect_passive

_FEWEST_POINTS = 5  # of a response that validates
_KEYS = ("file", "response", "input", "output", "amplitude", "use", "columns", "units", "scale", "conjugate", "joint")


def read(key: str, entry: Mapping[str, Any], folder: Path, axis: Axis) -> list[FRF]:
    """The responses in the file of one [[frf]]: all, or the one that it chooses by its number.

    Args:
        key: what the entry is called in messages, "frf 1".
        entry: the table of `dataset.toml`.
        folder: of the file that it names.
        axis: whose responses they are.

    Raises:
        DataError: the file cannot be read, what its columns and units are is not clear, or no axis answers like that.
    """
    name, use = columns.file_and_use(entry, _KEYS, key)
    try:
        for side, example in (("input", "torque"), ("output", "position")):
            if not isinstance(entry.get(side), str):
                given = f"; {entry[side]!r} given" if side in entry else ""
                raise DataError(f'{side} must be given, as in {side} = "{example}"{given}')
        # A current is turned into torque; then the amplitude is one of torque already.
        source, constant = entry["input"], 1.0
        if source == "current":
            constant = axis.constant("the input is current, not torque: axis.torque_constant [N m/A] is needed")
        amplitude = number(entry, "amplitude", "", drive_unit(source, axis.joint.kind) if source in INPUTS else "")
        scale = number(entry, "scale", "", "SI per raw number")
        if not isinstance(conjugate := entry.get("conjugate", False), bool):
            raise DataError(f"conjugate must be true or false; {conjugate!r} given")
        if not os.path.isfile(folder / name):
            raise DataError(f"no such file: {name}; {formats.beside(folder / name)}")
        parts = frf_table.parts(formats.read(folder / name), entry.get("response"))
        if amplitude is not None and len(parts) > 1:
            raise DataError(f"amplitude is one, and the file holds {len(parts)} responses; leave it out where the file "
                            "has the excitation, or choose one of them, as in response = 1")
        found = [
            f
            for label, table in parts
            for f in frf_table.levels_from_table(
                table, Path(name).name + label, source, entry["output"],
                columns=subtable(entry, "columns"), unit=subtable(entry, "units"), scale=scale,
                amplitude=amplitude, conjugate=conjugate, kind=axis.joint.kind, count=axis.joint.resolution, use=use,
            )
        ]  # fmt: skip
        if source == "current":
            sign, phase = frf_table.other_ways(scale, conjugate)
            sign = sign if axis.in_amperes else f"axis.torque_constant = {-constant:g}"
            found = [expect_passive(_from_torque(f, constant, axis.joint.kind), sign, phase) for f in found]
    except DataError as error:
        raise DataError(f"{key} ({name}): {error}") from None
    return found


def _from_torque(frf: FRF, constant: float, kind: str) -> FRF:
    """A response from current as one from torque; `constant` [N m/A]."""
    excitation = None if frf.excitation is None else frf.excitation * abs(constant)
    sigma = None if frf.sigma is None else frf.sigma / abs(constant)
    unit = response_unit("torque", frf.output, kind)
    return replace(frf, response=frf.response / constant, input="torque", unit=unit, excitation=excitation, sigma=sigma)


def split(frfs: tuple[FRF, ...]) -> tuple[tuple[FRF, ...], str]:
    """Responses with their use, and the sentence that tells it.

    Of levels of excitation the inner ones can validate: what lies beyond the outer ones is not in the others.
    """
    levels = [f.amplitude is not None and len(f) >= _FEWEST_POINTS for f in frfs]
    if len(frfs) < 3 or not all(levels):
        return frfs, "no use was given, so all fit"
    order = sorted(range(len(frfs)), key=lambda i: float(np.median(frfs[i].amplitude)))  # type: ignore[arg-type]
    chosen = set(order[1:-1:3])
    said = "no use was given: of the levels between the smallest and the largest every third validates, the others fit"
    return tuple(replace(f, use="validate") if i in chosen else f for i, f in enumerate(frfs)), said
