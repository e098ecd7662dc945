"""The search for what is missing: one effect after another, while it earns its place on data not used to fit it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .compare import Comparison, compare_observations
from .effect import Effect
from .fit import FitResult, Progress, fewer, fit_observations, refine, rough_fit
from .frf_observation import Seen
from .held_out import HeldOut, p_value, scatter
from .inverse import Observation
from .least_squares import nudge
from .misfit import Misfit
from .plant import Plant
from .screen import Candidate, LinearModel, Screen, applicable, cross_validated, determined, is_present, joined
from .speed_curve import curve

Array = NDArray[np.float64]

MOST_EFFECTS = 4  # added in a row
FALSE_DISCOVERY_RATE = 0.01
# An effect must take so much of the squared error on held-out blocks that is not noise: less is not what is missing.
LEAST_SHARE = 0.2
LEAST_GAIN = 0.05  # of all the squared error: less is not told from what the noise is known by
AT_FLOOR = 1.4  # times the noise floor: as good as the sensors, whose noise is known no better
MOST_SCATTER = 0.5  # of an effect around its own prediction, relative to its size: more is not the effect
MOST_ROUNDS = 8  # an effect of several harmonics takes more than one
_CONTENDERS = 6  # candidates that are fitted jointly, roughly
_POINTS = 80  # of frequency responses that contenders are fitted to
_EXPONENTS = (2.0, 0.5, 1.0)  # of Stribeck curves: Gauss's, one with a long tail, and Tustin's
_FORMS: dict[str, tuple[dict[str, float], ...]] = {"asymmetric_friction": ({"stiffening": 1.0}, {"stiffening": 0.0})}
_FINALISTS = 2  # of them, that do something different, fitted to the end
_SAME = 0.9  # cosine between what two candidates do to the residual, above which they do the same
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
        held_out: what is left of each block of the fit records by a fit without it.
    """

    effect: str | None
    result: FitResult
    comparison: Comparison | None = None
    confusable_with: tuple[str, ...] = ()
    p_value: float = float("nan")
    held_out: HeldOut = field(default_factory=lambda: HeldOut(np.empty(0), ()), repr=False)
    evidence: str = ""

    @property
    def validate_error(self) -> float | None:
        """Pooled torque error on the validate records."""
        return None if self.comparison is None else self.comparison.torque_error


