"""A drive on disk: its writer, its reader, and what is asked of it as a whole."""

from recorder.storage.access import Message
from recorder.storage.drive import Drive, TopicInfo, open_drive
from recorder.storage.export import export
from recorder.storage.frames import Frames, NoFrame, StoredFrame
from recorder.storage.head import DriveHead
from recorder.storage.inspect import Inspection, inspect
from recorder.storage.retime import Retiming, retime
from recorder.storage.verify import Verification, verify
from recorder.storage.writer import DriveWriter

__all__ = [
    "Drive",
    "DriveHead",
    "DriveWriter",
    "Frames",
    "Inspection",
    "Message",
    "NoFrame",
    "Retiming",
    "StoredFrame",
    "TopicInfo",
    "Verification",
    "export",
    "inspect",
    "open_drive",
    "retime",
    "verify",
]
