"""A model with every native effect on a joint of its own, and its replay: what the kernels of many worlds must give."""

import mujoco
import numpy as np
from axes import gms as friction
from test_effects import example

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.plant import Plant

STEP = float(np.float32(1e-3))
EVERY = [n for n, c in effects.CATALOGUE.items() if c.is_native]


def plant(name: str) -> Plant:
    """An effect beside a law that it may modulate."""
    bare = Plant.axis(1.0) + example(name)
    return bare if name == "gms" else bare + friction()


def catalogue() -> mujoco.MjModel:
    """A joint for every effect, called after it."""
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    for name in EVERY:
        body = spec.worldbody.add_body(name=name)
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], armature=10.0)
        body.add_geom(size=[0.1, 0, 0], contype=0, conaffinity=0)
    return gms.attach(spec, {name: plant(name) for name in EVERY}, "explicit").compile()


def motion(n: int = 600) -> tuple[np.ndarray, ...]:
    """(n,) time, position, velocity and load in single precision, with reversals and a rest."""
    t = np.arange(n) * STEP
    q = 0.02 * np.sin(2 * np.pi * 4 * t) + 0.005 * np.sin(2 * np.pi * 9 * t + 1)
    q = np.where((t > 0.3) & (t < 0.35), q[300], q)
    return tuple(np.asarray(x, np.float32) for x in (t, q, np.gradient(q, t), 3 * np.cos(20 * t)))


def expected(name: str, time: np.ndarray, *motion: np.ndarray) -> np.ndarray:
    """(n,) torque by the native replay."""
    return plant(name).joint().replay(np.arange(len(time)) * STEP, *motion).torque
