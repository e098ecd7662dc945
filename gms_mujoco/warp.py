"""Friction on MuJoCo Warp: thousands of worlds at once, on a GPU or a CPU.

    model = gms.attach("robot.xml", {"*": plant}).compile()
    m, friction = gms_mujoco.warp.put_model(model, nworld=4096)
    d = mujoco_warp.make_data(model, nworld=4096)
    mujoco_warp.step(m, d)

The friction is a kernel behind the passive forces of `mujoco_warp`, which runs the same C++ as the plug-in. Its state
moves on at the first evaluation at a later time; repeated evaluations at one time change nothing. Needs
`pip install 'gms-mujoco[warp]'`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import batched
from .errors import EngineError, ModelError
from .kernel import evaluator, wp

try:
    import mujoco_warp as mjw
except ImportError:
    raise EngineError("friction on MuJoCo Warp needs it: pip install 'gms-mujoco[warp]'") from None


class Friction:
    """Friction of the joints of a model in `nworld` worlds.

    Attributes:
        joints: names of the joints with friction, in the order of the model.
        state: warp array (nworld, n_state) float64. Copied with what the `mujoco_warp.Data` has, it is a fork: put both
            back, and the run goes on as it did.
        parameters: warp array (1 or nworld, n_parameter) float64; `set` and `get` know what stands where.
        torque: warp array (nworld, n_joints) float64, of the last evaluation [N m].
    """

    def __init__(self, layout: batched.Layout, nworld: int, device: Any = None) -> None:
        self._layout = layout
        self.joints = layout.names
        self.nworld = nworld
        with wp.ScopedDevice(device):
            self.state = wp.array(layout.virgin(nworld), dtype=wp.float64)
            self.parameters = wp.array(layout.parameters[None], dtype=wp.float64)
            self.torque = wp.zeros((nworld, len(layout.names)), dtype=wp.float64)
            self._dofs = wp.array(layout.dofs, dtype=int)
            self._places = wp.array(layout.places, dtype=int)
        self._kernel = _kernel(layout)

    def get(self, joint: str, parameter: str) -> NDArray[np.float64]:
        """(1 or nworld, n) values of "effect.parameter" of a joint; one row where all worlds have the same."""
        return np.array(self.parameters.numpy()[:, self._layout.column(joint, parameter)])

    def set(self, joint: str, values: Mapping[str, ArrayLike]) -> None:
        """Changes parameters of a joint.

        Args:
            joint: its name.
            values: of "effect.parameter", a number or (n,) for all worlds, (nworld,) or (nworld, n) for each.

        Raises:
            ModelError: no such joint or parameter, another shape, or values that the effect does not take.

        Where worlds begin to differ `parameters` becomes another array: capture a graph after that.
        """
        table = batched.changed(self._layout, self.parameters.numpy(), joint, values, self.nworld)
        if table.shape == self.parameters.shape:
            self.parameters.assign(table)  # in place, so that a captured graph sees it
        else:
            self.parameters = wp.array(table, dtype=wp.float64, device=self.parameters.device)

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Forgets the past of some worlds, given by number or by a mask of (nworld,); None: of all.

        A world whose time goes back, as `mujoco_warp.reset_data` makes it, is reset without being told.
        """
        chosen = np.arange(self.nworld) if worlds is None else np.asarray(worlds)
        if chosen.dtype == bool and chosen.shape != (self.nworld,):
            raise ModelError(f"a mask of worlds has shape ({self.nworld},); {chosen.shape} given")
        state = np.array(self.state.numpy())
        state[chosen] = self._layout.virgin(1)
        self.state.assign(state)

    def put_state(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Gives all worlds the friction state of a MuJoCo simulation, beside `mujoco_warp.put_data` of it.

        Raises:
            ModelError: the data has other friction than the model that was put.
        """
        self.state.assign(np.tile(self._layout.state_of(model, data), (self.nworld, 1)))

    def __call__(self, m: mjw.Model, d: mjw.Data) -> None:
        """Adds the torque to `d.qfrc_passive`: what `m.callback.passive` does."""
        if d.nworld != self.nworld:
            raise ModelError(f"the data has {d.nworld} worlds, the friction was put for {self.nworld}")
        load = (m.dof_armature, d.qacc, d.qfrc_actuator, d.qfrc_damper, d.qfrc_applied, float(m.nactuator == 0))
        wp.launch(
            self._kernel,
            dim=self.torque.shape,
            inputs=[self._dofs, self._places, self.parameters, m.opt.timestep, d.time, d.qpos, d.qvel, *load],
            outputs=[self.state, self.torque, d.qfrc_passive],
            device=self.state.device,
        )


def _kernel(layout: batched.Layout) -> Any:
    evaluate = evaluator(layout, wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def friction_kernel(
        dofs: wp.array[int],
        places: wp.array[int],
        parameters: wp.array2d[wp.float64],
        timestep: wp.array[float],
        time: wp.array[float],
        qpos: wp.array2d[float],
        qvel: wp.array2d[float],
        armature: wp.array2d[float],
        qacc: wp.array2d[float],
        qfrc_actuator: wp.array2d[float],
        qfrc_damper: wp.array2d[float],
        qfrc_applied: wp.array2d[float],
        applied: float,  # 1 where no actuators drive the joints, else 0
        state: wp.array2d[wp.float64],
        torque: wp.array2d[wp.float64],
        qfrc_passive: wp.array2d[float],
    ):
        world, joint = wp.tid()  # type: ignore[misc, unused-ignore]
        dof = dofs[joint]
        f = evaluate(
            joint,
            parameters,
            world % parameters.shape[0],
            state,
            state,
            world,
            wp.float64(time[world]),
            wp.float64(timestep[world % timestep.shape[0]]),
            wp.float64(qpos[world, places[joint]]),
            wp.float64(qvel[world, dof]),
            wp.float64(qfrc_actuator[world, dof] - armature[world % armature.shape[0], dof] * qacc[world, dof]),
            wp.float64(qfrc_damper[world, dof] + applied * qfrc_applied[world, dof]),
        )
        torque[world, joint] = f
        qfrc_passive[world, dof] += float(f)

    return friction_kernel


def put_model(model: mujoco.MjModel, nworld: int = 1) -> tuple[mjw.Model, Friction]:
    """`mujoco_warp.put_model` of a model with friction, on Warp's current device.

    Args:
        model: with friction from `gms_mujoco.attach`.
        nworld: number of worlds, as for `mujoco_warp.make_data`.

    Returns:
        The model, whose `callback.passive` is the friction, and the friction. A callback of your own that takes its
        place calls `friction(m, d)`.

    Raises:
        ModelError: no joint has friction, it is too stiff for an explicit step, or the
            integrator is RK4, whose stages cannot be told from steps.
        EngineError: the model has plug-in sensors.
    """
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise ModelError("friction on MuJoCo Warp runs with Euler, implicit, implicitfast or discrete; RK4 given")
    layout = batched.lay_out(model)
    friction = Friction(layout, nworld)
    m = mjw.put_model(layout.bare)
    m.callback.passive = friction
    return m, friction
