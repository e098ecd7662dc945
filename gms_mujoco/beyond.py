"""Causes beyond the catalogue, which an effect of it has to beat.

What resembles a cause takes most of what it does. Where one that is no effect of the catalogue leaves much less than
the best that is, that effect is not what is missing, however much it takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fit_result import FitResult
from .held_out import HeldOut, p_value
from .inverse import Observation, mean_torque, second_difference
from .judgement import FALSE_DISCOVERY_RATE, MUCH_LESS, Trial, floor_of
from .linear_model import LinearModel
from .plant import Plant
from .refine import refine
from .tall import gram

Array = NDArray[np.float64]

_HARMONICS = np.arange(1, 5)  # of an inertia
_ROUNDS = 3  # of strengths beside a fit, and the fit beside them
_KNOTS = np.array([0.25, 0.5, 0.75, 1.0])  # of the largest torque, between which a torque constant goes in lines
_LEAST, _MOST = 0.01, 0.95  # of the inertia, or of the torque constant, that are missing somewhere


class Hint(NamedTuple):
    """What explains more than anything in the catalogue.

    Attributes:
        said: a clause on it.
        experiment: that shows whether it does.
        left: squared residual that it leaves of blocks not seen [N^2 m^2]; inf where that is not known.
    """

    said: str
    experiment: str
    left: float = math.inf


class _Torques(NamedTuple):
    """What a cause with several strengths takes along a record, each at a strength of one.

    Attributes:
        inertia: (n, k) that is added to that of the axis [kg m^2].
        torque: (n, k) beside what that takes [N m].
    """

    inertia: Array
    torque: Array

    def band(self, o: Observation) -> Array:
        """(m, k) band-limited torque."""
        pull = second_difference(o.record.position, o.record.sample_time)[:, None]
        return o.band(self.inertia * pull + self.torque).T

    def beside(self, o: Observation, strength: Array) -> Observation:
        """The observation of an axis that the cause acts on, with some strengths (k,)."""
        added = {"inertia_change": self.inertia @ strength, "rigid_torque": self.torque @ strength}
        return o.with_signals({k: v + o.record.signals.get(k, 0.0) for k, v in added.items()})


class _Cause(NamedTuple):
    """A cause that no effect of the catalogue is.

    Attributes:
        kinds: of joints that it may be at work on.
        torques: along observations.
        missing: share of a plant's inertia or torque constant that strengths (k,) take away where they take most.
        say: what they are, and how large.
        experiment: that shows it.
        drives: whether it is what the drive delivers less; see `Misfit.delivered`.
    """

    kinds: tuple[str, ...]
    torques: Callable[[Sequence[Observation]], list[_Torques]]
    missing: Callable[[Plant, Array], float]
    say: Callable[[Plant, Array], str]
    experiment: str
    drives: bool = False


def _of_revolution(seen: Sequence[Observation]) -> list[_Torques]:
    return [_along_revolution(o) for o in seen]


def _along_revolution(o: Observation) -> _Torques:
    """d/dt of dL/dv less dL/dq for a kinetic energy J(q) v^2 / 2: J a + J' v^2 / 2."""
    inertia = _waves(o.position)
    cosines, sines = np.split(inertia, 2, 1)
    slope = np.concatenate([-_HARMONICS * sines, _HARMONICS * cosines], 1)
    return _Torques(inertia, slope * o.velocity[:, None] ** 2 / 2)


def _waves(position: Array) -> Array:
    """(n, k) cosine and then sine of each harmonic over positions (n,)."""
    angles = np.multiply.outer(position, _HARMONICS)
    return np.concatenate([np.cos(angles), np.sin(angles)], 1)


def _turned(strength: Array) -> Array:
    """(720,) inertia over a revolution that strengths of its harmonics add [kg m^2]."""
    return _waves(np.linspace(0, 2 * np.pi, 720, endpoint=False)) @ strength


