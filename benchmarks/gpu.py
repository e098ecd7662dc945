"""Throughput of MuJoCo Warp with and without friction: world-steps per second of the arm, on the device at hand.

Each of the seven joints has four friction elements with a Stribeck curve, and viscous drag: taken at the beginning of a
step, as their stiffness allows, and all seven solved for together by backward Euler, as stiff or static ones are. The
models take turns in short rounds, on a GPU each as a captured graph; the ratios are medians over the rounds of time
with friction over time without. All swing through the same positions: every tenth step takes the worlds back to where
they set out, each with velocities and torques of its own. So none comes to its limits, and friction slips and turns
back.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/gpu.py [largest number of worlds] [seconds per figure]
"""

import statistics
import time
from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from arguments import arguments

import gms_mujoco as gms
from gms_mujoco.warp import put_model

ROUNDS = 9
STEPS = 10  # from where the worlds set out; in a graph


def stepper(model: mujoco.MjModel, m: mjw.Model, worlds: int) -> Callable[[], None]:
    """A function that does STEPS steps of all worlds."""
    d = mjw.make_data(model, nworld=worlds)
    rng = np.random.default_rng(0)
    d.ctrl.assign((rng.uniform(-0.5, 0.5, (worlds, model.nu)) * model.actuator_ctrlrange[:, 1]).astype(np.float32))
    position = wp.array(rng.uniform(-0.5, 0.5, (worlds, model.nq)), dtype=float)
    velocity = wp.array(rng.uniform(-1, 1, (worlds, model.nv)), dtype=float)

    def steps() -> None:
        wp.copy(d.qpos, position)
        wp.copy(d.qvel, velocity)
        for _ in range(STEPS):
            mjw.step(m, d)

    steps()  # compiles
    if not wp.get_device().is_cuda:
        return steps
    with wp.ScopedCapture() as capture:
        steps()
    return lambda: wp.capture_launch(capture.graph)


def seconds(run: Callable[[], None], times: int) -> float:
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(times):
        run()
    wp.synchronize()
    return time.perf_counter() - start


def main(largest: int, budget: float) -> None:
    wp.config.log_level = wp.LOG_WARNING
    bare = mujoco.MjModel.from_xml_path(str(gms.MODELS / "arm.xml"))
    plants = {"*": gms.Plant.load("arm_joint")}
    real = [gms.attach(gms.MODELS / "arm.xml", plants, way).compile() for way in ("explicit", "implicit")]
    device = wp.get_device()
    print(f"world-steps/s of the arm on {device.name}, mujoco_warp {mjw.__version__}, gms_mujoco {gms.__version__}")
    print(f"{'':21s}{'friction explicit, time ratio':>40s}{'friction implicit, time ratio':>40s}")
    print(f"{'worlds':>7s}{'frictionless':>14s}" + 2 * f"{'steps/s':>14s}{'median':>11s}{'of rounds':>15s}")
    worlds = 1
    while worlds <= largest:
        runs = [stepper(bare, mjw.put_model(bare), worlds)]
        runs += [stepper(model, put_model(model, worlds)[0], worlds) for model in real]
        times = max(1, int(budget / 3 / ROUNDS / max(seconds(runs[0], 1), 1e-9)))
        rounds = [[seconds(run, times) for run in runs] for _ in range(ROUNDS)]
        rates = [worlds * STEPS * times / statistics.median(r) for r in zip(*rounds, strict=True)]
        line = f"{worlds:7d}{rates[0]:14.0f}"
        for i in (1, 2):
            ratios = sorted(r[i] / r[0] for r in rounds)
            line += f"{rates[i]:14.0f}{statistics.median(ratios):11.3f}{ratios[1]:9.3f}-{ratios[-2]:.3f}"
        print(line, flush=True)
        worlds *= 4 if worlds < 1024 else 2


if __name__ == "__main__":
    main(**arguments(__doc__, largest=4096, budget=4.0))
