"""The law of friction of an axis: whether the data ask for another than the one that a search began with."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect
from ..fit import fit_observations, from_the_data
from ..fit_result import FitResult, result_of
from ..identification.candidates import with_general_laws
from ..identification.held_out import HeldOut, p_value
from ..identification.least_squares import nudge
from ..identification.linear_model import cross_validated
from ..identification.misfit import Misfit
from ..identification.refine import CLOSE_TO_FLOOR, refined
from ..identification.starts import ELEMENTS, LAWS, to_identify
from ..plant import Plant
from ..progress import silent
from .friction_shape import (
    BENDS,
    OF_REVERSALS,
    STEPS,
    elastic_bristle,
    fading_damping,
    has_another_reading,
    of_the_other_kind,
    other_curve,
    plastic_bristle,
    shaped_as,
    slipping_back,
    turning_round,
)
from .judgement import (
    AT_FLOOR,
    FALSE_DISCOVERY_RATE,
    LEAST_GAIN,
    MUCH_LESS,
    floor_of,
    leaves_much_less,
    left_of,
    takes,
)
from .search import Search
from .steps import Step

Array = NDArray[np.float64]

# Each of `LAWS` describes by itself how friction begins, weakens and turns round. The one bristle of `lugre` is damped,
# forgets its reversals and creeps, which the elements of `gms` do not; `coulomb`, `stribeck` and `dahl` are contained
# in both, but for a `dahl` with another exponent than 1, and a `stribeck` with a creep velocity: that gives way below
# its level at once, and remembers nothing. So does `frictionloss`, which MuJoCo has and no bearing.
_TRIED_WITH = {"stribeck": {"creep_velocity": math.nan}}
_STRONGEST = 4.0  # times the level of sliding, which no friction at rest is
_HARDLY_MORE = 1.02  # times an error: one that is larger by less is as good
_NEAR = 1.2  # times what the own law leaves: another that leaves more does not take its place
_IN_REACH = 10.0  # times it, from where another exponent may still bring it there
_NEARLY_ALL = 0.9  # of the squared error above the floor, that no effect takes in the place of another law
_LITTLE = 0.05  # of the torque, that friction which is told leaves: beside a fit that is lost any law takes nearly all
_PLAINLY = 0.9  # of the squared error that one reading of a law leaves beside one effect, that another is to leave
_DAMPED = 0.3  # of what is critical, that a spring which is cut off is damped, to begin with


@dataclass(frozen=True)
class Trial:
    """A joint fit with another law of friction in the place of the plant's own, and what it leaves of each block.

    Attributes:
        law: as it stands before a fit.
        clear: worth it by all that an effect is judged by, and at the noise floor, or with so little left, of the
            torque and of what is above the floor, that no effect looks as much like friction: nothing else need be
            tried.
    """

    law: Effect
    result: FitResult
    held_out: HeldOut
    p_value: float
    clear: bool


class FrictionLaw:
    """The choice of a law of friction beside the search for effects.

    Args:
        search: whose plant may change its law.
        free: whether it may; else nothing is ever tried.

    Attributes:
        said: a sentence on the law where it is another than the first; else empty.
    """

    def __init__(self, search: Search, free: bool) -> None:
        self._search = search
        self._laws = choices(search.start, search.without) if free and search.timed else ()
        self._taken: set[str] = set()  # each law at most once, so that there is an end
        self.said = ""

    def beside(self, search: Search) -> FrictionLaw:
        """The choice beside another search, that has come from this one's."""
        out = copy(self)
        out._search, out._taken = search, set(self._taken)
        return out

    @property
    def has_room(self) -> bool:
        """Whether noise leaves enough of what the plant leaves for another law to be worth it."""
        now = self._search.steps[-1].result
        return takes(left_of(now.misfit, now.vector), floor_of(now), 0.0)

    def better(self, asked: bool = False) -> Trial | None:
        """The best of the other laws that earns its place beside what was found so far; None where the own one stays.

        None is tried where noise leaves too little for any to be worth it, unless it is `asked` for. At the floor
        already, whose tolerance has room for a wrong law that a stiff contact hides, another has to take as much of
        everything as an effect there. In the place of one that has come out as no bearing is, any does that leaves no
        more with fewer unknowns.
        """
        search, earned = self._search, []
        now = search.steps[-1].result
        least = left_of(now.misfit, now.vector)
        strays = _strays(now.plant)
        for law in self._laws if asked or strays or self.has_room else ():
            if law.name in now.plant or law.name in self._taken:
                continue
            most = _NEAR * now.misfit.cost(now.vector)
            in_reach = most * _IN_REACH if OF_REVERSALS in law.values else most
            tried = [from_the_data(with_law(now.plant, form), search.seen, below=in_reach) for form in _forms(law)]
            if "plastic" in law.values and "gms" in now.plant:
                tried += _cut_off(now, most)
            misfit, x = min(tried, key=lambda t: t[0].cost(t[1]))
            if most < misfit.cost(x) <= in_reach:
                misfit, x = turning_round(misfit, x, law.name, most)
            if misfit.cost(x) > most:
                continue
            result = result_of(misfit, x)
            # A bristle that bends, or whose damping fades, is no step further: without it a fit ends in another place.
            # Nor is the exponent by which friction turns round.
            bends = plastic_bristle(*elastic_bristle(result, cross_validated(result.misfit, result.vector)))
            result, held_out = other_curve(*fading_damping(*bends), [OF_REVERSALS])
            p = p_value(search.held_out, held_out)
            worth = search.is_worth_it(result, held_out)
            # The noise floors of two laws differ: of one that is stiffer the encoder shows less.
            at_floor = held_out.total <= AT_FLOOR**2 * floor_of(result)
            falls = search.held_out.total - held_out.total > LEAST_GAIN * search.held_out.total
            earns = p < FALSE_DISCOVERY_RATE and (worth or (at_floor and falls and not search.at_floor))
            fewer = result.misfit.coordinates.size < now.misfit.coordinates.size
            no_more = left_of(result.misfit, result.vector) <= least and held_out.total <= search.held_out.total
            if (earns or (strays and at_floor and fewer and no_more)) and search.selects(result):
                floor = min(floor_of(now), floor_of(result))
                explains = takes(search.held_out.total, held_out.total, floor, _NEARLY_ALL) and result.error < _LITTLE
                earned.append(Trial(law, result, held_out, p, bool(worth and (at_floor or explains))))
        return min(earned, key=lambda t: t.held_out.total, default=None)

    def instead(self, steps: list[Step]) -> Trial | None:
        """The best of the other laws that earns its place at the end of other steps, however little noise leaves."""
        search = self._search
        kept, search.steps = search.steps, steps
        try:
            return self.better(asked=True)
        finally:
            search.steps = kept

    def take(self, trial: Trial) -> None:
        """Begins the search anew with another law: what was found beside the wrong one is looked for again, with as
        much patience as at first."""
        search, name, first = self._search, trial.law.name, self._laws[0].name
        self._taken.add(name)
        was, now = search.steps[-1].result.error, trial.result.error
        fall = f"the torque error falls from {100 * was:.2f} % to {100 * now:.2f} %"
        if now >= was:
            fall = "less is left of what a fit has not seen"
        found = [e.name for e in trial.result.plant.effects if e.name not in search.start and e.name != name]
        with_it = "with it and what was found beside it by then" if found else "with it"
        self.said = "" if name == first else (
            f"{_told(trial.result.plant, name)} describes the friction, in the place of {first}: {with_it} {fall} "
            + (f"(p = {trial.p_value:.1g} on held-out blocks)" if trial.p_value < FALSE_DISCOVERY_RATE
               else "with fewer unknowns")
        )  # fmt: skip
        search.start = with_law(search.start, shaped_as(trial.law, trial.result.plant[name]))
        search.false.clear()
        if found:
            search.patience.grant()
            search.first(silent)
        else:
            search.steps = [Step(None, trial.result, held_out=trial.held_out)]
            search.shape()
            if search.relogged():  # what the wrong law left was too much to see a habit of the log beside it
                search.first(silent)


