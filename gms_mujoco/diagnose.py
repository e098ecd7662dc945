"""diagnose: which physical effect a plant is missing, or that none of the known ones is, or that nothing is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from . import effects
from .compare import Comparison, compare_observations, quick_torque_error
from .dataset import Dataset
from .effect import Effect
from .errors import DataError
from .fit import FitResult, Progress, baseline, fit_observations, refine, rough_fit
from .frf_observation import Seen
from .intervals import block_sums
from .inverse import Observation
from .least_squares import nudge
from .misfit import Misfit
from .observe import observe
from .plant import Plant
from .remainder import describe
from .screen import BLOCK, Candidate, Screen, applicable, cross_validated, is_present

Array = NDArray[np.float64]

MOST_EFFECTS = 4  # added in a row
FALSE_DISCOVERY_RATE = 0.01
LEAST_GAIN = 0.2  # of the squared error on held-out blocks (a tenth of the error): less is not worth an effect
AT_FLOOR = 1.4  # times the noise floor: as good as the sensors, whose noise is known no better
NOTHING_LEFT = 1.1  # times the noise floor: below it there is nothing that an effect could explain
_CONTENDERS = 6  # candidates that are fitted jointly, roughly
_FINALISTS = 2  # of them, fitted to the end
_WORTH_A_TRIAL = 0.003  # fall of the squared error in a linear refit, below which a joint one cannot be worth it
_CONFUSABLE = 0.05  # p value above which two refitted candidates are not told apart


@dataclass(frozen=True)
class Step:
    """One plant on the way: the baseline, or the plant before with one effect more.

    Attributes:
        effect: what was added; None for the baseline.
        result: the joint fit.
        comparison: on the validate records, made after every choice; None where there are none.
        evidence: one sentence that a person can check on a plot.
        confusable_with: effects that these records cannot tell from the one added.
        p_value: of the fall of the error on held-out blocks.
        held_out: (blocks,) squared residual of each block of the fit records, left by a fit without it.
    """

    effect: str | None
    result: FitResult
    comparison: Comparison | None = None
    confusable_with: tuple[str, ...] = ()
    p_value: float = float("nan")
    held_out: Array = field(default_factory=lambda: np.empty(0), repr=False)
    evidence: str = ""

    @property
    def validate_error(self) -> float | None:
        """Pooled torque error on the validate records."""
        return None if self.comparison is None else self.comparison.torque_error


@dataclass(frozen=True)
class Rejected:
    """An effect that was tried on the final plant and did not earn its place."""

    effect: str
    p_value: float
    validate_error: float | None = None


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes:
        verdict: "adequate" (the baseline is at the noise floor), "explained" (the effects added bring it there),
            "partly_explained" (they help, something remains) or "unexplained" (nothing known earns its place).
        noise_floor: the torque error that a perfect model would have.
        steps: the baseline, then one for each effect added.
        candidates: what was tried on the final plant and left out.
        remainder: what is left looks like this; empty where nothing is.
        next_experiment: what to measure next, None where there is nothing to settle.
    """

    verdict: str
    noise_floor: float
    steps: tuple[Step, ...]
    candidates: tuple[Rejected, ...] = ()
    remainder: str = ""
    next_experiment: str | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def baseline(self) -> Plant:
        """The plant before anything was added."""
        return self.steps[0].result.plant

    @property
    def plant(self) -> Plant:
        """The final plant."""
        return self.steps[-1].result.plant

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
            "noise_floor": self.noise_floor,
            "bandwidth_hz": max(o.bandwidth for o in self.steps[0].result.misfit.observations),
            "steps": [_step_dict(s, self.plant) for s in self.steps],
            "candidates": [
                {"effect": c.effect, "validate_error": c.validate_error, "p_value": c.p_value}
                for c in self.candidates
            ],
            "remainder": self.remainder or None,
            "next_experiment": self.next_experiment,
        }

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict.replace('_', ' ')}", ""]
        lines.append(f"{'model':32}  {'fit':>8}  {'validate':>8}   torque error in % of the torque")
        for s in self.steps:
            name = "baseline" if s.effect is None else f"+ {s.effect}"
            validate = "-" if s.validate_error is None else f"{100 * s.validate_error:.2f}"
            lines.append(f"{name:32}  {100 * s.result.error:8.2f}  {validate:>8}")
        lines.append(f"{'noise floor':32}  {'':8}  {100 * self.noise_floor:8.2f}")
        for s in self.steps[1:]:
            lines += ["", s.evidence]
            if s.confusable_with:
                lines.append(f"These records cannot tell it from {', '.join(s.confusable_with)}.")
        if self.remainder:
            lines += ["", f"What remains: {self.remainder}"]
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
        out["evidence"] = step.evidence
    return out


