"""What a Maxwell-slip friction must show, each as a property with a figure."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gms_mujoco import effects
from gms_mujoco.plant import Plant

FC, FS, VS = 4.5e-3, 5.4e-3, 0.8
STIFFNESS, FRACTION = [0.8, 0.4, 0.2, 0.1], [0.1, 0.2, 0.3, 0.4]


def friction(static=FS, attraction=0.3, **other):
    """Friction on the moving side, positive along the motion, as a function of (time, position)."""
    law = effects.GMS(
        stiffness=STIFFNESS, fraction=FRACTION, coulomb=FC, static=static, stribeck_velocity=VS,
        attraction=attraction, **other,
    )
    joint = (Plant.axis() + law).joint()

    def follow(q, dt=1e-3):
        t = np.arange(len(q)) * dt
        r = joint.replay(t, q, np.gradient(q, dt), states=True)
        return -r.torque, r.states[:, 2::2]

    return follow


def path(*turns, step=1e-4):
    """Position that runs straight from turn to turn."""
    legs = [np.linspace(a, b, max(2, round(abs(b - a) / step) + 1))[1:] for a, b in pairwise(turns)]
    return np.concatenate([[turns[0]], *legs])


def test_closed_minor_loops_return_to_the_same_point():
    """Non-local memory: after any minor loop the outer branch goes on as if the loop had not been."""
    follow = friction(static=FC, attraction=1e6)
    plain, _ = follow(path(0, 0.02))
    q = path(0, 0.008, 0.005, 0.0065, 0.0055, 0.0065, 0.005, 0.008, 0.02)
    looped, _ = follow(q)
    tail = round(0.012 / 1e-4)
    assert np.abs(looped[-tail:] - plain[-tail:]).max() < 1e-12 * FC


def test_masings_rule():
    """The branch after a reversal is the virgin curve, twice as large in both directions."""
    follow = friction(static=FC, attraction=1e6)
    virgin, _ = follow(path(0, 0.03))
    back, _ = follow(path(0, 0.03, -0.03))
    n = len(virgin)
    drop = virgin[-1] - back[n - 1 :]
    assert np.allclose(drop[: 2 * n - 1 : 2], 2 * virgin[: len(drop[: 2 * n - 1 : 2])], atol=1e-9 * FC)


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.5, 1.0, 3.0, -0.3])
def test_steady_speed_is_on_the_stribeck_curve(speed):
    dt = 1e-3
    seconds = max(2.0, 0.05 / abs(speed))  # past every break-away distance
    force, _ = friction()(speed * np.arange(int(seconds / dt)) * dt, dt)
    curve = np.sign(speed) * (FC + (FS - FC) * np.exp(-abs(speed / VS)))
    assert force[-1] == pytest.approx(curve, rel=5e-4)


def test_friction_lags_velocity():
    """Lower while decelerating than while accelerating would need no memory: here the force follows late."""
    dt = 1e-4
    t = np.arange(0, 1, dt)
    v = 1.0 + 0.9 * np.sin(2 * np.pi * 20 * t)
    force, _ = friction(attraction=0.1)(np.cumsum(v) * dt, dt)
    up, down = (np.gradient(v) > 0) & (t > 0.5), (np.gradient(v) < 0) & (t > 0.5)
    speed = 1.0
    at = [np.interp(speed, *(x[np.argsort(v[m])] for x in (v[m], force[m]))) for m in (up, down)]
    assert at[0] - at[1] > 0.02 * (FS - FC)


@settings(max_examples=60)
@given(st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=12), st.floats(1e-4, 0.3))
def test_every_element_stays_within_its_level(turns, step):
    _, forces = friction()(path(0.0, *turns, step=step))
    assert (np.abs(forces) <= np.array(FRACTION) * FS * (1 + 1e-12)).all()


@settings(max_examples=60)
@given(st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=12), st.integers(0, 2**31))
def test_no_net_work_over_a_closed_cycle(turns, seed):
    """Passive: a periodic motion, once periodic in force too, takes energy and never gives any."""
    rng = np.random.default_rng(seed)
    cycle = path(0.0, *turns, 0.0, step=1e-3)
    cycle = cycle + np.concatenate([[0], rng.normal(size=max(len(cycle) - 2, 0)) * 1e-4, [0]][: len(cycle)])
    q = np.concatenate([cycle, cycle[1:], cycle[1:]])
    force, _ = friction()(q)
    work = force[1:] * np.diff(q)  # the force at the end of a step is the larger while a spring is wound up
    trapezoid = 0.5 * (force[1:] + force[:-1]) * np.diff(q)
    last = slice(-(len(cycle) - 1), None)
    assert work[last].sum() >= -1e-15
    assert trapezoid[last].sum() >= -1e-6 * FS * max(np.abs(np.diff(q)).sum(), 1e-12)


def test_break_away_depends_on_the_rate():
    """A faster rise of force breaks away at a lower force: s(v) has less time to act at rest."""
    peak = []
    for speed in (0.001, 0.1, 2.0):
        force, _ = friction()(path(0, 0.3, step=speed * 1e-3))
        peak.append(force.max())
    assert peak[0] > peak[1] > peak[2]


def test_levels_that_a_reversal_carries_over_are_a_constant_torque_beside_equal_ones():
    """An element that carries from -0.8 to 1.2 of its limit is one that carries 1 either way, moved by 0.2 of it."""
    law = effects.GMS(
        stiffness=STIFFNESS, fraction=FRACTION, coulomb=FC, static=FC, stribeck_velocity=VS, attraction=1e6
    )
    q = 0.05 * np.sin(np.linspace(0, 40, 4001)) * np.linspace(1, 0.02, 4001)
    t, v = np.arange(len(q)), np.gradient(q)
    uneven = (Plant.axis() + law + effects.AsymmetricFriction(level=0.2, stiffening=0, dropping=0)).joint()
    even = (Plant.axis() + law).joint()
    memory = np.full(even.n_memory, -0.2)
    np.testing.assert_allclose(
        uneven.replay(t, q, v).torque, even.replay(t, q, v, memory=memory).torque - 0.2 * FC, atol=1e-9 * FC
    )


def test_an_element_whose_limit_drops_at_a_reversal_sticks_at_it():
    """Where the level alone differs: from 1.2 forward to 0.8 backward it falls to 0.8 and then unwinds as a spring."""
    law = effects.GMS(stiffness=[1.0], fraction=[1.0], coulomb=FC, static=FC, stribeck_velocity=VS, attraction=1e-6)
    joint = (Plant.axis() + law + effects.AsymmetricFriction(level=0.2, stiffening=0)).joint()
    q = np.array([0, 0.02, 0.02 - 1e-6, 0.02 - 1e-3])
    torque = -joint.replay(np.arange(4.0), q, np.gradient(q)).torque
    assert torque[1] == pytest.approx(1.2 * FC)
    assert torque[2] == pytest.approx(0.8 * FC - 1e-6)
    assert torque[3] == pytest.approx(0.8 * FC - 1e-3)


def test_an_element_that_is_stiffer_one_way_may_carry_its_force_over_a_reversal():
    """From 1.2 forward it unwinds at 0.8 of its stiffness, where it else gives way to 0.8 of its level at once."""
    law = effects.GMS(stiffness=[1.0], fraction=[1.0], coulomb=FC, static=FC, stribeck_velocity=VS, attraction=1e6)
    q = np.array([0, 0.02, 0.02 - 1e-6, 0.02 - 1e-3, -0.1])
    carried, drops = (
        -(Plant.axis() + law + effects.AsymmetricFriction(level=0.2, dropping=r)).joint()
        .replay(np.arange(5.0), q, np.gradient(q)).torque
        for r in (0, 1)
    )  # fmt: skip
    np.testing.assert_allclose(carried[1:4], 1.2 * FC - 0.8 * np.array([0, 1e-6, 1e-3]), rtol=1e-9)
    assert drops[2] < 0.81 * FC
    assert carried[4] == drops[4] == pytest.approx(-0.8 * FC)


def test_what_slid_at_speed_falls_by_as_much_as_the_level_does_at_a_reversal():
    """From 1.2 of the level of its speed to 0.8 of that, and not of what the joint has at rest."""
    law = effects.GMS(stiffness=[1.0], fraction=[1.0], coulomb=FC, static=2 * FC, stribeck_velocity=VS, attraction=1.0)
    joint = (Plant.axis() + law + effects.AsymmetricFriction(level=0.2, stiffening=0)).joint()
    t, q = np.array([0, 1.0, 1.0 + 1e-9]), np.array([0, 100 * VS, 100 * VS - 1e-6])
    fast, turned = -joint.replay(t, q, np.gradient(q, t)).torque[1:]
    assert fast == pytest.approx(1.2 * FC)
    assert turned == pytest.approx(0.8 * FC - 1e-6)
    unwound = -joint.replay(t[:2], q[:2] - 100 * VS, np.full(2, 100 * VS)).torque[1]
    assert unwound == pytest.approx(1.2 * FC)  # the first of a record, with nothing to fall from


@pytest.mark.parametrize("attraction", [1e-6, 1.0, 1e6])
def test_what_an_element_carries_beyond_the_level_of_its_speed_relaxes_while_it_unwinds(attraction):
    """It turns back from the static level faster than its spring unwinds: it neither keeps that nor slips back."""
    law = effects.GMS(
        stiffness=[1.0], fraction=[1.0], coulomb=FC, static=FS, stribeck_velocity=VS, attraction=attraction
    )
    back, duration = 2e-4, 1e-4
    for parts in (1, 10):
        t = np.concatenate([[0, 1e3], 1e3 + duration * np.arange(1, parts + 1) / parts])
        q = np.concatenate([[0, 0.02], 0.02 - back * np.arange(1, parts + 1) / parts])
        rests, *_, turned = -(Plant.axis() + law).joint().replay(t, q, np.gradient(q, t)).torque[1:]
        level = FC + (FS - FC) * np.exp(-back / duration / VS)
        assert rests == pytest.approx(FS, rel=1e-3)
        at_once = level + (rests - back - level) * np.exp(-attraction * duration / level)
        # In several steps the spring also unwinds what has relaxed before.
        assert turned == pytest.approx(at_once, abs=1e-9 if parts == 1 else 1.0 * back)


@pytest.mark.parametrize("parts", [1, 3, 10])
def test_a_load_that_falls_after_a_reversal_does_not_break_an_element_away(parts):
    """It falls with the level and then unwinds as a spring, whatever the step."""
    law = effects.GMS(stiffness=[1.0], fraction=[1.0], coulomb=FC, static=FC, stribeck_velocity=VS, attraction=0.1)
    joint = (Plant.axis() + law + effects.LoadDependentFriction(coefficient=1.0)).joint()
    t = np.linspace(0, 3, 3 * parts + 1)
    q = np.interp(t, [0, 1, 2, 3], [0, 0.02, 0.02 - 1e-6, 0.02 - 1e-3])
    load = np.interp(t, [0, 1, 2, 3], [0.2, 0.2, 0.1, 0.1])
    torque = -joint.replay(t, q, np.gradient(q, t), load).torque
    unwound = 1.1 * 1.0 * 0.999e-3  # stiffness grows with the level
    assert torque[2 * parts] == pytest.approx(1.1 * FC, rel=1e-3)
    assert torque[-1] == pytest.approx(1.1 * FC - unwound, rel=1e-2)


def letter(t, q, parts=20):
    """Force of one element along a motion, by the equations as they stand: past its level it slips, whichever way it is
    off; by Euler's method in `parts` steps from sample to sample."""
    force, slips, side, out = 0.0, False, 1.0, [0.0]
    for k in range(1, len(t)):
        dt = (t[k] - t[k - 1]) / parts
        v = (q[k] - q[k - 1]) / (t[k] - t[k - 1])
        level = FC + (FS - FC) * np.exp(-abs(v) / VS)
        for _ in range(parts):
            if slips and v * side > 0:
                force += 0.3 * dt * (side - force / level)
                continue
            slips, force = False, force + 1.0 * v * dt
            if abs(force) >= level:
                slips, side, force = True, np.sign(v), np.copysign(level, force)
        out.append(force)
    return np.array(out)


