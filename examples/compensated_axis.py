"""A servo axis with and without friction compensation, in the frequency and in the time domain.

The comparison that Yoon and Trumper (Mechatronics 24, 2014) make on their axis, in simulation: the same PID with
inertia feedforward follows the same commands alone, with a GMS observer on the exact friction, and with one identified
from three simulated logs. The figures of the paper's own section are not known to us; these are ours.

Frequency domain. The axis as the feedback sees it, from the torque of the feedback to the position, under multisines
of three amplitudes inside a slow position loop: friction makes it a spring below the Dahl resonance, which falls and
fades as the amplitude grows; compensated, it is a bare inertia. And the tracking response, from reference to position.

Time domain. The glitch where a sine turns; stick-slip, the limit cycle of a soft loop on a slow ramp; the time until a
positioning move has settled to one count; the chatter of the torque.

Run: python examples/compensated_axis.py [figure.png]      (the figure needs matplotlib)
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import gms_mujoco as gms
from gms_mujoco import control, demo
from gms_mujoco.bench import Measurement, run_loop
from gms_mujoco.excitation import Excitation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

PLANT = Plant.load("servo_axis")
J = PLANT.inertia
FC = PLANT["gms"].coulomb
H = 1 / 2000  # s
COUNT = 2 * np.pi / 1e6  # rad
LEVELS = (0.03, 0.15, 0.6)  # rms of the torque, in Coulomb levels
AMPLITUDES = (30, 300, 3000)  # rms of the reference [counts]
PERIODS, TRANSIENT = 3, 2

Compensator = Callable[[], control.Controller]


class Nothing(control.Controller):
    def __call__(self, observation: np.ndarray) -> float:
        return 0.0


class Kept(control.Controller):
    """A controller whose torques are kept."""

    def __init__(self, inner: control.Controller) -> None:
        self.inner, self.torque = inner, []

    def __call__(self, observation: np.ndarray) -> float:
        self.torque.append(self.inner(observation))
        return self.torque[-1]


def compensators() -> dict[str, Compensator]:
    """None, exact and identified."""
    logs = [r for r in demo.records(PLANT, np.random.default_rng(5)) if r.use == "fit"]
    model = gms.fit(gms.baseline(J), logs).plant
    return {
        "uncompensated": Nothing,
        "GMS observer, exact": lambda: control.GMSObserver(PLANT, H),
        "GMS observer, identified": lambda: control.GMSObserver(model, H),
    }


def servo(bandwidth: float) -> control.Controller:
    return control.PID(J, H, bandwidth) + control.Feedforward(J)


def run(reference: np.ndarray, compensator: Compensator, bandwidth: float) -> Record:
    """Log of a command that begins at 0."""
    return run_loop(PLANT, servo(bandwidth) + compensator(), reference, H, substeps=5, resolution=COUNT)


def axis_frf(compensator: Compensator, level: float) -> gms.FRF:
    """From the torque of the feedback to the position, in a loop of 5 Hz."""
    wave = Excitation.multisine(H, period=1.0, low=3.0, high=300.0, rms=level * FC, seed=1, kind="odd_random")
    signal = wave.repeat(PERIODS + TRANSIENT)
    against = Kept(compensator())
    loop = control.PID(J, H, 5.0) + against
    log = run_loop(PLANT, loop, np.zeros(len(signal)), H, added=signal, substeps=5, resolution=COUNT)
    rest = log.torque - np.array(against.torque)
    seen = Record(f"{level:g} Fc", log.time, {"torque": rest, "position": log.position}, "fit", COUNT)
    return Measurement((seen,), (signal,), wave.lines, wave.period, TRANSIENT, closed=True).frf()


def tracking_frf(compensator: Compensator, counts: float, bandwidth: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and complex response from reference to position, of the feedback alone and the compensator."""
    wave = Excitation.multisine(H, period=1.0, low=2.0, high=100.0, rms=counts * COUNT, seed=2, kind="odd_random")
    reference = wave.repeat(PERIODS + TRANSIENT, TRANSIENT)
    loop = control.PID(J, H, bandwidth) + compensator()
    log = run_loop(PLANT, loop, reference, H, substeps=5, resolution=COUNT)
    n = PERIODS * len(wave.wave)
    lines = PERIODS * wave.lines
    return wave.frequency, np.fft.rfft(log.position[-n:])[lines] / np.fft.rfft(reference[-n:])[lines]


