"""Sections of the page's lower part; a file without imports, as the page's process loads neither numpy nor rich."""

from __future__ import annotations


def section_html(title: str, text: str) -> str:
    """A section with a title around HTML; nothing where there is none."""
    return f"<section><h2>{title}</h2>{text}</section>" if text else ""