@given(
    elements=st.integers(1, 9),
    exponent=st.sampled_from([0.7, 1.0, 2.0]),
    slips_back=st.integers(0, 1),
    pace=st.floats(1e-3, 30.0),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60)
def test_what_is_left_out_for_speed_changes_no_bit(elements, exponent, slips_back, pace, seed):
    """Four elements that nothing modulates are followed by a shorter function: the same beside one that scales by 1."""
    rng = np.random.default_rng(seed)
    plant = Plant.axis() + effects.GMS(
        stiffness=rng.uniform(0.02, 1, elements), fraction=rng.dirichlet(np.ones(elements)), coulomb=FC, static=FS,
        stribeck_velocity=VS, stribeck_exponent=exponent, attraction=rng.uniform(0, 3), slips_back=slips_back,
    )  # fmt: skip
    v = pace * np.cumsum(rng.normal(size=400)) * 0.05
    v[150:180] = 0  # it rests
    t = np.arange(400) * 1e-3
    motion = (t, np.cumsum(v) * 1e-3, v)
    alone = plant.joint().replay(*motion, states=True)
    beside = (plant + effects.AsymmetricFriction(level=0.0)).joint().replay(*motion, states=True)
    assert np.array_equal(alone.torque, beside.torque)
    assert np.array_equal(alone.states, beside.states[:, : alone.states.shape[1]])


