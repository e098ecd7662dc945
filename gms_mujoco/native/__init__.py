"""The native library: the catalogue of effects written in C++, and joints built from them.

It knows no particular law. `Joint` replays a joint's effects along a given motion; the MuJoCo plug-in runs the
same code inside the engine.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, ModelError, listing
from ..parameter import Parameter
from ..threads import at_hand

Array = NDArray[np.float64]

_SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
LIBRARY_PATH = Path(__file__).parent / f"libgms_mujoco{_SUFFIX}"
_MAX_PARAMETERS = 12
_MOST_INSTANTS = 24  # per sample


class _Parameter(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
        ("fallback", ctypes.c_double),
        ("lower", ctypes.c_double),
        ("upper", ctypes.c_double),
        ("per_element", ctypes.c_bool),
        ("free", ctypes.c_bool),
        ("doc", ctypes.c_char_p),
        ("share", ctypes.c_bool),
        ("at_least", ctypes.c_char_p),
    )


class _Effect(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("class_name", ctypes.c_char_p),
        ("kind", ctypes.c_char_p),
        ("doc", ctypes.c_char_p),
        ("signature", ctypes.c_char_p),
        ("experiment", ctypes.c_char_p),
        ("parameters", _Parameter * _MAX_PARAMETERS),
        ("n_state", ctypes.c_void_p),
        ("n_memory", ctypes.c_void_p),
        ("recall", ctypes.c_void_p),
        ("modulate", ctypes.c_void_p),
        ("torque", ctypes.c_void_p),
        ("elements", ctypes.c_void_p),
        ("turns_round", ctypes.c_bool),
        ("torques", ctypes.c_void_p),
        ("alternatives", ctypes.c_void_p),
    )


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(LIBRARY_PATH))
    except OSError as error:
        raise EngineError(
            f"the native library {LIBRARY_PATH.name} cannot be loaded ({error}); reinstall with 'pip install .'"
        ) from None
    pointer, integer, real = ctypes.c_void_p, ctypes.c_int, ctypes.c_double
    for name, result, arguments in (
        ("gms_n_effects", integer, ()),
        ("gms_effect", ctypes.POINTER(_Effect), (integer,)),
        ("gms_joint_new", pointer, ()),
        ("gms_joint_delete", None, (pointer,)),
        ("gms_joint_add", integer, (pointer, integer, integer, pointer)),
        ("gms_joint_n_state", integer, (pointer,)),
        ("gms_joint_n_memory", integer, (pointer,)),
        ("gms_joint_replay", None, (pointer, integer) + (pointer,) * 9),
        ("gms_joint_elements", None, (pointer, integer, integer) + (pointer,) * 7),
        (
            "gms_joints_changes",
            None,
            (pointer,) + (integer,) * 4 + (pointer,) * 8 + (integer, pointer, integer, integer, integer, pointer),
        ),
        ("gms_joint_cycle", integer, (pointer, integer, integer, integer, integer) + (pointer,) * 4),
        ("gms_joint_mean", integer, (pointer, integer) + (pointer,) * 6 + (real, pointer, pointer, integer)),
        (
            "gms_joint_simulate",
            integer,
            (pointer, integer, integer, integer, real, real, real) + (pointer,) * 6 + (real, real) + (pointer,) * 4,
        ),
        (
            "gms_servo_simulate",
            integer,
            (pointer, integer, real, real, real, real, pointer, real, integer) + (pointer,) * 5,
        ),
        ("gms_series_mean", None, (integer, pointer, integer, pointer, pointer)),
        ("gms_series_band", None, (integer, pointer, integer, integer, integer, pointer, pointer)),
        ("gms_engine_symbols", ctypes.POINTER(ctypes.c_char_p), (pointer,)),
        ("gms_engine_init", integer, (pointer, ctypes.c_char_p, integer)),
        ("gms_engine_read", ctypes.c_char_p, (pointer, pointer, integer, integer) + (pointer,) * 4),
        ("gms_engine_strip", integer, (pointer,)),
        ("gms_engine_effect", pointer, (pointer, pointer, integer, integer) + (pointer,) * 4),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


library = _load()


@dataclass(frozen=True)
class Declaration:
    """What an effect's source file says of itself."""

    index: int
    name: str
    class_name: str
    kind: str
    doc: str
    signature: str
    experiment: str
    parameters: tuple[Parameter, ...]
    modulates: bool
    has_torque: bool
    separable: bool  # its elements do not know of each other


