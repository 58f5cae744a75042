"""A request that cannot be carried out now."""

from __future__ import annotations

from typing import Any

from lrm_math.errors import LrmError


class Refused(LrmError):
    """Carries `code`, `retryable` and `detail` for the reply."""

    def __init__(self, code: str, text: str, retryable: bool = False, **detail: Any) -> None:
        self.code, self.retryable, self.detail = code, retryable, detail
        super().__init__(text)
