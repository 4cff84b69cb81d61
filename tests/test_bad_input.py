"""Whatever is handed to the public API is refused in a sentence or gives finite numbers.

Valid calls, of which an argument or two are spoilt: by numbers that are none, too large, of the
wrong sign, by texts, by arrays of other shapes, by ids that do not exist.
"""

import warnings
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import warpdem as wd
from warpdem import room
from warpdem.validation import core

CLEAR = (wd.InputError, wd.NonFiniteError, wd.NotConvergedError, wd.TooFastError)
CLEAR += (wd.TroubledBondError,)
nan, inf = float("nan"), float("inf")
NUMBERS = [nan, inf, -inf, 0.0, -0.0, -1.0, -1e-300, 1e-300, 1e300, -1e300, 1e20, 0.5, 3, -7, 2**70]
ODD = [
    None,
    True,
    "text",
    "",
    b"bytes",
    [],
    {},
    (),
    object(),
    1j,
    [1.0, "two"],
    [[1.0], [1.0, 2.0]],
]
ODD += [np.zeros((0, 2)), np.zeros((3, 3, 3)), np.array(["a", "b"]), np.array([None, 1])]
ODD += [np.full((5, 2), nan), np.array([2**62, -(2**62)]), [10**9], [-1], [0.5], [nan, nan]]
ODD += [[1e300, 1e300], [1e300, 1e300, 1e300], [0.0, 0.0], [0.0, 0.0, 0.0], lambda *_: nan, len]
junk = st.sampled_from(NUMBERS) | st.sampled_from(ODD) | st.floats() | st.integers()
junk |= st.lists(st.floats(), max_size=4) | st.text(max_size=4)


