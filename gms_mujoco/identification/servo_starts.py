"""Where the fit of a servo that closes its own position loop starts: nothing of it need be known."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..effect import Effect
from ..errors import ModelError
from ..plant import Plant
from .servo_observation import ServoObservation

_RUNS = 8  # that choose among the guesses
_BEST = 5  # of them, no two with the same torque and friction, from which a fit starts
# Guesses, each over what follows from the runs.
_STALL_TORQUE = (2.0, 6.0, 20.0)  # over the largest torque of a payload
_INERTIA = (0.3, 1.5)  # over the least of a payload
_DUTY = (0.07, 0.25, 1.0)  # at the usual error of the position
_SPEED = (1.2, 2.0)  # of the motor without load, over the fastest motion
_FRICTION = (0.01, 0.03, 0.1)  # of the stall torque
_STRENGTHS = ("coulomb", "coefficient")  # begin at zero in a plant, and not in its fit


def untold(plant: Plant, observations: Sequence[object]) -> list[str]:
    """Parameters that these observations cannot tell from others: a fit leaves them as they are.

    While the bridge is on, the drag of the motor and that of the gear are one; only a phase without power tells them
    apart.
    """
    servos = [o for o in observations if isinstance(o, ServoObservation)]
    if not servos or "viscous" not in plant or any(np.any(o.run.powered < 0.5) for o in servos):
        return []
    return ["viscous.coefficient"]


def servo_starts(plant: Plant, observations: Sequence[ServoObservation]) -> list[Plant]:
    """Plants like `plant` with every parameter set, the few that simulate the runs best; itself where all are set.

    A hobby servo or a robot's: torques are guessed from the payloads, speeds from the motion, and the duty from how far
    the position stays behind the goal.

    Raises:
        ModelError: a parameter has no value, and nothing tells it.
    """
    if not plant.unset:
        return [plant]
    some = observations[:: -(-len(observations) // _RUNS)]
    weight = max(o.run.weight for o in observations)
    inertia = min(o.run.inertia for o in observations)
    fastest = float(np.quantile(np.abs(np.concatenate([o.velocity for o in observations])), 0.99)) or 1.0
    behind = [o.run.gain * float(np.sqrt(np.mean((o.run.goal - o.run.position) ** 2))) for o in observations]
    usual = float(np.median(behind)) or 1.0
    unseen = untold(plant, observations)
    found: dict[tuple[float, float], tuple[float, Plant]] = {}
    for torque, light, duty, speed, dry in itertools.product(_STALL_TORQUE, _INERTIA, _DUTY, _SPEED, _FRICTION):
        stall = torque * weight
        guess = {
            "stall_torque": stall, "electrical_drag": stall / (speed * fastest), "duty_per_rad": duty / usual,
            "goal_speed": 1.1 * fastest, "coulomb": dry * stall, "coefficient": dry * stall / fastest,
        }  # fmt: skip
        trial = replace(
            plant,
            inertia=light * inertia if plant.inertia is None else plant.inertia,
            effects=tuple(_filled(e, guess, unseen) for e in plant.effects),
        )
        cost = sum(float(np.sum((o.applied(trial) - o.needed(trial)) ** 2)) for o in some)
        if cost < found.get((torque, dry), (np.inf, trial))[0]:
            found[torque, dry] = cost, trial
    return [trial for _, trial in sorted(found.values(), key=lambda t: t[0])[:_BEST]]


def _filled(effect: Effect, guess: dict[str, float], unseen: Sequence[str]) -> Effect:
    values: dict[str, Any] = {}
    for p in effect.parameters:
        if f"{effect.name}.{p.name}" in unseen:
            continue
        if p.name not in effect.unset and not (p.name in _STRENGTHS and not effect.values[p.name]):
            continue
        if p.name not in guess:
            raise ModelError(f"{effect.name}.{p.name} has no value, and runs of a servo do not say where to begin; "
                             "give it")
        values[p.name] = guess[p.name]
    return effect.replace(**values) if values else effect
