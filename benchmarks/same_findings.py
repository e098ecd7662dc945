"""What a change costs or saves in a diagnosis, and whether it still finds the same: this tree beside another.

    python benchmarks/same_findings.py OTHER [--cases N] [--only NAME,...] [DATASET ...]

OTHER is a folder with another version of the project, its native library built in place. Every measurement set given,
and N axes with hidden effects (`hidden_effects.py`, records of 3 s at 1 kHz, 45 dB), are diagnosed by either version,
one after the other, each in a process of its own on one thread. Printed: processor seconds of the diagnosis, the
effects found in order, and the errors on fit and validate records and their floor [% of the torque].
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import hidden_effects

import gms_mujoco as gms

CASES = (
    ("single", ("cogging",), 0.12, 300), ("single", ("flexible_coupling",), 0.3, 303),
    ("single", ("asymmetric_friction",), 0.12, 302), ("pairs", ("gravity", "thermal_drift"), 0.3, 307),
    ("healthy", (), 0.0, 308), ("single", ("backlash",), 0.3, 304), ("single", ("delay",), 0.12, 305),
    ("single", ("quadratic_drag",), 0.3, 306), ("single", ("gravity",), 0.12, 301),
    ("pairs", ("cogging", "torque_saturation"), 0.3, 309), ("single", ("load_dependent_friction",), 0.3, 310),
    ("single", ("spring",), 0.12, 311),
)  # fmt: skip


def one(what: str) -> dict[str, Any]:
    """The diagnosis of a measurement set, or of a case by its number."""
    if what.isdecimal():
        runs = hidden_effects.measured(hidden_effects.Case(*CASES[int(what)]), (1000,), 3.0, 45.0)[1]
    else:
        runs = gms.load(what)
    began = time.process_time()
    d = gms.diagnose(runs)
    return {
        "seconds": time.process_time() - began,
        "found": [s.effect for s in d.steps[1:]],
        "verdict": d.verdict,
        "errors": [d.steps[-1].result.error, d.steps[-1].validate_error, d.noise_floor],
    }


def by(tree: Path, what: str) -> dict[str, Any]:
    """The same by the version of a tree."""
    threads = {"GMS_MUJOCO_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, __file__, "--one", what], check=True, capture_output=True, text=True,
        env={**os.environ, **threads, "PYTHONPATH": str(tree)},
    )  # fmt: skip
    found: dict[str, Any] = json.loads(ran.stdout.splitlines()[-1])
    return found


def name(what: str) -> str:
    if not what.isdecimal():
        return Path(what).name
    _, hidden, strength, seed = CASES[int(what)]
    return f"{' + '.join(hidden) or 'healthy'}, {strength:.0%}, seed {seed}"


def errors(found: dict[str, Any]) -> str:
    return " / ".join("-" if e is None else f"{100 * e:.3g}" for e in found["errors"])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("other", nargs="?", type=Path)
    parser.add_argument("sets", nargs="*", default=[])
    parser.add_argument("--cases", type=int, default=6)
    parser.add_argument("--only", default="", help="numbers of the cases, in place of the first")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_intermixed_args()
    if options.one:
        print(json.dumps(one(options.one)))
        return
    numbers = options.only.split(",") if options.only else [str(i) for i in range(min(options.cases, len(CASES)))]
    here, total = Path(__file__).parents[1], [0.0, 0.0]
    print(f"{'':46} {'CPU [s]':>13} {'fit / validate / floor [%]':>42}  found")
    for what in (*options.sets, *numbers):
        before, after = by(options.other, what), by(here, what)
        total = [t + f["seconds"] for t, f in zip(total, (before, after), strict=True)]
        same = before["found"] == after["found"] and before["verdict"] == after["verdict"]
        said = [", ".join(f["found"]) or "nothing" for f in (before, after)]
        told = said[0] if same else f"! {said[0]} ({before['verdict']}) -> {said[1]} ({after['verdict']})"
        times = f"{before['seconds']:6.1f} {after['seconds']:6.1f}"
        print(f"{name(what):46} {times} {errors(before):>20}, {errors(after):>20}  {told}", flush=True)
    print(f"{'all':46} {total[0]:6.1f} {total[1]:6.1f}")


if __name__ == "__main__":
    main()
