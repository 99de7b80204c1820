"""The times and numbers of a topic as CSV; times stay integers."""

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recorder.storage.access import Message
from recorder.storage.drive import FRAME_SCHEMA, Drive
from recorder.storage.frames import StoredFrame
from recorder.storage.stamps import timestamp_ns

Row = dict[str, Any]

_TEXT_BYTES_MAX = 1024
"""Longer bytes are told by their number."""


def write_csv(drive: Drive, topic: str, out: Path, report: Callable[[int, int], None]) -> int:
    """Raises OSError, `DriveError`."""
    total = drive.topics[topic].messages
    out.parent.mkdir(parents=True, exist_ok=True)
    rows = _frame_rows(drive, topic) if drive.topics[topic].schema == FRAME_SCHEMA else _rows(drive, topic)
    with out.open("w", newline="", encoding="utf-8") as file:
        writer: csv.DictWriter[str] | None = None
        for done, row in enumerate(rows, 1):
            if writer is None:
                writer = csv.DictWriter(file, list(row), restval="", extrasaction="ignore")
                writer.writeheader()
            writer.writerow(row)
            report(done, total)
    return total


def _frame_rows(drive: Drive, topic: str) -> Iterator[Row]:
    for frame in drive.frames(topic.split("/")[2]):
        yield _frame_row(frame)


def _frame_row(frame: StoredFrame) -> Row:
    return {
        "log_time_ns": frame.log_time_ns,
        "id": frame.id,
        **flatten(frame.stamp),
        **flatten(frame.settings),
        "width": frame.width,
        "height": frame.height,
        "bit_depth": frame.bit_depth,
        "bytes": frame.data_size,
    }


def _rows(drive: Drive, topic: str) -> Iterator[Row]:
    for message in drive.messages(topic):
        yield {
            "log_time_ns": message.log_time_ns,
            "raw_ns": message.raw_ns,
            "sequence": message.sequence,
            **_content(message),
        }


def _content(message: Message) -> Row:
    sample = message.sample
    if sample is not None:
        return flatten(sample)
    if isinstance(message.value, bytes):
        return {"data": _cell(message.value)}
    return _flatten_proto(message.value, "")


def flatten(sample: object) -> Row:
    """The fields of a sample, those of its stamp and settings beside them."""
    row: Row = {}
    for one in fields(sample):  # type: ignore[arg-type]
        value = getattr(sample, one.name)
        if is_dataclass(value):
            row |= flatten(value)
        else:
            row[one.name] = _cell(value)
    return row


def _flatten_proto(value: Any, prefix: str) -> Row:
    """Every scalar field of a foreign message, nested ones with dots in their names."""
    row: Row = {}
    for one in value.DESCRIPTOR.fields:
        name, content = prefix + one.name, getattr(value, one.name)
        if _is_repeated(one):
            row[f"{name}.count"] = len(content)
        elif one.message_type is None:
            row[name] = _cell(content)
        elif one.message_type.full_name == "google.protobuf.Timestamp":
            row[name] = timestamp_ns(content)
        elif value.HasField(one.name) or len(prefix.split(".")) < 4:
            row |= _flatten_proto(content, f"{name}.")
    return row


def _is_repeated(field: Any) -> bool:
    """protobuf 6 renamed the question."""
    if hasattr(field, "is_repeated"):
        return bool(field.is_repeated)
    return bool(field.label == field.LABEL_REPEATED)


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, bytes):
        if len(value) > _TEXT_BYTES_MAX:
            return f"{len(value)} bytes"
        text = value.decode("ascii", "backslashreplace").rstrip("\r\n")
        return text if text.isprintable() else value.hex()
    if isinstance(value, np.ndarray):
        return json.dumps([None if number != number else number for number in value.tolist()])  # noqa: PLR0124
    if isinstance(value, bool):
        return "true" if value else "false"
    return value