@pytest.fixture(scope="module", autouse=True)
def _little_room():
    """A machine for a few hundred thousand elements: what it takes is made in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, "host_memory", lambda: 10**8)
        yield


STEEL = wd.Material(1.0, 0.3, 1.0)


@cache
def plate():
    return core.small_packing("hexagonal strain")


@cache
def solid():
    return core.small_packing("voronoi space")


def spoilt(valid, data):
    """The arguments of a call with one or two of them spoilt."""
    out = dict(valid)
    for name in data.draw(st.lists(st.sampled_from(sorted(valid)), min_size=1, max_size=2)):
        value = valid[name]
        if isinstance(value, np.ndarray) and value.size and data.draw(st.booleans()):
            value = value.copy()  # an entry alone
            at = data.draw(st.integers(0, value.size - 1))
            wrong = NUMBERS if value.dtype.kind == "f" else [-1, 2**31, 2**62, -(2**62), 10**6]
            value.reshape(-1)[at] = data.draw(st.sampled_from(wrong))
            out[name] = value
        else:
            out[name] = data.draw(junk)
    return out


# -- calls that give a value -------------------------------------------------------------------

BOX = {"size": (4.0, 3.0), "spacing": 1.0}
CUBE = {"size": (3.0, 3.0, 3.0), "spacing": 1.0}
PLANE = {"plane": "strain", "thickness": 1.0}
SQUARE = wd.packing.Box((4.0, 4.0))
VALUES = {
    wd.Material: {"young": 1.0, "poisson": 0.3, "density": 1.0},
    wd.EVMBond: {"longitudinal": 1.0, "shear": 1.0, "bending": 1.0, "torsion": 1.0, "offset": 0.0,
                 "damping": 0.0, "large_rotation": False, "plane_only": False},
    wd.BeamLimit: {"tension": 1.0, "shear": 1.0, "section": wd.Circle(1.0)},
    wd.Circle: {"radius": 1.0},
    wd.Rectangle: {"width": 1.0, "height": 2.0},
    wd.Tube: {"outer": 2.0, "inner": 1.0},
    wd.DruckerPrager: {"compression": 1.0, "ratio": 2.0},
    wd.HuberMisesHencky: {"strength": 1.0},
    wd.Rankine: {"tension": 1.0},
    wd.MixedMode: {"tension": 1.0, "shear": 1.0},
    wd.MohrCoulomb: {"cohesion": 1.0, "friction_angle": 0.5, "cutoff": 0.1},
    wd.PlasticStrainLimit: {"strain": 0.1},
    wd.Incubation: {"criterion": wd.Rankine(1.0), "time": 1.0},
    wd.DamageRate: {"criterion": wd.Rankine(1.0), "time": 1.0, "exponent": 2.0},
    wd.LinearSoftening: {"criterion": wd.Rankine(1.0), "fracture_energy": 1.0},
    wd.CustomCriterion: {"function": None, "strength": 1.0, "numbers": (1.0,)},
    wd.Toughness: {"criterion": wd.Rankine(1.0), "stress_intensity": 1.0, "mode": "I"},
    wd.VonMises: {"yield_stress": 1.0, "hardening": 0.1, "rate": None},
    wd.Nikolaevsky: {"yield_stress": 1.0, "friction": 0.3, "dilatancy": 0.1, "hardening": 0.1,
                     "rate": None},
    wd.Perzyna: {"time": 1.0, "exponent": 1.0},
    wd.JohnsonCook: {"coefficient": 0.1, "reference_rate": 1.0},
    wd.PowerLaw: {"modulus": 1.0, "exponent": 0.5, "offset": 0.1},
    wd.Voce: {"saturation": 1.0, "rate": 1.0, "modulus": 0.1},
    wd.Table: {"plastic_strain": np.array([0.0, 1.0]), "growth": np.array([0.0, 1.0])},
    wd.Maxwell: {"time": 1.0},
    wd.KelvinVoigt: {"time": 1.0},
    wd.StandardLinearSolid: {"share": 0.5, "time": 1.0},
    wd.Prony: {"shares": np.array([0.2, 0.3]), "times": np.array([1.0, 2.0])},
    wd.RateAndState: {"mu0": 0.6, "a": 0.01, "b": 0.02, "V0": 1e-6, "Dc": 1e-5, "law": "aging",
                      "theta0": 1.0},
    wd.Healing: {"pressure": 1.0, "time": 1.0, "work": 1.0, "strength": 1.0},
    wd.wall.Plane: {"point": np.zeros(2), "normal": np.array([0.0, 1.0])},
    wd.wall.Sphere: {"centre": np.zeros(3), "radius": 1.0, "hollow": False},
    wd.wall.Box: {"centre": np.zeros(2), "size": np.ones(2), "rounding": 0.1},
    wd.wall.Cylinder: {"centre": np.zeros(3), "axis": np.array([0.0, 0.0, 1.0]), "radius": 1.0,
                       "length": 2.0, "hollow": False},
    wd.wall.Mesh: {"vertices": np.eye(4, 3), "faces": np.array([[0, 1, 2], [0, 2, 3]])},
    wd.packing.square: BOX | PLANE | {"neighbours": 1},
    wd.packing.hexagonal: BOX | PLANE | {"neighbours": 1},
    wd.packing.honeycomb: BOX | {"thickness": 1.0},
    wd.packing.simple_cubic: CUBE | {"neighbours": 1},
    wd.packing.bcc: CUBE | {"neighbours": 1},
    wd.packing.fcc: CUBE | {"neighbours": 1},
    wd.packing.voronoi: BOX | PLANE | {"seed": 0, "relaxations": 1, "periodic": False},
    wd.packing.laguerre: {"shape": SQUARE, "radius": np.array([1.0, 1.1, 0.9, 1.0]),
                          "position": np.array([[1.0, 1.0], [3.0, 1.2], [1.2, 3.0], [3.0, 3.0]]),
                          "periodic": False} | PLANE,
    wd.packing.polydisperse: {"shape": SQUARE, "radius": np.full(9, 0.6), "seed": 0,
                              "relaxations": 2} | PLANE,
    wd.packing.filament: {"curve": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 1.0, 0.0]]),
                          "bonds": 4, "section": wd.Circle(0.1), "closed": False, "plane": None},
    wd.packing.frame: {"nodes": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
                       "edges": np.array([[0, 1], [1, 2]]), "section": wd.Circle(0.1),
                       "bonds_per_edge": 2, "plane": "strain"},
    wd.packing.helix: {"radius": 1.0, "pitch": 0.5, "turns": 2.0, "bonds_per_turn": 8,
                       "section": wd.Circle(0.1)},
    wd.packing.ring: {"radius": 1.0, "bonds": 8, "section": wd.Circle(0.1), "plane": None},
    wd.packing.network: {"position": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
                         "bonds": np.array([[0, 1], [1, 2]]), "volume": np.ones(3),
                         "radius": np.full(3, 0.4), "plane": "strain", "thickness": 1.0},
    wd.packing.Disc: {"radius": 1.0, "centre": np.zeros(2)},
    wd.packing.Ring: {"inner": 1.0, "outer": 2.0, "centre": np.zeros(2)},
    wd.packing.Plate: {"size": (2.0, 2.0), "corner": np.zeros(2)},
    wd.packing.Polygon: {"corners": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])},
    wd.packing.Sphere: {"radius": 1.0, "centre": np.zeros(3)},
    wd.packing.Cylinder: {"radius": 1.0, "height": 1.0, "centre": np.zeros(3)},
    wd.CrackTracker: {"every": 20, "window": 1.0, "stop_at": 1.0,
                      "direction": np.array([1.0, 0.0])},
    wd.PlaneProbe: {"point": np.zeros(2), "normal": np.array([0.0, 1.0]), "every": 10},
    wd.FragmentTracker: {"every": 100},
}  # fmt: skip


def told_clearly(call):
    """The call's value, or None where it is refused in a sentence."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call()
        except CLEAR as error:
            text = str(error)
            assert len(text) > 15 and text.rstrip().endswith("."), text
            return None


