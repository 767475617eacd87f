"""How warm part and plate are when a layer begins, by their lumped heat balance, and how long to wait for it.

One temperature for plate and metal, as `config.material.PartHeat` states it: capacity of the plate and of the deposited metal, heat
by the laser's absorbed share, away into the table and from the metal's surface by air and radiation. Metal comes in cold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from config.material import Material
from planner.errors import RecipeError
from planner.plan import Layer, Operation, Pass
from planner.process import Settings
from planner.toolpath.balance import metal_mm3

_STEFAN_BOLTZMANN = 5.670374419e-8  # W/(m2 K4), CODATA 2018
_WALL_MM = 6.0  # of the metal, whose both sides lose heat: two or three tracks side by side
_STEP_S = 10.0  # of the balance: losses change by less than a hundredth in it
_MOST_WAIT_S = 7200.0  # for one layer
_CHANGE_S = 10.0  # of a tool: what changers of such cells take from cut to cut, ways included; a plan knows no cell; choice
_RAPID_MM_S = 100.0  # links without feed of their own


@dataclass
class HeatCourse:
    """The course of temperature over the layers as they are planned.

    temperature_k, mass_g : now   elapsed_s : since the first bead of the layer before   waited_s : in all
    begins_k : per layer (number, K when it begins), first deposition only   tool_mm : diameter of the cutter that is in, 0: the head
    """

    settings: Settings
    temperature_k: float = 0.0
    mass_g: float = 0.0
    elapsed_s: float = 0.0
    waited_s: float = 0.0
    begins_k: list[tuple[int, float]] = field(default_factory=list)
    given_up: list[int] = field(default_factory=list)
    tool_mm: float | None = None

    def __post_init__(self) -> None:
        ambient = self.settings.material.part_heat.ambient_k
        self.temperature_k = ambient
        limit = self.settings.max_interpass_k
        if limit is not None and limit < ambient + 1.0:
            raise RecipeError(
                f"max_interpass_k: asked {limit:g} K, but the plate lies at {ambient:g} K (part_heat.ambient_k): it never cools to that",
                "choose a higher temperature",
            )

    def cooled(self, layer: Layer) -> Layer:
        """The layer with its first deposition put off until what stands is cool enough; the course goes on to its end."""
        operations = list(layer.operations)
        for number, operation in enumerate(operations):
            self._change(operation)
            if operation.process.is_deposit and not self._is_begun(layer):
                operations[number] = self._put_off(operation, layer.index)
            for step in operation.passes:
                self._pass(step, operation)
        return replace(layer, operations=tuple(operations))

    def findings(self) -> list[str]:
        """One line where a limit was set: waiting in all, and the warmest layer."""
        limit = self.settings.max_interpass_k
        if limit is None or not self.begins_k:
            return []
        index, warmest = max(self.begins_k, key=lambda row: row[1])
        told = [
            f"interpass: layers wait {self.waited_s / 60.0:.1f} min in all so that part and plate are at most {limit:.0f} K when one "
            f"begins; warmest {warmest:.0f} K, layer {index}"
        ]
        if self.given_up:
            told.append(
                f"interpass: layers {', '.join(map(str, self.given_up[:5]))} begin warmer than that after {_MOST_WAIT_S / 3600.0:.0f} h: "
                "the plate does not lose its heat"
            )
        return told

    def _change(self, operation: Operation) -> None:
        """Time of a tool change, if one is due."""
        tool_mm = operation.cutter_diameter_mm
        if self.tool_mm is not None and tool_mm != self.tool_mm:
            self._rest(_CHANGE_S)
        self.tool_mm = tool_mm

    def _is_begun(self, layer: Layer) -> bool:
        return bool(self.begins_k) and self.begins_k[-1][0] == layer.index

    def _put_off(self, operation: Operation, layer: int) -> Operation:
        """The operation with the time that it waits for, as from the start of the layer before."""
        least = operation.interpass_s
        wait = max(least - self.elapsed_s, 0.0) if self.begins_k else 0.0
        self._rest(wait)
        limit = self.settings.max_interpass_k
        if limit is not None and self.begins_k:
            more = self._rest_until(limit)
            if more > 0.0:
                wait += more
                operation = replace(operation, interpass_s=round(self.elapsed_s, 1))
                if self.temperature_k > limit + 0.5:
                    self.given_up.append(layer)
        self.waited_s += wait
        self.begins_k.append((layer, self.temperature_k))
        self.elapsed_s = 0.0
        return operation

    def _rest(self, seconds: float) -> None:
        left = seconds
        while left > 1e-9:
            self._step(0.0, min(left, _STEP_S))
            left -= _STEP_S

    def _rest_until(self, limit_k: float) -> float:
        """Seconds that it takes to cool to a temperature, waited."""
        waited = 0.0
        while self.temperature_k > limit_k and waited < _MOST_WAIT_S:
            self._step(0.0, 1.0)
            waited += 1.0
        return waited

    def _pass(self, step: Pass, operation: Operation) -> None:
        """Heat and time of a pass."""
        material = self.settings.material
        rows, length = step.setpoints, step.tip.length
        ends = [*rows[1:, 0], length]
        for (at, feed, power, _, _), end in zip(rows.tolist(), ends, strict=True):
            seconds = (float(end) - at) / (_RAPID_MM_S if step.rapid else feed)
            left = seconds
            while left > 1e-9:
                self._step(material.head.absorptivity * power, min(left, _STEP_S))
                left -= _STEP_S
        if operation.process.is_deposit and not step.is_link:
            self._add(metal_mm3([step], self.settings) * material.density_g_mm3)

    def _step(self, absorbed_w: float, seconds: float) -> None:
        """The balance over a time with constant losses: the exponential approach to where heat and losses meet."""
        loss, capacity = self._loss_w_k(), self._capacity_j_k()
        ambient = self.settings.material.part_heat.ambient_k
        goal = absorbed_w / loss
        rise = self.temperature_k - ambient
        self.temperature_k = ambient + goal + (rise - goal) * math.exp(-seconds * loss / capacity)
        self.elapsed_s += seconds

    def _add(self, mass_g: float) -> None:
        """Metal at the temperature of the air."""
        material: Material = self.settings.material
        before, added = self._capacity_j_k(), mass_g * material.thermal.specific_heat_j_g_k
        self.temperature_k = (before * self.temperature_k + added * material.part_heat.ambient_k) / (before + added)
        self.mass_g += mass_g

    def _capacity_j_k(self) -> float:
        material = self.settings.material
        return material.part_heat.plate_heat_capacity_j_k + self.mass_g * material.thermal.specific_heat_j_g_k

    def _loss_w_k(self) -> float:
        material, facts = self.settings.material, self.settings.material.part_heat
        area_m2 = 2e-6 * self.mass_g / (_WALL_MM * material.density_g_mm3)
        warm, cold = self.temperature_k, facts.ambient_k
        radiation = facts.emissivity * _STEFAN_BOLTZMANN * (warm**2 + cold**2) * (warm + cold)
        return facts.plate_conductance_w_k + area_m2 * (facts.convection_w_m2_k + radiation)
