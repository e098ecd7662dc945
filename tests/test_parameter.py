"""The declaration of a parameter."""

import pytest

from gms_mujoco.errors import ModelError
from gms_mujoco.parameter import Parameter


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("share", 0.0, "1"), "parameter 'share': unit must be text; 0.0 given, and the order is name, unit, default"),
        (("share", "1", "0"), "default must be a number; '0' given"),
        (("share", "1", 0.0, None), "lower must be a number; None given"),
        ((1.0, "share"), "name must be text; 1.0 given"),
    ],
)
def test_another_order_is_told(given: tuple, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Parameter(*given)
