"""Which ids of a stream are in a drive, which are not, and which losses are stated."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

Range = tuple[int, int]
"""First and last id, both inclusive."""


@dataclass(frozen=True, slots=True)
class Account:
    """The ids of one stream against the ledger of losses."""

    missing: tuple[Range, ...]
    """Up to the last id that is there: neither there nor stated as lost."""
    contradicted: tuple[Range, ...]
    """Stated as lost, but there."""
    repeated: tuple[Range, ...]
    """Stated as lost more than once."""
    absent: int
    """Ids that are not there, by the gaps between ids or by the ledger."""

    @property
    def unaccounted(self) -> int:
        return sum(map(count, (*self.missing, *self.contradicted)))


def settle(ids: Iterable[int], losses: Iterable[Range], *, first: int | None = None) -> Account:
    """Compare the ids that are there with those that are stated as lost. Any order, any size.

    ``first`` is the id that the stream must begin with, None if it may begin with any.
    """
    there = union((number, number) for number in ids)
    stated = sorted(losses)
    lost = union(stated)
    inner = gaps(there)
    if first is not None and there and there[0][0] > first:
        inner = [(first, there[0][0] - 1), *inner]
    return Account(
        missing=tuple(without(inner, lost)),
        contradicted=tuple(common(there, lost)),
        repeated=tuple(_overlaps(stated)),
        absent=sum(map(count, union([*inner, *without(lost, there)]))),
    )


def count(ids: Range) -> int:
    return ids[1] - ids[0] + 1


def union(ranges: Iterable[Range]) -> list[Range]:
    """Sorted, disjoint, adjacent ones joined."""
    joined: list[Range] = []
    for first, last in sorted(ranges):
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = (joined[-1][0], max(joined[-1][1], last))
        else:
            joined.append((first, last))
    return joined


def gaps(ranges: list[Range]) -> list[Range]:
    """What lies between disjoint sorted ranges."""
    return [(a[1] + 1, b[0] - 1) for a, b in pairwise(ranges)]


def common(one: list[Range], other: list[Range]) -> list[Range]:
    """What is in both of two lists of disjoint sorted ranges."""
    found: list[Range] = []
    i = j = 0
    while i < len(one) and j < len(other):
        first, last = max(one[i][0], other[j][0]), min(one[i][1], other[j][1])
        if first <= last:
            found.append((first, last))
        if one[i][1] < other[j][1]:
            i += 1
        else:
            j += 1
    return found


def without(one: list[Range], other: list[Range]) -> list[Range]:
    """What is in ``one`` and not in ``other``, both disjoint and sorted."""
    if not one:
        return []
    everything = (one[0][0], one[-1][1])
    edges = [(everything[0] - 1, everything[0] - 1), *common(other, [everything])]
    edges.append((everything[1] + 1, everything[1] + 1))
    return common(one, [gap for gap in gaps(union(edges)) if gap[0] <= gap[1]])


def _overlaps(ranges: list[Range]) -> list[Range]:
    found = []
    reached = -1
    for first, last in ranges:
        if first <= reached:
            found.append((first, min(last, reached)))
        reached = max(reached, last)
    return found
