"""Error of an encoder whose disc does not sit centred on the shaft."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect
from ..parameter import Parameter


class EncoderEccentricity(Effect):
    """Encoder that reads q + A sin(q + phi) where the joint is at q."""

    name = "encoder_eccentricity"
    kind = "sensor"
    doc = (
        "Encoder disc off centre: it reads q + A sin(q + phi), with A = eccentricity over disc radius. At speed v\n"
        "the speed of the reading swings by A v, which looks like a torque J A v^2 once per revolution.\n"
        "It acts on the measurement alone: inside MuJoCo, where positions are exact, it is left out.\n"
        "Source: eccentricity error of encoders, e.g. Merry, van de Molengraft and Steinbuch, Mechatronics 23 (2013)."
    )
    signature = (
        "The torque error is a sine once per revolution whose height grows with the square of velocity; an inertia "
        "that changes over the revolution, as of a crank or a linkage, gives half as much."
    )
    experiment = "Constant-velocity runs over many revolutions at several speeds, the highest included."
    parameters = (
        # Up to the upper bound the reading still rises with the position everywhere.
        Parameter("amplitude", "rad", 0.0, lower=0.0, upper=0.5, doc="A"),
        Parameter("phase", "rad", 0.0, doc="phi, at position zero"),
    )

    def read(self, time: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the encoder reads."""
        amplitude, phase = self._numbers
        return position + amplitude * np.sin(position + phase)

    def correct(self, time: NDArray[np.float64], reading: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the joint is, by Newton's method."""
        amplitude, phase = self._numbers
        position = reading
        for _ in range(50):
            excess = position + amplitude * np.sin(position + phase) - reading
            position = position - excess / (1 + amplitude * np.cos(position + phase))
            if np.abs(excess).max(initial=0.0) < 1e-14:
                break
        return position

    @property
    def _numbers(self) -> tuple[float, float]:
        return float(self.values["amplitude"]), float(self.values["phase"])  # type: ignore[arg-type]