def diagnose(runs: Dataset, plant: Plant | None = None, *, progress: Progress | None = None) -> Diagnosis:
    """The whole loop: fit the baseline, find the effect that is missing, add it, refit, until nothing more earns it.

    Every effect of the catalogue is screened at the price of a few replays, the best are refitted jointly with the
    plant. One is added if it lowers the error on blocks of the fit records that its fit has not seen (and on the
    select records where there are some), significantly after control of the false discovery rate over the whole
    catalogue. The validate records are scored once, after the choice.

    Args:
        runs: a measurement set with at least one fit record.
        plant: where to start from; None: the default baseline.
        progress: called with a share in 0..1 and a message.

    Raises:
        DataError: there is nothing to fit.
    """
    report = progress or (lambda done, message: None)
    if not runs.fit:
        raise DataError('no fit records; mark some with use = "fit"')
    start = plant or baseline(runs.inertia, runs.kind)
    report(0.0, "looking at the records")
    seen = observe(runs.fit, start.inertia)
    bandwidth = next((o.bandwidth for o in seen if isinstance(o, Observation)), None)
    select = observe(runs.select, start.inertia, bandwidth) if runs.select else []

    search = _Search(seen, select, start)
    search.first(lambda done, message: report(0.02 + 0.2 * done, f"baseline: {message}"))
    for k in range(MOST_EFFECTS):
        lower, width = 0.22 + 0.6 * k / MOST_EFFECTS, 0.6 / MOST_EFFECTS
        if not search.add_one(lambda done, message, a=lower, b=width: report(a + b * done, message)):  # type: ignore[misc]
            break
    report(0.85, "checking the order")
    search.drop_idle()

    report(0.9, "scoring the validate records")
    last = search.steps[-1].result
    noise = last.noise
    validate = observe(runs.validate, start.inertia, bandwidth, last.plant) if runs.validate else []
    steps = tuple(
        replace(s, comparison=compare_observations(s.result.plant, validate, noise) if validate else None,
                evidence=_evidence(search.steps[i - 1], s) if i else "")
        for i, s in enumerate(search.steps)
    )  # fmt: skip
    comparison = steps[-1].comparison
    rejected = tuple(
        Rejected(name, p, quick_torque_error(trial, validate, comparison) if comparison else None)
        for name, p, trial in search.rejected
    )
    floor = comparison.noise_floor if comparison else steps[-1].result.floor
    report(1.0, "done")
    return _conclude(steps, rejected, floor, search)


def _conclude(steps: tuple[Step, ...], rejected: tuple[Rejected, ...], floor: float, search: _Search) -> Diagnosis:
    last = steps[-1].result
    at_floor = search.error <= AT_FLOOR * last.floor
    added = len(steps) > 1
    verdict = ("explained" if added else "adequate") if at_floor else ("partly_explained" if added else "unexplained")
    remainder = "" if at_floor else describe(last.misfit, last.vector)
    following = None
    confusable = [(s.effect, other) for s in steps for other in s.confusable_with if s.effect]
    if confusable:
        one, other = confusable[0]
        assert one is not None
        following = (
            f"To tell {one} from {other}: {_lowered(effects.find(one).experiment)} "
            f"For {other}: {_lowered(effects.find(other).experiment)}"
        )
    elif not at_floor and rejected:
        likely = min(rejected, key=lambda r: r.p_value)
        experiment = _lowered(effects.find(likely.effect).experiment)
        following = f"Nothing known explains the rest. {likely.effect} came closest: {experiment}"
    return Diagnosis(verdict, floor, steps, rejected, remainder, following)


def _lowered(text: str) -> str:
    return text[:1].lower() + text[1:]


