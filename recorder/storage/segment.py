"""What a segment holds, found without reading its images."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, ChunkIndex, Schema
from numpy.typing import NDArray

ENTRY = np.dtype(
    [
        ("log_time", "<u8"),
        ("offset", "<u8"),  # of the message record, in the file or in the decompressed chunk
        ("size", "<u8"),  # of the message's data
        ("chunk", "<i4"),  # of the segment's compressed chunks, else PLAIN
        ("segment", "<u4"),
        ("channel", "<u2"),
    ]
)
"""One message."""

PLAIN = -1
"""The message stands in the file as it is."""

Entries = NDArray[np.void]
Numbers = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class PackedChunk:
    """A compressed chunk: where its data stand, and how they are packed."""

    data: int
    size: int
    uncompressed_size: int
    compression: str


@dataclass(slots=True)
class Segment:
    """One MCAP file, as far as it can be read."""

    path: Path
    number: int | None
    """From its name; None for a file that is named otherwise."""
    size_bytes: int
    indexed: bool = False
    """Its summary is there and sound; otherwise it was read record by record."""
    end_reason: str | None = None
    """"closed" or "continued"; None if the segment does not say."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    entries: dict[int, Entries] = field(default_factory=dict)
    """By channel, in the order of the file."""
    packed: list[PackedChunk] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    """As the summary has them."""
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def closed(self) -> bool:
        """Whether the writer finished it."""
        return self.indexed and self.end_reason is not None

    @property
    def messages(self) -> int:
        return sum(len(entries) for entries in self.entries.values())

    def last_metadata(self, name: str) -> dict[str, str] | None:
        """The latest metadata record of a name."""
        return next((values for other, values in reversed(self.metadata) if other == name), None)

    def problem(self, text: str) -> None:
        self.problems.append(f"{self.name}: {text}")


class EntryList:
    """Collects the messages of one channel."""

    def __init__(self, channel: int) -> None:
        self._channel = channel
        self._blocks: list[Entries] = []
        self._rows: list[tuple[int, int, int, int, int, int]] = []

    def add(self, log_time_ns: int, offset: int, size: int, chunk: int) -> None:
        self._rows.append((log_time_ns, offset, size, chunk, 0, self._channel))

    def extend(self, log_time_ns: Numbers, offset: Numbers, size: Numbers, chunk: int) -> None:
        self._settle()
        block = np.zeros(len(log_time_ns), ENTRY)
        block["log_time"], block["offset"], block["size"] = log_time_ns, offset, size
        block["chunk"], block["channel"] = chunk, self._channel
        self._blocks.append(block)

    def entries(self) -> Entries:
        self._settle()
        return np.concatenate(self._blocks) if self._blocks else np.zeros(0, ENTRY)

    def _settle(self) -> None:
        if self._rows:
            self._blocks.append(np.array(self._rows, ENTRY))
            self._rows.clear()