class Search:
    """The state of the loop: the steps so far, and what the last round thought of every candidate."""

    def __init__(self, seen: Sequence[Seen], select: Sequence[Seen], start: Plant) -> None:
        self.seen, self.select, self.start = list(seen), list(select), start
        self.steps: list[Step] = []
        self.rejected: list[tuple[str, float, Plant]] = []
        self._false: set[str] = set()  # effects that were added and taken away again

    @property
    def held_out(self) -> HeldOut:
        """What the current plant leaves on held-out blocks."""
        return self.steps[-1].held_out

    @property
    def at_floor(self) -> bool:
        """Whether what the current plant leaves on held-out blocks is as good as noise."""
        return bool(self.held_out.total <= AT_FLOOR**2 * _floor(self.steps[-1].result))

    def first(self, report: Progress) -> None:
        result = fit_observations(self.start, self.seen, progress=report)
        self.seen = list(result.misfit.observations)  # of responses with what the fit has learnt about their points
        self.steps = [Step(None, result, held_out=cross_validated(result.misfit, result.vector))]
        self._bend()

    def add_one(self, report: Progress) -> bool:
        """Adds the effect that earns it most; False where none does."""
        current = self.steps[-1].result
        report(0.0, "screening the catalogue")
        screen = Screen(current.misfit, current.vector)
        scored = [c for c in map(screen.candidate, self._addable) if c is not None]
        scored.sort(key=lambda c: -c.gain)
        p_values = {c.effect.name: p_value(self.held_out, c.held_out) for c in scored}
        plants = {c.effect.name: joined(current.plant, c.effect) for c in scored}

        promising = [c for c in scored if c.gain > _WORTH_A_TRIAL][:_CONTENDERS]
        rough: list[tuple[str, Misfit, Array]] = []
        for i, c in enumerate(promising):
            report(0.2 + 0.5 * i / len(promising), f"trying {c.effect.name}")
            rough.append((c.effect.name, *self._tried(current, c)))
        rough.sort(key=lambda t: _left(t[1], t[2]))
        trials: list[tuple[str, FitResult, HeldOut]] = []
        for i, (name, misfit, x) in enumerate(_finalists(current, rough)):
            report(0.7 + 0.1 * i, f"refitting with {name}")
            result = refine(Misfit(misfit.coordinates.decode(x[: misfit.coordinates.size]), self.seen), x)
            if i == 0 and result.error > AT_FLOOR * result.floor:
                result = min(result, self._afresh(result.plant, name), key=_error)
            trials.append((name, result, cross_validated(result.misfit, result.vector)))
        self._settle_for(trials)
        p_values |= {name: max(p_value(self.held_out, h), self._beyond_speed(name, r)) for name, r, h in trials}
        plants |= {name: r.plant for name, r, _ in trials}
        self.rejected = [(name, p, plants[name]) for name, p in p_values.items() if name not in current.plant]
        return self._accept(trials, p_values)

    def _accept(self, trials: Sequence[tuple[str, FitResult, HeldOut]], p_values: dict[str, float]) -> bool:
        passed = discoveries(p_values)
        earned = [
            (name, result, held_out)
            for name, result, held_out in trials
            if name in passed
            and self._is_worth_it(result, held_out, 0.0 if name in self.steps[-1].result.plant else LEAST_SHARE)
            and is_present(result.plant[name])
            and self._selects(result)
        ]
        if not earned:
            return False
        chosen, others = simplest([t[2] for t in earned], [t[1].misfit.coordinates.size for t in earned])
        name, result, held_out = earned[chosen]
        confusable = tuple(earned[i][0] for i in others)
        if any(s.effect == name for s in self.steps):  # one more of its harmonics: no new cause
            self.steps[-1] = replace(self.steps[-1], result=result, held_out=held_out)
        else:
            self.steps.append(Step(name, result, None, confusable, p_values[name], held_out))
        if self._bend():  # what was chosen beside the wrong curve is chosen again
            self.first(lambda done, message: None)
        return True

    def _bend(self) -> bool:
        """Gives the Stribeck curve another exponent, which no fit frees, where friction over speed asks for it."""
        bent = False
        if self.at_floor or not self.bent:
            return bent
        for effect in self.steps[-1].result.plant.effects:
            for exponent in _EXPONENTS:
                last = self.steps[-1]
                now = last.result.plant[effect.name]
                if now.values.get("stribeck_exponent") in (None, exponent):
                    continue
                other = last.result.plant.replace(now.replace(stribeck_exponent=exponent))
                result = refine(Misfit(other, self.seen), last.result.vector)
                held_out = cross_validated(result.misfit, result.vector)
                if self._is_worth_it(result, held_out) and p_value(self.held_out, held_out) < FALSE_DISCOVERY_RATE:
                    bent = True
                    self.steps[-1] = replace(last, result=result, held_out=held_out)
                    if effect.name in self.start:
                        begun = self.start[effect.name]
                        self.start = self.start.replace(begun.replace(stribeck_exponent=exponent))
        return bent

    def _is_worth_it(self, result: FitResult, held_out: HeldOut, share: float = LEAST_SHARE) -> bool:
        """Whether an effect takes a good part of what noise does not explain; at the noise floor, of everything.

        What distorts the torque also raises the noise that a model without it reports: the lower floor counts. One
        more harmonic of an effect that is there already, no new cause, asks for no `share`.
        """
        before = self.held_out.total
        floor = 0.0 if self.at_floor else min(_floor(self.steps[-1].result), _floor(result))
        return bool(before - held_out.total > max(share * (before - floor), LEAST_GAIN * before))

    def _beyond_speed(self, name: str, result: FitResult) -> float:
        """p value of an effect that changes friction, where friction is any function of speed; 0 for other effects.

        What a sensor reads wrong is the speed of friction too.
        """
        effect = result.plant[name]
        if not (effect.modulates or effect.kind == "sensor") or not self._timed:
            return 0.0
        return p_value(_with_curve(self.steps[-1].result), _with_curve(result))

    @property
    def bent(self) -> float:
        """Share of the squared error on held-out blocks that another shape of friction over speed takes; 0 if none."""
        if not self._timed:
            return 0.0
        left = _with_curve(self.steps[-1].result)
        earned = self._is_worth_it(self.steps[-1].result, left)
        earned = earned and p_value(self.held_out, left) < FALSE_DISCOVERY_RATE
        return 1 - left.total / self.held_out.total if earned else 0.0

    @property
    def _addable(self) -> list[type[Effect]]:
        """The effects that could be added to the current plant and have not been found false."""
        return [e for e in applicable(self.steps[-1].result.plant, self.seen) if e.name not in self._false]

    @property
    def _timed(self) -> bool:
        """Whether anything was measured in time, and so at some speed."""
        return any(isinstance(o, Observation) for o in self.seen)

    def _settle_for(self, trials: Sequence[tuple[str, FitResult, HeldOut]]) -> None:
        """Lets the current plant keep what a trial found for it.

        A joint fit with one effect more can lead out of a local optimum that has nothing to do with the effect;
        that gain is the plant's own and must not be counted for the effect.
        """
        for name, result, held_out in trials[:1]:
            if name not in self.steps[-1].result.plant and self._is_worth_it(result, held_out):
                alone = refine(*_without(result, name))
                if alone.error < self.steps[-1].result.error:
                    again = cross_validated(alone.misfit, alone.vector)
                    self.steps[-1] = replace(self.steps[-1], result=alone, held_out=again)

    def _tried(self, current: FitResult, candidate: Candidate) -> tuple[Misfit, Array]:
        """A rough joint fit with one effect more, from where the plant is; a strong one also from the beginning.

        An effect that has several forms, which no fit chooses from, is tried in each.
        """
        some = fewer(self.seen, _POINTS)
        fits = []
        for form in _FORMS.get(candidate.effect.name, ({},)):
            plant = joined(current.plant, candidate.effect.replace(**form))
            misfit = Misfit(plant, some)
            memories = current.misfit.memories(current.vector, misfit.n_memory)
            fits.append((misfit, nudge(misfit, misfit.vector(plant, memories, current.misfit.skew(current.vector)))))
            if candidate.strong:
                strong = candidate.strong.replace(**form)
                fits.append(rough_fit(self._fresh(plant.replace(strong), strong.name), some))
        return min(fits, key=lambda t: t[0].cost(t[1]))

    def _fresh(self, near: Plant, name: str) -> Plant:
        """The first plant, not fitted, with the effects added so far and one more as they stand in `near`."""
        fresh = self.start
        for added in dict.fromkeys((*(s.effect for s in self.steps if s.effect), name)):
            fresh = fresh.replace(near[added]) if added in fresh else fresh + near[added]
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

    def drop_false(self) -> bool:
        """Takes away again effects that a later one has made superfluous, or that act unlike their prediction.

        Only beside all the others can that be seen: what is still missing would count against what was found first.
        True where there were any: beside the others alone something else may be seen.
        """
        dropped = False
        while len(self.steps) > 1:
            judged = [(k, *self._against(k)) for k in range(len(self.steps) - 1, 0, -1)]
            idle = [j for j in judged if j[3] > FALSE_DISCOVERY_RATE]
            k, without, held_out, _, most = idle[0] if idle else max(judged, key=lambda j: j[4])
            if not idle and most <= MOST_SCATTER:
                break
            step = self.steps[k]
            if not idle:
                self.rejected.append((str(step.effect), step.p_value, self.steps[-1].result.plant))
            kept = [*self.steps[:k], *self.steps[k + 1 :]]
            self.steps = [*kept[:-1], replace(kept[-1], result=without, held_out=held_out)]
            self._false.add(str(step.effect))
            dropped = True
        return dropped

    def _against(self, k: int) -> tuple[FitResult, HeldOut, float, float]:
        """The last plant without the effect of step k, what that leaves, and p value and scatter of the effect."""
        last, name = self.steps[-1], self.steps[k].effect
        assert name is not None
        result, held_out = self.steps[-2].result, self.steps[-2].held_out
        if {e.name for e in result.plant.effects} != {e.name for e in last.result.plant.effects} - {name}:
            result = refine(*_without(last.result, name))
            held_out = cross_validated(result.misfit, result.vector)
        floor = last.result.floor_rows / math.sqrt(last.result.misfit.delivered(last.result.vector))
        # What the fits leave, not what they predict: a block that alone determines an unknown is predicted by chance.
        uneven = scatter(_residual(result), _residual(last.result), floor)
        return result, held_out, p_value(held_out, last.held_out), uneven


