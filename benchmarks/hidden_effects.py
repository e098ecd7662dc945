"""How often the diagnosis names what is hidden, on axes that code other than ours simulated.

    python benchmarks/hidden_effects.py [--cases N] [--seed FIRST] [--kinds single,healthy,invented,pairs]
        [--effects cogging,...] [--strengths 0.05,0.12,0.3] [--noise DB] [--seconds S] [--rates 1000,2000,4000]

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
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bench_axes
import numpy as np
import truth_mujoco
import truth_plain
from bench_axes import Axis

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.record import Record

# Effects that may be told from each other, by MuJoCo and by the plain simulator.
PAIRS = (
    ("cogging", "gravity"), ("delay", "gravity"), ("cogging", "torque_saturation"), ("spring", "cogging"),
    ("flexible_coupling", "cogging"), ("torque_offset", "delay"), ("gravity", "thermal_drift"),
    ("asymmetric_friction", "cogging"), ("quadratic_drag", "gravity"), ("position_dependent_friction", "torque_offset"),
)  # fmt: skip
# The same torque by another name, on motion like this: an answer that counts as right.
SAME = {"current_loop_lag": {"delay"}, "delay": {"current_loop_lag"}}


@dataclass(frozen=True)
class Case:
    """What to hide: effects of the catalogue, or one that it does not have."""

    kind: str
    hidden: tuple[str, ...]
    strength: float
    seed: int


@dataclass(frozen=True)
class Outcome:
    case: Case
    found: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]  # what each of them was said to be confusable with
    verdict: str
    errors: tuple[float, float, float]  # validate before, after, noise floor
    seconds: float
    inertia: float  # found over true; nan where it was given
    remainder: str

    @property
    def first(self) -> str:
        return self.found[0] if self.found else "nothing"

    @property
    def right(self) -> bool:
        want = self.case.hidden if self.case.kind in ("single", "pairs") else ()
        if not want:
            return not self.found
        return self.first in want or any(self.first in SAME.get(w, ()) for w in want)

    @property
    def whole(self) -> bool:
        """Everything that is hidden was found, and nothing else."""
        found = set(self.found)
        return len(found) == len(self.case.hidden) and all(
            w in found or found & SAME.get(w, set()) for w in self.case.hidden
        )


def measured(case: Case, rates: tuple[int, ...], seconds: float, noise: float | None) -> tuple[Axis, Dataset]:
    """The axis of a case, and its records as a bench would log them."""
    rng = np.random.default_rng([case.seed, len(case.hidden)])
    axis = Axis.draw(rng, rates)
    if noise is not None:
        object.__setattr__(axis, "decibels", noise)
    sets = bench_axes.runs(axis, seconds)
    by_mujoco = case.kind != "invented" and all(e in truth_mujoco.EFFECTS for e in case.hidden)
    if case.kind == "healthy" and rng.random() < 0.25:
        by_mujoco = False
    truth = truth_mujoco if by_mujoco else truth_plain
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
    return axis, Dataset(Path(), tuple(records), inertia=axis.inertia if axis.given else None)


def solve(case: Case, options: argparse.Namespace) -> Outcome:
    axis, runs = measured(case, options.rates, options.seconds, options.noise)
    began = time.perf_counter()
    d = gms.diagnose(runs)
    took = time.perf_counter() - began
    errors = [float(x or 0) for x in (d.steps[0].validate_error, d.steps[-1].validate_error, d.noise_floor)]
    return Outcome(
        case,
        tuple(str(s.effect) for s in d.steps[1:]),
        tuple(s.confusable_with for s in d.steps[1:]),
        d.verdict,
        (errors[0], errors[1], errors[2]),
        took,
        float("nan") if axis.given else float(d.plant.inertia or 0) / axis.inertia,
        d.remainder,
    )


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


def line(o: Outcome) -> str:
    found = [f + (f" (or {', '.join(a)})" if a else "") for f, a in zip(o.found, o.alike, strict=True)]
    before, after, floor = (100 * e for e in o.errors)
    good = o.whole if o.case.kind == "pairs" else o.right
    hidden = " + ".join(o.case.hidden) or "none"
    said = f"  [{o.remainder}]" if o.case.kind == "invented" else ""
    return (
        f"{o.case.kind:8} {hidden:38} {o.case.strength:5.0%} {o.case.seed:5} {o.verdict:16} {before:6.2f} {after:6.2f} "
        f"{floor:6.2f} {o.seconds:4.0f}  {'' if good else '! '}{', '.join(found) or 'nothing'}{said}"
    )


def tables(done: list[Outcome]) -> str:
    out: list[str] = []

    def share(name: str, chosen: list[bool]) -> None:
        if chosen:
            out.append(f"{name:56} {sum(chosen):4} of {len(chosen):4}  {np.mean(chosen):5.0%}")

    singles = [o for o in done if o.case.kind == "single"]
    strengths = sorted({o.case.strength for o in singles})
    if singles:
        out.append(f"{'named first':40}" + "".join(f"{s:>9.0%}" for s in strengths))
        for name in dict.fromkeys(o.case.hidden[0] for o in singles):
            row = [[o.right for o in singles if o.case.hidden[0] == name and o.case.strength == s] for s in strengths]
            out.append(f"{name:40}" + "".join(f"{f'{sum(r)}/{len(r)}':>9}" for r in row))
        row = [[o.right for o in singles if o.case.strength == s] for s in strengths]
        out.append(f"{'all':40}" + "".join(f"{np.mean(r) if r else 0:>9.0%}" for r in row))
        out += ["", "confusion: hidden, then what was named first"]
        for name in dict.fromkeys(o.case.hidden[0] for o in singles):
            named = Counter(o.first for o in singles if o.case.hidden[0] == name)
            out.append(f"{name:40} " + ", ".join(f"{k} {n}" for k, n in named.most_common()))
        out.append("")
    share("named first and nothing false after it", [o.whole for o in singles])
    share("false alarms on healthy axes", [bool(o.found) for o in done if o.case.kind == "healthy"])
    share("abstention: nothing named for an invented effect", [not o.found for o in done if o.case.kind == "invented"])
    share("pairs fully found", [o.whole for o in done if o.case.kind == "pairs"])
    right = [o for o in done if o.case.hidden and o.right and o.case.kind == "single"]
    if right:
        ratio = np.array([o.errors for o in right])
        out.append(
            "validate error over noise floor, median (90 %): "
            f"before {np.median(ratio[:, 0] / ratio[:, 2]):.2f}, after {np.median(ratio[:, 1] / ratio[:, 2]):.2f} "
            f"({np.quantile(ratio[:, 1] / ratio[:, 2], 0.9):.2f}); at most 1.2 in "
            f"{np.mean(ratio[:, 1] <= 1.2 * ratio[:, 2]):.0%}"
        )
    bias = np.array([o.inertia for o in done if np.isfinite(o.inertia) and o.right and o.case.kind != "invented"])
    if len(bias):
        out.append(
            f"identified inertia over true one: median {np.median(bias):.4f}, 90 % within "
            f"{np.quantile(np.abs(bias - 1), 0.9):.2%}"
        )
    if done:
        took = np.array([o.seconds for o in done])
        out.append(f"time per case: median {np.median(took):.1f} s, longest {took.max():.1f} s")
    return "\n".join(out)


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
    parser.add_argument("--healthy", type=int, default=5, help="healthy axes per round and strength")
    options = parser.parse_args()
    done: list[Outcome] = []
    print(f"{'kind':8} {'hidden':35} strength  seed verdict          before  after  floor    s  found")
    try:
        for case in cases(options):
            done.append(solve(case, options))
            print(line(done[-1]), flush=True)
    except KeyboardInterrupt:
        pass
    print("\n" + tables(done))


if __name__ == "__main__":
    main()
