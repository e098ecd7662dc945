"""Harmonic balance: the periodic motion of a joint with friction under a sinusoidal torque.

The torque has no harmonics, so at each of them inertia and effects balance: J (k w)^2 q_k + f_k = 0, where f_k follows
from the whole motion. Source: Gelb and Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design
(1968).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import native

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAMPLES = 64  # of a period
ORDERS = np.arange(3, 22, 2)
_ROUNDS = 30
_HISTORY = 5
_BALANCED = 2e-3  # of the torque of the effects: what may be left over at a harmonic
_CLOSE = 5e-4  # of it: close enough
_FIRST = (np.exp(-2j * math.pi * np.arange(SAMPLES) / SAMPLES) * (2 / SAMPLES)).view(float).reshape(SAMPLES, 2)
_ALL = np.arange(SAMPLES // 2 + 1)


def motion(size: Array, omega: Array, extra: Complex | None = None) -> tuple[Array, Array]:
    """(n, SAMPLES) position and velocity over one period, from the crest of the fundamental on.

    Args:
        size: (n,) amplitude of the fundamental [rad].
        omega: (n,) [rad/s].
        extra: (n, orders) harmonics, in the phase of the fundamental [rad]; None: there are none.
    """
    spectrum = np.zeros((len(size), len(_ALL)), complex)
    spectrum[:, 1] = size * (SAMPLES / 2)
    if extra is not None:
        spectrum[:, ORDERS] = extra * (SAMPLES / 2)
    return np.fft.irfft(spectrum, SAMPLES, axis=1), velocity(spectrum, omega)


def velocity(spectrum: Complex, omega: Array) -> Array:
    """(n, SAMPLES) rate of periodic signals with the given rfft (n, SAMPLES / 2 + 1)."""
    slope = spectrum * (1j * _ALL * omega[:, None])
    slope[:, -1] = 0  # of the highest line the samples show one quadrature only
    return np.fft.irfft(slope, SAMPLES, axis=1)


def fundamental(x: Array) -> Complex:
    """(...) amplitude of the first harmonic of periods (..., SAMPLES)."""
    return np.ascontiguousarray(x @ _FIRST).view(complex)[..., 0]


@dataclass(frozen=True)
class Balance:
    """A periodic motion under a sinusoidal torque.

    Attributes:
        extra: (n, orders) harmonics of the motion [rad].
        first: (n,) fundamental of the torque of the effects along it [N m].
        good: (n,) whether the balance was found, to within 0.2 % of that torque; it may not be where a harmonic meets
            the resonance, far below it.
    """

    extra: Complex
    first: Complex
    good: NDArray[np.bool_]


def balance(
    joint: native.Joint, inertia: float, size: Array, omega: Array, extra: Complex | None = None
) -> Balance:
    """The harmonics of motions with a given fundamental.

    Args:
        joint: the effects.
        inertia: that moves with the joint [kg m^2].
        size: (n,) amplitude of the fundamental [rad].
        omega: (n,) [rad/s].
        extra: (n, orders) where to begin; None: without harmonics.
    """
    inertial = inertia * np.outer(omega, ORDERS) ** 2
    n = len(size)
    now = np.zeros((n, len(ORDERS)), complex) if extra is None else extra.astype(complex)
    best, first, least = now.copy(), np.zeros(n, complex), np.full(n, np.inf)
    share = np.full(n, 0.5)
    tried: list[tuple[Complex, Complex]] = []  # motions and the steps proposed there
    at = np.arange(n)  # not yet close enough
    for _ in range(_ROUNDS):
        torque = joint.cycle(2 * math.pi / omega[at], *motion(size[at], omega[at], now[at]))
        spectrum = np.fft.rfft(torque, axis=1) * (2 / SAMPLES)
        wrong = spectrum[:, ORDERS] + inertial[at] * now[at]
        left = np.abs(wrong).max(1) / np.maximum(np.abs(spectrum[:, 1]), 1e-300)
        better = left < least[at]
        taken = at[better]
        best[taken], first[taken], least[taken] = now[taken], spectrum[better, 1], left[better]
        share[at[left > 3 * least[at]]] *= 0.5
        stiffness = np.abs(spectrum[:, 1].real / size[at])[:, None]
        away = stiffness - inertial[at]
        # Near the resonance of a harmonic friction damps it: a step by the spring alone would go too far.
        away = np.where(np.abs(away) < 0.2 * stiffness, np.copysign(0.2 * stiffness, away), away)
        step = np.zeros_like(now)
        step[at] = share[at, None] * wrong / np.where(away == 0, 1.0, away)
        tried = [*tried[-_HISTORY:], (now.copy(), step)]
        at = at[least[at] > _CLOSE]
        if not len(at):
            break
        now[at] += _mixed([(x[at], f[at]) for x, f in tried])
    return Balance(best, first, least < _BALANCED)


def _mixed(tried: list[tuple[Complex, Complex]]) -> Complex:
    """Step from the last motion by Anderson's mixing of the steps proposed so far (Walker and Ni 2011), each point
    for itself."""
    x, f = (np.stack([a.view(float) for a in part]) for part in zip(*tried, strict=True))
    if len(x) < 3:
        return tried[-1][1]
    dx, df = np.diff(x, axis=0), np.diff(f, axis=0)
    normal = np.einsum("apk,bpk->pab", df, df)
    size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    right = np.einsum("apk,pk->pa", df, f[-1])[..., None]
    weight = np.linalg.solve(normal + (1e-8 * size + 1e-300) * np.eye(len(df)), right)[..., 0]
    step = f[-1] - np.einsum("pa,apk->pk", weight, dx + df)
    return np.ascontiguousarray(step).view(complex)
