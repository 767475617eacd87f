"""What was found wrong with a mesh, where, and what was done about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Finding:
    """One kind of fault in a mesh.

    kind              : str           open_edges, near_duplicate_vertices, degenerate_facets, duplicate_facets,
                                      mixed_winding, inverted, overlapping_bodies, several_bodies, ...
    count             : int           how many of them (facets, edges, vertices, bodies: the text says which)
    place             : (3,) float    the first of them, mm, or None where there is no one place
    mended            : bool          whether the mesh was changed so that the fault is gone
    volume_change_mm3 : float         by how much mending changed the enclosed volume
    text              : str           one line for a person
    """

    kind: str
    count: int
    place: NDArray[np.float64] | None
    mended: bool
    volume_change_mm3: float
    text: str

    def __str__(self) -> str:
        where = "" if self.place is None else f", first at {place_text(self.place)}"
        done = f"; mended, volume changed by {self.volume_change_mm3:.4g} mm³" if self.mended else ""
        return f"{self.text}{where}{done}"


def counted(count: int, noun: str) -> str:
    """A number with its noun, in the plural where it is not one: "1 hole", "3 holes", "2 bodies"."""
    plural = noun[:-1] + "ies" if noun.endswith("y") else noun + "s"
    return f"{count} {noun if count == 1 else plural}"


def place_text(place: ArrayLike) -> str:
    """A place in words.  place : (3,) float, mm."""
    values = [round(float(value), 3) + 0.0 for value in np.asarray(place, dtype=np.float64)]
    return "(" + ", ".join(f"{value:g}" for value in values) + ") mm"
