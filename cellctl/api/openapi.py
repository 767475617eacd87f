"""The document of the interface: names of operations that make good method names, what each group is about, the schemas no route names."""

from __future__ import annotations

from typing import Any

import msgspec
from fastapi import FastAPI
from fastapi.routing import APIRoute

from cellctl.api.problems import DOCUMENTED, Problem
from cellctl.domain.snapshot import Snapshot

# Operations are named as their functions are, except where that name needs its file beside it.
NAMES = {
    "session": "get_session", "upload": "upload_part", "get_mesh": "get_part_mesh", "get_file": "get_part_file", "estimate": "estimate_part",
    "thumbnail": "get_part_thumbnail", "recipe_schema": "get_recipe_schema", "plan_figures": "get_plan_figures", "submit": "submit_job",
    "edit": "edit_job", "approve": "approve_job", "cancel": "cancel_job", "rerun": "rerun_job", "show_clone": "show_clone_changes",
    "clone": "clone_job", "retry": "retry_job", "life": "get_job_life", "attach": "add_attachment", "move": "move_in_queue",
    "get_point": "get_resumption_point", "resume": "continue_job", "get_head": "get_program_head", "get_whole": "get_plan_geometry",
    "get_track": "get_program_track", "get_chunk": "get_program_track_chunk", "get_surface": "get_proof_surface",
    "get_picture": "get_proof_picture", "get_report": "get_proof_report", "acknowledge": "acknowledge_alarm", "trends": "get_trends",
    "marks": "get_trend_marks", "get_seal": "get_record_seal", "load": "load_consumable", "go_to": "go_to_place", "purge": "begin_purge",
    "purge_end": "end_purge", "pilot": "switch_pilot_beam", "get_snapshot": "get_cell", "about": "get_about", "facts": "get_cell_facts",
    "list_events": "list_cell_events", "control": "control_cell", "jog_on": "continue_jog", "command": "command_cell",
    "touch": "touch_point", "fit": "fit_touch_off", "adopt": "adopt_touch_off", "forget": "forget_measured",
    "list_deeds": "list_audit", "verify": "verify_audit", "healthz": "get_health", "readyz": "get_readiness", "metrics": "get_metrics",
}  # fmt: skip

TAGS = {
    "session": "Signing in and out",
    "parts": "Meshes, checked and mended; estimates and small pictures of them",
    "uploads": "Files of up to 1 GB in pieces that go on where they broke off (tus 1.0.0)",
    "jobs": "Submitting, approving, cancelling; what each job does",
    "job life": "Changing, running again, cloning and retrying jobs",
    "notes and attachments": "What people leave at a job",
    "queue": "The order in which jobs are planned and run",
    "table": "What lies on the cell's table, and who looked",
    "resumption": "Going on with a part whose run was interrupted",
    "drawings": "Plan, program and proof as binary drawings",
    "results": "Plan, program and proof as files and figures",
    "record": "What was commanded, read back and done by whom, sealed",
    "cell": "The cell's state, its commands, alarms, trends and consumables",
    "fleet": "The cells that share this store",
    "by hand": "Places, purge and aiming beam",
    "facts": "Materials and cells by version",
    "webhooks": "Who outside is told what happens here",
    "users": "People who sign in",
    "tokens": "Programs that sign in",
    "audit": "Who did what from where because of what",
    "health": "For supervisors and Prometheus",
    "events": "What happens, as it happens, with replay",
}


def name_of(route: APIRoute) -> str:
    """The operationId of a route that gives none itself."""
    return NAMES.get(route.name, route.name)


def _without_closed_tuples(schema: Any) -> Any:
    """A schema without `items: false`, which generators of clients do not read; minItems and maxItems beside it say the same."""
    if isinstance(schema, dict):
        return {name: _without_closed_tuples(value) for name, value in schema.items() if not (name == "items" and value is False)}
    return [_without_closed_tuples(value) for value in schema] if isinstance(schema, list) else schema


def document_whole(app: FastAPI) -> None:
    """Make the application's document complete: answers that refuse at every operation, groups, and the schemas that no route names."""
    generate = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = generate()
            schemas = document.setdefault("components", {}).setdefault("schemas", {})
            schemas["Problem"] = Problem.model_json_schema()
            _, parts_of_snapshot = msgspec.json.schema_components([Snapshot], ref_template="#/components/schemas/{name}")
            schemas.update(_without_closed_tuples(parts_of_snapshot))
            for operations in document["paths"].values():
                for operation in operations.values():
                    for status, answer in DOCUMENTED.items():
                        operation["responses"].setdefault(str(status), answer)
            used = {tag for operations in document["paths"].values() for operation in operations.values() for tag in operation["tags"]}
            document["tags"] = [{"name": name, "description": about} for name, about in TAGS.items() if name in used]
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
