"""What every friction law must show, each as a property with a figure; what Maxwell-slip shows beyond: test_gms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.plant import Plant

FC, FS, VS, J = 4.5e-3, 5.4e-3, 0.8, 2.4e-5
CURVE = {"coulomb": FC, "static": FS, "stribeck_velocity": VS}
LAWS: dict[str, Effect] = {
    "coulomb": effects.Coulomb(coulomb=FC),
    "stribeck": effects.Stribeck(**CURVE),
    "dahl": effects.Dahl(stiffness=1.5, coulomb=FC),
    "lugre": effects.LuGre(stiffness=1.5, damping=1e-4, **CURVE),
    "elastic": effects.LuGre(stiffness=1.5, damping=1e-4, elastic=0.6, **CURVE),
    "plastic": effects.LuGre(stiffness=1.5, damping=1e-4, plastic=1, **CURVE),
    "gms": effects.GMS(stiffness=[0.8, 0.4, 0.2, 0.1], fraction=[0.1, 0.2, 0.3, 0.4], attraction=0.3, **CURVE),
}
TAILS = {
    "stribeck with a tail": LAWS["stribeck"].replace(stribeck_exponent=2.0, stribeck_tail=1.0),
    "lugre with a tail": LAWS["lugre"].replace(stribeck_exponent=1.5, stribeck_tail=0.5),
    "gms with a tail": LAWS["gms"].replace(stribeck_exponent=2.0, stribeck_tail=1.0),
}
LAWS |= TAILS
EVERY = pytest.mark.parametrize("law", LAWS)
DYNAMIC = pytest.mark.parametrize("law", [k for k, law in LAWS.items() if law.name in ("dahl", "lugre", "gms")])
# Of the Stribeck curve; none: level Fc at every speed.
EXPONENT = {"stribeck": 1, "lugre": 2, "elastic": 2, "plastic": 2, "gms": 1}


def friction(plant, q, dt=1e-3, load=None):
    """(n,) friction on the moving side [N m] along (n,) positions."""
    return -plant.joint().replay(np.arange(len(q)) * dt, q, np.gradient(q, dt), load).torque


def curve(law, v):
    x = abs(v / VS)
    if law in TAILS:
        weakening = 1 / (1 + 0.5 * x**1.5) ** 2 if law.startswith("lugre") else 1 / (1 + x**2)
    else:
        weakening = np.exp(-(x ** EXPONENT[law])) if law in EXPONENT else 0.0
    return np.sign(v) * (FC + (FS - FC) * weakening)


@EVERY
@pytest.mark.parametrize("speed", [0.01, 0.3, 1.0, 3.0, -0.3])
def test_steady_speed_is_on_the_five_parameter_curve(law, speed):
    sigma, dt = 2e-5, 1e-3
    q = speed * np.arange(round(max(2.0, 0.1 / abs(speed)) / dt)) * dt
    force = friction(Plant.axis() + LAWS[law] + effects.Viscous(coefficient=sigma), q, dt)
    assert force[-1] == pytest.approx(curve(law, speed) + sigma * speed, rel=5e-4)


MODULATORS = {  # and the factor on the level at (position, time, load, direction)
    "asymmetric": (effects.AsymmetricFriction(level=0.2), lambda q, t, load, side: 1 + 0.2 * side),
    "asymmetric, as a whole": (
        effects.AsymmetricFriction(level=0.2, whole=1), lambda q, t, load, side: 1 + 0.2 * side,
    ),
    "asymmetric, by its own sign": (
        effects.AsymmetricFriction(level=0.2, whole=2), lambda q, t, load, side: 1 + 0.2 * side,
    ),
    "position": (
        effects.PositionDependentFriction(harmonics=[3], amplitude=[0.3], phase=[0.4]),
        lambda q, t, load, side: 1 + 0.3 * np.sin(3 * q + 0.4),
    ),
    "load": (effects.LoadDependentFriction(coefficient=50.0), lambda q, t, load, side: 1 + 50 * abs(load)),
    "thermal": (
        effects.ThermalDrift(amplitude=-0.4, time_constant=5.0),
        lambda q, t, load, side: 1 - 0.4 * np.exp(-t / 5),
    ),
    "thermal, heated by its own": (
        effects.ThermalDrift(amplitude=-0.4, time_constant=5.0, speed=0.2),
        lambda q, t, load, side: 1 - 0.4 * np.exp(-0.5 / 0.2 * (1 - np.exp(-t / 5))),
    ),
    "thermal, at 20 degC": (
        effects.ThermalDrift(amplitude=-0.4, time_constant=5.0, temperature_scale=15.0),
        lambda q, t, load, side: 1 - 0.4,
    ),
}


@EVERY
@pytest.mark.parametrize("modulator", MODULATORS)
@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_what_modulates_friction_scales_each_law(law, modulator, speed):
    """Turning steadily, with all drags beside: a product of the law's level and a factor, plus the drags."""
    dt, load = 1e-3, 4e-3
    t = np.arange(3000) * dt
    effect, factor = MODULATORS[modulator]
    drags = effects.QuadraticDrag(coefficient=1e-4), effects.Viscous(coefficient=2e-5)
    force = friction(Plant.axis() + LAWS[law] + effect + drags[0] + drags[1], speed * t, dt, np.full(len(t), load))
    expected = curve(law, speed) * factor(speed * t, t, load, np.sign(speed)) * np.ones(len(t))
    expected += 1e-4 * speed * abs(speed) + 2e-5 * speed
    late = t > 1  # past break-away; a bristle and the slip follow a varying level with a lag
    lag = 0.05 if modulator == "position" and law.split()[0] in ("dahl", "lugre", "elastic", "gms") else 2e-3
    assert np.allclose(force[late], expected[late], rtol=lag)


