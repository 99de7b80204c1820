"""The frames of a drive as a sequence, none of them read before it is asked for."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from recorder import codec
from recorder.errors import CodecError, DriveError, UsageError
from recorder.samples import CameraSettings, Pixels, Stamp
from recorder.storage.frame_message import HEAD_BYTES, HEAD_BYTES_MAX, FrameHead, read_head
from recorder.storage.segment import Entries
from recorder.storage.stamps import settings_from_proto, stamp_from_proto

if TYPE_CHECKING:
    from recorder.storage.drive import Drive


class NoFrame(UsageError, IndexError):
    """There is no frame that could be the nearest."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredFrame:
    """One frame of a drive. Its image is read at each access and kept by nobody."""

    camera: str
    id: int
    stamp: Stamp
    settings: CameraSettings
    bit_depth: int
    width: int
    height: int
    log_time_ns: int
    data_size: int
    """Bytes of the FELICS image."""
    _drive: "Drive" = field(repr=False)
    _entry: Any = field(repr=False)
    _data_offset: int = field(repr=False)

    @property
    def data(self) -> bytes:
        """The FELICS image, ``FF E8 … FF E9``. Raises `DriveError`."""
        return self._drive.access.part(self._entry, self._data_offset, self.data_size)

    @property
    def pixels(self) -> Pixels:
        """(height, width), decoded at each access: keep it if you need it twice.

        Raises `CodecError` if the image is damaged or is not the one that its message describes.
        """
        data = self.data
        check_image(data, self.width, self.height, self.bit_depth)
        return codec.decode(data)


def check_image(data: bytes, width: int, height: int, bit_depth: int) -> None:
    """Raises `CodecError` unless the image is of this size and depth."""
    header = codec.read_header(data)
    if (header.width, header.height, header.bit_depth) != (width, height, bit_depth):
        raise CodecError(
            f"an image of {header.width} x {header.height} x {header.bit_depth} bits where"
            f" {width} x {height} x {bit_depth} bits were recorded"
        )


class Frames(Sequence[StoredFrame]):
    """Frames in order of time. Slices are views; random access reads no other frame's image."""

    def __init__(self, drive: "Drive", entries: Entries) -> None:
        self._drive, self._entries = drive, entries
        self._utc: tuple[NDArray[np.int64], NDArray[np.bool_]] | None = None

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> StoredFrame: ...
    @overload
    def __getitem__(self, index: slice) -> "Frames": ...
    def __getitem__(self, index: int | slice) -> "StoredFrame | Frames":
        """Raises IndexError, and `DriveError` if the frame's message is damaged."""
        if isinstance(index, slice):
            return Frames(self._drive, self._entries[index])
        return self._load(self._entries[index])

    def __iter__(self) -> Iterator[StoredFrame]:
        return (self._load(entry) for entry in self._entries)

    def at(self, *, raw_ns: int | None = None, utc_ns: int | None = None) -> StoredFrame:
        """The frame nearest to a raw time or to a time in UTC.

        The first call with ``utc_ns`` reads the head of every frame, a few hundred bytes each; frames
        whose UTC is not known are then passed over. Raises ValueError unless exactly one time is
        given, `NoFrame` (an IndexError) if there is no frame with such a time.
        """
        if (raw_ns is None) == (utc_ns is None):
            raise ValueError("give either raw_ns or utc_ns")
        if len(self) == 0:
            raise NoFrame("no frame here", where=str(self._drive.path))
        if raw_ns is not None:
            times = self._entries["log_time"]
            return self[_nearest(times, raw_ns + self._drive.log_offset_ns)]
        assert utc_ns is not None
        times, known = self._utc = self._utc or self._read_utc()
        if not known.any():
            todo = "ask by raw_ns"
            raise NoFrame("no frame whose UTC is known", where=str(self._drive.path), todo=todo)
        distances = [abs(int(time) - utc_ns) for time in times[known]]
        return self[int(np.flatnonzero(known)[int(np.argmin(distances))])]

    def _read_utc(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        times, known = np.zeros(len(self), np.int64), np.zeros(len(self), np.bool_)
        for index, entry in enumerate(self._entries):
            try:
                stamp = self._head(entry).message.stamp
            except DriveError:
                continue
            if stamp.HasField("utc_ns"):
                times[index], known[index] = stamp.utc_ns, True
        return times, known

    def _load(self, entry: Any) -> StoredFrame:
        head = self._head(entry)
        told = head.message
        return StoredFrame(
            camera=self._drive.access.topic_of(entry).split("/")[2],
            id=told.id,
            stamp=stamp_from_proto(told.stamp),
            settings=settings_from_proto(told.settings),
            bit_depth=told.bit_depth,
            width=told.width,
            height=told.height,
            log_time_ns=int(entry["log_time"]),
            data_size=head.data_size,
            _drive=self._drive,
            _entry=entry,
            _data_offset=head.data_offset,
        )

    def _head(self, entry: Any) -> FrameHead:
        message, start = self._drive.access.start(entry, HEAD_BYTES)
        try:
            try:
                head = read_head(start)
            except ValueError:
                head = read_head(self._drive.access.start(entry, HEAD_BYTES_MAX)[1])
            if head.data_offset + head.data_size != message.size:
                raise ValueError("the image does not end with its message")
        except ValueError as error:
            raise DriveError(f"damaged frame: {error}", where=str(self._drive.path)) from error
        return head


def _nearest(times: NDArray[np.uint64], wanted: int) -> int:
    """Index of the time nearest to ``wanted``, the earlier of two; exact in integers."""
    if len(times) and times[0] > times[-1]:  # a slice that runs backwards
        return len(times) - 1 - _nearest(times[::-1], wanted)
    after = int(np.searchsorted(times, np.uint64(min(max(wanted, 0), 2**64 - 1))))
    candidates = [index for index in (after - 1, after) if 0 <= index < len(times)]
    return min(candidates, key=lambda index: abs(int(times[index]) - wanted))
