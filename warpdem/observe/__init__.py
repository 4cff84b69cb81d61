"""Observers that measure: they read a simulation and never touch it."""

from .crack import CrackTracker
from .snapshot import Snapshot

__all__ = ["CrackTracker", "Snapshot"]
