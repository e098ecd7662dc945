"""diagnose: which physical effect a plant is missing, or that none of the known ones is, or that nothing is."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import effects
from .compare import Comparison, compare_observations, quick_error
from .comparison.score import Score, relative_error
from .dataset import Dataset
from .diagnosis.custom import Shape, column, name_of
from .diagnosis.friction_law import choices, law_of, leading_further, much_better, with_law, would_be_better
from .diagnosis.friction_shape import with_exponents, without_vanished
from .diagnosis.given_inertia import corrected, free, is_doubtful
from .diagnosis.given_load import corrected_load
from .diagnosis.given_setup import corrected_setup
from .diagnosis.judgement import AT_FLOOR
from .diagnosis.moments import has_moments, unbent
from .diagnosis.paths import searched
from .diagnosis.recheck import drop_last, join_laws
from .diagnosis.remainder import describe, loudest
from .diagnosis.search import Search
from .diagnosis.steps import Step
from .effect import Effect
from .errors import DataError
from .fit import baseline
from .fit_result import FitResult, with_covariance
from .identification.frf_observation import Seen, tells_another_noise
from .identification.held_out import p_value
from .identification.inverse import Observation
from .identification.observe import driven, observe
from .identification.refine import finished, gone_on
from .identification.screen import Screen
from .identification.time_steps import as_fitted
from .identification.undetermined import never_slips
from .plant import Plant
from .progress import Progress, part, silent
from .threads import one_blas_thread

Array = NDArray[np.float64]

_SAYS_NOTHING = 0.1  # p value of an effect above which it is no closer to what remains than chance
_ALIKE = 1.5  # times an error, that another one is at most where both say the same
_TURNS = 2  # beside what is usual, and beside what was found: the setup of a robot, the noise of bare responses
_CLOSER = 0.98  # times the error of new records without an effect, that one which comes close leaves at most
_CLOSE = 1.2  # times the noise floor, which no part of the data makes more of
_WORSE = 1.1  # times what is left of new records without an effect: one with which more is left is contradicted
_NEAR_FLOOR = 2.0  # times the noise floor: more is left of new records by a plant that lacks something


@dataclass(frozen=True)
class Rejected:
    """An effect that was tried on the final plant and did not earn its place.

    Attributes:
        effect: its name.
        p_value: how easily chance alone would lower the error on held-out blocks as much.
        validate_error: with it, from a joint fit where one was made, else from the linear refit that it was judged by,
            or without it where that leaves less; None where no records validate.
    """

    effect: str
    p_value: float
    validate_error: float | None = None


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes:
        verdict: "adequate" (the baseline is at the noise floor), "explained" (the effects added bring it there),
            "partly_explained" (they help, something remains) or "unexplained" (nothing known earns its place). Single
            moments of the fit records that no law explains count for nothing where the validate records have none.
        noise_floor: the error that a perfect model would have, of the torque, of a servo of its position [rad]; on the
            validate records where there are some.
        steps: the baseline, then one for each effect added.
        candidates: what was tried on the final plant and left out.
        remainder: what is left looks like this; empty where nothing is.
        next_experiment: what to measure next, None where there is nothing to settle.
        notes: a sentence on how the records were logged, where that matters, one on single moments that nothing
            explains, and one on each candidate of the user's.
        data: what the records are for, and what was done to them or may be wrong with them, as `load` says it.
    """

    verdict: str
    noise_floor: float
    steps: tuple[Step, ...]
    candidates: tuple[Rejected, ...] = ()
    remainder: str = ""
    next_experiment: str | None = None
    notes: tuple[str, ...] = ()
    data: tuple[str, ...] = ()

    @property
    def baseline(self) -> Plant:
        """The plant before anything was added."""
        return self.steps[0].result.plant

    @property
    def plant(self) -> Plant:
        """The final plant."""
        return self.steps[-1].result.plant

    @property
    def score(self) -> Score:
        """What the errors and the floor are of, and how they are told."""
        return self.steps[0].result.score

    @property
    def fit_noise_floor(self) -> float:
        """The error that a perfect model would have on the records that were fitted."""
        return self.steps[-1].result.floor

    @property
    def comparisons(self) -> list[Comparison]:
        """Each step on the validate records."""
        return [s.comparison for s in self.steps if s.comparison is not None]

    @property
    def found(self) -> tuple[Effect, ...]:
        """The effects that were added, with their parameters, in order."""
        return tuple(self.plant[s.effect] for s in self.steps if s.effect)

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.found)

    def to_dict(self) -> dict[str, Any]:
        """The contents of `diagnosis.json`."""
        return {
            "schema": 1,
            "verdict": self.verdict,
            "error_of": self.score.of,
            "error_unit": self.score.unit,
            "noise_floor": self.noise_floor,
            "fit_noise_floor": self.fit_noise_floor,
            "bandwidth_hz": max(o.bandwidth for o in self.steps[0].result.misfit.observations),
            "steps": [_step_dict(s, self.plant) for s in self.steps],
            "candidates": [
                {"effect": c.effect, "validate_error": c.validate_error, "p_value": c.p_value}
                for c in self.candidates
            ],
            "remainder": self.remainder or None,
            "notes": list(self.notes),
            "data": list(self.data),
            "next_experiment": self.next_experiment,
        }

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict.replace('_', ' ')}", ""]
        lines.append(f"{'model':32}  {'fit':>8}  {'validate':>8}   {self.score.head}")
        for s in self.steps:
            name = "baseline" if s.effect is None else f"+ {s.effect}"
            fitted, validate = map(self.score.column, (s.result.error, s.validate_error))
            lines.append(f"{name:32}  {fitted:>8}  {validate:>8}")
        scored = self.noise_floor if self.comparisons else None
        fitted, validate = map(self.score.column, (self.fit_noise_floor, scored))
        lines.append(f"{'noise floor':32}  {fitted:>8}  {validate:>8}")
        for s in self.steps:
            lines += ["", s.evidence] if s.evidence else []
            if s.confusable_with:
                lines.append(f"These records cannot tell it from {', '.join(s.confusable_with)}.")
        if self.remainder:
            lines += ["", f"What remains: {self.remainder}"]
        if self.notes:
            lines += ["", *self.notes]
        if self.next_experiment:
            lines += ["", f"Measure next: {self.next_experiment}"]
        return "\n".join(lines)


