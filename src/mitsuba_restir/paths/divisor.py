"""Division of 32-bit integers by a number that kernels do not know when they are compiled."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class Divisor:
    """A divisor d, with which division is a multiplication (Granlund and Montgomery 1994).

    With L = ceil(log2 d) and f = ceil(2^(31 + L) / d), floor(n f / 2^(31 + L)) = floor(n / d) for
    all n < 2^31. No processor divides packets of integers.

    Fields: ``number`` (d), ``factor`` (f), ``shift`` (L); opaque.
    """

    number: mi.UInt32
    factor: mi.UInt32
    shift: mi.UInt32

    def divmod(self, n: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Quotient and remainder of ``n`` < 2^31."""
        quotient = dr.mul_hi(n << 1, self.factor) >> self.shift
        return quotient, n - quotient * self.number


def divisor(number: int) -> Divisor:
    """Divide by ``number``, from 1 to 2^31."""
    shift = (number - 1).bit_length()
    factor = -(-(1 << (31 + shift)) // number)
    return Divisor(*(dr.opaque(mi.UInt32, value) for value in (number, factor, shift)))