def _declaration(index: int) -> Declaration:
    e = library.gms_effect(index).contents
    parameters = tuple(
        Parameter(
            p.name.decode(), p.unit.decode(), p.fallback, p.lower, p.upper, p.free, p.per_element, p.share,
            (p.at_least or b"").decode(), p.doc.decode()
        )
        for p in e.parameters
        if p.name
    )
    texts = {k: getattr(e, k).decode() for k in ("name", "class_name", "kind", "doc", "signature", "experiment")}
    return Declaration(
        index, **texts, parameters=parameters,
        modulates=bool(e.modulate), has_torque=bool(e.torque), separable=bool(e.elements),
    )  # fmt: skip


DECLARATIONS = tuple(_declaration(i) for i in range(library.gms_n_effects()))
BY_NAME = {d.name: d for d in DECLARATIONS}
ANCHOR = 2  # numbers of a joint's state before those of its effects


def _address(array: Array | None) -> Any:
    return None if array is None else array.ctypes.data


@dataclass(frozen=True)
class Replay:
    """Torque of a joint along a motion.

    Attributes:
        torque: (n,) torque on the joint [N m].
        parts: (n, n_effects) the share of each effect [N m].
        states: (n, n_state) state after each sample, or None where not asked for.
    """

    torque: Array
    parts: Array | None = None
    states: Array | None = None


@dataclass(frozen=True)
class Motion:
    """Simulated motion of an axis at its samples; NaN after an instant at which it ran away.

    Attributes:
        position, velocity: (n,) [rad], [rad/s].
        friction: (n,) torque of the effects from each sample on [N m].
        states: (n, n_state) state at each sample, or None where not asked for.
    """

    position: Array
    velocity: Array
    friction: Array
    states: Array | None = None


# How the effects enter a time step: see Joint.simulate.
INTEGRATION = {"auto": -1, "explicit": 0, "implicit": 1}


class Reading(NamedTuple):
    """Where a joint's friction stands in `plugin_state`.

    Attributes:
        torque: place of the torque.
        states: (effect, begin, end) of each effect with state.
        load: place of the load; None where its friction does not depend on it.
    """

    torque: int
    states: list[tuple[str, int, int]]
    load: int | None


def reading(model: int, data: int, joint: int) -> Reading | None:
    """Where a joint's friction stands in `plugin_state` of a MuJoCo model; None for a joint without friction.

    Args:
        model, data: addresses of the mjModel and the mjData.
        joint: id of a hinge or slide joint.
    """
    torque, load, begin, end = ctypes.c_int(), ctypes.c_int(), ctypes.c_int(), ctypes.c_int()
    found: list[tuple[str, int, int]] = []
    i = 0
    places = tuple(map(ctypes.byref, (torque, load, begin, end)))
    while name := library.gms_engine_read(model, data, joint, i, *places):
        if end.value > begin.value:
            found.append((name.decode(), begin.value, end.value))
        i += 1
    return None if torque.value < 0 else Reading(torque.value, found, load.value if load.value >= 0 else None)


@dataclass(frozen=True)
class Attached:
    """Friction of a joint as it stands in a MuJoCo model.

    Attributes:
        effects: (name, number of elements, packed parameters) of each.
        stiffness: time step times slope over inertia; negative where an explicit step is asked for, infinite where an
            implicit one is.
        limit: of the stiffness for an explicit step.
    """

    effects: list[tuple[str, int, Array]]
    stiffness: float
    limit: float


