"""The documents of trends and alarms. Times are Unix seconds."""

from __future__ import annotations

from pydantic import BaseModel, Field

from cellctl.api.models import Strict


class ChannelFacts(BaseModel):
    """One channel. setpoint: the channel that says what this one should read; empty if it is no read-back."""

    name: str
    unit: str
    setpoint: str = ""


class Figures(BaseModel):
    """One channel's figures, one for each of `at`; null: nobody knows."""

    min: list[float | None]
    max: list[float | None]
    mean: list[float | None]


class Trends(BaseModel):
    """Channels over a time. step_s: width of a bucket, 0: the samples themselves; made_of_s: width of the stored level that answered, 0: the
    samples. A bucket of no samples stands where the cell was silent: a line is not to be drawn across it."""

    from_at: float
    to_at: float
    step_s: float
    made_of_s: int
    channels: list[ChannelFacts]
    at: list[float]
    samples: list[int]
    series: dict[str, Figures]


class Mark(BaseModel):
    """A moment on the axis of time: an alarm, a hold, a reset, a job's begin or end, a layer's begin."""

    seq: int
    at: float
    kind: str
    text: str
    job: str
    code: str = ""
    layer: int | None = None


class Marks(BaseModel):
    """Marks in order; `more`: there were more than are given."""

    items: list[Mark]
    more: bool


class AlarmTold(BaseModel):
    """One alarm. instead_of: codes of reports that it explains and stands in place of; line, layer: where the job was, counted from 0."""

    seq: int
    at: float
    code: str
    cause: str
    remedy: str
    line: int | None
    layer: int | None
    instead_of: list[str]
    acknowledged_by: str
    acknowledged_at: float | None


class AlarmItem(BaseModel):
    """An incident: what was latched between two resets. `first` is its first cause, `followed` what came after it."""

    id: int
    at: float
    ended_at: float | None = Field(description="when it was reset; null: it is latched")
    duration_s: float
    job: str
    job_name: str
    first: AlarmTold
    followed: list[AlarmTold]
    reset_by: str
    because: str = Field(description="why it was reset")


class Alarms(BaseModel):
    """A page of incidents, newest first."""

    items: list[AlarmItem]
    next: str | None = Field(None, description="cursor of the following page")


class Seen(Strict):
    """Says that an alarm was seen. It resets nothing."""

    because: str = Field("", max_length=500, description="a remark for the audit trail")
