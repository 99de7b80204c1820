"""What the operating system says of a target, as one line that a person can act on."""

import errno
from pathlib import Path

from recorder.errors import StorageError

_MEANING: dict[int, tuple[str, str]] = {
    errno.ENOSPC: ("full", "free some space or choose another place"),
    errno.EDQUOT: ("the disk quota is used up", "free some space or choose another place"),
    errno.EFBIG: ("a file may not grow any further here", "raise the limit or cut segments smaller"),
    errno.EROFS: ("read-only", "remount it writable or choose another place"),
    errno.EACCES: ("no permission to write", "change the owner or choose another place"),
    errno.EPERM: ("not permitted to write", "change the owner or choose another place"),
    errno.EIO: ("input/output error", "check the disk and its cable"),
    errno.ENODEV: ("the disk is gone", "connect it again or choose another place"),
    errno.ENXIO: ("the disk is gone", "connect it again or choose another place"),
    errno.ENOTDIR: ("not a folder", "choose a folder"),
    errno.EEXIST: ("not a folder", "choose a folder"),
    errno.ENAMETOOLONG: ("the name is too long", "choose a shorter one"),
    errno.EMFILE: ("too many open files", "raise the limit of open files"),
}


def storage_error(error: OSError, where: Path | str) -> StorageError:
    """``error`` as a `StorageError`: what is wrong with ``where``, and what to do."""
    what, todo = _MEANING.get(error.errno or 0, ("cannot be written", "check the disk"))
    detail = "" if error.errno in _MEANING else f" ({error.strerror or error})"
    return StorageError(what + detail, where=str(where), todo=todo)
