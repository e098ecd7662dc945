"""The position loop and the motor of a servo that is told where to go, not how hard to push."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..effect import Effect, actuators_of
from ..errors import ModelError
from ..parameter import Parameter

if TYPE_CHECKING:
    import mujoco

_SUPPLY = 1.0  # V; duty is voltage over supply, and only their product with the motor's constants can be seen


class PositionLoop(Effect):
    """Servo that closes its own position loop: duty from the error of the position, torque from duty and velocity."""

    name = "position_loop"
    kind = "controller"
    doc = (
        "Servo with its own position loop, as hobby and bus servos have it:\n"
        "g follows the goal at the goal speed at most; duty u = K c (g - q), within -U..U;\n"
        "tau = T u - D q' while the bridge is on, and nothing while it is off.\n"
        "T and D are the motor's: T = k V / R and D = k^2 / R with torque constant k, supply V and resistance R, all\n"
        "behind the gear. D is drag that only a powered motor has; what is left without power is `viscous`.\n"
        "It acts in MuJoCo, as a `dcmotor` that takes the goal, and on runs of a servo.\n"
        "Source: Krishnan, Electric Motor Drives (2001), chapter 2 (d.c. machine); MuJoCo's dcmotor."
    )
    signature = "The position lags the goal and creeps to it, or stops short of it under load."
    experiment = "Steps and sines of the goal with two payloads, at several loop gains, and releases of the torque."
    parameters = (
        Parameter("gain", "1", 32.0, lower=0.0, free=False, doc="K, loop gain as set in the servo"),
        Parameter("duty_per_rad", "1/rad", lower=1e-9, doc="c, duty per unit of gain and error"),
        Parameter("stall_torque", "N m", lower=1e-9, doc="T, torque at full duty and standstill"),
        Parameter("electrical_drag", "N m s/rad", lower=1e-9, doc="D, of the back-EMF, while the bridge is on"),
        Parameter("goal_speed", "rad/s", lower=1e-9, doc="speed at which the inner goal follows, at most"),
        Parameter("duty_limit", "1", 1.0, lower=1e-3, upper=1.0, free=False, doc="U, largest duty"),
    )

    def edit(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Gives the joint MuJoCo's own `dcmotor`, whose control is the goal [rad], named after the joint.

        Its inner goal begins at 0: set `data.act` where the joint begins elsewhere. Disabling its actuator group is
        switching the bridge off. The inertia of the plant belongs in the `armature` of the joint, without which the
        loop is unstable at usual time steps.

        Raises:
            ModelError: an actuator acts on the joint already.
        """
        import mujoco

        if actuators_of(spec, joint):
            raise ModelError(f"joint {joint!r} has an actuator already; position_loop brings its own")
        v = {k: float(x) for k, x in self.values.items()}  # type: ignore[arg-type]
        actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        constant = v["electrical_drag"] * _SUPPLY / v["stall_torque"]
        # dcmotor asks its controller for a torque and cancels the back-EMF within the supply: the derivative gain
        # takes that back.
        actuator.set_to_dcmotor(
            motorconst=[constant, 0.0],
            resistance=constant**2 / v["electrical_drag"],
            controller=[
                v["gain"] * v["duty_per_rad"] * v["stall_torque"], 0.0, v["electrical_drag"], v["goal_speed"], 0.0,
                v["duty_limit"] * _SUPPLY,
            ],
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
        )  # fmt: skip
