"""What a joint fit with one effect more is judged by."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..effect import Effect
from ..fit_result import FitResult, with_covariance
from ..identification.candidates import ORDERS, absent, is_possible, is_present, strengths, stronger, width_of
from ..identification.held_out import HeldOut, block_of_row, p_value
from ..identification.inverse import Observation
from ..identification.linear_model import LinearModel, determined
from ..identification.misfit import Misfit
from ..identification.noise import Noise
from ..identification.speed_curve import curve
from ..identification.tall import squared
from ..plant import Plant

Array = NDArray[np.float64]

FALSE_DISCOVERY_RATE = 0.01
# An effect must take so much of the squared error on held-out blocks that is not noise: less is not what is missing.
LEAST_SHARE = 0.2
LEAST_GAIN = 0.05  # of all the squared error: less is not told from what the noise is known by
AT_FLOOR = 1.4  # times the noise floor: as good as the sensors, whose noise is known no better
_MUCH = 0.4  # of what is not noise, where that is little and known no better than the noise
_SOME = 0.2  # of the rows, in which an axis slides, at least, for that to be judged by itself
_MOST = 0.5  # of what is not noise there, that an effect then has to take
_SURE = 1e-9  # p value of a fall there that is sure, however well the noise is known
FINALISTS = 2  # of them, that do something different, fitted to the end
_SAME = 0.9  # cosine between what two candidates do to the residual, above which they do the same
_SHUT = 1e-3  # of its width, to which a play is closed
_CARRIED = 0.5  # of what is gained with an effect, that must be lost again when it does nothing
CLOSE = 1.5  # times what the best left: an effect that left more is none in its place
NEARLY = 0.9  # of what the best took: one of fewer parameters that took as much is
_NO_MORE = 0.01  # of what a fit leaves: one that leaves so little more leaves as much
MUCH_LESS = 0.5  # of the squared error above the floor: another plant that leaves less than that is told
_CONFUSABLE = 0.05  # p value above which two refitted candidates are not told apart


class Trial(NamedTuple):
    """A joint fit with one effect more, and what it leaves of each block by a fit without it."""

    name: str
    result: FitResult
    held_out: HeldOut


def with_curve(result: FitResult) -> HeldOut:
    """What a linear refit leaves whose friction is any function of speed, see `speed_curve`."""
    misfit, x = result.misfit, result.vector
    model = LinearModel(misfit, x, misfit.residual(x))
    columns = curve(result.plant, misfit.observations) * model.determined[:, None]
    return HeldOut(model.held_out(columns) / np.sqrt(misfit.delivered(x)), misfit.observations)


def without(result: FitResult, name: str) -> tuple[Misfit, Array]:
    """The problem of a fit without one effect, and where to start: with friction as strong as leaves least, where the
    effect has multiplied it."""
    plant, own = result.plant.without(name), result.misfit
    misfit = Misfit(plant, own.observations)
    memories = own.memories(result.vector, misfit.n_memory) if misfit.n_memory == own.n_memory else None
    x = misfit.vector(plant, memories)
    return _as_strong(misfit, x) if result.plant[name].modulates else (misfit, x)


def _as_strong(misfit: Misfit, x: Array) -> tuple[Misfit, Array]:
    """The same problem where friction is multiplied by what leaves least; of records alone."""
    if not all(isinstance(o, Observation) for o in misfit.observations):
        return misfit, x
    plant, left = misfit.plant(x), misfit.residual(x)
    twice, there = misfit.onto(stronger(plant, 2.0), x)
    change = twice.residual(there) - left
    size = float(change @ change)
    factor = 1 - float(left @ change) / max(size, 1e-300)
    return misfit.onto(stronger(plant, factor), x) if size > 0 and factor > 0 else (misfit, x)


def carries(name: str, before: FitResult, after: FitResult) -> bool:
    """Whether an effect does what was gained with it: at a strength of zero, all else as it is, most is lost again.

    What multiplies friction always by the same does nothing. The rest of a plant may have found a better place, or a
    form that acts on others, at the side of an effect that does next to nothing; and of a part that swings no more than
    the ring that a record begins with may be of use. A play does what it does by its width: one that may as well have
    none is a coupling.
    """
    effect = after.plant[name]
    if not (is_present(effect) and is_possible(effect)):
        return False
    if absent(effect) == effect:  # absent only at the end of its range
        return True
    idle = after.misfit.onto(after.plant.replace(absent(effect)), after.vector)
    left, least = left_of(*(_as_strong(*idle) if effect.modulates else idle)), left_of(after.misfit, after.vector)
    gained = left_of(before.misfit, before.vector) - least
    lost = left - least > _CARRIED * gained
    if width := width_of(type(effect)):
        closed = effect.replace(**{width: _SHUT * float(np.asarray(effect.values[width]))})
        left_shut = left_of(*after.misfit.onto(after.plant.replace(closed), after.vector))
        lost = lost and left_shut - least > _NO_MORE * gained
    if not lost or not swings(effect):
        return lost
    return _left_of_ring(name, before, after) - least > _CARRIED * gained


def _left_of_ring(name: str, before: FitResult, after: FitResult) -> float:
    """What a linear refit without an effect leaves, beside the ring alone that each record begins with [N^2 m^2];
    inf of responses, which begin nowhere.

    A part that hardly damps rings through a whole record, and stands for anything that hums beside the axis. What
    belongs to the axis is driven by its motion.
    """
    misfit, place = after.misfit, after.misfit.coordinates.template.memory_places[name]
    begins = [misfit.states(i)[0] for i, o in enumerate(misfit.observations) if o.has_memory]
    states = np.array([b + k for b in begins for k in range(place.start, place.stop)], np.intp)
    if not len(states):
        return math.inf
    model = LinearModel(before.misfit, before.vector, before.misfit.residual(before.vector))
    ring = misfit.jacobian(after.vector, states)[:, states] * model.determined[:, None]
    basis = scipy.linalg.orth(model.without(ring / np.sqrt((ring**2).sum(0)).clip(1e-300)))
    return squared(model.target - basis @ (basis.T @ model.target)) / before.misfit.delivered(before.vector)


def is_told(name: str, result: FitResult) -> bool:
    """Whether the data tell a strength of an effect from none; of an effect without one they do."""
    effect = result.plant[name]
    labels = {f"{name}.{p.name}" for p in strengths(type(effect))}
    ends = with_covariance(result).plant.uncertainty.items()
    within = [interval for label, interval in ends if label.split("[")[0] in labels]
    return not within or any(low > 0 or high < 0 for low, high in within)


def finalists(
    current: FitResult, rough: Sequence[tuple[str, Misfit, Array]], count: int = FINALISTS
) -> list[tuple[str, Misfit, Array]]:
    """The best of the rough fits, best first; one more where the first two do the same to the residual; and the best
    of those that do the same as the first with fewer parameters."""
    before = current.misfit.residual(current.vector)
    after = [misfit.residual(x) for _, misfit, x in rough]
    if any(len(r) != len(before) for r in after):
        return list(rough[:count])  # of fewer points or runs: what they do cannot be set side by side
    changes = [before - r for r in after]
    sizes = [float(np.sqrt(c @ c)) for c in changes]
    alike = [float(changes[0] @ c) > _SAME * sizes[0] * size for c, size in zip(changes, sizes, strict=True)]
    most = count + (len(rough) > count - 1 and all(alike[:count]))
    simpler = (t for t, same in zip(rough[most:], alike[most:], strict=True) if same and t[1].size < rough[0][1].size)
    return [*rough[:most], *itertools.islice(simpler, 1)]


def swings(effect: Effect) -> bool:
    """Whether an effect is a part of the mechanism that swings at a frequency of its own."""
    return effect.kind == "mechanics" and any(p.unit == "Hz" for p in effect.parameters)


def least_share(plant: Plant, effect: Effect) -> float:
    """What an effect that is added, or grows, has to take at least of the squared error that is not noise.

    One more of the harmonics that are all tried is no new cause. One of thousands that were looked through has more
    chances to stand out, and has to show as much as a new effect.
    """
    if effect.name not in plant:
        return LEAST_SHARE
    new = np.setdiff1d(effect.values["harmonics"], plant[effect.name].values["harmonics"])
    return LEAST_SHARE if np.any(new > ORDERS) else 0.0


def most_of_use(before: float, least: float) -> float:
    """What another fit may leave beside one that left least [N^2 m^2], to be in its place: hardly more, or with fewer
    parameters nearly as little of what was left before."""
    return max(CLOSE * least, before - NEARLY * (before - least))


def takes(before: float, after: float, floor: float, share: float = LEAST_SHARE) -> bool:
    """Whether a good part of the squared error that is not noise is gone."""
    return bool(before - after > least_fall(before, floor, share))


def least_fall(before: float, floor: float, share: float = LEAST_SHARE) -> float:
    """By how much a squared error has to fall for that."""
    return max(share * (before - floor), LEAST_GAIN * before)


def at_floor(result: FitResult, held_out: HeldOut, times: float = AT_FLOOR) -> bool:
    """Whether what a fit leaves on held-out blocks is as good as noise, or at most so many times its floor, which says
    something; see `FitResult.rattles`."""
    return bool(held_out.total <= times**2 * floor_of(result)) and not result.rattles


def is_worth_it(
    now: FitResult, before: HeldOut, result: FitResult, after: HeldOut, share: float = LEAST_SHARE
) -> bool:
    """Whether a fit takes a good part of what noise does not explain of another; at the noise floor, of everything.

    What distorts the torque also raises the noise that a model without it reports: the lower floor counts. One
    more harmonic of an effect that is there already, no new cause, asks for no `share`.

    Of what is negligible it takes nothing. It takes that of what the fits leave, too: few records may leave a plant
    without the effect so little to tell a block by that any other start of the refits predicts it better.

    What moves less at high frequencies, as an axis behind a coupling, passes on less of the encoder's noise: that
    the noise is less says nothing for an effect, see `_quieter`; nor does what holds in the upper half of the band
    alone, see `_holds_below`.
    """
    if before.total <= now.negligible:
        return False
    in_part = takes_in_part(now, before, result, after) or _takes_of_rest(now, before, result, after)
    takes_enough = in_part or _takes_of_all(now, before, result, after, share)
    return takes_enough and _holds_below(now, before, result, share)


def _added(now: FitResult, result: FitResult) -> list[Effect]:
    """The effects of a fit that another lacks."""
    return [e for e in result.plant.effects if e.name not in now.plant]


def _left_by(now: FitResult, result: FitResult) -> tuple[float, float]:
    """What two fits leave, see `left_of`."""
    return left_of(now.misfit, now.vector), left_of(result.misfit, result.vector)


def _filters(now: FitResult, result: FitResult) -> bool:
    """Whether an effect was added that stands in the path of the torque, or swings: it may pass on less noise."""
    return any(_drives(e) or swings(e) for e in _added(now, result))


def _drives(effect: Effect) -> bool:
    return type(effect).deliver is not Effect.deliver


def takes_of_both(
    now: FitResult, before: HeldOut, result: FitResult, after: HeldOut, floor: float, share: float
) -> bool:
    """Whether a share of what is above the floor is gone, on held-out blocks and of what the fits leave."""
    return all(takes(a, b, floor, share) for a, b in ((before.total, after.total), _left_by(now, result)))


def _takes_of_all(now: FitResult, before: HeldOut, result: FitResult, after: HeldOut, share: float) -> bool:
    """Whether an effect takes its share on held-out blocks and of what the fits leave.

    What may pass on less noise has nothing to explain where hardly more is left than noise leaves beside the same
    friction: no more than that is what it can take.
    """
    quiet = at_floor(now, before)
    floor = 0.0 if quiet else min(floor_of(now), floor_of(result))
    if not takes_of_both(now, before, result, after, floor, share):
        return False
    if not quiet:
        return True
    idle, quieter = _noise_beside(now, result)
    if _filters(now, result) and before.total - idle < least_fall(before.total, 0.0, share):
        return False
    return takes(before.total, after.total + quieter, 0.0, share)


def _holds_below(now: FitResult, before: HeldOut, result: FitResult, share: float) -> bool:
    """At the noise floor, whether what an effect in the path of the torque takes, or one that swings, holds in the
    lower half of the band.

    A controller answers the noise of its own encoder, and the torque that it asks for then seems to come late, by its
    gain of the velocity over the inertia: what is left falls by half where it is that noise, at the upper end of the
    band. What does come late does so at any frequency, and has to take its share there too.
    """
    if not at_floor(now, before) or not _filters(now, result):
        return True
    drives = any(map(_drives, _added(now, result)))
    seen = [o for o in now.misfit.observations if isinstance(o, Observation)]
    if len(seen) < len(now.misfit.observations):
        return True
    below = [replace(o, bandwidth=o.bandwidth / 2) for o in seen]
    left, gone = (left_of(*r.misfit.onto(r.plant, r.vector, below)) for r in (now, result))
    return takes(left, gone, 0.0, share) if drives else gone <= (1 + LEAST_GAIN) * left


def takes_in_part(now: FitResult, before: HeldOut, result: FitResult, after: HeldOut) -> bool:
    """Whether an effect takes enough of a part of the records that what is left elsewhere should not hide it."""
    return _takes_of_sliding(now, before, result, after) or _takes_beside_moments(now, before, result, after)


def _takes_of_sliding(now: FitResult, before: HeldOut, result: FitResult, after: HeldOut) -> bool:
    """Whether an effect takes most of what noise does not explain where the axis slides, and no more is left in all.

    Around reversals a stiff contact leaves what its encoder does not resolve. That may be nearly all that a fit leaves,
    and says nothing of what is missing while friction is no more than its level.
    """
    found = _while_sliding(now, before, result, after)
    if found is None:
        return False
    left, gone, floor = found
    return left.total > AT_FLOOR**2 * floor and takes(left.total, gone.total, floor, _MOST)


def _while_sliding(
    now: FitResult, before: HeldOut, result: FitResult, after: HeldOut
) -> tuple[HeldOut, HeldOut, float] | None:
    """What two fits leave where the axis slides, 0 elsewhere, and the squared residual that noise leaves there through
    the louder [N^2 m^2]; None where it slides too little, or more is left in all."""
    seen = now.misfit.observations
    if not _added(now, result) or not all(isinstance(o, Observation) for o in seen):
        return None
    slides = np.concatenate([o.slides for o in seen if isinstance(o, Observation)])
    if slides.mean() < _SOME or after.total > before.total:
        return None
    return _where(slides, now, before, result, after)


def _where(
    rows: NDArray[np.bool_], now: FitResult, before: HeldOut, result: FitResult, after: HeldOut
) -> tuple[HeldOut, HeldOut, float]:
    """What two fits leave in some rows (m,), 0 elsewhere, and the squared residual that noise leaves there through the
    louder [N^2 m^2]."""
    left, gone = (HeldOut(rows * h.rows, h.observations) for h in (before, after))
    floor = max(squared(r.floor_rows[rows]) for r in (now, result)) / now.misfit.delivered(now.vector)
    return left, gone, floor


def _takes_beside_moments(now: FitResult, before: HeldOut, result: FitResult, after: HeldOut) -> bool:
    """Whether an effect surely takes its share beside the few moments that hold most of what is left, and no more is
    left in all.

    A knock, or one reversal that the law of friction misses, may outweigh all that an effect does in the rest of the
    records, and says nothing against it.
    """
    if at_floor(now, before) or not _added(now, result) or after.total > before.total:
        return False
    loud = before.moments()
    if not len(loud):
        return False
    calm = ~np.isin(block_of_row(before.observations), loud)
    left, gone, floor = _where(calm, now, before, result, after)
    is_above = left.total > AT_FLOOR**2 * floor
    return is_above and takes(left.total, gone.total, floor) and p_value(left, gone) < _SURE


def _takes_of_rest(now: FitResult, before: HeldOut, result: FitResult, after: HeldOut) -> bool:
    """At the noise floor, whether an effect takes much of the little that noise does not explain; or surely does so of
    that where the axis slides.

    Not of what stands in the path of the torque, or swings, and passes on less noise.
    """
    if not at_floor(now, before) or len(_added(now, result)) != 1 or _filters(now, result):
        return False
    floor, fits = min(floor_of(now), floor_of(result)), _left_by(now, result)
    falls = [(*pair, floor) for pair in ((before.total, after.total), fits)]
    much = all(takes(*fall, _MUCH) for fall in falls)
    if not much and (sliding := _while_sliding(now, before, result, after)) is not None:
        left, gone, noise = sliding
        falls = [(left.total, gone.total, noise)]
        much = takes(*falls[0], _MUCH) and p_value(left, gone) < _SURE
    if not much:
        return False
    _, quieter = _noise_beside(now, result)
    return all(takes(a, b + quieter, noise, _MUCH) for a, b, noise in falls)


def _noise_beside(now: FitResult, result: FitResult) -> tuple[float, float]:
    """What the sensors' noise alone leaves through a fit without an effect, and how much less through one with it
    [N^2 m^2].

    Of a fit with one effect more that is beside the same friction: the effect at a strength of zero, and as it is.
    Friction that has stiffened to stand for what is missing passes on a great deal, and no effect hides that noise.
    """
    added = _added(now, result)
    exchanged = any(e.name not in result.plant for e in now.plant.effects)
    if exchanged or not added:
        without_it = floor_of(now, result.noise)
        return without_it, max(without_it - floor_of(result), 0.0)
    effect = added[0]
    if absent(effect) == effect:
        misfit, vector = without(result, effect.name)
    else:
        misfit, vector = result.misfit.onto(result.plant.replace(absent(effect)), result.vector)
    idle = replace(result, plant=misfit.plant(vector), misfit=misfit, vector=vector)
    most = now.misfit.residual(now.vector)  # the same for both: noise that a plant passes on has no other end
    without_it = floor_of(idle, result.noise, most)
    return without_it, max(without_it - floor_of(result, result.noise, most), 0.0)


def residual_of(result: FitResult) -> HeldOut:
    """What a fit leaves where the motion determines friction, for a drive that delivers everything."""
    misfit = result.misfit
    rows = misfit.residual(result.vector) * determined(misfit)
    return HeldOut(rows / math.sqrt(misfit.delivered(result.vector)), misfit.observations)


def left_of(misfit: Misfit, vector: Array) -> float:
    """Squared residual where the motion determines friction, for a drive that delivers everything [N^2 m^2]."""
    return float(np.sum(misfit.residual(vector)[determined(misfit)] ** 2)) / misfit.delivered(vector)


def floor_of(result: FitResult, noise: Noise | None = None, most: Array | None = None) -> float:
    """The same that sensor noise alone would leave, as found or another, see `FitResult.floor_under`, or that is
    negligible [N^2 m^2]."""
    misfit = result.misfit
    rows = result.floor_rows if noise is None else result.floor_under(noise, most)
    left = float(np.sum(rows[determined(misfit)] ** 2)) / misfit.delivered(result.vector)
    return max(left, result.negligible)


def simplest(trials: Sequence[Trial]) -> tuple[int, list[int]]:
    """Which of those that are as good as the best on held-out blocks has the fewest free parameters; and the others.

    As good is what is not told from the best, leaves hardly more, or too little to have a cause: long records, or such
    without noise, tell apart what makes no difference. So is what has fewer free parameters and leaves no more of what
    it was fitted to, as a coupling where a play has no gap: the further unknowns say nothing, and where refits beside
    them predict better a fold has led the others astray.

    Short of the noise floor the best leaves least of what it claims to foretell: a load that knocks about in its play
    forgets where it was, and says so. What foretells all of that and leaves as much is not as good.
    """

    @functools.cache
    def left(i: int) -> float:
        return left_of(trials[i].result.misfit, trials[i].result.vector)

    held_out = [t.held_out for t in trials]
    sizes = [t.result.misfit.coordinates.size for t in trials]
    best = min(range(len(trials)), key=lambda i: held_out[i].total)
    floors = [0.0] * len(trials)
    if not at_floor(trials[best].result, held_out[best]):
        floors = [floor_of(t.result) for t in trials]
        near = [i for i, h in enumerate(held_out) if h.total < CLOSE * held_out[best].total]
        best = min(near, key=lambda i: held_out[i].total - floors[i])
    equal = [
        i
        for i, h in enumerate(held_out)
        if floors[best] - floors[i] < LEAST_GAIN * h.total
        and (
            p_value(h, held_out[best]) > _CONFUSABLE
            or h.total - held_out[best].total < LEAST_GAIN * held_out[best].total
            or h.total <= trials[i].result.negligible
            or (sizes[i] < sizes[best] and left(i) <= (1 + _NO_MORE) * left(best))
        )
    ]
    chosen = min(equal, key=lambda i: (sizes[i], held_out[i].total))
    return chosen, [i for i in equal if i != chosen]


def leaves_much_less(before: FitResult, after: FitResult) -> bool:
    """Whether a fit leaves less than half of the squared error above the floor that another leaves.

    A plant that is stiffer passes on more of the encoder's noise, and has a floor to show for all that it leaves: the
    lower counts.
    """
    floor = min(before.floor, after.floor)
    return after.error**2 - floor**2 < MUCH_LESS * (before.error**2 - floor**2)


def discoveries(p_values: dict[str, float]) -> set[str]:
    """Names that pass with the false discovery rate controlled over all of them (Benjamini and Hochberg 1995)."""
    ranked = sorted(p_values, key=p_values.__getitem__)
    passed = 0
    for i, name in enumerate(ranked, 1):
        if p_values[name] <= FALSE_DISCOVERY_RATE * i / len(ranked):
            passed = i
    return set(ranked[:passed])
