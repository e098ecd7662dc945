"""The duty below which a servo never goes while it has an error to remove."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from ..effect import Effect
from ..parameter import Parameter

if TYPE_CHECKING:
    import mujoco


class LeastDuty(Effect):
    """Duty that a position loop adds in the direction of its error, so that a small one overcomes friction."""

    name = "least_duty"
    kind = "controller"
    doc = (
        "Duty u0 sign(g - q) that the firmware of a servo adds to that of its position loop: the start-up force of\n"
        "bus servos, meant to overcome dry friction at a small error.\n"
        "It acts on runs of a servo, beside `position_loop`; MuJoCo's actuators have nothing like it.\n"
        "Source: Feetech, memory table of the STS series, register 24 (minimum startup force)."
    )
    signature = "The servo stops nearer to its goal than its gain and its friction allow, most at low gain."
    experiment = "Slow ramps of the goal up and down at low gain, under load."
    parameters = (Parameter("duty", "1", 0.0, lower=0.0, upper=1.0, doc="u0"),)

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Warns that it is left out."""
        if self.values["duty"]:
            warnings.warn(
                f"least_duty is left out of joint {joint!r}: MuJoCo has no element for it",
                stacklevel=5,
            )