def with_other_laws(search: Search, start: Plant) -> list[Plant]:
    """Plants with each of the other laws of friction among which the data may choose, beside which a search that has
    ended above the noise floor may come further; and with more elements where its own has fewer than usual."""
    plants = [with_law(start, law) for law in choices(start, search.without)[1:]]
    if "gms" in start and start["gms"].elements < ELEMENTS:
        plants.append(with_law(start, to_identify("gms", slips_back=float(np.asarray(start["gms"].slips_back)))))
    return [*plants, slipping_back(start)] if _may_follow_the_letter(search) else plants


def _may_follow_the_letter(search: Search) -> bool:
    """Whether a search has ended far above the noise floor beside `gms` friction that sticks where it unwinds.

    Beside the other reading an effect that changes a level is another one, and `by_the_letter` looks near the floor."""
    return has_another_reading(search.start) and search.timed and not is_close(search)


def is_close(search: Search) -> bool:
    """Whether a search has come close to the noise floor."""
    last = search.steps[-1].result
    return last.error <= CLOSE_TO_FLOOR * last.floor


def with_laws_added(search: Search, start: Plant) -> list[Plant]:
    """The same of a plant whose law of friction is simple, and no more to be chosen: with each general one, which is an
    effect that may be missing, in its place; none where a servo's runs hardly tell it."""
    laws = {} if search.fits.simulated else with_general_laws(start)
    return [plant for name, plant in laws.items() if name not in search.without]


