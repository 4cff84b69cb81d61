"""warpdem: fracture of solids made of bonded elements, on NVIDIA Warp."""

from importlib import import_module
from typing import TYPE_CHECKING

from . import experiments, packing, wall
from .bond import EVMBond
from .calibration import StrengthCalibration, calibrate_strength
from .checkpoint import Checkpoint
from .contact import Contact, touching_radius
from .criteria import (
    BeamLimit,
    CustomCriterion,
    DamageRate,
    DruckerPrager,
    HuberMisesHencky,
    Incubation,
    LinearSoftening,
    MixedMode,
    MohrCoulomb,
    PlasticStrainLimit,
    Rankine,
)
from .errors import (
    DamagedFileError,
    InputError,
    ModelWarning,
    NonFiniteError,
    NotConvergedError,
    TooFastError,
    TroubledBondError,
    UnstableError,
    UnwritableError,
)
from .friction import RateAndState
from .material import Material
from .moduli import Calibration, Moduli, calibrate, lattice_bond, lattice_moduli, periodic_moduli
from .observe import (
    CrackTracker,
    FracturePlane,
    FragmentTracker,
    PlaneProbe,
    Probe,
    Series,
    Snapshot,
    StressStrain,
    When,
    fracture_plane,
    fragments,
)
from .packing import Packing
from .plasticity import JohnsonCook, Nikolaevsky, Perzyna, PowerLaw, Table, Voce, VonMises
from .relinking import Healing, Welding
from .scene import Body, Scene, Servo
from .section import Circle, Rectangle, Tube
from .simulation import Observer, Simulation, resume
from .toughness import Toughness
from .viscoelasticity import KelvinVoigt, Maxwell, Prony, StandardLinearSolid
from .wall import Wall

if TYPE_CHECKING:
    from .sweeps import sweep
    from .write.field import draw_field
    from .write.fragment import write_fragments
    from .write.gsd import GsdWriter
    from .write.log import BreakLog
    from .write.structure import draw_structure
    from .write.usd import UsdWriter
    from .write.vtk import VtkWriter

__version__ = "0.1.0"

__all__ = [
    "BeamLimit",
    "Body",
    "BreakLog",
    "Calibration",
    "Checkpoint",
    "Circle",
    "Contact",
    "CrackTracker",
    "CustomCriterion",
    "DamageRate",
    "DamagedFileError",
    "DruckerPrager",
    "EVMBond",
    "FracturePlane",
    "FragmentTracker",
    "GsdWriter",
    "Healing",
    "HuberMisesHencky",
    "Incubation",
    "InputError",
    "JohnsonCook",
    "KelvinVoigt",
    "LinearSoftening",
    "Material",
    "Maxwell",
    "MixedMode",
    "ModelWarning",
    "Moduli",
    "MohrCoulomb",
    "Nikolaevsky",
    "NonFiniteError",
    "NotConvergedError",
    "Observer",
    "Packing",
    "Perzyna",
    "PlaneProbe",
    "PlasticStrainLimit",
    "PowerLaw",
    "Probe",
    "Prony",
    "Rankine",
    "RateAndState",
    "Rectangle",
    "Scene",
    "Series",
    "Servo",
    "Simulation",
    "Snapshot",
    "StandardLinearSolid",
    "StrengthCalibration",
    "StressStrain",
    "Table",
    "TooFastError",
    "Toughness",
    "TroubledBondError",
    "Tube",
    "UnstableError",
    "UnwritableError",
    "UsdWriter",
    "Voce",
    "VonMises",
    "VtkWriter",
    "Wall",
    "Welding",
    "When",
    "calibrate",
    "calibrate_strength",
    "draw_field",
    "draw_structure",
    "experiments",
    "fracture_plane",
    "fragments",
    "lattice_bond",
    "lattice_moduli",
    "packing",
    "periodic_moduli",
    "resume",
    "sweep",
    "touching_radius",
    "wall",
    "write_fragments",
]


# these load USD, matplotlib and the like, which takes a second, only where they are asked for
LATE = {
    "BreakLog": ".write.log",
    "GsdWriter": ".write.gsd",
    "UsdWriter": ".write.usd",
    "VtkWriter": ".write.vtk",
    "draw_field": ".write.field",
    "draw_structure": ".write.structure",
    "sweep": ".cli",  # where experiments are made known
    "write_fragments": ".write.fragment",
}


def __getattr__(name: str) -> object:
    if name not in LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(LATE[name], __name__), name)
