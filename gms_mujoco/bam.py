"""Plants from parameter files of Rhoban's BAM (Better Actuator Models).

BAM bounds the friction torque of a servo, on top of the viscous drag b |v|, by one of six laws, with the torques
t_m of the motor and t_e of everything else on the gearbox, and s(v) = exp(-|v/v_s|^alpha):

    M1  K_c
    M2  K_c + s K_cs
    M3  K_c + K_l |t_e - t_m|
    M4  K_c + K_l |t_e - t_m| + s (K_cs + K_ls |t_e - t_m|)
    M5  K_c + |K_e t_e - K_m t_m| + s (K_cs + |K_es t_e - K_ms t_m|)
    M6  M5 + s Q, Q quadratic in the smaller of t_e and t_m where they oppose each other

Our level is (Fc + (Fs - Fc) s) (1 + c |L|), L being the torque that the joint transmits: M1 and M2 are `coulomb` and
`stribeck` exactly. In balance t_e = -t_m, so that |t_e - t_m| is 2 |L|: M3 is `load_dependent_friction` of
c = 2 K_l / K_c, and M4 with K_ls / K_cs = K_l / K_c likewise; away from balance BAM's load has inertia torque and
friction in it that L has not. Other load terms, those of M5 and M6 included, no effect expresses: they are left out
and named.

Source: Duclusaud, Passault, Padois and Ly, Extended friction models for the physics simulation of servo actuators,
arXiv 2410.08650 (2024).
"""

from __future__ import annotations

import json
import math
import os
import warnings
from pathlib import Path
from typing import Any

from . import effects
from .errors import ModelError, listing
from .plant import Plant
from .version import __version__

LAWS = ("m1", "m2", "m3", "m4", "m5", "m6")
_ALIKE = 1e-6  # relative difference of two ratios that are one
_LOAD = {
    "m3": ("load_friction_base",),
    "m4": ("load_friction_base", "load_friction_stribeck"),
    "m5": (
        "load_friction_motor", "load_friction_external", "load_friction_motor_stribeck",
        "load_friction_external_stribeck",
    ),
}  # fmt: skip
_LOAD["m6"] = (*_LOAD["m5"], "load_friction_motor_quad", "load_friction_external_quad")
_MOTOR = ("kt", "R", "q_offset", "max_velocity", "error_gain_ratio", "current_limit")


def read_plant(path: str | os.PathLike[str]) -> Plant:
    """A plant from a parameter file of BAM: JSON as in its params/SERVO/m1.json to m6.json.

    The inertia is the `armature` of the servo, without what hangs on it; `command_delay` becomes `delay`. Motor and
    rig parameters (kt [N m/A], R [ohm], offsets, limits) stand in the provenance.

    Returns:
        Plant, with `left_out` in its provenance, and a warning, where a term of the law cannot be expressed.

    Raises:
        ModelError: not such a file, a parameter of the law is missing or not a number that it may be.
    """
    path = Path(path)
    try:
        table = json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise ModelError(f"{path}: no such file") from None
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(f"{path}: not a readable JSON file ({error})") from None
    if not isinstance(table, dict) or table.get("model") not in LAWS:
        given = table.get("model") if isinstance(table, dict) else type(table).__name__
        raise ModelError(f"{path}: model must be one of {listing(LAWS)}, as BAM writes it; {given!r} given")
    try:
        return _plant(path.name, table)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None


def _number(table: dict[str, Any], key: str, least: float = 0.0) -> float:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < math.inf:
        raise ModelError(f"{key} must be a number of at least {least:g}; {value!r} given")
    return float(value)


def _plant(name: str, table: dict[str, Any]) -> Plant:
    law = table["model"]
    base = _number(table, "friction_base")
    plant = Plant.axis(_number(table, "armature", 1e-12))
    weakens = 0.0
    if law in ("m1", "m3"):
        plant = plant + effects.find("coulomb")(coulomb=base)
    else:
        weakens = _number(table, "friction_stribeck")
        plant = plant + effects.find("stribeck")(
            coulomb=base, static=base + weakens, stribeck_velocity=_number(table, "dtheta_stribeck"),
            stribeck_exponent=_number(table, "alpha"),
        )  # fmt: skip
    plant = plant + effects.find("viscous")(coefficient=_number(table, "friction_viscous"))
    loads = {key: _number(table, key) for key in _LOAD.get(law, ())}
    left_out = []
    if any(loads.values()):
        coefficient = _coefficient(law, base, weakens, loads)
        if coefficient is None:
            terms = ", ".join(f"{k} {v:.3g}" for k, v in loads.items() if v)
            left_out.append(f"load terms of {law} that no effect expresses are left out: {terms}")
        else:
            plant = plant + effects.find("load_dependent_friction")(coefficient=coefficient)
    if table.get("command_delay"):
        plant = plant + effects.find("delay")(time=_number(table, "command_delay"))
    told: dict[str, Any] = {
        "source": f"{name}, parameters of BAM ({law}, actuator {table.get('actuator', 'not said')})",
        "version": f"gms_mujoco {__version__}",
    }
    told |= {f"bam_{k}": table[k] for k in _MOTOR if isinstance(table.get(k), int | float)}
    for line in left_out:
        warnings.warn(f"{name}: {line}", stacklevel=5)
    if left_out:
        told["left_out"] = left_out
    return Plant(plant.inertia, plant.effects, provenance=told)


def _coefficient(law: str, base: float, weakens: float, loads: dict[str, float]) -> float | None:
    """c of load_dependent_friction [1/(N m)]; None where the law is another."""
    if law not in ("m3", "m4"):
        return None
    sliding, more = loads["load_friction_base"], loads.get("load_friction_stribeck", 0.0)
    if base + weakens <= 0 or abs(sliding * weakens - more * base) > _ALIKE * (sliding + more) * (base + weakens):
        return None
    return 2 * (sliding + more) / (base + weakens)
