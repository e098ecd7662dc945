"""Import a colleague's universal file: frequency responses from an analyser, read through dataset.toml.

pyuff writes what an analyser would: one file for each of four levels of excitation, displacement in degrees per
ampere. Only what the file cannot say stands in dataset.toml. Printed is what was read, and the friction in it.
Needs pip install 'gms-mujoco[uff]'.
"""

import tempfile
from pathlib import Path

import numpy as np
import pyuff

import gms_mujoco as gms

TORQUE_CONSTANT = 0.1916  # N m/A
RESPONSE = """
[[frf]]
file = "level_{k}.uff"
input = "current"
output = "position"
amplitude = {amplitude}        # A
units = {{ output = "deg" }}
"""


def colleague(folder: Path) -> None:
    """Measures at held torque and exports."""
    text = f"[axis]\ntorque_constant = {TORQUE_CONSTANT}\n"
    frequency = np.geomspace(4, 150, 24)
    for k, torque in enumerate((8e-4, 1.6e-3, 2.8e-3, 4.2e-3), 1):
        frf = gms.stepped_sine(gms.Plant.load("servo_axis"), frequency, torque, held="torque")
        pyuff.UFF(str(folder / f"level_{k}.uff")).write_sets({
            "type": 58, "func_type": 4, "binary": 0, "id1": f"level {k}", "rsp_node": 1, "rsp_dir": 6, "ref_node": 1,
            "ref_dir": 6, "x": frf.frequency, "data": 180 / np.pi * frf.response * TORQUE_CONSTANT,
            "abscissa_spacing": 0, "abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz",
            "orddenom_spec_data_type": 0,
        }, "overwrite")  # fmt: skip
        text += RESPONSE.format(k=k, amplitude=torque / TORQUE_CONSTANT)
    (folder / "dataset.toml").write_text(text)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        colleague(Path(folder))
        runs = gms.load(folder)
    for f in runs.frfs:
        print(f"{f.name}: {len(f)} points from {f.frequency[0]:.3g} to {f.frequency[-1]:.3g} Hz, "
              f"{f.input} to {f.output} [{f.unit}], torque of {1e3 * f.excitation[0]:.2f} mN m")  # fmt: skip
    print(gms.identify_dahl(runs.frfs))


if __name__ == "__main__":
    main()
