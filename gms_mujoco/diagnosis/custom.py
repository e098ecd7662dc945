"""A Python function as a candidate: the shape of a torque that somebody suspects, scored like an effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..identification.frf_observation import Seen
from ..identification.inverse import Observation
from ..plant import Plant

Array = NDArray[np.float64]

# From time [s], position [rad] and velocity [rad/s], (n,) each, to the shape (n,) of a torque on the joint. Its
# strength is found, so its unit does not matter.
Shape = Callable[[Array, Array, Array], Array]


def name_of(shape: Shape) -> str:
    """What a candidate is called in a report: the name of the function."""
    return str(getattr(shape, "__name__", type(shape).__name__))


def column(shape: Shape, observations: Sequence[Seen], plant: Plant) -> Array:
    """(m,) band-limited torque of the shape along the motion of all observations; 0 in frequency responses.

    Args:
        plant: whose sensor effects say where the joint was.

    Raises:
        DataError: the function gives something else than one finite number per sample.
    """
    parts = []
    for o in observations:
        if not isinstance(o, Observation):
            parts.append(np.zeros(len(o.index)))
            continue
        seen, time = o.seen_by(plant), o.record.time
        given = shape(time.copy(), seen.position.copy(), seen.velocity.copy())
        try:
            torque = np.asarray(given, float)
        except (TypeError, ValueError):
            raise DataError(f"candidate {name_of(shape)} must give numbers; {given!r} given") from None
        if torque.shape != time.shape:
            raise DataError(
                f"candidate {name_of(shape)} must give one torque per sample, shape {time.shape}; {torque.shape} given"
            )
        bad = np.flatnonzero(~np.isfinite(torque))
        if len(bad):
            raise DataError(
                f"candidate {name_of(shape)} is not a finite number at sample {bad[0]} of {o.record.name} "
                f"({len(bad)} such)"
            )
        parts.append(o.band(torque))
    return np.concatenate(parts)
