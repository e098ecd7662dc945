"""What sensors and sampling alone do to the torque error: noise estimated from records, and the floor that it sets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ..logs.encoder import count_size
from ..native import Joint, Motion
from ..plant import Plant
from ..record import Record
from ..threads import each
from .between_samples import delivered, mean_torque, rms_torque, second_difference
from .frf_observation import Seen
from .grid import Grid, Path
from .inverse import Observation
from .variances import likeliest

Array = NDArray[np.float64]

_QUIET_FROM = 0.15  # of the Nyquist frequency: above it the motion says little and the sensors all
_QUIETER = 0.25  # quantile over the records
_ALIKE = 0.15  # scatter of the logarithm of what is the same in all records, and is read from noise
_APART = 0.3  # of what is not
_FURTHER = 3.0  # times as far from each other as what is the same
_FEWEST_RECORDS = 3  # that tell the one from the other
_MOSTLY = 0.5  # of the power: below, what is known can be taken off without much doubt
_BINS = 25  # of a spectrum's frequencies, whose median is taken
_FEWEST_SAMPLES = 10  # per period of the highest frequency compared: within it a held torque is well resolved
_FINER = 20.0  # than the instants that a replay takes
_NEGLIGIBLE = 0.01  # of the torque
_QUIET = 0.25  # of the noise: enough less to tell what grows with it
_STRETCH = 64  # samples
_LONG, _SCATTER = 256, 1.5  # samples, over which the squares of two draws of noise differ by less than this factor
_PARTS = 8  # of a sample, in which a possible motion is followed
_INSTANT = 1e-9  # s, and m or rad: next to nothing


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise on the samples of a record.

    Attributes:
        torque: [N m].
        position: [rad], quantisation included.
        resolution: position of one encoder count [rad]; 0 where the record shows none.
        share: of the rms torque of each record, where the noise of the torque is that; 0 where it is the same in all.
    """

    torque: float
    position: float
    resolution: float
    share: float = 0.0

    def torque_in(self, record: Record) -> float:
        """That of the torque of one record [N m]."""
        return self.share * rms_torque(record) if self.share else self.torque


def estimate_noise(records: Sequence[Record], inertia: float) -> Noise:
    """Noise of the sensors that all records share.

    It is read from the part of the spectrum of u - J q'' that the motion hardly reaches, where noise on the torque
    and noise on the position have known shapes: flat, and rising with the fourth power of frequency. Friction only
    adds to that spectrum, so the quieter records say what the noise is; a median over segments keeps single events
    (reversals, impacts) out of each.
    """
    groups = _by_rate(records)
    told = [_density(alike, inertia) for alike in groups]
    variance = _variances(*(np.concatenate(x) for x in zip(*told, strict=True)))
    count = float(np.median([count_size(r) for r in records]))
    torque, position = np.sqrt(variance)
    # Counts that are coarser than the motion make no white noise; that of the torque is in the torque at least.
    loudness = np.concatenate(list(map(_loudness, groups)))
    torque = min(torque, float(np.quantile(loudness, _QUIETER)))
    return Noise(float(torque), max(float(position), count / np.sqrt(12)), count)


def _by_rate(records: Sequence[Record]) -> list[list[Record]]:
    """Those that are sampled alike together, the fastest first."""
    rest, groups = list(records), []
    while rest:
        fastest = min(r.sample_time for r in rest)
        groups.append([r for r in rest if abs(fastest / r.sample_time - 1) < 1e-3])
        rest = [r for r in rest if abs(fastest / r.sample_time - 1) >= 1e-3]
    return groups


