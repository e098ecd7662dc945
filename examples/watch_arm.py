"""Watch friction work: a leaning arm is let go, in 3-D with the torque, elements and slips of each joint.

    python examples/watch_arm.py [RECORDING.rrd]

Without a file name it opens the rerun viewer and streams the simulation into it as it runs.
"""

import sys

import mujoco
import numpy as np

import gms_mujoco as gms

POSE = {"shoulder_lift": 40.0, "elbow": 30.0, "wrist_flex": 60.0}  # deg


def main(recording: str | None = None) -> None:
    model = gms.attach(str(gms.MODELS / "arm.xml"), {"*": gms.Plant.load("arm_joint")}).compile()
    data = mujoco.MjData(model)
    for joint, angle in POSE.items():
        data.joint(joint).qpos = np.radians(angle)
    with gms.view.stream(model, data, recording) as look:
        while data.time < 2.0:
            mujoco.mj_step(model, data)
            look()
    fell = np.degrees(data.joint("shoulder_lift").qpos[0]) - POSE["shoulder_lift"]
    print(f"the shoulder sank by {fell:.1f} deg until friction held it")
    if recording:
        look.close()
        print(f"wrote {recording}; gms-mujoco view {recording} opens it")


if __name__ == "__main__":
    main(*sys.argv[1:2])
