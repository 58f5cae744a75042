"""The ik process as it runs, asked over zenoh: many at once, too many, too late, not any more, and after its death."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import zenoh

from lrmd.cli import app
from lrmd.client import NoReply, RequestRefused, Rover
from lrmd.ik.process import LEAST_LOAD, QUEUE
from lrmd.messages.codec import ErrorReply, pack, unpack
from lrmd.messages.kinematics import CancelRequest, FkRequest, GoalEntry, IkReply, IkRequest, PlanRequest
from lrmd.messages.zenoh_session import client
from tests.conftest import TABLE_B2
from tests.support.daemon.daemon_process import (
    SLOW_BOARD,
    START_TIMEOUT,
    DaemonProcess,
    DaemonSetup,
    running_daemon,
    wait_for,
)

GOAL = GoalEntry(position_m=[0.2, 0.1, 0.3])
LONG = IkRequest(id="long", goals=[GOAL] * 1000, method="cube", deadline_ms=60_000.0)


class IkHarness:
    """A daemon with a model file of its own, and a client."""

    def __init__(self, setup: DaemonSetup, daemon: DaemonProcess, rover: Rover, model: Path) -> None:
        self.setup, self.daemon, self.rover, self.model = setup, daemon, rover, model

    def ask(self, *goals: GoalEntry, **more: object) -> IkReply:
        return self.rover.ik(IkRequest(goals=list(goals) or [GOAL], method="direct", **more))  # type: ignore[arg-type]

    def wait_for_answers(self) -> None:
        def answers() -> bool:
            with suppress(NoReply, RequestRefused):
                return bool(self.ask().answers)
            return False

        wait_for(answers, "the ik process answers", START_TIMEOUT, 0.05)

    def codes(self) -> list[str]:
        return [event.code for event in self.rover.events()]

    @property
    def file_hash(self) -> str:
        return hashlib.sha256(self.model.read_bytes()).hexdigest()

    def changed(self) -> str:
        """Another model in the file: its hash."""
        self.model.write_text(self.model.read_text().replace("-5.75", f"-5.{time.monotonic_ns() % 10**6:06d}"))
        return self.file_hash


@pytest.fixture(scope="module")
def harness(tmp_path_factory: pytest.TempPathFactory) -> Iterator[IkHarness]:
    folder = tmp_path_factory.mktemp("daemon")
    model = folder / "model.toml"
    shutil.copy(TABLE_B2, model)
    setup = DaemonSetup.make(folder, {**SLOW_BOARD, '# model = "/etc/lrm/model.toml"': f'model = "{model}"'})
    with running_daemon(setup) as (_, daemon), setup.rover() as rover:
        harness = IkHarness(setup, daemon, rover, model)
        harness.wait_for_answers()
        yield harness


@pytest.fixture(autouse=True)
def _with_the_first_model(harness: IkHarness) -> Iterator[None]:
    yield
    shutil.copy(TABLE_B2, harness.model)
    harness.rover.reload()


def refusal(harness: IkHarness, request: IkRequest) -> RequestRefused:
    with pytest.raises(RequestRefused) as caught:
        harness.rover.ik(request)
    return caught.value


def test_answers_name_the_model_and_solve_what_they_were_asked(harness: IkHarness) -> None:
    reply = harness.ask()
    assert (reply.model, reply.model_sha256) == (str(harness.model), harness.file_hash)
    assert harness.rover.info().model_sha256 == harness.file_hash
    (answer,) = reply.answers
    assert answer.q_rad is not None
    (place,) = harness.rover.fk(FkRequest(q_rad=[answer.q_rad])).places
    np.testing.assert_allclose(place.tcp_m, GOAL.position_m, atol=1e-6)
    plan = harness.rover.plan(PlanRequest(from_rad=[0.0] * 6, goal=GOAL))
    assert plan.found, plan.text
    assert plan.model_sha256 == harness.file_hash
    (place,) = harness.rover.fk(FkRequest(q_rad=plan.waypoints_rad[-1:])).places
    np.testing.assert_allclose(place.tcp_m, GOAL.position_m, atol=1e-6)


def test_fifty_at_once_are_all_answered_each_with_its_own(harness: IkHarness) -> None:
    heights = np.linspace(0.25, 0.35, 50).tolist()

    def one(height: float) -> float:
        (answer,) = harness.ask(GoalEntry(position_m=[0.2, 0.1, height]), deadline_ms=20_000.0).answers
        return answer.tcp_m[2]

    with ThreadPoolExecutor(50) as pool:
        np.testing.assert_allclose(list(pool.map(one, heights)), heights, atol=1e-6)


def test_what_does_not_fit_into_the_queue_is_told_to_come_again(harness: IkHarness) -> None:
    """All are sent before half a hundred are answered; nobody is left without an answer."""
    fit = QUEUE // LEAST_LOAD
    count = fit + 60
    payload = pack(IkRequest(goals=[GOAL] * 6, method="direct", deadline_ms=60_000.0))
    with zenoh.open(client([harness.setup.endpoint])) as session:
        key = harness.setup.key("rpc/ik")
        waiting = [session.get(key, payload=payload, timeout=60.0) for _ in range(count)]
        replies = [reply for handler in waiting for reply in handler]
    assert len(replies) == count
    errors = [unpack(ErrorReply, reply.err.payload.to_bytes()) for reply in replies if reply.err is not None]
    assert {(error.code, error.retryable) for error in errors} == {("busy", True)}
    assert count - len(errors) >= fit
    assert harness.ask().answers[0].verdict == "solved"


def test_an_answer_that_comes_too_late_is_not_reckoned_to_its_end(harness: IkHarness) -> None:
    began = time.monotonic()
    late = refusal(harness, LONG.model_copy(update={"deadline_ms": 100.0}))
    assert (late.code, late.retryable) == ("deadline", True)
    assert time.monotonic() - began < 2.0
    with ThreadPoolExecutor(1) as pool:
        blocking = pool.submit(refusal, harness, LONG.model_copy(update={"deadline_ms": 400.0}))
        time.sleep(0.1)
        behind = refusal(harness, LONG.model_copy(update={"deadline_ms": 50.0}))
        assert (behind.code, blocking.result().code) == ("deadline", "deadline")


def test_a_cancelled_query_ends_and_takes_no_other_with_it(harness: IkHarness) -> None:
    harness.rover.cancel("long")
    with ThreadPoolExecutor(2) as pool:
        working, queued = pool.submit(refusal, harness, LONG), None
        time.sleep(0.2)
        queued = pool.submit(refusal, harness, LONG)
        other = threading.Thread(target=harness.ask)
        other.start()
        time.sleep(0.5)  # until both wait, on a busy computer too
        assert not working.done(), "a cancellation that came before the query does not meet it"
        harness.rover.cancel("long")
        assert (working.result(5).code, queued.result(5).code) == ("cancelled", "cancelled")
        other.join(5)
        assert not other.is_alive()
    assert harness.ask(id="long").answers[0].verdict == "solved"


def test_a_reload_changes_the_answers_with_the_reply(harness: IkHarness) -> None:
    before, wanted = harness.ask(), harness.changed()
    assert harness.ask().model_sha256 == before.model_sha256, "a file that was written is not yet loaded"
    reply = harness.rover.reload()
    after = harness.ask()
    assert reply.model_sha256 == wanted == after.model_sha256 == harness.rover.info().model_sha256
    assert after.answers[0].q_rad != before.answers[0].q_rad
    assert harness.codes()[-1] == "model_loaded"


def test_a_hangup_signal_reloads_as_well(harness: IkHarness) -> None:
    wanted = harness.changed()
    harness.daemon.signal(signal.SIGHUP)
    wait_for(lambda: harness.ask().model_sha256 == wanted, "the new model answers")
    assert harness.rover.info().model_sha256 == wanted


BAD = {
    "no TOML": ("lrm/model/1", "lrm/mo", "schema"),
    "another arm": ('arm = "lrm-rover"', 'arm = "lrm-lab"', "this daemon drives lrm-rover"),
    "an unknown effect": ('"compliance"]', '"magic"]', "magic"),
    "a compliance of 50 rad/Nm": ('joint2.k_rad_per_Nm" = ', 'joint2.k_rad_per_Nm" = 50.0 # ', "no model of this arm"),
    "an offset of a radian": ('joint2.theta_rad" = ', 'joint2.theta_rad" = 1.0 # ', "its limits are -100 to 100 deg"),
    "an unknown parameter": ("offsets.joint2.alpha_rad", "offsets.joint2.alpha_mm", "alpha_mm"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_file_is_refused_with_the_reason_and_the_old_model_goes_on(harness: IkHarness, what: str) -> None:
    old, new, says = BAD[what]
    text, before = harness.model.read_text(), harness.ask()
    assert old in text
    harness.model.write_text(text.replace(old, new))
    with pytest.raises(RequestRefused) as caught:
        harness.rover.reload()
    assert caught.value.code == "model"
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert harness.ask().model_sha256 == before.model_sha256 == harness.rover.info().model_sha256
    assert harness.codes()[-1] == "model_refused"


def test_a_missing_file_is_refused(harness: IkHarness) -> None:
    harness.model.unlink()
    with pytest.raises(RequestRefused) as caught:
        harness.rover.reload()
    assert caught.value.code == "model"
    assert harness.ask().answers[0].verdict == "solved"


def test_a_reload_waits_for_the_ik_process_and_nobody_else_waits_with_it(harness: IkHarness) -> None:
    wanted = harness.changed()
    ik = harness.daemon.child("ik")
    os.kill(ik, signal.SIGSTOP)
    with ThreadPoolExecutor(1) as pool:
        reloading = pool.submit(harness.rover.reload)
        time.sleep(0.3)
        assert harness.rover.mode().mode == "disarmed"
        assert not reloading.done()
        os.kill(ik, signal.SIGCONT)
        assert reloading.result(5).model_sha256 == wanted
    assert harness.ask().model_sha256 == wanted


def test_after_its_death_it_answers_again_with_the_same_model(harness: IkHarness) -> None:
    before = harness.ask()
    os.kill(harness.daemon.child("ik"), signal.SIGKILL)
    harness.wait_for_answers()
    assert harness.ask().model_sha256 == before.model_sha256
    assert "ik_died" in harness.codes()


def test_until_it_is_back_every_query_is_told_so(harness: IkHarness) -> None:
    deaths, answers = harness.codes().count("ik_died"), []
    os.kill(harness.daemon.child("ik"), signal.SIGKILL)
    wait_for(lambda: harness.codes().count("ik_died") > deaths, "its death is noticed")
    with zenoh.open(client([harness.setup.endpoint])) as session:

        def answered() -> bool:
            for tail, request in (("rpc/cancel", CancelRequest(id="none")), ("rpc/ik", IkRequest(goals=[GOAL]))):
                replies = session.get(harness.setup.key(tail), payload=pack(request), timeout=5.0)
                errors = [unpack(ErrorReply, r.err.payload.to_bytes()) if r.err else None for r in replies]
                answers.append([(e.code, e.retryable) if e else None for e in errors])
            return answers[-1] == [None]

        wait_for(answered, "it answers again", START_TIMEOUT)
    assert [("busy", True)] in answers
    assert all(one and set(one) <= {None, ("busy", True)} for one in answers), "none is left without a reply"


def test_after_its_death_it_takes_no_file_that_the_daemon_has_not_accepted(harness: IkHarness) -> None:
    wanted = harness.changed()
    os.kill(harness.daemon.child("ik"), signal.SIGKILL)
    seen: list[str] = []

    def refused() -> bool:
        try:
            harness.ask()
        except RequestRefused as error:
            seen.extend([error.code] if error.code != "busy" else [])
        except NoReply:
            pass
        return bool(seen)

    wait_for(refused, "it refuses to answer", START_TIMEOUT, 0.05)
    assert seen == ["no_model"]
    assert harness.rover.reload().model_sha256 == wanted
    assert harness.ask().model_sha256 == wanted


def test_a_question_to_several_robots_at_once_is_refused(harness: IkHarness) -> None:
    with zenoh.open(client([harness.setup.endpoint])) as session:
        for tail in ("rpc/ik", "rpc/fk", "rpc/plan", "rpc/cancel", "rpc/reload"):
            replies = list(session.get(f"lrm/*/{tail}", payload=pack(IkRequest(goals=[GOAL])), timeout=5.0))
            errors = [unpack(ErrorReply, reply.err.payload.to_bytes()).code for reply in replies if reply.err]
            assert errors == ["wildcard"]


def test_lrm_reload_says_what_was_loaded(harness: IkHarness, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = harness.changed()
    assert app.main(["--connect", harness.setup.endpoint, "reload"]) == 0
    assert capsys.readouterr().out == f"model {harness.model}, sha256 {wanted[:12]}\n"
    harness.model.write_text("nothing")
    assert app.main(["--connect", harness.setup.endpoint, "reload"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
