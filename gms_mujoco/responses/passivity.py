"""Can an axis answer a torque like that: a response whose sign, or that of its phase, is another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frf import FRF, OUTPUTS, Complex
from .resonance import COHERENT

Array = NDArray[np.float64]

_SIGN, _PHASE = "of a torque of the other sign", "of a response for exp(-i w t)"
_LEADS = 0.3  # sine of a phase, more than a measured one errs
_STRONGEST = 5  # points in quadrature, which all must lead: noise alone seldom makes that
_SURE = 2.0  # standard deviations
_CLEAR = 0.5  # of a phase that turns one way
_ALONG = 0.7  # cosine of a phase that stays with the torque, or against it
_DECADES = 0.5  # that a mass line has at least: over so many no delay keeps its phase


def expect_passive(frf: FRF, other_sign: str = "scale = -1", other_phase: str = "conjugate = true") -> FRF:
    """The response from torque, with a note where a point of it gives energy, as no axis with friction does.

    Args:
        frf: from torque or load.
        other_sign: what turns the sign of the torque.
        other_phase: what turns that of the phase.

    Raises:
        DataError: all of it says that its sign, or that of its phase, is another one.
    """
    position = frf.response / (1j * frf.omega) ** list(OUTPUTS).index(frf.output)
    most = position[np.abs(position.imag).argmax()]
    upright = _is_upright_mass(frf.frequency, position)
    if frf.output == "velocity" and _rises(frf, position):
        raise DataError(f"the phase rises through the resonance, as that of no passive axis does; {_PHASE} say "
                        f"{other_phase}")
    if not upright and most.imag <= _LEADS * abs(most):
        return frf
    if upright:
        raise DataError("the response falls like that of a mass, and goes along with the torque, not against it; "
                        f"{_SIGN} say {other_sign}")
    turn = _turn(position)
    ways = [f"{_SIGN} say {other_sign}"] if turn < _CLEAR else []
    ways += [f"{_PHASE} say {other_phase}"] if turn > -_CLEAR else []
    said = f"the motion leads the torque where it counts, as that of no passive axis does; {', '.join(ways)}"
    if _all_lead(frf, position):
        raise DataError(said)
    return replace(frf, notes=(*frf.notes, said))


def _turn(position: Complex) -> float:
    """From -1 for a phase that falls through resonances, as that of an axis does, to 1 for one that rises."""
    by = np.angle(position[1:] / position[:-1])
    weight = np.abs(position.imag[1:]) + np.abs(position.imag[:-1])  # little at an antiresonance, where it rises
    return float(weight @ by / max(float(weight @ np.abs(by)), 1e-300))


def _rises(frf: FRF, position: Complex) -> bool:
    """Whether a resonance goes from a mass below to a stiffness above: of a velocity the conjugate gives no energy."""
    row = np.sort(np.argsort(np.abs(position.imag))[-_STRONGEST:])
    if len(frf) < _STRONGEST or row[-1] - row[0] >= _STRONGEST or not _tells(frf, position)[row].all():
        return False
    along = position[row].real / np.abs(position[row])
    through = along[0] < -_LEADS and along[-1] > _LEADS and bool(np.all(np.diff(along) > 0))
    return through and bool(np.all(position[row].imag < 0))


def _all_lead(frf: FRF, position: Complex) -> bool:
    """Whether the points that are strongest in quadrature all lead the torque, beyond their noise."""
    strongest = np.argsort(np.abs(position.imag))[-_STRONGEST:]
    leads = _tells(frf, position) & (position.imag > 0)
    return len(frf) >= _STRONGEST and bool(leads[strongest].all())


def _tells(frf: FRF, position: Complex) -> NDArray[np.bool_]:
    """(n,) whether the part in quadrature is more than noise."""
    told = np.ones(len(frf), bool)
    if frf.sigma is not None:
        told &= np.abs(position.imag / position) * np.abs(frf.response) > _SURE * frf.sigma
    if frf.coherence is not None:
        told &= frf.coherence > COHERENT
    return told


def _is_upright_mass(frequency: Array, position: Complex) -> bool:
    """Whether it falls like a mass line and moves with the torque all along, which a mass never does."""
    decades = np.log10(frequency / frequency[0])
    if len(frequency) < _STRONGEST or decades[-1] < _DECADES:
        return False
    slope = np.polyfit(decades, np.log10(np.abs(position)), 1)[0]
    cosine = position.real / np.abs(position)
    return bool(abs(slope + 2) < 0.5 and np.mean(cosine > _ALONG) > 0.9)
