"""A flood of messages that only happen to match the emergency stop's keys does not reach its callbacks."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
import zenoh
from hypothesis import assume, given
from hypothesis import strategies as st

from lrmd.api.children import router_setup
from lrmd.config import load_config
from lrmd.messages.zenoh_session import MESSAGES, RATE_HZ, client, neighbours, with_rate_limits
from lrmd.ramp.parent import SharedFd
from tests.support.daemon.daemon_process import DaemonSetup

PUTS = 3000
PATTERNS = (
    "lrm/**", "**", "lrm/rover/**", "lrm/*/cmd/*", "lrm/**/estop", "lrm/*/*/estop", "lrm/rover/cmd/e$*p", "l$*/**",
)  # fmt: skip


@st.composite
def wildcards(draw: st.DrawFn, key: str) -> str:
    """Key expressions that match a key, the robot's chunk only as a whole."""
    found: list[str] = []
    for number, chunk in enumerate(key.split("/")):
        part = draw(st.sampled_from(("same", "any", "several", "nothing or more before", "partly")))
        at, end = sorted((draw(st.integers(0, len(chunk))), draw(st.integers(0, len(chunk)))))
        partly = chunk if number == 1 or end - at == len(chunk) else f"{chunk[:at]}$*{chunk[end:]}"
        found += {"same": [chunk], "any": ["*"], "several": ["**"], "partly": [partly]}.get(part, ["**", chunk])
    return str(zenoh.KeyExpr.autocanonize("/".join(found)))


@pytest.mark.parametrize("tail", MESSAGES)
@given(data=st.data())
def test_every_wildcard_that_matches_the_stop_matches_a_rule_and_the_stop_itself_none(
    tail: str, data: st.DataObject
) -> None:
    key = f"lrm/rover/{tail}"
    rules = [zenoh.KeyExpr(rule) for rule in neighbours(tail)]
    for own in (key, f"lrm/*/{tail}", "lrm/rover/cmd/target", "lrm/rover/rpc/hold", "lrm/rover/state/*", "lrm/*/info"):
        assert not any(rule.intersects(zenoh.KeyExpr(own)) for rule in rules)
    wildcard = data.draw(wildcards(key))
    assert zenoh.KeyExpr(wildcard).intersects(zenoh.KeyExpr(key))
    assume(wildcard not in (key, f"lrm/*/{tail}"))
    assert any(rule.intersects(zenoh.KeyExpr(wildcard)) for rule in rules)


def test_a_flood_of_wildcards_hardly_reaches_the_stop_and_no_stop_is_lost_in_it(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    configured = router_setup(load_config(setup.config), SharedFd(0), SharedFd(0), "boot")
    reached: list[str] = []
    started = time.monotonic()
    with zenoh.open(zenoh.Config.from_json5(configured.zenoh)) as session:
        session.declare_subscriber("lrm/rover/cmd/estop", lambda sample: reached.append(str(sample.key_expr)))
        with zenoh.open(client([setup.endpoint])) as stranger:
            for number in range(PUTS):
                stranger.put(PATTERNS[number % len(PATTERNS)], b"x", congestion_control=zenoh.CongestionControl.BLOCK)
                if number % 100 == 0:
                    stranger.put("lrm/rover/cmd/estop", b"", congestion_control=zenoh.CongestionControl.BLOCK)
            while reached.count("lrm/rover/cmd/estop") < PUTS // 100:
                assert time.monotonic() < started + 30.0, "every stop arrives"
                time.sleep(0.01)
    foreign = len(reached) - PUTS // 100
    assert foreign <= len(neighbours("cmd/estop")) * (1 + RATE_HZ * (time.monotonic() - started))
    assert foreign < PUTS // 2


def test_limits_that_a_zenoh_file_has_stay() -> None:
    config = zenoh.Config()
    own = {"id": "mine", "flows": ["egress"], "messages": ["put"], "rules": [{"key_expr": "a/b", "freq": 1.0}]}
    config.insert_json5("downsampling", json.dumps([own]))
    kept = json.loads(with_rate_limits(config).get_json("downsampling"))
    assert [entry["id"] for entry in kept] == ["mine", *(f"lrm wildcards at {tail}" for tail in MESSAGES)]
