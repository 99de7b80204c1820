"""From a device's sample to a record on disk: stamp, encode, queue, write."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial

from recorder.clock import Clock
from recorder.codec import encode
from recorder.config import Settings
from recorder.errors import RecorderError, StorageError
from recorder.realtime.preview import preview
from recorder.samples import EncodedFrame, Fix, Frame, Loss, LossCause, Record, Sample
from recorder.service.queue import Entry, WriteQueue
from recorder.storage import DriveWriter
from recorder.timebase import Timebase

_SMALL = 1024
"""What a record other than a frame counts for in the queue, bytes; most are shorter."""


class Pipeline:
    """Takes samples from any thread, in order per device, and gets them onto the disk.

    Threads: the devices' call `take`; ``codec.workers`` compress; one makes previews; one
    writes. Bound: ``storage.queue_bytes`` between `take` and the disk; at the bound a live
    camera's frames are left out and stated, a file waits. A failure of the disk ends the
    recording: `failure` holds it and `failed` is set.
    """

    def __init__(self, settings: Settings, timebase: Timebase, writer: DriveWriter, *, clock: Clock) -> None:
        self._settings = settings
        self._timebase = timebase
        self._writer = writer
        self._clock = clock
        self._queue = WriteQueue(settings.storage.queue_bytes)
        self._encoders = ThreadPoolExecutor(settings.codec.workers, thread_name_prefix="encode")
        self._previewer = ThreadPoolExecutor(1, thread_name_prefix="preview")
        self._preview_due_ns: dict[str, int] = {}
        self._refused: dict[str, Loss] = {}
        self._thread = threading.Thread(target=self._write_all, name="write")
        self.failure: RecorderError | None = None
        self.failed = threading.Event()
        self.frames: dict[str, int] = {}
        """Frames written, by camera."""
        self.lost: dict[str, int] = {}
        """Samples stated as lost, by topic."""

    def start(self) -> None:
        self._thread.start()

    @property
    def queue_bytes(self) -> int:
        """Held between the devices and the disk just now."""
        return self._queue.held_bytes

    def close(self) -> None:
        """Write what is queued, close the drive, end all threads."""
        for topic in list(self._refused):
            self._state_refused(topic)
        self._previewer.shutdown(wait=True)
        self._queue.close()
        if self._thread.is_alive():
            self._thread.join()
        self._encoders.shutdown(wait=True, cancel_futures=True)
        try:
            self._writer.close()
        except StorageError as error:
            self.failure = self.failure or error

    def take(self, sample: Sample, *, live: bool) -> None:
        """One sample of a device. ``live``: it cannot wait, what does not fit is lost and stated."""
        if isinstance(sample, Frame):
            stamp = self._timebase.complete(sample.stamp, frame=True)
            self._take_frame(replace(sample, stamp=stamp), live=live)
            return
        self.put(sample)
        if isinstance(sample, Fix):
            utc = self._timebase.observe(sample)
            if utc is not None:
                self.put(utc)

    def put(self, record: Record) -> None:
        """Queue a record that is never dropped."""
        if isinstance(record, Loss):
            self.lost[record.stream] = self.lost.get(record.stream, 0) + record.count
        self._queue.put(lambda: record, _SMALL, wait=False, required=True)

    def call(self, do: Callable[[], None]) -> None:
        """Have the writer thread do something in its turn: the writer belongs to it alone."""
        self._queue.put(lambda: do, _SMALL, wait=False, required=True)

    def _take_frame(self, frame: Frame, *, live: bool) -> None:
        def start() -> Entry:
            return self._encoders.submit(self._encode, frame)

        # pixels until encoded, the image from then on: the larger of the two bounds the memory
        if self._queue.put(start, frame.pixels.nbytes, wait=not live):
            self._state_refused(frame.topic)
            self._offer_preview(frame, live=live)
        else:
            self._refuse(frame)

    def _refuse(self, frame: Frame) -> None:
        """Remember a frame that found no room, in one loss with its neighbours."""
        pending = self._refused.get(frame.topic)
        if pending is not None and pending.last_id + 1 == frame.id:
            pending = replace(pending, last_id=frame.id, last_raw_ns=frame.stamp.raw_ns)
        else:
            self._state_refused(frame.topic)
            raw_ns = frame.stamp.raw_ns
            pending = Loss(
                frame.topic, frame.id, frame.id, raw_ns, raw_ns, LossCause.QUEUE, "encoder or disk too slow"
            )
        self._refused[frame.topic] = pending

    def _state_refused(self, topic: str) -> None:
        pending = self._refused.pop(topic, None)
        if pending is not None:
            self.put(pending)

    def _encode(self, frame: Frame) -> Record:
        """In a worker: compress, or say that it could not be done."""
        codec = self._settings.codec
        try:
            data = encode(frame.pixels, bit_depth=frame.bit_depth, model=codec.model, k=codec.k)
        except (RecorderError, ValueError) as error:
            raw_ns = frame.stamp.raw_ns
            return Loss(frame.topic, frame.id, frame.id, raw_ns, raw_ns, LossCause.ENCODER, str(error))
        height, width = frame.pixels.shape
        return EncodedFrame(
            camera=frame.camera,
            id=frame.id,
            stamp=frame.stamp,
            width=width,
            height=height,
            bit_depth=frame.bit_depth,
            settings=frame.settings,
            data=data,
        )

    def _offer_preview(self, frame: Frame, *, live: bool) -> None:
        """Now and then, beside the recording: nothing waits for a preview."""
        realtime = self._settings.realtime
        raw_ns = frame.stamp.raw_ns or 0
        if not realtime.preview_hz or raw_ns < self._preview_due_ns.get(frame.camera, 0):
            return
        self._preview_due_ns[frame.camera] = raw_ns + round(1e9 / realtime.preview_hz)
        self._previewer.submit(self._make_preview, frame)

    def _make_preview(self, frame: Frame) -> None:
        realtime = self._settings.realtime
        picture = preview(frame, max_width=realtime.preview_width, quality=realtime.preview_quality)
        self._queue.put(lambda: picture, len(picture.jpeg), wait=False)

    def _write_all(self) -> None:
        """The writer thread: in order, and to the disk every ``sync_seconds``."""
        period_ns = round(self._settings.storage.sync_seconds * 1e9)
        due_ns = self._clock.raw_ns() + period_ns
        while not self._queue.drained:
            entry = self._queue.take(max(0.0, (due_ns - self._clock.raw_ns()) / 1e9))
            if entry is not None:
                self._guarded(partial(self._write, entry[0]))
                self._queue.done(entry[1])
            if self._clock.raw_ns() >= due_ns:
                self._guarded(self._writer.sync)
                due_ns = self._clock.raw_ns() + period_ns

    def _write(self, entry: Entry) -> None:
        record = entry.result() if isinstance(entry, Future) else entry
        if callable(record):
            record()
            return
        if isinstance(record, Loss) and record.cause is LossCause.ENCODER:
            self.lost[record.stream] = self.lost.get(record.stream, 0) + 1
        self._writer.write(record)
        if isinstance(record, EncodedFrame):
            self.frames[record.camera] = self.frames.get(record.camera, 0) + 1

    def _guarded(self, step: Callable[[], None]) -> None:
        """Do one step of the writer unless the disk has failed."""
        if self.failed.is_set():
            return
        try:
            step()
        except RecorderError as error:
            self._fail(error)
        except Exception as error:  # a bug of ours must not leave a writer that silently does nothing
            self._fail(StorageError(f"writing failed: {type(error).__name__}: {error}"))

    def _fail(self, error: RecorderError) -> None:
        self.failure = error
        self.failed.set()
