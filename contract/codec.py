"""Messages to bytes and back: JSON, with an error that names the message, the field and the fault."""

from functools import cache
from typing import Any, TypeVar

import msgspec

from contract.messages import Message

T = TypeVar("T", bound=Message)

MAX_PAYLOAD_BYTES = 65536

_encoder = msgspec.json.Encoder()


class WireError(ValueError):
    """A payload that is not the message it should be; the text names message, field and fault."""

    def __init__(self, kind: str, fault: str) -> None:
        super().__init__(f"{kind}: {fault}")
        self.kind = kind
        self.fault = fault


@cache
def _decoder(kind: type[T]) -> msgspec.json.Decoder[T]:
    return msgspec.json.Decoder(kind)


def encode(message: Message) -> bytes:
    """The message as UTF-8 JSON. Numbers must be finite; a NaN would not survive the trip.

    The encoder trusts its caller for bounds (the receiver checks them), since it runs in the
    control loop.
    """
    return _encoder.encode(message)


def decode(kind: type[T], payload: bytes) -> T:
    """A message of the given kind.

    :raises WireError: too large, not JSON, wrong or unknown or missing field, out of bounds.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise WireError(kind.__name__, f"{len(payload)} bytes, at most {MAX_PAYLOAD_BYTES} allowed")
    try:
        message: T = _decoder(kind).decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise WireError(kind.__name__, str(error)) from None
    return message


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON Schema of a message, as stored beside its recordings."""
    return msgspec.json.schema(kind)
