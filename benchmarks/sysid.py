"""Identification from 60 s of 2 kHz data: this package against `mujoco.sysid` on the same records, in one run.

The axes: models/servo_axis.toml (GMS friction with a Stribeck curve) and random ones like it, 2 kHz, encoder of 10^6
counts, 0.02 mN m of noise on the torque; to fit, 20 s each in pre-sliding, about break-away and turning; to validate,
5 s each of other multisines. `mujoco.sysid` gets what it needs to do well: the same records cut into chunks of 0.5 s,
each from its measured position and smoothed velocity (an open-loop position drifts over longer ones), one model build
per parameter and not per chunk, bounds of a factor 30 about starts within a factor 2 of the truth. It runs its own
optimizer until that stops; "to 1 %" is when its cost first came within 1 % of the last. This package starts from the
records alone. Times are of the processor, summed over threads, so that what else the machine does counts little.

Errors, on the validate records: `torque` as `compare` has it; `motion` is the forward simulation over short windows.
Where the model is right both fits find it. A Coulomb model is wrong in pre-sliding, where it has to stick: a fit to the
motion takes more friction for it and a fifth less inertia, which the torque shows twice as far off.

Run: python benchmarks/sysid.py [axes]       needs pip install 'mujoco[sysid]'
"""

import contextlib
import io
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from arguments import arguments
from mujoco import sysid
from scipy.signal import savgol_filter

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.axis import plant_of
from gms_mujoco.excitation import multisine
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate
from gms_mujoco.tasks import scatter

H, COUNT, CHUNK = 5e-4, 2 * math.pi / 1e6, 1000
REGIMES = ((1.0, 60.0, 0.4), (0.5, 40.0, 1.5), (0.3, 15.0, 4.0))  # Hz, Hz, rms in friction levels
XML = """<mujoco><option timestep="{h}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
<joint name="shaft" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
<actuator><motor name="drive" joint="shaft"/>{more}</actuator></mujoco>"""
LUGRE = '<dcmotor name="bearing" joint="shaft" input="none" motorconst="0" resistance="1" lugre="1 1e-4 1 1 1"/>'
OURS = "gms.fit: gms (8 elements), viscous, inertia"
PAIRS = [
    ("mujoco.sysid: friction loss, damping, armature", "gms.fit: coulomb, viscous, inertia"),
    ("mujoco.sysid: LuGre of a dcmotor, damping, armature", "gms.fit: lugre, viscous, inertia"),
    ("mujoco.sysid: friction loss, damping, armature", OURS),
    ("mujoco.sysid: LuGre of a dcmotor, damping, armature", OURS),
]
Modifier = Callable[[Any, float], None]


def records(plant: Plant, seconds: float, use: str, seed: int) -> list[Record]:
    level = float(plant["gms"].values["static"])  # type: ignore[arg-type]
    out = []
    for i, (low, high, rms) in enumerate(REGIMES):
        torque = multisine(round(seconds / H), H, low, high, rms * level, np.random.default_rng([seed, i, len(use)]))
        bench = {"resolution": COUNT, "torque_noise": 2e-5, "seed": seed + i, "substeps": 10}
        out.append(simulate(plant, torque, H, name=f"{use} {i}", use=use, **bench))  # type: ignore[arg-type]
    return out


def by_sysid(
    runs: list[Record], more: str, start: dict[str, tuple[float, Modifier]]
) -> tuple[dict[str, float], float, float]:
    """Values that `mujoco.sysid` finds, searched in logarithm; seconds until it stopped, and to 1 % of its cost."""
    begin = time.process_time()
    spec = mujoco.MjSpec.from_string(XML.format(h=H, more=more))
    model = spec.compile()
    chunks = []
    for r in runs:
        speed = savgol_filter(r.position, 41, 3, deriv=1, delta=H)
        for k in range(0, len(r) - CHUNK, CHUNK):
            part = slice(k, k + CHUNK)
            position = (r.position[part] - r.position[k])[:, None]
            control = np.column_stack([r.torque[part], *([np.zeros(CHUNK)] * (model.nu - 1))])
            clock = H * np.arange(CHUNK)
            data = mujoco.MjData(model)
            data.qvel[0] = speed[k]
            state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
            names = [("shaft", sysid.SignalType.MjStateQPos)]
            measured = sysid.TimeSeries.from_names(clock, position, model, names)
            commanded = sysid.TimeSeries.from_control_names(clock, control, model)
            chunks.append(sysid.SystemTrajectory(model, commanded, measured, state, None))
    params = sysid.ParameterDict()
    for name, (value, put) in start.items():
        def modify(s: Any, p: Any, put: Modifier = put) -> None:
            put(s, 10 ** float(p.value[0]))

        x = math.log10(value)
        params.add(sysid.Parameter(name, x, x - 1.5, x + 1.5, modifier=modify))

    costs: list[tuple[float, float]] = []

    def residual(x: Any, p: Any) -> Any:
        build = lambda p: sysid.apply_param_modifiers(p, spec)  # noqa: E731
        found = sysid.model_residual(x, p, build, chunks, resample_true=False)
        # Of several columns (finite differences) each has the residuals of all chunks.
        rows = found[0].T.reshape(x.shape[1], -1).T if x.ndim > 1 else found[0]
        costs.append((time.process_time() - begin, float(np.sum(rows.reshape(len(rows), -1)[:, 0] ** 2))))
        return [rows], found[1], found[2]

    with contextlib.redirect_stdout(io.StringIO()):
        best, _ = sysid.optimize(params, residual, verbose=False)
    spent = time.process_time() - begin
    last = min(c for _, c in costs)
    return {k: 10 ** float(best[k].value[0]) for k in start}, spent, next(t for t, c in costs if c <= 1.01 * last)


