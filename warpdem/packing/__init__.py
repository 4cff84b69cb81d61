"""Packings: where the elements are, and the bonds and faces between them (theory B1)."""

from .lattice import bcc, fcc, hexagonal, simple_cubic, square
from .network import filament, frame, helix, honeycomb, load, network, ring
from .packing import Mask, Packing
from .voronoi import voronoi

__all__ = [
    "Mask",
    "Packing",
    "bcc",
    "fcc",
    "filament",
    "frame",
    "helix",
    "hexagonal",
    "honeycomb",
    "load",
    "network",
    "ring",
    "simple_cubic",
    "square",
    "voronoi",
]
