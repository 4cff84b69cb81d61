"""Finite strain: dilation, true stress and flow of elements by their deformation gradients (B6).

F_i = 1 + H_i with H_i = (1/V_i) sum w du (x) B_i^-T c over an element's linked faces, where du is
the difference of the centres' displacements and c the element's own arm in the reference state.
B_i, the same sum with the centre line in place of du and c in that of B_i^-T c, is 1 where all
faces are there (theory B1). So F_i is exact for every affine motion, at free surfaces as well.
"""

from functools import cache

import warp as wp

from .algebra import Laws, narrow
from .face import Faces, face
from .facet import facet
from .fracture import pair_tensor
from .memory import get, kernel, nn, put
from .plastic import Flow, flow_stress, numbers_type

LEAST_JACOBIAN = 1e-2  # beyond it an element is lost; its volume stress grows no more


@cache
def gradients(s: Laws) -> Laws:
    """Square matrices of the plane or of space, and what follows from a displacement gradient."""
    real, dim = s.real, s.dim
    mat = wp.types.matrix((dim, dim), real)

    @wp.func
    def load(a: wp.array(dtype=real), i: int) -> mat:
        m = mat()
        for row in range(wp.static(dim)):
            for column in range(wp.static(dim)):
                m[row, column] = get(a, wp.static(dim * dim) * i + wp.static(dim) * row + column)
        return m

    @wp.func
    def store(a: wp.array(dtype=real), i: int, m: mat):
        for row in range(wp.static(dim)):
            for column in range(wp.static(dim)):
                put(a, wp.static(dim * dim) * i + wp.static(dim) * row + column, m[row, column])

    @wp.func
    def deformation(h: mat) -> mat:
        """F = 1 + H."""
        return wp.identity(n=wp.static(dim), dtype=real) + h

    @wp.func
    def growth(h: mat) -> real:
        """det F - 1 without cancellation, kept above -1."""
        e = wp.trace(h) + wp.determinant(h)
        if wp.static(dim == 3):
            e += h[0, 0] * h[1, 1] - h[0, 1] * h[1, 0]
            e += h[1, 1] * h[2, 2] - h[1, 2] * h[2, 1]
            e += h[2, 2] * h[0, 0] - h[2, 0] * h[0, 2]
        return wp.max(e, real(LEAST_JACOBIAN - 1.0))

    @wp.func
    def dilation(h: mat) -> real:
        """E = ln det F, precise where H is small too."""
        x = growth(h)
        u = real(1.0) + x
        rounded = u - real(1.0)
        safe = wp.where(rounded == real(0.0), real(1.0), rounded)
        return wp.where(rounded == real(0.0), x, wp.log(u) * x / safe)

    @wp.func
    def spatial(h: mat) -> mat:
        """F^-T = dE/dF."""
        return wp.transpose(wp.inverse(deformation(h)))

    if dim == 2:

        @wp.func
        def embed(m: mat) -> s.mat3:
            o = real(0.0)
            return s.mat3(m[0, 0], m[0, 1], o, m[1, 0], m[1, 1], o, o, o, o)

        @wp.func
        def project(m: s.mat3) -> mat:
            return mat(m[0, 0], m[0, 1], m[1, 0], m[1, 1])
    else:

        @wp.func
        def embed(m: mat) -> mat:
            return m

        @wp.func
        def project(m: mat) -> mat:
            return m

    return Laws(
        mat=mat,
        load=load,
        store=store,
        deformation=deformation,
        growth=growth,
        dilation=dilation,
        spatial=spatial,
        embed=embed,
        project=project,
    )


