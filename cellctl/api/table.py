"""What a person vouches for before a job starts: the table is clear, or the part that the job goes on with stands untouched on it."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection

from cellctl.api.problems import ApiError
from cellctl.domain.jobs import ON_CELL
from cellctl.store import jobs
from cellctl.store.jobs import JobRow


@dataclass(frozen=True)
class Found:
    """The words of one thing to vouch for. field : of the request   what : as a sentence   seen : in the past"""

    field: str
    title: str
    what: str
    seen: str

    @property
    def missing(self) -> str:
        """Why a job that nobody looked for waits."""
        return f"waits until a person confirms that {self.what}"

    @property
    def again(self) -> str:
        """Why a job waits whose confirmation counts no more."""
        return f"waits until a person confirms again that {self.what}"


CLEAR = Found("table_clear", "The table is not confirmed clear", "the table is clear", "the table was found clear")
UNTOUCHED = Found(
    "part_untouched", "The part is not confirmed", "the part stands untouched on the table", "the part was found untouched"
)


def found_of(job: JobRow) -> Found:
    """What has to be vouched for before this job."""
    return CLEAR if job.continues_job is None else UNTOUCHED


def check_found(job: JobRow, table_clear: bool, part_untouched: bool) -> None:
    """Raises ApiError if a person vouches for the wrong one: a part that is gone on with does not stand on a clear table."""
    if table_clear and job.continues_job is not None:
        raise ApiError(
            409, UNTOUCHED.title, f"{job.name} goes on with the part of {job.continues_job}: the table must not be clear",
            "look that the part stands untouched, then set part_untouched",
        )  # fmt: skip
    if part_untouched and job.continues_job is None:
        raise ApiError(409, CLEAR.title, f"{job.name} goes on with no part: its table has to be clear", "look, then set table_clear")


def check_free(connection: Connection, cell: str) -> None:
    """Raises ApiError while a job is on the cell: nobody can vouch for the table that its part is made on."""
    for state in sorted(ON_CELL):
        for other in jobs.first_in(connection, state, 1, cell):
            raise ApiError(
                409, CLEAR.title, f"{other.name} ({other.id}) is on the cell: its part is on the table",
                "look again when it has ended and its part was taken off; approving without table_clear is possible now",
            )  # fmt: skip
