"""Text of a file as spreadsheets and trackers write it: any usual encoding, or the first sheet of a workbook.

An Excel export may begin with a byte order mark, and is UTF-16 if saved as Unicode text.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.data.table_text.workbook import sheet_text
from lrm_math.errors import FileError
from lrm_math.text_file import read_content

PACKED = b"PK\x03\x04"
"""Begin of a packed file, as .xlsx is."""
OLD_EXCEL = b"\xd0\xcf\x11\xe0"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\ufffd]")


@dataclass(frozen=True)
class FileText:
    """Text of a file; `sha256`: of its bytes. `notices`: what a person should know of how it was read."""

    text: str
    sha256: str
    notices: tuple[str, ...]


def read_text(path: Path) -> FileText:
    """Text in UTF-8, in UTF-16 with its mark, or else in Windows-1252 (Latin-1 and more). Raises `FileError`."""
    content = read_content(path)
    sha256 = hashlib.sha256(content).hexdigest()
    if content.startswith(PACKED):
        return FileText(sheet_text(path, content), sha256, ("read from the first sheet of the workbook",))
    if content.startswith(OLD_EXCEL):
        raise FileError(path, "", "an Excel file of before 2007", "save it as .xlsx or as CSV")
    notices = []
    try:
        text = content.decode("utf-16", "replace") if content.startswith(UTF_16) else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
        notices.append("read as Windows-1252 (Latin-1), as it is not UTF-8")
    if NO_TEXT.search(text):
        raise FileError(path, "", "is no text", "a table: CSV, or an Excel workbook (.xlsx)")
    if not text.endswith("\n"):
        notices.append("the last line does not end; is the file complete?")
    return FileText(text, sha256, tuple(notices))
