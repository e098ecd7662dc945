"""The effects of one joint: their torque along a motion that is given, and the motion under a torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import effort
from ..errors import ModelError, listing
from ..threads import at_hand
from .shared_library import BY_NAME, address, library

Array = NDArray[np.float64]

_MOST_INSTANTS = 24  # per sample
_AT_ANY_INSTANT = 4  # elements of friction that take as long as what is done at an instant whatever acts on a joint
_WITHOUT_ELEMENTS = 7  # the same of a law of friction that has a state and no elements


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
            if most := library.gms_joint_add(self.handle, BY_NAME[name].index, n, address(p)):
                raise ModelError(f"{name} with {n} elements needs more state than the {most} numbers of a joint")
        self.n_state: int = library.gms_joint_n_state(self.handle)
        self.n_memory: int = library.gms_joint_n_memory(self.handle)
        # Of one instant, in elements; laws of friction without any have more to do.
        laws = [d for d in map(BY_NAME.__getitem__, self.names) if d.kind == "friction" and not d.modulates]
        without = sum(d.has_state and not d.separable for d in laws)
        self.work = _AT_ANY_INSTANT + sum(self.counts) + _WITHOUT_ELEMENTS * without

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
            memory: (n_memory,) state before the first sample, each in [-1, 1] of what friction holds there in that
                direction, of a flexible coupling deflections [rad]; None: never moved.
            parts, states: whether to return the share of each effect and the states.

        Raises:
            ModelError: an array of another length.
        """
        n, inputs = self._motion(time, position, velocity, load, temperature, memory)
        effort.add(n * self.work)
        torque = np.empty(n)
        shares = np.empty((n, self.n_effects)) if parts else None
        history = np.empty((n, self.n_state)) if states else None
        library.gms_joint_replay(
            self.handle, n, *map(address, inputs), address(torque), address(shares), address(history)
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
        effort.add(n * self.work)
        torque = np.empty((n, self.counts[effect]))
        library.gms_joint_elements(self.handle, effect, n, *map(address, inputs), address(torque))
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
        effort.add(inputs[1].size * self.work)
        library.gms_joint_cycle(self.handle, use, at_hand(), *shape, *map(address, inputs), address(torque))
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
            self.handle, n, *map(address, inputs), tolerance, address(torque), address(instants), len(instants)
        )
        effort.add(count * self.work)
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
            memory: (n_memory,) state before the first sample, as for `replay`; None: never moved.
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
        effort.add(n * substeps * self.work)
        q[:1], v[:1] = position, velocity
        library.gms_joint_simulate(
            self.handle,
            n,
            substeps,
            INTEGRATION[integration],
            sample_time,
            inertia,
            start,
            *map(address, inputs),
            near,
            pull,
            *map(address, (q, v, friction, history)),
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
        effort.add(n * self.work)
        q[:1], v[:1] = position, velocity
        library.gms_servo_simulate(
            self.handle, n, step, inertia, rotor, weight, address(numbers), delay, len(inputs[0]),
            *map(address, (*inputs, q, v)),
        )  # fmt: skip
        return Motion(q, v, np.full(n, np.nan))
