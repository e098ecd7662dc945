"""Delay between the torque that is commanded and the torque that acts."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect, actuators_of
from ..errors import ModelError
from ..parameter import Parameter

if TYPE_CHECKING:
    import mujoco


class Delay(Effect):
    """Transport delay of the drive: tau(t) = u(t - T), with u held from each sample to the next."""

    name = "delay"
    kind = "drive"
    doc = (
        "Transport delay of the drive, tau(t) = u(t - T): computation, bus and current loop pass the command on late.\n"
        "For a command held over each sample the mean torque over sample k is (1 - f) u[k-m] + f u[k-m-1], where\n"
        "T is m + f samples. Of a servo that takes a goal, the goal and the power arrive late.\n"
        "Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems (1998), systems with delay."
    )
    signature = "The error is large where the command changes fast, and looks like its derivative."
    experiment = "Excitation up to high frequency: the phase of torque to acceleration falls in proportion to it."
    parameters = (Parameter("time", "s", 0.0, lower=0.0, upper=1.0, doc="T, from command to torque"),)

    def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean torque over each sample; before the first the command is taken to have been the first one."""
        if len(time) < 2:
            return command
        step = (time[-1] - time[0]) / (len(time) - 1)
        whole, part = divmod(float(self.values["time"]) / step, 1.0)  # type: ignore[arg-type]
        late = np.arange(len(command)) - int(whole)
        return (1 - part) * command[np.maximum(late, 0)] + part * command[np.maximum(late - 1, 0)]

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Gives the actuators of the joint MuJoCo's own delay, of the same mean torque per time step.

        Below one time step MuJoCo knows no delay but none and a whole step: the nearer one is taken, with a warning. It
        keeps as many past commands as the time step takes that the model has now: set that before.

        Raises:
            ModelError: no actuator acts on the joint, or one has a delay already.
        """
        time, step = float(self.values["time"]), spec.option.timestep  # type: ignore[arg-type]
        if 0 < time < step:
            nearest = step if time >= step / 2 else 0.0
            warnings.warn(
                f"delay.time {time:g} s is shorter than the time step {step:g} s and becomes {nearest:g} s on joint "
                f"{joint!r}",
                stacklevel=5,
            )
            time = nearest
        if time == 0:
            return
        acting = actuators_of(spec, joint)
        if not acting:
            raise ModelError(f"delay needs an actuator on joint {joint!r}; the model has none there")
        for a in acting:
            if a.delay > 0:
                raise ModelError(f"actuator {a.name!r} has a delay of {a.delay:g} s already")
            a.delay = time
            a.interp = 1  # between two samples of the command: the mean over the time step
            a.nsample = max(a.nsample, math.ceil(time / step) + 1)

    @classmethod
    def found(cls, spec: mujoco.MjSpec, joint: str) -> Self | None:
        """The longest delay of the actuators of the joint."""
        time = max((a.delay for a in actuators_of(spec, joint)), default=0.0)
        return cls(time=time) if time > 0 else None
