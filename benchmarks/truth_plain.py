"""Hidden effects made by a small simulator of its own, in tiny steps of plain Python: what MuJoCo has no element for,
and effects that nobody has in a catalogue."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from bench_axes import FINE, Array, Axis, Controller, Run

# Effects of the catalogue.
EFFECTS = (
    "asymmetric_friction", "position_dependent_friction", "load_dependent_friction", "thermal_drift", "quadratic_drag",
    "encoder_eccentricity",
)  # fmt: skip
# Effects of nobody's catalogue, and what each does.
INVENTED = {
    "hum": "a torque that is periodic in time",
    "stick_once": "the axis sticks once for a moment",
    "wandering_friction": "a friction level that wanders at random",
    "torque_jump": "a constant torque that appears in the middle of a run",
    "encoder_dropouts": "the encoder holds its last count for some milliseconds, now and then",
    "ageing_contact": "friction that grows with the time of rest and wears off when moving",
    "dead_zone": "an amplifier that delivers nothing for small commands",
    "magnetic_hysteresis": "a torque that follows a harmonic of the position late",
    "varying_inertia": "an inertia that changes along the revolution",
    "sensor_resonance": "the torque sensor rings",
    "amplifier_ripple": "a gain of the amplifier that varies with the electrical angle, otherwise in either direction",
    "belt_creep": "a belt that creeps under its load, between drive and encoder",
    "bearing_defect": "a torque each time a roller passes a dent, not a whole number of times per revolution",
    "mains_hum": "50 Hz on the reading of the torque",
    "cable_drag": "a cable that is dragged along: a spring that gives way over radians",
}

Values = dict[str, float]


def sized(axis: Axis, name: str, strength: float, seen: list[Run]) -> Values:
    """Parameters of an effect whose torque reaches `strength` of the friction level."""
    rng, top = axis.rng, strength * axis.level
    phase = float(rng.uniform(-math.pi, math.pi))
    sign = math.copysign(1, phase)
    own: dict[str, Values] = {
        "asymmetric_friction": {"share": sign * strength},
        "position_dependent_friction": {"share": strength, "harmonic": float(rng.integers(1, 6)), "phase": phase},
        # A load that swings between 0 and 1 N m, and by half the strength around its mean.
        "load_dependent_friction": {"coefficient": 2 * strength},
        "thermal_drift": {"share": strength, "time": float(rng.uniform(0.5, 2.5))},
        "quadratic_drag": {"coefficient": top / axis.fastest**2},
        "encoder_eccentricity": {"amplitude": min(top / axis.inertia / axis.fastest**2, 0.2), "phase": phase},
        "gravity": {"torque": top, "phase": phase},
        "cogging": {"amplitude": top, "harmonic": float(rng.integers(3, 15)), "phase": phase},
        "torque_offset": {"torque": sign * top},
        "hum": {"torque": top, "omega": 2 * math.pi * float(rng.uniform(4, 30)), "phase": phase},
        "stick_once": {"torque": 15 * top, "at": float(rng.uniform(0.3, 0.7))},
        "wandering_friction": {"share": strength, "time": 0.3},
        "torque_jump": {"torque": sign * top, "at": float(rng.uniform(0.4, 0.7))},
        "encoder_dropouts": {"time": 0.03 * strength + 0.002, "per_second": 2.0},
        "ageing_contact": {"share": 2 * strength, "time": 0.1},
        "dead_zone": {"torque": 1.5 * top},
        "magnetic_hysteresis": {"torque": top, "harmonic": float(rng.integers(2, 7))},
        "varying_inertia": {"share": strength},
        "amplifier_ripple": {"share": strength, "harmonic": float(rng.integers(4, 15)), "phase": phase},
        "belt_creep": {"share": 0.05 * strength / axis.level},
        "bearing_defect": {"torque": 4 * top, "per_turn": float(rng.uniform(2.6, 5.4))},
        "mains_hum": {"torque": top, "phase": phase},
        "cable_drag": {"torque": top, "range": float(rng.uniform(0.5, 2))},
        "sensor_resonance": {"omega": 2 * math.pi * float(rng.uniform(30, 60)) / (1 + strength), "zeta": 0.1},
    }
    return own[name]


@dataclass
class _Chance:
    """What is random in one run."""

    wander: Array
    dropped: set[int]
    at: float


def simulate(axis: Axis, hidden: dict[str, Values], run: Run, number: int) -> tuple[Array, Array, Array]:
    """(n,) torque as logged [N m], position of what the encoder sees [rad], load [N m].

    Args:
        number: of the run in its set, for what happens once.
    """
    parts = math.ceil(1 / axis.rate / FINE)
    n, h = len(run.torque), 1 / axis.rate / parts
    get = hidden.get
    asym, place, bears, warm = (get(k) for k in EFFECTS[:4])
    drag = get("quadratic_drag", {"coefficient": 0.0})["coefficient"]
    disc, pull, cog, offset, hum = (
        get(k) for k in ("encoder_eccentricity", "gravity", "cogging", "torque_offset", "hum")
    )
    jump, age, dead, magnet, vary, ring = (
        get(k)
        for k in ("torque_jump", "ageing_contact", "dead_zone", "magnetic_hysteresis", "varying_inertia",
                  "sensor_resonance")
    )  # fmt: skip
    ripple, creep, dent, mains, cable = (
        get(k) for k in ("amplifier_ripple", "belt_creep", "bearing_defect", "mains_hum", "cable_drag")
    )
    stick = get("stick_once") if number == 1 else None
    chance = _drawn(axis, hidden, n)
    rng = np.random.default_rng(round(1e9 * axis.inertia / axis.level))  # the same bearing in every run
    distance = (axis.breakaway * np.geomspace(0.2, 3, 5)).tolist()
    share = rng.dirichlet(np.full(5, 4.0)).tolist()
    spring = [a * axis.level / x for a, x in zip(share, distance, strict=True)]
    held = [0.0] * 5
    inertia, level, viscous = axis.inertia, axis.level, axis.viscous
    slow, exponent = 0.02 * axis.fastest, float(rng.uniform(0.7, 2))  # of the Stribeck curve
    lagged, follow = 1.15, h / 0.004  # the level follows the speed late: frictional lag
    q, v, rested = run.start, 0.0, 0.0
    shown, shown_rate, late, crept, dragged = 0.0, 0.0, 0.0, 0.0, 0.0
    control, count = Controller(axis), axis.count
    torque, position = np.empty(n), np.empty(n)
    load = 0.5 + 0.5 * np.sin(2 * math.pi * (0.23 + 0.1 * number) * np.arange(n) / axis.rate + number)
    duration = n / axis.rate
    for k in range(n):
        position[k] = q + crept if disc is None else q + disc["amplitude"] * math.sin(q + disc["phase"])
        if k in chance.dropped:
            position[k] = position[k - 1]
        reading = round(position[k] / count) * count
        feed = float(run.torque[k])
        u = feed if run.reference is None else control(feed, run.reference[k], reading)
        torque[k] = u
        if dead is not None:
            u = math.copysign(max(abs(u) - dead["torque"], 0.0), u)
        wander, weight = float(chance.wander[k]), float(load[k])
        for i in range(parts):
            t = (k + i / parts) / axis.rate
            factor = wander
            if place is not None:
                factor *= 1 + place["share"] * math.sin(place["harmonic"] * q + place["phase"])
            if bears is not None:
                factor *= 1 + bears["coefficient"] * weight
            if warm is not None:
                factor *= 1 + warm["share"] * math.exp(-t / warm["time"])
            if asym is not None:
                factor *= 1 + math.copysign(asym["share"], v)
            if age is not None:
                rested = min(rested + h, 2.0) if abs(v) < 0.02 * slow else rested * (1 - min(h * abs(v) / 0.05, 1))
                factor *= 1 + age["share"] * math.log1p(rested / age["time"])
            if stick is not None and abs(t / duration - chance.at) < 0.03 / duration:
                factor *= 1 + stick["torque"] / level
            lagged += follow * (1 + 0.15 * math.exp(-((abs(v) / slow) ** exponent)) - lagged)
            top = factor * lagged * level
            f = 0.0
            for j in range(5):
                w = held[j] + spring[j] * v * h
                most = share[j] * top
                held[j] = w = most if w > most else -most if w < -most else w
                f += w
            torque_out = u - f - viscous * v - drag * abs(v) * v
            if pull is not None:
                torque_out += pull["torque"] * math.sin(q + pull["phase"])
            if cog is not None:
                torque_out += cog["amplitude"] * math.sin(cog["harmonic"] * q + cog["phase"])
            if offset is not None:
                torque_out += offset["torque"]
            if hum is not None:
                torque_out += hum["torque"] * math.sin(hum["omega"] * t + hum["phase"] + number)
            if jump is not None and t > jump["at"] * duration:
                torque_out += jump["torque"] * (1 if number % 2 else -1)
            if magnet is not None:
                late += abs(v) * h / 0.3 * (math.sin(magnet["harmonic"] * q) - late)
                torque_out += magnet["torque"] * late
            if ripple is not None:
                ahead = ripple["phase"] + math.copysign(0.6, v)
                torque_out += u * ripple["share"] * math.sin(ripple["harmonic"] * q + ahead)
            if creep is not None:
                crept += creep["share"] * u * abs(v) * h
            if dent is not None and (dent["per_turn"] * q / (2 * math.pi)) % 1 < 0.08:
                torque_out -= math.copysign(dent["torque"], v)
            if cable is not None:
                dragged += v * h / cable["range"] * (1 - math.copysign(dragged, dragged * v))
                torque_out -= cable["torque"] * dragged
            mass = inertia
            if vary is not None:
                mass = inertia * (1 + vary["share"] * math.sin(2 * q))
                torque_out -= inertia * vary["share"] * math.cos(2 * q) * v * v
            v += h * torque_out / mass
            q += h * v
            if ring is not None:
                shown_rate += h * (ring["omega"] ** 2 * (u - shown) - 2 * ring["zeta"] * ring["omega"] * shown_rate)
                shown += h * shown_rate
        if ring is not None:
            torque[k] = shown
        if mains is not None:
            torque[k] += mains["torque"] * math.sin(100 * math.pi * k / axis.rate + mains["phase"] + number)
    return torque, position, load


def _drawn(axis: Axis, hidden: dict[str, Values], n: int) -> _Chance:
    rng, wander, dropped = axis.rng, np.ones(n), set[int]()
    if (w := hidden.get("wandering_friction")) is not None:
        keep = math.exp(-1 / axis.rate / w["time"])
        x, steps = 0.0, rng.standard_normal(n) * math.sqrt(1 - keep**2)
        for k in range(n):
            x = keep * x + steps[k]
            wander[k] = max(1 + w["share"] * x, 0.2)
    if (d := hidden.get("encoder_dropouts")) is not None:
        for start in rng.integers(1, n, round(d["per_second"] * n / axis.rate)):
            dropped |= set(range(start, start + max(round(d["time"] * axis.rate), 2)))
    return _Chance(wander, dropped, hidden.get("stick_once", {"at": 0.5})["at"])
