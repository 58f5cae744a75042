"""Texts of others, fit for a terminal: control characters, escapes and marks of writing direction are written out."""

from __future__ import annotations

from typing import Any


def shown(text: str) -> str:
    """The text with every character that is not printable as its escape, a line feed too."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown_texts(content: Any) -> Any:
    """The content of a message with all its texts, keys too, as they are shown."""
    match content:
        case str():
            return shown(content)
        case list():
            return [shown_texts(item) for item in content]
        case dict():
            return {shown_texts(key): shown_texts(item) for key, item in content.items()}
    return content
