"""The end of a campaign: poses that failed are named; where all did, nothing was measured, and that is an error."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.cli.campaign import conclude
from lrm_ident.measuring.campaign.run import CampaignResult
from lrm_math.errors import LrmError


@given(total=st.integers(1, 9), failed=st.integers(0, 9))
def test_a_campaign_without_any_pose_is_an_error_and_no_other_is(total: int, failed: int) -> None:
    failed = min(failed, total)
    result = CampaignResult({number + 1: "no way" for number in range(failed)})
    if failed == total:
        with pytest.raises(LrmError, match="no pose was measured; no way"):
            conclude(result, total, Path("data.csv"))
    else:
        conclude(result, total, Path("data.csv"))
