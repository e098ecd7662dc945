"""The learning baseline: a linear policy on friction features, added to a PID, trained by the cross-entropy method.

It needs no framework and no gradient: a generation of candidate weights runs on the native vector environment, all on
the same episodes, and the next one is drawn around the better ones (Rubinstein and Kroese, The Cross-Entropy Method,
2004). The features are stop operators along the reference and along the measured motion, which is what a Maxwell-slip
set is made of, so that a linear policy can remember as friction does.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import files
from .control import PID, Controller, Trace
from .control.base import ACCELERATION, AHEAD, POSITION, VELOCITY
from .control.follow import play
from .errors import DataError, ModelError
from .progress import Progress
from .servo import Axes
from .vector_env import ServoTrackingVector

Array = NDArray[np.float64]

WIDTHS = (0.03, 0.1, 0.3, 1.0, 3.0)  # of the stop operators, in break-away distances
NAMES = (
    "inertia", "drag", *(f"reference_stop_{w:g}" for w in WIDTHS), *(f"measured_stop_{w:g}" for w in WIDTHS)
)  # fmt: skip
ELITE = 0.25  # of a generation
TEST_EPISODES = 32
_POLICY, _SCHEMA, _KIND = "policy.json", 1, "residual"


@dataclass(frozen=True)
class Sizes:
    """What a designer knows of an axis before any identification, for scaling.

    Attributes:
        inertia: [kg m^2].
        sample_time: [s].
        level: friction torque at low speed [N m].
        breakaway: displacement over which friction builds up [rad].
    """

    inertia: float
    sample_time: float
    level: float
    breakaway: float

    @classmethod
    def of(cls, axes: Axes) -> Sizes:
        assert axes.plant.inertia is not None
        return cls(axes.plant.inertia, axes.sample_time, axes.scale.level, axes.scale.breakaway)


class Features:
    """(n, 12) numbers of order one from (n, 8) observations, in the order of `NAMES`; remembers, as friction does."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        self.widths = sizes.breakaway * np.array(WIDTHS)
        self.stops: Array | None = None  # (2, n, widths), along the reference and along the measured motion [rad]
        self.at = np.zeros((2, 0))

    def __call__(self, observation: Array) -> Array:
        """Features of this sample; every sample in turn."""
        s = self.sizes
        now = np.stack([observation[:, AHEAD], observation[:, POSITION]])
        if self.stops is None:
            self.stops, self.at = np.zeros((2, len(observation), len(WIDTHS))), now
        self.stops = np.clip(self.stops + (now - self.at)[:, :, None], -self.widths, self.widths)
        self.at = now
        inertia = s.inertia * observation[:, ACCELERATION] / s.level
        drag = observation[:, VELOCITY] / (100 * s.breakaway)
        return np.concatenate([np.stack([inertia, drag], 1), *(self.stops / self.widths)], axis=1)

    def forget(self, rows: Sequence[int], observation: Array) -> None:
        """Begins anew on some of the axes, which are where `observation` (n, 8) says."""
        if self.stops is not None:
            rows = list(rows)
            self.stops[:, rows] = 0.0
            self.at[:, rows] = observation[rows, AHEAD], observation[rows, POSITION]