def add_law(search: Search, other: Search) -> None:
    """Counts the law of friction that another search began with as the effect that a search from its simple one would
    have added first."""
    first, begun = search.steps[0], other.steps[0]
    p = p_value(first.held_out, begun.held_out)
    other.steps = [first, replace(begun, effect=law_of(other.start), p_value=p), *other.steps[1:]]


def leading_further(search: Search, others: Sequence[Search]) -> list[Search]:
    """Of searches with other laws of friction, which have not begun, those that may come to less than one that has
    ended: whose first plant would with the effect that promises most. The most promising comes first.

    Elements that bend as they like hide an effect in part, and leave less without it than the right law does. Frequency
    responses at many amplitudes know friction so well that beside the wrong law nothing that is missing is seen, and
    the right one alone does not show that it is: there every law is gone on with.
    """
    if not search.timed:
        return list(others)
    last = search.steps[-1].result
    reach = []
    for other in others:
        if _is_there(last.plant, other.start):
            continue
        other.first(silent)
        if law_of(other.start) in last.plant:  # in another reading, which hides as much: like is set beside like
            begun = copy(search)
            begun.steps = search.steps[:1]
            least = _PLAINLY * begun.within_reach()
        else:
            least = left_of(last.misfit, last.vector)
        reach.append((other.within_reach(least) / least, other))
    return [other for share, other in sorted(reach, key=lambda r: r[0]) if share < 1]


def _is_there(plant: Plant, other: Plant) -> bool:
    """Whether a plant has the law of another, read as there and of no fewer elements."""
    law = law_of(other)
    if law not in plant or plant[law].elements < other[law].elements:
        return False
    return plant[law].values.get("slips_back") == other[law].values.get("slips_back")


def comes_further(search: Search, other: Search) -> bool:
    """Whether a search with another law of friction from its beginning leaves much less, or what is in no catalogue
    does beside it."""
    before, after = search.steps[-1].result, other.steps[-1].result
    return (leaves_much_less(before, after) or _is_told_more(search, other)) and search.selects(after)


def _is_told_more(search: Search, other: Search) -> bool:
    """Whether what is in no catalogue leaves much less beside a search with another law than one has left."""
    if other.hint is None:
        return False
    floor = min(floor_of(s.steps[-1].result) for s in (search, other))
    return other.hint.left - floor < MUCH_LESS * (search.held_out.total - floor)


def told_instead(search: Search, other: Search) -> str:
    """The sentence on the law of a search that has come further than one with another law, or with fewer elements;
    empty where both have ended with the same."""
    after, before = (s.steps[-1].result.plant for s in (other, search))
    one, its = (_told(plant, law_of(plant)) for plant in (after, before))
    if one == its:
        many, few = (plant[law_of(plant)].elements for plant in (after, before))
        if few == many:
            return ""
        one, its = f"{one} of {many} elements", f"{its} of {few}"
    its = its.rstrip(",")  # no verb follows
    now, was = (100 * s.steps[-1].result.error for s in (other, search))
    if _is_told_more(search, other):
        return f"{one} describes the friction, in the place of {its}: beside it a cause explains most of what is left"
    return (
        f"{one} describes the friction, in the place of {its}: with it and what is found beside it the torque error is "
        f"{now:.2f} %, else {was:.2f} %"
    )


def _strays(plant: Plant) -> bool:
    """Whether friction comes out many times as strong at rest as while it slides: few samples told so, if any."""
    laws = [e for e in plant.effects if "static" in e.values]
    return any(float(np.asarray(e.static)) > _STRONGEST * float(np.asarray(e.coulomb)) for e in laws)