def resonance(frf: gms.FRF) -> tuple[float, float]:
    """Height of the peak over the three lowest lines, and its frequency [Hz]; 0 and 0 where it falls from them on."""
    size = np.abs(frf.response)
    peak = int(np.argmax(size))
    return (0.0, 0.0) if peak < 3 else (float(size[peak] / np.median(size[:3])), float(frf.frequency[peak]))


def off_the_mass_line(frf: gms.FRF) -> float:
    """Rms distance of the magnitude from 1 / (J w^2) up to 100 Hz [dB]."""
    low = frf.frequency < 100
    off = 20 * np.log10(np.abs(frf.response[low]) * J * frf.omega[low] ** 2)
    return float(np.sqrt(np.mean(off**2)))


def sine() -> np.ndarray:
    """Two seconds at 2 Hz, five times the range in which friction turns over."""
    t = H * np.arange(round(2.0 / H))
    return 0.02 * (1 - np.cos(2 * np.pi * 2.0 * t))


def ramp() -> np.ndarray:
    """Five seconds at 0.03 rad/s."""
    return 0.03 * H * np.arange(round(5.0 / H))


def move() -> np.ndarray:
    """A minimum-jerk move of 16000 counts, and a rest after it."""
    s = np.clip(H * np.arange(round((MOVE_TIME + 0.6) / H)) / MOVE_TIME, 0, 1)
    return 16000 * COUNT * s**3 * (10 - 15 * s + 6 * s**2)


MOVE_TIME = 0.2  # s


@dataclass(frozen=True)
class Times:
    """Time-domain figures of one compensator, in counts, seconds and N m; logs to draw."""

    sine: Record
    ramp: Record
    settle: Record
    rms: float
    glitch: float
    cycle: float
    settling: float
    chatter: float


def in_time(compensator: Compensator) -> Times:
    """Error, glitch and chatter on the sine (50 Hz loop), limit cycle (3 Hz loop), settling (20 Hz loop)."""
    log = run(sine(), compensator, 50.0)
    error = (sine() - log.position)[log.time > 0.5] / COUNT
    slow = run(ramp(), compensator, 3.0)
    cycle = (ramp() - slow.position)[slow.time > 2.0] / COUNT
    settle = run(move(), compensator, 20.0)
    out = np.abs(move() - settle.position) > 1.01 * COUNT
    settled = settle.time[np.flatnonzero(out)[-1]] - MOVE_TIME if out.any() else 0.0
    chatter = np.std(np.diff(log.torque))
    return Times(
        log, slow, settle, float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()), float(np.ptp(cycle)),
        max(float(settled), 0.0), float(chatter),
    )  # fmt: skip


def main() -> None:
    made = compensators()
    print("axis as the feedback sees it: Dahl resonance [Hz], its height over the low lines, rms off 1/(J w^2) [dB]")
    frfs = {name: [axis_frf(c, level) for level in LEVELS] for name, c in made.items()}
    for name, found in frfs.items():
        cells = []
        for frf in found:
            height, at = resonance(frf)
            seen = f"{at:5.1f} Hz x{height:4.1f}" if height else "      none    "
            cells.append(f"{seen} {off_the_mass_line(frf):5.1f} dB")
        print(f"  {name:26s}" + "".join(f"{c:>28s}" for c in cells))
    print(f"  {'rms torque':26s}" + "".join(f"{f'{level:g} Fc':>28s}" for level in LEVELS))
    tracking = {name: [tracking_frf(c, a) for a in AMPLITUDES] for name, c in made.items()}
    print("tracking in a 20 Hz loop: rms of |1 - T| below 10 Hz")
    for name, found in tracking.items():
        cells = [np.sqrt(np.mean(np.abs(1 - t[f < 10]) ** 2)) for f, t in found]
        print(f"  {name:26s}" + "".join(f"{c:28.3f}" for c in cells))
    print(f"  {'rms reference':26s}" + "".join(f"{f'{a:g} counts':>28s}" for a in AMPLITUDES))
    times = {name: in_time(c) for name, c in made.items()}
    print("in time:")
    print(f"  {'':26s}{'sine rms':>12s}{'glitch':>12s}{'limit cycle':>13s}{'settling':>12s}{'chatter':>14s}")
    print(f"  {'':26s}{'[counts]':>12s}{'[counts]':>12s}{'[counts p-p]':>13s}{'[ms]':>12s}{'[mN m/sample]':>14s}")
    for name, t in times.items():
        row = f"{t.rms:12.2f}{t.glitch:12.1f}{t.cycle:13.1f}{1e3 * t.settling:12.1f}{1e3 * t.chatter:14.4f}"
        print(f"  {name:26s}{row}")
    if len(sys.argv) > 1:
        draw(sys.argv[1], frfs, tracking, times)
        print(f"wrote {sys.argv[1]}")