def _with_curve(result: FitResult) -> HeldOut:
    """What a linear refit leaves whose friction is any function of speed, see `speed_curve`."""
    misfit, x = result.misfit, result.vector
    model = LinearModel(misfit, x, misfit.residual(x))
    columns = curve(result.plant, misfit.observations) * model.determined[:, None]
    return HeldOut(model.held_out(columns) / np.sqrt(misfit.delivered(x)), misfit.observations)


def _without(result: FitResult, name: str) -> tuple[Misfit, Array]:
    plant = result.plant.without(name)
    misfit = Misfit(plant, result.misfit.observations)
    if misfit.n_memory == result.misfit.n_memory:
        return misfit, misfit.vector(plant, result.misfit.memories(result.vector, misfit.n_memory))
    return misfit, misfit.vector(plant)


def _finalists(current: FitResult, rough: Sequence[tuple[str, Misfit, Array]]) -> list[tuple[str, Misfit, Array]]:
    """The best of the rough fits, best first; one more where the first two do the same to the residual; and the best
    of those that do the same as the first with fewer parameters."""
    before = current.misfit.residual(current.vector)
    after = [misfit.residual(x) for _, misfit, x in rough]
    if any(len(r) != len(before) for r in after):
        return list(rough[:_FINALISTS])  # of responses, fewer points: what they do cannot be set side by side
    changes = [before - r for r in after]
    sizes = [float(np.sqrt(c @ c)) for c in changes]
    alike = [float(changes[0] @ c) > _SAME * sizes[0] * size for c, size in zip(changes, sizes, strict=True)]
    most = _FINALISTS + (len(rough) > _FINALISTS - 1 and all(alike[:_FINALISTS]))
    simpler = (t for t, same in zip(rough[most:], alike[most:], strict=True) if same and t[1].size < rough[0][1].size)
    return [*rough[:most], *itertools.islice(simpler, 1)]


