"""XML as robots' files have it: any encoding, blank lines ahead, and prefixes that nobody declared.

Readers of URDF know no namespaces, so `xacro:property` is a name like any other here.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from lrm_math.errors import FileError
from lrm_math.text_file import read_content

UTF16 = "utf-16-le", "utf-16-be"
BYTE_ORDER_MARKS = (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")
DECLARED = re.compile(rb"""<\?xml[^>]*?encoding\s*=\s*["']([\w.-]+)["']""")
CONFLICT = re.compile("<{7} |={7}$|>{7} ")
DECLARATION = re.compile(r"\A(\s*)<\?xml.*?\?>", re.DOTALL)


@dataclass(frozen=True)
class XmlText:
    """Text of an XML file without its declaration, lines as in the file. `notices`: faults that are overlooked."""

    text: str
    notices: tuple[str, ...] = ()


def read_xml_text(path: Path) -> XmlText:
    """Text of an XML file in the encoding that it has. Raises `FileError`: no such file, or an unknown encoding."""
    content = read_content(path)
    encoding = _encoding(content)
    try:
        return XmlText(_undeclared(content.decode(encoding)))
    except LookupError:
        raise FileError(path, "", f"its encoding is '{encoding}', which is unknown", "save it as UTF-8") from None
    except UnicodeDecodeError as error:
        if encoding != "utf-8":
            raise FileError(path, "", f"its encoding is not '{encoding}' as it states", "save it as UTF-8") from None
        line = content[: error.start].count(b"\n") + 1
        notice = f"{path.name}, line {line}: not UTF-8 as it should be, so the file is read as Latin-1"
        return XmlText(_undeclared(content.decode("latin-1")), (notice,))


def _encoding(content: bytes) -> str:
    for mark, encoding in BYTE_ORDER_MARKS:
        if content.startswith(mark):
            return encoding
    if 0 in content[:2]:
        return UTF16[content[0] == 0]
    declared = DECLARED.search(content[:1000])
    stated = declared[1].decode("ascii", "replace").lower() if declared else "utf-8"
    return "utf-8" if stated.startswith(("utf-16", "utf16", "us-ascii")) or stated in ("utf8", "ascii") else stated


def _undeclared(text: str) -> str:
    return DECLARATION.sub(r"\1", text, count=1)


def parse_xml(path: Path, text: str) -> ElementTree.Element:
    """Tree of an XML text, comments included, names with their prefixes as written. Raises `FileError`."""
    tree = ElementTree.TreeBuilder(insert_comments=True)
    parser = expat.ParserCreate("utf-8")
    parser.ordered_attributes = True
    parser.buffer_text = True

    def start(name: str, attributes: Sequence[str]) -> None:
        tree.start(name, dict(zip(attributes[::2], attributes[1::2], strict=True)))

    parser.StartElementHandler = start
    parser.EndElementHandler, parser.CharacterDataHandler, parser.CommentHandler = tree.end, tree.data, tree.comment
    try:
        parser.Parse(DECLARATION.sub(r"\1", text, count=1).encode(), True)
    except expat.ExpatError as error:
        line = text.splitlines()[error.lineno - 1 : error.lineno]
        merge = f"line {error.lineno} is a conflict that git left there: keep one of its two versions"
        raise FileError(
            path, "", f"not valid XML: {error}", merge if line and CONFLICT.match(line[0]) else ""
        ) from None
    return tree.close()
