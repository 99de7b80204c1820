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


def test_a_late_chore_is_done_once_and_a_failing_one_again() -> None:
    late: list[float] = []
    failed: list[float] = []
    enough = threading.Event()

    def slow() -> None:
        late.append(time.monotonic())
        if len(late) == 1:
            time.sleep(0.5)
        if len(late) == 3:
            enough.set()

    def fail() -> None:
        failed.append(time.monotonic())
        raise OSError("no")

    housekeeping = Housekeeping([Chore("slow", 0.1, slow), Chore("fail", 0.1, fail)], clock=SYSTEM_CLOCK)
    housekeeping.start()
    assert enough.wait(5)
    housekeeping.close()
    assert late[2] - late[1] > 0.05
    assert len(failed) >= 2
