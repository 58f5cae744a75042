"""The runner of every catalogue: cases side by side, a line of progress each, and a file that a later run goes on with.

A case is whatever `examine` takes; its key names it in lines of progress and in the file. With one job the cases run
in this process, one after the other; else in processes, for which cases, results and `examine` must be picklable.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, NoReturn, TypeVar

from pydantic import TypeAdapter, ValidationError

from lrm_ident.fitting.executors import as_finished, executor_for
from lrm_ident.report.document import plain
from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError
from validation.commit import COMMIT

NO_CASE = "no case is chosen; --help lists the options that choose"
Case = TypeVar("Case")
Result = TypeVar("Result")


@dataclass(frozen=True)
class ResultsFile(Generic[Result]):
    """Results by the keys of their cases, as JSON: `{"schema": …, "commit": …, "cases": {key: result}}`.

    kind: type of a result, a dataclass or a dictionary. beside: further values of the document. failed: of a result,
    whether its case is to be computed again.
    """

    path: Path
    kind: type[Result]
    schema: str
    beside: Mapping[str, object] = field(default_factory=dict)
    failed: Callable[[Result], bool] = lambda _: False

    def read(self) -> dict[str, Result]:
        """Results by key, without those that failed or lack a number (null); none where there is no file yet.

        Raises `FileError` for another file, and for results of other code.
        """
        if not self.path.exists():
            return {}
        try:
            document: dict[str, Any] = json.loads(self.path.read_text(encoding="utf-8"))
            if document["schema"] != self.schema:
                raise KeyError(self.schema)
            kind = TypeAdapter(self.kind)
            results = {key: _validated(kind, values) for key, values in document["cases"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise FileError(self.path, "cases", f"holds no results of {self.schema}; name another file") from None
        if document.get("commit") != COMMIT:
            raise FileError(self.path, "commit", f"{document.get('commit')}; the code is {COMMIT}", "name another file")
        return {key: result for key, result in results.items() if result is not None and not self.failed(result)}

    def write(self, results: Mapping[str, Result]) -> None:
        """Writes all of them. Raises `FileError`."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        document = {"schema": self.schema, "commit": COMMIT, **self.beside, "cases": results}
        write_atomically(self.path, json_text(document).encode())


def _validated(kind: TypeAdapter[Result], values: object) -> Result | None:
    try:
        return kind.validate_python(values)
    except ValidationError as error:
        if all(one["input"] is None for one in error.errors()):
            return None
        raise


def json_text(document: object) -> str:
    """JSON of dataclasses, arrays and containers; NaN and infinity, which JSON has not, are null."""
    return json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def refuse(problem: object) -> NoReturn:
    """Ends a program with one line and exit code 2."""
    print(problem, file=sys.stderr)
    raise SystemExit(2)


def run_cases(
    cases: Mapping[str, Case],
    examine: Callable[[Case], Result],
    line: Callable[[str, Result], str],
    jobs: int = 1,
    file: ResultsFile[Result] | None = None,
) -> dict[str, Result]:
    """Results by key, in the order of the cases; progress goes to stderr.

    Args:
        cases: by key.
        examine: the result of a case. What it raises ends the run; what was done by then is in the file.
        line: a case's line of progress, of its key and result.
        jobs: processes side by side.
        file: results that are there already are not computed again; each new one is written at once.

    Raises `FileError`: the file is another one. Ends the program where there is no case.
    """
    if not cases:
        refuse(NO_CASE)
    results = file.read() if file else {}
    left = [key for key in cases if key not in results]
    for number, result in _finished(examine, [cases[key] for key in left], jobs):
        results[left[number]] = result
        if file:
            file.write(results)
        done = len(left) - sum(key not in results for key in left)
        print(f"{done}/{len(left)} {line(left[number], result)}", file=sys.stderr, flush=True)
    return {key: results[key] for key in cases}


def _finished(examine: Callable[[Case], Result], cases: Sequence[Case], jobs: int) -> Iterator[tuple[int, Result]]:
    """Number of a case and its result, as they are done."""
    if jobs == 1:
        yield from enumerate(map(examine, cases))
        return
    with executor_for(None, most=jobs) as executor:
        yield from as_finished(executor, examine, cases)
