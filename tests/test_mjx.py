"""Friction under MJX is the native friction, jitted, mapped and scanned."""

import mujoco
import numpy as np
import pytest

pytest.importorskip("mujoco.mjx", reason="pip install 'gms-mujoco[mjx]'")
pytest.importorskip("warp", reason="pip install 'gms-mujoco[mjx]'")

import jax
import jax.numpy as jnp
import warp as wp
from axes import BEARING, DRY, FC, FS, axis, stick_slip
from mujoco import mjx
from worlds import catalogue, expected, motion

from gms_mujoco import mjx as gms_mjx
from gms_mujoco.errors import ModelError

wp.config.log_level = wp.LOG_WARNING
HALF = 200
TORQUE = stick_slip(2 * HALF)


@pytest.fixture(scope="module")
def bearing():
    """A model, it and its friction under MJX, and run(data, state, parameters, torque) -> data, state, positions."""
    model = axis()[0]
    m, friction = gms_mjx.put_model(model)

    def run(d, state, parameters, torque):
        def step(carry, u):
            d, state = friction.step(m, carry[0].replace(ctrl=u[None]), carry[1], parameters)
            return (d, state), carry[0].qpos[0]

        (d, state), positions = jax.lax.scan(step, (d, state), torque)
        return d, state, positions

    half = jax.jit(jax.vmap(run, in_axes=(0, 0, 0, None)))

    def halves(d, state, parameters, torque):
        positions = []
        for part in np.reshape(np.float32(torque), (-1, HALF)):
            d, state, q = half(d, state, parameters, part)
            positions.append(q)
        return d, state, np.concatenate(positions, axis=1)

    return model, m, friction, halves


def virgin(m, friction, n=3):
    """Data, states and parameters of n worlds."""
    tree = (mjx.make_data(m), friction.init(), friction.parameters)
    return jax.tree.map(lambda x: jnp.repeat(x[None], n, axis=0), tree)


def truth(model, torque=TORQUE):
    data, positions = mujoco.MjData(model), []
    for u in torque:
        positions.append(data.qpos[0])
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    return np.array(positions)


def test_every_effect_is_the_native_replay_along_a_motion():
    m, friction = gms_mjx.put_model(catalogue())
    d = mjx.make_data(m)

    @jax.jit
    def replay(*motion):
        def at(carry, now):
            state, last = carry
            t, q, v, load = now
            full = {k: jnp.full_like(d.qvel, x) for k, x in (("qpos", q), ("qvel", v), ("qfrc_actuator", load - last))}
            here = d.replace(time=t, **full)
            _, state = friction.torque(m, here, state)
            torque, state = friction.torque(m, here, state)  # once more changes nothing
            return (state, torque), torque

        return jax.lax.scan(at, (friction.init(), jnp.zeros(len(friction.joints))), motion)[1]

    for joint, torque in zip(friction.joints, replay(*motion()).T, strict=True):
        should = expected(joint, *motion())
        np.testing.assert_allclose(torque, should, atol=2e-6 * np.abs(should).max(), err_msg=joint)


def test_a_servo_axis_moves_as_under_the_plugin(bearing):
    model, m, friction, run = bearing
    d, _, positions = run(*virgin(m, friction), TORQUE)
    assert np.ptp(truth(model)) > 0.2
    np.testing.assert_allclose(positions, np.tile(truth(model), (3, 1)), atol=1e-6)
    assert not d.qfrc_applied.any(), "the user's own torque is left as it was"


def test_worlds_have_parameters_of_their_own(bearing):
    _, m, friction, run = bearing
    factors = np.array([0.5, 1.0, 2.0])
    own = friction.replace("shaft", {"gms.coulomb": FC * factors, "gms.static": FS * factors}, nworld=3)
    own = friction.replace("shaft", {"viscous.coefficient": 3e-5}, 3, own)
    d, state, _ = virgin(m, friction)
    positions = run(d, state, own, TORQUE)[2]
    for world, factor in enumerate(factors):
        plant = BEARING.replace(BEARING["gms"].replace(coulomb=FC * factor, static=FS * factor))
        model, _ = axis(plant.replace(plant["viscous"].replace(coefficient=3e-5)))
        np.testing.assert_allclose(positions[world], truth(model), atol=1e-6)


def test_a_fork_goes_on_as_the_run_it_came_from_and_a_reset_begins_anew(bearing):
    _, m, friction, run = bearing
    d, state, p = virgin(m, friction)
    middle, half, first = run(d, state, p, TORQUE[:HALF])
    again = run(middle, half, p, TORQUE[HALF:])[2]
    np.testing.assert_array_equal(run(middle, half, p, TORQUE[HALF:])[2], again)
    np.testing.assert_array_equal(np.concatenate([first, again], axis=1), run(d, state, p, TORQUE)[2])
    for before in (half, state):  # time that has gone back, and the state of `init`, are a reset both
        np.testing.assert_array_equal(run(d, before, p, TORQUE[:HALF])[2], first)


def test_a_run_of_mujoco_is_taken_over_with_its_friction(bearing):
    model, _, friction, run = bearing
    data = mujoco.MjData(model)
    for u in TORQUE[:HALF]:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    _, _, p = virgin(bearing[1], friction)
    d = mjx.put_data(model, data)
    given = jax.tree.map(lambda x: jnp.repeat(x[None], 3, axis=0), (d, friction.init(model, data)))
    np.testing.assert_allclose(run(*given, p, TORQUE[HALF:])[2][0], truth(model)[HALF:], atol=1e-6)


def test_refuses_what_it_cannot_do(bearing):
    with pytest.raises(ModelError, match="Euler or implicitfast; RK4 given"):
        gms_mjx.put_model(axis(integrator="RK4")[0])
    with pytest.raises(ModelError, match="no joint with friction is called 'elbow'"):
        bearing[2].replace("elbow", {"gms.coulomb": 1.0})


def test_a_static_law_holds_a_world_and_lets_another_go():
    """Under 0.8, 1.25 and -1.5 times its level, with h = 0.5 ms and 50 steps."""
    m, friction = gms_mjx.put_model(axis(DRY)[0])
    level = DRY["coulomb"].coulomb
    torque = jnp.array([[0.8], [1.25], [-1.5]], jnp.float32) * level
    d = jax.vmap(lambda u: mjx.make_data(m).replace(ctrl=u))(torque)
    state = jnp.tile(friction.init(), (3, 1))
    step = jax.jit(jax.vmap(friction.step, in_axes=(None, 0, 0)))
    for _ in range(50):
        d, state = step(m, d, state)
    expected = np.array([0, 0.25, -0.5]) * level / DRY.inertia * 50 * m.opt.timestep
    np.testing.assert_allclose(d.qvel[:, 0], expected, rtol=1e-4, atol=1e-9)
