"""GenICam cameras (GigE Vision, USB3 Vision) through Aravis."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from threading import Event
from typing import Any

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import CameraSection
from recorder.drivers.aravis import aravis, buffer_bytes, open_camera, release, translated
from recorder.drivers.frame_ids import FrameIds
from recorder.drivers.genicam_setup import configure, identity
from recorder.drivers.pixel_formats import BY_CODE, BY_NAME, PixelFormat
from recorder.errors import DeviceError, DeviceLost
from recorder.samples import CameraSettings, Frame, Loss, LossCause, Pixels, Sample, Stamp, image_topic

SCHEME = "genicam://"

BUFFERS = 32
"""Half a second at 60 Hz, 84 MB of 16-bit images: what the reader may be late before frames are lost."""

POLL_US = 100_000
"""The longest wait for an image before the caller gets None."""


class GenicamCamera:
    """A live camera.

    A complete buffer becomes a `Frame`, any other a `Loss`, and so does every id that was skipped:
    ids go up from 0, the first image that was seen, and each is in one frame or in one loss.

    Aravis receives in a thread of its own, buffers up to `BUFFERS` images, reads the control
    register about every second to keep control, and drops images that find no free buffer. A camera
    that vanishes is noticed by that reading, 5 to 8 s later.

    Args:
        name: front or tag.
        settings: source ``genicam://ADDRESS``, ``genicam://SERIAL-OR-ID`` or ``genicam://`` for the
            first one found, and what to set.
    """

    live = True

    def __init__(self, name: str, settings: CameraSection, *, clock: Clock = SYSTEM_CLOCK) -> None:
        self.name = name
        self._wanted, self._clock = settings, clock
        self._where = settings.source
        self._camera: Any = None
        self._stream: Any = None
        self._device: Any = None
        self._watch = 0
        self._lost = Event()
        self._ids = FrameIds()
        self._settings = CameraSettings()
        self._told: dict[str, str] = {}
        self._last_raw_ns: int | None = None
        self._underruns = 0
        self._too_deep = False

    def open(self) -> None:
        """Take control, set up, start.

        Raises:
            DeviceAbsent: nothing answers there (known after 2.5 s).
            DeviceBusy: another program controls it.
            DeviceUnsuitable: none of our formats, or a setting out of its range.
            DeviceLost: it stopped answering meanwhile.
            DeviceError: Aravis is not installed, or anything else it says.
        """
        self.close()
        self._lost.clear()
        self._ids, self._last_raw_ns, self._underruns, self._too_deep = FrameIds(), None, 0, False
        try:
            self._camera = open_camera(self._where.removeprefix(SCHEME).strip("/"), self._where)
            self._device = self._camera.get_device()
            # Called in Aravis' thread: it holds nothing of this driver and only sets the event.
            lost = self._lost
            self._watch = self._device.connect("control-lost", lambda _device: lost.set())
            self._settings = configure(self._camera, self._wanted, self._where)
            self._told = identity(self._camera, self._where) | self._format()
            self._start()
        except BaseException as error:
            self.close()
            release(error)
            raise

    def samples(self) -> Iterator[Sample | None]:
        """Frames and losses as they come, None after 0.1 s without. Raises `DeviceLost`."""
        # Between two yields nothing of Aravis is held here, so that `close` can let go of all of it.
        while self._stream is not None:
            taken = self._take()
            if not taken:
                yield None
            yield from taken

    def describe(self) -> Mapping[str, str]:
        return self._told if self._camera is not None else {}

    @property
    def statistics(self) -> Mapping[str, int]:
        """Aravis' own counts since `open`: completed, failed, without a free buffer, packets missing."""
        stream = self._stream
        if stream is None:
            return {}
        names = ("n_completed_buffers", "n_failures", "n_underruns", "n_missing_packets")
        known = {stream.get_info_name(index) for index in range(stream.get_n_infos())}
        return {name[2:]: stream.get_info_uint64_by_name(name) for name in names if name in known}

    def close(self) -> None:
        """Stop and let go. A camera that no longer answers costs 5 s: Aravis wants to tell it."""
        if self._stream is not None and not self._lost.is_set():
            try:
                with translated(self._where):
                    self._camera.stop_acquisition()
            except DeviceError:
                pass  # it is being left in any case
        if self._device is not None and self._watch:
            self._device.disconnect(self._watch)
        # Aravis ends its threads and closes its sockets when the last reference goes, stream first.
        self._watch, self._stream = 0, None
        self._camera = self._device = None

    def _format(self) -> dict[str, str]:
        _, _, width, height = self._camera.get_region()
        told = {"pixel_format": self._settings.pixel_format, "size": f"{width}x{height}"}
        if self._settings.rate_hz is not None:
            told["rate_hz"] = f"{self._settings.rate_hz:.2f}"
        return told

    def _start(self) -> None:
        with translated(self._where):
            self._stream = self._camera.create_stream(None, None)
            if self._camera.is_gv_device():
                # The kernel's default holds a fraction of an image: without a packet socket, which
                # needs CAP_NET_RAW, nearly every image would be lost.
                self._stream.set_property("socket-buffer", aravis().GvStreamSocketBuffer.AUTO)
            payload = self._camera.get_payload()
            for _ in range(BUFFERS):
                self._stream.push_buffer(aravis().Buffer.new_allocate(payload))
            self._camera.start_acquisition()

    def _take(self) -> list[Sample]:
        """What the next buffer amounts to; nothing if there is none, or if it is late."""
        buffer = self._stream.timeout_pop_buffer(POLL_US)
        raw_ns = self._clock.raw_ns()
        if self._lost.is_set():
            raise DeviceLost(
                "the camera is gone or was taken over", where=self._where, todo="check its power and cable"
            )
        if buffer is None:
            return []
        try:
            return self._account(buffer, raw_ns)
        finally:
            self._stream.push_buffer(buffer)

    def _account(self, buffer: Any, raw_ns: int) -> list[Sample]:
        status, raw_id = buffer.get_status(), buffer.get_frame_id()
        complete = status == aravis().BufferStatus.SUCCESS
        if not complete and not raw_id:  # nothing of an image, not even its number
            return []
        arrival = self._ids.arrive(raw_id)
        if arrival is None:
            return []
        samples: list[Sample] = []
        if arrival.missing:
            samples.append(self._never_arrived(arrival.missing, raw_ns))
        self._last_raw_ns = raw_ns
        problem = self._problem(buffer) if complete else str(status.value_nick)
        if problem:
            samples.append(self._loss(range(arrival.id, arrival.id + 1), raw_ns, raw_ns, problem))
        else:
            samples.append(self._frame(buffer, arrival.id, raw_ns))
        return samples

    def _frame(self, buffer: Any, id_: int, raw_ns: int) -> Frame:
        format_ = BY_CODE[buffer.get_image_pixel_format()]
        width, height = buffer.get_image_width(), buffer.get_image_height()
        data = buffer_bytes(buffer)[: format_.wire_bytes(width, height)]
        pixels = format_.pixels(data, width, height)
        settings = self._settings
        if settings.pixel_format != format_.name:  # somebody else changed it
            settings = self._settings = replace(settings, pixel_format=format_.name)
        stamp = Stamp(
            raw_ns=raw_ns,
            device_ns=buffer.get_timestamp(),
            realtime_ns=buffer.get_system_timestamp(),
        )
        return Frame(self.name, id_, stamp, pixels, self._bit_depth(format_, pixels), settings)

    def _bit_depth(self, format_: PixelFormat, pixels: Pixels) -> int:
        """The format's, or 16 from the first image on that says otherwise.

        Some cameras align 10 bits left, or label 12 as 10. Such pixels are kept as they are.
        """
        if format_.has_spare_bits and not self._too_deep:
            self._too_deep = bool(int(pixels.max()) >> format_.bit_depth)
        return 16 if self._too_deep else format_.bit_depth

    def _problem(self, buffer: Any) -> str:
        """Why a buffer that came whole is still no image of ours."""
        format_ = BY_CODE.get(buffer.get_image_pixel_format())
        if format_ is None:
            return f"pixel format {buffer.get_image_pixel_format():#010x}, not {', '.join(BY_NAME)}"
        wanted = format_.wire_bytes(buffer.get_image_width(), buffer.get_image_height())
        came = len(buffer_bytes(buffer))
        return f"{came} of {wanted} bytes" if came < wanted or not wanted else ""

    def _never_arrived(self, ids: range, raw_ns: int) -> Loss:
        """Nothing came of these; the times bracket when it would have."""
        before = raw_ns if self._last_raw_ns is None else self._last_raw_ns
        underruns = self.statistics.get("underruns", 0)
        ours, self._underruns = underruns - self._underruns, underruns
        if ours >= len(ids):
            return self._loss(ids, before, raw_ns, "no free buffer", LossCause.QUEUE)
        return self._loss(ids, before, raw_ns, "never arrived")

    def _loss(
        self,
        ids: range,
        first_raw_ns: int,
        last_raw_ns: int,
        detail: str,
        cause: LossCause = LossCause.TRANSPORT,
    ) -> Loss:
        topic = image_topic(self.name)
        return Loss(topic, ids[0], ids[-1], first_raw_ns, last_raw_ns, cause, detail)
