"""The only code of the planner that opens files: plans and programs."""

from planner.files.plan_file import plan_from_bytes, plan_sha256, read_layer, read_plan, write_plan
from planner.files.program_file import read_program, write_program

__all__ = ["plan_from_bytes", "plan_sha256", "read_layer", "read_plan", "read_program", "write_plan", "write_program"]
