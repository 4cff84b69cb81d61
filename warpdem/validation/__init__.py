"""Cases that measure the code against theory, for the tests and for `warpdem validate`."""

from . import beam, core, evm, foundation, incremental, mca, rock, waves  # noqa: F401  they register
from .case import CASES, Case, Check, Measurement, as_markdown, cases

__all__ = ["CASES", "Case", "Check", "Measurement", "as_markdown", "cases"]
