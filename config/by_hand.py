"""What a person at the cell may do by hand, and how long what a person said counts."""

from __future__ import annotations

from pydantic import Field

from config.base import Facts, NotNegative, Positive


class ByHand(Facts):
    """Jogging, control of the cell, and the confirmation of the table."""

    jog_repeat_s: Positive = Field(0.25, le=1.0, description="a continuous jog whose button is not told held for so long ends")
    suspect_feed_mm_min: Positive = Field(1000.0, description="feed of a jog before homing or confirming the position, for rotary axes in deg/min")
    control_absent_s: Positive = Field(15.0, description="who has control and is not heard for so long counts as absent")
    table_confirmed_s: Positive = Field(900.0, description="so long it counts that a person found the table clear")
    start_retry_s: NotNegative = Field(30.0, description="so long a start that was refused for a device that did not answer is tried again")
