"""Observers that measure: they read a simulation and never touch it."""

from .crack import CrackTracker
from .fracture_plane import FracturePlane, fracture_plane
from .fragment import FragmentTracker, fragments, piece_of
from .probe import PlaneProbe, Probe
from .series import Series
from .snapshot import Snapshot
from .stress_strain import StressStrain
from .when import When

__all__ = [
    "CrackTracker",
    "FracturePlane",
    "FragmentTracker",
    "PlaneProbe",
    "Probe",
    "Series",
    "Snapshot",
    "StressStrain",
    "When",
    "fracture_plane",
    "fragments",
    "piece_of",
]
