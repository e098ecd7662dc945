"""A small servo that closes its own position loop, in MuJoCo: a dcmotor with slew limit and delay, and a pendulum."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from gms_mujoco import engine
from gms_mujoco.effects import Coulomb, Delay, PositionLoop, Viscous
from gms_mujoco.identification.servo_observation import STEP
from gms_mujoco.plant import Plant
from gms_mujoco.servo_run import ServoRun

MASS, ARM = 0.8, 0.12
STALL, DRAG, DUTY, SPEED = 5.5, 1.1, 0.2, 4.9  # N m, N m s/rad, 1/rad, rad/s
INERTIA, FRICTION, DAMPING = 0.02, 0.12, 0.04  # kg m^2, N m, N m s/rad
DELAY = 0.02  # s
SAMPLE = 0.02  # s
NOISE = 1e-3  # rad

LOOP = PositionLoop(stall_torque=STALL, electrical_drag=DRAG, goal_speed=SPEED, duty_per_rad=DUTY)
POOR = Plant(INERTIA, (LOOP, Coulomb(coulomb=FRICTION), Viscous(coefficient=DAMPING)))
TRUE = POOR + Delay(time=DELAY)


def run(goal, powered=None, gain=16.0, start=0.2, step=0.01, name="made", load=1.0, use="fit") -> ServoRun:
    """A run from rest with everything but its measured position, of which the first sample counts."""
    goal = np.asarray(goal, float)
    on = np.ones(len(goal)) if powered is None else powered
    inertia, weight = load * MASS * ARM**2, load * 9.81 * MASS * ARM
    time, rest = step * np.arange(len(goal)), np.full(len(goal), start)
    return ServoRun(name, time, goal, on, rest, gain, inertia, weight, use=use)


def pendulum(inertia: float, load: float = 1.0) -> mujoco.MjSpec:
    """The mass on the joint "j" of a rotor."""
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="{STEP}"/><worldbody><body><joint name="j" axis="0 1 0" armature="{inertia}"/>'
        f'<inertial pos="0 0 {-ARM}" mass="{load * MASS}" diaginertia="1e-12 1e-12 1e-12"/></body></worldbody></mujoco>'
    )
    spec.compiler.boundmass = 0
    return spec


def moved(model: mujoco.MjModel, r: ServoRun) -> np.ndarray:
    """(n,) position of the joint under the goal of a run, which is its control."""
    data = mujoco.MjData(model)
    data.qpos[0], data.act[0] = r.position[0], r.goal[0]
    if model.nhistory:  # a goal that was there before the run
        mujoco.mj_initCtrlHistory(model, data, 0, None, np.full(model.actuator_history[0, 0], r.goal[0]))
    steps, motion = round(r.sample_time / STEP), []
    for goal in np.repeat(r.goal, steps):
        data.ctrl[0] = goal
        motion.append(data.qpos[0])
        mujoco.mj_step(model, data)
    return np.array(motion)[::steps]


def in_mujoco(plant: Plant, r: ServoRun) -> np.ndarray:
    """(n,) position of a plant that is attached to MuJoCo."""
    attached = plant.replace(plant["position_loop"].replace(gain=r.gain))
    return moved(engine.attach(pendulum(plant.inertia), {"j": attached}).compile(), r)


def bench(delay: float = DELAY, seed: int = 1) -> list[ServoRun]:
    """Twelve runs of a servo that is MuJoCo's alone, eight to fit: steps and wanderings, two gains, two payloads.

    Each is made twice, with noise of its own.
    """
    rng = np.random.default_rng(seed)
    out = []
    for i in range(6):
        gain, load = (8.0, 24.0)[i % 2], (1.0, 2.0)[i // 2 % 2]
        use = "fit" if i < 4 else "validate"
        goal = np.repeat(rng.uniform(-1, 1, 5), 20) if i % 3 else np.cumsum(rng.normal(0, 0.05, 100))
        spec = pendulum(INERTIA, load)
        joint = spec.joint("j")
        joint.damping[0], joint.frictionloss = DAMPING, FRICTION
        joint.solref_friction, joint.solimp_friction = [2 * STEP, 1.0], [0.99, 0.999, 1e-4, 0.5, 2.0]  # hardly creeps
        constant = DRAG / STALL
        motor = spec.add_actuator(name="j", target="j", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_dcmotor(motorconst=[constant, 0.0], resistance=constant**2 / DRAG,
                             controller=[gain * DUTY * STALL, 0.0, DRAG, SPEED, 0.0, 1.0],
                             ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS))  # fmt: skip
        motor.delay, motor.interp, motor.nsample = delay, 1, round(delay / STEP) + 1
        made = run(goal, gain=gain, start=float(goal[0]), step=SAMPLE, load=load, use=use)
        motion = moved(spec.compile(), made)
        for again in "ab":
            read = motion + NOISE * rng.standard_normal(len(motion))
            out.append(replace(made, name=f"run {i}{again}.csv", position=read))
    return out