@given(
    slips_back=st.integers(0, 1),
    level=st.floats(-0.6, 0.6),
    stiffening=st.integers(0, 1),
    dropping=st.integers(0, 1),
    pace=st.floats(1e-3, 30.0),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60)
def test_an_element_does_the_same_by_itself_and_beside_others(slips_back, level, stiffening, dropping, pace, seed):
    """Four of five are followed at once, whatever friction does in either direction, and the last by itself."""
    rng = np.random.default_rng(seed)
    stiffness, share = rng.uniform(0.02, 1, 5), rng.dirichlet(np.ones(5))
    v = pace * np.cumsum(rng.normal(size=400)) * 0.05
    t = np.arange(400) * 1e-3

    def forces(first):
        law = effects.GMS(
            stiffness=np.roll(stiffness, -first), fraction=np.roll(share, -first), coulomb=FC, static=FS,
            stribeck_velocity=VS, attraction=1.0, slips_back=slips_back,
        )  # fmt: skip
        uneven = effects.AsymmetricFriction(level=level, stiffening=stiffening, dropping=dropping)
        return (Plant.axis() + law + uneven).joint().elements(0, t, np.cumsum(v) * 1e-3, v)

    told = forces(0)
    for first in range(1, 5):
        assert np.array_equal(np.roll(told, -first, axis=1), forces(first))


@pytest.mark.parametrize("step, close", [(1e-5, 1e-4), (5e-4, 5e-3)])
def test_by_the_letter_an_element_slips_back_where_the_falling_level_overtakes_it(step, close):
    """It has slid so slowly that it carries the static level, and turns round faster than its spring unwinds."""
    t = np.arange(0, 1.02, step)
    v = np.where(t < 1, 0.02, np.maximum(0.02 - 400 * (t - 1), -0.5))
    q = np.concatenate([[0], np.cumsum(v[1:] * step)])
    law = {"stiffness": [1.0], "fraction": [1.0], "coulomb": FC, "static": FS, "stribeck_velocity": VS}
    sticks, slips = (
        -(Plant.axis() + effects.GMS(**law, attraction=0.3, slips_back=back)).joint().replay(t, q, v).torque
        for back in (0, 1)
    )
    reference = letter(t, q)
    assert np.abs(slips - reference).max() < close * FS
    assert np.abs(sticks - reference).max() > 0.3 * FS
