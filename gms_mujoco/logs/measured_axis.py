"""The axis of a measurement set: the table [axis] of `dataset.toml`, a bare axis or a joint of an MJCF model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import DataError, listing
from ..record import LOAD_ACTS
from . import columns
from .columns import expect_known, number, subtable
from .robot import Payload, Robot, Setup

KINDS = ("hinge", "slide")
ENCODER = ("encoder_counts_per_rev", "encoder_resolution")
_SETUP = ("pose", "payload", "gravity", "zero", "reversed")
_KEYS = ("kind", "inertia", *ENCODER, "torque_constant", "load_acts", "model", "joint", *_SETUP)


class Axis:
    """The table [axis], checked, for one of its joints.

    Args:
        table: as in `dataset.toml`.
        folder: in which axis.model is looked for.
        joint: which, where the table has several.

    Attributes:
        joint: name, kind and resolution, "" for a bare axis.
        names: of all joints that the measurements are of.
        robot: None for a bare axis.
        inertia: [kg m^2] or [kg]; None: to be identified.
        torque_constant: [N m/A], None where not given; 1 where it is unknown.
        load_acts: 1 or -1 where the logged load acts on the axis too, see `Record.with_acting_load`; 0 where not.
        in_amperes: the torque constant is unknown: torque stays in A.
        has_current: whether a current was turned into torque.
        current_kinds: "rms" and "peak" where a current says which it is, with the first file that does.

    Raises:
        DataError: a key that does not exist, or that cannot be what it is given as.
    """

    def __init__(self, table: Mapping[str, Any], folder: Path, joint: str | None) -> None:
        expect_known(table, (*_KEYS, "controller"), "axis.")  # one with a controller is no `Axis`
        self.names = joint_names(table)
        self.robot = self._robot(table, folder, joint)
        name = self.robot.joint if self.robot else ""
        kinds = self.robot.kinds if self.robot else {}
        kind = table.get("kind", kinds.get(name, "hinge"))
        if kind not in KINDS:
            raise DataError(f"axis.kind must be one of {listing(KINDS)}; {kind!r} given")
        if self.robot and kind != kinds[name]:
            raise DataError(f"axis.kind is {kind!r}, but {name!r} is a {kinds[name]} in axis.model; leave kind out")
        others = {k: v for k, v in kinds.items() if k != name}
        self._table = table
        self.joint = columns.Joint(name, kind, None, others)
        self.joint = replace(self.joint, resolution=self.resolution(name, kind))
        if self.robot and table.get("inertia") == "model":
            self.inertia: float | None = self.robot.inertia
        elif self.robot and "inertia" in table:
            raise DataError('axis.inertia: beside axis.model only "model" (known, not identified) can be given; '
                            f"{table['inertia']!r} given")
        else:
            self.inertia = _positive(table, "inertia", "kg m^2" if kind == "hinge" else "kg")
        self.load_acts = table.get("load_acts", 0)
        if "load_acts" in table and self.load_acts not in LOAD_ACTS:
            raise DataError("axis.load_acts must be 1, for a load that pushes the axis in its direction, or -1; "
                            f"{self.load_acts!r} given")
        own = columns.of_joint({k: v for k, v in table.items() if k == "torque_constant"}, "axis", self.joint)[0]
        self.in_amperes = own.get("torque_constant") == "unknown"
        if self.in_amperes:
            for key in ("model", "inertia"):
                if key in table:
                    raise DataError(f'axis.torque_constant = "unknown" leaves torque in A, which axis.{key} cannot be '
                                    "compared with; leave one of them out")
            own["torque_constant"] = 1.0
        unit = "N m/A" if kind == "hinge" else "N/A"
        self.torque_constant: float | None = number(own, "torque_constant", "axis.", unit)
        self.has_current = False
        self.current_kinds: dict[str, str] = {}

    def constant(self, asked: str) -> float:
        """The torque constant, for a current that was found; raises DataError with `asked` where it is not given."""
        if self.torque_constant is None:
            raise DataError(asked)
        self.has_current = True
        return self.torque_constant

    def _robot(self, table: Mapping[str, Any], folder: Path, joint: str | None) -> Robot | None:
        if "model" not in table:
            for key in ("joint", *_SETUP):
                if key in table:
                    raise DataError(f"axis.{key} needs axis.model, the MJCF file of the robot")
            if joint:
                raise DataError(f"joint {joint!r} was asked for, but the set is of a bare axis without axis.model")
            return None
        if not isinstance(table["model"], str):
            raise DataError(f"axis.model must be the name of an MJCF file; {table['model']!r} given")
        columns.expect_name(table["model"], "axis.model")
        if not self.names:
            raise DataError("axis.model needs axis.joint, the name of a joint or a list of names")
        if joint is None and len(self.names) > 1:
            raise DataError(f"the set is of several joints, {listing(self.names)}: choose one, as in "
                            f"load(path, joint={self.names[0]!r}) or --joint {self.names[0]}")
        if joint is not None and joint not in self.names:
            raise DataError(f"the set is not of a joint {joint!r}; it is of {listing(self.names)}")
        return Robot(folder / table["model"], joint or self.names[0], _setup(table))

    def resolution(self, name: str, kind: str) -> float | None:
        """Position of one encoder count of a joint [rad or m]."""
        given = {k: v for k, v in self._table.items() if k in ENCODER}
        if self.robot:
            here = columns.Joint(name, kind, None, self.robot.kinds)
            given = columns.of_joint(given, "axis", here)[0]
        return encoder_count(given, kind)

    def has(self, entry: Mapping[str, Any], key: str) -> bool:
        """Whether a [[record]] or an [[frf]] is for this joint."""
        chosen = entry.get("joint")
        if chosen is None:
            return True
        if not self.robot:
            raise DataError(f"{key}: joint needs axis.model")
        names = [chosen] if isinstance(chosen, str) else chosen
        for name in names if isinstance(names, list) else [names]:
            if name not in self.names:
                raise DataError(f"{key}: joint must be among those of the axis, {listing(self.names)}; {name!r} given")
        return self.joint.name in names


def _setup(table: Mapping[str, Any]) -> Setup:
    """What the table [axis] says of how the robot was set up."""
    angles = {key: subtable(table, key) for key in ("pose", "zero")}
    for key, given in angles.items():
        for name, value in given.items():
            if not _are_numbers(value):
                raise DataError(f"axis.{key}.{name} must be a number [rad or m]; {value!r} given")
    gravity = table.get("gravity")
    if gravity is not None and not (isinstance(gravity, list) and len(gravity) == 3 and _are_numbers(*gravity)):
        raise DataError(f"axis.gravity must be three numbers, as in [0.0, 0.0, -9.81] [m/s^2]; {gravity!r} given")
    backwards = table.get("reversed", [])
    if not (isinstance(backwards, list) and all(isinstance(name, str) for name in backwards)):
        raise DataError(f'axis.reversed must be a list of joints, as in ["elbow"]; {backwards!r} given')
    x, y, z = gravity or (0.0, 0.0, 0.0)
    payload = _payload(subtable(table, "payload")) if "payload" in table else None
    return Setup(angles["pose"], payload, (x, y, z) if gravity else None, angles["zero"], tuple(backwards))


def _payload(table: Mapping[str, Any]) -> Payload:
    """The table axis.payload."""
    expect_known(table, ("body", "mass", "position"), "axis.payload.")
    body, mass, place = table.get("body"), table.get("mass"), table.get("position", [0.0, 0.0, 0.0])
    if not (isinstance(body, str) and isinstance(place, list) and len(place) == 3 and _are_numbers(mass, *place)):
        wanted = '{ body = "hand", mass = 0.4, position = [0.0, 0.0, 0.1] } [kg, m]'
        raise DataError(f"axis.payload must be a table as in {wanted}; {dict(table)!r} given")
    x, y, z = place
    return Payload(body, float(mass or 0.0), (x, y, z))


def _are_numbers(*values: object) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e6 for v in values)


def encoder_count(axis: Mapping[str, Any], kind: str) -> float | None:
    """Position of one encoder count [rad or m] of a joint, by the keys `ENCODER`; None where not given."""
    counts = _positive(axis, "encoder_counts_per_rev", "counts")
    resolution = _positive(axis, "encoder_resolution", "rad" if kind == "hinge" else "m")
    if counts is None:
        return resolution
    if kind == "slide":
        raise DataError("axis.encoder_counts_per_rev is for a hinge; a slide takes encoder_resolution [m]")
    if resolution is not None:
        raise DataError("axis: give encoder_counts_per_rev or encoder_resolution, not both")
    return 2 * math.pi / counts


def joint_names(axis: Mapping[str, Any]) -> tuple[str, ...]:
    """Names in axis.joint, none where it is not given."""
    given = axis.get("joint", [])
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list) or not all(isinstance(n, str) and n for n in names):
        raise DataError(f"axis.joint must be the name of a joint, or a list of names; {given!r} given")
    if len(set(names)) < len(names):
        raise DataError(f"axis.joint names a joint twice: {listing(names)}")
    return tuple(names)


def _positive(table: Mapping[str, Any], key: str, unit: str) -> float | None:
    value: float | None = number(table, key, "axis.", unit)
    if value is not None and value < 0:
        raise DataError(f"axis.{key} must be positive [{unit}]; {value!r} given")
    return value
