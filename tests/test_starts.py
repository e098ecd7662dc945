"""Where a fit starts, and how far it may go."""

import numpy as np
from bench import GMS, HEALTHY, J, runs

from gms_mujoco.observe import observe
from gms_mujoco.plant import Plant
from gms_mujoco.starts import LONGEST_BREAK_AWAY, visible_limits


def test_an_element_that_has_become_a_spring_does_not_make_room_for_itself() -> None:
    """However much of the level it takes, the others may become no softer than without it."""
    seen = observe(runs(HEALTHY), J)
    level = GMS.values["coulomb"] * np.asarray(GMS.values["fraction"])
    for share in (0.2, 0.5, 0.9):  # of a third element, of all the level
        total = float(level.sum()) / (1 - share)
        shares = [*(level / total), share]
        for distance in (2 * LONGEST_BREAK_AWAY, 100 * LONGEST_BREAK_AWAY):  # in units of the longest of the others
            usual = float(np.max(level / np.asarray(GMS.values["stiffness"])))
            soft = share * total / (distance * usual)
            law = GMS.replace(
                stiffness=[*GMS.values["stiffness"], soft], fraction=shares, coulomb=total, static=1.1 * total
            )
            lowest = visible_limits(Plant.axis(J) + law, seen)["gms.stiffness[0]"][0]
            assert total / 3 / lowest <= 1.01 * LONGEST_BREAK_AWAY * usual
