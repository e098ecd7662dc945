"""Learning from repetition: a torque that gets better each time the same motion is asked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from .base import Array, Controller, expect_positive


class ILC(Controller):
    """Iterative learning control: feedback, and a torque over time that learns from what the feedback had to do.

    After a trial the learned torque becomes  Q (learned + gain * feedback, `lead` samples ahead)  with Q a zero-phase
    low-pass: feedback-error learning, which needs no model (Bristow, Tharayil and Alleyne, Control Systems Magazine
    2006). Only the same reference from the same start profits.

    Args:
        feedback: makes the feedback anew for every trial.
        sample_time: [s].
        gain: of the learning, in (0, 1].
        bandwidth: of Q [Hz].
        lead: samples by which the feedback is late.
    """

    def __init__(
        self, feedback: Callable[[], Controller], sample_time: float, gain: float = 0.7, bandwidth: float = 100.0,
        lead: int = 2,
    ) -> None:
        expect_positive(sample_time=sample_time, bandwidth=bandwidth)
        self.make, self.gain, self.lead, self.sample_time = feedback, gain, lead, sample_time
        self.filter = scipy.signal.butter(2, min(2 * bandwidth * sample_time, 0.99))
        self.learned: Array = np.zeros(0)
        self.feedback, self.done = feedback(), list[float]()

    def __call__(self, observation: Array) -> float:
        k = len(self.done)
        self.done.append(float(self.feedback(observation)))
        return self.done[k] + (float(self.learned[k]) if k < len(self.learned) else 0.0)

    def again(self) -> ILC:
        """Learns from the trial that is over and gets ready for the next one; returns itself."""
        done = np.array(self.done)
        learned = np.zeros(len(done))
        m = min(len(done), len(self.learned))
        learned[:m] = self.learned[:m]
        ahead = np.concatenate([done[self.lead :], np.repeat(done[-1:], self.lead)])[: len(done)]
        raw = learned + self.gain * ahead
        self.learned = scipy.signal.filtfilt(*self.filter, raw) if len(raw) > 9 else raw
        self.feedback, self.done = self.make(), []
        return self
