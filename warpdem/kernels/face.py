"""Kinematics of a face between two elements (theory B2, B2a).

Facet points y_i = x_i + Q_i c_i and y_j = x_j + Q_j c_j coincide in the reference state, whatever
the centroid's place on the face, so c_i - c_j is the reference centre line there.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from .algebra import Laws, narrow, narrow_spin
from .memory import get, nn


class Faces(NamedTuple):
    """What the faces of a scene are like."""

    central: bool  # every one is in the middle of its centre line
    has_jump: bool  # some bonds meet through the side of a periodic, strained box
    has_slip: bool = False  # some bonds flow: the anchors of their springs move
    has_creep: bool = False  # they creep: the volume term is of the moved anchors as well
    has_rest: bool = False  # some are linked again: anchors and dilations start from there


@cache
def carrying(s: Laws, k: Laws):
    """delta = y_j - y_i [m] = u_j - u_i + (Q_j - 1) c_j - (Q_i - 1) c_i of two points that elements
    carry, and the arms to them in the world frame."""
    narrowed = narrow(s, k)

    @wp.func
    def carried(du: k.vec, qi: k.rot, qj: k.rot, ci: k.vec, cj: k.vec):
        xi = k.turn(qi, ci)
        xj = k.turn(qj, cj)
        return narrowed(du + xj - xi), narrowed(ci + xi), narrowed(cj + xj)

    return carried


@cache
def face(s: Laws, k: Laws, faces: Faces) -> Laws:
    """Openings and normals, differenced in the precision of k and returned in that of s.

    Where faces are central, one arm a bond is kept and the other is its opposite.
    """
    narrowed, real, carried = narrow(s, k), s.real, carrying(s, k)

    if faces.central:

        @wp.func
        def load_arm(bond_arm: wp.array(dtype=k.real), entry: int) -> k.vec:
            """Arm c from an element's centre to the face, in the reference state."""
            return k.real(1 - 2 * (entry & 1)) * k.load(bond_arm, nn(entry >> 1))
    else:

        @wp.func
        def load_arm(bond_arm: wp.array(dtype=k.real), entry: int) -> k.vec:
            """Arm c from an element's centre to the face, in the reference state."""
            return k.load(bond_arm, entry)

    @wp.func
    def load_opening(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        """Opening, and the arms from both centres to the face, in the world frame."""
        i = nn(get(bond_i, b))
        j = nn(get(bond_j, b))
        qi = k.load_rot(orientation, i)
        qj = k.load_rot(orientation, j)
        ci = load_arm(bond_arm, nn(2 * b))
        cj = load_arm(bond_arm, nn(2 * b + 1))
        du = k.load(displacement, j) - k.load(displacement, i)
        if wp.static(faces.has_jump):
            du += k.load(bond_jump, b)
        return carried(du, qi, qj, ci, cj)

    @wp.func
    def load_slips(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_slip: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        """How far the anchors have moved from the facet points of i and of j, Q_i s_ij and
        Q_j s_ji (theory B2a)."""
        si = k.load(bond_slip, nn(2 * b))
        sj = k.load(bond_slip, nn(2 * b + 1))
        qi = k.load_rot(orientation, nn(get(bond_i, b)))
        qj = k.load_rot(orientation, nn(get(bond_j, b)))
        return narrowed(si + k.turn(qi, si)), narrowed(sj + k.turn(qj, sj))

    @wp.func
    def load_anchors(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        bond_jump: wp.array(dtype=k.real),
        bond_slip: wp.array(dtype=k.real),
        displacement: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        """Opening of the spring, and the arms from both centres to its anchors: the facet points,
        moved by slips."""
        delta, ci, cj = load_opening(
            b, bond_i, bond_j, bond_arm, bond_jump, displacement, orientation
        )
        if wp.static(faces.has_slip):
            si, sj = load_slips(b, bond_i, bond_j, bond_slip, orientation)
            delta += sj - si
            ci += si
            cj += sj
        return delta, ci, cj

    @wp.func
    def load_weights(b: int, bond_arm: wp.array(dtype=k.real)):
        """Weights of both elements in a linear interpolation to the face: the nearer centre weighs
        more (Shilko eq. 11). A node, which lies on the face, has none."""
        if wp.static(faces.central):
            return real(0.5), real(0.5)
        ci = narrowed(load_arm(bond_arm, nn(2 * b)))
        cj = narrowed(load_arm(bond_arm, nn(2 * b + 1)))
        qi = wp.dot(ci, ci - cj)
        qj = -wp.dot(cj, ci - cj)
        if qi == real(0.0) or qj == real(0.0):
            return qi / (qi + qj), qj / (qi + qj)
        return qj / (qi + qj), qi / (qi + qj)

    @wp.func
    def load_distance(b: int, bond_arm: wp.array(dtype=k.real)) -> real:
        """Distance of both centres along the face's normal, in the reference state."""
        return wp.length(
            narrowed(load_arm(bond_arm, nn(2 * b)) - load_arm(bond_arm, nn(2 * b + 1)))
        )

    @wp.func
    def load_normals(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ):
        """The face normal as each element carries it, Q_i n0 and Q_j n0; their mean direction is n.

        It is not the centre line: m S n must sum to m V 1 with the carried arms (theory B6).
        """
        n0 = k.unit(load_arm(bond_arm, nn(2 * b)) - load_arm(bond_arm, nn(2 * b + 1)))
        qi = k.load_rot(orientation, nn(get(bond_i, b)))
        qj = k.load_rot(orientation, nn(get(bond_j, b)))
        return narrowed(n0 + k.turn(qi, n0)), narrowed(n0 + k.turn(qj, n0))

    @wp.func
    def load_normal(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        bond_arm: wp.array(dtype=k.real),
        orientation: wp.array(dtype=k.real),
    ) -> s.vec:
        """Mean direction n of the face normals that both elements carry."""
        line = load_arm(bond_arm, nn(2 * b)) - load_arm(bond_arm, nn(2 * b + 1))
        qi = k.load_rot(orientation, nn(get(bond_i, b)))
        qj = k.load_rot(orientation, nn(get(bond_j, b)))
        return s.unit(narrowed(line + k.real(0.5) * (k.turn(qi, line) + k.turn(qj, line))))

    narrowed_spin = narrow_spin(s, k)

    @wp.func
    def load_turn(
        b: int,
        bond_i: wp.array(dtype=int),
        bond_j: wp.array(dtype=int),
        orientation: wp.array(dtype=k.real),
    ):
        """Vector and scalar part of the rotation from i to j."""
        turned = k.relative(
            k.load_rot(orientation, nn(get(bond_i, b))), k.load_rot(orientation, nn(get(bond_j, b)))
        )
        return narrowed_spin(k.axial(turned)), real(k.scalar(turned))

    return Laws(
        load_turn=load_turn,
        load_arm=load_arm,
        load_opening=load_opening,
        load_slips=load_slips,
        load_anchors=load_anchors,
        load_weights=load_weights,
        load_distance=load_distance,
        load_normals=load_normals,
        load_normal=load_normal,
    )
