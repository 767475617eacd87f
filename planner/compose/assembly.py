"""The pieces of a division made one after the other: layers numbered through, set-ups, findings by piece, volumes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from planner.compose.heating import HeatCourse
from planner.compose.made import Made
from planner.compose.setups import setups_of
from planner.compose.standing import Standing
from planner.compose.straight import straight_piece
from planner.compose.turning import turning_piece
from planner.compose.work import Work
from planner.decompose.pieces import Division, Piece
from planner.plan import Layer, Setup, Subcomponent
from planner.process import Settings

Say = Callable[[str, float], None]


@dataclass(frozen=True)
class Assembly:
    """All pieces, made.  volumes_mm3 : as in the Plan."""

    layers: tuple[Layer, ...]
    subcomponents: tuple[Subcomponent, ...]
    setups: tuple[Setup, ...]
    findings: tuple[str, ...]
    volumes_mm3: dict[str, float]


def assemble(
    division: Division, settings: Settings, on_layer: Callable[[Layer], None] | None, say: Say
) -> Assembly:
    """Make the pieces of a division in order.  on_layer, say : as in `planner.pipeline.plan`.

    Raises PlanningError or RecipeError, naming the piece where there are several.
    """
    pieces = division.pieces
    setups, setup_of = setups_of([piece.direction for piece in pieces])
    whole = sum(piece.mesh.volume for piece in pieces)
    layers: list[Layer] = []
    made: list[Made] = []
    subcomponents: list[Subcomponent] = []
    findings: list[str] = []
    course = HeatCourse(settings)
    done = 0.0
    for number, piece in enumerate(pieces):
        share, begun = piece.mesh.volume / whole, done
        work = Work(
            piece,
            number,
            len(layers),
            _standing(pieces, number, settings),
            replace(settings.placed(piece.build_from_piece, division.build_from_part), is_on_plate=number == 0),
            division.build_from_part,
            on_layer,
            lambda stage, part, begun=begun, share=share: say(stage, begun + share * part),  # type: ignore[misc]
            course.cooled,
        )
        made.append(make_piece(work))
        subcomponents.append(_subcomponent(piece, setup_of[number], len(layers), made[-1]))
        layers += made[-1].layers
        findings += [f"{piece.name}: {line}" if len(pieces) > 1 else line for line in made[-1].findings]
        done += share
    findings += course.findings()
    return Assembly(
        tuple(layers), tuple(subcomponents), setups, tuple(findings), _volumes(pieces, made, settings)
    )


def _standing(pieces: tuple[Piece, ...], number: int, settings: Settings) -> Standing | None:
    """What stands before a piece; None where that is the plate straight below a piece that grows straight up."""
    if number == 0 and pieces[0].path is None:
        return None
    return Standing.before(pieces, number, settings.recipe.substrate_mm)


def make_piece(work: Work) -> Made:
    """One piece, by what it needs."""
    turns = work.piece.path is not None and work.settings.recipe.process != "mill"
    return turning_piece(work) if turns else straight_piece(work)


def _subcomponent(piece: Piece, setup: int, first: int, made: Made) -> Subcomponent:
    return Subcomponent(
        name=piece.name,
        parent=piece.parent,
        setup=setup,
        layers=(first, first + len(made.layers)),
        base=piece.base,
        end_direction=made.end_direction,
        axis=piece.axis,
        volume_mm3=piece.mesh.volume,
        joint_mm2=piece.joint_mm2,
        overhang_mm2=sum(layer.overhang_mm2 for layer in made.layers),
        unsupported_mm=made.unsupported_mm,
        support_mm3=made.support_mm3,
        why=piece.why,
    )


def _volumes(pieces: tuple[Piece, ...], made: list[Made], settings: Settings) -> dict[str, float]:
    part = sum(piece.mesh.volume for piece in pieces)
    deposited = sum(piece.deposited_mm3 for piece in made)
    return {
        "deposited": deposited,
        "milled": max(deposited - part, 0.0) if settings.is_milled else 0.0,
        "part": part,
        "support": sum(piece.support_mm3 for piece in made),
    }
