"""What is done in which order: deposit layer by layer, face and mill where due, every pass linked to the next."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from shapely import MultiPolygon

from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import outset
from planner.plan import Operation
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion, is_same
from planner.toolpath.balance import metal_mm3
from planner.toolpath.bands import Band
from planner.toolpath.beside import Stands
from planner.toolpath.bore import Boring, bore_operation
from planner.toolpath.cut import BULGE, Left, faced, left_findings, side_operations
from planner.toolpath.deposit import THINNEST, Dropped, deposit_operations, dropped_findings, grown_region, outside_mm
from planner.toolpath.links import Pose, linked, taken_up

Finished = Callable[[LayerRegion, list[Operation]], None]

RUNS_DOWN = 1.5
"""Of a track's height: how far below the surface that it is laid on it may wet a leaning wall."""
_HIGHER = 1e-3  # relative: a bead this much above what was asked is no rounding


@dataclass
class Sequence:
    """Operations as they are put in order, and the state of the part while they are.

    metal_top : highest metal, mm   above_mm : metal over the nominal top since the last facing
    here : where the tool is   deposited_mm3 : nominal   below : layer that was deposited last
    standing_mm : how high what else stands reaches under the ways   under : what stands below the base plane, as layers
    stands : what a cutter must keep clear of   bodies : the finished pieces among it, mm, piece frame   lean : how the head keeps clear of it
    last : operation   closing : linked operations that end the piece
    """

    settings: Settings
    standing_mm: float = 0.0
    under: list[LayerRegion] = field(default_factory=list)
    stands: Stands | None = None
    bodies: tuple[Mesh, ...] = ()
    lean: Callable[[Operation], Operation] = lambda operation: operation
    last: Operation | None = None
    closing: list[Operation] = field(default_factory=list)
    metal_top: float = 0.0
    above_mm: float = 0.0
    unfaced: int = 0
    here: Pose | None = None
    deposited_mm3: float = 0.0
    findings: list[str] = field(default_factory=list)
    below: LayerRegion | None = None
    dropped: list[Dropped] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    operations: dict[int, list[Operation]] = field(default_factory=dict)

    def add(self, operation: Operation, layer: int) -> None:
        """Link an operation to what comes before it and take it in."""
        here = self.here
        if self.stands is not None:
            here = taken_up(here, self.last, operation, is_beside=True)
        done, self.here = linked(operation, here, self.metal_top, self.settings, self.standing_mm)
        self.operations.setdefault(layer, []).append(done)
        self.last = done

    def deposit(self, layer: LayerRegion, bead: Bead, is_top: bool) -> None:
        """A layer's deposition.  is_top : part of its top is a finished face."""
        operations, dropped = deposit_operations(layer, bead, self.settings, is_top, below=self.below)
        self.below = layer
        self.dropped.extend(dropped)
        self.above_mm += max(bead.height_mm - layer.height_mm, 0.0)
        self.unfaced += 1
        self.metal_top = layer.z_top + self.above_mm + max(bead.crest_mm - bead.height_mm, 0.0)
        for operation in operations:
            self.add(self.lean(operation), layer.index)
            self.deposited_mm3 += metal_mm3(operation.passes, self.settings)

    def face(self, layer: LayerRegion, metal: MultiPolygon) -> None:
        """The facing of a layer's top, with the small cutter where what stands beside keeps the other away."""
        for operation in faced(metal, layer, self.above_mm, self.settings, self.stands, self.left):
            self.add(operation, layer.index)
        self.metal_top, self.above_mm, self.unfaced = layer.z_top, 0.0, 0

    def mill(self, band: Band, below: list[LayerRegion], excess_mm: float, run_down_mm: float) -> None:
        """The milling of a band's walls."""
        if self.under and band.first == 0:
            band = replace(band, continues=is_same(self.under[-1].areas[2], band.region, 0.01))
        operations, left = side_operations(
            band, [*self.under, *below], excess_mm, run_down_mm, self.settings, stands=self.stands, others=self.bodies
        )
        self.left.extend(left)
        for operation in operations:
            self.add(operation, band.last)

    def bore(self, boring: Boring, layer: int) -> None:
        """The boring of a hole from the side."""
        assert self.here is not None  # the metal that it is cut in was deposited
        done, self.here = bore_operation(boring, layer, self.here, max(self.metal_top, self.standing_mm))
        self.operations.setdefault(layer, []).append(done)


