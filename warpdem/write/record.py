"""What a run should remember of where it ran."""

import platform
from importlib.metadata import PackageNotFoundError, version

import warp as wp

PACKAGES = ("warpdem", "warp-lang", "numpy", "scipy", "usd-core", "matplotlib")


def describe_machine() -> dict[str, object]:
    """Versions, processor and devices."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions,
        "devices": [f"{d.alias}: {d.name}" for d in wp.get_devices()],
    }