def _error(result: FitResult) -> float:
    return result.error


def _residual(result: FitResult) -> HeldOut:
    """What a fit leaves where the motion determines friction, for a drive that delivers everything."""
    misfit = result.misfit
    rows = misfit.residual(result.vector) * determined(misfit)
    return HeldOut(rows / math.sqrt(misfit.delivered(result.vector)), misfit.observations)


def _left(misfit: Misfit, vector: Array) -> float:
    """Squared residual where the motion determines friction, for a drive that delivers everything [N^2 m^2]."""
    return float(np.sum(misfit.residual(vector)[determined(misfit)] ** 2)) / misfit.delivered(vector)


def _floor(result: FitResult) -> float:
    """The same that sensor noise alone would leave [N^2 m^2]."""
    misfit = result.misfit
    return float(np.sum(result.floor_rows[determined(misfit)] ** 2)) / misfit.delivered(result.vector)


def simplest(held_out: Sequence[HeldOut], sizes: Sequence[int]) -> tuple[int, list[int]]:
    """Which of those that are as good as the best on held-out blocks has the fewest free parameters; and the others.

    As good is what is not told from the best, or leaves hardly more: long records tell apart what makes no difference.

    Args:
        held_out: what each leaves.
        sizes: free parameters of each.
    """
    best = min(held_out, key=lambda h: h.total)
    equal = [
        i
        for i, h in enumerate(held_out)
        if p_value(h, best) > _CONFUSABLE or h.total - best.total < LEAST_GAIN * best.total
    ]
    chosen = min(equal, key=lambda i: (sizes[i], held_out[i].total))
    return chosen, [i for i in equal if i != chosen]


def discoveries(p_values: dict[str, float]) -> set[str]:
    """Names that pass with the false discovery rate controlled over all of them (Benjamini and Hochberg 1995)."""
    ranked = sorted(p_values, key=p_values.__getitem__)
    passed = 0
    for i, name in enumerate(ranked, 1):
        if p_values[name] <= FALSE_DISCOVERY_RATE * i / len(ranked):
            passed = i
    return set(ranked[:passed])
