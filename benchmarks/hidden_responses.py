"""How often the diagnosis names what is hidden from stepped-sine responses alone, on axes that MuJoCo simulated.

    python benchmarks/hidden_responses.py [--cases N] [--seed FIRST] [--effects delay,...,none] [--strengths 0.3,0.12]

Every case is a new axis (`bench_axes.py`) of MuJoCo's own elements (`truth_mujoco.py`): friction by yielding springs
or LuGre, drawn inertia, level, stiffness, encoder of 15 to 20 bit, sample rate and noise. Sines of eight torques, 0.12
to 3 times the friction level, at fourteen frequencies from a tenth of the Dahl resonance to five times it are held one
after the other; `gms.estimate_frf` makes a point of each; two of the torques validate. What an encoder does not see is
left out. Axes with gravity stand off its rest, by a constant torque such as an integrator holds.

Strength: torque of the effect over the friction level, at the largest motion (spring, gravity, viscous), or beside the
largest torque a little above the resonance (delay, lag, coupling). `viscous` is hidden from a GMS baseline without
drag. The right answer is the effect, or one that does the same to these data (ALIKE). Seeds below 1000 were used while
the rules were made; report others.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import truth_mujoco
from bench_axes import Array, Axis
from outcomes import HEAD, SAME, Case, Outcome, tables

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF, join_sines
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

EFFECTS = ("flexible_coupling", "current_loop_lag", "delay", "viscous", "spring", "gravity")
# On small motion a torque in proportion to the position is either.
ALIKE = SAME | {"spring": {"gravity"}, "gravity": {"spring"}}
LEVELS = np.geomspace(0.12, 3.0, 8)
VALIDATE = (2, 5)
POINTS = 14
RISE, SETTLE, KEPT = 2, 4, 6  # windows


def sized(axis: Axis, name: str, strength: float) -> truth_mujoco.Values:
    """Parameters of an effect that matters by `strength` in these measurements."""
    rng, top = axis.rng, strength * axis.level
    slowest, middle = 2 * math.pi * frequencies(axis)[[0, -5]]
    free = (LEVELS[-1] - 1) * axis.level / axis.inertia  # acceleration beyond friction
    if name in ("delay", "current_loop_lag"):
        return {"time": strength / LEVELS[-1] * 3 / middle}
    if name == "flexible_coupling":
        ratio = float(np.exp(rng.uniform(math.log(0.8), math.log(3.0))))
        share = float(np.clip(strength * rng.uniform(1, 2), 0.03, 0.6))
        omega = ratio * 2 * math.pi * axis.resonance
        return {"inertia": share * axis.inertia, "omega": omega, "zeta": float(rng.uniform(0.02, 0.15))}
    if name == "viscous":
        return {"coefficient": top / (free / slowest)}
    far = free / slowest**2
    if name == "spring":
        return {"stiffness": top / far, "rest": 0.0}
    if name == "gravity":
        return {"torque": top / min(far, 1.0), "phase": float(rng.uniform(-math.pi, math.pi))}
    raise ValueError(name)


def frequencies(axis: Axis) -> Array:
    """(POINTS,) a whole number of periods in a whole number of samples [Hz]."""
    wanted = np.geomspace(0.1 * axis.resonance, min(5 * axis.resonance, axis.rate / 10), POINTS)
    periods = np.maximum(np.ceil(40 * wanted / axis.rate), 1)
    return np.asarray(periods * axis.rate / np.round(periods * axis.rate / wanted))


def measured(name: str, strength: float, seed: int) -> tuple[Axis, list[FRF]]:
    """An axis, and its responses as a bench would measure them."""
    rng = np.random.default_rng([seed, 77])
    axis = Axis.draw(rng)
    # MuJoCo's friction loss creeps below its level, at a rate that is the time step's: no bearing does.
    friction = axis.friction if axis.friction != "frictionloss" else str(rng.choice(["springyield", "lugre"]))
    viscous = 0.0 if name == "viscous" else axis.viscous
    if name == "viscous":  # a plant of the user's keeps its law of friction
        friction = "springyield"
    axis = replace(axis, bits=int(rng.integers(15, 21)), friction=friction, viscous=viscous)
    hidden = {} if name == "none" else {name: sized(axis, name, strength)}
    if (drag := hidden.pop("viscous", None)) is not None:
        axis = replace(axis, viscous=drag["coefficient"])
    start, held = float(rng.uniform(0, 6)), 0.0
    if "spring" in hidden:
        hidden["spring"]["rest"] = start
    m, parts = truth_mujoco.model(axis, hidden)
    if "gravity" in hidden:
        start, held = standing(m, hidden["gravity"]["torque"], rng)
    out = []
    for i, level in enumerate(LEVELS * axis.level):
        points = []
        for f in frequencies(axis):
            torque, position = sine(axis, m, parts, f, level, start, held)
            noise = level / math.sqrt(2) * 10 ** (-axis.decibels / 20)
            signals = {
                "torque": torque + noise * rng.standard_normal(len(torque)),
                "position": np.round(position / axis.count) * axis.count,
            }
            record = Record(f"{f:.3g} Hz", np.arange(len(torque)) / axis.rate, signals, "fit", axis.count)
            window = max(math.ceil(40 * f / axis.rate), 1) / f
            try:
                points.append(gms.estimate_frf(record, period=window, transient=RISE + SETTLE))
            except DataError:  # less than a count
                continue
        same = [f for f in points if f.amplitude is not None and f.amplitude[0] > 2 * axis.count]
        use = "validate" if i in VALIDATE else "fit"
        if len(same) > 3:
            out += [replace(f, name=f"{level:.3g} N m", use=use) for f in join_sines(same, 0.5)]
    return axis, out


def standing(m: mujoco.MjModel, torque: float, rng: np.random.Generator) -> tuple[float, float]:
    """Where an axis with gravity stands, up to 60 degrees off its rest, and the torque that holds it there."""
    data, angle, pull = mujoco.MjData(m), np.linspace(0, 2 * math.pi, 721), []
    for q in angle:
        data.qpos[0] = q
        data.plastic[:] = q
        mujoco.mj_forward(m, data)
        pull.append(data.qfrc_bias[0])
    rest = angle[np.argmin(np.abs(pull) + torque * (np.gradient(pull) < 0))]
    start = float(rest + rng.uniform(-1, 1))
    return start, float(np.interp(start % (2 * math.pi), angle, pull))


def sine(
    axis: Axis, m: mujoco.MjModel, parts: int, frequency: float, level: float, start: float, held: float
) -> tuple[Array, Array]:
    """Torque from each sample to the next, and position at the sample: whole windows, the first ones rising."""
    window = round(max(math.ceil(40 * frequency / axis.rate), 1) * axis.rate / frequency)
    n = window * (RISE + SETTLE + KEPT)
    torque = held + level * np.minimum(np.arange(n) / (RISE * window), 1) * np.sin(
        2 * math.pi * frequency * np.arange(n) / axis.rate
    )
    data = mujoco.MjData(m)
    data.qpos[0] = start
    data.plastic[:] = start
    position, half = np.empty(n), 0.5 * m.opt.timestep
    for k, u in enumerate(torque):
        position[k] = data.qpos[0] - half * data.qvel[0]  # by which a semi-implicit step leads
        data.ctrl[0] = u
        mujoco.mj_step(m, data, parts)
    return torque, position


def solve(case: Case) -> Outcome:
    name = case.hidden[0] if case.hidden else "none"
    axis, frfs = measured(name, case.strength, case.seed)
    inertia = axis.inertia if axis.given else None
    plant = Plant.axis(inertia) + effects.find("gms")(8) if name == "viscous" else None
    began = time.process_time()
    d = gms.diagnose(Dataset(Path(), (), inertia=inertia, frfs=tuple(frfs)), plant)
    return Outcome.of(case, axis, d, time.process_time() - began, ALIKE)


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """In random order, so that a run that is cut has seen some of each."""
    seed = options.seed
    for _ in range(options.cases):
        for strength in options.strengths:
            for i in np.random.default_rng(seed).permutation(len(options.effects)):
                name = options.effects[i]
                yield Case("healthy", (), strength, seed) if name == "none" else Case("single", (name,), strength, seed)
                seed += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1, help="rounds over all effects")
    parser.add_argument("--seed", type=int, default=1000, help="of the first case; below 1000: development")
    parser.add_argument("--effects", type=lambda s: tuple(s.split(",")), default=(*EFFECTS, "none", "none"))
    parser.add_argument("--strengths", type=lambda s: tuple(map(float, s.split(","))), default=(0.3, 0.12))
    options = parser.parse_args()
    done: list[Outcome] = []
    print(HEAD)
    try:
        for case in cases(options):
            done.append(solve(case))
            print(done[-1], flush=True)
    except KeyboardInterrupt:
        pass
    if done:
        print("\n" + tables(done))


if __name__ == "__main__":
    main()
