"""How much of a part can be built from each direction without support, and from several in turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.decompose.grown import Cells, cells_along, grow
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WORTH = 0.005  # of the part: what a further direction must add to be counted
MOST_TURNED_DEG = 100.0  # of any direction from the first: beyond it the plate is in the way of the head
_MOST = 4  # directions in a set: each is another set-up


@dataclass(frozen=True, eq=False)
class Shares:
    """What of a part's volume can be built without support, 0 … 1.

    directions : (k, 3) float, unit   upright : (k,) float, standing on the plate with the head along the direction
    tilted : (k,) float, the same with the head tilted along the walls
    order : a set of directions, the best first, each adding most to those before it, head upright
    together : share after each of them
    """

    directions: Floats
    upright: Floats
    tilted: Floats
    order: tuple[int, ...]
    together: tuple[float, ...]


def buildable_shares(
    mesh: Mesh, directions: ArrayLike, limit_deg: float, tilted_deg: float | None = None, most: int = _MOST
) -> Shares:
    """The share of the part that each direction makes, and a set of them in turn.

    directions : (k, 3) float, unit, of the part's frame   limit_deg : lean of a wall that holds upright
    tilted_deg : with the head tilted along it; None: the head is not tilted   most : directions in the set.
    The set is found step by step, the head upright: the direction that makes most, then the one that adds most to what
    stands by then, within 100 degrees of the first. The part is looked at in cells of a hundredth of its size: shares are good to a
    few percent of it.
    """
    along = np.atleast_2d(np.asarray(directions, dtype=np.float64))
    parts = [cells_along(mesh, direction, limit_deg) for direction in along]
    upright = np.array([_share(cells, grow(cells, limit_deg, None, on_plate=True)) for cells in parts])
    tilted = upright
    if tilted_deg is not None:
        tilting = [cells_along(mesh, direction, tilted_deg) for direction in along]
        tilted = np.array([_share(cells, grow(cells, tilted_deg, None, on_plate=True)) for cells in tilting])
    return _with_set(along, parts, limit_deg, upright, np.maximum(tilted, upright), most)


def report(shares: Shares) -> list[str]:
    """Lines for a plan's findings: the set of directions with the head upright, and what single directions make."""
    first, *others = shares.order
    line = f"direction {_text(shares.directions[first])} makes {_percent(shares.upright[first])} of the part without support"
    for number, share in zip(others, shares.together[1:], strict=True):
        line += f", with {_text(shares.directions[number])} {_percent(share)}"
    ranked = sorted(range(len(shares.upright)), key=lambda k: (-round(float(shares.upright[k]), 3), k))
    single = [
        f"{_text(shares.directions[k])} {_percent(shares.upright[k])} and {_percent(shares.tilted[k])}"
        for k in ranked[:4]
    ]
    return [line, "share that a direction makes alone, head upright and tilted over overhangs: " + ", ".join(single)]


@dataclass(frozen=True, eq=False)
class _Built:
    """What stands, in the cells of one direction."""

    cells: Cells
    made: Flags

    @property
    def share(self) -> float:
        """Of the part."""
        return _share(self.cells, self.made)

    def joined(self, cells: Cells, limit_deg: float) -> _Built:
        """What stands when building went on along another direction, in the same cells as before."""
        centres, numbers = cells.centres()
        here = self.cells.holding(centres)
        seeds = np.zeros(cells.solid.size, dtype=np.bool_)
        seeds[numbers] = (here >= 0) & self.made.ravel()[here]
        grown = grow(cells, limit_deg, seeds.reshape(cells.solid.shape), on_plate=False)
        own, flat = self.cells.centres()
        there = cells.holding(own)
        more = self.made.copy().ravel()
        more[flat] |= (there >= 0) & grown.ravel()[there]
        return _Built(self.cells, more.reshape(self.made.shape))


def _with_set(
    directions: Floats, parts: list[Cells], limit_deg: float, upright: Floats, tilted: Floats, most: int
) -> Shares:
    """The shares with a set of directions, found step by step."""
    best = max(range(len(directions)), key=lambda k: (round(float(upright[k]), 3), round(float(tilted[k]), 3), -k))
    built = _Built(parts[best], grow(parts[best], limit_deg, None, on_plate=True))
    order, together = [best], [float(upright[best])]
    allowed = directions @ directions[best] > np.cos(np.radians(MOST_TURNED_DEG))
    while len(order) < most and together[-1] < 1.0 - WORTH:
        further = {k: built.joined(parts[k], limit_deg) for k in np.flatnonzero(allowed).tolist() if k not in order}
        if not further:
            break
        chosen = max(further, key=lambda k: (round(further[k].share, 3), -k))
        if further[chosen].share - built.share < WORTH:
            break
        built = further[chosen]
        order.append(chosen)
        together.append(max(built.share, together[-1]))
    return Shares(directions, upright, tilted, tuple(order), tuple(together))


def _share(cells: Cells, made: Flags) -> float:
    solid = int(np.count_nonzero(cells.solid))
    return int(np.count_nonzero(made)) / solid if solid else 0.0


def _text(direction: Floats) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in np.round(direction, 3) + 0.0) + ")"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"
