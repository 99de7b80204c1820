"""From a device's sample to a record on disk: stamp, encode, queue, write."""

import logging
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial

from recorder.clock import Clock
from recorder.codec import Model, encode, model_at, train
from recorder.config import Settings
from recorder.errors import RecorderError, StorageError
from recorder.realtime.preview import preview
from recorder.samples import EncodedFrame, Fix, Frame, LogLine, Loss, LossCause, PpsEdge, Record, Sample
from recorder.service.camera_timing import CameraTiming
from recorder.service.queue import Entry, WriteQueue
from recorder.storage import DriveWriter
from recorder.timebase import Timebase

_log = logging.getLogger("recorder.pipeline")

_TRAIN_NS = 1_000_000_000

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
        self._previewing: dict[str, Future[None]] = {}
        self._last_raw_ns: dict[str, int] = {}
        self._date_told = ""
        self._timing = {name: CameraTiming(camera) for name, camera in settings.drivers.camera.items()}
        self._trained: dict[tuple[str, Model, int], tuple[int, bytes]] = {}
        self._counting = threading.Lock()
        self._refused: dict[str, Loss] = {}
        self._lost: Counter[str] = Counter()
        self._frames: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._write_all, name="write")
        self.failure: RecorderError | None = None
        self.failed = threading.Event()
        self.synced_raw_ns = clock.raw_ns()
        """When the last forcing to disk was done, on our clock: what the watchdog looks at."""
        self.lost_raw_ns: int | None = None
        """When a sample was last stated as lost."""

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Write what is queued, close the drive, end all threads."""
        self.state_refused()
        self._previewer.shutdown(wait=True, cancel_futures=True)
        self._queue.close()
        if self._thread.is_alive():
            self._thread.join()
        self._encoders.shutdown(wait=True, cancel_futures=True)
        try:
            self._writer.close()
        except StorageError as error:
            self.failure = self.failure or error

    @property
    def frames(self) -> dict[str, int]:
        """Frames written, by camera."""
        with self._counting:
            return dict(self._frames)

    @property
    def lost(self) -> dict[str, int]:
        """Samples lost, by topic; counted when they are, also before the drive says so."""
        with self._counting:
            return dict(self._lost)

    @property
    def timing(self) -> dict[str, CameraTiming]:
        """How each camera's frames are timed."""
        return dict(self._timing)

    @property
    def queue_bytes(self) -> int:
        """Held between the devices and the disk just now."""
        return self._queue.held_bytes

    def take(self, sample: Sample, *, live: bool) -> bool:
        """One sample of a device; False if it had to be left out, which is then stated.

        ``live``: the device cannot wait. A file's samples wait for room instead.
        """
        if isinstance(sample, Frame):
            return self._take_frame(self._stamped(sample), live=live)
        utc = None
        if isinstance(sample, Fix):
            utc = self._timebase.observe(sample)
            self._tell_of_date(sample)
        if isinstance(sample, PpsEdge):
            sample = replace(sample, stamp=self._timebase.refine(sample.stamp))
            self._timebase.observe_pulse(sample)
        if isinstance(sample, (Fix, PpsEdge)):
            sample = replace(sample, stamp=self._timebase.complete(sample.stamp))
        self.put(sample, wait=not live)
        if utc is not None:
            self.put(utc, wait=not live)
        return True

    def put(self, record: Record, *, wait: bool = False) -> None:
        """Queue a record that is never left out; ``wait`` for room if it can."""
        if isinstance(record, Loss):
            self._count_lost(record.stream, record.count)
        self._queue.put(lambda: record, _SMALL, wait=wait, required=not wait)

    def call(self, do: Callable[[], None]) -> None:
        """Have the writer thread do something in its turn: the writer belongs to it alone."""
        self._queue.put(lambda: do, _SMALL, wait=False, required=True)

    def state_refused(self) -> None:
        """Put what was left out so far into the ledger, also while it goes on."""
        with self._counting:
            pending, self._refused = self._refused, {}
        for loss in pending.values():
            self._queue.put(partial(_itself, loss), _SMALL, wait=False, required=True)

    def _tell_of_date(self, fix: Fix) -> None:
        """Once, if the receiver's date is corrected or refused although it has a fix."""
        judgement = self._timebase.judgement
        reason = judgement.reason if judgement is not None and fix.valid else ""
        if reason and reason != self._date_told:
            self.put(LogLine(self._clock.raw_ns(), "warning", "gnss", reason))
            _log.warning("gnss: %s", reason)
        self._date_told = reason or self._date_told

    def _stamped(self, frame: Frame) -> Frame:
        """With its times complete. A camera's raw time goes forward, whatever a stamp says."""
        last_ns = self._last_raw_ns.get(frame.camera)
        stamp = self._timebase.refine(frame.stamp, after_ns=last_ns)
        assert stamp.raw_ns is not None
        if last_ns is not None and stamp.raw_ns <= last_ns:
            stamp = replace(stamp, raw_ns=last_ns + 1)
        self._last_raw_ns[frame.camera] = stamp.raw_ns or 0
        timing = self._timing.get(frame.camera) or self._timing.setdefault(frame.camera, CameraTiming())
        return replace(frame, stamp=self._timebase.complete(timing.stamped(frame, stamp), frame=True))

    def _take_frame(self, frame: Frame, *, live: bool) -> bool:
        def start() -> Entry:
            return self._encoders.submit(self._encode, frame)

        # pixels until encoded, the image from then on: the larger of the two bounds the memory
        if not self._queue.put(start, frame.pixels.nbytes, wait=not live):
            self._refuse(frame)
            return False
        if self._refused:
            self.state_refused()
        self._offer_preview(frame)
        return True

    def _refuse(self, frame: Frame) -> None:
        """Remember a frame that found no room, in one loss with its neighbours."""
        raw_ns = frame.stamp.raw_ns
        self._count_lost(frame.topic, 1)
        with self._counting:
            pending = self._refused.get(frame.topic)
            if pending is not None and pending.last_id + 1 == frame.id:
                self._refused[frame.topic] = replace(pending, last_id=frame.id, last_raw_ns=raw_ns)
                return
        self.state_refused()
        detail = "encoder or disk too slow"
        with self._counting:
            self._refused[frame.topic] = Loss(
                frame.topic, frame.id, frame.id, raw_ns, raw_ns, LossCause.QUEUE, detail
            )

    def _count_lost(self, topic: str, count: int) -> None:
        with self._counting:
            self._lost[topic] += count
            self.lost_raw_ns = self._clock.raw_ns()

    def _encode(self, frame: Frame) -> Record:
        """In a worker: compress, or say that it could not be done."""
        codec = self._settings.codec
        model = model_at(frame.bit_depth, codec.model)
        try:
            tables = self._tables(frame, model)
            data = encode(frame.pixels, bit_depth=frame.bit_depth, model=model, k=codec.k, tables=tables)
        except Exception as error:  # whatever it is, it costs this frame and no other
            return self._lost_to_encoder(frame, f"{type(error).__name__}: {error}")
        height, width = frame.pixels.shape
        if 8 * len(data) >= width * height * frame.bit_depth:  # the scene is another: train again
            self._trained.pop((frame.camera, model, frame.bit_depth), None)
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

    def _tables(self, frame: Frame, model: Model) -> bytes | None:
        """Trained on this camera's frames now and then; None where the settings leave nothing to train.

        An image carries its tables, so each can be decoded alone. Tables that are some frames old cost
        0.01 % of size; training on every frame costs felics-ls as much time as encoding it.
        """
        if model == "felics" and self._settings.codec.k != "trained":
            return None
        key = (frame.camera, model, frame.bit_depth)
        raw_ns = frame.stamp.raw_ns or 0
        trained_ns, tables = self._trained.get(key, (0, b""))
        if not tables or not 0 <= raw_ns - trained_ns < _TRAIN_NS:
            tables = train(frame.pixels, bit_depth=frame.bit_depth, model=model)
            self._trained[key] = (raw_ns, tables)
        return tables

    def _lost_to_encoder(self, frame: Frame | EncodedFrame, detail: str) -> Loss:
        raw_ns = frame.stamp.raw_ns
        self._count_lost(frame.topic, 1)
        return Loss(frame.topic, frame.id, frame.id, raw_ns, raw_ns, LossCause.ENCODER, detail)

    def _offer_preview(self, frame: Frame) -> None:
        """Now and then, beside the recording: nothing waits for a preview, a late one is left out."""
        realtime = self._settings.realtime
        raw_ns = frame.stamp.raw_ns or 0
        if not realtime.preview_hz or raw_ns < self._preview_due_ns.get(frame.camera, 0):
            return
        busy = self._previewing.get(frame.camera)
        if busy is not None and not busy.done():
            return
        self._preview_due_ns[frame.camera] = raw_ns + round(1e9 / realtime.preview_hz)
        self._previewing[frame.camera] = self._previewer.submit(self._make_preview, frame)

    def _make_preview(self, frame: Frame) -> None:
        realtime = self._settings.realtime
        try:
            picture = preview(frame, max_width=realtime.preview_width, quality=realtime.preview_quality)
        except Exception as error:
            _log.warning("no preview of %s: %s", frame.camera, error)
            return
        self._queue.put(lambda: picture, len(picture.jpeg), wait=False)

    def _write_all(self) -> None:
        """The writer thread: in order, and to the disk every ``sync_seconds``."""
        period_ns = round(self._settings.storage.sync_seconds * 1e9)
        due_ns = self._clock.raw_ns() + period_ns
        while not self._queue.drained:
            entry = self._queue.take(max(0.0, (due_ns - self._clock.raw_ns()) / 1e9))
            if entry is not None:
                self._write(entry[0])
                self._queue.done(entry[1])
            if self._clock.raw_ns() >= due_ns:
                self._guarded(self._sync)
                due_ns = self._clock.raw_ns() + period_ns

    def _write(self, entry: Entry) -> None:
        """One entry in its turn. After the disk has failed: count what is lost with it."""
        record = entry.result() if isinstance(entry, Future) else entry
        if callable(record):
            self._guarded(record)
            return
        try:
            self._guarded(partial(self._writer.write, record))
        except Exception as error:  # a record that cannot be put into bytes costs itself and no other
            problem = f"{type(error).__name__}: {error}"
            _log.error("a %s cannot be written: %s", type(record).__name__, problem)
            if isinstance(record, EncodedFrame):
                self._guarded(partial(self._writer.write, self._lost_to_encoder(record, problem)))
            line = LogLine(self._clock.raw_ns(), "error", "pipeline", f"not written: {problem}")
            self._guarded(partial(self._writer.write, line))
            return
        if isinstance(record, EncodedFrame):
            if self.failed.is_set():
                self._count_lost(record.topic, 1)
            else:
                with self._counting:
                    self._frames[record.camera] += 1

    def _sync(self) -> None:
        self._writer.sync()
        self.synced_raw_ns = self._clock.raw_ns()

    def _guarded(self, step: Callable[[], None]) -> None:
        """Do one step of the writer unless the disk has failed."""
        if self.failed.is_set():
            return
        try:
            step()
        except StorageError as error:
            self.failure = error
            self.failed.set()


def _itself(record: Record) -> Record:
    return record
