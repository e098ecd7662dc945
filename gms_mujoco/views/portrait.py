"""The friction of a plant as a rerun recording: what its parameters mean, before any measurement."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ..identification.motion import break_away_distance, virgin_curve
from ..plant import Plant
from . import drawing
from .drawing import draw
from .figure import COLOURS, Curve, prefixed
from .page import conditions, origin

Array = NDArray[np.float64]

_FAR = 10.0  # rad or m: no friction turns round over more
_LOOPS = (1.2, 0.5, 0.15)  # amplitudes of the loops, in break-away distances
_SAMPLES = 1024  # of one period
_QUASI_STATIC = 1e3  # s, period of motions that are slow
_SPEEDS = np.geomspace(1e-5, 1e3, 161)  # rad/s or m/s
_MOST = 3.0  # times the friction at rest: what is faster than that hides the Stribeck curve
_PERIODIC = ("cogging", "gravity", "position_dependent_friction")


def write_portrait(path: str | Path, plant: Plant) -> None:
    """Writes the recording of a plant.

    Entities: `parameters/text`; `virgin` (friction from rest), `loops` (hysteresis at several amplitudes), `speed`
    (steady friction), `resonance` (Dahl resonance over amplitude, where the inertia is known) and `turn` (torque over a
    slow revolution, where something depends on the position). The numbers of each curve stand in `.../data/CURVE`.

    Raises:
        ModelError: a parameter has no value yet; the inertia may be missing.
        GmsError: the folder does not exist or cannot be written.
    """
    torque, angle = ("N m", "rad") if plant.kind == "hinge" else ("N", "m")
    replace(plant, inertia=plant.inertia or 1.0).complete()
    reach = break_away_distance(plant, _FAR)
    views = []
    with drawing.recording(path) as stream:

        def show(entity: str, name: str, *drawn: object, **how: object) -> None:
            draw(stream, entity, *drawn, **how)  # type: ignore[arg-type]
            views.append(drawing.view(entity, name + conditions(plant)))

        if reach:
            distance, friction = virgin_curve(plant, 5 * reach)
            show("virgin", "from rest: the virgin curve", [Curve("virgin curve", distance, friction, COLOURS[0])],
                 "distance from rest", angle, "friction", torque, log=(True, False))  # fmt: skip
            curves = [_named_loop(plant, a * reach, angle, COLOURS[k]) for k, a in enumerate(_LOOPS)]
            show("loops", "to and fro: hysteresis", curves, "position", angle, "friction", torque)
        speed, (forward, backward) = _SPEEDS, steady_friction(plant, _SPEEDS, reach)
        seen = np.flatnonzero(np.maximum(forward, backward) <= _MOST * max(forward[0], backward[0]))
        first = np.flatnonzero(np.abs(forward - forward[0]) > 1e-3 * abs(forward[0]))  # where it begins to change
        shown = slice(int(first[0]) if len(first) else 0, int(seen[-1]) + 1)
        speed, forward, backward = speed[shown], forward[shown], backward[shown]
        curves = [Curve("forward", speed, forward, COLOURS[0])]
        if not np.allclose(forward, backward, rtol=1e-3):
            curves.append(Curve("backward", speed, backward, COLOURS[1]))
        if forward.any():
            moving = "turning" if plant.kind == "hinge" else "motion"
            show("speed", f"steady {moving}: friction over speed", curves, "speed", f"{angle}/s", "friction", torque,
                 log=(True, False))  # fmt: skip
        if reach and plant.inertia:
            amplitude = reach * np.geomspace(1e-3, 3.0, 40)
            curve = Curve("Dahl resonance", amplitude, dahl_resonance(plant, amplitude), COLOURS[0])
            show("resonance", "small strokes: Dahl resonance over amplitude", [curve], "amplitude", angle,
                 "frequency", "Hz", log=(True, True))  # fmt: skip
        if plant.kind == "hinge" and any(name in plant for name in _PERIODIC):
            position, there, back = slow_turn(plant)
            curves = [Curve("forward", position, there, COLOURS[0]), Curve("backward", position, back, COLOURS[1])]
            show("turn", "one slow revolution", curves, "position", angle, "torque of the drive", torque)
        lines = ["# " + ", ".join(e.name for e in plant.effects), "", "| parameter | value | 95 % interval | unit |"]
        lines += ["|---|---|---|---|", *(f"| {' | '.join(row)} |" for row in plant.rows()), ""]
        lines += [f"**{key}:** {value}\n" for key, value in origin(plant)]
        stream.log("parameters/text", rr.TextDocument("\n".join(lines), media_type="text/markdown"), static=True)
        text = rrb.TextDocumentView(origin="parameters/text", name="parameters")
        whole = (
            rrb.Horizontal(text, rrb.Grid(*views, grid_columns=min(len(views), 2)), column_shares=[1, 2])
            if views
            else text
        )
        panel = rrb.TimePanel(state="hidden", timeline="time")
        stream.send_blueprint(rrb.Blueprint(whole, panel, collapse_panels=True))


def hysteresis(plant: Plant, amplitude: Array) -> tuple[Array, Array]:
    """Closed loops of friction along slow sines, once transients are over.

    Args:
        amplitude: (c,) [rad].

    Returns:
        (c, n + 1) position [rad] and friction against the motion [N m].
    """
    phase = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    position = amplitude[:, None] * np.sin(phase)
    velocity = amplitude[:, None] * np.cos(phase) * 2 * np.pi / _QUASI_STATIC
    period = np.full(len(amplitude), _QUASI_STATIC)
    friction = -plant.friction.joint().cycle(period, position, velocity)
    return np.c_[position, position[:, :1]], np.c_[friction, friction[:, :1]]


def dahl_resonance(plant: Plant, amplitude: Array) -> Array:
    """(c,) frequency at which an axis swings on its friction, J w^2 = in-phase stiffness of the first harmonic [Hz]."""
    assert plant.inertia is not None
    position, friction = (v[:, :-1] for v in hysteresis(plant, amplitude))
    stiffness = 2 * np.mean(friction * position, axis=1) / amplitude**2
    return np.asarray(np.sqrt(np.maximum(stiffness, 0.0) / plant.inertia) / (2 * math.pi))


def steady_friction(plant: Plant, speed: Array, reach: float) -> tuple[Array, Array]:
    """(c,) friction at steady speed forward and backward, mean over a revolution, of a warm axis without load [N m].

    Args:
        speed: (c,) [rad/s].
        reach: break-away distance, over which friction turns round [rad].
    """
    revolution = 2 * math.pi if plant.kind == "hinge" else 20 * reach or 1.0
    last = slice(_SAMPLES // 4, _SAMPLES // 2)  # second of two revolutions forward, before two backward
    ramp = np.arange(_SAMPLES // 2) * 4 * revolution / _SAMPLES
    position = np.tile(np.r_[ramp, 2 * revolution - ramp], (len(speed), 1))
    way = np.repeat([1.0, -1.0], _SAMPLES // 2)
    torque = plant.friction.joint().cycle(4 * revolution / speed, position, speed[:, None] * way)
    second = slice(last.start + _SAMPLES // 2, last.stop + _SAMPLES // 2)
    return -torque[:, last].mean(1), torque[:, second].mean(1)


def slow_turn(plant: Plant) -> tuple[Array, Array, Array]:
    """(n,) position, and torque that the drive needs forward and backward over a slow revolution [rad], [N m]."""
    half = _SAMPLES // 2
    ramp = np.arange(half) * 2 * np.pi / half
    position = np.r_[ramp, 2 * np.pi - ramp][None]
    velocity = np.repeat([1.0, -1.0], half)[None] * 4 * np.pi / _QUASI_STATIC
    torque = -plant.joint().cycle(np.array([_QUASI_STATIC]), position, velocity)[0]
    return ramp, torque[:half], torque[half:][::-1]


def _named_loop(plant: Plant, amplitude: float, unit: str, colour: str) -> Curve:
    position, friction = hysteresis(plant, np.array([amplitude]))
    scale, unit = prefixed(amplitude, unit)
    return Curve(f"{float(f'{amplitude / scale:.2g}'):g} {unit}", position[0], friction[0], colour)
