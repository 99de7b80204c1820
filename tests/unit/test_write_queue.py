"""The queue between devices and disk: order, bound, waiting."""

import threading

from recorder.samples import LogLine
from recorder.service.queue import WriteQueue


def line(text: str) -> LogLine:
    return LogLine(0, "info", "test", text)


def test_order_is_kept() -> None:
    queue = WriteQueue(1000)
    for text in "abc":
        assert queue.put(lambda text=text: line(text), 10, wait=False)  # type: ignore[misc]
    taken = [queue.take(0) for _ in range(3)]
    assert [entry[0].message for entry in taken if entry] == ["a", "b", "c"]  # type: ignore[union-attr]


def test_at_the_bound_a_live_sample_is_refused_and_its_work_not_started() -> None:
    queue = WriteQueue(100)
    assert queue.put(lambda: line("a"), 80, wait=False)
    started: list[bool] = []
    assert not queue.put(lambda: started.append(True) or line("b"), 80, wait=False)  # type: ignore[func-returns-value]
    assert not started


def test_bytes_count_until_written() -> None:
    queue = WriteQueue(100)
    queue.put(lambda: line("a"), 80, wait=False)
    queue.take(0)
    assert not queue.put(lambda: line("b"), 80, wait=False)
    queue.done(80)
    assert queue.put(lambda: line("b"), 80, wait=False)


def test_one_sample_larger_than_the_bound_passes_when_nothing_else_is_held() -> None:
    assert WriteQueue(100).put(lambda: line("a"), 1000, wait=False)


def test_what_is_required_is_taken_beyond_the_bound() -> None:
    queue = WriteQueue(100)
    queue.put(lambda: line("a"), 100, wait=False)
    assert queue.put(lambda: line("gnss"), 100, wait=False, required=True)


def test_a_file_waits_for_room() -> None:
    queue = WriteQueue(100)
    queue.put(lambda: line("a"), 100, wait=False)
    passed = threading.Event()

    def put() -> None:
        queue.put(lambda: line("b"), 100, wait=True)
        passed.set()

    thread = threading.Thread(target=put)
    thread.start()
    assert not passed.wait(0.1)
    queue.take(0)
    queue.done(100)
    assert passed.wait(5)
    thread.join()


def test_closing_lets_a_waiting_file_go_and_keeps_what_is_queued() -> None:
    queue = WriteQueue(100)
    queue.put(lambda: line("a"), 100, wait=False)
    results: list[bool] = []
    thread = threading.Thread(target=lambda: results.append(queue.put(lambda: line("b"), 100, wait=True)))
    thread.start()
    queue.close()
    thread.join(5)
    assert results == [False]
    assert not queue.drained
    assert queue.take(0) is not None
    assert queue.drained
    assert queue.take(0) is None
