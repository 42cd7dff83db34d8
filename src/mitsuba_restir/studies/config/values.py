"""What the value of a key may be: each kind with the words that say so when it is not."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any

from annotated_types import Ge, Gt, Lt, MinLen
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BeforeValidator,
    ConfigDict,
    Strict,
    StrictBool,
    StrictFloat,
    StrictInt,
    StrictStr,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import PydanticCustomError

REFERENCE = "reference"
"""What the truth is called beside the variants."""

CLOSED = ConfigDict(extra="forbid")
"""Of tables in which unknown keys are refused."""

KIND = "kind"
"""Type of the error of a value that is not of its kind."""


def must_be(allowed: str) -> WrapValidator:
    """Say in one line what is allowed, in place of what pydantic says of every part of a value."""

    def check(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        try:
            return validate(value)
        except ValidationError as error:
            raise _refusal(value, allowed) from error

    return WrapValidator(check)


def only(test: Callable[[Any], object], allowed: str) -> AfterValidator:
    """Refuse what is of the right kind and does not pass a test."""

    def check(value: Any) -> Any:
        if test(value):
            return value
        raise _refusal(value, allowed)

    return AfterValidator(check)


def _refusal(value: object, allowed: str) -> PydanticCustomError:
    said = {"allowed": allowed, "value": repr(value)}
    return PydanticCustomError(KIND, "must be {allowed}, not {value}", said)


Text = Annotated[StrictStr, must_be("a string")]
Name = Annotated[StrictStr, MinLen(1), must_be("a string")]
Texts = Annotated[tuple[StrictStr, ...], MinLen(1), must_be("a list of strings")]
Flag = Annotated[StrictBool, must_be("true or false")]
Natural = Annotated[StrictInt, Ge(0), must_be("an integer of at least 0")]
Count = Annotated[StrictInt, Ge(1), must_be("an integer of at least 1")]
Batches = Annotated[StrictInt, Ge(2), must_be("an integer of at least 2")]
Depth = Annotated[StrictInt, Ge(-1), must_be("an integer of at least -1")]
Number = Annotated[float, Strict(), AllowInfNan(False)]
Amount = Annotated[Number, Ge(0.0), must_be("a number >= 0")]
Positive = Annotated[Number, Gt(0.0), must_be("a positive number")]
Share = Annotated[Number, Ge(0.0), Lt(1.0), must_be("a number >= 0 and < 1")]
Angle = Annotated[Number, Gt(0.0), Lt(180.0), must_be("a positive number and < 180")]
Vector = Annotated[tuple[Number, Number, Number], must_be("three finite numbers")]
Value = Annotated[
    StrictBool | StrictInt | StrictFloat | StrictStr, must_be("a number, a string, true or false")
]


def _inside(crop: tuple[float, float, float, float]) -> bool:
    left, top, width, height = crop
    return min(left, top) >= 0.0 < min(width, height) and max(left + width, top + height) <= 1.0


Crop = Annotated[
    tuple[Number, Number, Number, Number],
    must_be("4 finite numbers"),
    only(_inside, "left, top, width and height inside 0 ... 1"),
]

Size = tuple[int, int]


def _size(given: object) -> Size:
    """Turn "320x180" into width and height; a pair may be both already."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", given) if isinstance(given, str) else None
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    if isinstance(given, tuple) and len(given) == 2:
        width, height = given
    if min(width, height) < 1:
        raise ValueError(f"sizes must be like '320x180', not {given!r}")
    return width, height


def _sizes(given: object) -> tuple[Size, ...]:
    if not isinstance(given, list | tuple) or not given:
        raise ValueError(f"sizes must be a list of strings, not {given!r}")
    sizes = tuple(_size(one) for one in given)
    for index, (width, height) in enumerate(sizes):
        if (width, height) in sizes[:index]:
            raise ValueError(f"sizes has {width}x{height} twice")
    return sizes


Sizes = Annotated[tuple[Size, ...], BeforeValidator(_sizes)]


FolderName = Annotated[
    Name,
    only(re.compile(r"[^/\\]+").fullmatch, "without / and \\"),
    only(str.isprintable, "printable"),
]
MitsubaVariant = Annotated[
    Text,
    only(
        re.compile(r"(?!scalar)\w+_rgb").fullmatch,
        "one of colour that is compiled, as in llvm_ad_rgb or cuda_ad_rgb",
    ),
]


def _variant_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][\w+.-]*", name):
        raise ValueError(f"'{name}' cannot name a variant: use a-z, 0-9, _+.-")
    if name == REFERENCE:
        raise ValueError(f"'{name}' is what the truth is called: name it else")
    return name


VariantName = Annotated[str, AfterValidator(_variant_name)]
