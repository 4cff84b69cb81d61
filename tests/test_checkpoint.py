"""Runs that go on from a checkpoint: every bit, every fault, every signal."""

import json
import os
import resource
import signal
import zipfile
from hashlib import sha256

import numpy as np
import pytest

import warpdem as wd
from warpdem import archive, checkpoint, passes
from warpdem.validation import core
from warpdem.validation.contact import ball

SOFT = wd.Material(1.0, 0.3, 1.0)
STEPS = 60


def thrown(packing, speed=0.01, **options):
    """A body that flies apart, so that what may break does."""
    scene = wd.Scene()
    body = scene.add(packing, SOFT, **options)
    x = packing.position - packing.position.mean(axis=0)
    scene.set_velocity(body, speed * np.sign(x))
    if "fracture" in options and "softening" not in str(options["fracture"]).lower():
        scene.scatter_strength(body, 1.5)  # so that they break one after the other
    return scene, body


def facets():
    return thrown(core.small_packing("voronoi strain"), fracture=wd.Rankine(2e-3))[0]


def space():
    return thrown(core.small_packing("fcc"), fracture=wd.DruckerPrager(8e-3, 2.0))[0]


def evm():
    bond = wd.EVMBond(0.45, 0.45, 0.02, offset=0.1, damping=0.02)
    p = core.small_packing("hex strain")
    return thrown(p, 2e-4, bond=bond, volume=True, fracture=wd.Rankine(2e-4))[0]


def softening():
    law = wd.LinearSoftening(wd.Rankine(2e-3), 0.1)
    return thrown(core.small_packing("hex strain"), fracture=law)[0]


def incubating():
    law = wd.Incubation(wd.Rankine(2e-3), 2.0)
    return thrown(core.small_packing("hex strain"), fracture=law)[0]


def plastic(**options):
    law = wd.VonMises(0.01, wd.Voce(0.01, 2.0), rate=wd.Perzyna(1.0))
    p = core.small_packing("hex strain")
    scene = wd.Scene()
    body = scene.add(p, SOFT, yielding=law, **options)
    velocity = 3e-3 * p.position * [0.0, 1.0]
    scene.set_velocity(body, velocity)
    grips = p.bottom | p.top
    scene.hold(body, grips, velocity[grips])
    return scene


def breaking_plastic():
    return plastic(fracture=wd.Rankine(8e-3))


def finite():
    return plastic(finite_strain=True)


def prony():
    law = wd.Prony((0.5, 0.3), (5.0, 40.0))
    p = core.small_packing("hex strain")
    scene, body = thrown(p, viscous=law, fracture=wd.Rankine(2e-3))
    velocity, grips = 2e-4 * (p.position - p.position.mean(axis=0)), p.bottom | p.top
    scene.set_velocity(body, velocity)
    scene.hold(body, grips, velocity[grips])
    return scene


def kelvin():
    return thrown(core.small_packing("hex strain"), 1e-3, viscous=wd.KelvinVoigt(0.5))[0]


def contact():
    """Breaking bodies that meet, rub and rebound, on a wall."""
    p = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")
    scene = wd.Scene()
    for number in range(2):
        body = scene.add(p, SOFT, fracture=wd.Rankine(2e-3))
        body.displacement[:, 0] = number * 5.6
        scene.set_velocity(body, [-0.2 * number, -0.01])
    scene.contact(friction=0.3, restitution=0.8)
    scene.wall((0.0, -0.6), (0.0, 1.0), friction=0.2)
    return scene


def servo():
    p = wd.packing.hexagonal((8.0, 8.0), 1.0, "strain")
    scene = wd.Scene()
    body = scene.add(p, SOFT)
    scene.hold(body, p.bottom)
    scene.servo(body, p.top, traction=-1e-3, axis="y", speed=2e-3)
    scene.load(body, p.right, (1e-5, 0.0), history=lambda t: np.sin(t))
    scene.absorb(body, p.left)
    return scene


