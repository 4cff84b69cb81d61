"""Curves with words, as an experiment hands them to a picture."""

from dataclasses import dataclass, field

from numpy.typing import ArrayLike


@dataclass
class Line:
    """A curve: places, heights, what it is. style: as of matplotlib, "-", "--", "o"."""

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    style: str = "-"
    color: str = "C0"


@dataclass
class Chart:
    """Curves over one pair of axes, named with their units."""

    title: str
    xlabel: str
    ylabel: str
    lines: list[Line] = field(default_factory=list)
