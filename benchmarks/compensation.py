"""Friction compensation on a servo axis, from PID to an oracle: one table.

Task: the references of `GmsMujoco/ServoTracking-v0`, a 2 kHz servo with a million counts per revolution on the axis
of Yoon and Trumper (models/servo_axis.toml).

Figure: rms of the true tracking error over an episode of 0.75 s in encoder counts, from its first sample on; over the
episodes the inter-quartile mean, with a 95 % interval from 2000 bootstrap resamples. Every cell of a column has the
same episodes of the fixed test split.

Columns. The controllers know
  exact        the friction of the axis itself, and that it has never moved; tasks micro_steps, slow_sine, reversals
  history      the same, but the elements come from a history that no controller knows
  identified   a model fitted to three logs of that axis: GMS with 8 elements, or LuGre, each with viscous drag
  20 % off     the friction of the axis, whose parameters differ by up to a factor of 1.2, in each episode another
  held out     the same with factors between 1.4 and 1.96: identified on one friction, run on another
  hidden       the exact friction, but the axis has cogging of 0.3 Fc that no model knows
  sliding      as exact, in point_to_point and quadrants
  own feedback as exact, where the bandwidth of the feedback is tuned as well (20 to 120 Hz); else it is 50 Hz for all

Tuning, the same for all: the defaults, then points of a scrambled Sobol sequence in the box of each controller's own
parameters (log scale), as many together as the budget says, scored by the mean log error over the same episodes of the
train split, all five tasks, on the axis as it was identified: all columns but the first and the last two ask what
becomes of that on another axis. (With scattered friction a few episodes are not enough: what they have too much of,
the tuning takes for a share above 1.) Those without a parameter of their own are not tuned. What is learned has its own
budget, said in its row, in samples of the environment with friction scattered by 1.4: the CEM policy, PPO and SAC
(--rl). ILC repeats each test episode, which no other controller may.

Goal: the GMS observer at most 1.5 times above the oracle and at least 5 times below PID + feedforward. Where it is
missed, that is the column's question: elements with a history are loaded by what the observer cannot know until they
slip; an observer on wrong parameters leaves that part of the friction; it knows no cogging, which a disturbance
observer beside it takes; and a stiffer feedback leaves less friction to compensate, down to the half count that the
encoder cannot see.

Cost: one call of the Python controller, mean; the laws themselves take about a microsecond in C.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/compensation.py [--quick] [--episodes N] [--budget N] [--rl SAMPLES]
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from scipy.stats import qmc, trim_mean

import gms_mujoco as gms
from gms_mujoco import control, demo, learn
from gms_mujoco.plant import Plant
from gms_mujoco.progress import Bar
from gms_mujoco.tasks import PRESLIDING, TASKS

ID = "GmsMujoco/ServoTracking-v0"
H = 1 / 2000  # s
COUNT = 2 * np.pi / 1e6
PLANT = Plant.load("servo_axis")
J = PLANT.inertia
FC = PLANT["gms"].coulomb
BANDWIDTH = 50.0  # of the feedback where it is not tuned [Hz]
TRIALS = 6  # of ILC
SLIDING = ("point_to_point", "quadrants")
COGGING = gms.effects.Cogging(harmonics=[8], amplitude=[0.3 * FC], phase=[0.4])
BARE = PLANT.replace(PLANT["gms"].replace(coulomb=1e-12, static=1e-12, stiffness=[1e-9] * 8)).replace(
    PLANT["viscous"].replace(coefficient=0.0)
)

Parameters = dict[str, float]


@dataclass(frozen=True)
class Entry:
    """A controller of the table.

    Attributes:
        make: from its parameters, the model it may know (a plant with GMS, one with LuGre), axes and row.
        box: lowest and highest value of each parameter; the tuning searches in it.
        trials: how often it may repeat an episode.
        prepare: done to the axes once the episodes are drawn.
    """

    make: Callable[[Parameters, "Models", Any, int], control.Controller]
    box: dict[str, tuple[float, float]] = field(default_factory=dict)
    trials: int = 1
    prepare: Callable[[Any], None] | None = None


@dataclass(frozen=True)
class Models:
    """What the controllers know of the friction."""

    gms: Plant
    lugre: Plant


def pid(p: Parameters) -> control.Controller:
    return control.PID(J, H, p.get("bandwidth", BANDWIDTH), p.get("filter", 250.0))


def plain(p: Parameters, drag: float = 0.0) -> control.Controller:
    return pid(p) + control.Feedforward(J, drag)


def coulomb_viscous(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    level = p.get("share", 1.0) * m.gms["gms"].coulomb
    return plain(p, m.gms["viscous"].coefficient) + control.CoulombFeedforward(level, p.get("width", 0.2))


def disturbance_observer(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    return plain(p) + control.DisturbanceObserver(J, H, p.get("observer", 60.0))


def both_observers(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    known = control.GMSObserver(m.gms, H)
    return plain(p) + control.DisturbanceObserver(J, H, p.get("observer", 60.0), known)


def adrc(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    return control.ADRC(J, H, p.get("bandwidth", BANDWIDTH), p.get("observer", 150.0))


def ilc(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    return control.ILC(lambda: plain(p), H, p.get("gain", 0.7), p.get("low_pass", 100.0))


def oracle(p: Parameters, m: Models, axes: Any, k: int) -> control.Controller:
    return plain(p) + control.Oracle(lambda: axes.friction(k))


def without_friction(axes: Any) -> None:
    for k in range(axes.n):
        bare = BARE + COGGING.replace(amplitude=[0.0]) if "cogging" in axes.plant else BARE
        axes.exchange(k, bare)


SHARE = {"share": (0.6, 1.2)}
OBSERVER = {"observer": (15.0, 300.0)}
ENTRIES: dict[str, Entry] = {
    "PID": Entry(lambda p, m, axes, k: pid(p), {"filter": (100.0, 900.0)}),
    "PID + feedforward": Entry(lambda p, m, axes, k: plain(p), {"filter": (100.0, 900.0)}),
    "+ Coulomb-viscous feedforward": Entry(coulomb_viscous, {"share": (0.2, 1.2), "width": (0.01, 3.0)}),
    "+ LuGre observer": Entry(
        lambda p, m, axes, k: plain(p) + p.get("share", 1.0) * control.LuGreObserver(m.lugre, H), SHARE
    ),
    "+ GMS feedforward": Entry(
        lambda p, m, axes, k: plain(p) + p.get("share", 1.0) * control.GMSFeedforward(m.gms, H), SHARE
    ),
    "+ GMS observer": Entry(
        lambda p, m, axes, k: plain(p) + p.get("share", 1.0) * control.GMSObserver(m.gms, H), SHARE
    ),
    "+ disturbance observer": Entry(disturbance_observer, OBSERVER),
    "+ GMS and disturbance observers": Entry(both_observers, OBSERVER),
    "ADRC (extended state observer)": Entry(adrc, {"observer": (60.0, 600.0)}),
    f"+ ILC, {TRIALS} trials": Entry(ilc, {"gain": (0.2, 1.0), "low_pass": (30.0, 400.0)}, TRIALS),
    "oracle": Entry(oracle),
    "noise floor (no friction)": Entry(lambda p, m, axes, k: plain(p), prepare=without_friction),
}


@dataclass(frozen=True)
class Condition:
    """A column: options of the environment, and whether the models are identified ones."""

    options: dict[str, Any]
    identified: bool = False
    own_feedback: bool = False


CONDITIONS = {
    "exact": Condition({"spread": 1.0}),
    "history": Condition({"spread": 1.0, "memory": "random"}),
    "identified": Condition({"spread": 1.0}, identified=True),
    "20 % off": Condition({"spread": 1.2}),
    "held out": Condition({"spread": 1.4, "split": "held_out_friction"}),
    "hidden": Condition({"spread": 1.0, "plant": PLANT + COGGING}),
    "sliding": Condition({"spread": 1.0, "tasks": SLIDING}),
    "own feedback": Condition({"spread": 1.0}, own_feedback=True),
}


def errors(
    entry: Entry, p: Parameters, models: Models, options: dict[str, Any], n: int, steps: int, seed: int | None = None
) -> tuple[np.ndarray, float]:
    """(n,) rms errors [counts] over fixed episodes, or over those of a seed; and the cost of a call [s]."""
    fixed = {"split": "test"} if seed is None else {}
    base = {"plant": PLANT, "tasks": PRESLIDING, "episode_steps": steps, "num_envs": n, **fixed}
    envs = gym.make_vec(ID, **{**base, **options})
    axes = envs.unwrapped.axes
    made = [entry.make(p, models, axes, k) for k in range(n)]
    for trial in range(entry.trials):
        if trial:
            made = [c.again() for c in made]
        trace = control.follow(envs, made, seed, None if seed is not None else list(range(n)), entry.prepare)
    envs.close()
    return np.minimum(trace.rms(), 100 * axes.scale.breakaway) / COUNT, trace.cost


def tune(entry: Entry, models: Models, budget: int, n: int, steps: int, feedback: bool) -> Parameters:
    """The best of `budget` points in the box of an entry, on the train split."""
    box = dict(entry.box) | ({"bandwidth": (20.0, 120.0)} if feedback else {})
    if not box:
        return {}
    low, high = np.log(np.array(list(box.values()))).T
    points = np.exp(low + (high - low) * qmc.Sobol(len(box), seed=0).random(budget - 1))
    scored = []
    for p in ({}, *(dict(zip(box, point.tolist(), strict=True)) for point in points)):
        found, _ = errors(entry, p, models, {"spread": 1.0, "tasks": tuple(TASKS)}, n, steps, seed=7)
        scored.append((float(np.log(found).mean()), p))
    return min(scored, key=lambda s: s[0])[1]


def identify(seed: int = 5) -> Models:
    """GMS and LuGre models, each fitted to the same three simulated records of the axis."""
    records = [r for r in demo.records(PLANT, np.random.default_rng(seed)) if r.use == "fit"]
    lugre = Plant.axis(J) + gms.effects.LuGre() + gms.effects.Viscous()
    return Models(gms.fit(gms.baseline(J), records).plant, gms.fit(lugre, records).plant)


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Inter-quartile mean."""
    return trim_mean(values, 0.25, axis=axis)