def brought_back(search: Search) -> bool:
    """Takes the last plant from the beginning again where friction has come out as no bearing is, and that leaves
    hardly more and is one; whether it has.

    Of what little slides, many levels leave as much, and each of them says something else of another record.
    """
    last = search.steps[-1].result
    if not (search.timed and _strays(last.plant)):
        return False
    afresh = fit_observations(search.fits.fresh(last.plant), last.misfit.observations)
    if _strays(afresh.plant) or afresh.error > _HARDLY_MORE * last.error:
        return False
    held_out = cross_validated(afresh.misfit, afresh.vector)
    search.steps[-1] = replace(search.steps[-1], result=afresh, held_out=held_out)
    return True


def _forms(law: Effect) -> tuple[Effect, ...]:
    """A law in each of the forms between which no fit finds a way."""
    if "elastic" not in law.values or law.elastic or law.plastic:
        return (law,)
    return (law, law.replace(elastic=BENDS))


def _cut_off(now: FitResult, below: float) -> list[tuple[Misfit, Array]]:
    """Fits with a damped spring that is cut off at the level in the place of the elements of `gms`, by either of the
    usual curves: as stiff as one that gives way where they do, from the data alone no fit finds it; see `refine` for
    `below`."""
    gms, plant = now.plant["gms"], now.plant
    stiffness = 1 / float(np.sum(np.asarray(gms.fraction) ** 2 / np.asarray(gms.stiffness)))
    damping = _DAMPED * math.sqrt(stiffness * plant.driven_inertia)
    curve = {name: gms.values[name] for name in ("coulomb", "static", "stribeck_velocity", "stribeck_exponent")}
    law = to_identify("lugre").replace(stiffness=stiffness, damping=damping, plastic=1.0, **curve)
    found = []
    for form in (law, of_the_other_kind(law)):
        misfit = Misfit(with_law(plant, form), now.misfit.observations)
        x = misfit.vector(misfit.coordinates.template, skew=now.misfit.skew(now.vector))
        found.append((misfit, refined(misfit, nudge(misfit, x, STEPS), below=below)))
    return found


def law_of(plant: Plant) -> str:
    """The name of the law of a plant that has one."""
    return next(e.name for e in plant.effects if e.name in LAWS)


def choices(plant: Plant, without: Collection[str] = ()) -> tuple[Effect, ...]:
    """The laws among which the data may choose, that of the plant first, and none of the names in `without`; none where
    it has none or several."""
    own = [e for e in plant.effects if e.name in LAWS]
    if len(own) != 1:
        return ()
    others = [name for name in LAWS if name != own[0].name and name not in without]
    return (own[0], *(to_identify(name, **_TRIED_WITH.get(name, {})) for name in others))


def _told(plant: Plant, name: str) -> str:
    """The name of the law of a plant, and what friction does by it where that is not what one expects of the name."""
    creep, unit = plant.numbers().get(f"{name}.creep_velocity", (0.0, ""))
    if creep:
        return f"{name}, which gives way below its level (creep velocity {creep:.3g} {unit}),"
    if plant[name].values.get("slips_back"):
        return f"{name} by the letter of its switching law"
    return f"{name}, as a damped spring that is cut off at its level," if plant[name].values.get("plastic") else name


def with_law(plant: Plant, law: Effect) -> Plant:
    """The plant with another law in the place of its own, and of one that was found beside that."""
    own = law_of(plant)
    kept = (e for e in plant.effects if e.name == own or e.name not in LAWS)
    return replace(plant, effects=tuple(law if e.name == own else e for e in kept))


def would_be_better(search: Search) -> str:
    """That another law in the place of that of the last plant would leave much less of the torque; else nothing."""
    last = search.steps[-1].result
    above = last.error**2 - last.floor**2
    laws = choices(last.plant, search.without) if search.timed and above > 0 else ()
    for law in laws[1:]:
        other = fit_observations(with_law(last.plant, law), last.misfit.observations)
        if other.error**2 - last.floor**2 <= MUCH_LESS * above:
            return (
                f"friction is better described by {law.name} in the place of {laws[0].name}: "
                f"{100 * other.error:.2f} % of the torque would be left instead of {100 * last.error:.2f} %"
            )
    return ""
