"""Work of the processes behind the routes: tasks on the files in a request's folder.

The files are untrusted: a process that reads them may crash, or be killed.
"""

from __future__ import annotations

from pathlib import Path

from trisquare._support.suggestions import unknown
from trisquare.batch.limits import JobLimits
from trisquare.batch.worker import Answer, failure
from trisquare.errors import TrisquareError, error_members
from trisquare.serve.tasks import CONTENT, TASKS, Task


def perform(task: Task, limits: JobLimits) -> Answer:
    """Run a task in its own folder, which is the current one.

    Raises
    ------
    TypeError, ValueError, OSError, ImportError
        For bad options or files.
    """
    from trisquare.serve.answers import ANSWERS

    known = TASKS[task.name]
    for name in task.options:
        if name not in known:
            raise unknown("option", name, known)
    try:
        members, content = ANSWERS[task.name](task, limits)
    except TrisquareError as error:
        record = failure(task, type(error).__name__, str(error))
        record["error"] |= {"found": [], "rejected": []} | error_members(error)
        return record, None
    if content is not None:
        Path(CONTENT).write_bytes(content)
    return {"status": "done", **members}, None
