"""The receiver's clock against ours, from below: no sentence arrives before it was sent.

A fix arrives late by a constant delay, by a wobble above it, and by a level that jumps now and
then. The earliest arrivals tell the constant; a line through them, as steep as our oscillator is
wrong, tells the drift. Times are seconds and milliseconds of floating point here, both counted
from the first fix: a day of them is kept to less than a nanosecond.
"""

from collections import deque
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BLOCK_S = 15.0
"""Of so much time only the earliest arrival counts."""
JUMP_MS = 100.0
"""Between two fixes a second apart the wobble moves some milliseconds: more is another level."""
LEVEL_SIGMA_MS = 12.0
"""How far the wobble blurs the size of a jump; so far a level may move in a gap and be the same."""
GAP_S = 10.0
"""After so long without a fix the wobble may have gone anywhere, and the level may be another."""
KEPT_WHOLE_STEPS = 16
AGREEING = 3
"""As many fixes in a row make a level; fewer are outliers."""
OSCILLATOR_PPM = 30.0
"""One standard deviation of a machine's oscillator: 50 ppm are promised."""
BEND_S = 1200.0
BEND_PPM = 3.0
"""So much the oscillator's rate changes with temperature in ``BEND_S``: 5 ppm at most."""
WOBBLE_MS = 85.0
"""How far above the earliest possible a fix arrives on average; 170 ms have been seen."""
CORRELATION_S = 60.0
"""Fixes that are closer than this say the same."""
EARLY = 99.0
"""How much worse a fix before the line is than one after it."""
MS_PER_S = 1e-3
"""One ppm."""


@dataclass(frozen=True, slots=True)
class Block:
    """The earliest arrival of some seconds."""

    t_s: float
    offset_ms: float
    """What the fix told, minus raw time."""


@dataclass(frozen=True, slots=True)
class Level:
    """A delay from here on."""

    t_s: float
    step_ms: float
    """How much earlier than on the level before, give or take ``LEVEL_SIGMA_MS``."""
    after_gap: bool = False
    """Nobody saw whether it jumped: it may be the same level as before, or any."""


@dataclass(frozen=True, slots=True)
class WholeStep:
    """Full seconds by which the receiver corrected itself: what it had told before was wrong."""

    t_s: float
    seconds: int


class Arrivals:
    """Fixes as they arrive, thinned to blocks and cut where the receiver's delay jumps.

    A step of half a second or more is none of the delay: by its full seconds all that was told
    before was wrong (leap seconds before the almanac is in, a date), and is corrected here.

    Holds at most ``kept`` blocks, and the levels that begin among them; ``left_ms`` is the sum of
    the steps to levels that began before. The line stands on the very first level.
    """

    def __init__(self, kept: int | None = None) -> None:
        self.blocks: deque[Block] = deque(maxlen=kept)
        self.levels: deque[Level] = deque()
        self.left_ms = 0.0
        self.whole_steps: deque[WholeStep] = deque(maxlen=KEPT_WHOLE_STEPS)
        self._last: tuple[float, float] | None = None
        self._pending: list[tuple[float, float]] = []
        self._block_end_s = 0.0

    def add(self, t_s: float, offset_ms: float) -> bool:
        """Take a fix; whether a block or a level began with it."""
        fix = (t_s, offset_ms)
        if self._last is None:
            return self._keep(fix, new=True)
        if t_s <= self._last[0]:
            return False
        step_ms = offset_ms - self._last[1]
        if t_s - self._last[0] > GAP_S and abs(step_ms) < 500.0:
            self._pending.clear()
            self.levels.append(Level(t_s, 0.0, after_gap=True))
            return self._keep(fix, new=True)
        if abs(step_ms) <= JUMP_MS:
            self._pending.clear()
            return self._keep(fix, new=t_s >= self._block_end_s)
        if self._pending and abs(offset_ms - self._pending[-1][1]) > JUMP_MS:
            self._pending.clear()
        self._pending.append(fix)
        if len(self._pending) < AGREEING:
            return False
        pending, self._pending = self._pending, []
        begin_s, step_ms = pending[0][0], pending[0][1] - self._last[1]
        if seconds := round(step_ms / 1000):
            self.whole_steps.append(WholeStep(begin_s, seconds))
            moved = [Block(block.t_s, block.offset_ms + 1000.0 * seconds) for block in self.blocks]
            self.blocks.clear()
            self.blocks.extend(moved)
        if abs(step_ms - 1000 * seconds) > JUMP_MS:
            self.levels.append(Level(begin_s, step_ms - 1000 * seconds))
        for number, one in enumerate(pending):
            self._keep(one, new=number == 0)
        return True

    def _keep(self, fix: tuple[float, float], *, new: bool) -> bool:
        self._last = fix
        if new:
            self.blocks.append(Block(*fix))
            self._block_end_s = fix[0] + BLOCK_S
            while self.levels and self.levels[0].t_s < self.blocks[0].t_s:
                self.left_ms += self.levels.popleft().step_ms
        elif fix[1] > self.blocks[-1].offset_ms:
            self.blocks[-1] = Block(*fix)
        return new


