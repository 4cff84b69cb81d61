"""Packings: where the elements are, and the bonds and faces between them (theory B1)."""

from .lattice import bcc, fcc, hexagonal, simple_cubic, square
from .network import network
from .packing import Mask, Packing
from .voronoi import voronoi

__all__ = [
    "Mask",
    "Packing",
    "bcc",
    "fcc",
    "hexagonal",
    "network",
    "simple_cubic",
    "square",
    "voronoi",
]
