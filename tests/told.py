"""What a diagnosis tells, for the tests of the pages and recordings that show it."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gms_mujoco import effects
from gms_mujoco.compare import Comparison, compare
from gms_mujoco.comparison.score import TORQUE, Score
from gms_mujoco.dataset import load
from gms_mujoco.plant import Plant


@dataclass(frozen=True)
class Told:
    """What a diagnosis tells, without the search for it."""

    baseline: Plant
    plant: Plant
    comparisons: tuple[Comparison, ...]
    table: dict[str, Any]

    @property
    def score(self) -> Score:
        return TORQUE.of_kind(self.plant.kind)

    def to_dict(self) -> dict[str, Any]:
        return self.table


@functools.cache
def tell(small_set: Path) -> Told:
    """A set of `conftest.small_set` under a plant without and with its viscous friction."""
    runs = load(small_set)
    poor = Plant.axis(2.4e-5) + effects.find("coulomb")(coulomb=4e-3)
    rich = poor + effects.find("viscous")(coefficient=2e-5)
    comparisons = tuple(compare(p, runs.validate) for p in (poor, rich))
    errors = [c.torque_error for c in comparisons]
    table = {
        "schema": 1,
        "verdict": "partly_explained",
        "noise_floor": comparisons[0].noise_floor,
        "steps": [
            {"effect": None, "fit_error": errors[0], "validate_error": errors[0]},
            {
                "effect": "viscous",
                "fit_error": errors[1],
                "validate_error": errors[1],
                "confusable_with": ["quadratic_drag"],
                "parameters": {},
                "evidence": "The error <grows> with speed.",
            },
        ],
        "candidates": [{"effect": "gravity", "validate_error": None, "p_value": 0.4}],
        "next_experiment": "Run faster & longer.",
    }
    return Told(poor, rich, comparisons, table)