@dataclass(frozen=True, slots=True)
class Envelope:
    """The line that the earliest arrivals lie on, bent by temperature; on the first level."""

    knots_s: tuple[float, ...]
    """The line begins at the first and bends at the others."""
    line: Floats
    """Value at the first knot, ms; slope there, ms/s; change of slope at each other knot."""
    covariance: Floats
    end_s: float
    """Of the last block; further on it is a guess."""
    steps_ms: tuple[float, ...]
    """To each level, refined."""

    def at(self, t_s: float) -> float:
        """Milliseconds at an instant; before the first and after the last knot straight on."""
        return float(_row(t_s, self.knots_s) @ self.line)

    def slope(self, t_s: float) -> float:
        """Milliseconds a second."""
        return float(self.line[1] + sum(self.line[2:][np.array(self.knots_s[1:]) < t_s]))

    def sigma(self, t_s: float) -> float:
        """One standard deviation at an instant, growing with the distance from the blocks."""
        away_s = max(0.0, t_s - self.end_s, self.knots_s[0] - t_s)
        bend = BEND_PPM * MS_PER_S * sqrt(away_s**3 / 3 / BEND_S)
        return sqrt(max(0.0, self.variances(t_s)[0]) + bend**2)

    def variances(self, t_s: float) -> tuple[float, float, float]:
        """Variance of the value, covariance of value and slope, variance of the slope."""
        row = _row(t_s, self.knots_s)
        slope = np.array([0.0, 1.0, *(float(knot < t_s) for knot in self.knots_s[1:])])
        covariance = self.covariance
        return (
            float(row @ covariance @ row),
            float(row @ covariance @ slope),
            float(slope @ covariance @ slope),
        )


def fit(arrivals: Arrivals, iterations: int = 12) -> Envelope:
    """The most likely line: latencies above it exponential, before it all but impossible.

    Maximum a posteriori by iteratively reweighted least squares; the drift, its bends and the
    steps between levels are normal about what is known of them.
    """
    t_s = np.array([block.t_s for block in arrivals.blocks])
    offset_ms = np.array([block.offset_ms for block in arrivals.blocks])
    begins_s = np.array([level.t_s for level in arrivals.levels])
    steps_ms = np.array([level.step_ms for level in arrivals.levels])
    first_s, end_s = float(t_s[0]), float(t_s[-1])
    knots_s = (first_s, *np.arange(first_s + BEND_S, end_s - BEND_S / 2, BEND_S).tolist())
    bends = len(knots_s) - 1
    design = np.hstack([_rows(t_s, knots_s), (t_s[:, None] >= begins_s).astype(float)])
    rough_ms = offset_ms - design[:, 2 + bends :] @ steps_ms
    expected = np.concatenate([[rough_ms.max()], np.zeros(1 + bends), steps_ms])
    sigmas = [1e4, OSCILLATOR_PPM * MS_PER_S, *[BEND_PPM * MS_PER_S] * bends]
    variance = np.array([*sigmas, *[LEVEL_SIGMA_MS] * len(steps_ms)]) ** 2
    unseen = np.array([False] * (2 + bends) + [level.after_gap for level in arrivals.levels])
    late = BLOCK_S / (WOBBLE_MS * CORRELATION_S)
    found, softness_ms = expected, 20.0
    for _ in range(iterations):
        latency_ms = design @ found - offset_ms
        weight = np.where(latency_ms < 0, late * EARLY, late) / np.maximum(np.abs(latency_ms), softness_ms)
        weighted = design.T * weight
        # a step that nobody saw may be any: far out it is as likely as a bit further
        information = 1 / (variance + np.where(unseen, (found - expected) ** 2, 0.0))
        normal = weighted @ design + np.diag(information)
        found = np.linalg.solve(normal, weighted @ offset_ms + information * expected)
        softness_ms = max(1.0, 0.7 * softness_ms)
    line, covariance = found[: 2 + bends], np.linalg.inv(normal)[: 2 + bends, : 2 + bends]
    # what was not seen for long may come earlier still: on average by the scale of its exponential
    unseen_ms = 1 / (1 / WOBBLE_MS + len(t_s) * late)
    line[0] += unseen_ms
    covariance[0, 0] += unseen_ms**2
    return Envelope(knots_s, line, covariance, end_s, tuple(found[2 + bends :].tolist()))


def _rows(t_s: Floats, knots_s: tuple[float, ...]) -> Floats:
    since_s = t_s[:, None] - np.array(knots_s)
    return np.hstack([np.ones((len(t_s), 1)), since_s[:, :1], np.maximum(0.0, since_s[:, 1:])])


def _row(t_s: float, knots_s: tuple[float, ...]) -> Floats:
    return np.array([1.0, t_s - knots_s[0], *(max(0.0, t_s - knot) for knot in knots_s[1:])])