# -- calls that make a simulation --------------------------------------------------------------


def every(body, packing):
    """The methods of a scene, with valid arguments."""
    n, dim = len(packing), packing.dim
    some = np.arange(3)
    along = np.eye(dim)[1]
    low, high = packing.position.min(axis=0), packing.position.max(axis=0)
    return {
        "contact": {"friction": 0.3, "restitution": 0.9, "skin": 0.5, "law": "linear"},
        "hold": {"body": body, "where": some, "velocity": 0.01 * along, "axes": None,
                 "rotation": True, "history": None},
        "load": {"body": body, "where": some, "force": 1e-3 * along, "history": None},
        "press": {"body": body, "where": packing.side("top"), "pressure": 1e-3, "axes": None},
        "pull": {"body": body, "where": packing.side("top"), "traction": 1e-3 * along},
        "cut": {"body": body, "start": low + 0.1, "end": high - 0.1, "depth": None},
        "absorb": {"body": body, "where": packing.side("bottom")},
        "set_gravity": {"acceleration": -along},
        "set_velocity": {"body": body, "velocity": 1e-3 * along, "where": some},
        "set_strength": {"body": body, "factor": 0.9},
        "scale_stiffness": {"body": body, "factor": np.full(n, 1.1)},
        "scatter_strength": {"body": body, "modulus": 5.0, "seed": 1, "by": "bond"},
        "strain": {"body": body, "strain": 1e-4 * np.eye(dim), "origin": np.zeros(dim)},
        "wall": {"shape": low - 2.0, "normal": along, "friction": 0.2, "velocity": 1e-3 * along},
    }  # fmt: skip


def simulated(packing, method, arguments):
    """A small scene with a call to it, three steps, and the finite numbers that it must have."""
    scene = wd.Scene()
    fracture = wd.Rankine(0.05)
    body = scene.add(packing, STEEL, fracture=fracture)
    if method == "wall":
        scene.contact(friction=0.1)
    arguments = {k: body if v is BODY else v for k, v in arguments.items()}
    getattr(scene, method)(**arguments)
    ran(wd.Simulation(scene))


BODY = object()


def ran(sim):
    sim.run(steps=3)
    for value in (sim.position, sim.velocity, sim.stress, *sim.energy().values()):
        assert np.isfinite(value).all()


ADDED = {"bond": "facet", "fracture": None, "pairs": None, "volume": None, "grain": None,
         "facet_bending": False, "finite_strain": False, "material": STEEL}  # fmt: skip
MADE = {"precision": "float64", "device": "cpu", "dt": None, "force_dt": False,
        "local_damping": 0.0, "trouble": "warn", "simd": True, "threads": 1}  # fmt: skip


def added(packing, arguments):
    scene = wd.Scene()
    scene.add(packing, **arguments)
    ran(wd.Simulation(scene))


