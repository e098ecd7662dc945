"""What friction costs: a MuJoCo step with friction over the step without, beside MuJoCo's own elements.

Servo axis, seven-joint arm, and a humanoid of 27 driven hinges that stands on a floor; four elements on every hinge.
The variants take turns in short rounds of one process, pushed by the same torques, in every round others; the figure is
the median over the rounds of the ratio to the plain model in the same round, with the quartiles. A plug-in that does
nothing shows what MuJoCo takes for calling one: the least that any plug-in can cost.
Friction calms a motion, and with it the work of contacts and limits, ours as theirs: so each is also set over the plain
model on the same motion, which gets the torque of the friction applied. Then a batch on one thread and on all. Last,
instructions by callgrind, which no neighbour disturbs: those of a step beyond the plain one, per joint and element.

Run: python benchmarks/cost.py [rounds]
"""

import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
from arguments import arguments
from mujoco.batch import Batch

from gms_mujoco import effects, engine, native
from gms_mujoco.plant import Plant

Variant = Callable[[mujoco.MjSpec], str | None]  # changes the spec, or returns MJCF to add

MODELS = Path(__file__).resolve().parent.parent / "models"


def humanoid() -> str:
    """A floating trunk with a head, two arms and two legs: 27 hinges, contacts at the feet."""

    def limb(name: str, pos: str, joints: list[str], step: str, foot: bool = False) -> str:
        text, end = "", ""
        for i, axis in enumerate(joints):
            shift = pos if i == 0 else (step if i % 2 == 0 else "0 0 0")
            mass = 1.5 if i % 2 == 0 else 0.3
            text += (
                f'<body pos="{shift}"><joint name="{name}{i}" axis="{axis}" armature="0.02" range="-1 1"/>'
                f'<geom type="capsule" fromto="0 0 0 {step}" size="0.04" mass="{mass}" contype="0"/>'
            )
            end += "</body>"
        if foot:
            text += f'<geom type="box" pos="{step}" size="0.1 0.05 0.02" mass="0.5"/>'
        return text + end

    x, y, z = "1 0 0", "0 1 0", "0 0 1"
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody><geom type="plane" size="5 5 1"/>'
        '<body pos="0 0 0.9"><freejoint/><geom type="box" size="0.1 0.15 0.2" mass="10" contype="0"/>'
        + limb("neck", "0 0 0.25", [z, y, x], "0 0 0.08")
        + limb("left_arm", "0 0.2 0.15", [y, x, z, y, z, y], "0 0.05 -0.12")
        + limb("right_arm", "0 -0.2 0.15", [y, x, z, y, z, y], "0 -0.05 -0.12")
        + limb("left_leg", "0 0.1 -0.2", [z, x, y, y, y, x], "0 0 -0.2", foot=True)
        + limb("right_leg", "0 -0.1 -0.2", [z, x, y, y, y, x], "0 0 -0.2", foot=True)
        + "</body></worldbody><actuator>"
        + "".join(
            f'<motor joint="{name}{i}"/>'
            for name, n in (("neck", 3), ("left_arm", 6), ("right_arm", 6), ("left_leg", 6), ("right_leg", 6))
            for i in range(n)
        )
        + "</actuator></mujoco>"
    )


def level(spec: mujoco.MjSpec) -> float:
    """Friction level that suits the model [N m]."""
    return 4.5e-3 if len(spec.joints) == 1 else 4.0


def hinges(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_HINGE]


def plain(spec: mujoco.MjSpec) -> None:
    pass


def gms(integration: str, stiffer: float = 1.0, spread: float = 0.0) -> Variant:
    """The same friction on all joints, or with each joint's level and stiffness larger by `spread` than the last's."""

    def add(spec: mujoco.MjSpec) -> None:
        plants = {}
        for i, j in enumerate(hinges(spec)):
            f = level(spec) * (1 + spread * i)
            plants[j.name] = Plant.axis() + effects.GMS(
                stiffness=np.array([180.0, 90.0, 45.0, 20.0]) * f * stiffer, fraction=[0.1, 0.2, 0.3, 0.4], coulomb=f,
                static=1.2 * f, stribeck_velocity=0.8, attraction=60 * f,
            )
        engine.attach(spec, plants, integration)

    return add


