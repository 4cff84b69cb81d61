"""Vortices of a plane velocity field: where material turns about a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import Array, InputError, finite, positive

# |Gamma_1| above which a point is taken for a vortex's centre: of solid rotation it is 1, of a
# shear layer 2/pi (Graftieaux, Michard and Grosjean 2001)
LEAST_SWIRL = 2.0 / np.pi


@dataclass(frozen=True, eq=False)
class Vortex:
    """A point about which material turns.

    centre [m], (2,); swirl: Gamma_1 there, from -1 to 1, 1 where all of it turns counterclockwise;
    circulation [m^2/s]: greatest in size of circles about the centre, with its radius [m];
    vorticity [1/s]: mean inside the detector's radius.
    """

    centre: Array
    swirl: float
    circulation: float
    radius: float
    vorticity: float

    @property
    def sign(self) -> int:
        """1 counterclockwise, -1 clockwise."""
        return 1 if self.swirl > 0.0 else -1


@dataclass(frozen=True, eq=False)
class PlaneField:
    """Velocities on a square grid: x (m,), y (k,) [m], velocity (k, m, 2) [m/s]; NaN outside the
    body."""

    x: Array
    y: Array
    velocity: Array

    @property
    def step(self) -> float:
        """Distance of grid points [m]."""
        return float(self.x[1] - self.x[0])

    @property
    def vorticity(self) -> Array:
        """dv_y/dx - dv_x/dy [1/s], (k, m)."""
        v = self.velocity
        curl: Array = np.gradient(v[..., 1], self.step, axis=1)
        return curl - np.gradient(v[..., 0], self.step, axis=0)

    def smoothed(self, width: float) -> PlaneField:
        """Without the shaking of single elements: by Gauss's filter of a standard deviation [m],
        to which points outside the body do not count."""
        from scipy.ndimage import gaussian_filter

        inside = np.isfinite(self.velocity[..., 0])
        weight = np.maximum(gaussian_filter(inside.astype(float), width / self.step), 1e-12)
        velocity = np.full_like(self.velocity, np.nan)
        for k in (0, 1):
            filled = gaussian_filter(np.nan_to_num(self.velocity[..., k]), width / self.step)
            velocity[inside, k] = (filled / weight)[inside]
        return PlaneField(self.x, self.y, velocity)


def on_grid(
    position: ArrayLike, velocity: ArrayLike, low: ArrayLike, high: ArrayLike, step: float,
    smooth: float = 0.0,
) -> PlaneField:  # fmt: skip
    """Velocities (n, 2) of elements interpolated linearly to a grid between two corners [m].

    smooth [m]: width of `PlaneField.smoothed`.
    """
    from scipy.interpolate import LinearNDInterpolator

    x = finite("position", position, (None, 2))
    v = finite("velocity", velocity, (len(x), 2))
    a, b = finite("low", low, (2,)), finite("high", high, (2,))
    positive("step", step, ())
    if not (b > a + step).all():
        raise InputError("the upper corner must lie above the lower one by more than a step.")
    beyond = 4.0 * step + 3.0 * smooth
    near = ((x > a - beyond) & (x < b + beyond)).all(axis=1)
    if near.sum() < 4:
        raise InputError("there are no elements between the corners; move them into a body.")
    axes = [np.arange(a[k], b[k] + 0.5 * step, step) for k in (0, 1)]
    grid = np.stack(np.meshgrid(*axes), axis=-1)
    field = LinearNDInterpolator(x[near], v[near])(grid)
    plane = PlaneField(axes[0], axes[1], field)
    return plane.smoothed(smooth) if smooth > 0.0 else plane


def find_vortices(field: PlaneField, radius: float, least: float = LEAST_SWIRL) -> list[Vortex]:
    """Vortices of a field, strongest swirl first.

    radius [m]: of the disc over which Gamma_1, the mean sine of the angle between place and
    velocity about a point, is taken; a vortex is a local extremum of it above `least` in size
    (Graftieaux et al. 2001). Found in the frame in which the velocities are given.
    """
    from scipy.interpolate import RegularGridInterpolator
    from scipy.ndimage import maximum_filter
    from scipy.signal import fftconvolve

    positive("radius", radius, ())
    reach = round(radius / field.step)
    if reach < 2:
        raise InputError(
            f"the radius {radius:g} m must be at least two steps of the grid, {field.step:g} m."
        )
    size = np.linalg.norm(field.velocity, axis=2)
    inside = np.isfinite(size) & (size > 0.0)
    unit = np.where(inside[..., None], field.velocity / np.where(inside, size, 1.0)[..., None], 0.0)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    r = np.hypot(x, y)
    disc = ((r <= reach + 0.5) & (r > 0.0)).astype(float)
    r[reach, reach] = 1.0

    def mean(values: Array, kernel: Array) -> Array:
        return fftconvolve(values, kernel[::-1, ::-1], mode="same")

    count = mean(inside.astype(float), disc)
    swirl = mean(unit[..., 1], disc * x / r) - mean(unit[..., 0], disc * y / r)
    swirl = np.where(inside & (count > 0.7 * disc.sum()), swirl / np.maximum(count, 1.0), 0.0)

    strength = np.abs(swirl)
    peak = (strength >= least) & (strength == maximum_filter(strength, 2 * reach + 1))
    rows, columns = np.nonzero(peak)
    centres = np.stack([field.x[columns], field.y[rows]], axis=1)
    signs = np.sign(swirl[rows, columns])
    curl = np.nan_to_num(field.vorticity)
    vorticity = mean(curl, disc) / max(disc.sum(), 1.0)
    at = RegularGridInterpolator(
        (field.y, field.x), field.velocity, bounds_error=False, fill_value=np.nan
    )
    found = []
    for k in np.argsort(-strength[rows, columns]):
        others = np.linalg.norm(centres - centres[k], axis=1)[signs != signs[k]]
        most = 0.5 * others.min() if len(others) else 4.0 * radius
        circulation, circle = _circulation(at, centres[k], field.step, max(most, radius))
        place = rows[k], columns[k]
        found.append(
            Vortex(
                centres[k], float(swirl[place]), circulation, circle, float(vorticity[place])
            )
        )  # fmt: skip
    return found


def _circulation(at: object, centre: Array, step: float, most: float) -> tuple[float, float]:
    """Greatest circulation of circles about a centre, up to a radius, and that radius."""
    angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.stack([-ring[:, 1], ring[:, 0]], axis=1)
    best, radius = 0.0, step
    for r in np.arange(step, most + 0.5 * step, step):
        v = at((centre + r * ring)[:, ::-1])  # type: ignore[operator]
        if not np.isfinite(v).all():
            break
        total = float(2.0 * np.pi * r * (v * along).sum(axis=1).mean())
        if abs(total) > abs(best):
            best, radius = total, float(r)
    return best, radius
