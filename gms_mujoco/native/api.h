// Marks what Python calls through ctypes.
#ifndef GMS_MUJOCO_NATIVE_API_H_
#define GMS_MUJOCO_NATIVE_API_H_

#if defined(_WIN32)
#define GMS_API extern "C" __declspec(dllexport)
#else
#define GMS_API extern "C" __attribute__((visibility("default")))
#endif

#endif  // GMS_MUJOCO_NATIVE_API_H_
