"""What a fit could not tell from its data, and which experiment would."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..effect import Effect
from ..plant import Plant
from .frf_observation import FrfObservation, Seen
from .inverse import Observation

TELLS = "; what would tell it: "  # between a parameter and its experiment in a provenance
_UNKNOWN = 10.0  # an interval whose ends differ by this factor says nothing
_SHARE = 0.02  # of the stiffness of all elements, above which one that never slips is worth a word
_BARELY = 0.9  # of the largest motion: an element that slips only beyond shows no level of its own
_SLIDES = 5.0  # times as far as friction bends, that a record goes which slides
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
    reach = max(float(np.ptp(o.position)) for o in observations) / 2
    stuck = _stuck(gms, reach)
    if not stuck.any():
        return ""
    held = float(np.asarray(gms.stiffness)[stuck].sum())
    unit, size = ("N m/rad", "rad") if plant.kind == "hinge" else ("N/m", "m")
    also = "the spring" if "spring" in plant else "a spring, or gravity about its rest,"
    return (
        f"A stiffness of {held:.3g} {unit} in gms did not slip up to {reach:.3g} {size}: these data cannot tell it "
        f"from {also} of that stiffness. Slow motion to several times that amplitude would: friction then slips "
        "and does not return, a spring pulls back in proportion."
    )


def hardly_slides(plant: Plant, observations: Sequence[Seen]) -> str:
    """A sentence where no record goes much further than friction takes to give way, so that its level, and how it
    weakens, are those of pre-sliding; else "".

    Args:
        plant: every parameter set.
        observations: what it was fitted to.
    """
    runs = [o for o in observations if isinstance(o, Observation)]
    law = next((e for e in plant.effects if "stiffness" in e.values and "coulomb" in e.values), None)
    if law is None or len(runs) < len(observations):
        return ""
    level = float(np.max([law.coulomb, law.values.get("static", 0.0)]))
    bends, goes = level / float(np.sum(law.stiffness)), max(float(np.ptp(o.position)) for o in runs)
    if goes > _SLIDES * bends or bends <= 0:
        return ""
    unit = "rad" if plant.kind == "hinge" else "m"
    return (
        f"No record slides: the longest way is {goes:.2g} {unit}, and friction bends by {bends:.2g} {unit} before it "
        "gives way. Its level and how it weakens with speed are guesses from that; one record that slides tells them"
    )


def stuck_within(gms: Effect, reach: float) -> NDArray[np.bool_]:
    """(m,) elements whose break-away distance is beyond `reach` [rad]."""
    return np.asarray(gms.fraction) * max(gms.static, gms.coulomb) > reach * np.asarray(gms.stiffness)


def _stuck(gms: Effect, reach: float) -> NDArray[np.bool_]:
    """(m,) the same; none where they hardly matter."""
    stiffness, stuck = np.asarray(gms.stiffness), stuck_within(gms, reach)
    return stuck & bool(stiffness[stuck].sum() > _SHARE * stiffness.sum())


def left_open(plant: Plant, observations: Sequence[Seen]) -> dict[str, tuple[float, float]]:
    """Intervals of levels and shares where friction elements slipped in none of the data, or barely.

    Those then know what such an element carried at most, a lower bound of its level; the local expansion that other
    intervals come from does not see that. A sine of amplitude A makes those slip whose break-away distance is less; in
    a record it may be as long as the way from end to end.

    Args:
        plant: a fitted one, with its other intervals.
        observations: what it was fitted to.
    """
    if "gms" not in plant:
        return {}
    gms, known = plant["gms"], plant.uncertainty
    reach = max(float(np.ptp(o.position)) / (2 if isinstance(o, FrfObservation) else 1) for o in observations)
    stuck = _stuck(gms, _BARELY * reach)
    if not stuck.any():
        return {}
    level = float(np.max([gms.static, gms.coulomb]))
    least = np.where(stuck, _BARELY * reach * np.asarray(gms.stiffness), np.asarray(gms.fraction) * level)  # [N m]
    total = float(least.sum())
    out = {}
    for name in ("gms.coulomb", "gms.static"):
        if name in known:
            out[name] = min(known[name][0], plant.numbers()[name][0] * total / level), math.inf
    for i, carried in enumerate(least / total):
        if (name := f"gms.fraction[{i}]") in known:
            low, high = known[name]
            out[name] = (min(low, carried), 1.0) if stuck[i] else (0.0, max(high, carried))
    return {k: (float(low), float(high)) for k, (low, high) in out.items()}


def by_experiment(found: Mapping[str, str]) -> list[tuple[str, str]]:
    """What a fit could not tell, a line for each experiment that would: the names together, and the experiment.

    Args:
        found: experiment by name, as `undetermined` gives them.
    """
    names: dict[str, list[str]] = {}
    for name, experiment in found.items():
        stem, bracket, place = name.partition("[")
        group = names.setdefault(experiment, [])
        if bracket and group and group[-1].startswith(f"{stem}["):
            group[-1] = f"{group[-1][:-1]}, {place}"  # "gms.fraction[0, 3]"
        else:
            group.append(name)
    return [(", ".join(group), experiment) for experiment, group in names.items()]
