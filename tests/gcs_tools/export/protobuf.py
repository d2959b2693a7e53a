"""Decodes messages by the descriptors that an MCAP file or a server sends with them."""

from __future__ import annotations

from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.json_format import MessageToDict
from google.protobuf.message_factory import GetMessageClass


def decoded(schema_name: str, schema: bytes, data: bytes) -> dict[str, Any]:
    """Return a message with every field, by the names of the schema."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    message = GetMessageClass(pool.FindMessageTypeByName(schema_name))()
    message.ParseFromString(data)
    found: dict[str, Any] = MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
    return found
