"""The kernel's pulses: its structures to the byte, and nodes that are none. No pulse is at hand here."""

import os
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from recorder.drivers import pps
from recorder.drivers.pps import PpsSource, edge
from recorder.errors import DeviceAbsent, DeviceDenied, DeviceUnsuitable
from recorder.samples import PpsEdge, Stamp

HEADER = Path("/usr/include/linux/pps.h")
PROGRAM = r"""
#include <cstdio>
#include <cstring>
#include <linux/pps.h>
#include <sys/ioctl.h>
int main() {
    pps_fdata data;
    std::memset(&data, 0, sizeof data);
    data.info.assert_sequence = 0xfffffffe;
    data.info.clear_sequence = 7;
    data.info.assert_tu.sec = 1700000000;
    data.info.assert_tu.nsec = 123456789;
    data.info.assert_tu.flags = 3;
    data.info.clear_tu.sec = -5;
    data.info.current_mode = 0x11;
    data.timeout.sec = 2;
    data.timeout.nsec = 150000000;
    unsigned long fetch = PPS_FETCH, capabilities = PPS_GETCAP, parameters = PPS_GETPARAMS;
    std::fprintf(stderr, "%zu %zu %lu %lu %lu %d %d\n", sizeof data, sizeof(pps_kparams), fetch,
                 capabilities, parameters, PPS_CAPTUREASSERT, PPS_CANWAIT);
    std::fwrite(&data, sizeof data, 1, stdout);
}
"""


@pytest.mark.skipif(not HEADER.exists() or shutil.which("g++") is None, reason="no g++ or no linux/pps.h")
def test_structures_and_requests_are_the_kernels(tmp_path: Path) -> None:
    (tmp_path / "pps.cpp").write_text(PROGRAM)
    subprocess.run(["g++", "-o", tmp_path / "pps", tmp_path / "pps.cpp"], check=True)
    told = subprocess.run([tmp_path / "pps"], capture_output=True, check=True)
    assert list(map(int, told.stderr.split())) == [
        pps.FETCH.size,
        pps.PARAMETERS.size,
        pps.PPS_FETCH,
        pps.PPS_GETCAP,
        pps.PPS_GETPARAMS,
        pps.CAPTURE_ASSERT,
        pps.CAN_WAIT,
    ]
    assert pps.FETCH.unpack(told.stdout) == (
        0xFFFFFFFE, 7, 1_700_000_000, 123_456_789, 3, -5, 0, 0, 0x11, 2, 150_000_000, 0,
    )  # fmt: skip


def test_an_edge_bears_the_kernels_stamp_and_the_reading_after_it() -> None:
    fetched = pps.FETCH.pack(41, 40, 1_700_000_000, 999_999_999, 0, 1_699_999_999, 5, 0, 1, 0, 0, 0)
    assert edge(fetched, 77) == PpsEdge(Stamp(raw_ns=77, realtime_ns=1_700_000_000_999_999_999), 41)


@pytest.mark.parametrize("node", ["/dev/null", "/dev/zero", "/dev/tty"])
def test_a_node_that_is_no_pps_is_refused(node: str) -> None:
    with pytest.raises((DeviceUnsuitable, DeviceAbsent)) as caught:
        PpsSource(node).open()
    assert caught.value.where == node
    assert caught.value.todo


def test_a_file_is_no_pps(tmp_path: Path) -> None:
    (tmp_path / "pps0").write_bytes(bytes(64))
    with pytest.raises(DeviceUnsuitable, match="it is no PPS device"):
        PpsSource(str(tmp_path / "pps0")).open()


def test_a_source_that_is_not_there_is_absent(tmp_path: Path) -> None:
    with pytest.raises(DeviceAbsent, match="no such device"):
        PpsSource(str(tmp_path / "pps9")).open()


def test_a_source_that_may_not_be_read_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, flags: int) -> int:
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(DeviceDenied):
        PpsSource("/dev/pps0").open()


@pytest.mark.skipif(not Path("/dev/pps0").exists(), reason="no /dev/pps0 here")
def test_edges_of_a_real_source_come_a_second_apart() -> None:
    source = PpsSource("/dev/pps0")
    source.open()
    edges = []
    for one in source.samples():
        edges += [one] if one else []
        if len(edges) == 3:
            break
    source.close()
    steps = [b.sequence - a.sequence for a, b in pairwise(edges)]
    assert steps == [1, 1]
    for before, after in pairwise(edges):
        step_ns = (after.stamp.realtime_ns or 0) - (before.stamp.realtime_ns or 0)
        assert abs(step_ns - 1_000_000_000) < 10_000_000