class Residual(Controller):
    """PID and a torque linear in the features, within three friction levels.

    Takes one observation (8,), or (n, 8) with one or n sets of weights.

    Args:
        sizes: of the axis.
        weights: (12,) or (n, 12) torque over the friction level for each feature.
        bandwidth: of the PID [Hz].
    """

    def __init__(self, sizes: Sizes, weights: Array, bandwidth: float = 50.0) -> None:
        self.sizes, self.weights, self.bandwidth = sizes, np.asarray(weights, float), bandwidth
        self.features, self.pid = Features(sizes), PID(sizes.inertia, sizes.sample_time, bandwidth)
        self.sample_time = sizes.sample_time

    def __call__(self, observation: Array) -> Any:
        many = np.atleast_2d(observation)
        residual = np.clip((self.features(many) * self.weights).sum(axis=1), -3.0, 3.0) * self.sizes.level
        torque = self.pid(many) + residual
        return torque if np.ndim(observation) == 2 else float(torque[0])

    def save(self, path: str | Path) -> None:
        """Writes the policy as JSON."""
        table = {
            "schema": _SCHEMA, "kind": _KIND, "bandwidth": self.bandwidth, "sizes": vars(self.sizes),
            "weights": dict(zip(NAMES, self.weights.tolist(), strict=True)),
        }  # fmt: skip
        files.write_text(path, json.dumps(table, indent=1) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Residual:
        """Reads what `save` has written, or `policy.json` of a folder; raises DataError where it cannot."""
        path = Path(path) / _POLICY if Path(path).is_dir() else Path(path)
        try:
            table = json.loads(path.read_text(encoding="utf-8"))
            given = table["schema"], table["kind"]
            if given != (_SCHEMA, _KIND):
                raise ValueError(f"schema and kind are {given}, expected {(_SCHEMA, _KIND)}")
            sizes = Sizes(**{k: float(v) for k, v in table["sizes"].items()})
            weights, bandwidth = [float(table["weights"][n]) for n in NAMES], float(table["bandwidth"])
            if not np.isfinite(weights).all():
                raise ValueError("a weight is not finite")
            for name, value in {**vars(sizes), "bandwidth": bandwidth}.items():
                if not 0 < value < math.inf:
                    raise ValueError(f"{name} is {value:g}, expected a positive number")
            return cls(sizes, np.array(weights), bandwidth)
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error.strerror})") from None
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(f"{path}: not a policy that train has written ({error})") from None


@dataclass(frozen=True)
class Run:
    """Episodes that a policy followed beside those of the PID alone.

    Attributes:
        split: of the episodes.
        pid, policy: (n,) rms of the true tracking error [rad]; of an axis that ran away, the distance at which it had.
        pid_away, policy_away: (n,) whether it ran away.
    """

    split: str
    pid: Array
    policy: Array
    pid_away: NDArray[np.bool_]
    policy_away: NDArray[np.bool_]

    @property
    def ratio(self) -> float:
        """Median of the policy's error over that of the PID on the same episode."""
        return float(np.median(self.policy / self.pid))


@dataclass(frozen=True)
class Training:
    """A trained policy and how it came about.

    Attributes:
        policy: the mean of the last generation.
        curve: (generations, 2) error over that of the PID, geometric mean over the episodes: of the mean candidate,
            and of the best.
        runs: on the fixed test split and on friction held out of the training.
        time: (steps,) [s], and traces (3, steps) of the first test episode: reference, PID, policy [rad]; NaN once an
            axis has run away.
        steps: samples of the environment that the training took.
    """

    policy: Residual
    curve: Array
    runs: tuple[Run, ...]
    time: Array
    traces: Array
    steps: int

    def to_dict(self) -> dict[str, Any]:
        """Figures for `training.json`."""
        return {
            "schema": 1,
            "steps": self.steps,
            "curve": self.curve.tolist(),
            **{
                r.split: {
                    "ratio": r.ratio, "pid": r.pid.tolist(), "policy": r.policy.tolist(),
                    "ran_away": {"pid": int(r.pid_away.sum()), "policy": int(r.policy_away.sum())},
                }
                for r in self.runs
            },
        }

    def __str__(self) -> str:
        lines = [f"{self.steps} samples in {len(self.curve)} generations"]
        for r in self.runs:
            better = int((r.policy < r.pid).sum())
            lines.append(
                f"{r.split:18s} rms error {1 / r.ratio:.2f} times below the PID (median), "
                f"better in {better} of {len(r.pid)} episodes"
            )
            if r.pid_away.any() or r.policy_away.any():
                lines.append(
                    f"{'':18s} ran away: the PID in {r.pid_away.sum()}, the policy in {r.policy_away.sum()} of them"
                )
        return "\n".join(lines)