def made(packing, arguments):
    scene = wd.Scene()
    scene.set_velocity(scene.add(packing, STEEL), 1e-3 * np.eye(packing.dim)[0])
    ran(wd.Simulation(scene, **arguments))


def set_anew(packing, arguments):
    scene = wd.Scene()
    scene.add(packing, STEEL)
    sim = wd.Simulation(scene)
    sim.set_state(**arguments)
    ran(sim)


def driven(packing, name, arguments):
    scene = wd.Scene()
    scene.hold(scene.add(packing, STEEL), packing.side("bottom"))
    sim = wd.Simulation(scene)
    getattr(sim, name)(**arguments)
    ran(sim)


def packed(arguments):
    p = wd.Packing(**arguments)
    scene = wd.Scene()
    scene.add(p, STEEL)
    ran(wd.Simulation(scene))


FIELDS = ("position", "volume", "bonds", "area", "arms", "radius", "ids", "plane", "thickness",
          "spacing")  # fmt: skip
DRIVEN = {
    "run": {"steps": 2},
    "relax": {"tolerance": 1e-3, "max_steps": 50},
    "equilibrate": {"tolerance": 1e-6, "max_iterations": 5, "load_steps": 1},
    "natural_frequencies": {"count": 3},
}


def check(data):
    """One spoilt call."""
    kind = data.draw(st.sampled_from(["value"] * 4 + ["scene"] * 3 + ["rest"] * 3))
    if kind == "value":
        function = data.draw(st.sampled_from(list(VALUES)))
        arguments = spoilt(VALUES[function], data)
        told_clearly(lambda: function(**arguments))
        return
    packing = data.draw(st.sampled_from([plate, solid]))()
    if kind == "scene":
        methods = every(BODY, packing)
        method = data.draw(st.sampled_from(sorted(methods)))
        arguments = spoilt(methods[method], data)
        told_clearly(lambda: simulated(packing, method, arguments))
        return
    call = data.draw(st.sampled_from(["add", "make", "state", "drive", "packing"]))
    if call == "add":
        arguments = spoilt(ADDED, data)
        told_clearly(lambda: added(packing, arguments))
    elif call == "make":
        arguments = spoilt(MADE, data)
        told_clearly(lambda: made(packing, arguments))
    elif call == "state":
        valid = {"displacement": np.zeros_like(packing.position),
                 "velocity": np.zeros_like(packing.position)}  # fmt: skip
        arguments = spoilt(valid, data)
        told_clearly(lambda: set_anew(packing, arguments))
    elif call == "drive":
        name = data.draw(st.sampled_from(sorted(DRIVEN)))
        arguments = spoilt(DRIVEN[name], data)
        if any(isinstance(v, int) and v > 1000 for v in arguments.values()):
            return  # long, and that is what was asked for
        told_clearly(lambda: driven(packing, name, arguments))
    else:
        arguments = spoilt({f: getattr(packing, f) for f in FIELDS}, data)
        told_clearly(lambda: packed(arguments))


@pytest.mark.parametrize("function", VALUES, ids=lambda f: f.__name__)
def test_what_is_spoilt_was_sound(function):
    if function is not wd.CustomCriterion:  # of which only the refusals are looked at
        function(**VALUES[function])


@pytest.mark.filterwarnings("ignore::warpdem.ModelWarning")
@pytest.mark.parametrize("make", [plate, pytest.param(solid, marks=pytest.mark.slow)])
def test_the_scenes_that_are_spoilt_were_sound(make):
    packing = make()
    for method, arguments in every(BODY, packing).items():
        simulated(packing, method, arguments)
    added(packing, ADDED)
    made(packing, MADE)
    packed({f: getattr(packing, f) for f in FIELDS})
    for name, arguments in DRIVEN.items():
        driven(packing, name, arguments)


QUICK = {"deadline": None, "derandomize": True, "database": None,
         "suppress_health_check": list(HealthCheck)}  # fmt: skip


@settings(max_examples=100, **QUICK)
@given(st.data())
def test_bad_input_is_refused_or_harmless(data):
    check(data)


@pytest.mark.slow
@settings(max_examples=10_000, **QUICK)
@given(st.data())
def test_ten_thousand_bad_inputs(data):
    check(data)
