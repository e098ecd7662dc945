"""Seven joints of an arm, each with an effect that nobody told the model of, diagnosed one by one.

    python examples/arm.py [JOINT ...]

The arm of models/arm.xml moves all joints at once under a controller in MuJoCo, with friction on every joint and one
more effect each. Where MuJoCo can make the effect it does (a spring, a payload), or a line of code here (an offset,
cogging, a command that arrives late). What a robot logs, commanded torques and encoder positions, goes into a
measurement set with the MJCF of the arm, which knows nothing of friction, effects and payload; `gms_mujoco.diagnose`
names what is missing in each joint. With the payload 1 % of the torque remains that is not noise: its inertia answers
the trembling of the joints that are held, which no effect of one joint can tell.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import gms_mujoco as gms
from gms_mujoco import effects, formats

SAMPLE, STEPS = 1e-3, 4  # s, time steps per sample
DURATION = 8.0  # s
COUNTS = 2**20  # per revolution
MARGIN = 0.1  # rad, to the ends of a joint's range
LARGE = ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow")
USES = ("fit", "fit", "fit", "validate")


@dataclass(frozen=True)
class Hidden:
    """What one joint hides: an effect by name, and who makes it.

    Attributes:
        plant: effects of this package on the joint.
        edit: a change of the model.
        torque: added to the joint, of the state and the number of the joint [N m].
        late: samples by which commands arrive late.
        alone: the other joints are held while this one moves.
    """

    name: str
    plant: tuple[gms.Effect, ...] = ()
    edit: Callable[[mujoco.MjSpec], None] | None = None
    torque: Callable[[mujoco.MjData, int], float] | None = None
    late: int = 0
    alone: bool = False


def _payload(spec: mujoco.MjSpec) -> None:
    spec.body("hand").add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], pos=[0, 0, 0.1], mass=0.5,
                               contype=0, conaffinity=0)


def _stiffen(spec: mujoco.MjSpec) -> None:
    spec.joint("upper_arm_roll").stiffness[0] = 4.0


HIDDEN = {
    "shoulder_pan": Hidden("cogging", torque=lambda data, k: 0.8 * np.sin(24 * data.qpos[k] + 0.5)),
    "shoulder_lift": Hidden("load_dependent_friction", (effects.find("load_dependent_friction")(coefficient=0.01),)),
    "upper_arm_roll": Hidden("spring", edit=_stiffen),
    "elbow": Hidden("asymmetric_friction", (effects.find("asymmetric_friction")(level=0.15),)),
    "forearm_roll": Hidden("torque_offset", torque=lambda data, k: 0.25),
    "wrist_flex": Hidden("gravity", edit=_payload, alone=True),
    "wrist_roll": Hidden("delay", late=3),
}


def friction(joint: str) -> gms.Plant:
    """Friction of one joint, 5 N m in the large ones and 1 N m in the small ones."""
    level = 5.0 if joint in LARGE else 1.0
    distance = np.array([2e-4, 5e-4, 1.5e-3, 4e-3])  # rad, break-away of each element
    share = np.array([0.2, 0.3, 0.3, 0.2])
    return gms.Plant.axis() + effects.find("gms")(
        stiffness=level * share / distance, fraction=share, coulomb=level, static=1.2 * level, stribeck_velocity=0.1,
        attraction=20 * level,
    ) + effects.find("viscous")(coefficient=0.6 * level)


def references(
    rng: np.random.Generator, n_joints: int, moving: list[int], duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """(n, joints) position and velocity to follow: sums of a few slow and fast sines, so that joints turn round."""
    t = np.arange(round(duration / SAMPLE)) * SAMPLE
    rise = np.clip(t / 1.0, 0, 1) ** 2 * (3 - 2 * np.clip(t / 1.0, 0, 1))
    q = np.zeros((len(t), n_joints))
    for j in moving:
        for frequency, size in zip((0.13, 0.4, 1.1, 2.3), (0.6, 0.3, 0.06, 0.015), strict=True):
            f, phase = frequency * rng.uniform(0.8, 1.25), rng.uniform(0, 2 * np.pi)
            q[:, j] += size * (np.sin(2 * np.pi * f * t + phase) - np.sin(phase))
    q *= rise[:, None]
    return q, np.gradient(q, SAMPLE, axis=0)


def measure(joint: str, hidden: Hidden, seed: int, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One log of the arm while `joint` has its hidden effect: time (n,), torque and position (n, joints)."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml"))
    names = [j.name for j in spec.joints]
    for name in names:
        plant = friction(name)
        for effect in hidden.plant if name == joint else ():
            plant = plant + effect
        plant.attach(spec, name)
    if hidden.edit:
        hidden.edit(spec)
    spec.option.timestep = SAMPLE / STEPS
    model = spec.compile()
    data, k = mujoco.MjData(model), names.index(joint)
    target, speed = references(rng, len(names), [k] if hidden.alone else list(range(len(names))), duration)
    start = np.array([0, 0.5, 0, 0.8, 0, 0.5, 0])
    if not hidden.alone:  # gravity is one sine of the position only while the others stand where they stood
        start += rng.uniform(-0.4, 0.4, len(names))
    for i in range(model.njnt):  # within the range of each joint: an end stop's torque is no effect
        low, high = model.jnt_range[i] + np.array([MARGIN, -MARGIN])
        start[i] = np.clip(start[i], low - target[:, i].min(), high - target[:, i].max())
    data.qpos = start
    inertia = np.array([max(model.dof_armature[i], 0.1) for i in range(model.nv)])
    command = np.zeros((len(target) + hidden.late, model.nu))
    torque, position = np.empty_like(target), np.empty_like(target)
    count = 2 * np.pi / COUNTS
    for i in range(len(target)):
        # A position is read half a time step back: MuJoCo moves it with the velocity at the end of each step.
        position[i] = np.round((data.qpos - 0.5 * model.opt.timestep * data.qvel) / count) * count
        error, rate = start + target[i] - position[i], speed[i] - data.qvel
        torque[i] = data.qfrc_bias + inertia * (60.0**2 * error + 2 * 60.0 * rate)
        command[i + hidden.late] = torque[i]
        data.ctrl = torque[i]
        data.ctrl[k] = command[i, k]
        for _ in range(STEPS):
            if hidden.torque:
                data.qfrc_applied[k] = hidden.torque(data, k)
            mujoco.mj_step(model, data)
    return np.arange(len(target)) * SAMPLE, torque, position


def write(
    folder: Path, joint: str, seed: int = 0, hidden: Hidden | None = None, uses: tuple[str, ...] = USES,
    duration: float = DURATION,
) -> Path:
    """A measurement set of one joint: logs of the whole arm and its MJCF."""
    names = list(HIDDEN)
    lines = ["[axis]", f'model = "{(gms.MODELS / "arm.xml").as_posix()}"', f'joint = "{joint}"',
             f"encoder_counts_per_rev = {COUNTS}"]
    columns = ", ".join(f'{name} = "q_{name}"' for name in names)
    for i, use in enumerate(uses):
        t, torque, position = measure(joint, hidden or HIDDEN[joint], 100 * seed + i, duration)
        table = {"t": t, "tau": torque[:, names.index(joint)]}
        table |= {f"q_{name}": position[:, k] for k, name in enumerate(names)}
        formats.write(folder / f"{joint}_{i}.npz", table)
        lines += ["", "[[record]]", f'file = "{joint}_{i}.npz"', f'use = "{use}"',
                  f'columns = {{ time = "t", torque = "tau", position = {{ {columns} }} }}']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n")
    return folder


def main() -> int:
    print(f"{'joint':16} {'hidden':24} {'named':40} {'validate error [%]':>20} {'floor [%]':>9}   time [s]")
    for joint in sys.argv[1:] or HIDDEN:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            found = gms.diagnose(gms.load(write(Path(folder), joint)))
        errors = " -> ".join(f"{100 * c.torque_error:.2f}" for c in found.comparisons)
        named = ", ".join(e.name for e in found) or found.verdict
        print(f"{joint:16} {HIDDEN[joint].name:24} {named:40} {errors:>20} {100 * found.noise_floor:9.2f}   "
              f"{time.perf_counter() - began:.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
