"""When the images of a file were: from a CSV, from the container, or by counting."""

import csv
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

from recorder.errors import SourceError

DEFAULT_RATE = Fraction(25)
"""Images a second where nothing says it."""

_LIMIT_NS = 1 << 62


def read_times(path: Path) -> Sequence[int]:
    """Nanoseconds of each image, strictly rising: a column ``time_ns`` (integers) or ``time_s`` (decimals).

    Never through a float: 1700000000.123456789 s has more digits than one holds.
    Raises `SourceError`.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            column = next((name for name in ("time_ns", "time_s") if name in (rows.fieldnames or ())), None)
            if column is None:
                todo = "its first line must name a column time_ns or time_s"
                raise SourceError("no column of times", where=str(path), todo=todo)
            times = [_ns(row[column], column, f"{path}:{rows.line_num}") for row in rows]
    except FileNotFoundError:
        raise SourceError("no such file", where=str(path), todo="check drivers.camera.*.times") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SourceError(f"cannot be read as CSV ({error})", where=str(path)) from error
    for row, (before, after) in enumerate(pairwise(times), start=2):
        if after <= before:
            raise SourceError(f"the time of image {row - 1} is not after the one before it", where=str(path))
    return times


def _ns(text: str | None, column: str, where: str) -> int:
    try:
        value = Decimal((text or "").strip())
        ns = value if column == "time_ns" else value.scaleb(9)
        if not ns.is_finite() or abs(ns) >= _LIMIT_NS or (column == "time_ns" and ns != int(ns)):
            raise InvalidOperation
    except InvalidOperation:
        need = "an integer" if column == "time_ns" else "a decimal number of seconds"
        raise SourceError(f"{column} is {text!r}", where=where, todo=f"it must be {need}") from None
    return int(ns.to_integral_value())


class MediaTimes:
    """The time of each image, strictly rising.

    Args:
        listed: from a CSV; nothing else counts then.
        rate: images a second, for images whose file tells no time, or none after the one before.
    """

    def __init__(self, listed: Sequence[int] | None, rate: Fraction | None) -> None:
        self._listed = listed
        self._rate = rate or DEFAULT_RATE
        self._anchor = (0, 0)
        self._last_ns: int | None = None

    def of(self, index: int, media_ns: int | None) -> int:
        """Images must be asked for in order. Raises `IndexError` if the list has no such image."""
        if self._listed is not None:
            return self._listed[index]
        counted = self._anchor[1] + (index - self._anchor[0]) * 1_000_000_000 * self._rate.denominator // (
            self._rate.numerator
        )
        if media_ns is None or (self._last_ns is not None and media_ns <= self._last_ns):
            self._last_ns = counted
        else:
            self._anchor = (index, media_ns)
            self._last_ns = media_ns
        return self._last_ns

    def start_ns(self, index: int, first_ns: int) -> int:
        """The time of image 0, given that of the first image there is."""
        if self._listed is not None:
            return self._listed[0]
        return first_ns - index * 1_000_000_000 * self._rate.denominator // self._rate.numerator