@cache
def principal(s: Laws):
    """Principal axes of a symmetric tensor by Jacobi's rotations."""
    real, mat3, dim = s.real, s.mat3, s.dim
    rotations = 1 if dim == 2 else 18
    close = real(1e-15 if s.real is wp.float64 else 1e-7)

    @wp.func
    def principal(t: mat3) -> mat3:
        """Columns: the axes, of the plane or of space."""
        axes = wp.identity(n=3, dtype=real)
        a = t
        small = close * wp.trace(t)
        for n in range(wp.static(rotations)):
            if wp.abs(a[0, 1]) + wp.abs(a[1, 2]) + wp.abs(a[2, 0]) <= small:
                break
            p = n % 3
            q = (p + 1) % 3
            r = (p + 2) % 3
            off = a[p, q]
            safe = wp.where(off == real(0.0), real(1.0), off)
            x = (a[q, q] - a[p, p]) / (real(2.0) * safe)
            sign = wp.where(x < real(0.0), real(-1.0), real(1.0))
            tan = sign / (wp.abs(x) + wp.sqrt(x * x + real(1.0)))
            tan = wp.where(off == real(0.0), real(0.0), tan)
            cos = real(1.0) / wp.sqrt(tan * tan + real(1.0))
            sin = tan * cos
            a[p, p] = a[p, p] - tan * off
            a[q, q] = a[q, q] + tan * off
            a[p, q] = real(0.0)
            a[q, p] = real(0.0)
            rp = a[r, p]
            rq = a[r, q]
            a[r, p] = cos * rp - sin * rq
            a[r, q] = sin * rp + cos * rq
            a[p, r] = a[r, p]
            a[q, r] = a[r, q]
            for row in range(3):
                vp = axes[row, p]
                vq = axes[row, q]
                axes[row, p] = cos * vp - sin * vq
                axes[row, q] = sin * vp + cos * vq
        return axes

    return principal


@cache
def centre_openings(s: Laws, k: Laws, faces: Faces, simd: bool = True):
    """Pass over bonds: how far the centres have moved apart, times the face's weight w [m^2]."""
    real, narrowed = s.real, narrow(s, k)

    def centre_openings(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_jump: wp.array(dtype=k.real),
        # state read
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        # written
        centre_opening: wp.array(dtype=real),
    ):
        b = nn(wp.tid())
        du = k.load(displacement, nn(get(bond_j, b))) - k.load(displacement, nn(get(bond_i, b)))
        if wp.static(faces.has_jump):
            du += k.load(bond_jump, b)
        s.store(centre_opening, b, get(bond_weight, b) * narrowed(du))

    return kernel(centre_openings, simd)


