"""Where a fit starts, and how far it may go."""

import numpy as np
import pytest
from bench import GMS, HEALTHY, J, runs

import gms_mujoco as gms
from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.starts import LONGEST_BREAK_AWAY, sliding_furthest, starts, visible_limits
from gms_mujoco.plant import Plant


@pytest.mark.parametrize(
    "effect",
    [
        effects.ThermalDrift(amplitude=0.8, time_constant=1.0),
        effects.AsymmetricFriction(level=0.4),
        effects.PositionDependentFriction(harmonics=[3.0], amplitude=[0.5], phase=[1.0]),
    ],
    ids=lambda e: e.name,
)
def test_a_start_allows_for_what_modulates_friction(effect: Effect) -> None:
    """With the effect it has the level of friction itself, without it that of both."""
    seen = observe(runs(HEALTHY + effect), J)
    start, *_ = starts(gms.baseline(J) + effect, seen)
    level = float(np.asarray(GMS.values["coulomb"]))
    assert start["gms"].coulomb == pytest.approx(level, rel=0.05)


def test_the_records_that_slide_furthest_are_told_from_those_to_and_fro() -> None:
    seen = observe(runs(HEALTHY), J)
    assert [o.record.name for o in sliding_furthest(seen)] == ["fit_2"]
    assert sliding_furthest(seen[2:]) == sliding_furthest([seen[2], seen[2]]) == []


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


def test_a_stiff_element_with_next_to_nothing_of_the_level_does_not_hold_the_others() -> None:
    """They may become as soft as without it, however stiff it is."""
    seen = observe(runs(HEALTHY), J)
    shares, stiffness = np.asarray(GMS.values["fraction"]), np.asarray(GMS.values["stiffness"])
    alone = visible_limits(HEALTHY, seen)["gms.stiffness[0]"][0]
    for share in (1e-4, 5e-3):
        for times in (1e2, 1e8):  # as stiff as the others
            law = GMS.replace(stiffness=[*stiffness, times * stiffness[0]], fraction=[*(1 - share) * shares, share])
            assert visible_limits(HEALTHY.replace(law), seen)["gms.stiffness[0]"][0] < 1.01 * alone


@pytest.mark.parametrize("seconds", [2.0, 5.0])
def test_friction_is_not_asked_to_settle_over_much_more_than_the_records_last(seconds: float) -> None:
    """It would multiply the level of all of them by one number, a friction of the same shape in other units."""
    seen = observe(runs(HEALTHY, seconds=seconds), J)
    drift = effects.ThermalDrift(amplitude=0.5, time_constant=seconds)
    least, most = visible_limits(HEALTHY + drift, seen)["thermal_drift.time_constant"]
    assert least < 0.1 * seconds and seconds < most < 5 * seconds

    def spread(time_constant: float) -> float:
        """How much the level changes over the records, of the part that settles."""
        level = seen[0].replay(HEALTHY + drift.replace(time_constant=time_constant)) / seen[0].replay(HEALTHY)
        first, last = (np.median(part) for part in (level[: len(level) // 10], level[-len(level) // 10 :]))
        return float(first - last) / 0.5

    assert spread(most) > 0.2 > 0.01 > spread(1000 * most)
    slower = drift.replace(time_constant=1e3 * seconds)  # a value that somebody gave
    assert visible_limits(HEALTHY + slower, seen)["thermal_drift.time_constant"][1] >= 1e3 * seconds


@pytest.mark.parametrize("name", ["flexible_coupling", "backlash"])
def test_a_part_swings_no_faster_than_samples_show(name: str) -> None:
    """Faster ones are all alike: a coupling at 10 MHz had been found, which smoothed the noise of an encoder."""
    seen = observe(runs(HEALTHY, seconds=0.5), J)
    swinging = effects.find(name)(inertia=0.3 * J, frequency=80.0)
    limits = visible_limits(HEALTHY + swinging, seen)[f"{name}.frequency"]
    assert limits[1] == pytest.approx(0.5 / seen[0].sample_time)
    given = visible_limits(HEALTHY + swinging.replace(frequency=1e6), seen)[f"{name}.frequency"]
    assert given[1] == 1e6