def train(
    generations: int = 30,
    population: int = 24,
    episodes: int = 6,
    seed: int = 0,
    bandwidth: float = 50.0,
    episode_steps: int = 1000,
    progress: Progress | None = None,
    **options: Any,
) -> Training:
    """Trains the residual policy on the train split, then runs it on the fixed test episodes.

    Args:
        generations: of the cross-entropy method.
        population: candidates of one, each on the same episodes.
        episodes: of a generation, new ones in each.
        seed: draws candidates and episodes.
        bandwidth: of the PID [Hz].
        episode_steps: samples of an episode.
        progress: called with a share in 0..1 and a message.
        **options: of the environment, such as `plant`, `tasks`, `spread`.

    Raises:
        ModelError: a number that is not positive, or an option that cannot be.
    """
    for name, value in {"generations": generations, "population": population, "episodes": episodes}.items():
        if value < 1:
            raise ModelError(f"{name} must be positive; {value} given")
    rng = np.random.default_rng(seed)
    envs = ServoTrackingVector((population + 1) * episodes, episode_steps=episode_steps, **options)
    sizes = Sizes.of(envs.axes)
    mean, deviation, curve = np.zeros(len(NAMES)), np.full(len(NAMES), 0.4), []
    n_elite = max(round(ELITE * population), 1)
    for k in range(generations):
        candidates = np.concatenate([np.zeros((1, len(NAMES))), mean + deviation * _normal(rng, population, mean.size)])
        if k:
            candidates[1] = mean
        weights = np.repeat(candidates, episodes, axis=0)
        seeds = np.tile(rng.integers(2**31, size=episodes), population + 1)
        trace = _played(envs, Residual(sizes, weights, bandwidth), seed=seeds.tolist())
        errors = _rms(trace, envs.axes).reshape(-1, episodes)
        score = np.log(errors[1:] / errors[0]).mean(axis=1)  # over the PID, which has no weights
        best = candidates[1:][np.argsort(score)[:n_elite]]
        mean, deviation = best.mean(axis=0), 0.2 * deviation + 0.8 * best.std(axis=0) + 0.02 * math.exp(-k / 6)
        curve.append([math.exp(score[0] if k else float(np.median(score))), math.exp(score.min())])
        if progress is not None:
            progress((k + 1) / (generations + 1), f"error {1 / curve[-1][1]:.2f} times below the PID")
    runs = []
    traces: Array = np.zeros((3, 0))
    # Where there is one friction alone, none is held out.
    for split in ("test", "held_out_friction")[: 1 if options.get("spread") == 1 else 2]:
        test = ServoTrackingVector(TEST_EPISODES, split=split, episode_steps=episode_steps, **options)
        pid, own = (
            _played(test, Residual(sizes, w, bandwidth), episodes=list(range(TEST_EPISODES)))
            for w in (np.zeros(len(NAMES)), mean)
        )
        if split == "test":
            longer = own if pid.ended[0] else pid  # the other may have run away
            traces = np.stack([longer.reference[:, 0], pid.position[:, 0], own.position[:, 0]])
        runs.append(Run(split, _rms(pid, test.axes), _rms(own, test.axes), pid.ended, own.ended))
    if progress is not None:
        progress(1.0, "")
    time = np.arange(1.0, traces.shape[1] + 1) * sizes.sample_time
    steps = generations * envs.num_envs * episode_steps
    return Training(Residual(sizes, mean, bandwidth), np.array(curve, float), tuple(runs), time, traces, steps)


def _normal(rng: np.random.Generator, population: int, size: int) -> Array:
    """Mirrored pairs: a candidate on either side of the mean."""
    half = rng.standard_normal(((population + 1) // 2, size))
    return np.concatenate([half, -half])[:population]


def _played(envs: ServoTrackingVector, controller: Residual, seed: Any = None, episodes: Any = None) -> Trace:
    observation, _ = envs.reset(seed=seed, options=None if episodes is None else {"episode": episodes})
    return play(envs, observation, lambda seen, running: controller(seen))


def _rms(trace: Trace, axes: Axes) -> Array:
    """(n,) rms of the true tracking error [rad]; of an axis that ran away, the distance at which that is so."""
    return np.where(trace.ended, 100 * axes.scale.breakaway, trace.rms())