class _Search:
    """The state of the loop: the steps so far, and what the last round thought of every candidate."""

    def __init__(self, seen: Sequence[Seen], select: Sequence[Seen], start: Plant) -> None:
        self.seen, self.select, self.start = list(seen), list(select), start
        self.steps: list[Step] = []
        self.rejected: list[tuple[str, float, Plant]] = []

    @property
    def held_out(self) -> Array:
        """(blocks,) squared residuals of the current plant on held-out blocks."""
        return self.steps[-1].held_out

    @property
    def error(self) -> float:
        """Torque error on held-out blocks of the current plant."""
        result = self.steps[-1].result
        return result.error * float(np.sqrt(self.held_out.sum() / max(result.misfit.cost(result.vector), 1e-300)))

    def first(self, report: Progress) -> None:
        result = fit_observations(self.start, self.seen, progress=report)
        self.steps.append(Step(None, result, held_out=cross_validated(result.misfit, result.vector)))

    def add_one(self, report: Progress) -> bool:
        """Adds the effect that earns it most; False where none does."""
        current = self.steps[-1].result
        report(0.0, "screening the catalogue")
        screen = Screen(current.misfit, current.vector)
        scored = [c for c in map(screen.candidate, applicable(current.plant, self.seen)) if c is not None]
        scored.sort(key=lambda c: -c.gain)
        p_values = {c.effect.name: _p_value(self.held_out, c.held_out) for c in scored}
        plants = {c.effect.name: current.plant + c.effect for c in scored}

        promising = [c for c in scored if c.gain > _WORTH_A_TRIAL][:_CONTENDERS]
        rough: list[tuple[str, Misfit, Array]] = []
        for i, c in enumerate(promising):
            report(0.2 + 0.5 * i / len(promising), f"trying {c.effect.name}")
            rough.append((c.effect.name, *self._tried(current, c)))
        rough.sort(key=lambda t: t[1].cost(t[2]))
        trials: list[tuple[str, FitResult, Array]] = []
        for i, (name, misfit, x) in enumerate(rough[:_FINALISTS]):
            report(0.7 + 0.1 * i, f"refitting with {name}")
            result = refine(misfit, x)
            if i == 0 and result.error > AT_FLOOR * result.floor:
                result = min(result, self._afresh(result.plant, name), key=_error)
            trials.append((name, result, cross_validated(result.misfit, result.vector)))
        self._settle_for(trials)
        p_values |= {name: _p_value(self.held_out, h) for name, _, h in trials}
        plants |= {name: r.plant for name, r, _ in trials}
        self.rejected = [(name, p, plants[name]) for name, p in p_values.items()]
        # What distorts the torque also raises the noise that a model without it reports: the lowest floor counts.
        if self.error <= NOTHING_LEFT * min(r.floor for r in (self.steps[-1].result, *(t[1] for t in trials))):
            return False
        return self._accept(trials, p_values)

    def _accept(self, trials: Sequence[tuple[str, FitResult, Array]], p_values: dict[str, float]) -> bool:
        passed = _discoveries(p_values)
        earned = [
            (name, result, held_out)
            for name, result, held_out in trials
            if name in passed
            and held_out.sum() < (1 - LEAST_GAIN) * self.held_out.sum()
            and is_present(result.plant[name])
            and self._selects(result)
        ]
        if not earned:
            return False
        # Of those that are as good as the best the one with the fewest free parameters.
        best = min(earned, key=lambda t: t[2].sum())
        equal = [t for t in earned if _p_value(t[2], best[2]) > _CONFUSABLE]
        name, result, held_out = min(equal, key=lambda t: (t[1].misfit.coordinates.size, t[2].sum()))
        confusable = tuple(t[0] for t in equal if t[0] != name)
        self.steps.append(Step(name, result, None, confusable, p_values[name], held_out))
        return True

    def _settle_for(self, trials: Sequence[tuple[str, FitResult, Array]]) -> None:
        """Lets the current plant keep what a trial found for it.

        A joint fit with one effect more can lead out of a local optimum that has nothing to do with the effect;
        that gain is the plant's own and must not be counted for the effect.
        """
        for name, result, held_out in trials[:1]:
            if held_out.sum() < (1 - LEAST_GAIN) * self.held_out.sum():
                alone = refine(*_without(result, name))
                if alone.error < self.steps[-1].result.error:
                    again = cross_validated(alone.misfit, alone.vector)
                    self.steps[-1] = replace(self.steps[-1], result=alone, held_out=again)

    def _tried(self, current: FitResult, candidate: Candidate) -> tuple[Misfit, Array]:
        """A rough joint fit with one effect more, from where the plant is; a strong one also from the beginning."""
        plant = current.plant + candidate.effect
        misfit = Misfit(plant, self.seen)
        memories = current.misfit.memories(current.vector, misfit.n_memory)
        x = nudge(misfit, misfit.vector(plant, memories, current.misfit.skew(current.vector)))
        if not candidate.strong:
            return misfit, x
        other = rough_fit(self._fresh(plant.replace(candidate.strong), candidate.strong.name), self.seen)
        return min(((misfit, x), other), key=lambda t: t[0].cost(t[1]))

    def _fresh(self, near: Plant, name: str) -> Plant:
        """The first plant, not fitted, with the effects added so far and one more as they stand in `near`."""
        fresh = self.start
        for added in (*(s.effect for s in self.steps if s.effect), name):
            fresh = fresh + near[added]
        return fresh

    def _afresh(self, near: Plant, name: str) -> FitResult:
        """The same joint fit from the beginning: a plant that has bent far to hide an effect may not find back."""
        return fit_observations(self._fresh(near, name), self.seen)

    def _selects(self, result: FitResult) -> bool:
        """Whether the select records, where there are some, agree."""
        if not self.select:
            return True
        before, after = (
            compare_observations(p, self.select).torque_error for p in (self.steps[-1].result.plant, result.plant)
        )
        return after < before

    def drop_idle(self) -> None:
        """Takes away again an effect that a later one has made superfluous."""
        for k in range(len(self.steps) - 2, 0, -1):
            name = self.steps[k].effect
            assert name is not None
            last = self.steps[-1]
            without = refine(*_without(last.result, name))
            held_out = cross_validated(without.misfit, without.vector)
            if _p_value(held_out, last.held_out) > FALSE_DISCOVERY_RATE:
                final = replace(last, result=without, held_out=held_out)
                self.steps = [*self.steps[:k], *self.steps[k + 1 : -1], final]


