"""One segment: an MCAP file with its head, its messages and its end."""

from collections import Counter
from collections.abc import Mapping

from mcap.writer import CompressionType, Writer

from recorder.storage.head import SOFTWARE
from recorder.storage.messages import Kind
from recorder.storage.schemas import schema_data
from recorder.storage.segment_file import SegmentFile

CHUNK_BYTES = 1 << 20
"""A chunk is closed by the message that makes it larger: one or two frames of a camera, so that
damage costs few of them, and small messages still share one."""

RECORD_BYTES = 31
"""MCAP's own bytes around each message."""


class SegmentWriter:
    """Writes one segment through the ``mcap`` package, uncompressed: images do not shrink any more.

    Every method raises OSError if the disk fails; the file then ends on the last whole record.
    """

    def __init__(self, file: SegmentFile) -> None:
        self.file = file
        self.counts: Counter[str] = Counter()
        self.first_log_time_ns: int | None = None
        self._open_chunk_bytes = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._mcap = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)  # type: ignore[arg-type]
        self._mcap.start(library=SOFTWARE)

    @property
    def size_bytes(self) -> int:
        """What the file would hold if its open chunk were closed now, without the summary."""
        return self.file.tell() + self._open_chunk_bytes

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        self._mcap.add_metadata(name, dict(values))

    def attachment(self, name: str, media_type: str, data: bytes, log_time_ns: int) -> None:
        self._mcap.add_attachment(log_time_ns, log_time_ns, name, media_type, data)

    def message(self, kind: Kind, topic: str, data: bytes, log_time_ns: int, sequence: int) -> None:
        channel = self._channels.get(topic) or self._register(kind, topic)
        if self.first_log_time_ns is None:
            self.first_log_time_ns = log_time_ns
        position = self.file.tell()
        self._mcap.add_message(channel, log_time_ns, data, log_time_ns, sequence)
        self.counts[topic] += 1
        added = len(data) + RECORD_BYTES
        self._open_chunk_bytes = self._open_chunk_bytes + added if self.file.tell() == position else 0

    def flush(self) -> None:
        """Close the open chunk and hand it to the operating system."""
        self._mcap.flush()  # type: ignore[no-untyped-call]
        self._open_chunk_bytes = 0

    def finish(self) -> None:
        """Write summary and footer. The file stays open."""
        self._mcap.finish()  # type: ignore[no-untyped-call]

    def _register(self, kind: Kind, topic: str) -> int:
        if kind.schema not in self._schemas:
            self._schemas[kind.schema] = self._mcap.register_schema(
                kind.schema, "protobuf", schema_data(kind.message)
            )
        self._channels[topic] = self._mcap.register_channel(topic, "protobuf", self._schemas[kind.schema])
        return self._channels[topic]
