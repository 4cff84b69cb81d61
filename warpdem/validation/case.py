"""What a validation case is, and the list of them."""

import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ..errors import InputError, ModelWarning


@dataclass(frozen=True)
class Measurement:
    """One quantity, as a case yields it: its error must not be above the limit."""

    quantity: str
    reference: float
    source: str
    measured: float
    error: float
    limit: float


@dataclass(frozen=True)
class Check(Measurement):
    """A measurement with the case it belongs to and the seconds the case took."""

    case: str
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether the error is within its limit; never, if it is not a number."""
        return self.error <= self.limit


@dataclass(frozen=True)
class Case:
    """A named case of a group."""

    name: str
    group: str
    slow: bool
    measure: Callable[[], Iterable[Measurement]]

    def run(self) -> list[Check]:
        """Measure it."""
        began = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # cases know what they build
            found = list(self.measure())
        seconds = time.perf_counter() - began
        return [Check(**vars(m), case=self.name, seconds=seconds) for m in found]


CASES: dict[str, Case] = {}


def case(group: str, slow: bool = False) -> Callable[[Callable], Callable]:
    """Register a function that yields measurements, under its own name."""

    def register(measure: Callable[[], Iterable[Measurement]]) -> Callable:
        name = measure.__name__.replace("_", "-")
        if name in CASES:
            raise ValueError(f"there are two validation cases {name}; one would hide the other.")
        CASES[name] = Case(name, group, slow, measure)
        return measure

    return register


def cases(name: str | None = None) -> list[Case]:
    """All cases, those of a group, or one by its own name."""
    found = [c for c in CASES.values() if name in (None, c.group, c.name)]
    if not found:
        groups = ", ".join(sorted({c.group for c in CASES.values()}))
        raise InputError(
            f"there is no group or case {name!r}; groups are {groups}, cases are named in "
            "docs/validation.md."
        )
    return found


def as_markdown(checks: list[Check]) -> str:
    """The table of docs/validation.md."""
    lines = [
        "# Validation",
        "",
        "Written by `warpdem validate --write docs/validation.md`; the tests run the same cases.",
        "",
    ]
    for name in dict.fromkeys(c.case for c in checks):
        own = [c for c in checks if c.case == name]
        about = (CASES[name].measure.__doc__ or "").strip()
        lines += [f"## {name}", "", about, ""]
        lines += [
            "| quantity | reference | measured | error | limit | |",
            "|---|---|---|---|---|---|",
        ]
        for c in own:
            reference = f"{c.reference:.6g} ({c.source})"
            mark = "" if c.passed else "**missed**"
            lines.append(
                f"| {c.quantity} | {reference} | {c.measured:.6g} | {c.error:.2g} | {c.limit:.2g} "
                f"| {mark} |"
            )
        lines.append("")
    return "\n".join(lines)
