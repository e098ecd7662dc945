// What MuJoCo calls: the engine plug-in and the control callback.
