"""Memory that this machine has left, and the elements that there is room for."""

from pathlib import Path

from .errors import MOST, InputError

LEAST = 500  # bytes that an element of the smallest packings, rods, takes while it is made


def host_memory() -> int | None:
    """Memory left [B], or None where the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return None
    import resource  # not everywhere, but where there is /proc

    told = {name: value.split() for name, _, value in (x.partition(":") for x in lines)}
    left = 1024 * int(told["MemAvailable"][0]) if "MemAvailable" in told else None
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most == resource.RLIM_INFINITY or left is None:
        return left
    return max(0, min(left, most - pages * resource.getpagesize()))


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
