"""What systemd is told: ``sd_notify(3)`` over its datagram socket."""

import os
import socket


def notify(state: str) -> bool:
    """Send one state, such as ``READY=1``; False where nobody listens. Never waits, never raises."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    if address.startswith("@"):  # abstract socket
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            link.connect(address)
            link.send(state.encode(), socket.MSG_DONTWAIT)
    except OSError:
        return False
    return True


def watchdog_period_s() -> float | None:
    """How often systemd wants to hear from us: half of what the unit allows; None without a watchdog."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    return int(microseconds) / 2e6 if microseconds.isdigit() else None
