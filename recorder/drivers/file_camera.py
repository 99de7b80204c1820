"""A recorded camera: a video file, a folder of images or a stack of them, played as a driver."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import CameraSection
from recorder.drivers.image_folder import SUFFIXES, ImageFolder
from recorder.drivers.image_source import ImageSource, MissingImages, SourceImage
from recorder.drivers.image_stack import ImageStack
from recorder.drivers.image_times import MediaTimes, read_times
from recorder.drivers.video_file import VideoFile
from recorder.errors import DeviceLost, SourceError
from recorder.samples import CameraSettings, Frame, Loss, LossCause, Sample, Stamp, image_topic

STEP_NS = 200_000_000
"""No wait is longer, so that the caller can look at its stop event."""


class FileCamera:
    """Plays a file as the camera ``name``.

    A video frame is ``cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)`` in 8 bits; single images keep their
    depth (`DepthRule`). ``Frame.id`` is the place in the file, from 0. ``device_ns`` is the media
    time, ``raw_ns`` the origin plus the media time since the first image.

    Args:
        origin_raw_ns: raw time of the first image; what is replayed together must share it. None:
            the moment of opening.
        sleep: waits so many seconds; only used if ``settings.realtime``.
    """

    live = False

    def __init__(
        self,
        name: str,
        settings: CameraSection,
        *,
        origin_raw_ns: int | None = None,
        clock: Clock = SYSTEM_CLOCK,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name = name
        self._settings = settings
        self._path = Path(settings.source)
        self._given_origin = origin_raw_ns
        self._origin_raw_ns = 0
        self._clock = clock
        self._sleep = sleep
        self._source: ImageSource | None = None
        self._listed: Sequence[int] | None = None

    def open(self) -> None:
        """Raises `SourceError`."""
        listed = read_times(self._settings.times) if self._settings.times else None
        source = _open(self._path)
        if listed is not None and source.count is not None and len(listed) != source.count:
            source.close()
            raise self._uneven(len(listed), source.count)
        self._source, self._listed = source, listed

    def samples(self) -> Iterator[Sample | None]:
        """All images that can be read; those that cannot are a `Loss` each.

        Raises `DeviceLost` at the end if any was lost, `SourceError` if the CSV of times turns out
        not to fit a file that does not announce its length.
        """
        source = self._opened()
        # not at open: the recording may begin later, and a paced file must not have to catch up
        self._origin_raw_ns = self._clock.raw_ns() if self._given_origin is None else self._given_origin
        times = MediaTimes(self._listed, self._rate(source))
        start_ns: int | None = None
        missing: list[MissingImages] = []
        seen = 0
        for item in source.images():
            if isinstance(item, MissingImages):
                missing.append(item)
                seen = item.last + 1
                yield self._loss(item, start_ns)
                continue
            seen = item.index + 1
            if self._listed is not None and seen > len(self._listed):
                raise self._uneven(len(self._listed), None)
            media_ns = times.of(item.index, item.media_ns)
            if start_ns is None:
                start_ns = times.start_ns(item.index, media_ns)
            raw_ns = self._origin_raw_ns + media_ns - start_ns
            if self._settings.realtime:
                yield from self._wait_until(raw_ns)
            yield self._frame(item, Stamp(raw_ns=raw_ns, device_ns=media_ns), source)
        if missing:
            raise self._lost(missing, seen)
        if self._listed is not None and seen != len(self._listed):
            raise self._uneven(len(self._listed), seen)

    def describe(self) -> Mapping[str, str]:
        source = self._opened()
        told = {"source": str(self._path), **source.describe()}
        if source.count is not None:
            told["images"] = str(source.count)
        return told

    def close(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def _opened(self) -> ImageSource:
        if self._source is None:
            raise SourceError("not open", where=str(self._path))
        return self._source

    def _rate(self, source: ImageSource) -> Fraction | None:
        # The decimal digits that the configuration shows, not the binary fraction behind them.
        return Fraction(repr(self._settings.rate_hz)) if self._settings.rate_hz else source.rate

    def _wait_until(self, raw_ns: int) -> Iterator[None]:
        while (left_ns := raw_ns - self._clock.raw_ns()) > 0:
            self._sleep(min(left_ns, STEP_NS) / 1e9)
            if left_ns > STEP_NS:
                yield None

    def _frame(self, image: SourceImage, stamp: Stamp, source: ImageSource) -> Frame:
        rate = self._rate(source)
        settings = CameraSettings(
            pixel_format=f"Mono{image.bit_depth}", rate_hz=None if rate is None else float(rate)
        )
        return Frame(self.name, image.index, stamp, image.pixels, image.bit_depth, settings)

    def _loss(self, item: MissingImages, start_ns: int | None) -> Loss:
        first_raw_ns = last_raw_ns = None
        if self._listed is not None and item.last < len(self._listed):
            start_ns = self._listed[0] if start_ns is None else start_ns
            first_raw_ns, last_raw_ns = (
                self._origin_raw_ns + self._listed[index] - start_ns for index in (item.first, item.last)
            )
        return Loss(
            image_topic(self.name),
            item.first,
            item.last,
            first_raw_ns,
            last_raw_ns,
            LossCause.DEVICE,
            item.reason,
        )

    def _lost(self, missing: Sequence[MissingImages], total: int) -> DeviceLost:
        count = sum(item.last - item.first + 1 for item in missing)
        return DeviceLost(
            f"{missing[0].reason}: {count} of {total} images are missing",
            where=str(self._path),
            todo="the others are recorded; fetch the file again",
        )

    def _uneven(self, rows: int, images: int | None) -> SourceError:
        told = "more" if images is None else str(images)
        return SourceError(
            f"{rows} rows of times, but {self._path} has {told} images",
            where=str(self._settings.times),
            todo="it needs one row an image",
        )


def _open(path: Path) -> ImageSource:
    """The kind of source that ``path`` is. Raises `SourceError`."""
    try:
        return _opened(path)
    except OSError as error:
        todo = "check the path and who may read it"
        raise SourceError(
            f"cannot be read ({error.strerror or error})", where=str(path), todo=todo
        ) from error


def _opened(path: Path) -> ImageSource:
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for, for ever
        todo = "give a video, a folder of images or a .npy stack"
        raise SourceError("neither a file nor a folder", where=str(path), todo=todo)
    if path.suffix.lower() == ".npy":
        return ImageStack(path)
    if path.is_dir() or (path.suffix.lower() in SUFFIXES and path.is_file()):
        return ImageFolder(path)
    return VideoFile(path)
