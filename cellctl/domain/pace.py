"""How fast the machine goes along the predicted profile, how well it accelerates, and how far its time stamps can be trusted: from reports."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

RATE_BOUNDS = (0.0, 1000.0)  # process seconds per wire second; above 1 only where a simulated cell runs faster than life
SPANS = 10  # between reports, from which the rate is taken
NOISE_S = 0.012  # reports may be late by so much (USB bridges 1-16 ms, a loaded host); what is more is a change of speed
CHANGE = 0.15  # of the rate: a change
GAIN = 0.35  # of a report against the prediction, where its miss is one of many as large: then the time stamps are unsure
UNUSUAL = 3.0  # times the median miss: the machine did something else than predicted
MISSES = 11  # reports whose misses tell what is usual
STEADY = 0.01  # share of a span that another agility (PROBE) would add: below it there are no ramps in it
PROBE = 0.8  # of the present agility: what the profile is compared with
AGILITY_STEP = math.log(1.05)  # agility goes by such steps: few profiles are made
AGILITY_BOUNDS = (math.log(0.1), math.log(10.0))
FORGET = 0.97  # of what earlier ramps said, per span
KNOWN_S2 = 4e-4  # (s of ramps)^2 that have to speak before agility follows all of what they say


class Pace:
    """rate : process seconds per wire second    agility : acceleration of the control over that of the cell file"""

    def __init__(self) -> None:
        self.rate = 1.0
        self.agility = 1.0
        self._spans: deque[tuple[float, float]] = deque(maxlen=SPANS)
        self._with_ramps: deque[tuple[float, float]] = deque(maxlen=SPANS)
        self._has_late = False  # a span did not fit
        self._misses: deque[float] = deque(maxlen=MISSES)
        self._ramps = [0.0, 0.0]  # sums of sensitivity * miss and sensitivity^2

    def gain(self, ahead_s: float) -> float:
        """How much of a report's miss (process s) the follower takes over: all, unless such misses are usual."""
        usual = median(self._misses) if len(self._misses) >= MISSES // 2 else 0.0
        self._misses.append(abs(ahead_s))
        is_noise = abs(ahead_s) <= min(UNUSUAL * usual, NOISE_S * max(self.rate, 1.0))
        return GAIN if is_noise else 1.0

    def take(self, progress_s: float, span_s: float, ahead_s: float, sensitivity_s: float) -> None:
        """A span of motion: progress on the profile (process s) within wire time; ahead_s : what the prediction was short of.

        sensitivity_s : see take_ramps. Spans with ramps in them say little about the rate as long as the agility is not known.
        """
        known = self._spans or self._with_ramps
        is_off = bool(known) and abs(ahead_s) > max(NOISE_S * self.rate, CHANGE * self.rate * span_s)
        if is_off and not self._has_late:
            self._has_late = True  # believed when the next one says the same
            return
        if is_off:
            self._spans.clear()
            self._with_ramps.clear()
        self._has_late = False
        is_steady = abs(sensitivity_s) < STEADY * progress_s
        (self._spans if is_steady else self._with_ramps).append((progress_s, span_s))
        spans = self._spans or self._with_ramps
        measured = sum(progress for progress, _ in spans) / sum(span for _, span in spans)
        self.rate = min(max(measured, RATE_BOUNDS[0]), RATE_BOUNDS[1])

    def take_ramps(self, miss_s: float, sensitivity_s: float) -> None:
        """A span lasted `miss_s` (process s) longer than the profile; at PROBE times the agility it would have by `sensitivity_s`.

        Least squares with forgetting on 1 / agility, which the time of ramps is proportional to.
        """
        self._ramps[0] = FORGET * self._ramps[0] + sensitivity_s * miss_s
        self._ramps[1] = FORGET * self._ramps[1] + sensitivity_s * sensitivity_s
        if self._ramps[1] < 1e-12:
            return
        share = self._ramps[0] / (self._ramps[1] + KNOWN_S2)
        slowness = (1.0 + share * (1.0 / PROBE - 1.0)) / self.agility
        steps = round(-math.log(max(slowness, 1e-3)) / AGILITY_STEP)
        agility = math.exp(min(max(steps * AGILITY_STEP, AGILITY_BOUNDS[0]), AGILITY_BOUNDS[1]))
        if agility != self.agility:
            self.agility = agility
            self._ramps = [0.0, 0.0]
