"""Trials beside each other."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bench import HEALTHY

from gms_mujoco import effects
from gms_mujoco.diagnosis.trials import beside_load
from gms_mujoco.effect import Effect


@pytest.mark.parametrize(("travel", "loaded", "kept"), [(3.0, 1.3, False), (3.0, 5.0, True), (9.0, 1.3, True)])
def test_friction_over_a_part_of_a_wave_gives_way_to_what_a_load_does(
    travel: float, loaded: float, kept: bool
) -> None:
    """As on a robot, whose links load a joint by where they stand."""
    seen: Any = [SimpleNamespace(position=np.linspace(0, travel, 9))]
    uneven = effects.PositionDependentFriction(harmonics=[1], amplitude=[0.2], phase=[0.3])
    heavy = effects.LoadDependentFriction(coefficient=0.1)

    def trial(effect: Effect, total: float) -> Any:
        result = SimpleNamespace(plant=HEALTHY + effect)
        return SimpleNamespace(name=effect.name, result=result, held_out=SimpleNamespace(total=total))

    both = [trial(uneven, 1.0), trial(heavy, loaded)]
    assert beside_load(both[:1], seen) == both[:1]
    assert beside_load(both, seen) == (both if kept else both[1:])