def build_up(
    layers: list[LayerRegion],
    beads: list[Bead],
    tops: list[bool],
    bands: Iterable[Band],
    settings: Settings,
    finished: Finished,
    borings: Iterable[Boring] = (),
    *,
    begun: Sequence | None = None,
) -> Sequence:
    """The operations of a part that is deposited (and, where there are bands, milled), from the substrate up.

    tops : which layers have a finished face   bands : of all layers from below, taken one by one as the part grows, or
    none for a part that is only deposited   finished : told each layer and its operations when none will be added
    borings : holes that are cut from the side when all layers stand   begun : with what stands before; none: the plate.
    Raises PlanningError if no bead fits anywhere.
    """
    sequence = begun if begun is not None else Sequence(settings)
    following = iter(bands)
    current: Band | None = None
    for layer, bead, is_top in zip(layers, beads, tops, strict=True):
        if current is None or current.last < layer.index:
            current = next(following, None)
        sequence.deposit(layer, bead, is_top)
        band = current if current is not None and current.last == layer.index else None
        if settings.is_milled:
            if band is not None or _is_face_due(sequence, layer, bead, layer.index == len(layers) - 1):
                sequence.face(layer, outset(grown_region(layer, bead, settings), BULGE * bead.width_mm, 0.01))
            if band is not None:
                run_down = RUNS_DOWN * beads[band.first].crest_mm
                sequence.mill(band, layers[: band.first], _excess_mm(band, layers, beads, settings), run_down)
        if layer.index == len(layers) - 1:
            for boring in borings:
                sequence.bore(boring, layer.index)
            sequence.operations.setdefault(layer.index, []).extend(sequence.closing)
        finished(layer, sequence.operations.get(layer.index, []))
    if not any(sequence.operations.values()):
        raise PlanningError(
            f"nothing can be deposited: all walls are thinner than {THINNEST * beads[0].width_mm:.2f} mm, "
            f"{THINNEST:g} of the bead's width",
            "choose less power, more speed or a larger stock allowance",
        )
    sequence.findings += [*dropped_findings(sequence.dropped), *left_findings(sequence.left, settings)]
    return sequence


def _is_face_due(sequence: Sequence, layer: LayerRegion, bead: Bead, is_last: bool) -> bool:
    settings = sequence.settings
    every = settings.recipe.face_every_layers
    too_high = bead.height_mm > layer.height_mm * (1.0 + settings.overbuild) * (1.0 + _HIGHER)
    piled = sequence.above_mm >= settings.material.milling.axial_depth_mm
    return is_last or too_high or piled or (every is not None and sequence.unfaced >= every)


def _excess_mm(band: Band, layers: list[LayerRegion], beads: list[Bead], settings: Settings) -> float:
    """How far metal may stand out of a band's walls, mm: allowance, edge strip, bulge, and the steps of leaning layers."""
    tracks = beads[band.first : band.last + 1]
    return max(outside_mm(bead, settings) + BULGE * bead.width_mm for bead in tracks) + _leaning_out(band, layers)


def _leaning_out(band: Band, layers: list[LayerRegion]) -> float:
    """How far the layers of a leaning band stand out beyond its ruled wall, mm: each is as wide as its widest section."""
    if band.kind != "ruled":
        return 0.0
    out = 0.0
    for layer in layers[band.first : band.last + 1]:
        narrow = min((area for area in layer.areas if not area.is_empty), key=lambda area: area.area)
        out = max(out, float(narrow.boundary.hausdorff_distance(layer.region.boundary)))
    return out
