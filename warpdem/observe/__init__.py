"""Observers that measure: they read a simulation and never touch it."""

from .crack import CrackTracker
from .fracture_plane import FracturePlane, fracture_plane
from .probe import PlaneProbe, Probe
from .snapshot import Snapshot
from .stress_strain import StressStrain
from .when import When

__all__ = [
    "CrackTracker",
    "FracturePlane",
    "PlaneProbe",
    "Probe",
    "Snapshot",
    "StressStrain",
    "When",
    "fracture_plane",
]
