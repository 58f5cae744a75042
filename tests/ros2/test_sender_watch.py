"""What an order is newer than, whatever waits where: two senders with a network of their own each, and no clock."""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.errors import LrmError
from lrm_ros2.sender_watch import SenderEnd, SenderWatch

END = SenderEnd("MP", "/lrm/joint_trajectory")
SESSIONS = ("a", "b")


def token_of(session: str, kind: str = "MP") -> str:
    return f"@ros2_lv/0/{session}/1/2/{kind}/%/%/tester/%lrm%joint_trajectory/type/hash/qos"


class SenderQueues:
    """Daemon, watch and senders. What goes to a sender, and what comes from it, waits in a queue."""

    def __init__(self) -> None:
        self.stops = 0
        self.questions: dict[str, deque[Callable[[], None]]] = {session: deque() for session in SESSIONS}
        self.arriving: dict[str, deque[Callable[[], None] | int]] = {session: deque() for session in SESSIONS}
        self.watch = SenderWatch(lambda session, answered: self.questions[session].append(answered), [END])
        self.followed: list[tuple[int, int]] = []

    def hear(self, boot_id: str = "one") -> None:
        """The bridge hears how many stops there were."""
        state: Any = SimpleNamespace(boot_id=boot_id, stops=self.stops)
        self.watch.counted(state)

    def work(self, session: str) -> None:
        """A sender's session answers its next question."""
        if self.questions[session]:
            self.arriving[session].append(self.questions[session].popleft())

    def lose(self, session: str) -> None:
        """A question is lost."""
        if self.questions[session]:
            self.questions[session].popleft()

    def order(self, session: str) -> None:
        """A sender whose token is there sends an order; how many stops there were then."""
        if token_of(session) in self.watch.of(END):
            self.arriving[session].append(self.stops)

    def come(self, session: str) -> None:
        """A sender's token comes."""
        self.watch.token(token_of(session), there=True)

    def go(self, session: str) -> None:
        """It goes, and overtakes what the sender sent."""
        self.watch.token(token_of(session), there=False)

    def arrive(self, session: str) -> None:
        """The next of what a sender sent comes to the bridge. An order is followed if the daemon's count is its."""
        if not self.arriving[session]:
            return
        if not isinstance(what := self.arriving[session].popleft(), int):
            what()
            return
        try:
            known = self.watch.newer_than(END)
        except LrmError:
            return
        assert known.stops <= what
        if known.stops == self.stops:
            self.followed.append((what, self.stops))


EVENTS = [*["hear"] * 2, "stop", *["come"] * 2, "go", *["work"] * 4, "lose", *["order"] * 2, *["arrive"] * 8]


def test_no_order_is_followed_that_was_sent_before_the_last_stop() -> None:
    """Long random sequences: what breaks the law takes a dozen events in the right order."""
    followed = 0
    for seed in range(200):
        rng, network = random.Random(seed), SenderQueues()
        for _ in range(300):
            event, session = rng.choice(EVENTS), rng.choice(SESSIONS)
            if event == "stop":
                network.stops += 1
            elif event == "hear":
                network.hear()
            else:
                getattr(network, event)(session)
        assert all(sent == stops for sent, stops in network.followed), seed
        followed += len(network.followed)
    assert followed > 100


@given(stops=st.integers(0, 9))
def test_an_order_is_followed_once_its_sender_has_answered_since_the_last_stop(stops: int) -> None:
    network = SenderQueues()
    network.stops = stops
    network.hear()
    for session in SESSIONS:
        network.watch.token(token_of(session), there=True)
        network.work(session)
        network.arrive(session)
        network.order(session)
    for session in SESSIONS:
        network.arrive(session)
    assert network.followed == [(stops, stops)] * 2


def test_a_session_is_asked_as_soon_as_anything_of_it_is_there() -> None:
    network = SenderQueues()
    network.hear()
    network.watch.token("@ros2_lv/0/a/1/1/NN/%/%/tester", there=True)
    assert len(network.questions["a"]) == 1
    network.watch.token(token_of("b", kind="SS"), there=True)
    assert len(network.questions["b"]) == 1
    network.watch.token(token_of("*"), there=True)
    network.watch.token("@ros2_lv/0/a", there=True)
    assert network.watch.of(END) == frozenset()


def test_an_answer_of_the_daemon_before_a_restart_is_of_that_daemon() -> None:
    network = SenderQueues()
    network.watch.token(token_of("a"), there=True)
    network.stops = 3
    for boot_id in ("one", "two"):
        network.hear(boot_id)
        network.work("a")
        network.arrive("a")
        assert network.watch.newer_than(END).boot_id == boot_id
        network.stops = 1


def test_what_may_have_waited_for_long_and_whose_sender_is_unknown_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    network = SenderQueues()
    with pytest.raises(LrmError, match="no liveliness token"):
        network.watch.newer_than(END)
    network.watch.token(token_of("a"), there=True)
    network.hear()
    with pytest.raises(LrmError, match="answered no question yet"):
        network.watch.newer_than(END)
    network.work("a")
    network.arrive("a")
    assert not network.watch.silent([token_of("a")])
    later = time.monotonic() + 2.5
    monkeypatch.setattr(time, "monotonic", lambda: later)
    assert network.watch.silent([token_of("a")])
    with pytest.raises(LrmError, match=r"may have waited for 2\.5 s; should be at most 2 s"):
        network.watch.newer_than(END)
