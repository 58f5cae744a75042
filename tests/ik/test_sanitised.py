"""The kernel under the address and undefined-behaviour sanitizers: a short run of what `make soak` does at length."""

from __future__ import annotations

import pytest

from tests.soak import sanitised


@pytest.mark.slow
@pytest.mark.skipif(not sanitised.runtimes(), reason="the C compiler has no sanitizers")
def test_the_ik_fuzz_reads_and_writes_no_memory_but_its_own() -> None:
    done = sanitised.run(queries=25, seed=3, capture=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 violations" in done.stdout
