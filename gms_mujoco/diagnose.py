"""diagnose: which physical effect a plant is missing, or that none of the known ones is, or that nothing is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import effects
from .compare import compare_observations, quick_error
from .dataset import Dataset
from .diagnosis.conclusion import conclude, fits_alone, lowered
from .diagnosis.custom import Shape, Shapes, expect_torques, named, scored
from .diagnosis.findings import Diagnosis, Rejected
from .diagnosis.friction_law import (
    add_law,
    brought_back,
    comes_further,
    is_close,
    law_of,
    leading_further,
    told_instead,
    with_law,
    with_laws_added,
    with_other_laws,
    would_be_better,
)
from .diagnosis.friction_shape import (
    fading_damping,
    other_kind,
    with_exponents,
    with_many_elements,
    without_vanished,
)
from .diagnosis.given_inertia import contradicts, corrected, free, is_doubtful, is_needed
from .diagnosis.given_load import by_drive, corrected_load, grown, grows_with_drive
from .diagnosis.given_setup import corrected_setup
from .diagnosis.moments import has_moments, unbent
from .diagnosis.paths import searched
from .diagnosis.patience import Patience
from .diagnosis.plays import play_of
from .diagnosis.recheck import drop_last, join_laws, law_first
from .diagnosis.search import Search
from .diagnosis.steps import Step
from .diagnosis.unfitted import shown_unfitted
from .effort import counted
from .errors import DataError, ModelError
from .fit import baseline
from .fit_result import FitResult, with_covariance
from .identification.candidates import has_general_law, with_one_law
from .identification.frf_observation import Seen, tells_another_noise
from .identification.inverse import Observation
from .identification.observe import driven, expect_enough, loaded, observe
from .identification.refine import finished, gone_on
from .identification.time_steps import as_fitted
from .plant import Plant
from .progress import Progress, part, silent
from .threads import one_blas_thread

Array = NDArray[np.float64]

_TURNS = 2  # beside what is usual, and beside what was found: the setup of a robot, the noise of bare responses


@one_blas_thread()
def diagnose(
    runs: Dataset,
    plant: Plant | None = None,
    *,
    candidates: Shapes = (),
    without: Collection[str] = (),
    effort: float = 1.0,
    progress: Progress | None = None,
) -> Diagnosis:
    """The whole loop: fit the baseline, find the effect that is missing, add it, refit, until nothing more earns it.

    Every effect of the catalogue is screened at the price of a few replays, the best are refitted jointly with the
    plant. One is added if it lowers the error on blocks of the fit records that its fit has not seen (and on the
    select records where there are some), significantly after control of the false discovery rate over the whole
    catalogue. Where that ends above the noise floor, it goes on from effects that were passed over for one that left
    hardly less, and stays with the path that explains most. The validate records are scored after every choice and
    decide nothing; where they contradict an effect, the verdict and a note say so. Where they alone show that something
    is missing, the remainder says which effect would explain most of it, and nothing is added.

    The default baseline has `gms` friction. Where that leaves more than noise does, other laws in its place are fitted
    too, before effects are looked for and beside those that were found, and one takes it where it passes the same tests
    and leaves less than any effect would. Where the end is above the noise floor, the whole search is made beside each
    other law that with one effect may leave less, and that law taken where it leaves much less in the end. A general
    law of your own `plant` gives way to another in the same way, but to none in `without`: the evidence of the baseline
    says so. Where it has a simple one (`coulomb`, `stribeck`, `dahl`, `frictionloss`, or none), `gms` and `lugre` are
    effects that may be missing, and take its place; where the end is above the noise floor the whole search is made
    beside each of them, too. Of several laws one of which is general that alone is gone on with, and a note says so.

    Frequency responses that come without a deviation are weighed again by what the plant leaves that was found beside
    them first, and all is looked for again.

    Of a robot a payload, another gravity or other zeros of its encoders are counted in where the records contradict its
    model in that way, and the evidence of the baseline says so, with the numbers; see `given_setup`. They are fitted
    again beside another law of friction, where the search ends with one.

    A load that was logged, and that acts on the axis itself, is counted in the same way; see `given_load`.

    An inertia that is given stays too, unless the records contradict it: where another leaves much less, or as little
    as an effect that was found in its place, it is identified, and the evidence of the baseline says so.

    Args:
        runs: a measurement set with at least one fit record.
        plant: where to start from; None: the default baseline.
        candidates: functions (time, position, velocity) -> torque of arrays (n,), causes that you suspect, as a list or
            by the name that each is to have. Each is scored on the final plant, in a joint linear refit of its strength
            and the plant, by the same test on blocks not seen, and reported among the candidates by its name; it is not
            added. An effect in one file (see CONTRIBUTING) is. Along a frequency response it is given the steady
            motion, to and fro about 0, and NaN for the time, which is not known there: what follows time is none of it.
        without: names of effects that you know not to be there; they are not looked at.
        effort: times the usual limits of the work that a search may take, `math.inf` for none. Beyond some thousand
            replays of all records it goes on from what it has found alone, and tries nothing from the beginning; beyond
            twice as many it ends, and a note says so. It is work that is counted, not time: the result is the same on
            every machine.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: there is nothing to fit, it is of the other kind of joint, or a candidate is no function, has the
            name of another or of an effect, or gives no torque for each sample.
        ModelError: no effect has the name of one in `without`, a load in the plant is heavier than its axis, or the
            plant takes a goal and the data have torques, or the other way round; or `effort` is not positive.
    """
    if not isinstance(runs, Dataset):
        raise DataError('a measurement set is expected first, as gms.load("folder") reads one, then a plant; '
                        f"{type(runs).__name__} given")
    without = [without] if isinstance(without, str) else without
    for name in without:
        effects.find(name)
    if not (isinstance(effort, (int, float)) and effort > 0):
        raise ModelError(f"effort must be positive, 1 as usual, math.inf for a search to its end; {effort!r} given")
    report = progress or silent
    if not runs.fit:
        raise DataError('no fit records; mark some with use = "fit"')
    shapes = named(candidates)
    if shapes and runs.controller:
        raise DataError("a candidate of your own is a torque along the motion, and a servo's log has no torque")
    start = plant or baseline(runs.inertia, runs.kind, controller=runs.controller)
    driven(start, runs.all)
    expect_torques(shapes, runs.fit)
    start, said = with_one_law(start)
    runs = runs.with_temperature_of_all()
    runs = replace(runs, notes=(*runs.notes, said))
    with counted() as spent:
        return _diagnosed(runs, start, shapes, without, Patience(effort, spent), report)


def _diagnosed(
    runs: Dataset, start: Plant, shapes: Mapping[str, Shape], without: Collection[str], patience: Patience,
    report: Progress,
) -> Diagnosis:  # fmt: skip
    """What `diagnose` says of arguments that have passed its checks."""
    report(0.0, "looking at the records")
    as_given, law_said, near = runs, "", None
    for turn in range(_TURNS):
        runs, setup_said = (corrected_setup if as_given.robot else corrected_load)(as_given, start)
        seen = observe(loaded(runs.fit, start), start.inertia, plant=near)
        expect_enough(seen, start)
        bandwidth = next((o.bandwidth for o in seen if isinstance(o, Observation)), None)
        select = observe(loaded(runs.select, start), start.inertia, bandwidth, near) if runs.select else []
        ended = _searched(seen, select, start, without, patience, report)
        search, law_said = ended.search, ended.law or law_said
        if setup_said and ended.law:
            # A payload that was found beside another friction has made up for what that lacks.
            start = _with_law_of(search, start)
        elif turn + 1 < _TURNS and tells_another_noise(search.steps[-1].result.plant, seen):
            near = search.steps[-1].result.plant
        else:
            break
    if ended.inertia:
        start = free(start)
    report(0.9, "scoring the validate records")
    last, moments = _ended(search, start)
    kept = search.steps[-1]
    search.steps = [replace(s, result=with_covariance(s.result)) for s in search.steps[:-1]]
    search.steps.append(replace(kept, result=last))
    noise = last.noise
    new = loaded(runs.validate, last.plant)
    validate = as_fitted(observe(new, start.inertia, bandwidth, last.plant) if new else [], last.plant.provenance)
    begun = ". ".join(filter(None, (setup_said, ended.load, ended.inertia, law_said)))
    steps = tuple(
        replace(s, comparison=compare_observations(s.result.plant, validate, noise) if validate else None,
                evidence=_evidence(search.steps[i - 1], s) if i else begun)
        for i, s in enumerate(search.steps)
    )  # fmt: skip
    comparison = steps[-1].comparison
    rejected = tuple(Rejected(t.name, t.p_value) for t in search.rejected)
    if comparison:
        rejected = tuple(
            Rejected(name, p, comparison.error if near is None else quick_error(near, validate, comparison))
            for name, p, near in search.left_out()
        )
    floor = comparison.noise_floor if comparison else steps[-1].result.floor
    hint = search.hint
    if hint is None and comparison and fits_alone(search, steps):
        hint = shown_unfitted(search, last, validate, comparison)
    of_law = would_be_better(search) if not (has_general_law(start) or search.at_floor) else ""
    if shapes:
        report(0.95, "scoring your candidates")
    own = scored(shapes, last, validate, comparison) if shapes else []
    found = conclude(steps, rejected, floor, search, moments, (ended.late, of_law), hint, own)
    if patience.cut and found.remainder:
        found = replace(found, notes=(*found.notes, patience.said))
    report(1.0, "done")
    return replace(found, data=tuple(line for line in (runs.split, *runs.notes) if line))


class _Ended(NamedTuple):
    """The search that has come furthest, and sentences on what it has come by.

    Attributes:
        search: of those with an inertia that is given or not, beside one law of friction or another.
        law, inertia, load: where they are others than it began with; else empty.
        late: on what was found last and taken away again.
    """

    search: Search
    law: str
    inertia: str
    load: str
    late: str


def _searched(
    seen: Sequence[Seen], select: Sequence[Seen], start: Plant, without: Collection[str], patience: Patience,
    report: Progress,
) -> _Ended:  # fmt: skip
    free_law = has_general_law(start)
    search = Search(seen, select, start, without, patience=patience)
    way = searched(search, free_law, part(report, 0.02, 0.85), halt=contradicts)
    inertia_said = ""
    as_found = _with_law_of(search, start) if way.law else start
    other = Search(seen, select, free(as_found), without, patience=patience)
    if way.halted or is_doubtful(search, other):
        if patience.is_at_end:
            patience.grant()
        instead = searched(other, free_law, part(report, 0.85, 0.9), search)
        if way.halted and not (is_needed(other, start) and corrected(search, other)):
            law = way.law
            way = searched(search, free_law, part(report, 0.85, 0.9))
            way = way._replace(law=way.law or law)
        if inertia_said := corrected(search, other):
            start, search, way = free(start), other, instead._replace(law=instead.law or way.law)
    load_said = ""
    if geared := grows_with_drive(search):
        carried = by_drive(seen), by_drive(select)
        patience.grant()
        other = Search(*carried, geared, without, patience=patience)
        instead = searched(other, free_law, part(report, 0.9, 0.9), search)
        if load_said := grown(search, other):
            (seen, select), search, way = carried, other, instead
    law_said, late = way.law, way.late
    if not (search.at_floor or search.hint):
        plants = with_other_laws(search, start) if free_law else with_laws_added(search, start)
        others = [Search(seen, select, plant, without, search.timed, patience) for plant in plants]
        if free_law or is_close(search):  # a simple law tells little of what is beside another
            others = leading_further(search, others)
        if others and patience.is_at_end:
            patience.grant()
        for other in others:
            instead = searched(other, False, part(report, 0.9, 0.9), search)
            if comes_further(search, other):
                if free_law:
                    law_said = told_instead(search, other) or law_said
                else:
                    add_law(search, other)
                search, late = other, instead.late
            if search.at_floor or patience.is_at_end:
                break
    if not free_law:
        law_first(search)
    elif (joined := join_laws(search, law_of(start))) and joined not in law_said:
        law_said = "; ".join(filter(None, (law_said, joined)))
    return _Ended(search, law_said, inertia_said, load_said, late)


def _with_law_of(search: Search, plant: Plant) -> Plant:
    """A plant with the law of friction that a search has ended with."""
    return with_law(plant, search.start[law_of(search.start)])


def _ended(search: Search, start: Plant) -> tuple[FitResult, str]:
    """The last fit at its end, without effects that are none there, and since when the records are off it."""
    while True:
        brought_back(search)
        kept = search.steps[-1]
        if search.timed and not search.patience.is_at_end:
            result, held_out = fading_damping(*other_kind(kept.result, kept.held_out))
            search.steps[-1] = kept = replace(kept, result=result, held_out=held_out)
        free_to_bend = gone_on(with_exponents(kept.result, start))
        # Where a load knocks is no moment that bends its contact, but what tells it.
        if play_of(kept.result.plant) is None and has_moments(kept.result, kept.held_out):
            return unbent(free_to_bend)
        last = finished(without_vanished(with_many_elements(free_to_bend)))
        if not drop_last(search, last):
            return last, ""


def _evidence(before: Step, step: Step) -> str:
    """One sentence that can be checked on a plot."""
    assert step.effect is not None
    better = sum(b < a for a, b in zip(before.held_out.by_record, step.held_out.by_record, strict=True))
    score = step.result.score
    was, now = before.result.error, step.result.error
    fall = f"the {score.name} falls from {score.told(was)} to {score.told(now)}"
    if now >= was:  # of a plant that was fitted between moments, which are in the error
        fall = "less is left of what a fit has not seen"
    gone = [e.name for e in before.result.plant.effects if e.name not in step.result.plant]
    instead = f", in the place of {' and '.join(gone)}" if gone else ""
    by = ", by the temperature that was measured" if step.result.plant[step.effect].thermometer else ""
    looks = lowered(effects.find(step.effect).signature).replace("torque error", score.name)
    return (
        f"{step.effect}{instead}{by}: with it {fall} (p = {step.p_value:.1g} on held-out blocks), in {better} of "
        f"{len(step.held_out.by_record)} fit records; {looks}"
    )
