"""The error of a request that the daemon does not carry out."""

from __future__ import annotations

from typing import Any

from lrm_math.errors import LrmError


class RequestError(LrmError):
    """A request that is not carried out; `code`, `retryable` and `detail` go into its `ErrorReply`."""

    def __init__(self, code: str, text: str, retryable: bool = False, **detail: Any) -> None:
        self.code, self.retryable, self.detail = code, retryable, detail
        super().__init__(text)
