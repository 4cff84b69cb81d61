"""warpdem: fracture of solids made of bonded elements, on NVIDIA Warp."""

from typing import TYPE_CHECKING

from . import experiments, packing, wall
from .bond import EVMBond
from .calibration import StrengthCalibration, calibrate_strength
from .contact import Contact
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
    InputError,
    ModelWarning,
    NonFiniteError,
    NotConvergedError,
    TooFastError,
    TroubledBondError,
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
from .simulation import Observer, Simulation
from .toughness import Toughness
from .viscoelasticity import KelvinVoigt, Maxwell, Prony, StandardLinearSolid
from .wall import Wall

if TYPE_CHECKING:
    from .sweeps import sweep
    from .write.field import draw_field
    from .write.fragment import write_fragments
    from .write.structure import draw_structure
    from .write.usd import UsdWriter

__version__ = "0.1.0"

__all__ = [
    "BeamLimit",
    "Body",
    "Calibration",
    "Circle",
    "Contact",
    "CrackTracker",
    "CustomCriterion",
    "DamageRate",
    "DruckerPrager",
    "EVMBond",
    "FracturePlane",
    "FragmentTracker",
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
    "UsdWriter",
    "Voce",
    "VonMises",
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
    "sweep",
    "wall",
    "write_fragments",
]


def __getattr__(name: str) -> object:
    # these load USD and matplotlib, which takes a second, only where they are asked for
    if name == "UsdWriter":
        from .write.usd import UsdWriter

        return UsdWriter
    if name == "draw_field":
        from .write.field import draw_field

        return draw_field
    if name == "write_fragments":
        from .write.fragment import write_fragments

        return write_fragments
    if name == "draw_structure":
        from .write.structure import draw_structure

        return draw_structure
    if name == "sweep":
        from . import cli  # where experiments are made known

        return cli.sweep
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
