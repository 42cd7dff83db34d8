"""What the value of a key may be: each kind with the words that say so when it is not."""

from __future__ import annotations

import re
from typing import Annotated, Any

from annotated_types import Ge, Gt, Lt, MinLen
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BeforeValidator,
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

KIND = "kind"
"""Type of the error of a value that is not of its kind."""


def must_be(allowed: str) -> WrapValidator:
    """Say in one line what is allowed, in place of what pydantic says of every part of a value."""

    def check(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        try:
            return validate(value)
        except ValidationError as error:
            said = {"allowed": allowed, "value": repr(value)}
            raise PydanticCustomError(KIND, "must be {allowed}, not {value}", said) from error

    return WrapValidator(check)


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


def _inside(crop: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    left, top, width, height = crop
    if min(left, top) < 0.0 or min(width, height) <= 0.0 or max(left + width, top + height) > 1.0:
        raise ValueError(
            f"crop must be left, top, width and height inside 0 ... 1, not {list(crop)}"
        )
    return crop


Crop = Annotated[
    tuple[Number, Number, Number, Number], must_be("4 finite numbers"), AfterValidator(_inside)
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


def _folder_name(name: str) -> str:
    if not name.isprintable() or set(name) & set("/\\"):
        raise ValueError(f"name must be printable and without / and \\, not {name!r}")
    return name


FolderName = Annotated[Name, AfterValidator(_folder_name)]


def _colour(variant: str) -> str:
    if not re.fullmatch(r"(?!scalar)\w+_rgb", variant):
        raise ValueError(
            "mitsuba_variant must be one of colour that is compiled, as in llvm_ad_rgb or "
            f"cuda_ad_rgb, not '{variant}'"
        )
    return variant


MitsubaVariant = Annotated[Text, AfterValidator(_colour)]


def _variant_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][\w+.-]*", name):
        raise ValueError(f"'{name}' cannot name a variant: use a-z, 0-9, _+.-")
    if name == REFERENCE:
        raise ValueError(f"'{name}' is what the truth is called: name it else")
    return name


VariantName = Annotated[str, AfterValidator(_variant_name)]