def _say_inertia(plant: Plant, strength: Array) -> str:
    size = np.hypot(*np.reshape(strength, (2, -1)))
    swing = np.ptp(_turned(strength)) / 2 / plant.driven_inertia
    return (f"an inertia that varies along the revolution, by {100 * swing:.2g} % to either side, most of it "
            f"{_HARMONICS[int(np.argmax(size))]} to a revolution")  # fmt: skip


def _of_torque(seen: Sequence[Observation]) -> list[_Torques]:
    """What a drive gives less, whose torque constant changes with the torque that is asked for."""
    most = max(float(np.abs(o.record.torque).max()) for o in seen)

    def one(o: Observation) -> _Torques:
        u = o.record.torque
        less = np.stack([mean_torque(o.record, u * np.minimum(np.abs(u) / most, knot)) for knot in _KNOTS], 1)
        return _Torques(np.zeros_like(less), less)

    return list(map(one, seen))


def _fallen(strength: Array) -> float:
    """Share of the torque constant that is gone at the largest torque."""
    return float(strength @ _KNOTS)


def _say_constant(plant: Plant, strength: Array) -> str:
    fallen = _fallen(strength)
    return (f"a torque constant that {'falls' if fallen > 0 else 'grows'} with the torque, by {100 * abs(fallen):.2g} "
            "% up to the largest")  # fmt: skip


def _delivered(seen: Sequence[Observation], torques: Sequence[_Torques], strength: Array) -> float:
    """Share of the variance of the torque that is left without what is taken from it."""
    asked = [o.record.torque for o in seen]
    left = sum(np.var(u - t.torque @ strength) for u, t in zip(asked, torques, strict=True))
    return float(np.clip(left / max(sum(map(np.var, asked)), 1e-300), 1e-9, 1.0))


_CAUSES = (
    _Cause(
        ("hinge",), _of_revolution, lambda plant, s: float(-_turned(s).min() / plant.driven_inertia), _say_inertia,
        "The same short push, from rest, at several places of the revolution: where an inertia is larger the axis "
        "comes to a lower speed.",
    ),
    _Cause(
        ("hinge", "slide"), _of_torque, lambda plant, s: abs(_fallen(s)), _say_constant,
        "Known loads, as weights on a lever, held at rest over the whole range of the torque.",
        drives=True,
    ),
)  # fmt: skip


def beyond(now: FitResult, before: HeldOut, best: Trial) -> Hint | None:
    """What is in no catalogue and leaves much less than the best fit with an effect more; None where nothing does.

    Args:
        now, before: a fit to records, and what it leaves of each block by a fit without it.
        best: with an effect more.
    """
    seen = [o for o in now.misfit.observations if isinstance(o, Observation)]
    for cause in (c for c in _CAUSES if now.plant.kind in c.kinds):
        torques = cause.torques(seen)
        bands = np.concatenate([t.band(o) for t, o in zip(torques, seen, strict=True)])
        strength, result, total = np.zeros(bands.shape[1]), now, math.inf
        for k in range(_ROUNDS):
            if k:
                beside = [t.beside(o, strength) for t, o in zip(torques, seen, strict=True)]
                result = refine(*now.misfit.onto(result.plant, result.vector, beside))
            misfit, x = result.misfit, result.vector
            model = LinearModel(misfit, x, misfit.residual(x))
            columns = bands * model.determined[:, None]
            free = model.without(columns)
            strength = strength + np.linalg.lstsq(gram(free, free), gram(free, model.target))[0]
            if not _LEAST < cause.missing(result.plant, strength) < _MOST:
                break
            delivered = misfit.delivered(x) * (_delivered(seen, torques, strength) if cause.drives else 1.0)
            left = HeldOut(model.held_out(columns) / math.sqrt(delivered), seen)
            if left.total > min(best.held_out.total, total):
                break
            total = left.total
            floor = min(floor_of(result), floor_of(best.result))
            much_less = left.total - floor < MUCH_LESS * (best.held_out.total - floor)
            if much_less and p_value(best.held_out, left) <= FALSE_DISCOVERY_RATE:
                share = 100 * (1 - left.total / before.total)
                said = f"{cause.say(result.plant, strength)}, explains more than any effect ({share:.0f} %)"
                return Hint(said, cause.experiment, left.total)
    return None
