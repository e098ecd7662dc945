"""Friction on MuJoCo Warp: thousands of worlds at once, on a GPU or a CPU.

    model = gms.attach("robot.xml", {"*": plant}).compile()
    m, friction = gms_mujoco.warp.put_model(model, nworld=4096)
    d = mujoco_warp.make_data(model, nworld=4096)
    mujoco_warp.step(m, d)

The friction is a kernel behind the passive forces of `mujoco_warp`, which runs the same C++ as the plug-in. Its state
moves on at the first evaluation at a later time; repeated evaluations at one time change nothing. Joints that are too
stiff for an explicit step are solved for together, by backward Euler, once the controls are known: behind the control
callback. Needs `pip install 'gms-mujoco[warp]'`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import batched
from .errors import EngineError, ModelError
from .kernel import GIVEN, POSITION, PUSH, VELOCITY, evaluator, responder, room_size, solver, wp

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
            if layout.implicit:
                self._implicit = wp.array(layout.implicit, dtype=int)
                self._solved = wp.array([layout.dofs[i] for i in layout.implicit], dtype=int)
                self._room = wp.zeros((nworld, room_size(layout)), dtype=wp.float64)
                work = layout.bare.nC + 2 * layout.bare.nv
                self._work = wp.zeros((nworld, work), dtype=wp.float64)
                self._net = wp.zeros((nworld, layout.bare.nv), dtype=float)
        self._kernel = _kernel(layout)
        self._solver = _solver(layout) if layout.implicit else None

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
        """Adds the torque of the explicit joints to `d.qfrc_passive`: what `m.callback.passive` does."""
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

    def solve(self, m: mjw.Model, d: mjw.Data) -> None:
        """Adds the torque of the implicit joints: what `m.callback.control` does, once the controls are set."""
        if not self._solver:
            return
        mjw.fwd_actuation(m, d)
        size = (self.nworld, m.nv)
        # Constraints are solved after friction: what they do is what they did in the last step.
        forces = [d.qfrc_passive, d.qfrc_bias, d.qfrc_applied, d.qfrc_actuator, d.qfrc_constraint]
        device = self.state.device
        wp.launch(_net_torque, dim=size, inputs=forces, outputs=[self._net], device=device)
        mjw.xfrc_accumulate(m, d, self._net)
        euler = m.opt.integrator == mjw.IntegratorType.EULER
        damps = batched.damps_at_the_end(int(m.opt.disableflags), euler)
        tree = [m.nv, m.M_rownnz, m.M_rowadr, m.M_colind, d.M, m.dof_damping, float(damps), self._solved, self._net]
        motion = [m.opt.timestep, d.time, d.qpos, d.qvel, d.qfrc_damper, d.qfrc_applied, float(m.nactuator == 0)]
        wp.launch(
            self._solver,
            dim=self.nworld,
            inputs=[self._implicit, self._dofs, self._places, self.parameters, *tree, *motion],
            outputs=[self._work, self._room, self.state, self.torque, d.qfrc_passive],
            device=device,
        )


@wp.kernel(enable_backward=False)
def _net_torque(
    passive: wp.array2d[float],
    bias: wp.array2d[float],
    applied: wp.array2d[float],
    actuator: wp.array2d[float],
    constraint: wp.array2d[float],
    net: wp.array2d[float],
):
    world, dof = wp.tid()  # type: ignore[misc, unused-ignore]
    smooth = passive[world, dof] - bias[world, dof] + applied[world, dof] + actuator[world, dof]
    net[world, dof] = smooth + constraint[world, dof]


def _solver(layout: batched.Layout) -> Any:
    respond, settle, n = responder(layout), solver(layout, wp.float64), len(layout.implicit)

    @wp.kernel(module="unique", enable_backward=False)
    def solve_kernel(
        implicit: wp.array[int],
        dofs: wp.array[int],
        places: wp.array[int],
        parameters: wp.array2d[wp.float64],
        nv: int,
        row_size: wp.array[int],
        row_start: wp.array[int],
        column: wp.array[int],
        inertia: wp.array2d[float],
        damping: wp.array2d[float],
        damps: float,
        solved: wp.array[int],
        net: wp.array2d[float],
        timestep: wp.array[float],
        time: wp.array[float],
        qpos: wp.array2d[float],
        qvel: wp.array2d[float],
        qfrc_damper: wp.array2d[float],
        qfrc_applied: wp.array2d[float],
        applied: float,  # 1 where no actuators drive the joints, else 0
        work: wp.array2d[wp.float64],
        room: wp.array2d[wp.float64],
        state: wp.array2d[wp.float64],
        torque: wp.array2d[wp.float64],
        qfrc_passive: wp.array2d[float],
    ):
        world = wp.tid()
        step = wp.float64(timestep[world % timestep.shape[0]])
        for i in range(n):
            joint = implicit[i]
            dof = dofs[joint]
            room[world, wp.static(POSITION * n) + i] = wp.float64(qpos[world, places[joint]])
            room[world, wp.static(VELOCITY * n) + i] = wp.float64(qvel[world, dof])
            given = qfrc_damper[world, dof] + applied * qfrc_applied[world, dof]
            room[world, wp.static(GIVEN * n) + i] = wp.float64(given)
        row = world % damping.shape[0]
        respond(
            nv, row_size, row_start, column, inertia, damping, row, damps, qvel, net, solved, step, world, work, room
        )
        settle(parameters, world % parameters.shape[0], state, state, world, wp.float64(time[world]), step, room)
        for i in range(n):
            f = room[world, wp.static(PUSH * n) + i]
            torque[world, implicit[i]] = f
            qfrc_passive[world, solved[i]] += float(f)

    return solve_kernel


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
        place calls `friction(m, d)`. Where joints are solved for implicitly `callback.control` is taken too: one of
        your own sets the controls and then calls `friction.solve(m, d)`.

    Raises:
        ModelError: no joint has friction, the integrator is RK4, whose stages cannot be told from steps, or a joint is
            too stiff for an explicit step where actuation is disabled, and with it the control callback.
        EngineError: the model has plug-in sensors.
    """
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise ModelError("friction on MuJoCo Warp runs with Euler, implicit, implicitfast or discrete; RK4 given")
    layout = batched.lay_out(model)
    if layout.implicit and model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        raise ModelError(
            f"joint {layout.names[layout.implicit[0]]!r}: its friction is too stiff for an explicit step of "
            f"{model.opt.timestep:g} s, and an implicit one is taken after the controls, which are disabled here: "
            'enable actuation, take a shorter time step, or attach with integration="explicit" to have it so'
        )
    friction = Friction(layout, nworld)
    m = mjw.put_model(layout.bare)
    m.callback.passive = friction
    if layout.implicit:
        m.callback.control = friction.solve
    return m, friction
