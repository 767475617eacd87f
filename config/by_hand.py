"""What a person at the cell may do by hand, where that is done, and how long what a person said counts."""

from __future__ import annotations

from pydantic import Field, model_validator

from config.base import Facts, Finite, NotNegative, Positive


class ByHand(Facts):
    """Jogging, control of the cell, and the confirmation of the table."""

    jog_repeat_s: Positive = Field(0.25, le=1.0, description="a continuous jog whose button is not told held for so long ends")
    suspect_feed_mm_min: Positive = Field(1000.0, description="feed of a jog before homing or confirming the position, for rotary axes in deg/min")
    control_absent_s: Positive = Field(15.0, description="who has control and is not heard for so long counts as absent")
    table_confirmed_s: Positive = Field(900.0, description="so long it counts that a person found the table clear")
    places: dict[str, dict[str, Finite]] = Field(
        default_factory=dict, description="where a hand sends the machine, such as park, tool_change: axis letter -> mm or deg, machine coordinates"
    )
    purge_place: str = Field("", description="the one of `places` at which powder and gas flow by hand; none: wherever the head stands")
    purge_max_s: Positive = Field(60.0, le=600.0, description="longest purge")
    purge_powder_g_min: Positive = Field(10.0, description="powder of a purge, unless it is asked for otherwise")
    purge_carrier_l_min: Positive = Field(5.0, description="carrier gas of a purge or gas test")
    purge_shield_l_min: Positive = Field(15.0, description="shield gas of a purge or gas test")
    purge_with_door_open: bool = Field(False, description="whether powder and gas may flow by hand with the door open")
    pilot_with_door_open: bool = Field(False, description="whether the aiming beam may be on with the door open: its class decides")
    pilot_max_s: Positive = Field(120.0, le=3600.0, description="longest time for which the aiming beam stays on")
    measured_max_mm: Positive = Field(5.0, description="farther from the cell file nothing that is measured by hand is adopted")
    residual_max_mm: Positive = Field(0.05, description="touched points that agree less well are not adopted")
    tilt_max_deg: Positive = Field(0.1, le=5.0, description="of the substrate: programs are posted for a level one")
    start_retry_s: NotNegative = Field(30.0, description="so long a start that was refused for a device that did not answer is tried again")

    @model_validator(mode="after")
    def _purge_place_is_one(self) -> ByHand:
        if self.purge_place and self.purge_place not in self.places:
            raise ValueError(f"purge_place: no place {self.purge_place}; places: {', '.join(self.places) or 'none'}")
        return self
