"""Joint fits of a plant with one effect more: roughly, then to their ends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from .. import effects
from ..effect import Effect
from ..fit import fit_observations
from ..fit_result import FitResult
from ..identification.candidates import ANEW, absent, begin_apart, joined, shapes, width_of
from ..identification.frf_observation import FrfObservation, Seen
from ..identification.least_squares import nudge
from ..identification.misfit import Misfit
from ..identification.refine import CLOSE_TO_FLOOR, fit_to_end
from ..identification.rough import begun, best_start, fewer
from ..identification.scales import Scales
from ..identification.screen import Candidate
from ..identification.servo_observation import ServoObservation
from ..plant import Plant
from .judgement import AT_FLOOR, FINALISTS, floor_of, left_of, most_of_use
from .patience import Patience
from .plays import from_other_contacts, looked_at

Array = NDArray[np.float64]
Rough = tuple[str, Misfit, Array]  # an effect, the problem with it and a rough solution

_POINTS = 80  # of frequency responses that contenders are fitted to
_SCALING = ({"stiffening": 1.0, "whole": 0.0}, {"stiffening": 0.0, "whole": 0.0}, {"stiffening": 1.0, "whole": 1.0})
_WITH_DRAG = (*(form | {"drag": 1.0} for form in _SCALING), {"stiffening": 1.0, "whole": 1.0, "drag": 0.0})
_RUBBING = ({"deceleration": 0.0}, {"deceleration": 1.0}, {"deceleration": 0.2})
# Of each effect that has several. Whether one has a speed, or a scale of temperature, or slows its load down, is a form
# of it, and which a fit finds.
FORMS: dict[str, tuple[dict[str, float], ...]] = {
    "backlash": _RUBBING,
    "flexible_coupling": _RUBBING,
    "asymmetric_friction": tuple(
        {"stiffening": stiffening, "dropping": dropping, "whole": 0.0}
        for stiffening in (1.0, 0.0) for dropping in (1.0, 0.0)
    ),
    "load_dependent_friction": _WITH_DRAG,
    "position_dependent_friction": _WITH_DRAG,
    "thermal_drift": tuple(
        form | {"speed": speed, "temperature_scale": scale, "anew": anew}
        for speed, scale, anew in ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        for form in _SCALING
    ),
}  # fmt: skip
# More of them, for an effect that was taken and leaves more than noise.
_SELDOM: dict[str, tuple[dict[str, float], ...]] = {"asymmetric_friction": ({"whole": 1.0}, {"whole": 2.0})}
_STARTS = 2  # of the forms of an effect, the most promising, that are looked for from the beginning
_OPENED = 0.5  # of what the plant leaves, that a coupling leaves at most where a play may do better
_FAR = 2.0  # times the cost of a fit: another form that leaves more after a few steps leaves more in the end
_RUBS = 2.0  # times the squared residual that a load with dry friction has to leave, that one without may
LIMITS = {"flexible_coupling": "backlash"}  # what each is when it does not play


@dataclass(frozen=True)
class JointFits:
    """How plants are fitted jointly with one effect more, to the same measurements.

    Attributes:
        start: the plant that the search began with.
        seen: what is fitted.
        added: names of the effects that the search has added to it.
        patience: where that is short nothing is fitted from the beginning.
    """

    start: Plant
    seen: tuple[Seen, ...]
    added: frozenset[str]
    patience: Patience = field(default_factory=Patience)

    @property
    def simulated(self) -> bool:
        """Whether whole motions are simulated, and nothing is replayed along a measured one."""
        return any(isinstance(o, ServoObservation) for o in self.seen)

    @cached_property
    def few(self) -> list[Seen]:
        """What a rough fit looks at: of frequency responses with many points some."""
        return fewer(self.seen, _POINTS)

    @cached_property
    def _scales(self) -> Scales:
        return Scales.of(self.seen, self.start)

    def worth_trying(self, current: FitResult, rough: Sequence[Rough]) -> float:
        """A squared residual that a rough fit must come down to, to be looked at further beside these others.

        That of a finalist; and once one is at the noise floor, close to that, or low enough to be simpler and as good.
        """
        if self.simulated or not rough:
            return math.inf
        cost, left = current.misfit.cost(current.vector), left_of(current.misfit, current.vector)
        least = sorted(left_of(misfit, x) for _, misfit, x in rough)
        below = least[FINALISTS] if len(least) > FINALISTS else math.inf
        if least[0] <= AT_FLOOR**2 * floor_of(current):
            below = min(below, most_of_use(left, least[0]))
        return below + max(cost - left, 0.0)  # what the motion does not determine says nothing

    def forms(self, effect: Effect, plant: Plant | None = None, seldom: bool = False) -> list[dict[str, float]]:
        """The forms of an effect, which no fit chooses from; of one that `plant` has, the one that it has.

        With those that are `seldom` right, or without.

        Those with a speed have that of the effect, or a typical one; those with a scale of temperature likewise, and
        there are none where no temperature was measured that varies. What begins anew with each record is as if by
        time, but where records begin at other times. Responses alone hardly tell dry friction of a load
        from that of the joint, and each look at one is a balance to be found.
        """
        if effect.name not in FORMS or (plant is not None and effect.name in plant):
            return [{}]
        units = {p.name: p.unit for p in effect.parameters if p.is_scale}
        if FORMS[effect.name] is _RUBBING and all(isinstance(o, FrfObservation) for o in self.seen):
            return [{}]
        scales = {name: float(np.ravel(effect.values[name])[0]) or self._scales[unit] for name, unit in units.items()}
        scales[ANEW] = float(begin_apart(self.seen))
        forms = FORMS[effect.name] + (_SELDOM.get(effect.name, ()) if seldom else ())
        known = [form for form in forms if all(scales.get(k, 1.0) for k, v in form.items() if v)]
        return [{k: v * scales.get(k, 1.0) for k, v in form.items()} for form in known]

    def roughly(self, current: FitResult, candidate: Candidate, below: float = math.inf) -> tuple[Misfit, Array]:
        """A rough joint fit with one effect more, from where the plant is; a strong one also from the beginning.

        An effect that has several forms, which no fit chooses from, is tried in each.

        Args:
            current: the plant.
            candidate: the effect.
            below: a squared residual that is of use [N^2 m^2].
        """
        fits: list[tuple[Misfit, Array]] = []
        ways: list[tuple[float, dict[str, float]]] = []  # cost, form
        for form in self.forms(candidate.effect, current.plant):
            tried = self._nudged(current, candidate, form, below)
            ways.append((min(misfit.cost(x) for misfit, x in tried) * _worth(form), form))
            fits += tried
        if candidate.strong:
            ways.sort(key=lambda t: t[0])
            fits += self.afresh(current.plant, candidate.strong, [f for _, f in ways], min(ways[0][0], below))
        name = candidate.effect.name
        return min(fits, key=lambda t: t[0].cost(t[1]) * _worth(t[0].coordinates.template[name].values))

    def _nudged(
        self, current: FitResult, candidate: Candidate, form: dict[str, float], below: float
    ) -> list[tuple[Misfit, Array]]:
        """Rough fits with a candidate in one form."""
        begun = candidate if any(form.values()) else candidate.gliding or candidate
        plants = [joined(current.plant, e.replace(**form)) for e in (begun.effect, *begun.others)]
        near = (current.misfit.onto(plant, current.vector, self.few) for plant in plants)
        return [(misfit, nudge(misfit, x, below=below)) for misfit, x in near]

    def gliding(self, current: FitResult, candidate: Candidate, rough: Rough) -> list[Rough]:
        """Beside a rough fit of a play with dry friction behind it that without: a load that knocks as noise decides
        looks at first as one that rests."""
        name, misfit, x = rough
        if width_of(type(candidate.effect)) is None or not rubs(misfit.plant(x)[name]):
            return []
        fits = self._nudged(current, candidate, {"deceleration": 0.0}, math.inf)
        return [(name, *min(fits, key=lambda t: t[0].cost(t[1])))]

    def leading(self, name: str, current: FitResult, rough: Sequence[Rough]) -> FitResult:
        """The rough fit with an effect taken to its end; short of the noise floor that with and without dry friction of
        a load, where both were tried."""
        begun = {rubs(misfit.plant(x)[name]): (misfit, x) for n, misfit, x in reversed(rough) if n == name}
        ends: list[FitResult] = []
        for misfit, x in sorted(begun.values(), key=lambda t: left_of(*t)):
            ends.append(self.formed(name, self.whole(current, misfit, x)))
            if ends[-1].error <= AT_FLOOR * ends[-1].floor:
                break
        return min(ends, key=lambda r: _left(r, name))

    def afresh(
        self, plant: Plant, effect: Effect, ways: Sequence[dict[str, float]], below: float
    ) -> list[tuple[Misfit, Array]]:
        """Rough fits with an effect that is strong, in each of its forms, the most promising first: from the beginning,
        where the others begin as the first does, or of a servo, which bends less, from here."""
        plants = [joined(plant, effect.replace(**form)) for form in ways]
        if not self.simulated:
            starts = [best_start(self.fresh(p), self.few, below=below) for p in plants[:_STARTS]]
            plants = starts + [starts[0].replace(p[effect.name]) for p in plants[_STARTS:]]
        return [begun(p, self.few, below=below) for p in plants]

    def limits(self, current: FitResult, rough: Sequence[Rough]) -> list[Rough]:
        """Rough joint fits with the limit of each effect that was tried and has one, from where that one came to.

        What a resonance is seen by is narrow, and no grid of frequencies as fine: a contact that knocks finds it.
        """
        out = []
        for special, general in LIMITS.items():
            for _, misfit, x in (r for r in rough if r[0] == general and special not in current.plant):
                plant = misfit.plant(x)
                effect = effects.find(special)
                values = {p.name: plant[general].values[p.name] for p in effect.parameters}
                plant = plant.without(general) + effect(None, **values)
                skew = misfit.skew(x)
                near, there = current.misfit.onto(plant, current.vector, misfit.observations, skew=skew)
                out.append((special, near, nudge(near, there)))
        return out

    def opened(self, current: FitResult, rough: Sequence[Rough]) -> list[Rough]:
        """A rough joint fit with a play in the place of each coupling that was tried, takes most and leaves more than
        noise: as stiff and with as much behind it, as wide as leaves least."""
        out = []
        for special, general in LIMITS.items():
            for _, misfit, x in (r for r in rough if r[0] == special and general not in current.plant):
                left = left_of(misfit, x)
                if left <= AT_FLOOR**2 * floor_of(current) or left > _OPENED * left_of(current.misfit, current.vector):
                    continue
                plant, effect = misfit.plant(x), effects.find(general)
                values = {p.name: plant[special].values[p.name] for p in effects.find(special).parameters}
                width = width_of(effect)
                assert width is not None
                grid = {s[width] for s in shapes(effect, self._scales, self.seen, current.plant)}
                plants = [plant.without(special) + effect(None, **values, **{width: w}) for w in sorted(grid)]
                best = looked_at(current.misfit, current.vector, plants)[0]
                near, there = current.misfit.onto(best, current.vector, misfit.observations)
                out.append((general, near, nudge(near, there)))
        return out

    def fresh(self, near: Plant) -> Plant:
        """The first plant, not fitted, with what was added to it as it stands in `near`, without what was replaced."""
        fresh = replace(self.start, effects=tuple(e for e in self.start.effects if e.name in near))
        for e in near.effects:
            if e.name not in self.start:
                fresh = fresh + e
            elif e.name in self.added:
                fresh = fresh.replace(e)
        return fresh

    def to_end(self, misfit: Misfit, x: Array, below: float = math.inf) -> FitResult:
        """A rough joint fit, made on some of the observations, taken to its end on all; see `refine` for `below`."""
        return fit_to_end(Misfit(misfit.plant(x), self.seen), x, below=below)

    def whole(self, now: FitResult, misfit: Misfit, x: Array) -> FitResult:
        """`best` of a rough joint fit taken to its end; far above the noise floor the one from the beginning comes
        first and may spare it.

        Args:
            now: the fit without the effect.
            misfit, x: the rough fit.
        """
        near = Misfit(misfit.plant(x), self.seen)
        if left_of(near, x) <= CLOSE_TO_FLOOR**2 * floor_of(now) or self.patience.is_short:
            return self.best(self.to_end(near, x))
        afresh = fit_observations(self.fresh(misfit.plant(x)), self.seen, below=near.cost(x))
        if afresh.is_near_floor:
            return afresh
        return min(self.to_end(near, x, afresh.misfit.cost(afresh.vector)), afresh, key=attrgetter("error"))

    def best(self, result: FitResult) -> FitResult:
        """The same joint fit, or above the noise floor that from the beginning where it leaves less.

        A plant that has bent far to hide an effect may not find back.
        """
        if result.error <= AT_FLOOR * result.floor or self.patience.is_short:
            return result
        begun = fit_observations(self.fresh(result.plant), self.seen, below=result.misfit.cost(result.vector))
        return min(result, begun, key=attrgetter("error"))

    def anew(self, name: str, result: FitResult) -> FitResult:
        """The same joint fit, or above the noise floor that from the beginning with another form of an effect where it
        leaves less: a form that is wrong may lead the plant to where no other does better."""
        effect = result.plant[name]
        ways = [form for form in self.forms(effect, seldom=True) if effect.replace(**form) != effect]
        if not ways or result.error <= AT_FLOOR * result.floor or self.patience.is_short:
            return result
        least = result.misfit.cost(result.vector)
        rough = self.afresh(result.plant.without(name), absent(effect), ways, least)
        misfit, x = min(rough, key=lambda t: t[0].cost(t[1]))
        return min(result, self.to_end(misfit, x, least), key=attrgetter("error"))

    def formed(self, name: str, result: FitResult) -> FitResult:
        """The same joint fit, or that with another form of the effect or another contact of a play where it leaves
        less: rough fits are no judges of forms that differ little."""
        plays = width_of(effects.find(name)) is not None
        if plays:
            result = from_other_contacts(result)
        found, cost = [result], result.misfit.cost(result.vector)
        for form in self.forms(result.plant[name], seldom=result.error > AT_FLOOR * result.floor):
            plant = result.plant.replace(result.plant[name].replace(**form))
            if plant[name] != result.plant[name]:
                misfit, x = result.misfit.onto(plant, result.vector, self.seen)
                least = cost * _worth(result.plant[name].values) / _worth(form)
                x = nudge(misfit, x, below=_FAR * least)
                if misfit.cost(x) <= _FAR * least:
                    found.append(fit_to_end(misfit, x, below=least))
        best = min(found, key=lambda r: _left(r, name))
        return from_other_contacts(best) if plays and best is not result else best


def _worth(values: Mapping[str, object]) -> float:
    """How much less an effect with these values has to leave than in its other forms: so many times the square.

    Behind a play dry friction keeps a load from knocking when noise decides, and leaves less than the play that is
    there but has none.
    """
    return _RUBS if values.get("deceleration") else 1.0


def _left(result: FitResult, name: str) -> float:
    """The squared residual of a fit, by which it is compared with those that have an effect in another form."""
    return result.error**2 * _worth(result.plant[name].values)


def rubs(effect: Effect) -> bool:
    """Whether an effect has a load with dry friction of its own."""
    return bool(effect.values.get("deceleration"))
