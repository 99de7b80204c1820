"""The status socket: one object per connection, and what happens when nobody is there."""

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from recorder.errors import NotRunning, RecorderError
from recorder.service.status import StatusServer, read_status, socket_path

HEALTHY = {
    "recording": True,
    "devices": {"gnss": {"state": "streaming", "reason": "", "samples": 1, "lost": 0}},
    "time": {},
    "disk": {},
    "processes": {},
}


@pytest.fixture
def server(tmp_path: Path) -> Iterator[StatusServer]:
    server = StatusServer(tmp_path / "status.sock", lambda: HEALTHY)
    server.start()
    yield server
    server.close()


def test_each_connection_gets_one_object(server: StatusServer) -> None:
    for _ in range(3):
        assert read_status(server.path) == HEALTHY


def test_a_client_that_sends_garbage_or_leaves_does_no_harm(server: StatusServer) -> None:
    for sent in (b"", b"\x00" * 1000, b"GET / HTTP/1.1\r\n\r\n"):
        with socket.socket(socket.AF_UNIX) as link:
            link.connect(str(server.path))
            link.sendall(sent)
    assert read_status(server.path) == HEALTHY


def test_the_socket_is_gone_after_close(tmp_path: Path) -> None:
    server = StatusServer(tmp_path / "status.sock", dict)
    server.start()
    server.close()
    assert not server.path.exists()


def test_nobody_there_is_not_running_with_exit_code_3(tmp_path: Path) -> None:
    with pytest.raises(NotRunning) as caught:
        read_status(tmp_path / "none.sock")
    assert caught.value.exit_code == 3
    assert "recorder run" in str(caught.value)


def test_a_socket_left_by_a_crash_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "status.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    server = StatusServer(path, lambda: HEALTHY)
    server.start()
    assert read_status(path) == HEALTHY
    server.close()


def test_a_second_recorder_is_refused(server: StatusServer) -> None:
    with pytest.raises(RecorderError, match="another recorder is running"):
        StatusServer(server.path, dict).start()


def test_a_path_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecorderError, match="status socket cannot be made"):
        StatusServer(tmp_path / "file" / "status.sock", dict).start()


def test_a_recorder_that_hangs_is_not_pushed_aside(tmp_path: Path) -> None:
    hung = StatusServer(tmp_path / "status.sock", dict)
    hung.start()
    hung._stop.set()  # nobody answers any more, but it still runs
    hung._thread.join()
    with pytest.raises(RecorderError, match="another recorder is running"):
        StatusServer(hung.path, dict).start()
    assert hung.path.is_socket()
    hung.close()


def test_a_status_that_fails_is_told(tmp_path: Path) -> None:
    def broken() -> dict[str, object]:
        raise OSError("disk is gone")

    server = StatusServer(tmp_path / "status.sock", broken)
    server.start()
    told = read_status(server.path)
    server.close()
    assert told["healthy"] is False
    assert "disk is gone" in told["problems"][0]


@pytest.mark.parametrize(
    "told",
    [
        b"",
        b"[1]",
        b"{}",
        b"[" * 100_000,
        b'{"devices": [1]}',
        json.dumps({**HEALTHY, "devices": {"a": {}}}).encode(),
    ],
)
def test_something_else_on_the_socket_is_no_recorder(tmp_path: Path, told: bytes) -> None:
    path = tmp_path / "status.sock"
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(path))
        other.listen()

        def answer() -> None:
            link, _ = other.accept()
            link.sendall(told)
            link.close()

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(NotRunning, match="no recorder"):
            read_status(path)
        thread.join()


def test_the_environment_names_the_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RECORDER_SOCKET", raising=False)
    assert socket_path() == Path("/run/recorder/status.sock")
    assert socket_path(Path("/a")) == Path("/a")
    monkeypatch.setenv("RECORDER_SOCKET", "/b")
    assert socket_path(Path("/a")) == Path("/b")
