"""How often the diagnosis names what is hidden, on axes that code other than ours simulated.

    python benchmarks/hidden_effects.py [--cases N] [--seed FIRST] [--kinds single,healthy,invented,pairs]
        [--effects cogging,...] [--strengths 0.05,0.12,0.3] [--noise DB] [--seconds S] [--rates 1000,2000,4000]
        [--inertia FACTOR] [--workers N]

Every case is a new axis (`bench_axes.py`): inertia over three decades, friction level, pre-sliding stiffness, encoder
of 12 to 20 bit, 1 to 4 kHz, noise 20 to 60 dB below the torque, its own choice of runs. The truth comes from MuJoCo's
own elements where it has them (`truth_mujoco.py`: friction by yielding springs, LuGre or frictionloss), else from a
small simulator in plain Python (`truth_plain.py`). Strength: height of the effect's torque (rms where it follows the
command) over the friction level.

The right answer to an axis with an invented effect, which no catalogue has, is to name nothing. Lines come as the cases
are done; the tables at the end, also after Ctrl-C. Seeds below 1000 were used while the rules were made; report others.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import bench_axes
import numpy as np
import truth_mujoco
import truth_plain
from bench_axes import Axis
from outcomes import HEAD, Case, Outcome, tables

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.record import Record

# Effects that may be told from each other, by MuJoCo and by the plain simulator.
PAIRS = (
    ("cogging", "gravity"), ("delay", "gravity"), ("cogging", "torque_saturation"), ("spring", "cogging"),
    ("flexible_coupling", "cogging"), ("torque_offset", "delay"), ("gravity", "thermal_drift"),
    ("asymmetric_friction", "cogging"), ("quadratic_drag", "gravity"), ("position_dependent_friction", "torque_offset"),
)  # fmt: skip

def measured(
    case: Case, rates: tuple[int, ...], seconds: float, noise: float | None, inertia: float | None = None
) -> tuple[Axis, Dataset]:
    """The axis of a case, and its records as a bench would log them; `inertia`: times the true one that is given."""
    rng = np.random.default_rng([case.seed, len(case.hidden)])
    axis = Axis.draw(rng, rates)
    if noise is not None:
        axis = replace(axis, decibels=noise)
    sets = bench_axes.runs(axis, seconds)
    by_mujoco = case.kind != "invented" and all(e in truth_mujoco.EFFECTS for e in case.hidden)
    if case.kind == "healthy" and rng.random() < 0.25:
        by_mujoco = False
    truth = truth_mujoco if by_mujoco else truth_plain
    if not by_mujoco:
        axis = replace(axis, friction="plain")
    hidden = {name: truth.sized(axis, name, case.strength, sets[0]) for name in case.hidden}
    built = truth_mujoco.model(axis, hidden) if by_mujoco else None
    made = []
    for use, chosen in zip(("fit", "validate"), sets, strict=True):
        for i, run in enumerate(chosen):
            load = None
            if built is not None:
                torque, position = truth_mujoco.simulate(axis, hidden, run, built)
            else:
                torque, position, load = truth_plain.simulate(axis, hidden, run, i)
            made.append((f"{use}_{i}_{run.name}", use, torque, position, load))
    size = np.sqrt(np.mean([np.mean(m[2] ** 2) for m in made])) * 10 ** (-axis.decibels / 20)
    records = []
    for name, use, torque, position, load in made:
        signals = {
            "torque": torque + size * rng.standard_normal(len(torque)),
            "position": np.round(position / axis.count) * axis.count,
        }
        if "load_dependent_friction" in hidden and load is not None:
            signals["load"] = load
        records.append(Record(name, np.arange(len(torque)) / axis.rate, signals, use, axis.count))
    if inertia is not None:  # wrong, so that the records have to tell it
        return replace(axis, given=False), Dataset(Path(), tuple(records), inertia=inertia * axis.inertia)
    return axis, Dataset(Path(), tuple(records), inertia=axis.inertia if axis.given else None)


def solve(case: Case, options: argparse.Namespace) -> Outcome:
    axis, runs = measured(case, options.rates, options.seconds, options.noise, options.inertia)
    began = time.process_time()
    d = gms.diagnose(runs)
    return Outcome.of(case, axis, d, time.process_time() - began)


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """In random order, so that a run that is cut has seen some of each."""
    singles = [e for e in (*truth_mujoco.EFFECTS, *truth_plain.EFFECTS) if not options.effects or e in options.effects]
    invented = [e for e in truth_plain.INVENTED if not options.effects or e in options.effects]
    seed = options.seed
    for _ in range(options.cases):
        for strength in options.strengths:
            batch: list[tuple[str, tuple[str, ...]]] = []
            if "single" in options.kinds:
                batch += [("single", (e,)) for e in singles]
            if "invented" in options.kinds and strength >= 0.1:
                batch += [("invented", (e,)) for e in invented]
            if "pairs" in options.kinds and strength >= 0.1:
                batch += [("pairs", p) for p in PAIRS]
            if "healthy" in options.kinds:
                batch += [("healthy", ())] * max(options.healthy, 0)
            for i in np.random.default_rng(seed).permutation(len(batch)):
                kind, hidden = batch[i]
                yield Case(kind, hidden, strength, seed)
                seed += 1


def left_to_the_parent() -> None:
    """Ctrl-C reaches a worker too, and is not for it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def solved(options: argparse.Namespace) -> Iterator[Outcome]:
    """The outcomes, as they come: with several workers not in the order of the cases."""
    if options.workers == 1:
        yield from (solve(case, options) for case in cases(options))
        return
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "GMS_MUJOCO_THREADS": "1"}  # of the workers to come
    with multiprocessing.get_context("spawn").Pool(options.workers, left_to_the_parent) as pool:
        yield from pool.imap_unordered(functools.partial(solve, options=options), cases(options))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)

    def names(text: str) -> tuple[str, ...]:
        return tuple(text.split(","))

    parser.add_argument("--cases", type=int, default=1, help="rounds over all effects")
    parser.add_argument("--seed", type=int, default=1000, help="of the first case; below 1000: development")
    parser.add_argument("--kinds", type=names, default=("single", "healthy", "invented", "pairs"))
    parser.add_argument("--effects", type=names, default=())
    parser.add_argument("--strengths", type=lambda s: tuple(map(float, s.split(","))), default=(0.3, 0.12, 0.05))
    parser.add_argument("--noise", type=float, default=None, help="dB below the torque; default: drawn from 20 to 60")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each record")
    parser.add_argument("--rates", type=lambda s: tuple(map(int, s.split(","))), default=(1000, 2000, 4000))
    parser.add_argument(
        "--inertia", type=float, default=None,
        help="times the true one that every axis is said to have; default: for half of them the true one is given",
    )
    parser.add_argument("--healthy", type=int, default=5, help="healthy axes per round and strength")
    parser.add_argument("--workers", type=int, default=1, help="processes, of one thread each if they are several")
    options = parser.parse_args()
    done: list[Outcome] = []
    print(HEAD)
    try:
        for outcome in solved(options):
            done.append(outcome)
            print(outcome, flush=True)
    except KeyboardInterrupt:
        pass
    print("\n" + tables(done))


if __name__ == "__main__":
    main()
