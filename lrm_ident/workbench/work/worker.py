"""Long work in a process of its own: tasks go in, progress and results come out, and it can be ended at any time.

The process is started with `spawn` before the first task, so that a click need not wait for imports.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from lrm_ident.fitting.executors import end_with_parent
from lrm_ident.workbench.work.tasks import WorkDone, WorkMessage, WorkProgress, WorkTask
from lrm_math.errors import LrmError

SMALLEST_PAUSE = 0.05
"""s between two messages of the same progress."""


@dataclass
class WorkProcess:
    """The process. One task at a time; `task` is the one at work, or None."""

    task: WorkTask | None = None
    _process: Any = field(init=False, default=None)
    _pipe: Connection = field(init=False)

    def __post_init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def start(self, task: WorkTask) -> None:
        """Gives the process a task."""
        self.task = task
        self._pipe.send(task)

    def messages(self) -> Iterator[WorkMessage]:
        """Messages that have come since the last call; a failure, and a new process, if it died."""
        try:
            while self._pipe.poll():
                message = self._pipe.recv()
                if isinstance(message, WorkDone):
                    self.task = None
                yield message
        except (EOFError, OSError):
            was, self.task = self.task, None
            self.close()
            self._start()
            if was is not None:
                yield WorkDone("the process that did the work was ended from outside; the model is as it was")

    def cancel(self) -> None:
        """Ends the task at once; a new process takes the next one."""
        self.task = None
        self.close()
        self._start()

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


_EARLY: list[WorkProcess] = []


def start_early() -> None:
    """Starts the process while the command line is still loading: both take a second or two."""
    _EARLY.append(WorkProcess())


def work_process() -> WorkProcess:
    """The process that was started early, or a new one."""
    return _EARLY.pop() if _EARLY else WorkProcess()


def _work(pipe: Connection) -> None:
    """Takes tasks until the other end closes."""
    from lrm_ident.workbench.work.run_task import run_task  # here: only this process needs what computes

    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process ends this one
    said = 0.0

    def send(message: WorkMessage) -> None:
        """Sends a message to the page; of progress not more than one per `SMALLEST_PAUSE`."""
        nonlocal said
        now = time.monotonic()
        if isinstance(message, WorkProgress) and 0 < message.done < message.of and now - said < SMALLEST_PAUSE:
            return
        said = now
        pipe.send(message)

    while True:
        try:
            task: WorkTask = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            run_task(task, send)
            pipe.send(WorkDone())
        except LrmError as error:
            pipe.send(WorkDone(str(error)))
        except Exception as error:  # a fault of ours must not end the page
            pipe.send(WorkDone(f"internal error ({type(error).__name__}: {error}); please report it"))
