"""Cases that measure the code against theory, for the tests and for `warpdem validate`."""

from . import (  # noqa: F401  they register
    beam,
    contact,
    core,
    crack,
    evm,
    finite,
    foundation,
    fracture,
    friction,
    incremental,
    mca,
    plastic,
    relink,
    rock,
    rolling,
    search,
    visco,
    wall,
    waves,
    weld,
)
from .case import CASES, Case, Check, Measurement, as_markdown, cases

__all__ = ["CASES", "Case", "Check", "Measurement", "as_markdown", "cases"]