def attached(model: int, data: int, joint: int) -> Attached | None:
    """The friction of a joint of a MuJoCo model, given by addresses as for `reading`; None where it has none."""
    effect, n, stiffness, limit = ctypes.c_int(), ctypes.c_int(), ctypes.c_double(), ctypes.c_double()
    found: list[tuple[str, int, Array]] = []
    out = [ctypes.byref(x) for x in (effect, n, stiffness, limit)]
    while address := library.gms_engine_effect(model, data, joint, len(found), *out):
        declared = DECLARATIONS[effect.value]
        size = sum(n.value if p.per_element else 1 for p in declared.parameters)
        found.append((declared.name, n.value, np.array((ctypes.c_double * size).from_address(address))))
    return Attached(found, stiffness.value, limit.value) if found else None


class Joint:
    """The native effects of one joint.

    Args:
        effects: (name, number of elements, packed parameters) of each.
    """

    def __init__(self, effects: Sequence[tuple[str, int, Array]]) -> None:
        self._effects = list(effects)
        self.handle = library.gms_joint_new()
        self.n_effects = len(effects)
        self.counts = [n for _, n, _ in effects]
        self.names = [name for name, _, _ in effects]
        self.kinds = [BY_NAME[name].kind for name, _, _ in effects]
        for name, n, packed in effects:
            p = np.ascontiguousarray(packed, float)
            if library.gms_joint_add(self.handle, BY_NAME[name].index, n, _address(p)):
                raise EngineError(f"{name} with {n} elements needs more state than a joint holds")
        self.n_state: int = library.gms_joint_n_state(self.handle)
        self.n_memory: int = library.gms_joint_n_memory(self.handle)

    def __del__(self) -> None:
        if getattr(self, "handle", None) and library is not None:
            library.gms_joint_delete(self.handle)

    def __reduce__(self) -> tuple[type[Joint], tuple[list[tuple[str, int, Array]]]]:
        """A copy has a handle of its own."""
        return Joint, (self._effects,)

    def replay(
        self,
        time: Array,
        position: Array,
        velocity: Array,
        load: Array | None = None,
        temperature: Array | None = None,
        memory: Array | None = None,
        parts: bool = False,
        states: bool = False,
    ) -> Replay:
        """Torque along a given motion.

        Args:
            time, position, velocity: (n,) in [s], [rad], [rad/s].
            load: (n,) normal load or transmitted torque [N m], optional.
            temperature: (n,) [degC], optional.
            memory: (n_memory,) state before the first sample, each in [-1, 1] of its level, of a
                flexible coupling deflections [rad]; None: never moved.
            parts, states: whether to return the share of each effect and the states.

        Raises:
            ModelError: an array of another length.
        """
        n, inputs = self._motion(time, position, velocity, load, temperature, memory)
        torque = np.empty(n)
        shares = np.empty((n, self.n_effects)) if parts else None
        history = np.empty((n, self.n_state)) if states else None
        library.gms_joint_replay(
            self.handle, n, *map(_address, inputs), _address(torque), _address(shares), _address(history)
        )
        return Replay(torque, shares, history)

    def _motion(self, time: Array, *others: Array | None) -> tuple[int, list[Array | None]]:
        """Number of samples of a motion, and its arrays as the library reads them, which does not look at lengths."""
        names = ("time", "position", "velocity", "load", "temperature", "memory")
        inputs = [None if a is None else np.ascontiguousarray(a, float) for a in (time, *others)]
        n = np.size(time)
        for name, given in zip(names, (time, *others), strict=True):
            shape = (self.n_memory if name == "memory" else n,)
            if given is not None and np.shape(given) != shape:
                raise ModelError(f"{name} has shape {np.shape(given)}, expected {shape}")
        return n, inputs

    def elements(
        self,
        effect: int,
        time: Array,
        position: Array,
        velocity: Array,
        load: Array | None = None,
        temperature: Array | None = None,
        memory: Array | None = None,
    ) -> Array:
        """Torque of each element of a separable effect along a given motion.

        Args:
            effect: its number among the effects of the joint.
            time, position, velocity, load, temperature, memory: as for `replay`.

        Returns:
            (n, elements) [N m].
        """
        n, inputs = self._motion(time, position, velocity, load, temperature, memory)
        torque = np.empty((n, self.counts[effect]))
        library.gms_joint_elements(self.handle, effect, n, *map(_address, inputs), _address(torque))
        return torque

    def cycle(self, period: Array, position: Array, velocity: Array, effect: int | None = None) -> Array:
        """Torque along periodic motions, in the steady state [N m].

        The axis is warm, carries no load, and everything that fades has faded; a body behind a coupling swings as it
        does after a long time.

        Args:
            period: (c,) of each motion [s].
            position, velocity: (c, n) at n equal steps of one period [rad], [rad/s].
            effect: number of a separable effect of the joint, for the torque of its elements; None: of all.

        Returns:
            (c, n), or (c, elements, n).
        """
        inputs = [np.ascontiguousarray(a, float) for a in (period, position, velocity)]
        shape = inputs[1].shape
        torque = np.empty(shape if effect is None else (shape[0], self.counts[effect], shape[1]))
        use = -1 if effect is None else effect
        library.gms_joint_cycle(self.handle, use, at_hand(), *shape, *map(_address, inputs), _address(torque))
        return torque

    def mean(
        self,
        time: Array,
        position: Array,
        velocity: Array,
        load: Array | None = None,
        temperature: Array | None = None,
        memory: Array | None = None,
        tolerance: float = np.inf,
    ) -> tuple[Array, Array]:
        """Mean torque around each sample, with a weight that falls linearly to zero at the samples beside it.

        Between samples the motion is the cubic of their
        positions and velocities. The torque runs straight from sample to sample unless it bends there (an element
        slips, the motion reverses): then the interval is halved until the torque is straight.

        Args:
            time, position, velocity, load, temperature, memory: as for `replay`.
            tolerance: by how much the torque in the middle of an interval, times the part of a sample that it lasts,
                may be off the straight line [N m]; infinite: only a reversal is looked at.

        Returns:
            (n,) mean torque, at the first and the last sample the torque itself [N m]; and the instants between which
            the torque was taken as straight, in samples from the first.

        Raises:
            ModelError: an array of another length.
        """
        n, inputs = self._motion(time, position, velocity, load, temperature, memory)
        torque, instants = np.empty(n), np.empty(_MOST_INSTANTS * n)
        count = library.gms_joint_mean(
            self.handle, n, *map(_address, inputs), tolerance, _address(torque), _address(instants), len(instants)
        )
        return torque, instants[:count].copy()

    def simulate(
        self,
        inertia: float,
        sample_time: float,
        torque: Array,
        position: float = 0.0,
        velocity: float = 0.0,
        substeps: int = 1,
        start: float = 0.0,
        load: Array | None = None,
        temperature: Array | None = None,
        memory: Array | None = None,
        state: Array | None = None,
        integration: str = "auto",
        states: bool = False,
        path: Array | None = None,
        near: float = 0.0,
        pull: float = 0.0,
    ) -> Motion:
        """Motion of one axis under a torque that is held from each sample to the next.

        Semi-implicit Euler like MuJoCo's: with one substep it is the plug-in's trajectory of a bare hinge, bit for
        bit. The effects are taken at the beginning of a step ("explicit"), or by backward Euler ("implicit"),
        which holds without creep under a static law and stays bounded at any step; "auto" takes the implicit
        way where h^2 k + h sigma exceeds the inertia, the explicit one being more accurate below.

        Args:
            inertia: [kg m^2].
            sample_time: [s].
            torque: (n,) [N m].
            position, velocity: at the first sample [rad], [rad/s].
            substeps: time steps per sample.
            start: time of the first sample [s].
            load, temperature: (n,) [N m], [degC], optional, held like the torque.
            memory: (n_memory,) state before the first sample, each in [-1, 1] of its level, of a
                flexible coupling deflections [rad]; None: never moved.
            state: (n_state,) state at the first sample, one of those a replay returns, instead of `memory`.
            integration: "auto", "explicit" or "implicit".
            states: whether to return the states.
            path: (n,) positions to stay near [rad], optional.
            near: distance from the path within which the motion is free [rad].
            pull: natural frequency of the critically damped spring that pulls back what strays further [rad/s].

        Raises:
            ModelError: inertia, sample time or substeps is not positive, or the integration is unknown.
        """
        if not (inertia > 0 and sample_time > 0 and substeps > 0):
            raise ModelError(
                "inertia [kg m^2], sample_time [s] and substeps must be positive; "
                f"{inertia:g}, {sample_time:g} and {substeps} given"
            )
        if integration not in INTEGRATION:
            raise ModelError(f"integration must be one of {listing(INTEGRATION)}; {integration!r} given")
        inputs = [
            None if a is None else np.ascontiguousarray(a, float)
            for a in (torque, load, temperature, memory, state, path)
        ]
        n = len(torque)
        q, v, friction = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
        history = np.full((n, self.n_state), np.nan) if states else None
        q[:1], v[:1] = position, velocity
        library.gms_joint_simulate(
            self.handle,
            n,
            substeps,
            INTEGRATION[integration],
            sample_time,
            inertia,
            start,
            *map(_address, inputs),
            near,
            pull,
            *map(_address, (q, v, friction, history)),
        )
        return Motion(q, v, friction, history)

    def simulate_servo(
        self,
        inertia: float,
        rotor: float,
        weight: float,
        loop: Array,
        delay: float,
        step: float,
        time: Array,
        goal: Array,
        powered: Array,
        position: float = 0.0,
        velocity: float = 0.0,
    ) -> Motion:
        """Motion of a servo that closes its own position loop, with a pendulum on its shaft.

        The friction is that of this joint; its load is the torque that the gear transmits.

        Args:
            inertia: of all that moves [kg m^2].
            rotor: the part of it before the gear [kg m^2].
            weight: A of the torque -A sin(q) of the payload [N m].
            loop: parameters of the effect position_loop in the order of its table, then the least duty.
            delay: after which goal and power act [s].
            step: [s].
            time: (n,) of the samples [s].
            goal: (n,) position asked for, from each sample to the next [rad].
            powered: (n,) 1 where the motor bridge is on, else 0.
            position, velocity: at the first sample [rad], [rad/s].

        Returns:
            Position and velocity at the beginning of each step, from the first sample to beyond the last; the friction
            is not recorded.

        Raises:
            ModelError: inertia or step is not positive, or the delay is negative.
        """
        if not (inertia > 0 and step > 0 and delay >= 0):
            raise ModelError(
                "inertia [kg m^2] and step [s] must be positive, and delay [s] not negative; "
                f"{inertia:g}, {step:g} and {delay:g} given"
            )
        numbers, *inputs = [np.ascontiguousarray(a, float) for a in (loop, time, goal, powered)]
        n = int((time[-1] - time[0]) / step) + 2
        q, v = np.full(n, np.nan), np.full(n, np.nan)
        q[:1], v[:1] = position, velocity
        library.gms_servo_simulate(
            self.handle, n, step, inertia, rotor, weight, _address(numbers), delay, len(inputs[0]),
            *map(_address, (*inputs, q, v)),
        )  # fmt: skip
        return Motion(q, v, np.full(n, np.nan))
