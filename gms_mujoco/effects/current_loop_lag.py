"""Lag of the drive's current loop."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect, actuators_of
from ..errors import ModelError
from ..parameter import Parameter

if TYPE_CHECKING:
    import mujoco


class CurrentLoopLag(Effect):
    """First-order lag of the drive: T dtau/dt = u - tau, with u held from each sample to the next."""

    name = "current_loop_lag"
    kind = "drive"
    doc = (
        "First-order lag of the drive, T dtau/dt = u - tau: a current loop of bandwidth 1/(2 pi T).\n"
        "For a command held over each sample, with e = exp(-h/T): tau[k+1] = u[k] + (tau[k] - u[k]) e, and the mean\n"
        "torque over sample k is u[k] + (tau[k] - u[k]) (1 - e) T/h. Shorter than a sample it looks like `delay`.\n"
        "Source: closed current loop, e.g. Leonhard, Control of Electrical Drives (2001)."
    )
    signature = "The error is large where the command changes fast, and decays within a few T of each step."
    experiment = "Steps of torque, and excitation up to high frequency: phase and gain of torque to acceleration fall."
    parameters = (Parameter("time", "s", 0.0, lower=0.0, upper=0.05, doc="T, time constant"),)

    def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean torque over each sample; before the first the command is taken to have been the first one."""
        lag = float(self.values["time"])  # type: ignore[arg-type]
        if len(time) < 2 or lag == 0:
            return command
        step = (time[-1] - time[0]) / (len(time) - 1)
        left = math.exp(-step / lag)
        # tau[k+1] = left tau[k] + (1 - left) u[k], from tau[0] = u[0]
        torque = scipy.signal.lfilter([0.0, 1 - left], [1.0, -left], command, zi=[command[0]])[0]
        return command + (torque - command) * -math.expm1(-step / lag) * lag / step

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Gives the motors of the joint MuJoCo's own first-order filter, right to half a time step.

        Raises:
            ModelError: no actuator acts on the joint, or one has dynamics of its own or is a servo, whose force a
                filter of its control does not lag.
        """
        import mujoco

        lag = float(self.values["time"])  # type: ignore[arg-type]
        if lag == 0:
            return
        acting = actuators_of(spec, joint)
        if not acting:
            raise ModelError(f"current_loop_lag needs an actuator on joint {joint!r}; the model has none there")
        for a in acting:
            if a.dyntype != mujoco.mjtDyn.mjDYN_NONE:
                kind = mujoco.mjtDyn(a.dyntype).name[6:].lower()
                raise ModelError(f"actuator {a.name!r} has dynamics of its own ({kind}); current_loop_lag cannot act")
            if a.biastype != mujoco.mjtBias.mjBIAS_NONE or a.gaintype != mujoco.mjtGain.mjGAIN_FIXED:
                raise ModelError(
                    f"actuator {a.name!r} makes its force from more than its control; current_loop_lag needs a motor"
                )
            a.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            a.dynprm[0] = lag
            a.actearly = True  # without, a lag of nothing would still be a time step

    @classmethod
    def found(cls, spec: mujoco.MjSpec, joint: str) -> Self | None:
        """The slowest first-order filter of a motor of the joint."""
        import mujoco

        filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
        motors = (
            a
            for a in actuators_of(spec, joint)
            if a.dyntype in filters and a.biastype == mujoco.mjtBias.mjBIAS_NONE
        )
        lag = max((float(a.dynprm[0]) for a in motors), default=0.0)
        return cls(time=lag) if lag > 0 else None
