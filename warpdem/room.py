"""Memory that this machine has left, and the elements that there is room for."""

from pathlib import Path

from .errors import MOST, InputError

LEAST = 400  # bytes that an element of the smallest packings, rods, takes while it is made


def host_memory() -> int | None:
    """Memory left [B], or None where the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    told = {name: value.split() for name, _, value in (x.partition(":") for x in lines)}
    return 1024 * int(told["MemAvailable"][0]) if "MemAvailable" in told else None


def check_elements(count: float) -> int:
    """The nearest whole number of elements; raises InputError if there is no room for them."""
    free = host_memory()
    most = MOST if free is None else min(MOST, free // LEAST)
    if not count <= most:
        raise InputError(
            f"the number of elements would be {count:.3g}; at most {most:.1e} fit into the memory "
            "that is left: enlarge the spacing, or take a smaller body."
        )
    return round(count)