def box():
    cell = wd.packing.voronoi((6.0, 6.0), 1.0, periodic=True, seed=1)
    scene = wd.Scene()
    body = scene.add(cell, SOFT)
    scene.strain(body, lambda t: 1e-3 * np.sin(t) * np.eye(2))
    return scene


def tools(sinks=4e-3):
    """A breaking body on a floor, between a turning disc on a path and a plate that is steered."""
    p = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")
    scene = wd.Scene()
    scene.scatter_strength(scene.add(p, SOFT, fracture=wd.Rankine(2e-3)), 1.5)
    scene.contact(friction=0.3, restitution=0.8)
    low, high = p.position.min(axis=0), p.position.max(axis=0)
    scene.wall((0.0, low[1] - 0.5), (0.0, 1.0))
    disc = wd.wall.Sphere((low[0] + 2.0, high[1] + 1.51), 1.0)
    scene.wall(disc, path=lambda t: np.array([1e-3 * t, -sinks * t, 0.0]), spin=0.05)
    plate = scene.wall((high[0] + 0.502, 0.0), (-1.0, 0.0))
    scene.steer(plate, 2e-2, (-1.0, 0.0), 0.05)
    return scene


def hertz():
    """Breaking bodies of space that meet by Hertz's law, over a mesh that moves."""
    p = wd.packing.simple_cubic((2.0, 2.0, 2.0), 1.0)
    scene = wd.Scene()
    for number in range(2):
        body = scene.add(p, SOFT, fracture=wd.DruckerPrager(8e-3, 2.0))
        scene.scatter_strength(body, 1.5)
        body.displacement[:, 0] = 2.05 * number
        scene.set_velocity(body, [0.03 - 0.06 * number, 0.0, -0.01])
    scene.contact(friction=0.3, restitution=0.8, law="hertz")
    z = p.position[:, 2].min() - 0.51
    corners = [[-9.0, -9.0, z], [9.0, -9.0, z], [9.0, 9.0, z], [-9.0, 9.0, z]]
    scene.wall(wd.wall.Mesh(corners, [[0, 1, 2], [0, 2, 3]]), velocity=(0.0, 0.0, 0.01))
    return scene


def ageing():
    """Rate-and-state friction of pairs, of a wall, and of the faces of broken bonds."""
    p = wd.packing.hexagonal((5.0, 4.0), 1.0, "strain")
    scene = wd.Scene()
    for number in range(2):
        body = scene.add(p, SOFT, facet_bending=True, fracture=wd.Rankine(4e-3))
        scene.scatter_strength(body, 1.5)
        body.displacement[:, 0] = 5.05 * number
        scene.set_velocity(body, [0.05 - 0.1 * number, -0.01])
    scene.contact(friction=wd.RateAndState(mu0=0.4, a=0.01, b=0.015, V0=1e-3, Dc=1e-2))
    scene.wall((0.0, p.position[:, 1].min() - 0.5), (0.0, 1.0), velocity=(0.01, 0.0))
    return scene


def healing():
    """A bar that breaks and is linked again, several times."""
    p = wd.packing.square((4.0, 1.0), 1.0, "strain")
    scene = wd.Scene()
    body = scene.add(p, SOFT, fracture=wd.Rankine(2e-3), healing=wd.Healing(pressure=1e-4))
    x = p.position[:, 0].mean()
    scene.set_strength(body, np.inf)
    scene.set_strength(body, 1.0, [x, -9.0], [x, 9.0])
    scene.contact(friction=0.2)
    scene.hold(body, [0])
    omega = 0.5
    scene.hold(body, [3], velocity=[0.01 * omega, 0.0], history=lambda t: np.cos(omega * t))
    return scene


def welding():
    """Two elements, pressed on each other until they weld, and pulled apart."""
    scene = wd.Scene()
    one, other = (scene.add(ball(np.array([x, 0.0]), 0.5), SOFT) for x in (0.0, 1.0))
    scene.hold(one, [0])
    omega = 0.5
    scene.hold(other, [0], velocity=[0.01 * omega, 0.0], history=lambda t: np.sin(omega * t))
    other.displacement[:] = [-0.01, 0.0]
    scene.contact(friction=0.3, welding=wd.Welding(strength=2e-3, pressure=1e-4, time=1.0))
    return scene


