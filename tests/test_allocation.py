"""A step allocates no memory: counted in a process of its own, by a malloc in front of the C library's."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

COUNTER = """
#include <stddef.h>
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
static long n;
long allocations(void) { return n; }
void *malloc(size_t size) { n++; return __libc_malloc(size); }
void *calloc(size_t count, size_t size) { n++; return __libc_calloc(count, size); }
void *realloc(void *p, size_t size) { n++; return __libc_realloc(p, size); }
void *aligned_alloc(size_t alignment, size_t size) { n++; return __libc_memalign(alignment, size); }
int posix_memalign(void **p, size_t alignment, size_t size) {
  n++;
  *p = __libc_memalign(alignment, size);
  return *p ? 0 : 12;
}
"""

STEPS = """
import ctypes, sys
import mujoco, numpy as np
sys.path.insert(0, {tests!r})
from axes import AXIS, BEARING, DRY, engine
from test_stiff import ARM, POSE, stiff_arm
from gms_mujoco import effects
from gms_mujoco.plant import Plant

counter = ctypes.CDLL({counter!r})
assert counter.allocations() > 1000, "it counts"
soft = Plant.load({tests!r} + "/../models/arm_joint.toml")
dry = Plant.axis() + effects.Coulomb(coulomb=8.0) + effects.LoadDependentFriction(coefficient=0.1)
motor = AXIS.replace('<motor name="drive"', '<dcmotor name="drive" motorconst="0.1" resistance="10"')
bare = AXIS.replace('<actuator><motor name="drive" joint="shaft"/></actuator>', "")
cases = {{
    "explicit arm": engine.attach(ARM, {{"*": soft}}, "explicit", engine.READINGS).compile(),
    "implicit arm": engine.attach(ARM, {{"*": soft}}, "implicit").compile(),
    "stiff arm": stiff_arm(2e-3)[0],
    "static arm": engine.attach(ARM, {{"*": dry}}).compile(),
    "dcmotor": engine.attach(motor, {{"shaft": DRY}}).compile(),
    "no actuator": engine.attach(bare, {{"shaft": BEARING}}, "implicit").compile(),
}}
for name, model in cases.items():
    data = mujoco.MjData(model)
    def steps(n):
        before = counter.allocations()
        mujoco.mj_step(model, data, n)
        return counter.allocations() - before
    if model.nv == 7:
        data.qpos[:] = POSE
    data.qfrc_applied[:] = 5e-3 if model.nv == 1 else 12.0
    if model.nu:
        data.ctrl[:] = 2e-3
    steps(200)
    few, many = steps(1), steps(1000)
    print(f"{{name}}: {{few}} {{many}}")
"""


def test_a_step_allocates_nothing(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not (compiler and sys.platform == "linux"):
        pytest.skip("needs Linux and a C compiler, to put a malloc that counts in front of the C library's")
    source, counter = tmp_path / "counter.c", tmp_path / "counter.so"
    source.write_text(COUNTER)
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(counter), str(source)], check=True)
    script = STEPS.format(tests=str(Path(__file__).parent), counter=str(counter))
    environment = os.environ | {"LD_PRELOAD": str(counter), "PYTHONPATH": os.pathsep.join(sys.path)}
    # Not from the tree, where Python would take the package that lies there for the one that is installed.
    run = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    counts = dict(line.split(": ") for line in run.stdout.splitlines() if ": " in line)
    assert len(counts) == 6
    for name, pair in counts.items():
        few, many = map(int, pair.split())
        assert many == few, f"{name}: {many - few} allocations in 999 steps"
