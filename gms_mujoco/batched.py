"""The friction of a model laid out for many worlds at once, and the model without its plug-in.

MuJoCo Warp refuses models with engine plug-ins and MJX drops them without a word: there the friction of the plug-in
runs beside the model, its parameters and states in two arrays with a row for each world.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import native
from .errors import EngineError, ModelError, listing

OWN_STATE = 8  # of a joint, before the states of its effects: see native/kernel.h


@dataclass(frozen=True)
class Layout:
    """Which effects act on which joints, and where their numbers stand.

    Attributes:
        bare: the model without friction of ours.
        names: of the joints with friction, in the order of the model.
        dofs, places: of these joints in qvel and in qpos.
        effects: names of all effects in use.
        joints, uses: tables for the kernel, see native/kernel.h.
        parameters: (n_parameter,) of all joints.
        columns: where the values of "effect.parameter" of a joint stand among them.
        states: where the state of each effect of a joint stands in a row of `n_state`.
    """

    bare: mujoco.MjModel
    names: tuple[str, ...]
    dofs: tuple[int, ...]
    places: tuple[int, ...]
    effects: tuple[str, ...]
    joints: tuple[tuple[int, ...], ...]
    uses: tuple[tuple[int, ...], ...]
    parameters: NDArray[np.float64]
    columns: Mapping[str, Mapping[str, slice]]
    states: Mapping[str, Mapping[str, slice]]
    n_state: int

    @property
    def implicit(self) -> tuple[int, ...]:
        """Numbers of the joints that are too stiff for an explicit step, or asked for an implicit one."""
        return tuple(i for i, row in enumerate(self.joints) if row[-1])

    def column(self, joint: str, parameter: str) -> slice:
        """Where a parameter stands; raises ModelError naming those that exist."""
        if joint not in self.columns:
            raise ModelError(f"no joint with friction is called {joint!r}; they are {listing(self.columns)}")
        if parameter not in self.columns[joint]:
            raise ModelError(
                f"joint {joint!r} has no parameter {parameter!r}; its parameters are {listing(self.columns[joint])}"
            )
        return self.columns[joint][parameter]

    def modulates(self, effect: str) -> bool:
        return native.BY_NAME[effect].modulates

    def has_torque(self, effect: str) -> bool:
        return native.BY_NAME[effect].has_torque

    def multiplier(self, effect: str) -> str:
        """Of its torque, by name in `Level`; empty where nothing multiplies it."""
        declared = native.BY_NAME[effect]
        if declared.kind != "friction":
            return ""
        return "whole" if declared.has_state else "drag"

    def virgin(self, n: int) -> NDArray[np.float64]:
        """(n, n_state) of joints that have never moved: the next evaluation sets out from where they are."""
        state = np.zeros((n, self.n_state))
        state[:, [row[4] + 1 for row in self.joints]] = np.nan
        return state

    def state_of(self, model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
        """(n_state,) of the joints of a MuJoCo simulation with the plug-in, as it stands between two steps."""
        out = self.virgin(1)[0]
        for name, row in zip(self.names, self.joints, strict=True):
            found = native.reading(model._address, data._address, model.joint(name).id)
            if found is None or [e for e, _, _ in found.states] != list(self.states[name]):
                raise ModelError(f"joint {name!r} of the data has other friction than the model that was put")
            for effect, begin, end in found.states:
                out[self.states[name][effect]] = data.plugin_state[begin:end]
            # See kTorque in native/instance.h. Time and position are those of the data, which are rounded.
            anchor = found.torque - native.ANCHOR - (row[5] - OWN_STATE)
            ahead, velocity = data.plugin_state[found.torque + 1 : found.torque + 3]
            virgin = velocity >= np.finfo(float).max
            load = 0.0 if found.load is None else data.plugin_state[found.load]
            if not np.isnan(data.plugin_state[anchor]):
                position, time = data.plugin_state[anchor : anchor + native.ANCHOR]
                there = np.float32(position)
                own = (there, np.float32(time), virgin, ahead, 0.0 if virgin else velocity, load, 0, position - there)
                out[row[4] : row[4] + OWN_STATE] = own
        return out


def lay_out(model: mujoco.MjModel) -> Layout:
    """Reads the friction of a model that has been attached to it.

    Raises:
        ModelError: no joint has friction.
        EngineError: the model has other plug-ins, or sensors of the friction.
    """
    data = mujoco.MjData(model)
    names: list[str] = []
    dofs: list[int] = []
    places: list[int] = []
    joints: list[tuple[int, ...]] = []
    uses: list[tuple[int, ...]] = []
    packed: list[NDArray[np.float64]] = []
    effects: dict[str, int] = {}
    columns: dict[str, dict[str, slice]] = {}
    states: dict[str, dict[str, slice]] = {}
    first_state = first = 0
    for i in range(model.njnt):
        friction = native.attached(model._address, data._address, i)
        if friction is None:
            continue
        name = model.joint(i).name
        own, at, n_uses = OWN_STATE, first, len(uses)
        columns[name], states[name] = {}, {}
        for effect, n, p in friction.effects:
            n_state = native.Joint([(effect, n, p)]).n_state - native.ANCHOR
            uses.append((effects.setdefault(effect, len(effects)), n, at - first, own))
            for parameter in native.BY_NAME[effect].parameters:
                size = n if parameter.per_element else 1
                columns[name][f"{effect}.{parameter.name}"] = slice(at, at + size)
                at += size
            if n_state:
                states[name][effect] = slice(first_state + own, first_state + own + n_state)
            own += n_state
            packed.append(p)
        stiff = int(friction.stiffness > friction.limit)
        joints.append((n_uses, len(uses) - n_uses, first, at - first, first_state, own, stiff))
        names.append(name)
        dofs.append(int(model.jnt_dofadr[i]))
        places.append(int(model.jnt_qposadr[i]))
        first, first_state = at, first_state + own
    if not names:
        raise ModelError("no joint of the model has friction of gms_mujoco; put it on with gms_mujoco.attach")
    return Layout(
        _bare(model), tuple(names), tuple(dofs), tuple(places), tuple(effects), tuple(joints), tuple(uses),
        np.concatenate(packed), columns, states, first_state,
    )  # fmt: skip


def damps_at_the_end(disabled: int, euler: bool) -> bool:
    """Whether MuJoCo takes the damping of joints at the end of a step, torque -D v+ where qfrc_passive has -D v.

    Args:
        disabled: flags of `opt.disableflags`.
        euler: whether the integrator is Euler.
    """
    off = mujoco.mjtDisableBit
    return not (disabled & off.mjDSBL_DAMPER or (euler and disabled & off.mjDSBL_EULERDAMP))


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    bare = copy.copy(model)
    if native.library.gms_engine_strip(bare._address):
        raise EngineError(
            "the model has other plug-ins beside the friction, or sensors of it, which run in MuJoCo alone: attach "
            "without sensors, and read the torque of the friction here"
        )
    return bare


def changed(
    layout: Layout, table: NDArray[np.float64], joint: str, values: Mapping[str, ArrayLike], nworld: int
) -> NDArray[np.float64]:
    """Parameters of `nworld` worlds with some of one joint changed.

    Args:
        table: (1 or nworld, n_parameter), one row where all worlds have the same.
        joint: its name.
        values: of "effect.parameter", a number or (n,) for all worlds, (nworld,) or (nworld, n) for each.

    Returns:
        (1 or nworld, n_parameter).

    Raises:
        ModelError: no such joint or parameter, another shape, or values that the effect does not take.
    """
    given = {key: _rows(layout.column(joint, key), joint, key, v, nworld) for key, v in values.items()}
    alone = len(table) == 1 and all((rows == rows[:1]).all() for rows in given.values())
    table = np.repeat(table, 1 if alone or len(table) > 1 else nworld, axis=0)
    for key, rows in given.items():
        table[:, layout.column(joint, key)] = rows[: len(table)]
    for effect in {key.split(".")[0] for key in given}:
        _validate(layout, table, joint, effect)
    return table


def _rows(columns: slice, joint: str, key: str, values: ArrayLike, nworld: int) -> NDArray[np.float64]:
    size = columns.stop - columns.start
    given: NDArray[np.float64] = np.asarray(values, float)
    if size == 1 and given.shape == (nworld,):
        given = given[:, None]
    if given.shape not in ((), (size,), (nworld, size)):
        raise ModelError(f"{key} of {joint!r} has shape {given.shape}; expected ({size},) or ({nworld}, {size})")
    return np.broadcast_to(given, (nworld, size))


def _validate(layout: Layout, table: NDArray[np.float64], joint: str, effect: str) -> None:
    declared = native.BY_NAME[effect].parameters
    own = {p.name: table[:, layout.column(joint, f"{effect}.{p.name}")] for p in declared}
    for p in declared:
        values = own[p.name]
        bad = ~((values >= p.lower) & (values <= p.upper) & np.isfinite(values))
        if bad.any():
            wrong = values[bad][0]
            raise ModelError(f"{effect}.{p.name} must lie in {p.span} {p.unit}; {wrong:g} given")
        if p.at_least and (values < own[p.at_least]).any():
            raise ModelError(f"{effect}.{p.name} must be at least {p.at_least} in every world")
        if p.share and (np.abs(values.sum(axis=1) - 1) > 1e-6).any():
            raise ModelError(f"{effect}.{p.name} must sum to 1 in every world")