def _evidence(before: Step, step: Step) -> str:
    """One sentence that can be checked on a plot."""
    assert step.effect is not None
    observations = step.result.misfit.observations
    pairs = zip(_by_record(observations, before.held_out), _by_record(observations, step.held_out), strict=True)
    better = sum(b.sum() < a.sum() for a, b in pairs)
    return (
        f"{step.effect}: with it the torque error falls from {100 * before.result.error:.2f} % to "
        f"{100 * step.result.error:.2f} % (p = {step.p_value:.1g} on held-out blocks), in {better} of "
        f"{len(observations)} fit records; {_lowered(effects.find(step.effect).signature)}"
    )


def _without(result: FitResult, name: str) -> tuple[Misfit, Array]:
    plant = result.plant.without(name)
    misfit = Misfit(plant, result.misfit.observations)
    if misfit.n_memory == result.misfit.n_memory:
        return misfit, misfit.vector(plant, result.misfit.memories(result.vector, misfit.n_memory))
    return misfit, misfit.vector(plant)


def _error(result: FitResult) -> float:
    return result.error


def _by_record(observations: Sequence[Seen], blocks: Array) -> list[Array]:
    counts = [len(block_sums([o], np.ones((len(o.index), 1)), BLOCK)) for o in observations]
    return np.split(blocks, np.cumsum(counts)[:-1])


def _p_value(before: Array, after: Array) -> float:
    """Of the hypothesis that the squared error of the blocks does not fall, by a one-sided t-test.

    On the logarithm of the ratio: an effect that acts at high speed makes a few blocks fall so far that their mean
    would hide how surely they do.
    """
    fall = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    if len(fall) < 3 or not np.any(np.abs(fall) > 1e-9):
        return 1.0
    return float(stats.ttest_1samp(fall, 0.0, alternative="greater").pvalue)


def _discoveries(p_values: dict[str, float]) -> set[str]:
    """Names that pass with the false discovery rate controlled over all of them (Benjamini and Hochberg 1995)."""
    ranked = sorted(p_values, key=p_values.__getitem__)
    passed = 0
    for i, name in enumerate(ranked, 1):
        if p_values[name] <= FALSE_DISCOVERY_RATE * i / len(ranked):
            passed = i
    return set(ranked[:passed])
