"""Every error that leaves a room, and what raises it.

RecorderError
├── UsageError             the caller asked for something that cannot be done; exit code 2
│   ├── ConfigError        an unknown key or a bad value in recorder.toml
│   ├── SourceError        a file, folder or URI that cannot be recorded from
│   └── DriveError         a path that is not a drive, or one that cannot be opened
├── DeviceError            a device failed; the supervisor tries again, a one-shot recording stops
│   ├── DeviceAbsent       nothing answers at this address
│   ├── DeviceDenied       the operating system refuses access
│   ├── DeviceBusy         another program holds the device
│   ├── DeviceUnsuitable   the device offers nothing that we can record
│   └── DeviceLost         the device was there and went away
├── StorageError           the target is full, read-only or broken
├── CodecError             bytes that are not a sound FELICS image
└── NotRunning             nobody answers on the status socket; exit code 3

A user sees one line: where, what, and what to do.
"""


class RecorderError(Exception):
    """An error with a place and a remedy.

    Args:
        what: what is wrong, in a few words.
        where: the path, address, key or device that it concerns.
        todo: what the reader can do about it.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str = "", todo: str = "") -> None:
        self.what, self.where, self.todo = what, where, todo
        super().__init__(what)

    def __str__(self) -> str:
        line = f"{self.where}: {self.what}" if self.where else self.what
        line = f"{line}; {self.todo}" if self.todo else line
        return " ".join(line.split())


class UsageError(RecorderError):
    """The caller asked for something that cannot be done."""

    exit_code = 2


class ConfigError(UsageError):
    """An unknown key or a bad value in the configuration."""


class SourceError(UsageError):
    """A file, folder or URI that cannot be recorded from."""


class DriveError(UsageError):
    """A path that is not a drive, or one that cannot be opened."""


class DeviceError(RecorderError):
    """A device failed."""


class DeviceAbsent(DeviceError):
    """Nothing answers at this address."""


class DeviceDenied(DeviceError):
    """The operating system refuses access to the device."""


class DeviceBusy(DeviceError):
    """Another program holds the device."""


class DeviceUnsuitable(DeviceError):
    """The device offers nothing that we can record."""


class DeviceLost(DeviceError):
    """The device was there and went away."""


class StorageError(RecorderError):
    """The target is full, read-only or broken."""


class CodecError(RecorderError):
    """Bytes that are not a sound FELICS image.

    Args:
        what: what is wrong.
        offset: the byte at which it was noticed, from the start of the image, or None.
    """

    def __init__(self, what: str, *, offset: int | None = None) -> None:
        self.offset = offset
        super().__init__(what if offset is None else f"{what} at byte {offset}")


class NotRunning(RecorderError):
    """Nobody answers on the status socket."""

    exit_code = 3
