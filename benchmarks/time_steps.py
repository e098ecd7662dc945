"""What the diagnosis makes of logs as MuJoCo's users write them: every time step a row, after the step, without noise.

Random axes with MuJoCo's own frictionloss (default solver parameters), LuGre of a dcmotor, or our plug-in, at time
steps of 1, 2 and 5 ms, under Euler; two runs of random torques and one in a loop. Nothing is hidden, or a weight, a
spring or cogging of 10 to 20 % of the friction.

Seeds: axis i comes from default_rng([77, i]). Run: python benchmarks/time_steps.py [axes]
"""

import itertools
import time
from pathlib import Path

import mujoco
import numpy as np
from arguments import arguments
from simulated_logs import course, errors
from truth_mujoco import DCMOTOR

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

FRICTIONS = ("frictionloss", "lugre", "gms")
HIDDEN = ("", "gravity", "cogging", "spring")
SECONDS = 6.0


def model(friction: str, hidden: str, inertia: float, level: float, step: float) -> tuple[mujoco.MjModel, float]:
    """The axis, and its inertia with what hangs on it."""
    joint = f'damping="{0.03 * level}"' + f' frictionloss="{level}"' * (friction == "frictionloss")
    joint += f' stiffness="{0.1 * level}"' * (hidden == "spring")
    arm = 0.05 if hidden == "gravity" else 0.0  # m
    mass = 0.2 * level / 9.81 / arm if arm else 1e-6
    motors = ""
    if friction == "lugre":
        bristle = f"{100 * level} {0.1 * np.sqrt(100 * level * inertia)} {level} {1.2 * level} 0.2"
        motors += f'{DCMOTOR} lugre="{bristle}"/>'
    if hidden == "cogging":
        motors += f'{DCMOTOR} cogging="{0.15 * level} 7 0.3"/>'
    xml = f"""<mujoco><compiler angle="radian"/><option timestep="{step}"/><worldbody><body>
    <joint name="shaft" axis="0 1 0" {joint}/>
    <inertial pos="{arm} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody>
    <actuator><motor joint="shaft"/>{motors}</actuator></mujoco>"""
    whole = inertia + mass * arm**2
    if friction != "gms":
        return mujoco.MjModel.from_xml_string(xml), whole
    law = effects.GMS(
        stiffness=[1000 * level, 100 * level, 30 * level], fraction=[0.3, 0.4, 0.3], coulomb=level, static=1.15 * level,
        stribeck_velocity=0.5, attraction=100 * level,
    )  # fmt: skip
    return gms.attach(xml, {"shaft": Plant.axis() + law}).compile(), whole


def logged(m: mujoco.MjModel, inertia: float, level: float, rng: np.random.Generator) -> list[Record]:
    """Two runs of torques and one in a loop, for each use."""
    h = m.opt.timestep
    t = h * np.arange(round(SECONDS / h))
    out = []
    for use, (i, (highest, size)) in itertools.product(
        ("fit", "validate"), enumerate(((30.0, 0.6), (15.0, 1.4), (0.9, 0.0)))
    ):
        wave = course(t, 20, highest, size * level if size else 2.0, rng)
        data, position, torque = mujoco.MjData(m), np.empty(len(t)), np.empty(len(t))
        stiffness, damping = inertia * 40.0**2, inertia * 60.0
        for k, x in enumerate(wave):
            data.ctrl[0] = x if size else stiffness * (x - data.qpos[0]) - damping * data.qvel[0]
            mujoco.mj_step(m, data)
            position[k], torque[k] = data.qpos[0], data.actuator_force[0]
        out.append(Record(f"{use}_{i}", t, {"torque": torque, "position": position}, use))
    return out


def main(axes: int) -> None:
    right = 0
    print("friction       hidden    step   verdict            error before, after, floor [%]   named")
    for i in range(axes):
        rng = np.random.default_rng([77, i])
        friction, hidden = FRICTIONS[i % len(FRICTIONS)], HIDDEN[i // len(FRICTIONS) % len(HIDDEN)]
        inertia = 10 ** rng.uniform(-3, -1.5)
        level, step = inertia * rng.uniform(60, 300), float(rng.choice([1e-3, 2e-3, 5e-3]))
        m, whole = model(friction, hidden, inertia, level, step)
        begun = time.process_time()
        d = gms.diagnose(Dataset(Path(), tuple(logged(m, whole, level, rng)), "hinge", whole))
        named = [e.name for e in d]
        right += named == [hidden] * bool(hidden)
        said = f"{', '.join(named) or '-'}   {time.process_time() - begun:.0f} s"
        print(f"{friction:14} {hidden or '-':9} {1e3 * step:.0f} ms   {d.verdict:17}  {errors(d)}   {said}", flush=True)
    print(f"named what is hidden, and nothing else: {right} of {axes}")


if __name__ == "__main__":
    main(**arguments(__doc__, axes=12))