def draw(path: str, frfs: dict, tracking: dict, times: dict) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shades, exact = ("#f2b8b5", "#e0605e", "#8c1d18"), ("#a8d5ba", "#3f9b6c", "#10543a")
    names = list(frfs)
    figure, axes = plt.subplots(2, 3, figsize=(15, 8.2), constrained_layout=True)
    a = axes[0, 0]
    for name, colours in zip(names[:2], (shades, exact), strict=True):
        for frf, level, colour in zip(frfs[name], LEVELS, colours, strict=True):
            a.loglog(frf.frequency, np.abs(frf.response), color=colour, lw=1.3, label=f"{name}, {level:g} Fc")
    f = frfs[names[0]][0].frequency
    a.loglog(f, 1 / (J * (2 * np.pi * f) ** 2), "k--", lw=1, label="bare inertia")
    a.set(title="axis as the feedback sees it", xlabel="frequency [Hz]", ylabel="position over torque [rad/(N m)]")
    a = axes[0, 1]
    for name, colours in zip(names[:2], (shades, exact), strict=True):
        for (f, t), counts, colour in zip(tracking[name], AMPLITUDES, colours, strict=True):
            a.semilogx(f, 20 * np.log10(np.abs(t)), color=colour, lw=1.3, label=f"{name}, {counts} counts")
    a.set(title="tracking, PID of 20 Hz", xlabel="frequency [Hz]", ylabel="position over reference [dB]")
    lines = dict(zip(names, ("#c44e52", "#2a9d5c", "#4c72b0"), strict=True))
    command, slow, target = sine(), ramp(), move()
    for name, t in times.items():
        own = {"color": lines[name], "lw": 1.1, "label": name}
        axes[0, 2].plot(t.sine.time, (command - t.sine.position) / COUNT, **own)
        axes[1, 0].plot(t.ramp.time, (slow - t.ramp.position) / COUNT, **own)
        off = np.abs(target - t.settle.position) / COUNT
        axes[1, 1].semilogy(1e3 * (t.settle.time - MOVE_TIME), np.maximum(off, 0.3), **own)
        axes[1, 2].plot(t.ramp.time, 1e3 * t.ramp.torque, **own)
    axes[0, 2].set(title="2 Hz sine, PID of 50 Hz: glitch at each reversal", xlabel="time [s]", xlim=(0.5, 1.1),
                   ylabel="tracking error [counts]")
    axes[1, 0].set(title="stick-slip on a ramp of 0.03 rad/s, PID of 3 Hz", xlabel="time [s]", xlim=(0, 5),
                   ylabel="tracking error [counts]")
    axes[1, 1].set(title="settling after a move, PID of 20 Hz", xlabel="time after the end of the move [ms]",
                   ylabel="|error| [counts], 0.3: none", xlim=(-200, 300))
    axes[1, 1].axhline(1, color="k", lw=0.7, ls="--")
    axes[1, 2].set(title="torque on that ramp", xlabel="time [s]", ylabel="torque [mN m]", xlim=(0, 5))
    for a in axes.flat:
        a.grid(alpha=0.25, which="both")
        a.legend(fontsize=7, loc="best")
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main()
