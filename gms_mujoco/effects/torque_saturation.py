"""Limit of the torque that the drive can deliver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect
from ..parameter import Parameter

if TYPE_CHECKING:
    import mujoco


class TorqueSaturation(Effect):
    """Drive that delivers no more than its limit: tau = min(max(u, -L), L)."""

    name = "torque_saturation"
    kind = "drive"
    doc = (
        "Drive that delivers no more than its limit, tau = min(max(u, -L), L): the current limit of the amplifier, or\n"
        "the supply voltage at low speed. It matters only where the record logs the torque that was asked for.\n"
        "There is no strength: a limit above the largest command is the same as none.\n"
        "Source: Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems (2010), actuator saturation."
    )
    signature = "The torque error is zero up to a certain command, and grows one to one beyond it."
    experiment = "Commands up to the largest the axis will see, sudden ones included."
    parameters = (Parameter("limit", "N m", lower=0.0, doc="L, largest torque either way"),)

    def deliver(self, time: NDArray[np.float64], command: NDArray[np.float64]) -> NDArray[np.float64]:
        """The command within the limit."""
        limit = float(self.values["limit"])  # type: ignore[arg-type]
        return np.clip(command, -limit, limit)

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Sets MuJoCo's own limit on the sum of the actuator forces on the joint; a tighter one there stays."""
        limit, j = float(self.values["limit"]), spec.joint(joint)  # type: ignore[arg-type]
        low, high = (-limit, limit)
        if j.actfrclimited == 1 or (j.actfrclimited == 2 and j.actfrcrange[0] < j.actfrcrange[1]):
            low, high = max(low, j.actfrcrange[0]), min(high, j.actfrcrange[1])
        j.actfrclimited = 1
        j.actfrcrange = [low, high]

    @classmethod
    def found(cls, spec: mujoco.MjSpec, joint: str) -> Self | None:
        """The limit of the actuator forces on the joint, where it is the same either way."""
        j = spec.joint(joint)
        low, high = j.actfrcrange
        limited = j.actfrclimited == 1 or (j.actfrclimited == 2 and low < high)
        return cls(limit=high) if limited and low == -high else None
