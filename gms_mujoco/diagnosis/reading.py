"""A torque reading that rings: what an effect of the mechanism has to beat that rings itself.

A sensor between drive and axis swings on its own compliance: of a torque tau it shows u, with u'' / w^2 + 2 zeta / w u'
+ u = tau. Beside such a reading the axis looks as if a part of it swung. But friction comes through a sensor filtered
too, and through a coupling it does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..identification.held_out import HeldOut
from ..identification.inverse import Observation
from ..identification.least_squares import nudge
from ..identification.linear_model import LinearModel, cross_validated
from ..identification.misfit import Misfit
from ..identification.tall import gram, squared
from ..parameter import Parameter

Array = NDArray[np.float64]

_LAG, _PERIOD = 1e-4, 1e-3  # s, at which the slopes are taken
_LONGEST = 0.1  # s, of a period by 2 pi


class TorqueReading(Effect):
    """The torque behind a reading that rings, tau = u + b u' + u'' / w^2; no effect that could be added."""

    name = "torque_reading"
    kind = "drive"
    doc = "Second-order sensor of the torque."
    signature = "What is read rings after each step of the torque."
    experiment = (
        "A step of torque on the joint, locked behind the sensor: a sensor that swings rings there too, a part of the "
        "axis that swings does not."
    )
    parameters = (
        Parameter("lag", "s", 0.0, doc="b = 2 zeta / w"),
        Parameter("period", "s", 0.0, lower=0.0, upper=_LONGEST, doc="1 / w"),
    )

    def deliver(self, time: Array, command: Array) -> Array:
        if len(time) < 3:
            return command
        step = (time[-1] - time[0]) / (len(time) - 1)
        rate = np.gradient(command, step)
        lag, period = float(self.values["lag"]), float(self.values["period"])  # type: ignore[arg-type]
        return command + lag * rate + period**2 * np.gradient(rate, step)


def as_shown(reading: Effect, left: HeldOut) -> float:
    """Squared residual of what is read, given what is left of the torque behind a reading [N^2 m^2].

    That torque has noise that grows with the square of the frequency, and nothing of what was read at the sensor's own:
    there is no comparing it with what plants leave that take the reading for the torque.

    Args:
        reading: a TorqueReading.
        left: by a fit with it, of records.
    """
    lag, period = float(reading.values["lag"]), float(reading.values["period"])  # type: ignore[arg-type]
    ends = np.cumsum([len(o.index) for o in left.observations])[:-1]
    total = 0.0
    for o, rows in zip(left.observations, np.split(left.rows, ends), strict=True):
        assert isinstance(o, Observation)
        above, below = scipy.signal.bilinear([1.0], [period**2, max(lag, 0.0), 1.0], 1 / o.step)
        total += squared(scipy.signal.lfilter(above, below, rows))
    return total


def rung(misfit: Misfit, x: Array) -> tuple[Misfit, Array] | None:
    """The same plant, roughly fitted to the torque behind a reading that rings; None where it does not look like one.

    Args:
        misfit, x: a problem and its solution.
    """
    residual = misfit.residual(x)
    model = LinearModel(misfit, x, residual)
    trials = [_joined(misfit, x, TorqueReading(lag=_LAG)), _joined(misfit, x, TorqueReading(period=_PERIOD))]
    columns = np.stack([m.residual(there) - residual for m, there in trials], 1) * model.determined[:, None]
    free = model.without(columns)
    size = np.sqrt((free**2).sum(0)).clip(1e-300)
    lag, square = -np.linalg.lstsq(gram(free / size, free / size), gram(free / size, model.target))[0] / size
    if square <= 0:
        return None
    period = _PERIOD * math.sqrt(square)
    near, there = _joined(misfit, x, TorqueReading(lag=_LAG * lag, period=min(period, _LONGEST)))
    there = nudge(near, there)
    found = near.plant(there)[TorqueReading.name]
    return (near, there) if float(found.values["period"]) > 0 else None  # type: ignore[arg-type]


def ring(misfit: Misfit, x: Array, left: HeldOut, swinging: Sequence[HeldOut]) -> str:
    """How a reading rings that explains more than an axis of which a part swings; empty where none does.

    Args:
        misfit, x: a problem and its solution.
        left: what that leaves on held-out blocks.
        swinging: what is left there by fits with effects that swing.
    """
    reading = rung(misfit, x)
    if reading is None:
        return ""
    near, there = reading
    sensor, behind = near.plant(there)[TorqueReading.name], cross_validated(near, there)
    least = as_shown(sensor, replace(behind, rows=behind.rows * math.sqrt(near.delivered(there))))
    if least > min(h.total for h in swinging):
        return ""
    frequency = 1 / (2 * math.pi * float(sensor.values["period"]))  # type: ignore[arg-type]
    share = 1 - least / left.total
    return (
        f"a torque reading that rings at {frequency:.3g} Hz, as a sensor on its own compliance does "
        f"({100 * share:.0f} % of the square)"
    )


def _joined(misfit: Misfit, x: Array, effect: Effect) -> tuple[Misfit, Array]:
    return misfit.onto(misfit.plant(x) + effect, x)