def _step_dict(step: Step, final: Plant) -> dict[str, Any]:
    out: dict[str, Any] = {
        "effect": step.effect,
        "fit_error": step.result.error,
        "validate_error": step.validate_error,
    }
    if step.effect:
        out["confusable_with"] = list(step.confusable_with)
        out["p_value"] = step.p_value
        out["parameters"] = final.table(step.effect)
    if step.evidence:
        out["evidence"] = step.evidence
    return out


@one_blas_thread()
def diagnose(
    runs: Dataset,
    plant: Plant | None = None,
    *,
    candidates: Sequence[Shape] = (),
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """The whole loop: fit the baseline, find the effect that is missing, add it, refit, until nothing more earns it.

    Every effect of the catalogue is screened at the price of a few replays, the best are refitted jointly with the
    plant. One is added if it lowers the error on blocks of the fit records that its fit has not seen (and on the
    select records where there are some), significantly after control of the false discovery rate over the whole
    catalogue. Where that ends above the noise floor, it goes on from effects that were passed over for one that left
    hardly less, and stays with the path that explains most. The validate records are scored after every choice and
    decide nothing; where they contradict an effect, the verdict and a note say so.

    The default baseline has `gms` friction. Where that leaves more than noise does, other laws in its place are fitted
    too, before effects are looked for and beside those that were found, and one takes it where it passes the same tests
    and leaves less than any effect would. Where the end is above the noise floor, the whole search is made beside each
    other law that with one effect may leave less, and that law taken where it leaves much less in the end. A general
    law of your own `plant` stays: what another would do is told in the remainder. Where it has a simple one (`coulomb`,
    `stribeck`, `dahl`, `frictionloss`, or none), `gms` and `lugre` are effects that may be missing, and take its place.

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
        candidates: functions (time, position, velocity) -> torque of arrays (n,), causes that you suspect. Each is
            scored on the final plant, in a joint linear refit of its strength and the plant, by the same test on
            blocks not seen, and reported among the candidates by its name; it is not added. An effect in one file
            (see CONTRIBUTING) is.
        without: names of effects that you know not to be there; they are not looked at.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: there is nothing to fit, or a candidate gives no torque for each sample.
        ModelError: no effect has the name of one in `without`, or the plant takes a goal and the data have torques, or
            the other way round.
    """
    if not isinstance(runs, Dataset):
        raise DataError('a measurement set is expected first, as gms.load("folder") reads one, then a plant; '
                        f"{type(runs).__name__} given")
    for name in without:
        effects.find(name)
    report = progress or silent
    if not runs.fit:
        raise DataError('no fit records; mark some with use = "fit"')
    if candidates and runs.controller:
        raise DataError("a candidate of your own is a torque along the motion, and a servo's log has no torque")
    start = plant or baseline(runs.inertia, runs.kind, controller=runs.controller)
    driven(start, runs.fit)
    report(0.0, "looking at the records")
    as_given, law_said, near = runs, "", None
    for turn in range(_TURNS):
        runs, setup_said = (corrected_setup if as_given.robot else corrected_load)(as_given, start)
        seen = observe(runs.fit, start.inertia, plant=near)
        bandwidth = next((o.bandwidth for o in seen if isinstance(o, Observation)), None)
        select = observe(runs.select, start.inertia, bandwidth, near) if runs.select else []
        search, other_law, inertia_said, late = _searched(seen, select, start, plant is None, without, report)
        law_said = other_law or law_said
        if setup_said and other_law:
            # A payload that was found beside another friction has made up for what that lacks.
            start = _with_law_of(search, start)
        elif turn + 1 < _TURNS and tells_another_noise(search.steps[-1].result.plant, seen):
            near = search.steps[-1].result.plant
        else:
            break
    if inertia_said:
        start = free(start)
    report(0.9, "scoring the validate records")
    last, moments = _ended(search, start)
    kept = search.steps[-1]
    search.steps = [replace(s, result=with_covariance(s.result)) for s in search.steps[:-1]]
    search.steps.append(replace(kept, result=last))
    noise = last.noise
    validate = observe(runs.validate, start.inertia, bandwidth, last.plant) if runs.validate else []
    validate = as_fitted(validate, last.plant.provenance)
    begun = ". ".join(filter(None, (setup_said, inertia_said, law_said)))
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
    hint = search.hint.said if search.hint else ""
    said = (late, hint, would_be_better(search) if plant and not search.at_floor else "")
    found = _conclude(steps, rejected, floor, search, moments, said)
    found = replace(found, data=tuple(line for line in (runs.split, *runs.notes) if line))
    if candidates:
        report(0.95, "scoring your candidates")
        found = _with_shapes(found, candidates, search, validate)
    report(1.0, "done")
    return found


def _searched(
    seen: Sequence[Seen], select: Sequence[Seen], start: Plant, free_law: bool, without: Collection[str],
    report: Progress,
) -> tuple[Search, str, str, str]:  # fmt: skip
    """The search that has come furthest, of those with an inertia that is given or not and beside one law of friction
    or another; sentences on that law and that inertia where they are others than it began with, and on what was found
    last and taken away again."""
    search = Search(seen, select, start, without)
    law_said, late = searched(search, free_law, part(report, 0.02, 0.85))
    inertia_said = ""
    as_found = _with_law_of(search, start) if law_said else start
    other = Search(seen, select, free(as_found), without)
    if is_doubtful(search, other):
        other_law, other_late = searched(other, free_law, part(report, 0.85, 0.9), search)
        if inertia_said := corrected(search, other):
            start, search, law_said, late = free(start), other, other_law or law_said, other_late
    if free_law and not search.at_floor and not search.hint:
        laws = choices(start)[1:]
        others = [Search(seen, select, with_law(start, law), without, quick=search.timed) for law in laws]
        for other in leading_further(search, others):
            _, other_late = searched(other, False, part(report, 0.9, 0.9), search)
            if better := much_better(search, other):
                search, late, law_said = other, other_late, better
            if search.at_floor:
                break
    if free_law and (joined := join_laws(search)):
        law_said = "; ".join(filter(None, (law_said, joined)))
    return search, law_said, inertia_said, late


def _with_law_of(search: Search, plant: Plant) -> Plant:
    """A plant with the law of friction that a search has ended with."""
    return with_law(plant, search.start[law_of(search.start)])


def _ended(search: Search, start: Plant) -> tuple[FitResult, str]:
    """The last fit at its end, without effects that are none there, and since when the records are off it."""
    while True:
        kept = search.steps[-1]
        free_to_bend = gone_on(with_exponents(kept.result, start))
        if has_moments(kept.result, kept.held_out):
            return unbent(free_to_bend)
        last = finished(without_vanished(free_to_bend))
        if not drop_last(search, last):
            return last, ""


def _conclude(
    steps: tuple[Step, ...],
    rejected: tuple[Rejected, ...],
    floor: float,
    search: Search,
    moments: str,
    said: tuple[str, ...],
) -> Diagnosis:
    last = steps[-1].result
    negligible = max(o.negligible for o in search.seen)
    comparisons = [s.comparison for s in steps if s.comparison is not None]
    holds = _holds(comparisons, negligible)
    at_floor = (search.at_floor or _as_good(steps[-1], negligible)) and holds
    at_floor |= bool(moments) and _told_beforehand(steps[-1].comparison, negligible)
    added = len(steps) > 1
    verdict = ("explained" if added else "adequate") if at_floor else ("partly_explained" if added else "unexplained")
    left = np.split(last.misfit.residual(last.vector), last.misfit.splits)
    remainder = ""
    if not at_floor:
        size = f"{last.score.told(last.error)} of the {last.score.of}"
        when = f"most of it {moments}" if moments else ""
        fitted = () if search.at_floor else (size, describe(last.plant, last.misfit.observations, left), when)
        said = (*fitted, *said, "" if holds else _elsewhere(steps[-1].comparison), _other_curve(search))
        remainder = "; ".join(filter(None, said))
    following = None
    confusable = [(s.effect, other) for s in steps for other in s.confusable_with if s.effect]
    if confusable:
        one, other = confusable[0]
        assert one is not None
        following = (
            f"To tell {one} from {other}: {_lowered(effects.find(one).experiment)} "
            f"For {other}: {_lowered(effects.find(other).experiment)}"
        )
    elif stuck := never_slips(last.plant, last.misfit.observations):
        following = stuck
    elif search.hint:
        following = search.hint.experiment
    elif not at_floor:
        record, error = _loudest(search, steps[-1], left), steps[-1].validate_error
        following = _to_isolate(rejected, record, error, _comes_back(steps[-1]))
    off = f"The fit records are off {moments}" if moments and at_floor else ""
    unseen = _unseen(steps[-1].comparison, negligible) if at_floor else ""
    notes = tuple(f"{line}." for line in (last.habit, off, unseen, _contradicted(steps, comparisons)) if line)
    return Diagnosis(verdict, floor, steps, rejected, remainder, following, notes)


def _loudest(search: Search, step: Step, left: Sequence[Array]) -> str:
    """Name of the record that most of what remains stands in: of those that were not fitted, where the others are told
    as well as noise allows."""
    if search.at_floor and step.comparison is not None:
        return max(step.comparison.rows, key=lambda r: float(r.residual @ r.residual)).name
    return loudest(step.result.misfit.observations, left)


def _comes_back(step: Step) -> bool:
    """Whether about as much is left of new records as of those that were fitted, and clearly more than noise."""
    if step.comparison is None:
        return False
    errors, floor = (step.result.error, step.comparison.error), max(step.result.floor, step.comparison.noise_floor)
    return min(errors) > max(_NEAR_FLOOR * floor, max(errors) / _ALIKE)


def _to_isolate(
    rejected: Sequence[Rejected], record: str, error: float | None = None, comes_back: bool = False
) -> str:
    """What to measure where nothing known explains the rest: what the closest effect asks for, or the same again.

    Args:
        rejected: what was tried.
        record: that most of what remains stands in.
        error: of the validate records, of which an effect that is close takes something.
        comes_back: whether new records have it too.
    """
    near = [r for r in rejected if error is None or r.validate_error is None or r.validate_error < _CLOSER * error]
    likely = min(near, key=lambda r: r.p_value, default=None)
    if likely is None or likely.p_value > _SAYS_NOTHING:
        if comes_back:
            return (
                "Nothing known explains the rest, or comes close. New records have it too, so the machine does it each "
                f"time: repeat {record} with one thing changed at a time, the place, the direction, the speed, the "
                "load, the temperature. What it follows is its cause."
            )
        return (
            f"Nothing known explains the rest, or comes close. Measure {record} twice more in the same way: what comes "
            "back is the machine's, what does not is noise or drift."
        )
    experiment = _lowered(effects.find(likely.effect).experiment)
    return f"Nothing known explains the rest. {likely.effect} came closest: {experiment}"


def _with_shapes(
    found: Diagnosis, shapes: Sequence[Shape], search: Search, validate: Sequence[Seen]
) -> Diagnosis:
    """The diagnosis with the user's own candidates, scored on the final plant."""
    last, comparison = search.steps[-1].result, found.steps[-1].comparison
    screen = Screen(last.misfit, last.vector)
    scored, notes = [], []
    for shape in shapes:
        name = name_of(shape)
        gain, strength, held_out = screen.shape(column(shape, last.misfit.observations, last.plant))
        p = p_value(screen.held_out, held_out)
        error = None
        if comparison:
            own = column(shape, validate, last.plant)
            errors = np.concatenate([r.residual for r in comparison.records]) + strength * own
            splits = np.cumsum([len(r.residual) for r in comparison.records])[:-1]
            error = relative_error(np.split(errors, splits), [r.measured for r in comparison.records])
        scored.append(Rejected(name, p, error))
        notes.append(f"{name}: takes {100 * gain:.0f} % of the squared error (p = {p:.1g} on held-out blocks)")
    return replace(found, candidates=(*found.candidates, *scored), notes=(*found.notes, *notes))


def _as_good(step: Step, negligible: float) -> bool:
    """Whether hardly more is left than noise leaves, of all that was fitted and of all that was not.

    The search looks closer: at what the motion determines, of which a coarse encoder may leave little, and known worse
    than the noise.
    """
    ends = [(step.result.error, step.result.floor)]
    if step.comparison is not None:
        ends.append((step.comparison.error, step.comparison.noise_floor))
    return all(error <= max(_CLOSE * floor, negligible) for error, floor in ends)


def _holds(comparisons: Sequence[Comparison], negligible: float) -> bool:
    """Whether the last plant is as good on new records as those before it and near the noise floor, or at it.

    What fits well and does not hold on new records is no explanation, whatever it does to those it was fitted to. Where
    the axis moves less than its encoder resolves nothing holds, and that speaks against no plant.
    """
    if not comparisons:
        return True
    *before, last = comparisons
    error, floor = last.determined
    most = min(_NEAR_FLOOR * floor, *(c.determined[0] for c in before), math.inf)
    return error <= most or _told_beforehand(last, negligible)


def _told_beforehand(comparison: Comparison | None, negligible: float) -> bool:
    """Whether a plant leaves no more than noise of records that it has not seen."""
    return comparison is not None and comparison.error <= max(AT_FLOOR * comparison.noise_floor, negligible)


def _unseen(comparison: Comparison | None, negligible: float) -> str:
    """That new records leave more than noise, and where; empty where they do not."""
    if comparison is None or _told_beforehand(comparison, negligible):
        return ""
    error, floor = comparison.determined
    if error > AT_FLOOR * floor:
        return f"Left is {_elsewhere(comparison)}"
    share = 1 - (error / comparison.error) ** 2
    return (
        f"Of the square that is left of the records that were not fitted {100 * share:.0f} % is where the axis moves "
        "less than its encoder resolves, and no model knows what holds it"
    )


def _contradicted(steps: Sequence[Step], comparisons: Sequence[Comparison]) -> str:
    """That new records leave clearly more with effects than without them, and what the user may do, or show nothing of
    an effect; else empty."""
    if len(comparisons) < len(steps):
        return ""
    errors = [c.determined[0] for c in comparisons]
    best, floor = int(np.argmin(errors)), comparisons[-1].determined[1]
    told = comparisons[-1].score.told
    if errors[-1] <= max(_WORSE * errors[best], AT_FLOOR * floor):
        idle = [k for k in range(1, len(errors)) if errors[k] > max(_CLOSER * errors[k - 1], AT_FLOOR * floor)]
        said = (f"{steps[k].effect} ({told(comparisons[k - 1].error)} without it, {told(comparisons[k].error)} with it)"
                for k in idle)
        return f"The validate records show nothing of {' and of '.join(said)}" if idle else ""
    names = " and ".join(str(s.effect) for s in steps[best + 1 :])
    return (
        f"The validate records contradict {names}: {told(comparisons[-1].error)} of them would be left, "
        f"{told(comparisons[best].error)} without. One with use = \"select\" would have to agree with every choice"
    )


def _elsewhere(comparison: Comparison | None) -> str:
    """What is left of the records that were not fitted, and where that stands."""
    if comparison is None:
        return ""
    error, floor = comparison.determined
    size = f"{comparison.score.told(comparison.error)} of the {comparison.score.of} of the records that were not fitted"
    if error > AT_FLOOR * floor:
        size += f", {error / floor:.2g} times what noise leaves"
    runs = comparison.records
    where = describe(comparison.plant, [r.observation for r in runs], [r.residual for r in runs]) if runs else ""
    return "; ".join(filter(None, (size, where)))


def _other_curve(search: Search) -> str:
    """That friction over speed is not what the plant says, where that would explain a good part of the rest."""
    share = search.bent
    if not share:
        return ""
    return f"friction over speed has another shape than its Stribeck curve ({100 * share:.0f} % of the square)"


def _lowered(text: str) -> str:
    return text[:1].lower() + text[1:]


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
    return (
        f"{step.effect}{instead}: with it {fall} (p = {step.p_value:.1g} on held-out blocks), in {better} of "
        f"{len(step.held_out.by_record)} fit records; {_lowered(effects.find(step.effect).signature)}"
    )