def renewing():
    """A sheet that flows so far that its faces are renewed."""
    p = wd.packing.voronoi((8.0, 8.0), 1.0, "strain", seed=1, periodic=True)
    scene = wd.Scene()
    flows = {"yielding": wd.VonMises(0.01, wd.Voce(0.01, 2.0)), "finite_strain": True}
    body = scene.add(p, SOFT, renew_faces=0.05, **flows)
    rate = 2e-3
    scene.strain(body, lambda t: np.diag([np.expm1(rate * t), np.expm1(-rate * t)]))
    scene.set_velocity(body, rate * p.position * [1.0, -1.0])
    return scene


def crossing():
    """Pieces of a periodic body that rub on each other, through the sides of a box that shrinks."""
    p = wd.packing.voronoi((7.0, 6.0), 1.0, "strain", seed=1, periodic=True)
    scene = wd.Scene()
    body = scene.add(p, SOFT, fracture=wd.Rankine(2e-3))
    scene.strain(body, lambda t: np.diag([1e-3, 5e-4]) * (1.0 - 0.05 * t))
    scene.set_velocity(body, 0.06 * np.random.default_rng(3).normal(size=p.position.shape))
    scene.scatter_strength(body, 1.5)
    scene.contact(friction=0.3)
    return scene


OLD = (facets, space, evm, softening, incubating, plastic, breaking_plastic, finite, prony,
       kelvin, contact, servo, box)  # fmt: skip
MAKES = (*OLD, tools, hertz, ageing, healing, renewing, crossing)
BREAKING = (facets, space, evm, prony, contact, tools, hertz, ageing, healing)
LENGTH = {renewing: 260, crossing: 200, healing: 140, hertz: 36}  # steps
QUICK = {(facets, "float32"), (evm, "mixed")}  # beside float64
CASES = [
    pytest.param(make, x, id=f"{make.__name__}-{x}",
                 marks=[] if (make, x) in QUICK or (x == "float64" and make is not crossing)
                 else [pytest.mark.slow])
    for make in MAKES for x in ("float64", "float32", "mixed")
]  # fmt: skip


def bytes_of(sim):
    """Every array of a simulation that holds numbers, by name."""
    arrays = sim._step.arrays.items()
    return {name: a.numpy().tobytes() for name, a in arrays if name not in sim._step.addresses}


