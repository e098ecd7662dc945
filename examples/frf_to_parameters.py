"""From frequency responses to the parameters of friction: stepped sines at six amplitudes, as in Yoon and Trumper.

The axis of models/ is measured in simulation at held position amplitudes from deep in pre-sliding to sliding. Its
resonance wanders from some 30 Hz down to nothing as the friction elements slip one after another; that says how stiff
each is and where it slips. Printed beside the truth.
"""

import numpy as np

import gms_mujoco as gms

AMPLITUDES = np.geomspace(6e-5, 6e-2, 6)  # rad
FREQUENCIES = np.geomspace(5, 120, 12)  # Hz


def main() -> None:
    truth = gms.Plant.load("servo_axis")
    responses = [gms.stepped_sine(truth, FREQUENCIES, a, resolution=2 * np.pi / 1e6) for a in AMPLITUDES]
    found = gms.identify_dahl(responses)
    gms_true = truth["gms"]
    stiffness = np.array(gms_true.stiffness)
    rows = {
        "inertia [kg m^2]": (found.inertia, truth.inertia),
        "stiffness at rest [N m/rad]": (found.stiffness.sum() + found.stuck, stiffness.sum()),
        "level of friction [N m]": (found.plant["gms"].coulomb, gms_true.coulomb),
    }
    for name, (value, true) in rows.items():
        print(f"{name:30} {value:10.4g}   true {true:10.4g}   off by {100 * abs(value / true - 1):.1f} %")
    print(found)


if __name__ == "__main__":
    main()
