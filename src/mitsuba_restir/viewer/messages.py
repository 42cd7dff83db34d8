"""What a browser may say by the websocket, checked before anything is done with it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LONGEST = 4096
"""Bytes of a message."""

Way = Annotated[float, Field(ge=-4, le=4, allow_inf_nan=False)]
"""Of a mouse between two frames, in heights of the picture; of keys, in seconds of flight."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Seen(_Message):
    """The picture has been drawn; another one may come."""

    type: Literal["seen"]
    number: int = Field(ge=0, le=2**53)


class Drag(_Message):
    """The mouse has moved the camera."""

    type: Literal["drag"]
    how: Literal["orbit", "look", "pan"]
    dx: Way
    dy: Way


class Dolly(_Message):
    """The wheel has moved the camera."""

    type: Literal["dolly"]
    amount: Way


class Fly(_Message):
    """Keys have moved the camera."""

    type: Literal["fly"]
    right: Way
    up: Way
    forward: Way


class Home(_Message):
    """The camera is to go where it was at the beginning."""

    type: Literal["home"]


Message = Seen | Drag | Dolly | Fly | Home

_ADAPTER: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


def parse(text: str) -> Message:
    """
    The message of a text.

    Raises
    ------
    ValueError
        It is none; says why in a line.
    """
    if len(text) > LONGEST:
        raise ValueError(f"a message has at most {LONGEST} characters, not {len(text)}")
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"not a message{f' ({where})' if where else ''}: {first['msg']}") from None
