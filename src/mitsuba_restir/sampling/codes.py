"""Named small integers: an enumeration whose members Dr.Jit takes as literals."""

from __future__ import annotations


class Codes:
    """Base of enumerations of small integers (``enum.IntEnum`` members are refused by Dr.Jit)."""

    @classmethod
    def names(cls) -> list[str]:
        """Names of the members in lower case, in the order of their numbers, which start at 0."""
        return [name.lower() for name, code in vars(cls).items() if isinstance(code, int)]
