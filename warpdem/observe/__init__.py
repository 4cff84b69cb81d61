"""Observers that measure: they read a simulation and never touch it."""

from .crack import CrackTracker
from .probe import PlaneProbe, Probe
from .snapshot import Snapshot

__all__ = ["CrackTracker", "PlaneProbe", "Probe", "Snapshot"]
