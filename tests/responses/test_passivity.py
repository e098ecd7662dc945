"""A response of the other sign is refused, and one that only some points speak against is told so."""

from dataclasses import replace

import numpy as np
import pytest

from gms_mujoco.errors import DataError
from gms_mujoco.frf import FRF
from gms_mujoco.responses.passivity import expect_passive

F = np.geomspace(2, 200, 30)
W = 2 * np.pi * F
AXIS = FRF("axis", F, 1 / (0.5 + 1e-3j * W - 2.4e-5 * W**2))
MASS = FRF("mass", F, -1 / (2.4e-5 * W**2) * np.exp(-0.01j))
COUPLED = FRF("coupled", F, 1 / (0.5 + 1e-3j * W - 1e-5 * W**2 - 2.4e-5 * W**2 / (1 - (W / 300) ** 2 + 1e-4j * W)))


@pytest.mark.parametrize("frf", [AXIS, MASS, COUPLED], ids=lambda f: f.name)
def test_an_axis_is_passive_and_its_opposite_is_not(frf: FRF) -> None:
    for late in (0.0, 2e-4, 1e-3):  # s, of a drive
        assert expect_passive(replace(frf, response=frf.response * np.exp(-1j * W * late))).notes == ()
    with pytest.raises(DataError, match="scale = -1"):
        expect_passive(replace(frf, response=-frf.response))


@pytest.mark.parametrize("frf", [AXIS, COUPLED], ids=lambda f: f.name)
def test_what_turns_the_phase_is_told_from_what_turns_the_sign(frf: FRF) -> None:
    with pytest.raises(DataError) as told:
        expect_passive(replace(frf, response=frf.response.conj()))
    assert "conjugate = true" in str(told.value) and "scale" not in str(told.value)
    with pytest.raises(DataError) as told:
        expect_passive(replace(frf, response=-frf.response), "scale = -2")
    assert "scale = -2" in str(told.value) and "conjugate" not in str(told.value)


def test_points_of_noise_are_no_reason_to_refuse() -> None:
    """One outlier, points within their deviation or without coherence, and few points are told in a note."""
    bad = np.where(F < 3, 5j, 1.0) * AXIS.response
    other = replace(AXIS, response=AXIS.response.conj())
    for frf in (
        replace(AXIS, response=np.where(F < 2.1, 5j, 1.0) * AXIS.response),
        replace(AXIS, response=bad, coherence=np.where(F < 3, 0.1, 1.0)),
        replace(other, sigma=np.abs(other.response)), other.where(np.arange(30) % 8 == 0),
    ):  # fmt: skip
        assert "no passive axis" in expect_passive(frf).notes[-1]
