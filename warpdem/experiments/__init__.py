"""Experiments beside what is known, as functions, each also a command `warpdem run NAME`."""

from .bimaterial import Bimaterial, BimaterialResult, bimaterial
from .branching import Branching, BranchingResult, branching
from .brazilian import Brazilian, brazilian
from .crushed_grain import CrushedGrain, CrushedGrainResult, crushed_grain
from .drop import Drop, DropResult, drop
from .envelope import Envelope, strength_envelope
from .heterogeneous import Heterogeneous, HeterogeneousResult, heterogeneous
from .impact import Impact, ImpactResult, impact
from .indentation import Indentation, IndentationResult, indentation
from .john_shah import JohnShah, JohnShahResult, john_shah
from .kalthoff import Kalthoff, KalthoffResult, kalthoff
from .material_point import material_strength
from .mode_i import ModeI, ModeIResult, mode_i
from .mode_ii import ModeII, ModeIIResult, mode_ii
from .rock import Rock, RockResult
from .shared import Result
from .sliding_block import SlidingBlock, SlidingBlockResult, sliding_block
from .specimen import Compression, Confined, Specimen, Tension, compression, confined, tension
from .spring_slider import SpringSlider, SpringSliderResult, spring_slider

__all__ = [
    "Bimaterial",
    "BimaterialResult",
    "Branching",
    "BranchingResult",
    "Brazilian",
    "Compression",
    "Confined",
    "CrushedGrain",
    "CrushedGrainResult",
    "Drop",
    "DropResult",
    "Envelope",
    "Heterogeneous",
    "HeterogeneousResult",
    "Impact",
    "ImpactResult",
    "Indentation",
    "IndentationResult",
    "JohnShah",
    "JohnShahResult",
    "Kalthoff",
    "KalthoffResult",
    "ModeI",
    "ModeII",
    "ModeIIResult",
    "ModeIResult",
    "Result",
    "Rock",
    "RockResult",
    "SlidingBlock",
    "SlidingBlockResult",
    "Specimen",
    "SpringSlider",
    "SpringSliderResult",
    "Tension",
    "bimaterial",
    "branching",
    "brazilian",
    "compression",
    "confined",
    "crushed_grain",
    "drop",
    "heterogeneous",
    "impact",
    "indentation",
    "john_shah",
    "kalthoff",
    "material_strength",
    "mode_i",
    "mode_ii",
    "sliding_block",
    "spring_slider",
    "strength_envelope",
    "tension",
]