@DYNAMIC
@settings(max_examples=40)
@given(turns=st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=10), step=st.floats(1e-4, 0.3))
def test_stays_within_its_level(law, turns, step):
    q = path(0.0, *turns, step=step)
    plant = Plant.axis() + (LAWS[law].replace(damping=0.0) if "damping" in LAWS[law].values else LAWS[law])
    assert np.abs(friction(plant, q)).max() <= (FC if law == "dahl" else FS) * (1 + 1e-12)


def path(*turns, step=1e-3):
    legs = [np.linspace(a, b, max(2, round(abs(b - a) / step) + 1))[1:] for a, b in pairwise(turns)]
    return np.concatenate([[turns[0]], *legs])


@EVERY
@settings(max_examples=40)
@given(turns=st.lists(st.integers(-100, 100), min_size=1, max_size=10), step=st.sampled_from([1e-5, 1e-4, 1e-3]))
def test_no_net_work_over_a_closed_cycle(law, turns, step):
    """Passive: once the force is periodic like the motion, a cycle takes energy and never gives any."""
    cycle = step * path(0, *turns, 0, step=1)  # at one speed: a jump of the level is no work
    q = np.concatenate([cycle] + [cycle[1:]] * 3)
    force = friction(Plant.axis() + LAWS[law], q)
    work = 0.5 * (force[1:] + force[:-1]) * np.diff(q)
    rounding = 1e-9 * FS * np.abs(np.diff(cycle)).sum()
    assert work[-(len(cycle) - 1) :].sum() >= -rounding


@pytest.mark.parametrize(("law", "lags"), [("lugre", True), ("gms", True), ("dahl", False), ("stribeck", False)])
def test_friction_lags_velocity(law, lags):
    """The force at one speed differs between speeding up and slowing down; a law without memory of rate has one."""
    dt = 1e-4
    t = np.arange(0, 1, dt)
    v = 1.0 + 0.9 * np.sin(2 * np.pi * 20 * t)
    slow = LAWS[law] if law != "lugre" else effects.LuGre(stiffness=0.05, **CURVE)
    force = friction(Plant.axis() + slow, np.cumsum(v) * dt, dt)
    up, down = (np.gradient(v) > 0) & (t > 0.5), (np.gradient(v) < 0) & (t > 0.5)
    at = [np.interp(1.0, *(x[np.argsort(v[m])] for x in (v[m], force[m]))) for m in (up, down)]
    assert at[0] - at[1] > 0.02 * (FS - FC) if lags else abs(at[0] - at[1]) < 5e-3 * (FS - FC)


@pytest.mark.parametrize(("law", "falls"), [("lugre", True), ("gms", True), ("dahl", False)])
def test_break_away_depends_on_the_rate(law, falls):
    speeds = 0.001, 0.1, 2.0
    peak = [friction(Plant.axis() + LAWS[law], path(0, 0.3, step=v * 1e-3)).max() for v in speeds]
    assert peak[0] > peak[1] > peak[2] if falls else np.ptp(peak) < 1e-3 * FC