def tendons(spec: mujoco.MjSpec) -> str:
    """Plain Maxwell-slip: four yielding springs on every joint."""
    f = level(spec)
    text = "".join(
        f'<fixed stiffness="{k * f}" springyield="{a / k}" springlength="0"><joint joint="{j.name}" coef="1"/></fixed>'
        for j in hinges(spec)
        for k, a in ((180.0, 0.1), (90.0, 0.2), (45.0, 0.3), (20.0, 0.4))
    )
    return f"<tendon>{text}</tendon>"


def lugre(spec: mujoco.MjSpec) -> str:
    f = level(spec)
    text = "".join(
        f'<dcmotor joint="{j.name}" input="none" motorconst="0" resistance="1" '
        f'lugre="{300 * f} 0 {f} {1.2 * f} 0.8"/>'
        for j in hinges(spec)
    )
    return f"<actuator>{text}</actuator>"


def frictionloss(spec: mujoco.MjSpec) -> None:
    for j in hinges(spec):
        j.frictionloss = level(spec)


class MjpPlugin(ctypes.Structure):
    """The head of MuJoCo's mjpPlugin; room for what follows, which is not used."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.c_void_p),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in ("nstate", "nsensordata", "init", "destroy", "copy", "reset")),
        *((name, ctypes.c_void_p) for name in ("compute", "advance")),
        ("rest", ctypes.c_void_p * 16),
    )


EMPTY = "nil"  # as long as the name of ours: MuJoCo measures it at every call
_empty: list[object] = []  # what the plug-in table points to


def register_empty() -> None:
    """Registers a plug-in with the capabilities of ours that does nothing. What a step calls is C that
    returns at once."""
    lib, zero = engine._libmujoco(), ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)
    none = ctypes.cast(lib.mj_version, ctypes.c_void_p).value
    init, nstate = zero(lambda *_: 0), ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int)(lambda *_: 0)
    plugin = MjpPlugin()
    lib.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = EMPTY.encode()
    plugin.capabilityflags = mujoco.mjtPluginCapabilityBit.mjPLUGIN_PASSIVE | (
        mujoco.mjtPluginCapabilityBit.mjPLUGIN_ACTUATOR
    )
    plugin.init = ctypes.cast(init, ctypes.c_void_p).value
    plugin.nstate = ctypes.cast(nstate, ctypes.c_void_p).value
    plugin.reset = plugin.compute = plugin.advance = none
    lib.mjp_registerPlugin(ctypes.byref(plugin))
    _empty[:] = [init, nstate, plugin]


def empty(spec: mujoco.MjSpec) -> None:
    """An instance of the plug-in that does nothing."""
    if not _empty:
        register_empty()
    spec.activate_plugin(EMPTY)
    instance = spec.add_plugin(name="empty", plugin_name=EMPTY, active=True)
    hinges(spec)[0].parent.plugin = instance


VARIANTS = {
    "plain": plain,
    "empty plug-in": empty,
    "gms explicit": gms("explicit"),
    "gms implicit": gms("implicit"),
    "gms explicit, no two alike": gms("explicit", spread=1e-3),
    "gms implicit, no two alike": gms("implicit", spread=1e-3),
    "gms implicit, 100 x stiffer": gms("implicit", 100),
    "springyield tendons": tendons,
    "dcmotor LuGre": lugre,
    "frictionloss": frictionloss,
}
SOURCES = {"servo": MODELS / "servo_axis.xml", "arm": MODELS / "arm.xml", "humanoid": humanoid()}
STEPS = {"servo": 4000, "arm": 700, "humanoid": 150}


def build(source: Path | str, variant: Variant) -> tuple[mujoco.MjModel, mujoco.MjData]:
    text = source if isinstance(source, str) else source.read_text()
    spec = mujoco.MjSpec.from_string(text)
    if more := variant(spec):
        spec = mujoco.MjSpec.from_string(text.replace("</mujoco>", more + "</mujoco>"))
    model = spec.compile()
    return model, mujoco.MjData(model)


def round_of(model: mujoco.MjModel, data: mujoco.MjData, steps: int, seed: int = 0) -> float:
    """Processor time of one step [s]. The joints move to and fro: torques around the friction level."""
    mujoco.mj_resetData(model, data)
    rng = np.random.default_rng(seed)
    size = 4.5e-3 if model.nv == 1 else 4.0
    spent = 0.0
    for _ in range(10):
        data.qfrc_applied[-27:] = rng.normal(size=min(model.nv, 27)) * 1.2 * size
        start = time.thread_time()
        mujoco.mj_step(model, data, steps // 10)
        spent += time.thread_time() - start
    return spent / (steps // 10 * 10)


ELEMENTS = 4
HINGES = {"servo": 1, "arm": 7, "humanoid": 27}


def table(rows: dict[str, list[str]]) -> None:
    print(f"{'':28s}" + "".join(f"{name:>26s}" for name in SOURCES))
    for v, row in rows.items():
        print(f"{v:28s}" + "".join(f"{cell:>26s}" for cell in row))


def times(rounds: int) -> None:
    print(f"MuJoCo {mujoco.__version__}; step time over plain, median (quartiles) of {rounds} rounds")
    rows: dict[str, list[str]] = {name: [] for name in VARIANTS}
    for name, source in SOURCES.items():
        built = {v: build(source, f) for v, f in VARIANTS.items()}
        spent: dict[str, list[float]] = {v: [] for v in VARIANTS}
        for i in range(rounds + 3):
            for v in list(VARIANTS) if i % 2 else list(VARIANTS)[::-1]:
                t = round_of(*built[v], STEPS[name], i)
                if i >= 3:
                    spent[v].append(t)
        base = np.array(spent["plain"])
        for v in VARIANTS:
            low, mid, high = np.quantile(np.array(spent[v]) / base, [0.25, 0.5, 0.75])
            us = np.median(spent[v]) * 1e6
            rows[v].append(f"{us:8.2f} us" if v == "plain" else f"{mid:.3f} ({low:.3f}-{high:.3f})")
    table(rows)


def friction_torques(model: mujoco.MjModel, data: mujoco.MjData) -> Callable[[], np.ndarray]:
    """Reads the torque of the friction on each dof in the last step: of our plug-in, or of LuGre as an actuator."""
    places = [(model.jnt_dofadr[j], native.reading(model._address, data._address, j)) for j in range(model.njnt)]
    ours = [(dof, found[0]) for dof, found in places if found]
    dofs, torques = np.array(ours or [(0, 0)]).T

    def read() -> np.ndarray:
        if not ours:
            return data.qfrc_actuator.copy()
        out = np.zeros(model.nv)
        out[dofs] = data.plugin_state[torques]
        return out

    return read


def along(rounds: int) -> None:
    """Step time over that of the plain model on the same motion. Both run from torques recorded for every step."""
    print(f"\nstep time over plain on the same motion, median (quartiles) of {rounds} rounds")
    variants = ("gms explicit", "gms implicit", "gms implicit, 100 x stiffer", "dcmotor LuGre")
    rows: dict[str, list[str]] = {v: [] for v in variants}
    spec, full = mujoco.mjtState.mjSTATE_QFRC_APPLIED, mujoco.mjtState.mjSTATE_FULLPHYSICS
    for name, source in SOURCES.items():
        n = STEPS[name]
        for v in variants:
            pair = [build(source, VARIANTS[v]), build(source, plain)]
            (model, data), read = pair[0], friction_torques(*pair[0])
            size, rng = 4.5e-3 if model.nv == 1 else 4.0, np.random.default_rng(0)
            applied, friction = np.zeros((n, model.nv)), np.zeros((n, model.nv))
            for k in range(n):
                applied[k] = applied[k - 1]
                if k % (n // 10) == 0:
                    applied[k, -27:] = rng.normal(size=min(model.nv, 27)) * 1.2 * size
                data.qfrc_applied[:] = applied[k]
                mujoco.mj_step(model, data)
                friction[k] = read()
            ratios, ends = [], []
            for i in range(rounds + 3):
                spent = []
                for (m, d), torque in zip(pair, (applied, applied + friction), strict=True):
                    mujoco.mj_resetData(m, d)
                    start = np.empty(mujoco.mj_stateSize(m, full))
                    mujoco.mj_getState(m, d, start, full)
                    before = time.thread_time()
                    mujoco.rollout.rollout(m, d, start, torque[None], control_spec=spec)
                    spent.append(time.thread_time() - before)
                    ends.append(d.qpos.copy())
                if i >= 3:
                    ratios.append(spent[0] / spent[1])
            low, mid, high = np.quantile(ratios, [0.25, 0.5, 0.75])
            same = np.allclose(ends[0], ends[1], rtol=1e-4, atol=1e-6)
            rows[v].append(f"{mid:.3f} ({low:.3f}-{high:.3f})" + ("" if same else " !"))
    table(rows)
    print("!: the plain model has left the motion, by rounding that grows at contacts")


COUNTED = 100  # steps


def counts() -> dict[tuple[str, str], float]:
    """Instructions of a step by callgrind, which writes out its sums whenever a round begins by resetting its data."""
    with tempfile.TemporaryDirectory() as folder:
        options = [f"--callgrind-out-file={folder}/part", "--toggle-collect=mj_step", "--dump-before=mj_resetData"]
        subprocess.run(
            ["valgrind", "--tool=callgrind", *options, sys.executable, __file__, "--count"],
            check=True, capture_output=True,
        )
        parts = sorted(Path(folder).glob("part*"), key=lambda f: int(f.suffix[1:] or 10**9))
        sums = [int(n) for f in parts for n in re.findall(r"^totals: (\d+)", f.read_text(), re.M)]
    rounds = [(name, v) for name in SOURCES for v in VARIANTS]
    return {r: n / COUNTED for r, n in zip(rounds, sums[1:], strict=True)}  # the first is of compiling


def instructions() -> None:
    if not shutil.which("valgrind"):
        print("\ninstructions: left out, valgrind is not installed")
        return
    print(f"\ninstructions of a step beyond the plain one, per joint and element ({ELEMENTS} on every joint)")
    counted = counts()
    rows: dict[str, list[str]] = {v: [] for v in VARIANTS}
    for name in SOURCES:
        base = counted[name, "plain"]
        for v in VARIANTS:
            share = (counted[name, v] - base) / HINGES[name] / ELEMENTS
            rows[v].append(f"{base:.0f} in all" if v == "plain" else f"{share:.0f}")
    table(rows)


def batch(rounds: int, worlds: int = 64, steps: int = 40) -> None:
    """Steps of the arm in a Batch: throughput against plain, and whether the number of threads changes a bit."""
    threads = os.cpu_count() or 1
    print(f"\nbatch of {worlds} arms, throughput over plain, median of {rounds} rounds, on 1 and {threads} threads")
    ends: dict[str, list[np.ndarray]] = {}
    spent: dict[tuple[str, int], list[float]] = {}
    variants = ("plain", "empty plug-in", "gms explicit", "gms implicit")
    models = {v: build(SOURCES["arm"], VARIANTS[v])[0] for v in variants}
    for n in (1, threads):
        batches = {v: Batch(models[v], worlds, n, True) for v in variants}
        rng = np.random.default_rng(0)
        for i in range(rounds):
            ctrl = rng.normal(size=(worlds, 7)) * 5
            for v in variants if i % 2 else variants[::-1]:
                batches[v].ctrl[:] = ctrl
                start = time.process_time()  # of all threads: the neighbours of this process do not count
                for _ in range(steps):
                    batches[v].step()
                spent.setdefault((v, n), []).append(time.process_time() - start)
        for v in variants:
            ends.setdefault(v, []).append(np.array(batches[v].qpos))
    for v in variants[1:]:
        ratio = [np.median(np.array(spent["plain", n]) / np.array(spent[v, n])) for n in (1, threads)]
        same = np.array_equal(*ends[v])
        print(f"{v:28s}{ratio[0]:8.3f}{ratio[1]:8.3f}   {'the same' if same else 'NOT the same'} to the last bit")


def main() -> None:
    warnings.simplefilter("ignore")
    if sys.argv[1:2] == ["--count"]:
        for built in [build(source, v) for source in SOURCES.values() for v in VARIANTS.values()]:
            round_of(*built, COUNTED)
        return
    rounds = arguments(__doc__, rounds=60)["rounds"]
    times(rounds)
    along(rounds)
    batch(rounds)
    instructions()


if __name__ == "__main__":
    main()