def interval(values: np.ndarray, statistic: Callable[..., np.ndarray] = iqm, draws: int = 2000) -> tuple[float, float]:
    """95 % bootstrap interval of a statistic over the last axis of the values."""
    picked = np.random.default_rng(0).integers(values.shape[-1], size=(draws, values.shape[-1]))
    low, high = np.quantile(statistic(np.moveaxis(values[..., picked], -2, 0)), (0.025, 0.975))
    return float(low), float(high)


def ratio(values: np.ndarray) -> np.ndarray:
    """Of the inter-quartile means of two controllers on the same episodes, (..., 2, n)."""
    means = iqm(values)
    return means[..., 0] / means[..., 1]


def learned(samples: int, quick: bool) -> dict[str, Entry]:
    """The policies; trained on all tasks with friction scattered by 1.4."""
    found = {}
    training = learn.train(6 if quick else 30, episode_steps=400 if quick else 1000, plant=PLANT)
    policy = training.policy
    name = f"PID + CEM policy, {training.steps / 1e6:.1f} M samples"
    found[name] = Entry(
        lambda p, m, axes, k: learn.Residual(policy.sizes, policy.weights, p.get("bandwidth", BANDWIDTH))
    )
    if not samples:
        return found
    import torch
    from stable_baselines3 import PPO, SAC

    from gms_mujoco.sb3 import Compensation, Learned, SB3Vector

    torch.set_num_threads(1)
    for kind in (PPO, SAC):
        for bandwidth in (None, BANDWIDTH):
            vec = gym.make_vec(ID, num_envs=32, plant=PLANT, episode_steps=1000, autoreset_mode="SameStep")
            envs = Compensation(SB3Vector(vec), bandwidth)
            own = {"n_steps": 256, "batch_size": 1024} if kind is PPO else {"gradient_steps": 4, "batch_size": 256}
            model = kind("MlpPolicy", envs, seed=0, device="cpu", **own).learn(samples)
            label = f"{'' if bandwidth is None else 'PID + '}{kind.__name__}, {samples / 1e3:.0f} k samples"
            found[label] = Entry(
                lambda p, m, axes, k, model=model, bandwidth=bandwidth: Learned(model, axes, bandwidth)
            )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Friction compensation on a servo axis: one table.")
    parser.add_argument("--quick", action="store_true", help="few episodes, a small budget: a minute")
    parser.add_argument("--episodes", type=int, default=0, help="of each cell (default: 24; quick: 4)")
    parser.add_argument("--budget", type=int, default=0, help="evaluations of each tuning (default: 16; quick: 4)")
    parser.add_argument("--rl", type=int, default=0, metavar="SAMPLES", help="train PPO and SAC on so many samples")
    parser.add_argument("--only", nargs="*", help="columns (default: all)")
    options = parser.parse_args()
    n, budget = options.episodes or (4 if options.quick else 24), options.budget or (4 if options.quick else 16)
    steps = 600 if options.quick else 1500
    n_tune = 5 if options.quick else 10
    columns = {k: c for k, c in CONDITIONS.items() if not options.only or k in options.only}
    start = time.perf_counter()
    exact = identify()
    models = {True: exact, False: Models(PLANT, exact.lugre)}
    entries = ENTRIES | learned(options.rl, options.quick)
    rows: dict[str, dict[str, np.ndarray]] = {}
    notes: dict[str, str] = {}
    cells = len(entries) * len(columns)
    with Bar() as bar:
        for name, entry in entries.items():
            tuned = {f: tune(entry, models[False], budget, n_tune, steps // 2, f)
                     for f in {c.own_feedback for c in columns.values()}}
            costs, rows[name] = [], {}
            for column, c in columns.items():
                bar((len(rows) - 1 + len(costs) / len(columns)) * len(columns) / cells, f"{name}, {column}")
                p = tuned[c.own_feedback]
                rows[name][column], cost = errors(entry, p, models[c.identified], c.options, n, steps)
                costs.append(cost)
            sets = [", ".join(f"{k} {v:.3g}" for k, v in tuned[f].items()) or "defaults" for f in sorted(tuned)]
            notes[name] = f"{1e6 * np.median(costs):10.1f}  {'; own feedback: '.join(sets)}"
    print(f"rms tracking error [encoder counts]: inter-quartile mean [95 % interval] of {n} episodes of "
          f"{steps * H:g} s; tuning: {budget} evaluations each; gms_mujoco {gms.__version__}")
    for some in filter(None, (list(columns)[:4], list(columns)[4:])):
        table(rows, some, iqm)
    print("\nratios of inter-quartile means on the same episodes; goals: at least 5, at most 1.5")
    pairs = {
        "PID + feedforward over GMS observer": ("PID + feedforward", "+ GMS observer"),
        "GMS observer over oracle": ("+ GMS observer", "oracle"),
        "GMS observer over noise floor": ("+ GMS observer", "noise floor (no friction)"),
        "GMS over both observers": ("+ GMS observer", "+ GMS and disturbance observers"),
    }
    compared = {k: {c: np.stack([rows[a][c], rows[b][c]]) for c in columns} for k, (a, b) in pairs.items()}
    for some in filter(None, (list(columns)[:4], list(columns)[4:])):
        table(compared, some, ratio)
        met = []
        for c in some:
            below, above = (float(ratio(compared[k][c])) for k in list(pairs)[:2])
            said = {(True, True): "both", (True, False): "the first", (False, True): "the second"}
            met.append(said.get((below >= 5, above <= 1.5), "none"))
        print(f"{'goals met':36s}" + "".join(f"{m:>21s}" for m in met))
    print(f"\n{'cost of a call and what the tuning chose':36s}{'us/step':>10s}  parameters [Hz, or as a factor]")
    for name, note in notes.items():
        print(f"{name:36s}{note}")
    print(f"\n{time.perf_counter() - start:.0f} s")


def table(rows: dict[str, dict[str, np.ndarray]], columns: list[str], statistic: Callable[..., Any]) -> None:
    """Prints a statistic of each cell with its interval."""
    print(f"\n{'':36s}" + "".join(f"{c:>21s}" for c in columns))
    for name, row in rows.items():
        cells = []
        for c in columns:
            low, high = interval(row[c], statistic)
            cells.append(f"{float(statistic(row[c])):.2f} [{low:.2f}, {high:.2f}]")
        print(f"{name:36s}" + "".join(f"{c:>21s}" for c in cells))


if __name__ == "__main__":
    main()
