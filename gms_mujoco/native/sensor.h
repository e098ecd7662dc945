// The plug-in `gms_mujoco.sensor`: the friction of a joint as a MuJoCo sensor.
#ifndef GMS_MUJOCO_NATIVE_SENSOR_H_
#define GMS_MUJOCO_NATIVE_SENSOR_H_

namespace gms {

void register_sensor();

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_SENSOR_H_
