"""Observers that measure: they read a simulation and never touch it."""

from .crack import CrackTracker
from .fragment import FragmentTracker, fragments, piece_of
from .probe import PlaneProbe, Probe
from .snapshot import Snapshot

__all__ = [
    "CrackTracker",
    "FragmentTracker",
    "PlaneProbe",
    "Probe",
    "Snapshot",
    "fragments",
    "piece_of",
]
