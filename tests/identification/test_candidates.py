"""Candidates: what a plant does not have yet, at values that the effect accepts and the motion can show."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, UNKNOWN, J, runs

from gms_mujoco import effects
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit, observe
from gms_mujoco.identification.candidates import (
    applicable,
    begin_apart,
    is_part_of_wave,
    is_possible,
    is_present,
    joined,
    lean,
    shapes,
    width_of,
    widths,
    with_general_laws,
    with_one_law,
)
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.scales import Scales
from gms_mujoco.plant import Plant

OBSERVED = observe(runs(HEALTHY), J)


def test_applicable_effects_are_not_there_yet_nor_contained() -> None:
    names = {e.name for e in applicable(HEALTHY)}
    assert not names & {"gms", "viscous", "coulomb", "stribeck", "dahl", "lugre"}
    assert {"cogging", "gravity", "delay", "asymmetric_friction"} <= names
    assert "viscous" in {e.name for e in applicable(HEALTHY.without("viscous"))}
    assert "coulomb" in {e.name for e in applicable(Plant.axis(J))}


def test_general_laws_take_the_place_of_what_they_contain() -> None:
    bare, dry, cogging = Plant.axis(J), effects.Coulomb(coulomb=LEVEL), HIDDEN["cogging"]
    creeping = effects.Stribeck(coulomb=LEVEL, static=LEVEL, stribeck_velocity=1.0, creep_velocity=0.1)
    for plant in (bare, bare + dry, bare + dry + effects.Stribeck(), bare + effects.Frictionloss(coulomb=LEVEL)):
        laws = list(with_general_laws(plant + cogging).values())
        assert [[e.name for e in p.effects] for p in laws] == [["gms", "cogging"], ["lugre", "cogging"]]
        assert all(p.effects[0].unset for p in laws) and laws[0]["gms"].elements > 1
    for law in (HEALTHY["gms"], effects.LuGre(), creeping):
        assert not with_general_laws(bare + dry + law)


def test_of_several_laws_a_general_one_stays_alone_and_simple_ones_as_they_are() -> None:
    dahl, bristle, drag = effects.Dahl(), effects.LuGre(), effects.Viscous()
    plant, said = with_one_law(Plant.axis(1.0) + dahl + bristle + drag)
    assert [e.name for e in plant.effects] == ["lugre", "viscous"]
    assert said.startswith("dahl, lugre are each a law of all the friction") and said.endswith("that is lugre here")
    for one in (Plant.axis(1.0) + bristle + drag, Plant.axis(1.0) + drag):
        assert with_one_law(one) == (one, "")
    simple = Plant.axis(1.0) + dahl + effects.Stribeck()
    assert with_one_law(simple)[0] == simple and "each a law" in with_one_law(simple)[1]


def test_what_begins_anew_is_a_shape_where_records_begin_at_other_times_alone() -> None:
    at_once = [Observation(r, 50.0) for r in runs(HEALTHY, seconds=1.0)]
    later = [Observation(replace(o.record, time=o.record.time + 9.0 * i), 50.0) for i, o in enumerate(at_once)]
    for observed, apart in ((at_once, False), (later, True)):
        assert begin_apart(observed) == apart
        tried = [s.get("anew") for s in shapes(effects.ThermalDrift, Scales.of(observed), observed)]
        assert set(tried) == ({0.0, 1.0} if apart else {None})
    assert not begin_apart([*later, None])  # type: ignore[list-item]  # as of a response, which has no beginning


def test_shapes_are_values_that_the_effect_accepts() -> None:
    scales = Scales.of(OBSERVED)
    for name, kind in effects.CATALOGUE.items():
        for shape in shapes(kind, scales, OBSERVED):
            table = {p.name: p for p in kind.parameters}
            assert all(table[k].lower <= v <= table[k].upper for k, v in shape.items()), name


def test_harmonics_are_tried_only_where_the_motion_passes_them() -> None:
    tried = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(OBSERVED), OBSERVED)]
    assert tried[0] == 2 and tried == sorted(tried)
    small = fit(UNKNOWN, runs(HEALTHY)[:1], bandwidth=100.0).misfit.observations  # pre-sliding: far from a turn
    turn = float(np.ptp(small[0].position)) / (2 * math.pi)
    few = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(small), small)]
    assert all(n * turn >= 1 for n in few) and len(few) < len(tried)


def _over(travel: float, **more: np.ndarray) -> list[Observation]:
    """A record whose positions span so much [rad]."""
    record = OBSERVED[-1].record
    q = travel * (record.position - record.position.min()) / np.ptp(record.position)
    return [Observation(replace(record, signals={**record.signals, "position": q, **more}), 60.0)]


def test_friction_over_a_part_of_a_wave_is_tried_beside_none_that_varies_with_the_load() -> None:
    """Of friction that varies twice to a revolution, seen over 1.8 rad, harmonics 4, 5 and 6 were named."""
    kind, seen = effects.PositionDependentFriction, _over(1.8)
    loaded = HEALTHY + effects.LoadDependentFriction(coefficient=0.1)
    tried, few = ([s["harmonics"] for s in shapes(kind, Scales.of(seen), seen, p)] for p in (HEALTHY, loaded))
    assert tried[0] == 1 and few[0] == 4
    narrow = _over(0.2)
    assert next(shapes(kind, Scales.of(narrow), narrow))["harmonics"] == 8


@pytest.mark.parametrize(
    ("effect", "part"),
    [
        (effects.PositionDependentFriction(harmonics=[3, 9], amplitude=[0.1, 0.1], phase=[0, 0]), True),
        (effects.PositionDependentFriction(harmonics=[4, 9], amplitude=[0.1, 0.1], phase=[0, 0]), False),
        (effects.Cogging(harmonics=[1], amplitude=[0.1], phase=[0]), False),
        (effects.LoadDependentFriction(coefficient=0.1), False),
    ],
)
def test_friction_of_a_part_of_a_wave_is_known_by_its_longest(effect: Effect, part: bool) -> None:
    assert is_part_of_wave(effect, _over(1.8)) == part


def test_a_sine_of_the_revolution_is_no_candidate_over_a_few_degrees() -> None:
    """A spring over 0.04 rad had been gravity of twelve times the friction."""
    once = {"gravity", "encoder_eccentricity"}
    assert once <= {e.name for e in applicable(HEALTHY, _over(0.5))}
    names = {e.name for e in applicable(HEALTHY, _over(0.04))}
    assert not once & names and {"spring", "cogging", "position_dependent_friction"} <= names


def test_records_of_other_parts_of_the_revolution_show_longer_waves_together() -> None:
    """Of a wave that no record holds whole its neighbours were named, three of them, with a spring and gravity."""
    record = fit(UNKNOWN, runs(HEALTHY)[2:], bandwidth=60.0).misfit.observations[0].record
    parts = []
    for start in (0.0, 1.0, 9 * math.pi - 1.0):  # 0 to 2.15 rad, and 2.14 to 3.29 of the fifth turn
        q = start + 1.15 * (record.position - record.position.min()) / np.ptp(record.position)
        parts.append(Observation(replace(record, signals={**record.signals, "position": q}), 60.0))
    apart = [next(shapes(effects.Cogging, Scales.of([p]), [p]))["harmonics"] for p in parts]
    together = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(parts), parts)]
    assert apart == [6, 6, 6] and together[0] == 2


def test_an_effect_whose_strength_vanished_is_not_present() -> None:
    assert is_present(HIDDEN["cogging"]) and not is_present(effects.Cogging(harmonics=[6]))
    assert is_present(HIDDEN["delay"]) and not is_present(effects.Delay(time=0.0))


def test_one_more_harmonic_is_a_candidate_and_no_other_effect_twice() -> None:
    plant = HEALTHY + effects.Cogging(harmonics=[6], amplitude=[0.2 * LEVEL], phase=[0.4])
    names = {e.name for e in applicable(plant + HIDDEN["gravity"])}
    assert {"cogging", "position_dependent_friction"} <= names and "gravity" not in names
    more = joined(plant, effects.Cogging(harmonics=[9], amplitude=[0.1 * LEVEL], phase=[1.0]))
    assert more["cogging"].harmonics == (6.0, 9.0) and len(more.effects) == len(plant.effects)
    tried = [s["harmonics"] for s in shapes(effects.Cogging, Scales.of(OBSERVED), OBSERVED, plant)]
    assert 6.0 not in tried and {5.0, 7.0} <= set(tried)


def test_candidates_for_a_gap_are_close_and_knock_hard() -> None:
    tried = list(shapes(effects.Backlash, Scales.of(OBSERVED), OBSERVED))
    gaps, frequencies = ({s[k] for s in tried} for k in ("gap", "frequency"))
    assert min(gaps) >= 3 * OBSERVED[0].record.resolution and all(20 <= f <= 120 for f in frequencies)
    # Two refinements close the steps of the grid to less than 1.3.
    steps = np.diff(np.log(sorted(gaps)))
    assert np.exp(steps.max()) / (1.41 * 1.19) ** 2 < 1.3


def test_widths_of_a_play_are_tried_closely_over_the_whole_grid() -> None:
    scales = Scales.of(OBSERVED)
    assert [k for k, e in effects.CATALOGUE.items() if width_of(e) or [*widths(e, scales, OBSERVED, HEALTHY)]] == [
        "backlash"
    ]
    gaps, grid = (
        [tried["gap"] for tried in values(effects.Backlash, scales, OBSERVED, HEALTHY)] for values in (widths, shapes)
    )
    assert gaps[0] == pytest.approx(min(grid)) and gaps[-1] == pytest.approx(max(grid))
    steps = np.diff(np.log(gaps))
    assert (steps > 0).all() and (steps < 0.13).all()


def test_an_effect_at_the_end_of_its_range_or_a_resonance_without_one_is_not_what_it_is_called() -> None:
    lag, coupling = effects.CurrentLoopLag, effects.FlexibleCoupling
    assert is_possible(lag(time=0.01)) and not is_possible(lag(time=0.05))
    assert is_possible(coupling(inertia=1e-5, frequency=30, damping=0.3))
    assert not is_possible(coupling(inertia=1e-5, frequency=1, damping=5))
    assert is_possible(effects.Backlash(inertia=1e-5, gap=0.01, frequency=100, damping=1))
    assert is_possible(effects.Cogging(harmonics=[2, 3], amplitude=[1, 2], phase=[0, 0]))
    heavy = effects.LuGre(coulomb=30.0, static=40.0, stiffness=1e5, damping=2.0, stribeck_velocity=0.1)
    assert is_possible(heavy)  # its damping is in N m s/rad, and no ratio


def test_a_load_that_joins_a_plant_is_less_than_its_inertia() -> None:
    load = effects.find("flexible_coupling")(inertia=3 * J, frequency=50.0)
    assert 0 < joined(HEALTHY, load).driven_inertia < J
    assert joined(HEALTHY, load.replace(inertia=0.2 * J))["flexible_coupling"].inertia == 0.2 * J


def test_an_effect_sheds_the_harmonics_that_are_nothing() -> None:
    cogging = effects.Cogging(harmonics=[3, 5, 21], amplitude=[0.2, 1e-4, 0.0], phase=[0.1, 0.2, 0.3])
    assert lean(cogging) == effects.Cogging(harmonics=[3, 5], amplitude=[0.2, 1e-4], phase=[0.1, 0.2])
    for whole in (lean(cogging), cogging.replace(amplitude=[0, 0, 0]), effects.Gravity(amplitude=0.0, phase=0.1)):
        assert lean(whole) == whole


@pytest.mark.parametrize("count", [1, 2])
def test_waves_on_a_slide_joint_need_two_records_that_hold_them_to_the_place(count: int) -> None:
    """The zero of one may be anywhere: what fits it need not come back at the same place."""
    slide = replace(HEALTHY, kind="slide")
    names = {e.name for e in applicable(slide, observe(runs(slide)[:count], J))}
    assert ({"cogging", "position_dependent_friction"} <= names) == (count == 2)
    assert not {"gravity", "encoder_eccentricity"} & names
