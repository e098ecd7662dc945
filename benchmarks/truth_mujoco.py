"""Hidden effects made by MuJoCo's own elements: friction, drive and mechanism of one axis as MJCF."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from bench_axes import FINE, Array, Axis, Controller, Run

# Effects that MuJoCo has an element for.
EFFECTS = (
    "cogging", "gravity", "torque_offset", "spring", "delay", "current_loop_lag", "torque_saturation",
    "flexible_coupling", "backlash",
)  # fmt: skip
# A motor that does not turn electrically: what dcmotor adds to the joint by itself.
DCMOTOR = '<dcmotor joint="shaft" input="none" motorconst="0" resistance="1" '

# The bristle of LuGre follows the speed step by step: at FINE it is late by as much as 0.5 % of the torque.
_FINER = 4

Values = dict[str, float]


def sized(axis: Axis, name: str, strength: float, seen: list[Run]) -> Values:
    """Parameters of an effect whose torque is `strength` of the friction level at its height, or rms where it varies
    with the command.

    Args:
        seen: the runs of the axis, for the sizes of command and motion.
    """
    rng, top = axis.rng, strength * axis.level
    torque = np.concatenate([r.torque for r in seen])
    phase = float(rng.uniform(-math.pi, math.pi))
    moving = torque[np.abs(torque) > 0.05 * axis.level]
    if name == "cogging":
        return {"amplitude": top, "harmonic": float(rng.integers(3, 15)), "phase": phase}
    if name == "gravity":
        return {"torque": top, "phase": phase}
    if name == "torque_offset":
        return {"torque": math.copysign(top, phase)}
    if name == "spring":
        far = [float(np.abs(r.reference[:, 0] - r.reference[0, 0]).max()) for r in seen if r.reference is not None]
        return {"stiffness": top / max(far), "rest": phase}
    if name in ("delay", "current_loop_lag"):
        rate = [np.sqrt(np.mean(np.diff(r.torque) ** 2)) * axis.rate for r in seen if r.reference is None]
        return {"time": float(min(top / max(rate), 0.03))}
    if name == "torque_saturation":
        sizes = np.sort(np.abs(moving))
        low, high = 0.0, float(sizes[-1])
        for _ in range(40):  # the rms of what is cut off
            middle = 0.5 * (low + high)
            cut = math.sqrt(float(np.mean(np.maximum(sizes - middle, 0) ** 2)))
            low, high = (middle, high) if cut > top else (low, middle)
        return {"limit": max(high, 1.2 * axis.level)}
    omega = 2 * math.pi * float(rng.uniform(25, 70))
    spin = float(np.sqrt(np.mean(moving**2)))
    if name == "backlash":
        share = float(np.clip(4 * top / spin, 0.05, 0.6))
        return {"inertia": share * axis.inertia, "gap": float(rng.uniform(0.005, 0.04)), "omega": omega + 300}
    if name == "flexible_coupling":
        share = float(np.clip(3 * top / spin, 0.05, 0.6))
        return {"inertia": share * axis.inertia, "omega": omega, "zeta": float(rng.uniform(0.02, 0.15))}
    raise ValueError(name)


def model(axis: Axis, hidden: dict[str, Values]) -> tuple[mujoco.MjModel, int]:
    """The axis with the hidden effects, and time steps per sample."""
    parts = math.ceil(1 / axis.rate / FINE) * (_FINER if axis.friction == "lugre" else 1)
    step = 1 / axis.rate / parts
    second = hidden.get("flexible_coupling") or hidden.get("backlash")
    own = axis.inertia - (second["inertia"] if second else 0.0)
    joint, tendon, actuators, options = f'damping="{axis.viscous}"', "", [], 'gravity="0 0 0"'
    where, mass = "0 0 0", 1e-6
    if (g := hidden.get("gravity")) is not None:
        options = 'gravity="0 0 -9.81"'
        arm = 0.001  # m
        mass = g["torque"] / 9.81 / arm
        where = f"{arm * math.cos(g['phase'])} 0 {arm * math.sin(g['phase'])}"
        own -= mass * arm**2
    if (s := hidden.get("spring")) is not None:
        joint += f' stiffness="{s["stiffness"]}" springref="{s["rest"]}"'
    if axis.friction == "frictionloss":
        stiff = axis.rng.random() < 0.5  # as stiff as the time step allows, or as MuJoCo has it by default
        joint += f' frictionloss="{axis.level}"' + (f' solreffriction="{2 * step} 1"' if stiff else "")
    elif axis.friction == "lugre":
        k, level = axis.stiffness, axis.level
        damping = 0.2 * math.sqrt(k * axis.inertia)
        actuators.append(f'{DCMOTOR} lugre="{k} {damping} {level} {1.15 * level} {0.02 * axis.fastest}"/>')
    else:
        distance = axis.breakaway * np.geomspace(0.2, 3, 6)
        share = axis.rng.dirichlet(np.full(6, 4.0))
        for x, a in zip(distance, share, strict=True):
            tendon += (
                f'<fixed stiffness="{a * axis.level / x}" springyield="{x}" springlength="0">'
                '<joint joint="shaft" coef="1"/></fixed>'
            )
    load = ""
    if second:
        how = (
            f'stiffness="{second["inertia"] * second["omega"] ** 2}" '
            f'damping="{2 * second["zeta"] * second["omega"] * second["inertia"]}"'
            if "flexible_coupling" in hidden
            else f'limited="true" range="{-second["gap"] / 2} {second["gap"] / 2}" '
            f'solreflimit="{-second["omega"] ** 2} {-2 * second["omega"]}" solimplimit="0.99 0.99 0.001"'
        )
        i = second["inertia"]
        load = (
            f'<body><joint name="load" axis="0 1 0" {how}/>'
            f'<inertial pos="0 0 0" mass="1e-6" diaginertia="{i} {i} {i}"/></body>'
        )
    drive = ""
    if (d := hidden.get("delay")) is not None:
        drive += f' delay="{max(round(d["time"] / step), 1) * step}" nsample="{round(d["time"] / step) + 2}"'
    if (s := hidden.get("torque_saturation")) is not None:
        drive += f' forcerange="{-s["limit"]} {s["limit"]}"'
    if (lag := hidden.get("current_loop_lag")) is not None:
        drive += f' dyntype="filterexact" dynprm="{lag["time"]}" actearly="true"'
    for c in (v for k, v in hidden.items() if k.startswith("cogging")):
        actuators.append(f'{DCMOTOR} cogging="{c["amplitude"]} {c["harmonic"]} {c["phase"]}"/>')
    if "torque_offset" in hidden:
        actuators.insert(0, '<motor name="offset" joint="shaft"/>')  # dcmotors without input have no control
    xml = f"""<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/>
    <option timestep="{step!r}" {options} integrator="implicitfast"/>
    <worldbody><body><joint name="shaft" axis="0 1 0" {joint}/>
    <inertial pos="{where}" mass="{mass}" diaginertia="{own} {own} {own}"/>{load}</body></worldbody>
    <tendon>{tendon}</tendon>
    <actuator><general name="drive" joint="shaft"{drive}/>{''.join(actuators)}</actuator></mujoco>"""
    return mujoco.MjModel.from_xml_string(xml), parts


def simulate(axis: Axis, hidden: dict[str, Values], run: Run, built: tuple[mujoco.MjModel, int]) -> tuple[Array, Array]:
    """(n,) torque that was commanded from each sample to the next [N m], and position at the sample [rad]."""
    m, parts = built
    data = mujoco.MjData(m)
    data.qpos[0] = run.start
    data.plastic[:] = run.start  # the springs have yielded to where the axis stands
    if "torque_offset" in hidden:
        data.ctrl[1] = hidden["torque_offset"]["torque"]
    mujoco.mj_forward(m, data)
    control, count = Controller(axis), axis.count
    torque, position = np.empty(len(run.torque)), np.empty(len(run.torque))
    for k, feed in enumerate(run.torque):
        position[k] = data.qpos[0]
        reading = round(data.qpos[0] / count) * count
        u = float(feed) if run.reference is None else control(float(feed), run.reference[k], reading)
        torque[k] = data.ctrl[0] = u
        mujoco.mj_step(m, data, parts)
    return torque, position
