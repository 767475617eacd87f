"""Trends of any past moment, and what stands on their axis of time."""

from __future__ import annotations

import asyncio
import io
from typing import Annotated, Any

import msgspec
import numpy as np
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from cellctl.api.models_trends import Mark, Marks, Trends
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import ServiceOf, Viewer
from cellctl.domain.channels import CHANNELS, NAMES
from cellctl.store import marks as store_marks
from cellctl.store.trends import Trend, trend

router = APIRouter(prefix="/api/v1/cell", tags=["cell"], responses=DOCUMENTED)
ARROW = "application/vnd.apache.arrow.stream"
CSV = "text/csv"
SPAN_S = 600.0  # without `from`
TIME_MAX = 1e11  # Unix s
MARKS_MAX = 1000
DECIMALS = 4
Time = Annotated[float | None, Query(ge=0.0, le=TIME_MAX, allow_inf_nan=False, description="Unix time, s")]
FROM = "Unix time, s; left out: ten minutes before `to`"
FromTime = Annotated[float | None, Query(alias="from", ge=0.0, le=TIME_MAX, allow_inf_nan=False, description=FROM)]
_encoder = msgspec.json.Encoder()


def _span(from_: float | None, to: float | None, now: float) -> tuple[float, float]:
    """The time asked for. Raises ApiError 422."""
    to_at = now if to is None else to
    from_at = max(to_at - SPAN_S, 0.0) if from_ is None else from_
    if not from_at < to_at:
        hint = "both are Unix times in seconds; `to` is now if left out"
        raise ApiError(422, "The request does not fit", f"from={from_at:g} is not before to={to_at:g}", hint)
    return from_at, to_at


def _channels(asked: list[str]) -> tuple[str, ...]:
    """Raises ApiError 422 for a name that there is not."""
    for name in asked:
        if name not in NAMES:
            raise ApiError(422, "The request does not fit", f"channel={name[:60]!r} is no channel", f"one of {', '.join(NAMES)}")
    return tuple(dict.fromkeys(asked)) or NAMES


def _numbers(values: Any) -> list[float | None]:
    return [None if value != value else value for value in np.round(values, DECIMALS).tolist()]


def _document(found: Trend, from_at: float, to_at: float) -> bytes:
    facts = {channel.name: channel for channel in CHANNELS}
    return _encoder.encode(
        {
            "from_at": from_at,
            "to_at": to_at,
            "step_s": found.step_s,
            "made_of_s": found.made_of,
            "channels": [{"name": name, "unit": facts[name].unit, "setpoint": facts[name].setpoint} for name in found.channels],
            "at": np.round(found.at, 3).tolist(),
            "samples": found.samples.tolist(),
            "series": {
                name: {
                    "min": _numbers(found.least[:, k]),
                    "max": _numbers(found.greatest[:, k]),
                    "mean": _numbers(found.mean[:, k]),
                }
                for k, name in enumerate(found.channels)
            },
        }
    )


def _columns(found: Trend) -> dict[str, Any]:
    """Column by column, as in a table."""
    columns: dict[str, Any] = {"at": found.at, "samples": found.samples}
    for k, name in enumerate(found.channels):
        for word, values in (("min", found.least), ("max", found.greatest), ("mean", found.mean)):
            columns[f"{name}_{word}"] = values[:, k]
    return columns


def _arrow(found: Trend) -> bytes:
    import pyarrow as pa  # heavy, and seldom asked for

    columns = _columns(found)
    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue().to_pybytes())


def _csv(found: Trend) -> bytes:
    columns = _columns(found)
    text = io.StringIO()
    text.write(",".join(columns) + "\r\n")
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        text.write(",".join("" if value != value else f"{value:.14g}" for value in row) + "\r\n")
    return text.getvalue().encode()


@router.get(
    "/trends",
    response_model=Trends,
    responses={200: {"content": {ARROW: {"schema": {"type": "string", "format": "binary"}}, CSV: {"schema": {"type": "string"}}}}},
)
async def trends(
    _person: Viewer,
    service: ServiceOf,
    request: Request,
    from_: FromTime = None,
    to: Time = None,
    points: Annotated[int, Query(ge=1, le=5000, description="buckets at most")] = 1000,
    channel: Annotated[list[str] | None, Query(max_length=64, description="left out: all")] = None,
) -> Response:
    """Least, greatest and mean of channels in buckets of time; as JSON, or by Accept as CSV or an Arrow stream."""
    from_at, to_at = _span(from_, to, service.store.clock())
    names = _channels(channel or [])
    accept = request.headers.get("accept", "")
    media_type = next((kind for kind in (ARROW, CSV) if kind in accept), "application/json")

    def answer() -> bytes:
        with service.store.read_cell() as rows:
            found = trend(rows, from_at, to_at, points, names)
        return _arrow(found) if media_type == ARROW else _csv(found) if media_type == CSV else _document(found, from_at, to_at)

    body = await asyncio.to_thread(answer)
    return Response(body, media_type=media_type, headers={"Cache-Control": "no-store", "Vary": "Accept"})


@router.get("/trends/marks")
def marks(
    _person: Viewer,
    service: ServiceOf,
    from_: FromTime = None,
    to: Time = None,
    job: Annotated[str, Query(max_length=60, description="only of this job; then of any time unless from and to say otherwise")] = "",
    layers: Annotated[bool, Query(description="begins of layers too")] = False,
) -> Marks:
    """Alarms, holds, resets, begins and ends of jobs and of layers: the marks on the axis of time, in order."""
    now = service.store.clock()
    from_at, to_at = (from_ or 0.0, now + 1.0 if to is None else to) if job else _span(from_, to, now)
    with service.store.read_cell() as rows:
        found = store_marks.marks(rows, from_at, to_at, MARKS_MAX + 1, job, layers)
    items = [
        Mark(
            seq=one.seq, at=one.at, kind="hold" if one.kind in ("state", "held") else one.kind, text=one.text, job=one.job,
            code=str(one.data.get("code", "")), layer=one.data.get("layer") if one.kind in ("layer", "alarm") else None,
        )
        for one in found[:MARKS_MAX]
    ]  # fmt: skip
    return Marks(items=items, more=len(found) > MARKS_MAX)
