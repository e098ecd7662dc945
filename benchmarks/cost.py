"""What friction costs: time of a MuJoCo step with friction over the time without, beside MuJoCo's own elements.

Servo axis, seven-joint arm, and a humanoid of 27 hinges that stands on a floor; four elements on every hinge. The
variants take turns in short rounds of one process; the figure is the median over the rounds of the ratio to the
plain model in the same round, with the quartiles. Run: python benchmarks/cost.py [rounds]
"""

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from gms_mujoco import effects, engine
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
        + "</body></worldbody></mujoco>"
    )


def level(spec: mujoco.MjSpec) -> float:
    """Friction level that suits the model [N m]."""
    return 4.5e-3 if len(spec.joints) == 1 else 4.0


def hinges(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_HINGE]


def plain(spec: mujoco.MjSpec) -> None:
    pass


def gms(integration: str) -> Variant:
    def add(spec: mujoco.MjSpec) -> None:
        f = level(spec)
        law = effects.GMS(
            stiffness=np.array([180.0, 90.0, 45.0, 20.0]) * f, fraction=[0.1, 0.2, 0.3, 0.4], coulomb=f,
            static=1.2 * f, stribeck_velocity=0.8, attraction=60 * f,
        )
        plant = Plant.axis() + law
        engine.attach(spec, {j.name: plant for j in hinges(spec)}, integration)

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


VARIANTS = {
    "plain": plain,
    "gms explicit": gms("explicit"),
    "gms implicit": gms("implicit"),
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


def round_of(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> float:
    """Time of one step [s]. The joints move to and fro: torques around the friction level."""
    mujoco.mj_resetData(model, data)
    rng = np.random.default_rng(0)
    size = 4.5e-3 if model.nv == 1 else 4.0
    spent = 0.0
    for _ in range(10):
        data.qfrc_applied[-27:] = rng.normal(size=min(model.nv, 27)) * 1.2 * size
        start = time.perf_counter()
        mujoco.mj_step(model, data, steps // 10)
        spent += time.perf_counter() - start
    return spent / (steps // 10 * 10)


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    warnings.simplefilter("ignore")
    print(f"MuJoCo {mujoco.__version__}; step time over plain, median (quartiles) of {rounds} rounds")
    print(f"{'':24s}" + "".join(f"{name:>26s}" for name in SOURCES))
    table: dict[str, list[str]] = {name: [] for name in VARIANTS}
    for name, source in SOURCES.items():
        built = {v: build(source, f) for v, f in VARIANTS.items()}
        times = {v: [] for v in VARIANTS}  # type: dict[str, list[float]]
        for i in range(rounds + 3):
            order = list(VARIANTS) if i % 2 else list(VARIANTS)[::-1]
            for v in order:
                t = round_of(*built[v], STEPS[name])
                if i >= 3:
                    times[v].append(t)
        base = np.array(times["plain"])
        for v in VARIANTS:
            low, mid, high = np.quantile(np.array(times[v]) / base, [0.25, 0.5, 0.75])
            us = np.median(times[v]) * 1e6
            table[v].append(f"{us:8.2f} us" if v == "plain" else f"{mid:.3f} ({low:.3f}-{high:.3f})")
    for v, row in table.items():
        print(f"{v:24s}" + "".join(f"{cell:>26s}" for cell in row))


if __name__ == "__main__":
    main()
