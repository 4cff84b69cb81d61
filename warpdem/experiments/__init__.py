"""Published experiments as functions, each also a command `warpdem run NAME`."""

from .branching import Branching, BranchingResult, branching
from .brazilian import Brazilian, brazilian
from .envelope import Envelope, strength_envelope
from .heterogeneous import Heterogeneous, HeterogeneousResult, heterogeneous
from .kalthoff import Kalthoff, KalthoffResult, kalthoff
from .material_point import material_strength
from .mode_i import ModeI, ModeIResult, mode_i
from .mode_ii import ModeII, ModeIIResult, mode_ii
from .rock import Rock, RockResult
from .shared import Result
from .specimen import Compression, Confined, Specimen, Tension, compression, confined, tension

__all__ = [
    "Branching",
    "BranchingResult",
    "Brazilian",
    "Compression",
    "Confined",
    "Envelope",
    "Heterogeneous",
    "HeterogeneousResult",
    "Kalthoff",
    "KalthoffResult",
    "ModeI",
    "ModeII",
    "ModeIIResult",
    "ModeIResult",
    "Result",
    "Rock",
    "RockResult",
    "Specimen",
    "Tension",
    "branching",
    "brazilian",
    "compression",
    "confined",
    "heterogeneous",
    "kalthoff",
    "material_strength",
    "mode_i",
    "mode_ii",
    "strength_envelope",
    "tension",
]
