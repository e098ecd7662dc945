"""What a fit could not tell from its data, and which experiment would."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from . import effects
from .frf_observation import Seen
from .plant import Plant

_UNKNOWN = 10.0  # an interval whose ends differ by this factor says nothing
_SHARE = 0.02  # of the stiffness of all elements, above which one that never slips is worth a word
_EXPERIMENTS = {
    "gms.stiffness": "sines or reversals at amplitudes from well below to well above the break-away distances",
    "gms.fraction": "sines or reversals at more amplitudes, closer together",
    "gms.coulomb": "sliding well beyond the Stribeck velocity",
    "gms.static": "slow sliding, or sines large enough for all elements to slip",
    "gms.stribeck_velocity": "constant-velocity runs, or large sines, from well below to well above the velocity at "
    "which friction weakens",
    "gms.attraction": "transients while sliding: changes of speed and reversals at speed",
    "inertia": "higher frequencies, where the response follows its mass line",
}


def undetermined(plant: Plant) -> dict[str, str]:
    """Parameters that the data of a fit could not tell, by name, with the experiment that would.

    Those whose 95 % interval spans more than a factor of ten, a share that may be anything, and a static level that
    may be the Coulomb level or twice it. An interval that is all that the parameter may be, as [0, inf], stands for one
    of which nothing is known.
    """
    out: dict[str, str] = {}
    drags = "position_loop" in plant and "viscous" in plant
    if plant.uncertainty and drags and "viscous.coefficient" not in plant.uncertainty:  # see `untold`
        out["viscous.coefficient"] = (
            "runs in which the power goes off while the servo moves; until then it is part of "
            "position_loop.electrical_drag"
        )
    numbers = plant.numbers()
    for name, (low, high) in plant.uncertainty.items():
        value = numbers[name][0]
        if not math.isfinite(high - low):
            vague = True
        elif name.startswith("gms.fraction"):
            vague = high - low > 0.5
        elif low > 0:
            vague = high > _UNKNOWN * low
        else:
            vague = not high - low < 1e3 * abs(value) and value != 0
        if vague:
            effect, _, _ = name.partition(".")
            general = _EXPERIMENTS.get(name.split("[")[0]) or effects.find(effect).experiment.rstrip(".")
            out[name] = general[:1].lower() + general[1:]
    return out


def never_slips(plant: Plant, observations: Sequence[Seen]) -> str:
    """A sentence where friction elements did not slip in any of the data, and so are not told from a spring; else "".

    Args:
        plant: every parameter set.
        observations: what it was fitted to.
    """
    if "gms" not in plant:
        return ""
    gms = plant["gms"]
    stiffness = np.asarray(gms.stiffness)
    reach = max(float(np.ptp(o.position)) for o in observations) / 2
    stuck = np.asarray(gms.fraction) * max(gms.static, gms.coulomb) > reach * stiffness
    held = float(stiffness[stuck].sum())
    if not held > _SHARE * stiffness.sum():
        return ""
    unit, size = ("N m/rad", "rad") if plant.kind == "hinge" else ("N/m", "m")
    also = "the spring" if "spring" in plant else "a spring, or gravity about its rest,"
    return (
        f"A stiffness of {held:.3g} {unit} in gms did not slip up to {reach:.3g} {size}: these data cannot tell it "
        f"from {also} of that stiffness. Slow motion to several times that amplitude would: friction then slips "
        "and does not return, a spring pulls back in proportion."
    )
