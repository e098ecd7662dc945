"""Random servo axes and the runs that a bench would make of them. Nothing here comes from the package."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINE = 1 / 16000  # s, longest time step of a truth
FRICTIONS = ("springyield", "lugre", "frictionloss")  # MuJoCo's own


@dataclass(frozen=True)
class Axis:
    """What a bench has on the table, drawn over the range of servo axes.

    Attributes:
        inertia: [kg m^2], over three decades.
        level: Coulomb friction [N m], 60 to 400 rad/s^2 times the inertia.
        resonance: of the inertia on the pre-sliding stiffness [Hz].
        viscous: [N m s/rad].
        fastest: speed of the fast runs [rad/s].
        bits: of the encoder.
        rate: [Hz].
        decibels: by which the noise of the torque stays below the torque.
        friction: which of MuJoCo's own makes the friction.
        given: whether the measurement set says what the inertia is.
    """

    inertia: float
    level: float
    resonance: float
    viscous: float
    fastest: float
    bits: int
    rate: int
    decibels: float
    friction: str
    given: bool
    rng: np.random.Generator = field(repr=False, compare=False)

    @classmethod
    def draw(cls, rng: np.random.Generator, rates: tuple[int, ...] = (1000, 2000, 4000)) -> Axis:
        inertia = math.exp(rng.uniform(math.log(1e-6), math.log(1e-3)))
        level = inertia * math.exp(rng.uniform(math.log(60), math.log(400)))
        fastest = float(rng.uniform(15, 50))
        return cls(
            inertia, level, float(rng.uniform(20, 80)), level * float(rng.uniform(0.1, 0.6)) / fastest, fastest,
            int(rng.integers(12, 21)), int(rng.choice(rates)), float(rng.uniform(20, 60)),
            str(rng.choice(FRICTIONS)), bool(rng.random() < 0.5), rng,
        )  # fmt: skip

    @property
    def stiffness(self) -> float:
        """Of the friction before it slips [N m/rad]."""
        return self.inertia * (2 * math.pi * self.resonance) ** 2

    @property
    def breakaway(self) -> float:
        """[rad]"""
        return self.level / self.stiffness

    @property
    def count(self) -> float:
        """[rad]"""
        return 2 * math.pi / 2**self.bits


# ------------------------------------------------------------------------------------------------ excitation


@dataclass(frozen=True)
class Run:
    """One run: a torque in open loop, or a reference that a controller follows.

    Attributes:
        name: of the kind.
        torque: (n,) [N m]; the controller's is added where there is a reference.
        reference: (n, 2) position and speed [rad], [rad/s]; None: open loop.
        start: position of the joint at the first sample [rad].
    """

    name: str
    torque: Array
    reference: Array | None
    start: float


def _time(axis: Axis, seconds: float) -> Array:
    return np.asarray(np.arange(round(seconds * axis.rate)) / axis.rate)


def multisine(axis: Axis, seconds: float, low: float, high: float, size: float) -> Array:
    """(n,) random phases, flat spectrum, rms `size` friction levels [N m]."""
    t = _time(axis, seconds)
    f = np.unique(np.round(np.geomspace(low, high, 60) * seconds)) / seconds
    phase = axis.rng.uniform(0, 2 * math.pi, len(f))
    wave = sum(np.sin(2 * math.pi * a * t + b) for a, b in zip(f, phase, strict=True))
    return np.asarray(size * axis.level * wave / np.sqrt(np.mean(np.square(wave))))


def _open(name: str, low: float, high: float, size: float) -> Callable[[Axis, float], Run]:
    def make(axis: Axis, seconds: float) -> Run:
        start = float(axis.rng.uniform(0, 6))
        return Run(name, multisine(axis, seconds, low, high, size), None, start)

    return make


def _closed(name: str, make: Callable[[Axis, Array], Array]) -> Callable[[Axis, float], Run]:
    def run(axis: Axis, seconds: float) -> Run:
        t = _time(axis, seconds)
        path = make(axis, t)
        speed = np.gradient(path, t)
        start = float(axis.rng.uniform(0, 6))
        return Run(name, axis.inertia * np.gradient(speed, t), np.stack([start + path - path[0], speed], 1), start)

    return run


def _slow_sweep(axis: Axis, t: Array) -> Array:
    """A sine that speeds up while it shrinks."""
    low, high = axis.rng.uniform(0.15, 0.3), axis.rng.uniform(1.5, 4)
    k = math.log(high / low) / t[-1]
    phase = 2 * math.pi * low * np.expm1(k * t) / k
    return axis.rng.uniform(2.5, 6) * np.exp(-k * t / 2) * np.sin(phase)


def _reversals(axis: Axis, t: Array) -> Array:
    """Back and forth at several speeds, with a short stretch of acceleration at each turn."""
    out, q, v = np.zeros_like(t), 0.0, 0.0
    step = float(t[1])
    wanted = axis.rng.uniform(1.5, 10)
    back = axis.rng.uniform(3.4, 7)
    for i in range(len(t)):
        if abs(q) > back / 2 and q * wanted > 0:
            wanted = -math.copysign(axis.rng.uniform(1.5, 10), wanted)
        v += float(np.clip(wanted - v, -200 * step, 200 * step))
        q += v * step
        out[i] = q
    return out


def _point_to_point(axis: Axis, t: Array) -> Array:
    """Moves of random length with a trapezoidal speed, and a rest after each."""
    out, i, q = np.zeros_like(t), 0, 0.0
    step, top, rise = float(t[1]), 0.6 * axis.fastest, axis.rng.uniform(150, 400)
    while i < len(t):
        goal = axis.rng.uniform(-10, 10)
        length, sign = abs(goal - q), math.copysign(1, goal - q)
        v = min(top, math.sqrt(length * rise))
        ramp, whole = v / rise, length / v + v / rise
        s = np.arange(0, whole + axis.rng.uniform(0.05, 0.3), step)
        speed = np.clip(np.minimum(s, whole - s) / max(ramp, step), 0, 1) * v
        move = q + sign * np.cumsum(speed) * step
        n = min(len(move), len(t) - i)
        out[i : i + n] = move[:n]
        i, q = i + n, float(move[-1])
    return out


def _fast(axis: Axis, t: Array) -> Array:
    """Two sines that reach the fastest speed."""
    f, g = axis.rng.uniform(0.3, 0.8), axis.rng.uniform(1, 2.5)
    v = axis.fastest
    return 0.7 * v / (2 * math.pi * f) * np.sin(2 * math.pi * f * t) + 0.3 * v / (2 * math.pi * g) * np.sin(
        2 * math.pi * g * t
    )


KINDS: dict[str, Callable[[Axis, float], Run]] = {
    "presliding": _open("presliding", 1, 60, 0.45),
    "breakaway": _open("breakaway", 0.5, 50, 1.3),
    "turning": _open("turning", 0.4, 30, 3.5),
    "slow_sweep": _closed("slow_sweep", _slow_sweep),
    "reversals": _closed("reversals", _reversals),
    "point_to_point": _closed("point_to_point", _point_to_point),
    "fast": _closed("fast", _fast),
}


def runs(axis: Axis, seconds: float) -> list[list[Run]]:
    """What is measured to fit and to validate: small, slow and fast motion, never the same."""
    rng = axis.rng
    kinds = [
        str(rng.choice(["presliding", "breakaway"])),
        str(rng.choice(["slow_sweep", "reversals"])),
        str(rng.choice(["turning", "fast"])),
        str(rng.choice(["point_to_point", "breakaway", "reversals"])),
    ]
    return [[KINDS[k](axis, seconds) for k in kinds] for _ in range(2)]


class Controller:
    """PD on what the encoder reads, with a filtered speed.

    Args:
        axis: whose inertia and encoder set the gains.
    """

    def __init__(self, axis: Axis) -> None:
        omega = 2 * math.pi * 8
        self.kp, self.kd = axis.inertia * omega**2, 1.4 * axis.inertia * omega
        self.share = 1 - math.exp(-2 * math.pi * (30 if axis.bits < 15 else 100) / axis.rate)
        self.rate, self.limit = axis.rate, 12 * axis.level
        self.speed, self.last = 0.0, math.nan

    def __call__(self, feed: float, wanted: Array, reading: float) -> float:
        if not math.isnan(self.last):
            self.speed += self.share * ((reading - self.last) * self.rate - self.speed)
        self.last = reading
        u = feed + self.kp * (float(wanted[0]) - reading) + self.kd * (float(wanted[1]) - self.speed)
        return min(max(u, -self.limit), self.limit)