def joint(key: str) -> Modifier:
    def put(s: Any, x: float) -> None:
        old = getattr(s.joint("shaft"), key)  # damping has several coefficients, the first of them linear
        setattr(s.joint("shaft"), key, x if np.ndim(old) == 0 else [x, *np.asarray(old)[1:]])

    return put


def bearing(array: str, at: int) -> Modifier:
    def put(s: Any, x: float) -> None:
        getattr(s.actuator("bearing"), array)[at] = x

    return put


Found = dict[str, tuple[Plant, float, float]]  # seconds, and seconds to 1 %


def sysid_plants(runs: list[Record], truth: Plant, rng: np.random.Generator) -> Found:
    gms_ = truth["gms"].values
    near = lambda x: float(x) * float(2 ** rng.uniform(-1, 1))  # noqa: E731
    common = {"armature": (near(truth.inertia), joint("armature")), "damping": (near(2e-5), joint("damping"))}
    out = {}
    x, *spent = by_sysid(runs, "", common | {"frictionloss": (near(gms_["coulomb"]), joint("frictionloss"))})
    plant = Plant.axis(x["armature"]) + effects.find("coulomb")(coulomb=x["frictionloss"])
    out["mujoco.sysid: friction loss, damping, armature"] = (
        plant + effects.find("viscous")(coefficient=x["damping"]), *spent,
    )  # fmt: skip
    lugre = {
        "stiffness": (near(np.sum(gms_["stiffness"])), bearing("dynprm", 5)),
        "bristle": (near(3e-4), bearing("dynprm", 6)),
        "coulomb": (near(gms_["coulomb"]), bearing("biasprm", 3)),
        "static": (near(gms_["static"]), bearing("biasprm", 4)),
        "vs": (near(gms_["stribeck_velocity"]), bearing("biasprm", 5)),
    }
    x, *spent = by_sysid(runs, LUGRE, common | lugre)
    law = effects.find("lugre")(
        stiffness=x["stiffness"], damping=x["bristle"], coulomb=x["coulomb"], static=max(x["static"], x["coulomb"]),
        stribeck_velocity=x["vs"],
    )  # fmt: skip
    plant = Plant.axis(x["armature"]) + law + effects.find("viscous")(coefficient=x["damping"])
    out["mujoco.sysid: LuGre of a dcmotor, damping, armature"] = plant, *spent
    return out


def our_plants(runs: list[Record]) -> Found:
    models = {
        "gms.fit: coulomb, viscous, inertia": Plant.axis() + effects.find("coulomb")() + effects.find("viscous")(),
        "gms.fit: lugre, viscous, inertia": Plant.axis() + effects.find("lugre")() + effects.find("viscous")(),
        OURS: gms.baseline(),
    }
    out = {}
    for name, model in models.items():
        begin = time.process_time()
        plant = gms.fit(model, runs).plant
        spent = time.process_time() - begin
        out[name] = plant, spent, spent
    return out


def main(axes: int) -> None:
    table: dict[str, list[list[float]]] = {}
    for i in range(axes):
        rng = np.random.default_rng([11, i])
        truth = plant_of("servo_axis")
        truth = truth if i == 0 else scatter(truth, rng, 2.0)
        runs, other = records(truth, 20.0, "fit", 10 * i), records(truth, 5.0, "validate", 1000 + 10 * i)
        found = our_plants(runs) | sysid_plants(runs, truth, rng)
        band = float(found[OURS][0].provenance["bandwidth"])  # one for all
        for name, (plant, spent, sooner) in found.items():
            score = gms.compare(plant, other, bandwidth=band)
            table.setdefault(name, []).append([spent, sooner, 100 * score.torque_error, 100 * score.simulation_error])
            print(f"  axis {i}: {name}: {spent:.1f} s, {100 * score.torque_error:.2f} %", file=sys.stderr)
        score = gms.compare(truth, other, bandwidth=band)
        table.setdefault("the axis itself", []).append([0, 0, 100 * score.torque_error, 100 * score.simulation_error])
    rows = {k: np.median(v, axis=0) for k, v in table.items()}
    print(f"60 s of 2 kHz data; median over {axes} axes")
    print(f"{'':54} {'time [s]':>9} {'to 1 % [s]':>10} {'torque [%]':>11} {'motion [%]':>11}")
    for name, (spent, sooner, torque, motion) in rows.items():
        print(f"{name:54} {spent:9.2f} {sooner:10.2f} {torque:11.2f} {motion:11.2f}")
    for theirs, mine in PAIRS:
        ratio = np.median([[a[0] / b[0], a[1] / b[0]] for a, b in zip(table[theirs], table[mine], strict=True)], axis=0)
        print(f"{theirs} over {mine}: {ratio[0]:.0f} times the time, {ratio[1]:.0f} to 1 %")


if __name__ == "__main__":
    main(**arguments(__doc__, axes=3))
