"""How a surface lies and bends: unit normals and curvatures at many parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.basis import Side
from planner.nurbs.surface import Surface

Floats = NDArray[np.float64]
Sides = tuple[Side, Side]

_DEGENERATE = 1e-10  # sine of the angle between S_u and S_v, or share of the longer by the shorter, taken as none


@dataclass(frozen=True, eq=False)
class SurfaceCurvature:
    """Curvatures at k parameters, 1/mm, > 0 where the surface bends away from its normal (convex from outside).

    largest, smallest     : (k,) float      Principal curvatures.
    along_largest, along_smallest : (k, 3)  Unit principal directions; any two at right angles where both are equal.
    NaN where the surface has no regular parametrisation (a pole, an apex).
    """

    largest: Floats
    smallest: Floats
    along_largest: Floats
    along_smallest: Floats

    @property
    def mean(self) -> Floats:
        """(k,) float, 1/mm   Half the sum of the principal curvatures."""
        return 0.5 * (self.largest + self.smallest)

    @property
    def gaussian(self) -> Floats:
        """(k,) float, 1/mm²   Their product."""
        return self.largest * self.smallest


def unit_normals(surface: Surface, u: ArrayLike, v: ArrayLike, sides: Sides = ("right", "right")) -> Floats:
    """Unit normals S_u x S_v / |S_u x S_v| at pairs of parameters: (k, 3) float.

    At a pole, where S_u or S_v vanishes, the limit along the other parameter (by S_uv); zero where there is none, as
    at the apex of a cone. Raises ValueError if the surface is not in space or a parameter lies outside the domain.
    """
    _in_space(surface)
    by = surface.derivatives(u, v, 2, sides)
    by_u, by_v, twist = by[1, 0], by[0, 1], by[1, 1]
    normal = np.cross(by_u, by_v)
    length = np.linalg.norm(normal, axis=1)
    speed_u, speed_v = np.linalg.norm(by_u, axis=1), np.linalg.norm(by_v, axis=1)
    longer = np.maximum(speed_u, speed_v)
    size = np.linalg.norm(twist, axis=1)
    poor = length <= _DEGENERATE * np.maximum(longer * longer, 1e-300)
    if poor.any():
        (_, u_end), (_, v_end) = surface.domain
        one, other = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        inward_v = np.where(np.broadcast_to(other, poor.shape) >= v_end, -1.0, 1.0)
        inward_u = np.where(np.broadcast_to(one, poor.shape) >= u_end, -1.0, 1.0)
        limit = np.where(
            (speed_u <= speed_v)[:, None],
            np.cross(twist, by_v) * inward_v[:, None],
            np.cross(by_u, twist) * inward_u[:, None],
        )
        reach = np.linalg.norm(limit, axis=1)
        limit[reach <= _DEGENERATE * np.maximum(longer * size, 1e-300)] = 0.0
        normal = np.where(poor[:, None], limit, normal)
        length = np.linalg.norm(normal, axis=1)
    return np.asarray(np.divide(normal, length[:, None], out=np.zeros_like(normal), where=length[:, None] > 0.0))


def curvatures(surface: Surface, u: ArrayLike, v: ArrayLike, sides: Sides = ("right", "right")) -> SurfaceCurvature:
    """Principal curvatures and directions at pairs of parameters, from both fundamental forms.

    The shape operator is taken in an orthonormal frame of the tangent plane, where it is symmetric.
    Raises ValueError if the surface is not in space or a parameter lies outside the domain.
    Source: do Carmo, Differential Geometry of Curves and Surfaces, ch. 3-3 (with the sign turned round).
    """
    _in_space(surface)
    by = surface.derivatives(u, v, 2, sides)
    by_u, by_v = by[1, 0], by[0, 1]
    normal = np.cross(by_u, by_v)
    area, speed = np.linalg.norm(normal, axis=1), np.linalg.norm(by_u, axis=1)
    longer = np.maximum(speed, np.linalg.norm(by_v, axis=1))
    regular = (area > _DEGENERATE * longer * longer) & (speed > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        n, x = normal / area[:, None], by_u / speed[:, None]
        y = np.cross(n, x)
        e, f, g = (-np.einsum("ij,ij->i", part, n) for part in (by[2, 0], by[1, 1], by[0, 2]))
        a = np.einsum("ij,ij->i", by_v, x)  # S_u = speed x,  S_v = a x + b y
        b = area / speed
        xx = e / speed**2
        xy = (f / speed - a * xx) / b
        yy = (g - a * a * xx - 2.0 * a * b * xy) / (b * b)
        middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
        turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        along = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
        across = np.cross(n, along)
    nowhere = np.where(regular, 1.0, np.nan)
    return SurfaceCurvature(
        (middle + half) * nowhere, (middle - half) * nowhere, along * nowhere[:, None], across * nowhere[:, None]
    )


def _in_space(surface: Surface) -> None:
    if surface.dimension != 3:
        raise ValueError(f"normals need a surface in space, not in {surface.dimension} dimensions")
