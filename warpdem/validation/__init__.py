"""Cases that measure the code against theory, for the tests and for `warpdem validate`."""

from .case import CASES, Case, Check, Measurement, cases
from . import core  # noqa: F401, I001  registers its cases

__all__ = ["CASES", "Case", "Check", "Measurement", "cases"]
