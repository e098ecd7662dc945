"""The search for what is missing: one effect after another, while it earns its place on data not used to fit it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..compare import compare_observations
from ..effect import Effect
from ..fit import fit_as_logged
from ..fit_result import FitResult
from ..identification.candidates import applicable, is_open, joined
from ..identification.frf_observation import FrfObservation, Seen
from ..identification.habits import EARLY_SHARE, as_logged
from ..identification.held_out import HeldOut, p_value
from ..identification.inverse import Observation
from ..identification.least_squares import nudge
from ..identification.linear_model import cross_validated
from ..identification.misfit import Misfit
from ..identification.refine import CLOSE_TO_FLOOR, refine
from ..identification.screen import Candidate, Screen
from ..plant import Plant
from ..progress import Progress, silent
from .beyond import Hint, beyond
from .friction_shape import (
    by_the_letter,
    elastic_bristle,
    fading_damping,
    later_elements,
    more_elements,
    other_curve,
    plastic_bristle,
    shaped_as,
    without_idle,
)
from .joint_fits import FORMS, LIMITS, JointFits, Rough
from .judgement import (
    AT_FLOOR,
    CLOSE,
    FALSE_DISCOVERY_RATE,
    FINALISTS,
    LEAST_GAIN,
    LEAST_SHARE,
    Trial,
    at_floor,
    carries,
    discoveries,
    finalists,
    floor_of,
    is_told,
    is_worth_it,
    least_share,
    leaves_much_less,
    left_of,
    most_of_use,
    simplest,
    swings,
    takes_of_both,
    with_curve,
    without,
)
from .moments import has_moments
from .openings import DRAG, afresh, beside_following, beside_straight, for_stuck, general_laws, straight
from .pairs import TwoAtOnce
from .patience import Patience
from .reading import TorqueReading, ring
from .steps import Step, Tried
from .trials import beside_contained, beside_load, is_needless, p_beside, surer
from .waves import as_one_wave

Array = NDArray[np.float64]

MOST_EFFECTS = 4  # added in a row
MOST_ROUNDS = 8  # an effect of several harmonics takes more than one
_CONTENDERS = 6  # candidates that are fitted jointly, roughly
_WORTH_A_TRIAL = 0.003  # fall of the squared error in a linear refit, below which a joint one cannot be worth it
_MOST = 0.5  # of the squared error: beside an effect that surely takes more, others have to promise something too,
_RIVALS = 0.25  # so much of what it promises where they may do so by chance
_BY_CHANCE = 0.05  # p value of that, above which it has to promise at the noise floor all that a joint one must take
_HALF = 0.5  # of the squared error that the first takes: a rough fit that takes less is no rival of it
_LED_ON = 0.9  # times the error of a fit: another curve of friction may show there that had not


class Search:
    """The state of the loop: the steps so far, and what the last round thought of every candidate.

    Args:
        seen: what is fitted.
        select: what has to agree with a choice; may be empty.
        start: to begin with.
        without: names of effects that are not looked at.
        quick: whether it follows what it sees alone: nothing is tried from the beginning, and no path not taken.
        patience: how far it goes; None: to its end.
    """

    def __init__(
        self, seen: Sequence[Seen], select: Sequence[Seen], start: Plant, without: Collection[str] = (),
        quick: bool = False, patience: Patience | None = None,
    ) -> None:  # fmt: skip
        self.seen, self.select, self.start, self.without = list(seen), list(select), start, without
        self.quick, self.patience = quick, patience or Patience()
        self.steps: list[Step] = []
        self.rejected: list[Tried] = []
        self.false: set[str] = set()  # effects that were added and taken away again
        self.hint: Hint | None = None  # what explains more than anything in the catalogue
        self.waits = False  # whether another curve of friction does, see `shape`
        self._shaped_at = 0.0  # error of the last fit whose shape of friction was looked for
        self._formed: set[frozenset[str]] = set()  # effects together, of which each has the form that leaves least

    @property
    def fits(self) -> JointFits:
        """How the current plant is fitted with one effect more."""
        added = frozenset(s.effect for s in self.steps if s.effect)
        return JointFits(self.start, tuple(self.seen), added, self.patience)

    @property
    def held_out(self) -> HeldOut:
        """What the current plant leaves on held-out blocks."""
        return self.steps[-1].held_out

    @property
    def at_floor(self) -> bool:
        """Whether what the current plant leaves on held-out blocks is as good as noise."""
        return at_floor(self.steps[-1].result, self.held_out)

    def branch(self, number: int, trial: Trial) -> Search:
        """Another search, which took another effect at one step and is there now."""
        out, before = copy(self), self.steps[number - 1]
        p = p_value(before.held_out, trial.held_out)
        out.steps = [*self.steps[:number], Step(trial.name, trial.result, None, (), p, trial.held_out)]
        out.seen, out.rejected, out.false, out.hint, out.waits = list(self.seen), [], set(), None, False
        out._formed = set(self._formed)
        return out

    def left_out(self) -> list[tuple[str, float, Plant | None]]:
        """Effects that were left out, their p values, and the plants with them; None where an effect that was never
        fitted jointly leaves no less of what was fitted than the plant without it."""
        last = self.steps[-1].result
        cost = last.misfit.cost(last.vector)

        def plant(tried: Tried) -> Plant | None:
            if tried.fitted:
                return tried.plant
            # Beside the plant as it has ended, whose friction may have other elements.
            effect = tried.plant[tried.name]
            beside = last.plant.replace(effect) if tried.name in last.plant else last.plant + effect
            near, x = last.misfit.onto(beside, last.vector)
            return beside if near.cost(x) < cost else None

        return [(t.name, t.p_value, plant(t)) for t in self.rejected]

    def become(self, other: Search) -> None:
        """Goes on where another search has ended."""
        vars(self).update(vars(other))

    def first(self, report: Progress) -> None:
        result = fit_as_logged(self.start, self.seen, report)
        self.patience.begin(result)
        for e in filter(is_open, self.start.effects):
            self.start = self.start.replace(result.plant[e.name])
        self.seen = list(result.misfit.observations)  # of responses with what the fit has learnt about their points
        self.steps = [Step(None, result, held_out=cross_validated(result.misfit, result.vector))]
        self.shape()

    def within_reach(self, least: float = math.inf) -> float:
        """Squared residual that the current plant would leave with the effect that promises most, by a linear refit
        [N^2 m^2]; see `left_of`. Infinite where more than `least` would be left of its loudest record, even if that
        were all that there is to explain."""
        current = self.steps[-1].result
        misfit, x = current.misfit, current.vector
        if math.isfinite(least) and self.with_one_more(*misfit.part(x, misfit.loudest(x)[:1])) > least:
            return math.inf
        return self.with_one_more(misfit, x)

    def with_one_more(self, misfit: Misfit, x: Array) -> float:
        """The same beside a vector of another problem, of a plant with the same effects."""
        gains = [c.gain for c in self._candidates(Screen(misfit, x))]
        return (1 - max(gains, default=0.0)) * left_of(misfit, x)

    def likeliest_beside(self, columns: Array) -> Effect | None:
        """The effect that leaves least in a linear refit in which torques (m, k) are free too; None where none can."""
        current = self.steps[-1].result
        screen = Screen(current.misfit, current.vector)
        found = [c for c in self._candidates(screen) if c.columns is not None]
        return max(found, key=lambda c: screen.explained(c, columns)).effect if found else None

    def add_one(self, report: Progress, law: FitResult | None = None) -> bool:
        """Adds the effect that earns it most; False where none does, or what is in no catalogue leaves much less.

        Args:
            report: called with a share in 0..1 and a message.
            law: a fit with another law of friction, which is gone on with where this adds nothing: effects are then
                looked for beside that, and here only what may come closer than it, and not from the beginning.
        """
        current, fits = self.steps[-1].result, self.fits
        report(0.0, "screening the catalogue")
        screen = Screen(current.misfit, current.vector)
        scored = sorted(self._candidates(screen), key=lambda c: -c.gain)
        p_values = {c.effect.name: p_value(self.held_out, c.held_out) for c in scored}
        plants = {c.effect.name: joined(current.plant, c.effect) for c in scored}
        if law is not None and self._promises_less(scored, law):
            return False

        promising = self._promising(scored, p_values)[:_CONTENDERS]
        rough: list[Rough] = []
        for i, c in enumerate(promising):
            report(0.2 + 0.5 * i / len(promising), f"trying {c.effect.name}")
            rough.append((c.effect.name, *fits.roughly(current, c, fits.worth_trying(current, rough))))
            rough += fits.gliding(current, c, rough[-1])
        rough += [r for r in (*fits.limits(current, rough), *fits.opened(current, rough)) if r[0] in p_values]
        if self.timed:
            rough += beside_straight(current, fits, self._addable, fits.worth_trying(current, rough))
            rough += for_stuck(current, self._addable, fits.worth_trying(current, rough))
        laws: list[Rough] = []
        if not (self.at_floor or fits.simulated):
            laws = general_laws(current, fits, self.barred, fits.worth_trying(current, rough))
        plants |= {name: misfit.plant(x) for name, misfit, x in laws}
        on_all = {name: cross_validated(Misfit(plants[name], self.seen), x) for name, _, x in laws}
        p_values |= {name: p_value(self.held_out, left) for name, left in on_all.items()}
        rough += laws
        trials = self._trials(rough, p_values, report)
        self.hint = unlisted = self._beyond(trials)
        added = False
        if unlisted is None:
            if self._reads_a_ring(trials):
                swinging = [name for name, plant in plants.items() if swings(plant[name])]
                p_values |= dict.fromkeys(swinging, 1.0)
                promising = [c for c in promising if c.effect.name not in swinging]
            new = [c for c in promising if c.effect.name not in current.plant]
            added = self._accept(trials, p_values) or self._accept_two(screen, new, rough, trials, p_values)
            for more in (self._beside_following, lambda: self._afresh(new, report)):
                if not added and law is None and (begun := more()):
                    trials += self._trials(begun, p_values, report)
                    added = self._accept(trials, p_values)
        fitted = {name: r.plant for name, r, _ in trials}
        plants |= fitted
        self.rejected = [
            Tried(name, p, plants[name], name in fitted) for name, p in p_values.items() if name not in current.plant
        ]
        if added or unlisted is not None:
            return added
        if not self.at_floor and self.relogged():  # the plant may have been led to where a habit shows
            self._seen_anew()
            return True
        if law is not None:
            return False
        again = self.waits or self.steps[-1].result.error < _LED_ON * self._shaped_at
        return self._drag_for_curve() or self._refined() or (again and self.shape(at_last=True))

    def _promises_less(self, scored: Sequence[Candidate], law: FitResult) -> bool:
        """Whether another law of friction leaves much less than the plant, and less than a linear refit with any of the
        candidates."""
        now = self.steps[-1].result
        most = max((c.gain for c in scored), default=0.0)
        least = (1 - most) * left_of(now.misfit, now.vector)
        return leaves_much_less(now, law) and left_of(law.misfit, law.vector) < least

    def _promising(self, scored: Sequence[Candidate], p_values: dict[str, float]) -> list[Candidate]:
        """The candidates of which a joint fit could be worth it, by their gains and p values in the linear refit.

        Above the noise floor a trial may also lead the plant out of a local optimum, see `_settle_for`: there what
        promises little is tried too, unless one surely takes most. What is left beside that is for the next round. What
        stands in single moments once an effect was found is as good as noise: where it is, any effect is by chance.
        """
        leads = bool(scored) and scored[0].gain > _MOST and p_values[scored[0].effect.name] <= FALSE_DISCOVERY_RATE
        as_noise = self.at_floor or (len(self.steps) > 1 and has_moments(self.steps[-1].result, self.held_out))
        by_chance = LEAST_GAIN if as_noise else _RIVALS * scored[0].gain if leads else _WORTH_A_TRIAL
        return [c for c in scored if c.gain > (by_chance if p_values[c.effect.name] > _BY_CHANCE else _WORTH_A_TRIAL)]

    def _trials(self, rough: Sequence[Rough], p_values: dict[str, float], report: Progress) -> list[Trial]:
        """The best of the rough fits taken to their ends; their p values become those of the whole fits."""
        fits, current = self.fits, self.steps[-1].result
        rough = sorted(rough, key=lambda t: left_of(t[1], t[2]))
        if fits.simulated:
            # A few runs that fall to the other side may carry a fit, and hold nowhere else: what passes the test of the
            # screen is refitted before what fits best.
            rough[1:] = sorted(rough[1:], key=lambda t: p_values[t[0]])
        trials: list[Trial] = []
        earns = False  # the first of them its place
        best = [t for i, t in enumerate(rough) if t[0] not in [other[0] for other in rough[:i]]]
        held = [t for t in best if self._holds_roughly(t)] if self.at_floor and self.only_timed else best
        ends = finalists(current, held, FINALISTS + fits.simulated)
        ends = self._limit_instead(ends, best)
        ends += surer(best, ends, p_values)
        for i, (name, misfit, x) in enumerate(ends):
            if i == 1:
                earns = self._earns(trials[0])
            if earns and self.patience.is_at_end:
                break
            if earns and self._is_no_rival(misfit, x, trials[0]):
                continue
            report(0.7 + 0.1 * i, f"refitting with {name}")
            if trials:
                result = fits.to_end(misfit, x, self._of_use(trials[0], misfit, len(p_values)))
            else:
                result = fits.leading(name, current, rough)
            result = without_idle(result)
            trials.append(Trial(name, result, cross_validated(result.misfit, result.vector)))
        self._settle_for(trials)
        p_values |= {t.name: p_beside(self.steps[-1].result, self.held_out, t) for t in trials}
        return trials

    def _limit_instead(self, ends: list[Rough], rough: Sequence[Rough]) -> list[Rough]:
        """The same rough fits; where the first plays, and what it is without a play takes nearly as much and comes down
        to the noise floor, that in its place: a play has no more to say, and each look at one is long."""
        if not ends:
            return ends
        (name, misfit, x), current = ends[0], self.steps[-1].result
        most = most_of_use(left_of(current.misfit, current.vector), left_of(misfit, x))
        close = [t for t in rough if LIMITS.get(t[0]) == name and left_of(t[1], t[2]) <= most]
        for special, near, there in close if name not in current.plant else []:
            found = self.fits.whole(current, near, there)
            if found.error <= AT_FLOOR * found.floor:
                return [(special, found.misfit, found.vector), *(t for t in ends if t[0] not in (special, name))]
        return ends

    def _is_no_rival(self, misfit: Misfit, x: Array, first: Trial) -> bool:
        """Whether a rough fit has taken less than half of what the first, which earns its place, takes down to near the
        noise floor: at its end it takes no more."""
        if self.at_floor or not at_floor(first.result, first.held_out, CLOSE_TO_FLOOR):
            return False
        before, least = (left_of(r.misfit, r.vector) for r in (self.steps[-1].result, first.result))
        return before - left_of(misfit, x) < _HALF * (before - least)

    def _holds_roughly(self, rough: Rough) -> bool:
        """Whether a rough fit leaves less of blocks not seen than the plant without its effect, by more than chance.

        At the noise floor a rough fit is near its end, and noise is most of what unknowns take.
        """
        _, misfit, x = rough
        return p_value(self.held_out, cross_validated(misfit, x)) <= _BY_CHANCE

    def _drag_for_curve(self) -> bool:
        """Puts a drag in the place of a curve that stands for it at the noise floor, where little or nothing is left
        that the drag could take; False where it earns no place. See `straightened`.

        It does where it leaves less than the curve of all that is fitted, and of blocks not seen surely less, with no
        more unknowns; and beside friction that does not stand for it, it has to take its share of what is left.
        """
        now = self.steps[-1]
        if not (self.at_floor and self.only_timed) or (begun := straight(now.result, self._addable)) is None:
            return False
        *plants, fixed = begun

        def fitted(plant: Plant) -> tuple[FitResult, HeldOut]:
            misfit, x = now.result.misfit.onto(plant, now.result.vector, fixed=fixed)
            result = refine(misfit, nudge(misfit, x))
            return result, cross_validated(result.misfit, result.vector)

        result, held_out = fitted(plants[1])
        leaves_less = left_of(result.misfit, result.vector) <= left_of(now.result.misfit, now.result.vector)
        if not leaves_less or p_value(now.held_out, held_out) > FALSE_DISCOVERY_RATE or not self.selects(result):
            return False
        base, before = fitted(plants[0])
        floor = min(floor_of(base), floor_of(result))
        p = p_beside(base, before, Trial(DRAG, result, held_out))
        if p > FALSE_DISCOVERY_RATE or not takes_of_both(base, before, result, held_out, floor, LEAST_SHARE):
            return False
        last = self.fits.to_end(*result.misfit.onto(result.plant, result.vector))
        self.steps[-1] = replace(now, result=base, held_out=before)
        self.steps.append(Step(DRAG, last, None, (), p, cross_validated(last.misfit, last.vector)))
        return True

    def _beside_following(self) -> list[Rough]:
        """Rough fits beside friction that follows its level, see `openings`; none at the noise floor."""
        if self.at_floor or self.fits.simulated:
            return []
        return beside_following(self.steps[-1].result, self.fits, self._addable)

    def _afresh(self, candidates: Sequence[Candidate], report: Progress) -> list[Rough]:
        """Rough fits from the beginning, see `openings`; none at the noise floor."""
        if self.at_floor or self.fits.simulated or self.quick or self.patience.is_short:
            return []
        return afresh(self.steps[-1].result, self.fits, candidates, report)

    def _beyond(self, trials: Sequence[Trial]) -> Hint | None:
        """What is in no catalogue and leaves much less than the best of the trials, short of the noise floor."""
        if not trials or self.at_floor or not self.only_timed:
            return None
        best = min(trials, key=lambda t: t.held_out.total)
        if at_floor(best.result, best.held_out):
            return None
        return beyond(self.steps[-1].result, self.held_out, best)

    def _reads_a_ring(self, trials: Sequence[Trial]) -> bool:
        """Whether a torque reading that rings explains more than an axis of which a part swings; says so in `hint`."""
        swinging = [t for t in trials if swings(t.result.plant[t.name]) and self.is_worth_it(t.result, t.held_out)]
        if not swinging or not self.only_timed:
            return False
        if not self.at_floor and any(t.result.error <= AT_FLOOR * t.result.floor for t in swinging):
            return False
        now = self.steps[-1].result
        said = ring(now.misfit, now.vector, self.held_out, [t.held_out for t in swinging])
        if said:
            self.hint = Hint(said, TorqueReading.experiment)
        return bool(said)

    def _accept(self, trials: Sequence[Trial], p_values: dict[str, float]) -> bool:
        passed = discoveries(p_values)
        now = self.steps[-1]
        earned = beside_contained([t for t in trials if t.name in passed and self._earns(t)])
        earned = beside_load(earned, self.seen)
        if not earned:
            return False
        left, *after = (left_of(r.misfit, r.vector) for r in (now.result, *(t.result for t in earned)))
        if self.relogged(EARLY_SHARE * (1 - min(after) / left)):  # a weak effect may stand for what is the log's habit
            self.first(silent)
            return True
        chosen, others = simplest(earned)
        name, result, held_out = earned[chosen]
        if name in FORMS and name != trials[0].name:  # the form of the first alone was looked at again
            result = self.fits.formed(name, result)
            held_out = cross_validated(result.misfit, result.vector)
        confusable = tuple(earned[i].name for i in others)
        if any(s.effect == name for s in self.steps):  # one more of its harmonics: no new cause
            self.steps[-1] = replace(now, result=result, held_out=held_out)
        else:
            rest = tuple(t for t in earned if t.name != name and t.name not in now.result.plant)
            # A general law of friction takes the place of what it contains.
            self.steps = [s for s in self.steps if s.effect is None or s.effect in result.plant]
            self.steps.append(Step(name, result, None, confusable, p_values[name], held_out, others=rest))
        if self.shape() and self._is_needless(name):
            self.first(silent)
        elif self.relogged():
            self._seen_anew()
        return True

    def _accept_two(
        self, screen: Screen, candidates: Sequence[Candidate], rough: Sequence[Rough], trials: Sequence[Trial],
        p_values: dict[str, float],
    ) -> bool:  # fmt: skip
        """Adds two effects at once that earn their places beside each other; False where none do."""
        if self.at_floor or len(self.steps) >= MOST_EFFECTS:
            return False
        now = self.steps[-1].result
        two = TwoAtOnce(now, self.fits, screen, rough, trials, p_values, self.selects)
        both = two.of(candidates)
        if both is None and trials and not self.fits.simulated:
            both = two.beside(min(trials, key=lambda t: t.held_out.total), self._addable)
        if both is None:
            return False
        self.steps += both
        if self.shape() and any(self._is_needless(str(s.effect)) for s in both):
            self.first(silent)
        return True

    def _is_needless(self, name: str) -> bool:
        """Whether an effect that was found earns no place beside the curve of friction that the plant has now."""
        return is_needless(name, self.steps[-1].result, self.held_out)

    def _earns(self, trial: Trial) -> bool:
        """Whether a joint fit with one effect more is better than the current plant by all but its p value."""
        now = self.steps[-1].result
        share = least_share(now.plant, trial.result.plant[trial.name])
        worth = self.is_worth_it(trial.result, trial.held_out, share)
        if not (worth and carries(trial.name, now, trial.result) and self.selects(trial.result)):
            return False
        # A response knows no place: of what varies with it only some combination of strength and phase is seen.
        return not all(isinstance(o, FrfObservation) for o in self.seen) or is_told(trial.name, trial.result)

    def shape(self, at_last: bool = False) -> bool:
        """Gives friction elements that slip later, another reading of its law, another curve and more elements where
        they earn it; whether it has any of these but more elements.

        A curve that bends at will hides a part of an effect, a drag most of it, an element that slips late a part of a
        spring. What leaves more than an effect would beside the present friction waits, until `at_last` no effect is
        found.
        """
        last = self.steps[-1]
        if not self.timed:
            return False
        begun, before = last.result, last.held_out
        late = later_elements(begun, before)
        hides = late[0] is not begun and not at_last and self._explains_more(begun, before, late[1])
        bends = elastic_bristle(*by_the_letter(*((begun, before) if hides else late)))
        read, left = fading_damping(*plastic_bristle(*bends))
        bent, best = other_curve(read, left)
        self.waits = hides or (bent is not read and not at_last and self._explains_more(read, left, best))
        result, held_out = (read, left) if self.waits else more_elements(bent, best)
        self.steps[-1] = replace(last, result=result, held_out=held_out)
        self._shaped_at = result.error
        for e in self.start.effects:
            if e.name in result.plant:
                self.start = self.start.replace(shaped_as(e, result.plant[e.name]))
        return (read if self.waits else bent) is not last.result

    def reformed(self) -> bool:
        """Gives the effects that were added the forms that leave least beside each other; whether any has another.

        The form of one was chosen while what was found later was missing, or beside what was none.
        """
        names = frozenset(e.name for e in self.steps[-1].result.plant.effects)
        alone = len(self.steps) == 2 and not self.false
        if self.patience.is_at_end or alone or names in self._formed:
            return False
        self._formed.add(names)
        before = self.steps[-1]
        result = before.result
        for name in (s.effect for s in self.steps if s.effect in FORMS):
            result = self.fits.formed(name, result)
        if result.error**2 > (1 - LEAST_GAIN) * before.result.error**2:
            return False
        self.steps[-1] = replace(before, result=result, held_out=cross_validated(result.misfit, result.vector))
        return True

    def as_one_wave(self) -> None:
        """Gives effects over a part of the revolution the one wave that explains as much, see `waves`."""
        last = self.steps[-1]
        if self.only_timed and (result := as_one_wave(last.result)):
            self.steps[-1] = replace(last, result=result, held_out=cross_validated(result.misfit, result.vector))

    def _refined(self) -> bool:
        """Gives friction more elements where they earn it from where a trial has led the plant; whether it has any."""
        last = self.steps[-1]
        if not self.timed:
            return False
        result, held_out = more_elements(last.result, last.held_out)
        self.steps[-1] = replace(last, result=result, held_out=held_out)
        return result is not last.result

    def _explains_more(self, now: FitResult, left: HeldOut, most: HeldOut) -> bool:
        """Whether a linear refit with an effect more surely leaves less of each block than another fit does."""
        found = [c.held_out for c in self._candidates(Screen(now.misfit, now.vector))]
        return any(h.total < most.total and p_value(left, h) <= FALSE_DISCOVERY_RATE for h in found)

    def relogged(self, share: float = EARLY_SHARE) -> bool:
        """Sees the log by another of its habits, where that explains what an effect has hidden, or may stand for."""
        seen = as_logged(self.steps[-1].result, share=share)
        self.seen = seen or self.seen
        return seen is not None

    def _seen_anew(self) -> None:
        """Stays with what was found beside another habit of the log, where that is all; else begins again beside this
        one, of which it may have stood for a part."""

        def again(step: Step) -> Step:
            before = step.result
            result = self.fits.to_end(*before.misfit.onto(before.plant, before.vector, self.seen, skew=0.0))
            return replace(step, result=result, held_out=cross_validated(result.misfit, result.vector))

        last = again(self.steps[-1])
        if len(self.steps) > 1 and at_floor(last.result, last.held_out):
            self.steps = [*map(again, self.steps[:-1]), last]
        else:
            self.first(silent)

    def is_worth_it(self, result: FitResult, held_out: HeldOut, share: float = LEAST_SHARE) -> bool:
        """Whether a fit with one effect more takes enough of what the current plant leaves; see `judgement`."""
        return is_worth_it(self.steps[-1].result, self.held_out, result, held_out, share)

    @property
    def bent(self) -> float:
        """Share of the squared error on held-out blocks that another shape of friction over speed takes; 0 if none."""
        if not self.timed:
            return 0.0
        left = with_curve(self.steps[-1].result)
        earned = self.is_worth_it(self.steps[-1].result, left)
        earned = earned and p_value(self.held_out, left) < FALSE_DISCOVERY_RATE
        return 1 - left.total / self.held_out.total if earned else 0.0

    def _candidates(self, screen: Screen) -> list[Candidate]:
        """What could be added to the current plant, of which a linear refit shows anything."""
        return screen.candidates(self._addable)

    @property
    def barred(self) -> set[str]:
        """Names of effects that are not looked at: not asked for, or found false."""
        return {*self.false, *self.without}

    @property
    def _addable(self) -> list[type[Effect]]:
        """The effects that could be added to the current plant and have not been found false."""
        return [e for e in applicable(self.steps[-1].result.plant, self.seen) if e.name not in self.barred]

    @property
    def timed(self) -> bool:
        """Whether anything was measured in time, and so at some speed."""
        return any(isinstance(o, Observation) for o in self.seen)

    @property
    def only_timed(self) -> bool:
        """Whether everything was."""
        return all(isinstance(o, Observation) for o in self.seen)

    def _settle_for(self, trials: Sequence[Trial]) -> None:
        """Lets the current plant keep what a trial found for it.

        A joint fit with one effect more can lead out of a local optimum that has nothing to do with the effect;
        that gain is the plant's own and must not be counted for the effect.
        """
        for name, result, held_out in trials[:1]:
            if name not in self.steps[-1].result.plant and self.is_worth_it(result, held_out):
                now = self.steps[-1].result
                alone = refine(*without(result, name), below=now.misfit.cost(now.vector))
                if alone.error < now.error:
                    again = cross_validated(alone.misfit, alone.vector)
                    self.steps[-1] = replace(self.steps[-1], result=alone, held_out=again)

    def _of_use(self, first: Trial, misfit: Misfit, tried: int) -> float:
        """A squared residual above which another joint fit than the first says nothing.

        Where the first is sure to earn its place that is one neither close to it, nor with fewer parameters and nearly
        as good: see `recheck.exchange`.
        """
        now = self.steps[-1].result
        sure = p_beside(now, self.held_out, first) <= FALSE_DISCOVERY_RATE / tried and self._earns(first)
        if not sure:
            return math.inf
        cost, least = (r.misfit.cost(r.vector) for r in (now, first.result))
        simpler = misfit.coordinates.size < first.result.misfit.coordinates.size
        return most_of_use(cost, least) if simpler else CLOSE * least

    def selects(self, result: FitResult) -> bool:
        """Whether the select records, where there are some, agree."""
        if not self.select:
            return True
        before, after = (
            compare_observations(p, self.select).error for p in (self.steps[-1].result.plant, result.plant)
        )
        return after < before