@pytest.mark.filterwarnings("ignore::warpdem.ModelWarning")
@pytest.mark.parametrize(("make", "precision"), CASES)
def test_a_resumed_run_differs_in_no_byte(make, precision, tmp_path):
    options = {"precision": precision, "local_damping": 0.1 if make is kelvin else 0.0}
    path = tmp_path / "half.npz"
    whole, half = (wd.Simulation(make(), **options) for _ in range(2))
    for sim in (whole, half):
        sim.observe(wd.FragmentTracker(7))
    steps = LENGTH.get(make, STEPS)
    whole.run(steps=steps)
    half.run(steps=steps // 2, checkpoint=path)
    again = wd.resume(path, make())
    tracker = again.observe(wd.FragmentTracker(7))
    again.run(steps=steps - steps // 2)
    a, b = bytes_of(whole), bytes_of(again)
    assert a.keys() == b.keys()
    assert [name for name in a if a[name] != b[name]] == []
    assert np.array_equal(tracker.history, whole._observers[0].history)
    assert np.array_equal(whole.broken_bonds(), again.broken_bonds())
    assert np.array_equal(whole.relinked_bonds(), again.relinked_bonds())
    assert whole.renewals == again.renewals
    assert whole.energy() == again.energy()
    if make in BREAKING:  # the checkpoint lies in the middle of a fracture
        late = whole.broken_bonds()["step"] > steps // 2
        assert late.any() and not late.all()
    if make is healing:
        late = whole.relinked_bonds()["step"] > steps // 2
        assert late.any() and not late.all()
    if make is renewing:  # before and after the checkpoint
        assert [r.step for r in whole.renewals] == [100, 200]
    if make is crossing:
        assert len(whole.contacts) > 0
    if make is tools:
        assert all(np.linalg.norm(whole.wall_force(w)) > 0.0 for w in whole.scene.walls)
    if make is softening:
        keeps = wd.resume(path, make()).integrity
        assert ((keeps < 1.0) & (keeps > whole.integrity)).any()


@pytest.mark.filterwarnings("ignore::warpdem.ModelWarning")
@pytest.mark.parametrize("make", MAKES, ids=lambda m: m.__name__)
def test_no_array_that_steps_write_is_left_out(make, tmp_path):
    sim, path = wd.Simulation(make()), tmp_path / "all.npz"
    before = bytes_of(sim)
    sim.run(steps=20)
    after = bytes_of(sim)
    written = {name for name in after if before.get(name) != after[name]}
    sim.save(path)
    with np.load(path, allow_pickle=False) as file:
        kept = {n.removeprefix("state/"): file[n].tobytes() for n in file if "/" in n}
    assert {"displacement", "velocity"} <= written
    assert {name for name in written if kept.get(name) != after[name]} == set()


def test_welds_resume_with_their_log(tmp_path):
    sims = [wd.Simulation(welding(), dt=0.1) for _ in range(2)]
    whole, half = sims
    whole.run(steps=300)
    half.run(steps=150, checkpoint=tmp_path / "a.npz")
    again = wd.resume(tmp_path / "a.npz", welding())
    again.run(steps=150)
    late = whole.welded_pairs()["step"] > 150
    assert late.any() and not late.all()
    assert np.array_equal(whole.welded_pairs(), again.welded_pairs())
    assert bytes_of(again) == bytes_of(whole)


def test_a_new_attribute_is_kept_without_a_word(tmp_path):
    class Mine:
        every = 3

        def __init__(self):
            self.rng, self.rows, self.kept = np.random.default_rng(4), [], {}
            self.function, self.rare = (lambda x: x), set()

        def observe(self, sim):
            x = self.rng.normal(size=2)
            self.rows.append((sim.time, x, np.float32(x[0])))
            self.kept[sim.steps], self.last = float(x[1]), np.float64(x[0])
            self.rare.add(sim.steps)

        def finish(self, sim):
            pass

    one, two = wd.Simulation(facets()), wd.Simulation(facets())
    mine, half = one.observe(Mine()), two.observe(Mine())
    rows = half.rows
    one.run(steps=20)
    two.run(steps=10)
    two.save(tmp_path / "a.npz")
    sim = wd.resume(tmp_path / "a.npz", facets())
    new = Mine()
    held = new.rows
    sim.observe(new)
    sim.run(steps=10)
    assert held is new.rows and rows is not held
    assert repr(new.rows) == repr(mine.rows)
    assert (new.kept, new.rare, new.last) == (mine.kept, mine.rare, mine.last)
    assert type(new.last) is np.float64 and new.function(2) == 2


def test_what_does_not_belong_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    sim = wd.Simulation(facets())
    sim.observe(wd.FragmentTracker())
    sim.save(path)
    other = thrown(core.small_packing("voronoi strain"), fracture=wd.Rankine(3e-3))[0]
    with pytest.raises(wd.InputError, match="another scene: bond_strength differ"):
        wd.resume(path, other)
    with pytest.raises(wd.InputError, match="records of a FragmentTracker here"):
        wd.resume(path, facets()).observe(wd.CrackTracker())
    with pytest.raises(wd.DamagedFileError, match="there is no file"):
        wd.resume(tmp_path / "b.npz", facets())
    with pytest.raises(wd.InputError, match=r"must end in \.npz"):
        sim.save(tmp_path / "a.dat")
    with pytest.raises(wd.InputError, match="there is no folder"):
        sim.save(tmp_path / "none" / "a.npz")

    def loaded(factor):
        p = wd.packing.hexagonal((6.0, 6.0), 1.0, "strain")
        scene = wd.Scene()
        scene.load(scene.add(p, SOFT), p.right, (1e-5, 0.0), history=lambda t: factor + t)
        return scene

    moved = wd.Simulation(loaded(1.0))
    moved.run(steps=3)
    moved.save(path)
    with pytest.raises(wd.InputError, match="functions of time"):
        wd.resume(path, loaded(2.0))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A checkpoint, and its bytes."""
    path = tmp_path_factory.mktemp("whole") / "a.npz"
    sim = wd.Simulation(facets())
    sim.run(steps=20)
    sim.save(path)
    return path, path.read_bytes()


def test_the_same_state_gives_the_same_file(whole, tmp_path):
    sim = wd.resume(whole[0], facets())
    sim.save(tmp_path / "b.npz")
    assert (tmp_path / "b.npz").read_bytes() == whole[1]


def test_every_flipped_bit_is_refused(whole, tmp_path):
    path, data = tmp_path / "a.npz", whole[1]
    rng = np.random.default_rng(1)
    places = [*rng.integers(0, len(data), 140), *(len(data) - 1 - np.arange(60))]
    refused = 0
    for place in places:
        bad = bytearray(data)
        bad[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bad)
        with pytest.raises(wd.DamagedFileError, match="damaged"):
            archive.read_archive(path)
        refused += 1
    assert refused == 200


def test_every_truncation_is_refused(whole, tmp_path):
    path, data = tmp_path / "a.npz", whole[1]
    rng = np.random.default_rng(2)
    for size in [0, 1, len(data) - 1, *rng.integers(2, len(data) - 1, 47)]:
        path.write_bytes(data[:size])
        with pytest.raises(wd.DamagedFileError, match="damaged"):
            archive.read_archive(path)


def sealed(path):
    """Give a forged file a digest that is right."""
    data = path.read_bytes()
    path.write_bytes(data + sha256(data).hexdigest().encode())


def forged(path, header, members, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as file:
        file.writestr("header.json", header if isinstance(header, str) else json.dumps(header))
        for name, data in members.items():
            file.writestr(name, data)
        file.comment = archive.SEAL + b"0" * archive.DIGEST
    path.write_bytes(path.read_bytes()[: -archive.DIGEST])
    sealed(path)


def npy(dtype, shape, data=b""):
    from io import BytesIO

    out = BytesIO()
    told = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, told)
    return out.getvalue() + data


@pytest.mark.parametrize(
    ("arrays", "member", "compression", "says"),
    [
        ({"x": ["<f8", [10**12]]}, npy("<f8", (10**12,)), zipfile.ZIP_STORED, "should have 8000"),
        ({"x": ["<f8", [2]]}, npy("<f8", (10**12,)), zipfile.ZIP_STORED, "not what its header"),
        ({"x": ["<f8", [2**62, 4]]}, npy("<f8", (2**62, 4)), zipfile.ZIP_STORED, "should have"),
        ({"x": ["<f8", [-1]]}, npy("<f8", (-1,)), zipfile.ZIP_STORED, "shape of x"),
        ({"x": ["|O", [1]]}, npy("|O", (1,), b"\x80\x04N."), zipfile.ZIP_STORED, "of the kind"),
        ({"x": ["<f8", [1]]}, npy("|O", (1,), b"\x80\x04N."), zipfile.ZIP_STORED, "not what its"),
        ({"x": ["|u1", [10**8]]}, npy("|u1", (10**8,), bytes(10**8)), zipfile.ZIP_DEFLATED,
         "compressed"),
        ({}, npy("<f8", (1,), bytes(8)), zipfile.ZIP_STORED, "not those that its header names"),
    ],
    ids=["1e12", "1e12 own", "overflow", "negative", "object", "hidden object", "bomb", "unnamed"],
)  # fmt: skip
def test_forged_sizes_are_refused_before_memory_is_taken(
    arrays, member, compression, says, tmp_path
):
    import tracemalloc

    path = tmp_path / "a.npz"
    forged(path, {"version": 1, "arrays": arrays}, {"x.npy": member}, compression)
    del member
    tracemalloc.start()
    with pytest.raises(wd.DamagedFileError, match=says):
        archive.read_archive(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * archive.BLOCK


def test_strange_headers_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    endless = '{"version": 1, "arrays": ' + "[" * 100_000
    lists = '{"version": 1, "arrays": []}'
    for header in (
        "[]",
        "{",
        "7",
        '{"version": 99, "arrays": {}}',
        '{"version": 1}',
        lists,
        endless,
    ):
        forged(path, header, {})
        with pytest.raises(wd.DamagedFileError, match="damaged"):
            archive.read_archive(path)


def test_the_last_two_are_kept_and_offered(tmp_path):
    path = tmp_path / "a.npz"
    sim = wd.Simulation(facets())
    sim.run(steps=25, checkpoint=path, checkpoint_every=10)
    assert {x.name for x in tmp_path.iterdir()} == {"a.npz", "a.previous.npz"}
    assert [checkpoint.read(x)[0]["steps"] for x in (path, archive.previous(path))] == [25, 20]
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(wd.DamagedFileError, match=r"before it is .*a\.previous\.npz"):
        wd.resume(path, facets())
    again = wd.resume(archive.previous(path), facets())
    again.run(steps=5)
    assert bytes_of(again) == bytes_of(sim)


def test_checkpoints_change_no_bit(tmp_path):
    alone, kept = wd.Simulation(contact()), wd.Simulation(contact())
    alone.run(steps=STEPS)
    kept.run(steps=STEPS, checkpoint=tmp_path / "a.npz", checkpoint_every=7)
    assert bytes_of(alone) == bytes_of(kept)


def test_a_full_disk_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.npz"
    sim = wd.Simulation(facets())
    sim.save(path)
    before, limits = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        for most in (100, len(before) // 2, len(before) - 50):
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
            with pytest.raises(wd.InputError, match=r"cannot write .* is whole"):
                sim.save(path)
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_bytes() == before
    assert [x.name for x in tmp_path.iterdir()] == ["a.npz"]


def test_a_log_that_lost_lines_is_refused(tmp_path):
    log, path = tmp_path / "log.csv", tmp_path / "a.npz"
    sim = wd.Simulation(facets())
    sim.observe(wd.BreakLog(log, every=1))
    sim.run(steps=30, checkpoint=path)
    log.write_bytes(log.read_bytes()[:200])
    again = wd.resume(path, facets())
    again.observe(wd.BreakLog(log, every=1))
    with pytest.raises(wd.InputError, match="at the checkpoint; put the file"):
        again.run(steps=5)
    with pytest.raises(wd.InputError, match="cannot write into the folder"):
        wd.BreakLog("/proc/none/log.csv")


def hash_of(sim):
    return sha256(b"".join(v for _, v in sorted(bytes_of(sim).items()))).hexdigest()


def test_records_that_wait_for_their_observers_are_not_lost(tmp_path):
    path = tmp_path / "a.npz"
    sim = wd.Simulation(facets())
    sim.observe(wd.FragmentTracker(every=5))
    sim.run(steps=10)
    sim.save(path)
    again = wd.resume(path, facets())
    with pytest.raises(wd.InputError, match="have not been handed over"):
        again.save(path)
    tracker = again.observe(wd.FragmentTracker(every=5))
    again.save(path)
    assert len(tracker.history) == 3


def test_a_signal_that_is_ignored_stays_so(tmp_path):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        sim = wd.Simulation(facets())

        class Caller:
            every = 4

            def observe(self, _):
                os.kill(os.getpid(), signal.SIGINT)

            def finish(self, _):
                pass

        sim.observe(Caller())
        sim.run(steps=12, checkpoint=tmp_path / "a.npz")
        assert sim.steps == 12
    finally:
        signal.signal(signal.SIGINT, before)


def test_five_runs_of_a_scene_are_one():
    seen = set()
    for _ in range(5):
        sim = wd.Simulation(contact())
        sim.run(steps=STEPS)
        seen.add(hash_of(sim))
    assert len(seen) == 1


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize(
    ("plate", "precision"),
    [
        (True, "float64"),
        *(
            pytest.param(*x, marks=pytest.mark.slow)
            for x in ((True, "float32"), (False, "float32"))
        ),
    ],
)
def test_one_and_two_threads_resume_to_the_same_bits(plate, precision, tmp_path):
    """Two runs in one and one in two halves, in the plane and in space."""

    def scene():
        if plate:
            p = wd.packing.hexagonal((110.0, 70.0), 1.0, "strain")
        else:
            p = wd.packing.fcc((15.0, 15.0, 15.0), 1.0)
        return thrown(p, 0.02, fracture=wd.DruckerPrager(1e-2, 3.0))[0]

    seen = set()
    for threads in (1, 2):
        whole = wd.Simulation(scene(), precision=precision, threads=threads, dt=0.1)
        whole.run(steps=30)
        seen.add(hash_of(whole))
    assert whole.model.bonds > whole.model.elements > passes.SHARED  # both are shared out
    half = wd.Simulation(scene(), precision=precision, dt=0.1)
    half.run(steps=15, checkpoint=tmp_path / "a.npz")
    again = wd.resume(tmp_path / "a.npz", scene(), threads=2)
    again.run(steps=15)
    seen.add(hash_of(again))
    late = whole.broken_bonds()["step"] > 15
    assert late.any() and not late.all()
    assert len(seen) == 1


def test_walls_and_renewals_of_another_scene_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    sim = wd.Simulation(tools())
    sim.run(steps=10, checkpoint=path)
    other = tools()
    other.walls[1].shape.radius = 1.1
    with pytest.raises(wd.InputError, match=r"another scene: wall_shape, walls differ"):
        wd.resume(path, other)
    with pytest.raises(wd.InputError, match="wall 1 is elsewhere at this instant"):
        wd.resume(path, tools(sinks=5e-3))


def test_faces_are_renewed_at_the_same_steps_whoever_looks():
    alone, watched = wd.Simulation(renewing()), wd.Simulation(renewing())
    watched.observe(wd.FragmentTracker(33))
    alone.run(steps=130)
    watched.run(steps=130)
    assert bytes_of(alone) == bytes_of(watched)


def test_renumbered_and_turned_specimens_move_alike():
    """Elements and bonds in another order, all turned by 0.7: the same breaks and places."""
    p = core.small_packing("voronoi strain")
    rng, turn = np.random.default_rng(3), np.array([[np.cos(0.7), -np.sin(0.7)],
                                                    [np.sin(0.7), np.cos(0.7)]])  # fmt: skip
    order, bond_order = rng.permutation(len(p)), rng.permutation(len(p.bonds))
    place = np.argsort(order)
    other = wd.Packing(
        p.position[order] @ turn.T, p.volume[order], place[p.bonds][bond_order],
        p.area[bond_order], p.arms[bond_order] @ turn.T, radius=p.radius[order], plane="strain",
    )  # fmt: skip
    velocity = 1e-2 * rng.normal(size=p.position.shape)
    sims = []
    for packing, v in ((p, velocity), (other, velocity[order] @ turn.T)):
        scene = wd.Scene()
        scene.set_velocity(scene.add(packing, SOFT, fracture=wd.Rankine(6e-3)), v)
        sims.append(wd.Simulation(scene, dt=0.1))
        sims[-1].run(steps=150)
    one, two = sims
    u = two.displacement[place] @ turn
    assert np.abs(u - one.displacement).max() < 1e-11 * np.abs(one.displacement).max()
    assert 10 < (~one.linked).sum() < len(p.bonds)
    assert np.array_equal(one.linked[bond_order], two.linked)
