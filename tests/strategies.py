"""Effects and plants with any values that they accept, for hypothesis to draw."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st

from gms_mujoco import effects
from gms_mujoco.effect import Effect, Parameter
from gms_mujoco.plant import Plant


def _value(draw: st.DrawFn, p: Parameter) -> float:
    if math.isinf(p.lower) or (p.lower < 0 < p.upper):
        return draw(st.floats(max(p.lower, -100), min(p.upper, 100), allow_subnormal=False))
    # On a logarithmic scale, as far as the bounds let it.
    low, high = math.log(max(p.lower, 1e-6)), math.log(min(p.upper, 1e4))
    return min(max(math.exp(draw(st.floats(low, max(low, high)))), p.lower), p.upper)


@st.composite
def some_effect(draw: st.DrawFn, name: str) -> Effect:
    """An effect with any values that it accepts."""
    kind = effects.find(name)
    n = draw(st.integers(1, 4)) if any(p.per_element for p in kind.parameters) else 1
    values: dict[str, object] = {}
    for p in kind.parameters:
        each = [_value(draw, p) for _ in range(n if p.per_element else 1)]
        if p.share:
            weight = np.array(draw(st.lists(st.floats(0.01, 1), min_size=n, max_size=n)))
            each = list(weight / weight.sum())
        if p.at_least:
            each = [v + float(values[p.at_least]) for v in each]  # type: ignore[arg-type]
        values[p.name] = each if p.per_element else each[0]
    return kind(**values)


@st.composite
def some_plant(draw: st.DrawFn, name: str, kinds: tuple[str, ...] = ("hinge",)) -> Plant:
    inertia = draw(st.floats(1e-6, 1e2))
    return Plant(inertia, (draw(some_effect(name)),), draw(st.sampled_from(kinds)), draw(st.booleans()))


every_effect = pytest.mark.parametrize("name", sorted(effects.CATALOGUE))
