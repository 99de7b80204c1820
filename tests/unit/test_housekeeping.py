"""Chores: each at its own period, until closed."""

import threading
import time

from recorder.clock import SYSTEM_CLOCK
from recorder.service.housekeeping import Chore, Housekeeping


def test_each_chore_runs_at_once_and_at_its_period() -> None:
    often: list[float] = []
    seldom: list[float] = []
    enough = threading.Event()

    def tick() -> None:
        often.append(time.monotonic())
        if len(often) >= 5:
            enough.set()

    chores = [
        Chore("often", 0.02, tick),
        Chore("seldom", 100, lambda: seldom.append(time.monotonic())),
    ]
    housekeeping = Housekeeping(chores, clock=SYSTEM_CLOCK)
    housekeeping.start()
    assert enough.wait(5)
    housekeeping.close()
    count = len(often)
    assert often[4] - often[0] >= 0.06
    assert len(seldom) == 1
    time.sleep(0.05)
    assert len(often) == count
