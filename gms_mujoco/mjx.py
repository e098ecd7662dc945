"""Friction under MJX: the law in the carry of a scan, jitted and mapped over worlds like the step itself.

    model = gms.attach("robot.xml", {"*": plant}).compile()
    m, friction = gms_mujoco.mjx.put_model(model)
    d, state = mjx.make_data(m), friction.init()
    d, state = jax.jit(friction.step)(m, d, state)

JAX calls the kernel that runs on MuJoCo Warp (`warp.jax_kernel`), with the plug-in's C++, on a CPU or an NVIDIA GPU. It
cannot be differentiated. Needs `pip install 'gms-mujoco[mjx]'`.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from . import batched
from .errors import EngineError, ModelError

try:
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    from .kernel import jax_solver, jax_torque
except (ImportError, EngineError):  # of the kernel, which names what Warp alone needs
    raise EngineError("friction under MJX needs it: pip install 'gms-mujoco[mjx]'") from None


class Friction:
    """Friction of the joints of a model; all methods are pure functions for `jax.jit`, `jax.vmap` and `jax.lax.scan`.

    Attributes:
        joints: names of the joints with friction, in the order of the model.
        parameters: (n_parameter,) of the model; `replace` makes another array of them.
    """

    def __init__(self, layout: batched.Layout) -> None:
        self._layout = layout
        self._torque = jax_torque(layout)
        self._solve = jax_solver(layout) if layout.implicit else None
        self._solved = np.array([layout.dofs[i] for i in layout.implicit], int)
        self._dofs, self._places = np.array(layout.dofs), np.array(layout.places)
        self.joints = layout.names
        self.parameters = jnp.asarray(layout.parameters, jnp.float32)

    def init(self, model: mujoco.MjModel | None = None, data: mujoco.MjData | None = None) -> jax.Array:
        """(n_state,) of joints that have never moved. Give it back to a world to reset its friction.

        With the model and data of a MuJoCo simulation: the state of its friction, beside `mjx.put_data` of it.

        Raises:
            ModelError: the data has other friction than the model that was put.
        """
        if model is None or data is None:
            return jnp.asarray(self._layout.virgin(1)[0], jnp.float32)
        return jnp.asarray(self._layout.state_of(model, data), jnp.float32)

    def replace(
        self, joint: str, values: Mapping[str, ArrayLike], nworld: int = 1, parameters: jax.Array | None = None
    ) -> jax.Array:
        """Parameters with some of one joint changed, for `step`; not for use inside `jax.jit`.

        Args:
            joint: its name.
            values: of "effect.parameter", a number or (n,) for all worlds, (nworld,) or (nworld, n) for each.
            nworld: number of worlds.
            parameters: to start from, (n_parameter,) or (nworld, n_parameter); None: those of the model.

        Returns:
            (n_parameter,), or (nworld, n_parameter) for `jax.vmap` where worlds differ.

        Raises:
            ModelError: no such joint or parameter, another shape, or values that the effect does not take.
        """
        table = self._layout.parameters if parameters is None else np.asarray(parameters, float)
        table = batched.changed(self._layout, np.atleast_2d(table), joint, values, nworld)
        return jnp.asarray(table if len(table) > 1 else table[0], jnp.float32)

    def torque(
        self, m: mjx.Model, d: mjx.Data, state: jax.Array, parameters: jax.Array | None = None
    ) -> tuple[jax.Array, jax.Array]:
        """Torque on each joint with friction [N m] (n_joints,), and the state here.

        The state moves on where the time of `d` is later than its own; else it stays, whatever is asked. Joints that
        are too stiff for an explicit step are solved for together, by backward Euler: that takes an `mjx.forward` more.
        """
        p = self.parameters if parameters is None else parameters
        time, step = jnp.reshape(d.time, (1,)), jnp.reshape(m.opt.timestep, (1,))
        i = self._dofs
        pull = d.qfrc_actuator[i] - m.dof_armature[i] * d.qacc[i]
        given = -m.dof_damping[i] * d.qvel[i] + (d.qfrc_applied[i] if m.nu == 0 else 0)
        motion = (time, step, d.qpos[self._places], d.qvel[i], pull, given)
        inputs = [jnp.asarray(x, jnp.float32)[None] for x in (p, state, *motion)]
        torque, state = self._torque(*inputs)
        if self._solve is None:
            return torque[0], state[0]
        free, response = self._without(m, d, torque[0])
        implicit, at = np.array(self._layout.implicit), self._solved
        given = jnp.concatenate([d.qpos[self._places[implicit]], d.qvel[at], free, motion[-1][implicit], response])
        inputs = [jnp.asarray(x, jnp.float32)[None] for x in (p, state[0], time, step, given)]
        solved, state, _ = self._solve(*inputs)
        return torque[0].at[implicit].set(solved[0]), state[0]

    def _without(self, m: mjx.Model, d: mjx.Data, torque: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Velocities (n,) at the end of the step without friction of the implicit joints, and what torques change of
        them (n * n,)."""
        now = mjx.forward(m, d.replace(qfrc_applied=d.qfrc_applied.at[self._dofs].add(torque)))
        damped = batched.damps_at_the_end(int(m.opt.disableflags), m.opt.integrator == mjx.IntegratorType.EULER)
        inertia = mjx.full_m(m, now) + (m.opt.timestep * jnp.diag(m.dof_damping) if damped else 0)
        at = self._solved
        response = m.opt.timestep * jnp.linalg.inv(inertia)[at]
        # Constraints are solved after friction: what they do is what they did in the last step.
        return d.qvel[at] + response @ (now.qfrc_smooth + d.qfrc_constraint), response[:, at].ravel()

    def step(
        self, m: mjx.Model, d: mjx.Data, state: jax.Array, parameters: jax.Array | None = None
    ) -> tuple[mjx.Data, jax.Array]:
        """`mjx.step` with friction.

        Args:
            m, d: of one world; `jax.vmap` over `d`, `state` and, where they differ, `parameters` for many.
            state: (n_state,) from `init` or the last step.
            parameters: (n_parameter,) from `replace`; None: those of the model.

        Returns:
            The data and the state to go on with.
        """
        torque, state = self.torque(m, d, state, parameters)
        applied = d.qfrc_applied
        d = mjx.step(m, d.replace(qfrc_applied=applied.at[self._dofs].add(torque)))
        return d.replace(qfrc_applied=applied), state


def put_model(model: mujoco.MjModel) -> tuple[mjx.Model, Friction]:
    """`mjx.put_model` of a model with friction, and its friction.

    Args:
        model: with friction from `gms_mujoco.attach`.

    Raises:
        ModelError: no joint has friction, or the integrator is another than Euler or implicitfast.
        EngineError: the model has other plug-ins, or sensors of the friction.
    """
    if model.opt.integrator not in (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST):
        name = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
        raise ModelError(f"friction under MJX runs with Euler or implicitfast; {name} given")
    layout = batched.lay_out(model)
    return mjx.put_model(layout.bare), Friction(layout)