def _density(alike: Sequence[Record], inertia: float) -> tuple[Array, Array]:
    """What noises of a variance of one on torque and position are in the spectrum of u - J q'', (n, 2), and how loud
    that is in the quieter of records that are sampled alike, (n,)."""
    h, segment = _cut(alike)
    errors = [mean_torque(r) - _rigid(r, inertia) for r in alike]
    inertia = typical_inertia(alike, inertia)
    f, use = _where_sensors_say_all(segment, h)
    # Smoothed before the quieter ones are taken: of ragged spectra a low quantile is their raggedness.
    spectra = _spectra([e[1:-1] for e in errors], segment, h)
    smooth = [scipy.signal.medfilt(d, min(_BINS, (len(d) - 1) | 1)) for d in spectra]
    half = np.pi * f * h
    passed = 1 - np.sin(half) ** 2 / 3 if alike[0].sensed else np.cos(half)  # of the torque, by its mean
    shapes = 2 * h * np.stack([passed**2, (inertia / h**2) ** 2 * (2 * np.sin(half)) ** 4], 1)
    return shapes, np.quantile(smooth, _QUIETER, axis=0)[use]


def _cut(records: Sequence[Record]) -> tuple[float, int]:
    """Sample time [s] of records that are sampled alike, and samples of a segment that their spectra are made of."""
    return float(np.mean([r.sample_time for r in records])), min(1024, *(len(r) // 4 for r in records))


def _where_sensors_say_all(segment: int, h: float) -> tuple[Array, NDArray[np.bool_]]:
    """Frequencies of a spectrum where the motion says little [Hz], and which of all they are."""
    f = np.asarray(np.fft.rfftfreq(segment, h), np.float64)
    use = (f > _QUIET_FROM / (2 * h)) & (f < 0.95 / (2 * h))
    return f[use], use


def _spectra(series: Sequence[Array], segment: int, h: float) -> list[Array]:
    """Spectra of series, by medians over segments."""
    how = {"nperseg": segment, "average": "median", "detrend": "linear"}
    return each(lambda x: scipy.signal.welch(x, 1 / h, **how)[1], series)


def _loudness(records: Sequence[Record]) -> Array:
    """(n,) white noise that would be as loud as the torque of each record where the motion says little [N m]."""
    h, segment = _cut(records)
    _, use = _where_sensors_say_all(segment, h)
    return np.sqrt([np.median(d[use]) / (2 * h) for d in _spectra([r.torque for r in records], segment, h)])


def _most_torque(record: Record, inertia: float) -> float:
    """How loud the noise of the torque may be, as the high frequencies of a record tell [N m].

    Where counts are louder in u - J q'' even at the lowest of these, at which they are least, it is what the torque
    itself shows, in which a controller's answer to these counts may be too.
    """
    noise, h = estimate_noise([record], inertia), record.sample_time
    least = noise.position * typical_inertia([record], inertia) / h**2 * (2 * np.sin(np.pi * _QUIET_FROM / 2)) ** 2
    return noise.torque if noise.torque > least else float(_loudness([record])[0])


def _variances(shapes: Array, density: Array) -> Array:
    """(k,) variances of noises of known spectra (n, k) that together have density (n,), by Whittle's likelihood.

    It weighs relative errors, so that the loud end does not rule.
    """
    least = 1e-12 * float(density.max(initial=0.0))
    if not least > 0:
        return np.zeros(shapes.shape[1])
    density = np.maximum(density, least)
    scale = shapes.mean(0) / density.mean()
    return np.asarray(likeliest(shapes / scale, density, np.full(shapes.shape[1], 0.5)) / scale)


def refine_noise(
    noise: Noise, observations: Sequence[Seen], residuals: Sequence[Array], inertia: float = 0.0
) -> Noise:
    """The noise, with that of the torque no larger than what a model has left most of the time.

    What a model leaves over is noise and its own errors; the median over short segments and over frequencies
    ignores errors that come and go. A band-limited residual sees what high frequencies cannot show. What the noise
    of the position leaves in it, through the inertia, is not that of the torque. Where it is the same share of the
    torque in each record, as of a log whose noise was given in dB or of a sensor whose range was changed, that is it.

    Args:
        residuals: (m,) torque residual of each observation [N m].
        inertia: [kg m^2].
    """
    seen = [(o, r) for o, r in zip(observations, residuals, strict=True) if isinstance(o, Observation)]
    if not seen:
        return noise
    own, most = np.array(each(lambda t: _left_of_noise(*t, noise, inertia), seen)).T
    heard = own[np.isfinite(own)]
    least = float(np.median(heard)) if len(heard) else math.inf
    share = _common_share(most, [o.record for o, _ in seen], inertia)
    return replace(noise, torque=min(noise.torque, least), share=share)


def _left_of_noise(o: Observation, residual: Array, noise: Noise, inertia: float) -> tuple[float, float]:
    """Noise of the torque that a residual shows, without what the noise of the position leaves in it, and with it
    [N m]; inf where rests that say nothing, and are 0 in it, leave no stretch of it."""
    n = min(_STRETCH, len(residual))
    told = np.all(residual[: len(residual) // n * n].reshape(-1, n), axis=1)
    if not told.any():
        return math.inf, math.inf
    f, _, power = scipy.signal.spectrogram(residual, 1 / o.step, nperseg=n, noverlap=0, detrend="linear")
    inside = _inside(f, o.bandwidth)
    # The median of a periodogram's exponential distribution is ln 2 of its mean.
    h = o.record.sample_time
    density = np.median(power[inside][:, told], axis=1) / np.log(2) / (2 * h)
    twice = (2 * np.sin(np.pi * f[inside] * h) / h) ** 2  # differentiated
    known = (typical_inertia([o.record], inertia) * noise.position * twice) ** 2
    quiet = known < _MOSTLY * density
    if not quiet.any():
        return (float(np.sqrt(np.min(density))),) * 2
    return float(np.sqrt(np.median((density - known)[quiet]))), float(np.sqrt(np.median(density[quiet])))


def shows_noise(observation: Observation) -> bool:
    """Whether a record is long enough for `refine_noise`: its spectrum has a frequency well inside the band."""
    n = min(_STRETCH, max(len(observation.index), 1))
    return bool(_inside(np.asarray(np.fft.rfftfreq(n, observation.step)), observation.bandwidth).any())


def _inside(frequency: Array, bandwidth: float) -> NDArray[np.bool_]:
    """(n,) which frequencies are well inside a band, where its edge and the slow motion say little [Hz]."""
    return (frequency > 0.1 * bandwidth) & (frequency < 0.7 * bandwidth)


def _common_share(left: Array, records: Sequence[Record], inertia: float) -> float:
    """The noise of each record over its torque, where that is the same in all and the noise is not; else 0.

    What is read from a record is its noise at most: where one stands out above the others, they tell.

    Args:
        left: (n,) noise that a model has left of each record, at most [N m]; inf where it says nothing.
        inertia: [kg m^2].
    """
    sizes = np.array([rms_torque(r) for r in records])
    if min(inertia, sizes.min()) <= 0 or _apart(sizes) < _APART:
        return 0.0
    noise = np.minimum(left, [_most_torque(r, inertia) for r in records])
    if noise.min() <= 0:
        return 0.0
    by_share = np.argsort(noise / sizes)
    for told in (by_share, by_share[:-1]):
        known, size = noise[told], sizes[told]
        asks = np.isfinite(left[told]).sum() >= _FEWEST_RECORDS and _apart(size) >= _APART
        if asks and _apart(known / size) < min(_ALIKE, _apart(known) / _FURTHER):
            return float(np.median(known / size))
    return 0.0


def _apart(values: Array) -> float:
    """Standard deviation of the logarithm."""
    return float(np.std(np.log(values)))


def inertia_along(record: Record, inertia: float) -> Array | float:
    """(n,) inertia about the joint of a robot in the poses of a record, or that of the axis [kg m^2]."""
    change = record.get("inertia_change")
    return inertia if change is None else inertia + change


def _rigid(record: Record, inertia: float) -> Array:
    """(n,) torque that the rigid bodies take; noise of a robot's other encoders is in it, with the same shape [N m]."""
    torque = inertia_along(record, inertia) * second_difference(record.position, record.sample_time)
    more = record.get("rigid_torque")
    return torque if more is None else torque + more


def typical_inertia(records: Sequence[Record], inertia: float) -> float:
    """Root mean square of the inertia about the joint over the records [kg m^2]."""
    return float(np.sqrt(np.mean([np.mean(np.square(inertia_along(r, inertia))) for r in records])))


def noise_of(observations: Sequence[Seen], residuals: Sequence[Array], inertia: float) -> Noise:
    """Noise of the sensors that all records share, given what a model has left; none where there are no records."""
    records = [o.record for o in observations if isinstance(o, Observation)]
    if not records:
        return Noise(0.0, 0.0, 0.0)
    return refine_noise(estimate_noise(records, inertia), observations, residuals, inertia)


def rough_inertia(records: Sequence[Record]) -> float:
    """Inertia from torque against acceleration, direction and velocity; enough to scale noise by."""
    tops, sides = [], []
    for r in records:
        o = Observation(r, 1 / (20 * r.sample_time))
        v = o.velocity[o.index]
        tops.append(np.stack([o.acceleration, np.sign(v), v, np.ones_like(v)], 1))
        none = Plant.axis(1.0)
        sides.append(o.applied(none) + o.replay(none))  # without what a robot's rigid bodies take
    a, y = np.concatenate(tops), np.concatenate(sides)
    scale = np.maximum(np.sqrt(np.mean(a**2, 0)), 1e-300)
    value = float((np.linalg.lstsq(a / scale, y, rcond=None)[0] / scale)[0])
    return value if value > 0 else float(np.std(y) / scale[0])


def choose_bandwidth(records: Sequence[Record], inertia: float | None = None) -> float:
    """Bandwidth [Hz] up to which the position still says what the acceleration is.

    It ends where the noise of the position, differentiated twice, would add more to the torque error than the
    noise of the torque itself or 1 % of the torque, and at the latest at a tenth of the sampling rate.
    """
    inertia = inertia or rough_inertia(records)
    noise = estimate_noise(records, inertia)
    inertia = typical_inertia(records, inertia)
    h = max(r.sample_time for r in records)
    f = np.geomspace(1 / (400 * h), 1 / (_FEWEST_SAMPLES * h), 60)
    # Integral of (2 sin(pi f h))^4 from 0 to f, for small f h.
    added = 2 * h * (inertia * noise.position * (2 * np.pi) ** 2) ** 2 * f**5 / 5
    rms = np.mean([np.mean(r.torque**2) for r in records])
    fine = np.flatnonzero(added <= np.maximum(2 * h * noise.torque**2 * f, _NEGLIGIBLE**2 * rms))
    return float(f[fine[-1]] if len(fine) else f[0])


def floor_residual(
    observation: Seen, plant: Plant, memory: Array | None, noise: Noise, rng: np.random.Generator,
    left: Array | None = None, sampling: Array | None = None,
) -> Array:  # fmt: skip
    """(m,) residual that `plant` itself would leave on data like these; of a response its uncertainty [N m].

    Args:
        left: (m,) what it leaves: the part of sensors is scaled down as `believable` says, that of `hidden_residual` to
            the power that is left beside it; None: neither is.
        sampling: (m,) of a record its `sampling_residual`, where that is known.
    """
    if not isinstance(observation, Observation):
        drawn = observation.floor(rng)
        return drawn if left is None else believable(drawn, left)
    motion = simulated(observation, plant, memory, noise)
    known = sampling_residual(observation, plant, memory) if sampling is None else sampling
    drawn = sensor_residual(observation, plant, memory, noise, rng, motion) + known
    hidden = hidden_residual(observation, plant, memory, motion)
    if left is None:
        return drawn + hidden
    # Over the record, not stretch by stretch: when the axis turns back is chance, and how often much the same.
    drawn = believable(drawn, left)
    return drawn + hidden * _room(drawn, hidden, left)


def sensor_residual(
    observation: Observation, plant: Plant, memory: Array | None, noise: Noise, rng: np.random.Generator,
    motion: Motion | None = None,
) -> Array:  # fmt: skip
    """(m,) residual that the noise of the sensors alone leaves on a record, one draw [N m].

    A motion that the plant can make under the measured torque, see `possible_motion`, is taken as true. It is read
    again through a noisy, quantising encoder and passed through the same inverse dynamics. What stays the same when
    the noise is a fourth of that is no noise but a plant that turns over at the least cause, and is left out.
    """
    r = observation.record
    true = possible_motion(observation, plant, noise, motion or simulated(observation, plant, memory, noise))
    seen = observation.again(true).unsmoothed().needed(plant, memory)
    extra = np.sqrt(max(noise.position**2 - noise.resolution**2 / 12, 0.0)) * rng.standard_normal(len(true))
    read = true + extra
    if noise.resolution:
        # A second reading through the same counts would agree with the first more than two readings do, as far as
        # the motion still holds some of it: the counts are put elsewhere.
        shift = noise.resolution * (0.25 + 0.5 * rng.random())
        read = np.round((read + shift) / noise.resolution) * noise.resolution - shift
    torque = observation.band(mean_torque(r, noise.torque_in(r) * rng.standard_normal(len(r))))
    loud, quiet = (
        part * torque - (observation.again(true + part * (read - true)).needed(plant, memory) - seen)
        for part in (1.0, _QUIET)
    )
    return loud * _growth(loud, quiet)


def believable(floor: Array, residual: Array) -> Array:
    """(m,) floor, scaled down over long stretches where it is louder than what is left: noise and errors together.

    A plant that stands at a threshold may turn over for seconds by another draw of the noise, and did not by that of
    the record.
    """
    stretch = np.arange(len(floor)) // _LONG
    square, most = (np.bincount(stretch, x**2) for x in (floor, residual))
    return floor * np.sqrt(np.minimum(_SCATTER * most / np.maximum(square, 1e-300), 1.0))[stretch]


def _room(drawn: Array, hidden: Array, left: Array) -> float:
    """The share of `hidden`, at most 1, with which it and what is drawn are together as loud as what is left."""
    # The root of a quadratic: where both say whether the axis turned back, noise undoes a part of what samples hide.
    square, rest, common = float(hidden @ hidden), float(left @ left - drawn @ drawn), float(hidden @ drawn)
    root = np.sqrt(max(common**2 + square * rest, 0.0))
    return float(np.clip((root - common) / max(square, 1e-300), 0.0, 1.0))


def _growth(loud: Array, quiet: Array) -> Array:
    """(m,) share of what noise leaves that grows with the noise, root of that of the squares, over short stretches."""
    stretch = np.arange(len(loud)) // _STRETCH
    loud_square, quiet_square = (np.bincount(stretch, x**2) for x in (loud, quiet))
    constant = quiet_square / np.maximum(loud_square, 1e-300)
    return np.asarray(np.sqrt(np.clip((1 - constant) / (1 - _QUIET**2), 0, 1)))[stretch]


def possible_motion(observation: Observation, plant: Plant, noise: Noise, motion: Motion | None) -> Array:
    """(n,) position that the encoder would have read like this, and along which the torque of the plant balances [rad].

    While the contact bends by less than a count the smoothed readings rest, or step where the axis glides, and the
    plant needs another torque along them than along the motion. So it is taken as `simulated`; what strays far from the
    readings all the same, because the plant errs, is scaled down to a count. Without counts the smoothed position is
    that motion.
    """
    if motion is None:
        return observation.position
    strayed = motion.position[::_PARTS] - observation.seen_by(plant).position
    return observation.position + _within(strayed, noise.resolution)


def simulated(observation: Observation, plant: Plant, memory: Array | None, noise: Noise) -> Motion | None:
    """(_PARTS * n) motion of the joint under the measured torque, of which what strays further from the readings than
    half a count is pulled back; None where there are no counts, or it runs away."""
    r, seen, inertia = observation.record, observation.seen_by(plant), plant.driven_inertia
    if not noise.resolution or inertia <= 0:
        return None

    def often(name: str) -> Array | None:
        values = r.get(name)
        return None if values is None else np.repeat(values, _PARTS)

    torque, rigid = delivered(plant, r, _PARTS), often("rigid_torque")
    motion = plant.joint().simulate(
        typical_inertia([r], inertia), r.sample_time / _PARTS, torque if rigid is None else torque - rigid,
        float(seen.position[0]), float(seen.velocity[0]),
        start=float(r.time[0]), load=often("load"), temperature=often("temperature"), memory=memory,
        path=np.interp(np.arange(len(torque)) / _PARTS, np.arange(len(r)), seen.position),
        near=noise.resolution / 2, pull=2 * np.pi * observation.bandwidth,
    )  # fmt: skip
    return motion if np.isfinite(motion.position).all() else None


def hidden_residual(observation: Observation, plant: Plant, memory: Array | None, motion: Motion | None) -> Array:
    """(m,) residual that comes of what a `simulated` motion does between its samples, one draw [N m].

    Where the speed touches zero there, the axis may turn back for microseconds, of which no sample knows. Friction that
    drops as it turns then goes another way until it has slipped again. It is the difference between the torques that
    the same plant needs along the samples and along all of the motion: nothing that it lacks is in it.
    """
    r, joint = observation.record, plant.joint()
    if motion is None or not keeps_turns(joint):
        return np.zeros(len(observation.index))
    instants = np.arange((len(r) - 1) * _PARTS + 1) / _PARTS
    position, velocity = (x[: len(instants)] for x in (motion.position, motion.velocity))
    velocity = np.append((velocity[1:] + velocity[:-1]) / 2, velocity[-1])  # a step jumps to the one that it ends with
    time, load, temperature = (
        None if x is None else np.interp(instants, np.arange(len(r)), x)
        for x in (r.time, r.get("load"), r.get("temperature"))
    )
    assert time is not None
    whole = Grid(instants).mean(Path(time, position, velocity, load, temperature).torque(joint, memory))
    seen = observation.again(position[::_PARTS]).unsmoothed()
    bare = replace(plant, effects=tuple(e for e in plant.effects if e.kind != "sensor"))  # that is where the joint is
    return seen.replay(bare, memory) + seen.rigid - observation.band(whole)


def keeps_turns(joint: Joint) -> bool:
    """Whether friction that slides is another after a turn back for next to no way and time.

    Friction that is alike in both directions comes back from there to where it was.
    """
    if not joint.n_effects:
        return False
    time = np.array([0, 1, 1 + _INSTANT, 1 + 2 * _INSTANT])
    for way in (1.0, -1.0):
        far = way * np.array([0, 1, 1 - _INSTANT, 1])  # [rad or m]
        torque = joint.replay(time, far, way * np.array([1.0, 1.0, -1.0, 1.0]), load=np.ones(4)).torque
        if abs(torque[3] - torque[1]) > _NEGLIGIBLE * abs(torque[1]):
            return True
    return False


def _within(strayed: Array, most: float) -> Array:
    """(n,) what strays further than `most` for long, scaled down to it: the encoder would not have read that."""
    # A running mean that was large may round to less than nothing.
    usual = np.sqrt(scipy.ndimage.uniform_filter1d(strayed**2, _LONG, mode="nearest").clip(0))
    return np.asarray(strayed * np.minimum(most / np.maximum(usual, 1e-300), 1.0))


def sampling_residual(observation: Observation, plant: Plant, memory: Array | None) -> Array:
    """(m,) part of `floor_residual` that is known: what closer instants between samples would still change [N m]."""
    return observation.replay(plant, memory) - observation.replay(plant, memory, finer=_FINER)
