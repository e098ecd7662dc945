"""A Python function as a candidate: the shape of a torque that somebody suspects, scored like an effect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..compare import Comparison
from ..comparison.score import relative_error
from ..errors import DataError
from ..fit_result import FitResult
from ..frf import FRF
from ..identification.frf_observation import FrfObservation, Seen
from ..identification.held_out import p_value
from ..identification.inverse import Observation
from ..identification.screen import Screen
from ..plant import Plant
from ..record import Record
from ..responses.harmonics import motion

Array = NDArray[np.float64]

# From time [s], position [rad] and velocity [rad/s], (n,) each, to the shape (n,) of a torque on the joint. Its
# strength is found, so its unit does not matter.
Shape = Callable[[Array, Array, Array], Array]
Shapes = Sequence[Shape] | Mapping[str, Shape]

_EXPECTED = "a function (time, position, velocity) -> torque, arrays of one value per sample"


class Scored(NamedTuple):
    """A candidate of the user's on the final plant.

    Attributes:
        name: in reports.
        gain: share of the squared residual that it takes.
        p_value: how easily chance alone would take as much on held-out blocks.
        error: of the validate records with it; None where there are none.
    """

    name: str
    gain: float
    p_value: float
    error: float | None

    @property
    def said(self) -> str:
        """A line on it."""
        share = f"{100 * self.gain:.0f} % of the squared error"
        return f"{self.name}: takes {share} (p = {self.p_value:.1g} on held-out blocks)"


def named(shapes: Shapes) -> dict[str, Shape]:
    """Candidates by what they are called in a report: as given, or by the name of the function, lambdas numbered.

    Raises:
        DataError: they are neither a list nor a mapping of functions, or two have one name, or one that of an effect.
    """
    if isinstance(shapes, str) or not isinstance(shapes, Iterable):
        raise DataError(f"candidates are given as a list, as in [function]; {_told(shapes)} given")
    if isinstance(shapes, Mapping):
        pairs = [(str(name), shape) for name, shape in shapes.items()]
    else:
        pairs = [(_name(shape, i), shape) for i, shape in enumerate(shapes, 1)]
    for name, shape in pairs:
        if isinstance(shape, type) or not callable(shape):
            raise DataError(f"a candidate is {_EXPECTED}; {_told(shape)} among them")
        if name in effects.CATALOGUE or sum(name == other for other, _ in pairs) > 1:
            whose = "an effect of the catalogue" if name in effects.CATALOGUE else "another candidate"
            raise DataError(f'candidate {name} is called as {whose} is; give names, as in {{"my {name}": function}}')
    return dict(pairs)


def _name(shape: object, number: int) -> str:
    name = str(getattr(shape, "__name__", type(shape).__name__))
    return f"lambda {number}" if name == "<lambda>" else name


def _told(value: object) -> str:
    """What something is, for a message."""
    if isinstance(value, str | int | float):
        return repr(value)
    return str(getattr(value, "__name__", type(value).__name__))


def expect_torques(shapes: Mapping[str, Shape], data: Sequence[object]) -> None:
    """One call of each candidate along a measured motion, before a search that takes long.

    Raises:
        DataError: as of `column`, or it follows time, and there are frequency responses alone.
    """
    record = next((d for d in data if isinstance(d, Record)), None)
    frf = next((d for d in data if isinstance(d, FRF)), None)
    for name, shape in shapes.items():
        if record is not None:
            speed = np.gradient(record.position, record.time)
            _torque(name, shape, record.time, record.position, speed, record.name)
        elif frf is not None:
            size = np.ones(1) if frf.amplitude is None else frf.amplitude[:1]
            [position], [velocity] = motion(size, frf.omega[:1])
            if not _steady(name, shape, frf.name, position, velocity).any():
                raise DataError(f"candidate {name} gives no torque along {frf.name}: in a frequency response time is "
                                "NaN and the position goes to and fro about 0; fit a record too")


def column(name: str, shape: Shape, observations: Sequence[Seen], plant: Plant) -> Array:
    """(m,) rows of the torque of a shape along the motion of all observations.

    Of a frequency response that is the first harmonic along its steady motion about 0. Its time is not known, and NaN:
    what follows that is no part of it.

    Args:
        plant: whose sensor effects say where the joint was.

    Raises:
        DataError: the function cannot be called, or gives something else than one finite real number per sample.
    """
    parts = []
    for o in observations:
        if isinstance(o, Observation):
            seen = o.seen_by(plant)
            parts.append(o.band(_torque(name, shape, o.record.time, seen.position, seen.velocity, o.name)))
        else:
            assert isinstance(o, FrfObservation)
            parts.append(o.along(plant, partial(_steady, name, shape, o.name)))
    return np.concatenate(parts)


def scored(
    shapes: Mapping[str, Shape], last: FitResult, validate: Sequence[Seen], comparison: Comparison | None
) -> list[Scored]:
    """Candidates on a final plant, each in a joint linear refit of its strength and the plant.

    Args:
        validate, comparison: what decided nothing, and what the plant leaves of it; None where there is none.
    """
    screen, out = Screen(last.misfit, last.vector), []
    for name, shape in shapes.items():
        gain, strength, held_out = screen.shape(column(name, shape, last.misfit.observations, last.plant))
        error = None
        if comparison:
            rows = comparison.rows
            own = strength * column(name, shape, validate, last.plant)
            parts = np.split(own, np.cumsum([len(r.residual) for r in rows])[:-1])
            left = [r.residual + part for r, part in zip(rows, parts, strict=True)]
            error = relative_error(left, [r.measured for r in rows])
        out.append(Scored(name, gain, p_value(screen.held_out, held_out), error))
    return out


def _steady(name: str, shape: Shape, where: str, position: Array, velocity: Array) -> Array:
    """(n,) torque along one period of a motion that repeats, as the second turn leaves it; 0 where it follows time."""
    n = len(position)
    there = np.tile(position, 2), np.tile(velocity, 2)
    return _torque(name, shape, np.full(2 * n, np.nan), *there, where)[n:]


def _torque(name: str, shape: Shape, time: Array, position: Array, velocity: Array, where: str) -> Array:
    """(n,) what a candidate gives along a motion; see `column`."""
    try:
        given = shape(time.copy(), position.copy(), velocity.copy())
    except Exception as error:  # whatever stands in it
        told = f"{type(error).__name__} ({' '.join(str(error).split())})"
        raise DataError(f"candidate {name} ends in {told} on {where}; expected is {_EXPECTED}") from error
    if np.iscomplexobj(given):
        raise DataError(f"candidate {name} must give real numbers; complex ones given")
    try:
        torque = np.asarray(given, float)
    except (TypeError, ValueError):
        raise DataError(f"candidate {name} must give numbers; {_told(given)} given") from None
    if torque.shape != time.shape:
        raise DataError(f"candidate {name} must give one torque per sample, shape {time.shape}; {torque.shape} given")
    if np.isnan(time).any() and np.isnan(torque).any():
        return np.zeros(len(time))
    bad = np.flatnonzero(~np.isfinite(torque))
    if len(bad):
        raise DataError(f"candidate {name} is not a finite number at sample {bad[0]} of {where} ({len(bad)} such)")
    return torque
