"""The estimate: division, layers, time and powder, and what that costs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from config.cell import Cell
from planner.decompose.division import divide
from planner.decompose.pieces import Division
from planner.errors import PlanningError
from planner.estimate.prices import Cost, Missing, cost_of
from planner.estimate.slabs import sliced_pieces
from planner.estimate.work import Book, book_of
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe

TIME_SHARE = 0.25
"""Relative: how far the plan's own time may be from the estimate; measured against the plans of the paper's four parts."""
POWDER_SHARE = 0.20


@dataclass(frozen=True)
class Estimate:
    """What a part would take.  Times s, masses g, volumes mm³, lengths mm.

    layers : as many as the plan would have, about   thickness_mm : least and greatest   direction : of the first piece, part frame
    times_s : deposit, mill, changes, interpass, waits; build_time_s their sum   time_range_s, powder_range_g : within which the plan is expected
    mass_g : of the finished part   cost : None while a rate is missing, see `missing`   basis : how it was found, one line each
    """

    material: str
    process: str
    layers: int
    thickness_mm: tuple[float, float]
    direction: tuple[float, float, float]
    pieces: int
    setups: int
    build_time_s: float
    time_range_s: tuple[float, float]
    times_s: dict[str, float]
    laser_s: float
    powder_g: float
    powder_range_g: tuple[float, float]
    mass_g: float
    deposited_mm3: float
    milled_mm3: float
    gas_l: float
    cost: Cost | None
    missing: tuple[Missing, ...]
    uncertainty: float
    basis: tuple[str, ...]


def estimate(mesh: Mesh, recipe: Recipe, cell: Cell, *, division: Division | None = None) -> Estimate:
    """Layers, time, powder and cost of a part, from its sections alone: no contour is fitted and no pass is made.

    mesh : part frame, mm, closed   division : of an earlier estimate of the same mesh, direction and cuts, to save its time.
    Raises RecipeError or PlanningError as the planner would; a part milled from a block is refused, its metal is not deposited.
    """
    if recipe.process == "mill":
        raise PlanningError("process = mill: a part milled from a block is not estimated", "submit it: its plan says how long it takes")
    settings = Settings.from_recipe(recipe)
    divided = division if division is not None else divide(mesh, recipe, settings)
    book = book_of(sliced_pieces(divided, settings), settings, cell)
    return _told(mesh, recipe, settings, divided, book, cell)


def _told(mesh: Mesh, recipe: Recipe, settings: Settings, division: Division, book: Book, cell: Cell) -> Estimate:
    facts = settings.material
    gas_l = (facts.deposition.carrier_gas_l_min.usual + facts.deposition.shield_gas_l_min.usual) * book.deposit_s / 60.0
    cost, missing = cost_of(book.total_s, book.powder_g, gas_l, facts, cell)
    directions = [tuple(round(float(value), 6) for value in piece.direction) for piece in division.pieces]
    up = division.build_from_part[2, :3]
    return Estimate(
        material=facts.name,
        process=recipe.process,
        layers=book.layers,
        thickness_mm=(min(book.thickness_mm), max(book.thickness_mm)),
        direction=(float(up[0]) + 0.0, float(up[1]) + 0.0, float(up[2]) + 0.0),
        pieces=len(division.pieces),
        setups=1 + sum(a != b for a, b in pairwise(directions)),
        build_time_s=book.total_s,
        time_range_s=((1.0 - TIME_SHARE) * book.total_s, (1.0 + TIME_SHARE) * book.total_s),
        times_s={
            "deposit": book.deposit_s,
            "mill": book.mill_s,
            "changes": book.changes_s,
            "interpass": book.interpass_s,
            "waits": book.waits_s,
        },
        laser_s=book.laser_s,
        powder_g=book.powder_g,
        powder_range_g=((1.0 - POWDER_SHARE) * book.powder_g, (1.0 + POWDER_SHARE) * book.powder_g),
        mass_g=mesh.volume * facts.density_g_mm3,
        deposited_mm3=book.deposited_mm3,
        milled_mm3=max(book.deposited_mm3 - mesh.volume, 0.0) if settings.is_milled else 0.0,
        gas_l=gas_l,
        cost=cost,
        missing=missing,
        uncertainty=TIME_SHARE,
        basis=_basis(recipe, settings, book),
    )


def _basis(recipe: Recipe, settings: Settings, book: Book) -> tuple[str, ...]:
    """How the figures were found, and what they leave out."""
    lines = [
        f"{book.layers} layers by the recipe's rule, each with its own section; beads of {settings.material.name} by area",
        "walls by outline and cutting depths, tops by area, tools by the number of changes; no pass was made and no collision looked for",
    ]
    if book.stepped:
        lines.append(f"walls of {book.stepped} layers are too curved or too flat for a cutter's flank: milled in steps of half the tolerance")
    if settings.max_interpass_k is not None:
        lines.append("waiting until the part has cooled (max_interpass_k) is not in it")
    if recipe.layer_height_mm is None and recipe.layer_rule != "facet":
        lines.append(f"layers are counted by the rule facet, not {recipe.layer_rule}")
    return tuple(lines)
