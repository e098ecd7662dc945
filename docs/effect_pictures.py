"""What the torque of each effect alone looks like along one motion: the picture on its page.

The motion: strokes of a few mrad that grow, one slow revolution forth and back, then fast turns. A load and a
temperature that change go with it. An effect that is not drawn here has a page without a picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.plant import Plant
from gms_mujoco.views.figure import COLOURS, Curve, plot

Array = NDArray[np.float64]

H = 1e-3  # s
J, LEVEL = 2.4e-5, 4.5e-3  # of a servo axis [kg m^2], [N m]
STROKES, SLOW, FAST = 3.0, 8.0, 4.0  # s


@dataclass(frozen=True)
class Picture:
    """One effect and where it shows.

    Attributes:
        effect: with parameters of a usual size.
        over: quantity that it is drawn against, one of `Motion.quantities`.
        part: of the motion that is drawn: "strokes", "slow", "fast" or "all".
        beside: effects without which it does nothing; their own torque is taken off.
    """

    effect: Effect
    over: str
    part: str
    beside: tuple[Effect, ...] = ()


COULOMB = effects.Coulomb(coulomb=LEVEL)
ELEMENTS = {"stiffness": [1.2, 0.3, 0.08], "fraction": [0.3, 0.3, 0.4]}
STRIBECK = {"coulomb": LEVEL, "static": 6e-3, "stribeck_velocity": 0.8}
PICTURES = {p.effect.name: p for p in (
    Picture(effects.GMS(**ELEMENTS, **STRIBECK, attraction=0.3), "position", "strokes"),
    Picture(effects.Dahl(stiffness=1.2, coulomb=LEVEL), "position", "strokes"),
    Picture(effects.LuGre(stiffness=1.2, **STRIBECK), "position", "strokes"),
    Picture(effects.Coulomb(coulomb=LEVEL), "velocity", "slow"),
    Picture(effects.Stribeck(**STRIBECK), "velocity", "fast"),
    Picture(effects.Frictionloss(coulomb=LEVEL, creep_velocity=0.05, creep_time=9.5e-3), "velocity", "strokes"),
    Picture(effects.Viscous(coefficient=2e-5), "velocity", "fast"),
    Picture(effects.QuadraticDrag(coefficient=2e-6), "velocity", "fast"),
    Picture(effects.AsymmetricFriction(level=0.2), "velocity", "slow", (COULOMB,)),
    Picture(effects.PositionDependentFriction(harmonics=[3], amplitude=[0.25], phase=[0.5]), "position", "slow",
            (COULOMB,)),
    Picture(effects.LoadDependentFriction(coefficient=40.0), "load", "slow", (COULOMB,)),
    Picture(effects.ThermalDrift(amplitude=0.4, time_constant=5.0), "time", "all", (COULOMB,)),
    Picture(effects.Cogging(harmonics=[8], amplitude=[1e-3], phase=[0.4]), "position", "slow"),
    Picture(effects.TorqueOffset(torque=6e-4), "position", "slow"),
    Picture(effects.TorqueSaturation(limit=8e-3), "torque", "fast"),
    Picture(effects.CurrentLoopLag(time=3e-3), "torque rate", "fast"),
    Picture(effects.Delay(time=3e-3), "torque rate", "fast"),
    Picture(effects.Gravity(amplitude=1.5e-3, phase=0.6), "position", "slow"),
    Picture(effects.Spring(stiffness=4e-4, preload=3e-4), "position", "slow"),
    Picture(effects.FlexibleCoupling(inertia=0.4 * J, frequency=40.0, damping=0.03), "time", "fast"),
    Picture(effects.Backlash(inertia=0.4 * J, gap=8e-3, frequency=150.0), "time", "fast"),
    Picture(effects.EncoderEccentricity(amplitude=2e-3, phase=0.5), "position", "slow"),
)}  # fmt: skip

SAID = {
    "strokes": "short strokes that grow",
    "slow": "one slow revolution forth and back",
    "fast": "fast turns with reversals",
    "all": "strokes, a slow revolution and fast turns",
}


class Motion:
    """The motion that all are drawn along, sampled."""

    def __init__(self) -> None:
        a, b, c = (np.arange(round(s / H)) * H for s in (STROKES, SLOW, FAST))
        strokes = 0.015 * a / STROKES * np.sin(2 * np.pi * 1.5 * a)
        slow = np.pi * (1 - np.cos(2 * np.pi * b / SLOW))
        # Turns that change direction abruptly: a smoothed square wave of the velocity.
        speed = 25.0 * np.tanh(8 * np.sin(2 * np.pi * 0.5 * c)) * (1 - np.cos(2 * np.pi * c / FAST)) / 2
        self.position = np.concatenate([strokes, slow, np.cumsum(speed) * H])
        self.time = np.arange(len(self.position)) * H
        self.velocity = np.gradient(self.position, H)
        self.parts = {
            "strokes": slice(0, len(a)), "slow": slice(len(a), len(a) + len(b)), "fast": slice(len(a) + len(b), None),
            "all": slice(None),
        }  # fmt: skip
        self.load = LEVEL * (1.5 + np.sin(2 * np.pi * 0.4 * self.time))
        self.acceleration = np.gradient(self.velocity, H)
        self.acceleration[[len(a), len(a) + len(b)]] = 0.0  # where the parts meet
        self.command = J * self.acceleration + LEVEL * np.tanh(self.velocity / 4.0)
        self.quantities = {
            "position": (self.position, "rad"),
            "velocity": (self.velocity, "rad/s"),
            "time": (self.time, "s"),
            "load": (self.load, "N m"),
            "torque": (self.command, "N m"),
            "torque rate": (np.gradient(self.command, H), "N m/s"),
        }

    def missed(self, picture: Picture) -> tuple[Array, str, str]:
        """(n,) what a model without the effect misses, what that is, and its unit."""
        e = picture.effect
        if e.kind == "sensor":
            return e.read(self.time, self.position) - self.position, "reading - position", "rad"
        label = "torque that is missing"
        if not e.is_native:
            return self.command - e.deliver(self.time, self.command), label, "N m"
        whole, without = (self._torque(*picture.beside, *more) for more in ((e,), ()))
        rigid = e.hidden_inertia * self.acceleration  # what such a model takes for its part of the axis
        return without - whole - rigid, label, "N m"

    def _torque(self, *chosen: Effect) -> Array:
        plant = Plant(J, chosen)
        return plant.joint().replay(self.time, self.position, self.velocity, self.load, None).torque


def picture(effect: type[Effect]) -> str:
    """SVG of the effect, and a sentence that says what is drawn; "" for an effect that is not drawn here."""
    p = PICTURES.get(effect.name)
    if p is None:
        return ""
    here = MOTION.parts[p.part]
    y, label, unit = MOTION.missed(p)
    x, x_unit = MOTION.quantities[p.over]
    svg = plot([Curve(effect.name, x[here], y[here], COLOURS[1])], p.over, x_unit, label, unit, width=560, height=260)
    values = ", ".join(f"{k} {_said(v)}" for k, v in p.effect.values.items())
    caption = f"{effect.name} alone along {SAID[p.part]}: what a model without it misses ({values})."
    return f'<figure class="signature">{svg}<figcaption>{caption}</figcaption></figure>'


def _said(value: float | tuple[float, ...]) -> str:
    numbers = [f"{v:g}" for v in np.atleast_1d(value)]
    return numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"


MOTION = Motion()
