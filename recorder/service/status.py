"""``recorder status``: one JSON object per connection on a Unix socket."""

import contextlib
import fcntl
import json
import os
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from recorder.errors import NotRunning, RecorderError

DEFAULT_SOCKET = Path("/run/recorder/status.sock")
_TIMEOUT_S = 2.0
_SIZE_MAX = 1 << 20


def socket_path(configured: Path | None = None) -> Path:
    """Where the status socket is: ``$RECORDER_SOCKET``, else as configured, else the default."""
    told = os.environ.get("RECORDER_SOCKET", "")
    return Path(told) if told else configured or DEFAULT_SOCKET


def read_status(path: Path) -> dict[str, Any]:
    """Ask a running service. Raises `NotRunning` if nobody answers with a status."""
    todo = "start it with: recorder run --config recorder.toml"
    try:
        told = _ask(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise NotRunning(f"no recorder answers ({reason})", where=str(path), todo=todo) from None
    try:
        status = json.loads(told)
    except (ValueError, RecursionError):
        status = None
    if not isinstance(status, dict) or not _is_status(status):
        raise NotRunning("what answers is no recorder", where=str(path), todo=todo)
    return status


def _ask(path: Path) -> bytes:
    """All that is answered, within a time and a size. Raises OSError."""
    end = time.monotonic() + _TIMEOUT_S
    told = b""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(_TIMEOUT_S)
        link.connect(str(path))
        while part := link.recv(65536):
            told += part
            if len(told) > _SIZE_MAX or time.monotonic() > end:
                raise OSError("it does not stop talking")
    return told


def _is_status(told: dict[str, Any]) -> bool:
    """Whether an object has what people are shown of a status."""
    if "problems" in told and "recording" not in told:  # a recorder that cannot tell its state
        return isinstance(told["problems"], list)
    devices = told.get("devices")
    kinds = {"recording": bool, "time": dict, "disk": dict, "processes": dict, "devices": dict}
    return all(isinstance(told.get(key), kind) for key, kind in kinds.items()) and all(
        isinstance(device, dict) and {"state", "reason", "samples", "lost"} <= device.keys()
        for device in (devices or {}).values()
    )


class StatusServer:
    """Answers on the socket, in its own thread; nothing waits for it.

    Each connection gets the object that ``status`` returns and is closed; a client that does
    not read within two seconds is dropped. Nothing a client sends is read. A lock file beside the
    socket says whose it is, also while a recorder hangs.
    """

    def __init__(self, path: Path, status: Callable[[], dict[str, Any]]) -> None:
        self.path = path
        self._status = status
        self._stop = threading.Event()
        self._socket: socket.socket | None = None
        self._lock: IO[bytes] | None = None
        self._thread = threading.Thread(target=self._serve, name="status", daemon=True)

    def start(self) -> None:
        """Raises `RecorderError` if another recorder runs there or the socket cannot be made."""
        server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = self.path.with_name(self.path.name + ".lock").open("wb")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self.path.is_socket():
                self.path.unlink()  # left behind by a crash: the lock is ours
            server.bind(str(self.path))
            self.path.chmod(0o660)
            server.listen(8)
            server.settimeout(0.2)
        except BlockingIOError:
            server.close()
            self._let_go()
            todo = "stop it first"
            raise RecorderError("another recorder is running", where=str(self.path), todo=todo) from None
        except OSError as error:
            server.close()
            self._let_go()
            raise RecorderError(
                f"status socket cannot be made ({error.strerror or error})",
                where=str(self.path),
                todo="set service.socket or RECORDER_SOCKET to a path that can be written",
            ) from None
        self._socket = server
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        if self._socket is None:
            return
        self._thread.join()
        self._socket.close()
        self._socket = None
        with contextlib.suppress(OSError):
            self.path.unlink()
        self._let_go()

    def _let_go(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _answer(self) -> bytes:
        try:
            told = self._status()
        except Exception as error:  # whoever asks must learn that something is wrong
            told = {"healthy": False, "problems": [f"status: {type(error).__name__}: {error}"]}
        return json.dumps(told).encode() + b"\n"

    def _serve(self) -> None:
        assert self._socket is not None
        while not self._stop.is_set():
            try:
                link, _ = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            answer = self._answer()
            with link, contextlib.suppress(OSError):
                link.settimeout(_TIMEOUT_S)
                link.sendall(answer)
