"""From the description of a message to its protobuf class, and to the descriptors that a recording carries.

A description is what :mod:`seatrial.acquisition.recording.schemas` holds, in the words of JSON Schema. Beside those
it may say the ``format`` of a number that is neither protobuf's ``double`` nor ``int64``, the ``number`` of a field
where fields are not numbered in their order, and the ``names`` of an enumeration's values. What an object does not
require is an ``optional`` field.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from google.protobuf import descriptor_pb2, timestamp_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, Message
from google.protobuf.message_factory import GetMessageClass

Schema: TypeAlias = dict[str, Any]

_FORMATS = {"number": "double", "integer": "int64", "string": "string", "boolean": "bool"}
_TIMESTAMP = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
_FIELD = descriptor_pb2.FieldDescriptorProto
_MESSAGES_OF_FILE, _FIELDS, _MESSAGES = 4, 2, 3  # where in descriptors these stand: what comments refer to


class MessageKind:
    """A kind of message: its full name, its class, and the ``FileDescriptorSet`` by which any reader knows it."""

    def __init__(self, title: str, schema: Schema) -> None:
        self.title = title
        self.descriptors = descriptor_pb2.FileDescriptorSet(
            file=[_TIMESTAMP, _file_of(title, schema)]
        ).SerializeToString()
        self.message = message_class(title, self.descriptors)


def message_class(title: str, descriptors: bytes) -> Any:
    """The class of a message that a ``FileDescriptorSet`` describes.

    It lives in a pool of its own: what another file or program calls so is not meant. Raises ValueError for bytes
    that describe no such message.
    """
    pool = DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(descriptors).file:
            pool.AddSerializedFile(file.SerializeToString())
        return GetMessageClass(pool.FindMessageTypeByName(title))
    except (DecodeError, TypeError, KeyError) as error:
        raise ValueError(f"its schema describes no {title}") from error


def plain(message: Message) -> dict[str, Any]:
    """The fields of a message; optional ones and messages within only where they are said."""
    fields = message.DESCRIPTOR.fields
    names = [entry.name for entry in fields if not entry.has_presence or message.HasField(entry.name)]
    return {name: _plain(getattr(message, name)) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, Message):
        return plain(value)
    if isinstance(value, Mapping):
        return dict(value)
    return value if isinstance(value, str | bytes | int | float) else [_plain(item) for item in value]


def _file_of(title: str, schema: Schema) -> descriptor_pb2.FileDescriptorProto:
    package, _, name = title.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto3", dependency=[_TIMESTAMP.name]
    )
    _fill(file.message_type.add(name=name), schema, f".{title}", file.source_code_info, [_MESSAGES_OF_FILE, 0])
    return file


def _fill(proto: Any, schema: Schema, full_name: str, comments: Any, path: list[int]) -> None:
    """Put the fields of an object into its descriptor, with their descriptions as comments."""
    comments.location.add(path=path, span=(0, 0, 0), leading_comments=schema.get("description", ""))
    required: Any = schema.get("required", schema["properties"])
    for index, (name, definition) in enumerate(schema["properties"].items()):
        field = proto.field.add(name=name, number=definition.get("number", index + 1), label=_FIELD.LABEL_OPTIONAL)
        if definition["type"] == "array" or "additionalProperties" in definition:
            field.label = _FIELD.LABEL_REPEATED
        _set_type(proto, field, definition.get("items", definition), full_name, comments, path)
        if name not in required and field.label != _FIELD.LABEL_REPEATED and field.type != _FIELD.TYPE_MESSAGE:
            field.MergeFrom(_FIELD(proto3_optional=True, oneof_index=len(proto.oneof_decl)))
            proto.oneof_decl.add(name=f"_{name}")
        comments.location.add(
            path=[*path, _FIELDS, index], span=(0, 0, 0), leading_comments=definition.get("description", "")
        )


def _set_type(proto: Any, field: Any, schema: Schema, full_name: str, comments: Any, path: list[int]) -> None:
    """Say of which type a field is, and describe that type, if it is one of its own, within the message."""
    type_name = "".join(word.title() for word in field.name.split("_"))
    if "names" in schema:
        field.type, field.type_name = _FIELD.TYPE_ENUM, f"{full_name}.{schema['title']}"
        enumeration = proto.enum_type.add(name=schema["title"])
        for number, name in enumerate(schema["names"]):
            enumeration.value.add(name=name, number=number)
    elif schema["type"] != "object":
        kind = schema.get("format", _FORMATS[schema["type"]])
        field.type = _FIELD.Type.Value(f"TYPE_{kind.upper()}")
    elif schema.get("title") == "time":
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, ".google.protobuf.Timestamp"
    elif "additionalProperties" in schema:
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, f"{full_name}.{type_name}Entry"
        entry = {
            "type": "object",
            "properties": {"key": {"type": "string"}, "value": schema["additionalProperties"]},
        }
        within = proto.nested_type.add(
            name=f"{type_name}Entry", options=descriptor_pb2.MessageOptions(map_entry=True)
        )
        _fill(within, entry, field.type_name, comments, [*path, _MESSAGES, len(proto.nested_type) - 1])
    else:
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, f"{full_name}.{type_name}"
        within = proto.nested_type.add(name=type_name)
        _fill(within, schema, field.type_name, comments, [*path, _MESSAGES, len(proto.nested_type) - 1])
