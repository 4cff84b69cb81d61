"""Cases that measure the code against theory, for the tests and for `warpdem validate`."""

from . import core  # noqa: F401  registers its cases
from .case import CASES, Case, Check, Measurement, as_markdown, cases

__all__ = ["CASES", "Case", "Check", "Measurement", "as_markdown", "cases"]
