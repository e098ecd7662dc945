"""What an error is of, and how it is told."""

import numpy as np
import pytest

from gms_mujoco.comparison.score import FORCE, POSITION, TORQUE, above_floor


def test_a_torque_error_is_relative_and_a_position_error_is_in_radians() -> None:
    left, measured = [np.array([0.1, -0.1]), np.array([0.3, 0.3])], [np.ones(2), np.ones(2)]
    assert TORQUE.pooled(left, measured) == pytest.approx(np.sqrt((0.01 + 0.09) / 2))
    assert POSITION.pooled(left, measured) == pytest.approx(0.2)  # records of equal weight, whatever their size


def test_an_error_is_told_with_its_unit() -> None:
    assert (TORQUE.told(0.0123), POSITION.told(0.0123)) == ("1.23 %", "12.3 mrad")
    assert (TORQUE.told(None), POSITION.told(None)) == ("-", "-")
    assert (TORQUE.column(0.0123), POSITION.column(0.0123), POSITION.column(None)) == ("1.23", "12.30", "-")
    assert "%" in TORQUE.head and "[mrad]" in POSITION.head
    assert [s.name for s in (TORQUE, FORCE, POSITION)] == ["torque error", "force error", "position error"]
    assert TORQUE.of_kind("slide") is FORCE and FORCE.of == "torque"  # files have one name for both
    assert TORQUE.of_kind("hinge") is TORQUE and POSITION.of_kind("slide") is POSITION


def test_an_error_is_told_above_its_floor_by_one_rule() -> None:
    assert above_floor(1.2, 1.0) == above_floor(0.0, 0.0) == ""
    assert above_floor(0.13, 0.1) == "1.3 times the noise floor"
    assert above_floor(0.1, 0.0) == "above the noise floor"
