"""Registers the environments with Gymnasium; they are loaded when the first is made."""

from gymnasium.envs.registration import register

for _name in ("ServoTracking", "ServoExcitation"):
    register(
        id=f"GmsMujoco/{_name}-v0",
        entry_point=f"gms_mujoco.env:{_name}",
        vector_entry_point=f"gms_mujoco.vector_env:{_name}Vector",
    )
