"""Simulated friction against references that share no code with it, and the hold test of other simulators' friction."""

import math

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.plant import Plant

J, FC, FS, VS, C = 2.4e-5, 4.5e-3, 5.4e-3, 0.8, 0.3
STIFFNESS, SHARE = np.array([0.8, 0.4, 0.2, 0.1]), np.array([0.1, 0.2, 0.3, 0.4])


def tiny_steps(torque, h, parts):
    """Position [rad] at each sample of an axis with GMS friction under a torque held from sample to sample.

    The equations of Lampaert et al. as they stand, by Heun's method in `parts` steps per sample, each element switching
    where it reaches its limit and where the axis turns round.
    """
    dt = h / parts
    q = v = 0.0
    force, slipping, out = [0.0] * 4, [False] * 4, []
    elements = list(zip(range(4), STIFFNESS.tolist(), SHARE.tolist(), strict=True))

    def rates(v, force):
        s = FC + (FS - FC) * math.exp(-abs(v) / VS)
        side = 1.0 if v > 0 else -1.0
        return [C * (side * a - force[i] / s) if slipping[i] else k * v for i, k, a in elements]

    for u in torque.tolist():
        out.append(q)
        for _ in range(parts):
            first = rates(v, force)
            acceleration = (u - sum(force)) / J
            ahead = [f + dt * r for f, r in zip(force, first, strict=True)]
            v_ahead = v + dt * acceleration
            second = rates(v_ahead, ahead)
            v_next = v + 0.5 * dt * (acceleration + (u - sum(ahead)) / J)
            q += 0.5 * dt * (v + v_next)
            force = [f + 0.5 * dt * (x + y) for f, x, y in zip(force, first, second, strict=True)]
            if v * v_next < 0:
                slipping = [False] * 4
            v = v_next
            s = FC + (FS - FC) * math.exp(-abs(v) / VS)
            for i, _, a in elements:
                if not slipping[i] and abs(force[i]) >= a * s and force[i] * v > 0:
                    slipping[i], force[i] = True, math.copysign(a * s, force[i])
    return np.array(out)


@pytest.fixture(scope="module")
def reference():
    h = 1e-3
    t = np.arange(250) * h
    torque = 1.3 * FS * np.sin(2 * np.pi * 5 * t) * np.exp(-4 * t)  # slides, turns round, comes to rest
    return torque, h, tiny_steps(torque, h, 1000)


def test_agrees_with_a_reference_of_tiny_steps_to_a_thousandth_of_the_range(reference):
    torque, h, exact = reference
    law = effects.GMS(
        stiffness=STIFFNESS, fraction=SHARE, coulomb=FC, static=FS, stribeck_velocity=VS, attraction=C
    )
    joint = (Plant.axis(J) + law).joint()
    for integration in ("explicit", "implicit"):
        error = [
            np.abs(joint.simulate(J, h, torque, substeps=n, integration=integration).position - exact).max()
            for n in (25, 50, 100)
        ]
        assert error[-1] < 1e-3 * np.ptp(exact), (integration, error)
        order = np.log2(np.divide(error[:-1], error[1:]))
        assert (order > 0.8).all(), (integration, order)


LAWS = {  # break-away 0.34 N m each; whether the load cycle leaves the joint where it was
    "gms": (effects.GMS(stiffness=[40, 20, 10, 5], fraction=[0.1, 0.2, 0.3, 0.4], coulomb=0.28, static=0.34,
                        stribeck_velocity=0.1, attraction=10.0), True),
    "coulomb": (effects.Coulomb(coulomb=0.34), True),
    "stribeck": (effects.Stribeck(coulomb=0.28, static=0.34, stribeck_velocity=0.1), True),
    "dahl": (effects.Dahl(stiffness=75.0, coulomb=0.34), False),
    "lugre": (effects.LuGre(stiffness=75.0, damping=0.1, coulomb=0.34, static=0.34, stribeck_velocity=0.1), False),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("h", [1e-4, 5e-4, 2e-3, 5e-3])
def test_hold_test(law, h):
    """Load 0.15 + 0.10 sin(2 pi 5 t) N m, after the transient. MuJoCo: frictionloss creeps by 23,563 urad/s, LuGre by
    2,440. Ours: nothing, but for Dahl and LuGre, which have one memory and creep by what their equations say."""
    effect, returns = LAWS[law]
    period = round(0.2 / h)
    load = 0.15 + 0.10 * np.sin(2 * np.pi * np.arange(25 * period) / period)
    joint = (Plant.axis(1e-3) + effect + effects.Viscous(coefficient=0.02)).joint()
    q = joint.simulate(1e-3, h, load).position
    creep = (q[-1] - q[-1 - 5 * period]) / 1.0  # rad/s
    if returns:
        assert abs(creep) < 1e-9
    else:
        # Quasi-static: dF/dq = k (1 - F / F0 sgn) between the extremes of the load; a loop closes short of its start.
        level = 0.34
        low, high = 0.05, 0.25
        up = level / 75 * np.log((level - low) / (level - high))
        down = level / 75 * np.log((level + high) / (level + low))
        assert creep == pytest.approx((up - down) * 5, rel=0.1)
