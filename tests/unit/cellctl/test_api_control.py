"""Control of the cell over REST: who asks as which client, and what is said without a cell process."""

from __future__ import annotations

from typing import Any

from cellctl.store import audit


async def test_taking_control_without_a_cell_process_says_so_and_is_written_down(web: Any) -> None:
    answer = await web.operator.post("/api/v1/cell/control", json={"action": "take", "because": "mine"})
    assert answer.status_code == 503 and "restarted by itself" in answer.json()["hint"]
    with web.service.store.read() as rows:
        deeds = audit.of_target(rows, "trunnion-tcp")
    assert [(deed["verb"], deed["because"]) for deed in deeds] == [("take_control", "mine")]


async def test_a_client_id_that_is_no_name_and_an_action_that_is_none_are_refused(web: Any) -> None:
    answer = await web.operator.get("/api/v1/cell/about", headers={"X-Client-Id": "fine"})
    assert answer.status_code == 200
    refused = await web.operator.post("/api/v1/cell/hold", json={}, headers={"X-Client-Id": "a b\x7f"})
    assert refused.status_code == 422 and "X-Client-Id" in refused.json()["detail"]
    assert (await web.operator.post("/api/v1/cell/control", json={"action": "steal"})).status_code == 422
    assert (await web.viewer.post("/api/v1/cell/control", json={"action": "take"})).status_code == 403
