"""How long the layers of an estimate take and what they use: beads by area, walls by outline, tops by area, changes by count."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import shapely

from config.cell import Cell
from planner.decompose.bores import Bore
from planner.estimate.slabs import Slab, Sliced
from planner.process import Bead, Settings
from planner.toolpath.contour import edge_mm
from planner.toolpath.cut import BULGE
from planner.toolpath.deposit import outside_mm
from planner.toolpath.face import widest_step_mm
from planner.toolpath.pattern import TOP_DENSER
from planner.toolpath.side import wall_offsets
from planner.toolpath.tops import TOP_RESERVE

BEAD_LINK_S = 0.18  # between two beads: laser off, a short way; mean of the posted programs of the paper's four parts
CUT_LINK_S = 0.33  # between two cuts: lifted, over and down; same mean
APPROACH_S = 3.4  # from the change position to the first pass; same mean
_LEADS_MM = 10.0  # on to a wall and off it, for each cut round it
_EVEN_SHARE = 0.01  # of a region that is left a little over half its mean width inside: less, and it is a strip of even width
_STEP_SHARE = 0.5  # of the tolerance: height of the steps of a wall that no flank follows
_RUN_DOWN_LAYERS = 2.0  # how far below a stepped wall the metal that ran down is looked for
_CRUMB_MM2 = 0.5  # of inside corners that a cutter does not reach: less is rounding
_RAMP = math.tan(math.radians(3.0))  # of a helix into a bore
_CORELESS = 0.45  # of the cutter's diameter: greatest radius of that helix
_SETTLED = math.log(20.0)  # time constants until a flow is steady within 5 %


@dataclass
class Book:
    """What adds up.  Times in s, volumes in mm³.

    deposit_s : laser passes and ways between them   mill_s : the same of cutters   changes_s : of tools, spindle and approach
    interpass_s : layers that wait for the one before   waits_s : head slide, purge, powder until it is steady
    layer_powder_g : per layer   stepped, layers : how many layers are milled in steps, and how many there are
    """

    deposit_s: float = 0.0
    mill_s: float = 0.0
    changes_s: float = 0.0
    interpass_s: float = 0.0
    waits_s: float = 0.0
    powder_g: float = 0.0
    deposited_mm3: float = 0.0
    laser_s: float = 0.0
    layers: int = 0
    stepped: int = 0
    thickness_mm: list[float] = field(default_factory=list)
    last_layer_s: float = math.inf

    @property
    def total_s(self) -> float:
        """All of it."""
        return self.deposit_s + self.mill_s + self.changes_s + self.interpass_s + self.waits_s


def book_of(pieces: Sequence[Sliced], settings: Settings, cell: Cell) -> Book:
    """The time and metal of all pieces, one after the other.  Raises RecipeError where no bead fills a layer."""
    book = Book()
    for piece in pieces:
        _Piece(book, settings, cell).build(piece)
    return book


class _Piece:
    """One piece as it grows: layers since the last milling, height since the last facing."""

    def __init__(self, book: Book, settings: Settings, cell: Cell) -> None:
        self.book, self.settings, self.cell = book, settings, cell
        self.small = settings.with_small_cutter()
        self.band: list[tuple[Slab, Bead]] = []
        self.above_mm = 0.0
        self.unfaced = 0

    def build(self, piece: Sliced) -> None:
        """Deposit and mill layer by layer."""
        for number, slab in enumerate(piece.slabs):
            following = piece.slabs[number + 1] if number + 1 < len(piece.slabs) else None
            before = self.book.total_s
            self._wait()
            begun = self.book.total_s
            bead = self.settings.bead_for(slab.height_mm, TOP_RESERVE if slab.is_top else 0.0)
            self._deposit(slab, bead)
            if self.settings.is_milled:
                self._mill(slab, bead, following)
            if following is None:
                self.book.mill_s += sum(_bore_s(bore, self.settings) for bore in piece.bores)
            self.book.last_layer_s = self.book.total_s - (begun if before else 0.0)
            self.book.layers += 1
            self.book.thickness_mm.append(slab.height_mm)

    def _wait(self) -> None:
        self.book.interpass_s += max(self.settings.interpass_s - self.book.last_layer_s, 0.0)

    def _deposit(self, slab: Slab, bead: Bead) -> None:
        step = bead.step_mm / (TOP_DENSER if slab.is_top else 1.0)
        grown = _grown(slab.region, self.settings.allowance_mm + 0.5 * edge_mm(bead, self.settings))
        length = max(grown.area / step, 0.5 * slab.region.length)
        passes = _pass_count(grown, step)
        facts = self.settings.material.deposition
        lit_s = (length + passes * (facts.lead_in_mm + facts.lead_out_mm)) / bead.speed_mm_s
        self.book.laser_s += length / bead.speed_mm_s
        self.book.deposit_s += lit_s + passes * BEAD_LINK_S
        self.book.powder_g += lit_s * bead.powder_g_min / 60.0
        self.book.deposited_mm3 += length * bead.area_mm2
        self.above_mm += max(bead.height_mm - slab.height_mm, 0.0)
        self.unfaced += 1

    def _mill(self, slab: Slab, bead: Bead, following: Slab | None) -> None:
        self.band.append((slab, bead))
        is_due = self._ends(following)
        if not (is_due or self._is_face_due(slab, bead)):
            return
        self._change(self.settings)
        self._face(slab, bead)
        if is_due:
            self._walls()
            self.band = []
        self._back_to_head(bead)

    def _ends(self, following: Slab | None) -> bool:
        """Whether the walls are milled before the next layer: as in `planner.toolpath.bands`."""
        last = self.band[-1][0]
        if following is None or last.is_stepped or following.is_stepped or not following.goes_on:
            return True
        if following.is_upright != last.is_upright:
            return True
        most = self.settings.recipe.mill_every_layers
        height = sum(slab.height_mm for slab, _ in self.band) + following.height_mm
        return height > self.settings.mill_every_mm + 1e-9 or (most is not None and len(self.band) >= most)

    def _is_face_due(self, slab: Slab, bead: Bead) -> bool:
        every = self.settings.recipe.face_every_layers
        too_high = bead.height_mm > slab.height_mm * (1.0 + self.settings.overbuild) * 1.001
        return too_high or self.above_mm >= self.settings.material.milling.axial_depth_mm or (every is not None and self.unfaced >= every)

    def _face(self, slab: Slab, bead: Bead) -> None:
        metal = _grown(slab.region, outside_mm(bead, self.settings) + BULGE * bead.width_mm)
        cuts = max(1, math.ceil((self.above_mm - 1e-9) / self.settings.material.milling.axial_depth_mm))
        pieces = len(shapely.get_parts(metal))
        length = cuts * (metal.area / widest_step_mm(self.settings) + pieces * self.settings.cutter_diameter_mm)
        self.book.mill_s += length / self.settings.mill_feed_mm_s + cuts * pieces * CUT_LINK_S
        self.above_mm, self.unfaced = 0.0, 0

    def _walls(self) -> None:
        slabs = [slab for slab, _ in self.band]
        region = slabs[0].region if len(slabs) == 1 or slabs[0].is_upright else shapely.union_all([slab.region for slab in slabs])
        excess = max(outside_mm(bead, self.settings) + BULGE * bead.width_mm for _, bead in self.band)
        out = max(slab.out_mm for slab in slabs)
        if slabs[0].is_stepped:
            step = _STEP_SHARE * self.settings.recipe.tolerance_mm
            below = min(_RUN_DOWN_LAYERS * self.settings.layer_max_mm, slabs[0].room_mm)
            self._round(region, excess + 0.5 * out, math.ceil(slabs[0].height_mm / step), self.settings)
            self._round(region, excess, int(below / step), self.settings)
            self.book.stepped += 1
        else:
            self._round(region, excess + out, 1, self.settings)
        if self.small is None:
            return
        left = _unreached(region, self.settings.cutter_radius_mm)
        if left.area > _CRUMB_MM2:
            self._change(self.small)
            self._round(left, excess, 1, self.small)

    def _round(self, region: shapely.Geometry, excess_mm: float, levels: int, cutter: Settings) -> None:
        """Cuts round an outline, by the radial depth, on some levels."""
        for leave in wall_offsets(excess_mm, cutter.material.milling.radial_depth_mm):
            centre = _grown(region, cutter.cutter_radius_mm + leave)
            loops = sum(1 + len(polygon.interiors) for polygon in shapely.get_parts(centre))
            length = centre.length + loops * _LEADS_MM
            self.book.mill_s += levels * (length / cutter.mill_feed_mm_s + loops * CUT_LINK_S)

    def _change(self, cutter: Settings) -> None:
        response = self.cell.response
        self.book.changes_s += response.tool_change_s + APPROACH_S + cutter.spindle_rpm / response.spindle_rpm_per_s

    def _back_to_head(self, bead: Bead) -> None:
        """To the head again, and the waits of both ways: purge and slide, then powder until it flows."""
        response = self.cell.response
        flow_s = response.powder_delay_s + _SETTLED * response.powder_settle_s
        self.book.changes_s += response.tool_change_s + APPROACH_S
        self.book.waits_s += 2.0 * flow_s + self.cell.limits.purge_s + 2.0 * response.head_slide_s
        self.book.powder_g += flow_s * bead.powder_g_min / 60.0


def _grown(region: shapely.Geometry, by_mm: float) -> shapely.Geometry:
    return shapely.buffer(region, by_mm, quad_segs=8) if by_mm > 0.0 else region


def _pass_count(grown: shapely.Geometry, step_mm: float) -> float:
    """Beads of a region: rings where it is a strip of even width, else the chords of a hatch, outline / (π step) (Crofton)."""
    count = 0.0
    for part in shapely.get_parts(grown):
        mean = 2.0 * part.area / max(part.length, 1e-9)
        is_strip = len(part.interiors) > 0 and shapely.buffer(part, -0.55 * mean).area <= _EVEN_SHARE * part.area
        count += 1.0 if is_strip else 1.0 + len(part.interiors) + part.length / (math.pi * step_mm)
    return count


def _unreached(region: shapely.Geometry, radius_mm: float) -> shapely.Geometry:
    """What a cutter leaves beside an outline: narrow gaps and inside corners, mm."""
    closed = shapely.buffer(shapely.buffer(region, radius_mm, quad_segs=8), -radius_mm, quad_segs=8)
    return shapely.buffer(shapely.difference(closed, shapely.buffer(region, 0.05)), 0.0)


def _bore_s(bore: Bore, settings: Settings) -> float:
    """s to cut a bore: helices and rings by the axial and the radial depth, once round at the end."""
    milling = settings.material.milling
    cutter = settings if bore.radius_mm > settings.cutter_radius_mm else settings.with_small_cutter() or settings
    reach = max(bore.radius_mm - cutter.cutter_radius_mm, 0.1)
    helix = min(reach, _CORELESS * cutter.cutter_diameter_mm)
    rings = max(0, math.ceil((reach - helix) / milling.radial_depth_mm))
    levels = max(1, math.ceil(bore.depth_mm / milling.axial_depth_mm))
    turn = 2.0 * math.pi * helix
    down = max(bore.depth_mm / _RAMP, levels * turn) + levels * turn
    outward = levels * sum(2.0 * math.pi * (helix + (reach - helix) * (k + 1) / max(rings, 1)) for k in range(rings))
    return (down + outward + 2.0 * math.pi * reach) / cutter.mill_feed_mm_s
