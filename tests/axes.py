"""A bare servo axis in MuJoCo and what drives it, for the tests of the MuJoCo faces."""

import mujoco
import numpy as np

from gms_mujoco import effects, engine
from gms_mujoco.plant import Plant

J = 2.4e-5
FC, FS = 4.5e-3, 5.4e-3

AXIS = f"""<mujoco><option timestep="0.0005" gravity="0 0 0"/>
<worldbody><body name="rotor"><joint name="shaft" axis="0 0 1"/>
<inertial pos="0 0 0" mass="1" diaginertia="{J} {J} {J}"/></body></worldbody>
<actuator><motor name="drive" joint="shaft"/></actuator></mujoco>"""
# A light body on a joint, from which a heavy one hangs by a weld.
WELD = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody>
  <body name="A"><joint name="j" type="slide" axis="0 0 -1"/>
    <geom size="0.02" mass="0.1" contype="0" conaffinity="0"/></body>
  <body name="B" pos="0 0 -0.2"><freejoint/><geom size="0.02" mass="1" contype="0" conaffinity="0"/></body>
  </worldbody><equality><weld body1="A" body2="B"/></equality></mujoco>"""


def gms(stiffness=(0.8, 0.4, 0.2, 0.1)):
    return effects.GMS(
        stiffness=stiffness, fraction=[0.1, 0.2, 0.3, 0.4], coulomb=FC, static=FS, stribeck_velocity=0.8,
        attraction=0.3,
    )


BEARING = Plant.axis(J) + gms() + effects.Viscous(coefficient=2e-5)
DRY = Plant.axis(J) + effects.Coulomb(coulomb=4e-3)


def axis(plant=BEARING, integration="auto", timestep=5e-4, integrator="Euler"):
    spec = engine.attach(AXIS, {"shaft": plant}, integration)
    spec.option.timestep = timestep
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = spec.compile()
    return model, mujoco.MjData(model)


def stick_slip(n, h=5e-4, amplitude=8e-3):
    t = np.arange(n) * h
    return amplitude * np.sin(2 * np.pi * 3 * t) * (0.6 + 0.4 * np.sin(2 * np.pi * 0.7 * t))


def run(model, data, torque):
    """(n, 4) time, position, velocity and friction torque before each step."""
    rows = []
    for u in torque:
        data.ctrl[:] = u
        mujoco.mj_forward(model, data)
        rows.append((data.time, data.qpos[0], data.qvel[0], data.qfrc_passive[0]))
        mujoco.mj_step(model, data)
    return np.array(rows)
