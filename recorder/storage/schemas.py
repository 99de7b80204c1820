"""Protobuf schemas as MCAP wants them: a set of file descriptors that explains itself."""

from functools import cache
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message

MessageClass = type[Message]


def schema_data(message: MessageClass) -> bytes:
    """The serialised FileDescriptorSet of a message class, dependencies first."""
    return _schema_data(message.DESCRIPTOR)


@cache
def _schema_data(descriptor: Any) -> bytes:
    files: dict[str, Any] = {}

    def collect(file: Any) -> None:
        if file.name in files:
            return
        for dependency in file.dependencies:
            collect(dependency)
        files[file.name] = file

    collect(descriptor.file)
    described = descriptor_pb2.FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(described.file.add())
    return described.SerializeToString(deterministic=True)


def message_class(name: str, data: bytes) -> MessageClass:
    """The class of message ``name`` as a foreign or older schema describes it.

    Raises ValueError if ``data`` is not a set of file descriptors that holds ``name``.
    """
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(data).file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except Exception as error:
        raise ValueError(f"schema {name!r} is not usable ({type(error).__name__})") from error
