"""warpdem: fracture of solids made of bonded elements, on NVIDIA Warp."""

from typing import TYPE_CHECKING

from . import experiments, packing
from .bond import EVMBond
from .calibration import StrengthCalibration, calibrate_strength
from .criteria import DruckerPrager, HuberMisesHencky, Rankine
from .errors import InputError, ModelWarning, NonFiniteError, NotConvergedError, TroubledBondError
from .material import Material
from .moduli import Calibration, Moduli, calibrate, lattice_bond, lattice_moduli, periodic_moduli
from .observe import (
    CrackTracker,
    FracturePlane,
    PlaneProbe,
    Probe,
    Snapshot,
    StressStrain,
    When,
    fracture_plane,
)
from .packing import Packing
from .plasticity import JohnsonCook, Nikolaevsky, Perzyna, PowerLaw, Table, Voce, VonMises
from .scene import Body, Scene, Servo
from .section import Circle, Rectangle, Tube
from .simulation import Observer, Simulation

if TYPE_CHECKING:
    from .write.field import draw_field
    from .write.structure import draw_structure
    from .write.usd import UsdWriter

__version__ = "0.1.0"

__all__ = [
    "Body",
    "Calibration",
    "Circle",
    "CrackTracker",
    "DruckerPrager",
    "EVMBond",
    "FracturePlane",
    "HuberMisesHencky",
    "InputError",
    "JohnsonCook",
    "Material",
    "ModelWarning",
    "Moduli",
    "Nikolaevsky",
    "NonFiniteError",
    "NotConvergedError",
    "Observer",
    "Packing",
    "Perzyna",
    "PlaneProbe",
    "PowerLaw",
    "Probe",
    "Rankine",
    "Rectangle",
    "Scene",
    "Servo",
    "Simulation",
    "Snapshot",
    "StrengthCalibration",
    "StressStrain",
    "Table",
    "TroubledBondError",
    "Tube",
    "UsdWriter",
    "Voce",
    "VonMises",
    "When",
    "calibrate",
    "calibrate_strength",
    "draw_field",
    "draw_structure",
    "experiments",
    "fracture_plane",
    "lattice_bond",
    "lattice_moduli",
    "packing",
    "periodic_moduli",
]


def __getattr__(name: str) -> object:
    # these load USD and matplotlib, which takes a second, only where they are asked for
    if name == "UsdWriter":
        from .write.usd import UsdWriter

        return UsdWriter
    if name == "draw_field":
        from .write.field import draw_field

        return draw_field
    if name == "draw_structure":
        from .write.structure import draw_structure

        return draw_structure
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
