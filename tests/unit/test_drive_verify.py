"""Every gap accounted for, every flipped byte found."""

import random
from pathlib import Path

import pytest

from recorder.errors import DriveError
from recorder.samples import ClockPair, Loss, LossCause, NmeaSentence, Record, Stamp
from recorder.storage import inspect, open_drive, verify
from recorder.storage.ledger import settle
from tests.unit.drive_maker import frame, frames, make_drive, raw_ns

IMAGE = "/camera/front/image"


def _loss(first: int, last: int, stream: str = IMAGE) -> Loss:
    return Loss(stream, first, last, raw_ns(first), raw_ns(last), LossCause.QUEUE)


def _with_gap() -> list[Record]:
    return [one for one in frames(12) if one.id not in (4, 5, 8)]


def test_a_gap_without_a_ledger(tmp_path: Path) -> None:
    with open_drive(make_drive(tmp_path, _with_gap())) as drive:
        told = verify(drive)
        seen = inspect(drive).topics[IMAGE]
    assert (told.ok, told.frames, told.damaged, told.unaccounted) == (False, 9, 0, 3)
    assert f"{IMAGE}: ids 4 to 5 missing and not in the ledger" in told.problems
    assert (seen.gaps, seen.lost) == (3, 0)


def test_a_gap_in_the_ledger(tmp_path: Path) -> None:
    path = make_drive(tmp_path, [*_with_gap(), _loss(4, 5), _loss(8, 8), _loss(12, 14)])
    with open_drive(path) as drive:
        told = verify(drive)
        seen = inspect(drive)
    assert (told.ok, told.unaccounted, told.problems) == (True, 0, [])
    assert (seen.topics[IMAGE].gaps, seen.topics[IMAGE].lost) == (6, 6)
    assert seen.losses == {"queue": 6}


@pytest.mark.parametrize(
    ("losses", "unaccounted", "words"),
    [
        ([_loss(4, 5)], 1, "id 8 missing"),
        ([_loss(4, 6), _loss(8, 8)], 1, "id 6 in the ledger as lost, but there"),
        ([_loss(4, 5), _loss(5, 5), _loss(8, 8)], 0, "id 5 in the ledger more than once"),
        ([_loss(4, 5), _loss(8, 8, "/camera/tag/image")], 1, "id 8 missing"),
    ],
)
def test_a_ledger_that_does_not_agree(
    tmp_path: Path, losses: list[Loss], unaccounted: int, words: str
) -> None:
    with open_drive(make_drive(tmp_path, [*_with_gap(), *losses])) as drive:
        told = verify(drive)
    assert not told.ok
    assert told.unaccounted == unaccounted
    assert any(words in problem for problem in told.problems)


def test_ids_and_times_that_go_back(tmp_path: Path) -> None:
    with open_drive(make_drive(tmp_path, [frame(0), frame(2), frame(1)])) as drive:
        problems = verify(drive).problems
    assert any("id 1 after 2" in problem for problem in problems)
    assert any("its time goes back by 16717000 ns" in problem for problem in problems)


def test_the_ledger_of_many_ids() -> None:
    account = settle([5, 10**18], [(7, 10**17), (10**18 + 1, 10**19)])
    assert account.missing == ((6, 6), (10**17 + 1, 10**18 - 1))
    assert account.contradicted == account.repeated == ()
    assert settle([], [(1, 3)]).absent == 3
    assert settle([1, 2, 3], []).unaccounted == 0


def test_a_damaged_image_is_one_damaged_frame(tmp_path: Path) -> None:
    path = make_drive(tmp_path, frames(12))
    segment = path / "0000.mcap"
    data = bytearray(segment.read_bytes())
    data[data.index(frame(7).data) + 150] ^= 4
    segment.write_bytes(data)
    with open_drive(path) as drive:
        assert drive.problems == []
        told = verify(drive)
    assert (told.ok, told.frames, told.damaged, told.unaccounted) == (False, 11, 1, 0)
    assert any("frame 7" in problem for problem in told.problems)
    assert any("checksum" in problem for problem in told.problems)


def test_a_damaged_stamp_is_never_returned(tmp_path: Path) -> None:
    path = make_drive(tmp_path, frames(3))
    segment = path / "0000.mcap"
    data = bytearray(segment.read_bytes())
    data[data.index(frame(1).data) - 20] ^= 1
    segment.write_bytes(data)
    with open_drive(path) as drive:
        with pytest.raises(DriveError, match="damaged"):
            drive.frames("front")[1]
        assert drive.frames("front")[2].id == 2
        assert drive.frames("front").at(utc_ns=frame(1).stamp.utc_ns).id in (0, 2)
        told = verify(drive)
        assert inspect(drive).problems
    assert (told.ok, told.damaged) == (False, 1)


def test_a_flipped_byte_anywhere_is_found(tmp_path: Path) -> None:
    records: list[Record] = [frame(0), frame(1), _loss(2, 2), frame(3)]
    records += [ClockPair(raw_ns(3), 1, 2, 3, 4), NmeaSentence(Stamp(raw_ns=raw_ns(3)), b"$GPRMC")]
    path = make_drive(tmp_path, records, sync_every=2)
    segment = path / "0000.mcap"
    data = bytearray(segment.read_bytes())
    rng = random.Random(7)
    unseen = []
    everywhere = rng.sample(range(len(data)), 500)
    heads_and_ends = [*range(60, 560, 9), *range(len(data) - 400, len(data), 7)]
    for at in everywhere + heads_and_ends:
        flip = 1 << rng.randrange(8)
        data[at] ^= flip
        segment.write_bytes(data)
        try:
            with open_drive(path) as drive:
                told = verify(drive)
        except DriveError:
            pass
        else:
            if told.ok or not told.problems:
                unseen.append((at, flip))
        data[at] ^= flip
    assert unseen == []


def test_progress_goes_to_the_end(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    with open_drive(make_drive(tmp_path, frames(5))) as drive:
        verify(drive, lambda done, total: seen.append((done, total)))
        assert seen[-1] == (drive.segments[0].size_bytes,) * 2
    assert seen == sorted(seen)
