"""Friction on every joint of a robot arm, in ten lines: the drives let go of a leaning arm, and it falls or stays.

Prints how far each joint moves within a second, without friction and with.
"""

import mujoco
import numpy as np

import gms_mujoco as gms

POSE = {"shoulder_lift": 4.0, "elbow": 8.0, "wrist_flex": 60.0}  # deg


def sag(spec: mujoco.MjSpec) -> np.ndarray:
    """How far each joint moves in the second after the drives have let go [rad]."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for joint, angle in POSE.items():
        data.joint(joint).qpos = np.radians(angle)
    start = data.qpos.copy()
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    return data.qpos - start


def main() -> None:
    bare = mujoco.MjSpec.from_file(str(gms.MODELS / "arm.xml"))
    real = gms.attach(bare.copy(), {"*": gms.Plant.load("arm_joint")})
    for joint, free, held in zip(bare.joints, sag(bare), sag(real), strict=True):
        print(f"{joint.name:15} {np.degrees(free):9.3f} deg without friction, {np.degrees(held):7.3f} deg with")


if __name__ == "__main__":
    main()
