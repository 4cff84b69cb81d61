"""The plane along which a body broke, from the places of its broken bonds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import Array, InputError, finite, positive

FEWEST = 8  # broken bonds that a plane is fitted to
TURNS = 180  # directions tried in the plane, and their square root's measure in space
REFINEMENTS = 5


@dataclass(frozen=True)
class FracturePlane:
    """The densest band of broken bonds: a point [m] of its middle plane, the unit normal, and the
    share of the broken bonds that lie in it."""

    point: Array
    normal: Array
    share: float

    def angle_to(self, axis: ArrayLike) -> float:
        """Angle between the plane and an axis [degrees], 0 to 90."""
        a = finite("axis", axis, self.normal.shape)
        sine = abs(float(a @ self.normal)) / float(np.linalg.norm(a))
        return float(np.degrees(np.arcsin(min(1.0, sine))))


def fracture_plane(broken: ArrayLike, elements: ArrayLike, width: float) -> FracturePlane | None:
    """The band of broken bonds that stands out most from an even spread; None of too few bonds.

    broken (m, dim), elements (n, dim): places of broken bonds and of all elements [m]; width [m]:
    of the band. Of bands in all directions (a Hough transform) the one whose count c has the
    greatest likelihood ratio c ln(c/e) - (c - e) is taken, e being what the same number of bonds
    spread as the elements are would have there; then its normal is that of the principal axes of
    the bonds in it.
    """
    x, body = finite("broken", broken, (None, None)), finite("elements", elements, (None, None))
    positive("width", width, ())
    if x.shape[1] != body.shape[1]:
        raise InputError("broken and elements must have the same dimension.")
    if len(x) < FEWEST:
        return None
    normal, at = _densest(x, body, width)
    point = at * normal
    for _ in range(REFINEMENTS):
        near = x[np.abs((x - point) @ normal) <= 0.5 * width]
        if len(near) < FEWEST:
            break
        point = near.mean(axis=0)
        _, size, axes = np.linalg.svd(near - point, full_matrices=False)
        if size[-1] > 0.5 * size[-2]:  # a blot has no direction
            break
        normal = axes[-1]
    share = float((np.abs((x - point) @ normal) <= 0.5 * width).mean())
    return FracturePlane(point, normal * np.where(normal[-1] < 0.0, -1.0, 1.0), share)


def _densest(x: Array, body: Array, width: float) -> tuple[Array, float]:
    """Normal of the densest band, and the place of its middle along it [m]."""
    best, found = -1.0, (np.zeros(x.shape[1]), 0.0)
    for normal in _directions(x.shape[1]):
        along, spread = x @ normal / width, body @ normal / width
        for shift in (0.0, 0.5):
            low = int(np.floor(min(along.min(), spread.min()) + shift))
            c, n = (np.bincount(np.floor(s + shift).astype(int) - low) for s in (along, spread))
            count = np.zeros(max(len(c), len(n)))
            count[: len(c)] = c
            even = np.ones_like(count)  # at least one, so that a corner counts for nothing
            even[: len(n)] = np.maximum(n * len(x) / len(body), 1.0)
            ratio = count * np.log(np.maximum(count, 1.0) / even) - (count - even)
            ratio[count <= even] = 0.0
            k = int(np.argmax(ratio))
            if ratio[k] > best:
                best, found = float(ratio[k]), (normal, (k + low + 0.5 - shift) * width)
    return found


def _directions(dim: int) -> Array:
    """Unit vectors spread evenly over half a circle or half a sphere."""
    if dim == 2:
        turn = np.pi * np.arange(TURNS) / TURNS
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)
    count = TURNS * 8
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)  # golden angle
    r = np.sqrt(1.0 - z**2)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
