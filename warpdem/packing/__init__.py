"""Packings: where the elements are, and the bonds and faces between them (theory B1)."""

from .lattice import bcc, fcc, hexagonal, simple_cubic, square
from .network import filament, frame, helix, honeycomb, load, network, ring
from .packing import Mask, Packing
from .shapes import Box, Cylinder, Disc, Mesh, Plate, Polygon, Ring, Sphere
from .voronoi import laguerre, polydisperse, voronoi

__all__ = [
    "Box",
    "Cylinder",
    "Disc",
    "Mask",
    "Mesh",
    "Packing",
    "Plate",
    "Polygon",
    "Ring",
    "Sphere",
    "bcc",
    "fcc",
    "filament",
    "frame",
    "helix",
    "hexagonal",
    "honeycomb",
    "laguerre",
    "load",
    "network",
    "polydisperse",
    "ring",
    "simple_cubic",
    "square",
    "voronoi",
]