def exact(law, t, torque):
    """Position at times t of the axis with the law's equation as it stands in the literature, by LSODA."""
    spring, level = 1.5, lambda v: FC + (FS - FC) * np.exp(-((v / VS) ** 2))

    def rates(now, y):
        _, v, f = y
        if law == "dahl":
            return [v, (torque(now) - f) / J, spring * (1 - f / FC * np.sign(v)) * v]
        share = f * np.sign(v) / level(v)
        bend = v * (1 - share)  # sigma0 dz/dt = sigma0 (v - sigma0 |v| z / s)
        if law == "elastic":
            edge = 0.6 * FC / level(v)
            alpha = np.sin(np.pi / 2 * np.clip((share - edge) / (1 - edge), 0, 1)) ** 2
            bend = v * (1 - alpha * share)
        return [v, (torque(now) - f - 1e-4 * bend) / J, spring * bend]

    return solve_ivp(rates, (0, t[-1]), [0, 0, 0], "LSODA", t, rtol=1e-10, atol=1e-13, max_step=1e-4).y[0]


@pytest.mark.parametrize("law", ["dahl", "lugre", "elastic"])
def test_agrees_with_its_equation_to_a_thousandth_of_the_range(law):
    """Sliding, turning round, coming to rest; the error halves with the step. GMS: test_reference."""
    h = 5e-4
    t = np.arange(500) * h
    commands = 1.3 * FS * np.sin(2 * np.pi * 5 * t) * np.exp(-4 * t)
    reference = exact(law, t, lambda now: commands[min(int(now / h + 1e-9), len(t) - 1)])
    joint = (Plant.axis(J) + LAWS[law]).joint()
    finest = 256 if law == "elastic" else 64  # what only bends rings, and an implicit step damps that
    for integration in ("explicit", "implicit"):
        error = [
            np.abs(joint.simulate(J, h, commands, substeps=n, integration=integration).position - reference).max()
            for n in (finest // 4, finest // 2, finest)
        ]
        assert error[-1] < 1e-3 * np.ptp(reference), (integration, error)
        order = np.log2(np.divide(error[:-1], error[1:]))
        assert (order > 0.8).all(), (integration, order)


@EVERY
@pytest.mark.parametrize("wh", [10.0, 100.0])
def test_bounded_without_chatter_at_any_step(law, wh):
    """Pushed past break-away and back at a step far too long for its springs."""
    h = 2e-3
    k = J * (wh / h) ** 2
    stiff = {
        "dahl": effects.Dahl(stiffness=k, coulomb=FC),
        "lugre": effects.LuGre(stiffness=k, damping=np.sqrt(k * J), **CURVE),
        "elastic": effects.LuGre(stiffness=k, damping=np.sqrt(k * J), elastic=0.6, **CURVE),
        "gms": effects.GMS(
            stiffness=k * np.array([8, 4, 2, 1]) / 15, fraction=[0.1, 0.2, 0.3, 0.4], attraction=0.3, **CURVE
        ),
    }.get(law, LAWS[law])
    torque = 1.5 * FS * np.sin(2 * np.pi * 3 * np.arange(1000) * h)
    motion = (Plant.axis(J) + stiff).joint().simulate(J, h, torque)
    assert np.abs(motion.friction).max() <= FS * (1 + 1e-9)
    v = motion.velocity
    fast = v[np.abs(v) > 0.05 * np.abs(v).max()]
    assert np.count_nonzero(np.diff(np.sign(fast))) <= 2 * 6 + 1


def test_a_bristle_that_only_bends_holds_what_stays_below_its_share():
    """Under a load that trembles below break-away the bristle of LuGre creeps, that of Dupont and others does not."""
    t = np.arange(4000) * 1e-3
    load = FS * (0.25 + 0.2 * np.sin(2 * np.pi * 5 * t)) * np.minimum(t / 0.5, 1)
    crept = {}
    for law in ("lugre", "elastic"):
        plant = Plant.axis(J) + LAWS[law].replace(damping=2e-3)
        q = plant.joint().simulate(J, 1e-3, load, substeps=50).position
        crept[law] = abs(q[3000:3800].mean() - q[1000:1800].mean())
    assert crept["elastic"] < 1e-9 and crept["lugre"] > 1e-4


def test_a_bristle_that_only_bends_unbends_along_a_straight_line():
    """From where it slides to the other side's share with sigma0 alone, where LuGre's is up to twice as stiff."""
    q = path(0.0, 0.1, 0.1 - 2 * FC / 1.5, step=1e-6)
    law = LAWS["elastic"].replace(damping=0.0, static=FC)
    force = friction(Plant.axis() + law, q)
    turn = int(np.argmax(q))
    back = q[turn] - q[turn:]
    straight = 1.5 * back < (1 + 0.6) * FC
    assert force[turn] == pytest.approx(FC, rel=1e-9)
    np.testing.assert_allclose(force[turn:][straight], FC - 1.5 * back[straight], atol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.95])