@cache
def deformations(s: Laws, k: Laws, faces: Faces, slots: int, has_dilation: bool, simd: bool = True):
    """Pass over elements: H_i, g_i = A_i (ln det F_i - P_i), and what g_i pulls arms with.

    volume_pull is g F^-T B^-T: its product with w and an arm is the force of the volume energy.
    """
    real, geometry, narrowed, g = s.real, face(s, k, faces), narrow(s, k), gradients(s)

    def deformations(
        # model
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        inverse_shape: wp.array(dtype=real),
        # state read
        volume_stiffness: wp.array(dtype=real),
        mean_stiffness: wp.array(dtype=real),
        centre_opening: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        # written
        displacement_gradient: wp.array(dtype=real),
        volume_pull: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        mean_stress: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        h = g.mat()
        for slot in range(wp.static(slots)):
            entry = nn(get(incidence, slot * elements + i))
            own = real(1 - 2 * (entry & 1)) * s.load(centre_opening, nn(entry >> 1))
            h += wp.outer(own, narrowed(geometry.load_arm(bond_arm, entry)))
        shape = g.load(inverse_shape, i)
        h = (h * shape) / get(element_volume, i)
        e = g.dilation(h)
        if wp.static(has_dilation):
            e = e - get(plastic_dilation, i)
        stress = get(volume_stiffness, i) * e
        g.store(displacement_gradient, i, h)
        g.store(volume_pull, i, stress * (g.spatial(h) * wp.transpose(shape)))
        put(volume_stress, i, stress)
        if wp.static(faces.has_slip):
            put(mean_stress, i, get(mean_stiffness, i) * e)

    return kernel(deformations, simd)


@cache
def finite_forces(s: Laws, k: Laws, faces: Faces, has_bending: bool, simd: bool = True):
    """Pass over facet bonds: force on i and the torques on both elements.

    As `facet_forces`, but the forces of the volume energies act at the centres:
    f_I = w g_i F_i^-T B_i^-T c_i and f_J = -w g_j F_j^-T B_j^-T c_j on i.
    """
    geometry, law, real = face(s, k, faces), facet(s), s.real
    g, narrowed = gradients(s), narrow(s, k)

    def finite_forces(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        facet_bending: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        volume_pull: wp.array(dtype=real),
        # written
        trial_force: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
    ):
        b = nn(wp.tid())
        delta, yi, yj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        f = law.force(get(facet_stiffness, b), delta)
        if wp.static(faces.has_slip):
            s.store(trial_force, b, f)
        ti = s.cross(yi, f)
        tj = -s.cross(yj, f)
        if wp.static(has_bending):
            p, m = geometry.load_normals(b, bond_i, bond_j, bond_arm, orientation)
            half, cosine = geometry.load_turn(b, bond_i, bond_j, orientation)
            t = law.bending_torque(
                get(facet_bending, 2 * b), get(facet_bending, 2 * b + 1), p, m, half, cosine
            )
            ti += t
            tj -= t
        ci = narrowed(geometry.load_arm(bond_arm, nn(2 * b)))
        cj = narrowed(geometry.load_arm(bond_arm, nn(2 * b + 1)))
        pull = (
            g.load(volume_pull, nn(get(bond_i, b))) * ci
            - g.load(volume_pull, nn(get(bond_j, b))) * cj
        )
        s.store_ends(bond_place, end_force, end_torque, b, f + get(bond_weight, b) * pull, ti, tj)

    return kernel(finite_forces, simd)


@cache
def kirchhoff(s: Laws, k: Laws, faces: Faces, slots: int):
    """tau_i = sym (1/V_i) sum F (x) F_i c [Pa], the true stress times det F; what acts out of plane
    is not in it."""
    real, geometry, narrowed, g = s.real, face(s, k, faces), narrow(s, k), gradients(s)

    @wp.func
    def stress(
        i: int,
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        displacement_gradient: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        elements: int,
    ) -> g.mat:
        t = g.mat()
        for slot in range(wp.static(slots)):
            at = nn(slot * elements + i)
            c = narrowed(geometry.load_arm(bond_arm, nn(get(incidence, at))))
            t += wp.outer(s.load(end_force, at), c)
        t = t * wp.transpose(g.deformation(g.load(displacement_gradient, i)))
        return (real(0.5) / get(element_volume, i)) * (t + wp.transpose(t))

    return stress


@cache
def kirchhoff_stresses(s: Laws, k: Laws, faces: Faces, slots: int, simd: bool = True):
    """Pass over elements: the stress tau, and that of the springs alone before this step's slips.

    spring_stress is (1/V_i) sum f (x) B_i^-T c [Pa], force over area of the reference state.
    """
    real, g, average = s.real, gradients(s), kirchhoff(s, k, faces, slots)
    geometry, narrowed = face(s, k, faces), narrow(s, k)

    def kirchhoff_stresses(
        # model
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        inverse_shape: wp.array(dtype=real),
        # state read
        displacement_gradient: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        trial_force: wp.array(dtype=real),
        # written
        kirchhoff_stress: wp.array(dtype=real),
        spring_stress: wp.array(dtype=real),
        elements: int,
    ):
        i = nn(wp.tid())
        t = average(
            i, incidence, bond_arm, element_volume, displacement_gradient, end_force, elements
        )
        g.store(kirchhoff_stress, i, t)
        p = g.mat()
        for slot in range(wp.static(slots)):
            entry = nn(get(incidence, slot * elements + i))
            f = real(1 - 2 * (entry & 1)) * s.load(trial_force, nn(entry >> 1))
            p += wp.outer(f, narrowed(geometry.load_arm(bond_arm, entry)))
        g.store(spring_stress, i, (p * g.load(inverse_shape, i)) / get(element_volume, i))

    return kernel(kirchhoff_stresses, simd)


@cache
def jacobian(s: Laws, plane: str | None):
    """Volume over that of the reference state; in plane stress with the change of thickness."""
    real, g = s.real, gradients(s)

    @wp.func
    def ratio(h: g.mat, volume_stress: real, two_shear: real, plastic_dilation: real) -> real:
        j = real(1.0) + g.growth(h)
        if wp.static(plane == "stress"):  # eps_zz is -D m/2G, plastic -P
            j = j * wp.exp(-volume_stress / two_shear - plastic_dilation)
        return j

    return ratio


@cache
def true_stress(s: Laws, k: Laws, faces: Faces, slots: int, plane: str | None, simd: bool = True):
    """Pass over listed elements: their true (Cauchy) stress tau/det F [Pa], tension positive."""
    real, g = s.real, gradients(s)
    average, ratio = kirchhoff(s, k, faces, slots), jacobian(s, plane)

    def true_stress(
        # model
        listed: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        element_two_shear: wp.array(dtype=real),
        # state read
        displacement_gradient: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        # written
        stress: wp.array(dtype=real),
        elements: int,
    ):
        i = listed[wp.tid()]
        t = g.embed(
            average(
                i, incidence, bond_arm, element_volume, displacement_gradient, end_force, elements
            )
        )
        plastic = real(0.0)
        if wp.static(plane == "strain"):
            t[2, 2] = get(volume_stress, i)
            if wp.static(faces.has_slip):
                t[2, 2] -= get(element_two_shear, i) * get(plastic_strain_zz, i)
        if wp.static(plane == "stress" and faces.has_slip):
            plastic = get(plastic_dilation, i)
        h = g.load(displacement_gradient, i)
        s.store_tensor(
            stress, i, t / ratio(h, get(volume_stress, i), get(element_two_shear, i), plastic)
        )

    return kernel(true_stress, simd)


@cache
def finite_returns(s: Laws, plane: str | None, flow: Flow) -> Laws:
    """How far tau returns at finite strain, in the axes of b = F F^T (von Mises, theory B6).

    The plastic rate of deformation is D = x (tau - m). Slips D F c take 2 G sym(D b) off tau, for
    the springs are as stiff as their lattice is stretched; so each component falls by a factor of
    its own. With b = 1 it is the radial return.
    """
    real, mat3, law, half = s.real, s.mat3, numbers_type(s), s.real(0.5)
    flowing, measure = flow_stress(s, flow), pair_tensor(s)
    close = real(1e-10 if s.real is wp.float64 else 1e-5)
    third = real(2.0 / 3.0)

    @wp.func
    def returned(t: mat3, b: s.vec3, mean: real, y: real, volume: real):
        """tau and m after flow, y = 2 G x; volume: A/2G."""
        r = mat3()
        m = mean
        for p in range(3):
            for q in range(3):
                r[p, q] = t[p, q] / (real(1.0) + half * y * (b[p] + b[q]))
        if wp.static(plane == "stress"):
            # m is tr(tau)/3 at once, and P grows by x m, so that g falls
            own = real(0.0)
            each = real(3.0)
            for p in range(2):
                own += t[p, p] / (real(1.0) + y * b[p])
                each -= y * (b[p] - volume) / (real(1.0) + y * b[p])
            m = own / each
            for p in range(2):
                r[p, p] = (t[p, p] + y * (b[p] - volume) * m) / (real(1.0) + y * b[p])
        else:
            for p in range(3):
                r[p, p] = m + (t[p, p] - m) / (real(1.0) + y * b[p])
        return r, m

    @wp.func
    def growth(
        x: law,
        t: mat3,
        b: s.vec3,
        mean: real,
        volume: real,
        ratio: real,
        two_shear: real,
        p: real,
        dt: real,
        strains: wp.array(dtype=real),
        stresses: wp.array(dtype=real),
    ):
        """y at which q is the flow stress times the ratio of volumes, and tau and m there.

        By false position between no flow and too much (the Illinois form).
        """
        trial = measure.von_mises(t)
        slow, _slope = flowing(x, p, real(0.0), dt, strains, stresses)
        low = real(0.0)
        high = real(0.0)
        over = trial - ratio * slow
        under = real(0.0)
        side = real(0.0)
        y = third * half * (trial / (ratio * slow) - real(1.0))
        r = t
        m = mean
        for _n in range(200):
            r, m = returned(t, b, mean, y, volume)
            q = measure.von_mises(r)
            stress, _s = flowing(x, p, third * y * q / two_shear, dt, strains, stresses)
            off = q - ratio * stress
            if wp.abs(off) <= close * trial:
                break
            if off > real(0.0):
                if side == real(1.0):
                    under = half * under
                low = y
                over = off
                side = real(1.0)
            else:
                if side == real(-1.0):
                    over = half * over
                high = y
                under = off
                side = real(-1.0)
            between = (low * under - high * over) / (under - over)
            y = wp.where(high == real(0.0), real(2.0) * y, between)
        return y, r, m

    @wp.func
    def bounded(y: real, way: mat3, pulled: mat3, b: s.vec3) -> real:
        """y, no more than takes energy from the springs: way : (tau_s - G x way b) >= 0.

        way: tau - m; pulled: the springs' part of tau, all in the axes of b.
        """
        cost = real(0.0)
        for p in range(3):
            for q in range(3):
                cost += half * way[p, q] * way[p, q] * b[p]
        return wp.max(wp.min(y, wp.ddot(way, pulled) / cost), real(0.0))

    return Laws(growth=growth, bounded=bounded)


@cache
def finite_return(s: Laws, k: Laws, plane: str | None, flow: Flow, simd: bool = True):
    """Pass over elements of one yield law: the plastic flow of this step (von Mises).

    plastic_gradient is D F, with which slips of arms c are made; plastic_growth that of the plastic
    strain, plastic_growth_zz that of its part out of the plane; return_factor the share of what
    bonds carry beside the elements' stress that they keep.
    """
    real, law, g, axes = s.real, numbers_type(s), gradients(s), principal(s)
    measure, ratio, back = pair_tensor(s), jacobian(s, plane), finite_returns(s, plane, flow)
    flowing, third = flow_stress(s, flow), real(2.0 / 3.0)

    def finite_return(
        # model
        flow_elements: wp.array(dtype=int),
        element_two_shear: wp.array(dtype=real),
        inverse_mass: wp.array(dtype=real),
        hardening_strain: wp.array(dtype=real),
        hardening_stress: wp.array(dtype=real),
        # state read
        displacement_gradient: wp.array(dtype=real),
        kirchhoff_stress: wp.array(dtype=real),
        spring_stress: wp.array(dtype=real),
        volume_stress: wp.array(dtype=real),
        volume_stiffness: wp.array(dtype=real),
        mean_stress: wp.array(dtype=real),
        mean_stiffness: wp.array(dtype=real),
        plastic_strain: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        # written
        plastic_dilation: wp.array(dtype=real),
        return_factor: wp.array(dtype=real),
        plastic_gradient: wp.array(dtype=real),
        plastic_growth: wp.array(dtype=real),
        plastic_growth_zz: wp.array(dtype=real),
        numbers: law,
        dt: real,
        first: int,
    ):
        i = flow_elements[wp.tid() + first]
        two_shear = get(element_two_shear, i)
        h = g.load(displacement_gradient, i)
        f = g.deformation(h)
        springs = g.load(spring_stress, i) * wp.transpose(f)
        tau = g.load(kirchhoff_stress, i)
        if wp.min(s.load(inverse_mass, i)) == real(0.0):
            # a grip pulls at it beside its faces, by nobody knows what traction
            tau = real(0.5) * (springs + wp.transpose(springs))
            tau += get(volume_stress, i) * wp.identity(n=wp.static(s.dim), dtype=real)
        t = g.embed(tau)
        pulled = g.embed(springs)
        stretch = g.embed(f * wp.transpose(f))
        dilated = real(0.0)
        if wp.static(plane == "strain"):
            pulled[2, 2] = -two_shear * get(plastic_strain_zz, i)
            t[2, 2] = get(volume_stress, i) + pulled[2, 2]
            stretch[2, 2] = real(1.0)
        if wp.static(plane == "stress"):
            dilated = get(plastic_dilation, i)
        j = ratio(h, get(volume_stress, i), two_shear, dilated)
        p = get(plastic_strain, i)
        slow, _slope = flowing(numbers, p, real(0.0), dt, hardening_strain, hardening_stress)
        kept = real(1.0)
        grown = real(0.0)
        grown_zz = real(0.0)
        rate = g.mat()
        if measure.von_mises(t) > j * slow:
            turn = axes(stretch)
            stretch = wp.transpose(turn) * stretch * turn
            b = s.vec3(stretch[0, 0], stretch[1, 1], stretch[2, 2])
            # springs that pull alike in all directions, beyond what the change of volume asks for,
            # relax: m is the mean stress less that excess
            excess = wp.trace(pulled) - two_shear * get(mean_stress, i) / get(mean_stiffness, i)
            mean = measure.mean_stress(t) - excess / real(3.0)
            y, r, m = back.growth(
                numbers,
                wp.transpose(turn) * t * turn,
                b,
                mean,
                get(volume_stiffness, i) / two_shear,
                j,
                two_shear,
                p,
                dt,
                hardening_strain,
                hardening_stress,
            )
            way = r - m * wp.identity(n=3, dtype=real)
            y = back.bounded(y, way, wp.transpose(turn) * pulled * turn, b)
            x = y / two_shear
            kept = real(1.0) / (real(1.0) + y)
            grown = third * x * measure.von_mises(r)
            d = x * (turn * way * wp.transpose(turn))
            rate = g.project(d) * f
            grown_zz = d[2, 2]
            if wp.static(plane == "stress"):  # there the springs' excess is made good by P
                put(plastic_dilation, i, dilated - y * kept * excess / two_shear)
        put(return_factor, i, kept)
        g.store(plastic_gradient, i, rate)
        put(plastic_growth, i, grown)
        if wp.static(plane is not None):
            put(plastic_growth_zz, i, grown_zz)

    return kernel(finite_return, simd)


@cache
def share_growth(s: Laws, k: Laws, faces: Faces, slots: int, plane: str | None, simd: bool = True):
    """Pass over elements that flow: plastic strains grow as the slips around the element do.

    A bond slips by the flow of both elements, so half of what an element deforms by is its
    neighbours' flow. Were its own flow alone counted, neighbours could flow by turns unnoticed,
    and their strains drift apart.
    """
    real, geometry, narrowed, g = s.real, face(s, k, faces), narrow(s, k), gradients(s)
    dim = real(s.dim)

    def share_growth(
        # model
        flow_elements: wp.array(dtype=int),
        incidence: wp.array(dtype=int),
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        element_volume: wp.array(dtype=real),
        inverse_shape: wp.array(dtype=real),
        # state read
        bond_weight: wp.array(dtype=real),
        plastic_growth: wp.array(dtype=real),
        plastic_growth_zz: wp.array(dtype=real),
        # written
        plastic_strain: wp.array(dtype=real),
        plastic_strain_zz: wp.array(dtype=real),
        plastic_dilation: wp.array(dtype=real),
        bonds: int,
        elements: int,
    ):
        i = flow_elements[wp.tid()]
        shape = wp.transpose(g.load(inverse_shape, i))
        grown = real(0.0)
        out = real(0.0)
        for slot in range(wp.static(slots)):
            entry = nn(get(incidence, slot * elements + i))
            b = entry >> 1
            if b < bonds:
                j = nn(get(bond_i, b))
                if (entry & 1) == 0:
                    j = nn(get(bond_j, b))
                c = narrowed(geometry.load_arm(bond_arm, entry))
                way = (get(bond_weight, b) / (dim * get(element_volume, i))) * (shape * c)
                own = wp.dot(way, c)
                other = -wp.dot(way, narrowed(geometry.load_arm(bond_arm, nn(entry ^ 1))))
                grown += own * get(plastic_growth, i) + other * get(plastic_growth, j)
                if wp.static(plane is not None):
                    out += own * get(plastic_growth_zz, i) + other * get(plastic_growth_zz, j)
        put(plastic_strain, i, get(plastic_strain, i) + grown)
        if wp.static(plane == "strain"):
            put(plastic_strain_zz, i, get(plastic_strain_zz, i) + out)
        if wp.static(plane == "stress"):
            put(plastic_dilation, i, get(plastic_dilation, i) - out)

    return kernel(share_growth, simd)


@cache
def finite_slip(s: Laws, k: Laws, faces: Faces, evaluates_anew: bool, simd: bool = True):
    """Pass over facet bonds: slips of this step, the forces after them, the energy they take.

    Each side's anchor moves by its element's plastic flow, D F c, and what the spring carries
    beside the stress of both elements' springs relaxes. The rest is as in `facet_slip`.
    """
    geometry, law, real = face(s, k, faces), facet(s), s.real
    g, narrowed, widened = gradients(s), narrow(s, k), narrow(k, s)

    @wp.func
    def move(
        entry: int,
        element: int,
        p: s.vec,
        orientation: wp.array(dtype=k.real),
        bond_slip: wp.array(dtype=k.real),
    ):
        """Move an anchor by p of the world, kept in the frame of its element."""
        way = widened(p)
        own = way + k.turn_back(k.load_rot(orientation, element), way)
        k.store(bond_slip, entry, k.load(bond_slip, entry) + own)

    def finite_slip(
        # model
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_place: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        # state read
        facet_stiffness: wp.array(dtype=real),
        bond_weight: wp.array(dtype=real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
        spring_stress: wp.array(dtype=real),
        return_factor: wp.array(dtype=real),
        plastic_gradient: wp.array(dtype=real),
        # written
        bond_slip: wp.array(dtype=k.real),
        spring_force: wp.array(dtype=real),
        end_force: wp.array(dtype=real),
        end_torque: wp.array(dtype=real),
        bond_dissipation: wp.array(dtype=wp.float64),
    ):
        b = nn(wp.tid())
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        delta, yi, yj = geometry.load_anchors(
            b, bond_i, bond_j, bond_arm, bond_jump, bond_slip, displacement, orientation
        )
        stiffness = get(facet_stiffness, b)
        after = law.force(stiffness, delta)
        wi, wj = geometry.load_weights(b, bond_arm)
        kept = wi * get(return_factor, i) + wj * get(return_factor, j)
        if stiffness > real(0.0) and kept < real(1.0):
            ci = narrowed(geometry.load_arm(bond_arm, nn(2 * b)))
            cj = narrowed(geometry.load_arm(bond_arm, nn(2 * b + 1)))
            shared = wi * g.load(spring_stress, i) + wj * g.load(spring_stress, j)
            beside = after - get(bond_weight, b) * (shared * (ci - cj))
            relaxed = (real(0.5) * (real(1.0) - kept) / stiffness) * beside
            pi = relaxed + g.load(plastic_gradient, i) * ci
            pj = relaxed - g.load(plastic_gradient, j) * cj
            p = pi + pj
            lost = stiffness * p
            after = after - lost
            before = s.load(spring_force, b)
            put(
                bond_dissipation,
                b,
                get(bond_dissipation, b) + wp.float64(real(0.5) * wp.dot(p, after + before)),
            )
            move(nn(2 * b), i, pi, orientation, bond_slip)
            move(nn(2 * b + 1), j, -pj, orientation, bond_slip)
            if wp.static(not evaluates_anew):
                at_i = nn(get(bond_place, 2 * b))
                at_j = nn(get(bond_place, 2 * b + 1))
                s.store(end_force, at_i, s.load(end_force, at_i) - lost)
                s.store(end_force, at_j, s.load(end_force, at_j) + lost)
                ti = s.load_spin(end_torque, at_i) - s.cross(yi, lost) + s.cross(pi, after)
                tj = s.load_spin(end_torque, at_j) + s.cross(yj, lost) + s.cross(pj, after)
                s.store_spin(end_torque, at_i, ti)
                s.store_spin(end_torque, at_j, tj)
        s.store(spring_force, b, after)

    return kernel(finite_slip, simd)
