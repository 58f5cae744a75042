"""Whose messages a client accepts, by laws over random sequences; without network."""

from __future__ import annotations

from collections.abc import Iterator
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.client import NoReply, Rover, SeveralDaemons
from lrmd.client.identity import Daemon, Origin, Subscription, origin_of
from lrmd.config import load_config
from lrmd.messages.codec import HeaderSource, pack
from lrmd.messages.control import FaultsState
from lrmd.messages.zenoh_session import key
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import FakeQuery, InMemoryDaemon

TIMES = st.integers(1, 2**62)


def state(boot_id: str, t_mono_ns: int) -> bytes:
    return pack(FaultsState(boot_id=boot_id, seq=1, t_mono_ns=t_mono_ns, t_wall_ns=0, faults=[]))


@pytest.fixture
def daemon() -> Iterator[InMemoryDaemon]:
    sim = SimulatedDaemon(load_config(CONFIG))
    sim.run(30)
    found = InMemoryDaemon(sim, "boot1")
    with found.reachable():
        yield found


def answering(daemon: InMemoryDaemon, tail: str, data: bytes, on: str | None = None) -> None:
    """Another program answers beside the daemon, on the key that it was asked on, or another one."""
    whole = key("rover", tail)

    def reply(query: FakeQuery) -> None:
        with query:
            query.reply(on or whole, data)

    daemon.session.declare_queryable(whole, reply)


@given(known=TIMES, written=TIMES)
def test_an_old_reply_is_none(known: int, written: int) -> None:
    daemon = Daemon("boot1", known, known)
    assert daemon.wrote(Origin("boot1", written)) == (written > known)
    assert not daemon.wrote(Origin("boot2", written))


@given(st.lists(st.tuples(st.sampled_from(["boot1", "boot2"]), TIMES)))
def test_states_are_delivered_once_and_in_order(sent: list[tuple[str, int]]) -> None:
    """Until `info` is asked again: of one boot id, ascending, and each that is newer than those delivered before."""
    seen: list[Origin | None] = []
    subscription = Subscription(lambda data: seen.append(origin_of(data)), lambda: Daemon("boot1", 0, 0), mock.Mock())
    with mock.patch("lrmd.client.identity.threading.Thread"):
        for boot_id, t in sent:
            subscription.take("lrm/rover/state/faults", state(boot_id, t))
            subscription.take("lrm/*/state/faults", state("boot1", 2**62))
    newest, expected = 0, []
    for boot_id, t in sent:
        if boot_id == "boot1" and t > newest:
            newest = t
            expected.append(Origin("boot1", t))
    assert seen == expected


@given(forged=TIMES, own=TIMES)
def test_a_forged_time_holds_states_up_until_info_is_asked_again(forged: int, own: int) -> None:
    known, seen = [Daemon("boot1", 0, 0)], list[bytes]()
    subscription = Subscription(seen.append, lambda: known[0], mock.Mock())
    with mock.patch("lrmd.client.identity.threading.Thread"):
        subscription.take("k", state("boot1", forged))
        known[0] = Daemon("boot1", own, own)
        subscription.take("k", state("boot1", own + 1))
    assert len(seen) == 2


@given(st.binary())
def test_any_bytes_have_an_origin_or_none(data: bytes) -> None:
    found = origin_of(data)
    assert found is None or found.boot_id.isalnum()


def test_two_programs_at_the_first_query_are_an_error_that_names_both(daemon: InMemoryDaemon) -> None:
    answering(daemon, "info", pack(FaultsState(**HeaderSource("boot2").next("info"), faults=[])))
    with Rover("rover") as rover, pytest.raises(SeveralDaemons, match=r"2 programs .* \(boot id boot1, boot2\)"):
        rover.mode()


def test_another_daemon_that_comes_later_is_not_listened_to(daemon: InMemoryDaemon) -> None:
    with Rover("rover") as rover:
        assert rover.boot_id == "boot1"
        for tail in ("info", "state/faults"):
            answering(daemon, tail, pack(FaultsState(**HeaderSource("boot2").next(tail), faults=[])))
        assert rover.faults().boot_id == "boot1"


@pytest.mark.parametrize(
    ("data", "on"), [(b"nonsense", None), (state("boot1", 1), None), (state("boot1", 2**62), "lrm/other/state/faults")]
)
def test_old_and_foreign_replies_are_passed_over(daemon: InMemoryDaemon, data: bytes, on: str | None) -> None:
    with Rover("rover") as rover:
        assert rover.boot_id == "boot1"
        answering(daemon, "state/faults", data, on)
        assert rover.faults().t_mono_ns not in (1, 2**62)


def test_old_replies_alone_are_no_reply(daemon: InMemoryDaemon) -> None:
    answering(daemon, "state/strange", state("boot1", 1))
    with Rover("rover") as rover, pytest.raises(NoReply, match="or an old one"):
        rover._query(FaultsState, "state/strange")
