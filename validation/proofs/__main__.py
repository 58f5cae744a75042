"""`python -m validation.proofs`: writes the pages of docs/proofs, and README's table, from the results beside them."""

from __future__ import annotations

from validation.proofs.pages import pages
from validation.proofs.readme_table import readme


def main() -> None:
    """Writes every page of which the result is there."""
    for path, text in (pages() | readme()).items():
        path.write_text(text, encoding="utf-8")
        print(path.name)


if __name__ == "__main__":
    main()
