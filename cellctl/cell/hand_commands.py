"""Commands of a hand at the machine, as the cell takes them: overrides, home, jog, places, purge, pilot beam, unlock, position."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from cellctl.cell.by_hand import ByHand
from cellctl.cell.measuring import adopt
from cellctl.cell.overriding import override
from cellctl.domain.messages import Command
from cellctl.domain.states import Trigger, after, is_reached
from drivers.cell_wires import CellDrivers

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

T = Trigger


class HandCommands:
    """Verbs by name. drivers : those of a cell that is there; raises Refused without"""

    def __init__(self, controller: Controller, hands: ByHand, drivers: Callable[[], CellDrivers]) -> None:
        self._c = controller
        self._hands = hands
        self._drivers = drivers
        self.verbs: dict[str, Callable[[Command], Awaitable[dict[str, Any]]]] = {
            "override": self._override,
            "home": self._home,
            "unlock": self._unlock,
            "confirm_position": self._confirm_position,
            "jog": self._jog,
            "jog_keep": self._jog_keep,
            "jog_end": self._jog_end,
            "go_to": self._go_to,
            "purge": self._purge,
            "purge_end": self._purge_end,
            "pilot": self._pilot,
            "measured": self._measured,
        }

    async def _override(self, command: Command) -> dict[str, Any]:
        return override(self._c, command, self._drivers())

    async def _home(self, command: Command) -> dict[str, Any]:
        if not is_reached(self._c.state, T.HOME):
            after(self._c.state, T.HOME)
            self._hands.home(command, self._drivers())
        return {"state": self._c.state.value}

    async def _unlock(self, command: Command) -> dict[str, Any]:
        if not is_reached(self._c.state, T.UNLOCK):
            after(self._c.state, T.UNLOCK)
            await self._hands.unlock(command, self._drivers())
        return {"state": self._c.state.value}

    async def _confirm_position(self, command: Command) -> dict[str, Any]:
        self._hands.confirm_position(command)
        return {"state": self._c.state.value}

    async def _jog(self, command: Command) -> dict[str, Any]:
        jog = self._hands.start_jog(command, self._drivers())
        return {"state": self._c.state.value, "repeat_s": self._c.cell.by_hand.jog_repeat_s if jog.is_continuous else 0.0}

    async def _jog_keep(self, command: Command) -> dict[str, Any]:
        return {"state": self._c.state.value, "is_jogging": self._hands.keep()}

    async def _jog_end(self, command: Command) -> dict[str, Any]:
        self._hands.end_jog("let go")
        return {"state": self._c.state.value}

    async def _go_to(self, command: Command) -> dict[str, Any]:
        return {"place": self._hands.go_to(command, self._drivers()), "state": self._c.state.value}

    async def _purge(self, command: Command) -> dict[str, Any]:
        seconds = self._c.flow_by_hand.begin(command, self._drivers())
        return {"state": self._c.state.value, "seconds": seconds}

    async def _purge_end(self, command: Command) -> dict[str, Any]:
        self._hands.end_purge(command.because or "ended by the operator")
        return {"state": self._c.state.value}

    async def _pilot(self, command: Command) -> dict[str, Any]:
        c, seconds = self._c, command.args.get("seconds")
        if command.args.get("on"):
            c.pilot.turn_on(self._drivers(), float(seconds) if isinstance(seconds, (int, float)) else None)
        else:
            c.pilot.turn_off(command.because or "switched off")
        return {"state": c.state.value, "left_s": round(c.pilot.left_s, 1)}

    async def _measured(self, command: Command) -> dict[str, Any]:
        return await adopt(self._c, command)