def test_a_bristle_that_only_bends_gives_way_as_published_whatever_the_step(share):
    """One interval or many to the same place: the solution of the equation of Dupont and others."""
    ways = np.geomspace(0.01, 10, 30)

    def gives_way(_, pull):
        return 1 - np.sin(np.pi / 2 * np.clip((pull - share) / (1 - share), 0, 1)) ** 2 * pull

    exact = solve_ivp(gives_way, (0, ways[-1]), [0.0], "LSODA", ways, rtol=1e-10, atol=1e-12, max_step=0.01).y[0]
    plant = Plant.axis() + effects.LuGre(stiffness=FC, coulomb=FC, static=FC, stribeck_velocity=VS, elastic=share)
    for n in (1, 7, 1000):
        reached = [friction(plant, np.linspace(0, way, n + 1))[-1] for way in ways]
        np.testing.assert_allclose(reached, FC * exact, atol=5e-5 * FC)


def test_a_spring_that_is_cut_off_moves_as_its_authors_step_it():
    """Kikuuwe et al. (2006): backward Euler of a spring and a damper, whose force is cut off at the level."""
    law, dt = effects.LuGre(stiffness=1.5, damping=4e-3, plastic=1, **CURVE), 2e-5
    t = np.arange(0, 1.5, dt)
    q = 0.02 * np.sin(2 * np.pi * 4 * t) * t + 0.1 * np.sin(2 * np.pi * 1.3 * t)
    bend, forces, way = 0.0, np.zeros(len(t)), np.diff(q, prepend=q[:1])
    for i, d in enumerate(way):
        level = abs(curve("plastic", d / dt)) if d else FS
        forces[i] = np.clip(law.stiffness * (bend + d) + law.damping * d / dt, -level, level)
        bend = (forces[i] + law.damping * bend / dt) / (law.stiffness + law.damping / dt)
    assert np.abs(friction(Plant.axis() + law, q, dt) - forces)[1:].max() < 2e-3 * FS
    assert np.abs(forces).max() > 0.99 * FC


@pytest.mark.parametrize("elastic", [0.0, 0.6])
def test_a_bristle_is_damped_as_it_follows_a_level_that_changes_with_the_place(elastic):
    """A way of many of its lengths in each interval, against its equation in steps as small as it takes: what it is
    damped by is most of what the place does then."""
    k, damping, share, n, fast = 5.0, 0.03, 0.3, 3, 40.0
    law = effects.LuGre(stiffness=k, damping=damping, elastic=elastic, **CURVE)
    place = effects.PositionDependentFriction(harmonics=[n], amplitude=[share], phase=[0.4], stiffening=0.0)
    t = np.arange(800) * 5e-4
    q, v = fast / 10 * np.sin(10 * t), fast * np.cos(10 * t)

    def level(t):
        return curve("lugre", abs(fast * np.cos(10 * t))) * (1 + share * np.sin(n * fast / 10 * np.sin(10 * t) + 0.4))

    def slips(pull, t):
        edge, s = elastic * FC * level(t) / curve("lugre", abs(fast * np.cos(10 * t))), level(t)
        return (1 - np.sin(np.pi / 2 * np.clip((s - pull) / (s - edge), 0, 1)) ** 2 if elastic else 1.0) * pull / s

    def rate(t, pull):
        speed = fast * np.cos(10 * t)
        return k * speed * (1 - slips(np.sign(speed) * pull, t))

    exact = solve_ivp(rate, (0, t[-1]), [level(0)], "Radau", t, rtol=1e-8, atol=1e-12, max_step=1e-4).y[0]
    damped = np.array([rate(at, pull) for at, pull in zip(t, exact, strict=True)]) * damping / k
    assert np.ptp(damped) > FC
    found = -(Plant.axis() + law + place).joint().replay(t, q, v, memory=np.array([1.0])).torque
    moves = (t > 0.05) & (abs(v) > 1)
    assert np.sqrt(np.mean((found - exact - damped)[moves] ** 2)) < 0.02 * FC
