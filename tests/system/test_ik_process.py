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
from lrmd.client.rover import NoAnswer, RequestRefused, Rover
from lrmd.ik.process import QUEUE
from lrmd.messages.control import ErrorReply, pack, unpack
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkReply, IkRequest, PlanRequest
from lrmd.messages.zenoh_session import client
from tests.support.daemon_process import DaemonProcess, Place, running, wait_for

TABLE_B2 = Path(__file__).resolve().parents[1] / "models" / "thesis-table-b2-option-1.toml"
GOAL = GoalEntry(position_m=[0.2, 0.1, 0.3])
LONG = IkRequest(id="long", goals=[GOAL] * 1000, method="cube", deadline_ms=60_000.0)


class Rig:
    """A daemon with a model file of its own, and a client."""

    def __init__(self, place: Place, daemon: DaemonProcess, rover: Rover, model: Path) -> None:
        self.place, self.daemon, self.rover, self.model = place, daemon, rover, model

    def ask(self, *goals: GoalEntry, **more: object) -> IkReply:
        return self.rover.ik(IkRequest(goals=list(goals) or [GOAL], method="direct", **more))  # type: ignore[arg-type]

    def wait_for_answers(self) -> None:
        def answers() -> bool:
            with suppress(NoAnswer, RequestRefused):
                return bool(self.ask().answers)
            return False

        wait_for(answers, "the ik process answers", pause=0.05)

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
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("daemon")
    model = folder / "model.toml"
    shutil.copy(TABLE_B2, model)
    place = Place.make(folder, {'# model = "/etc/lrm/model.toml"': f'model = "{model}"'})
    with running(place) as (_, daemon), place.rover() as rover:
        rig = Rig(place, daemon, rover, model)
        rig.wait_for_answers()
        yield rig


@pytest.fixture(autouse=True)
def _with_the_first_model(rig: Rig) -> Iterator[None]:
    yield
    shutil.copy(TABLE_B2, rig.model)
    rig.rover.reload()


def refusal(rig: Rig, request: IkRequest) -> RequestRefused:
    with pytest.raises(RequestRefused) as caught:
        rig.rover.ik(request)
    return caught.value


def test_answers_name_the_model_and_solve_what_they_were_asked(rig: Rig) -> None:
    reply = rig.ask()
    assert (reply.model, reply.model_sha256) == (str(rig.model), rig.file_hash)
    assert rig.rover.info().model_sha256 == rig.file_hash
    (answer,) = reply.answers
    assert answer.q_rad is not None
    (place,) = rig.rover.fk(FkRequest(q_rad=[answer.q_rad])).places
    np.testing.assert_allclose(place.tcp_m, GOAL.position_m, atol=1e-6)
    plan = rig.rover.plan(PlanRequest(from_rad=[0.0] * 6, goal=GOAL))
    assert plan.found, plan.text
    assert plan.model_sha256 == rig.file_hash
    (place,) = rig.rover.fk(FkRequest(q_rad=plan.waypoints_rad[-1:])).places
    np.testing.assert_allclose(place.tcp_m, GOAL.position_m, atol=1e-6)


def test_fifty_at_once_are_all_answered_each_with_its_own(rig: Rig) -> None:
    heights = np.linspace(0.25, 0.35, 50).tolist()

    def one(height: float) -> float:
        (answer,) = rig.ask(GoalEntry(position_m=[0.2, 0.1, height]), deadline_ms=20_000.0).answers
        assert answer.tcp_m is not None
        return answer.tcp_m[2]

    with ThreadPoolExecutor(50) as pool:
        np.testing.assert_allclose(list(pool.map(one, heights)), heights, atol=1e-6)


def test_what_does_not_fit_into_the_queue_is_told_to_come_again(rig: Rig) -> None:
    """All are sent before the first is answered; nobody is left without an answer."""
    count = QUEUE + 40
    payload = pack(IkRequest(goals=[GOAL] * 3, method="direct", deadline_ms=60_000.0))
    with zenoh.open(client([rig.place.endpoint])) as session:
        key = rig.place.key("rpc/ik")
        waiting = [session.get(key, payload=payload, timeout=60.0) for _ in range(count)]
        replies = [reply for handler in waiting for reply in handler]
    assert len(replies) == count
    errors = [unpack(ErrorReply, reply.err.payload.to_bytes()) for reply in replies if reply.err is not None]
    assert {(error.code, error.retryable) for error in errors} == {("busy", True)}
    assert count - len(errors) >= QUEUE
    assert rig.ask().answers[0].verdict == "solved"


def test_an_answer_that_comes_too_late_is_not_reckoned_to_its_end(rig: Rig) -> None:
    began = time.monotonic()
    late = refusal(rig, LONG.model_copy(update={"deadline_ms": 100.0}))
    assert (late.code, late.retryable) == ("deadline", True)
    assert time.monotonic() - began < 2.0
    with ThreadPoolExecutor(1) as pool:
        blocking = pool.submit(refusal, rig, LONG.model_copy(update={"deadline_ms": 400.0}))
        time.sleep(0.1)
        behind = refusal(rig, IkRequest(goals=[GOAL], deadline_ms=50.0))
        assert (behind.code, blocking.result().code) == ("deadline", "deadline")


def test_a_cancelled_query_ends_and_takes_no_other_with_it(rig: Rig) -> None:
    rig.rover.cancel("long")
    with ThreadPoolExecutor(2) as pool:
        working, queued = pool.submit(refusal, rig, LONG), None
        time.sleep(0.2)
        queued = pool.submit(refusal, rig, LONG)
        other = threading.Thread(target=rig.ask)
        other.start()
        time.sleep(0.1)
        assert not working.done(), "a cancellation that came before the query does not meet it"
        rig.rover.cancel("long")
        assert (working.result(5).code, queued.result(5).code) == ("cancelled", "cancelled")
        other.join(5)
        assert not other.is_alive()
    assert rig.ask(id="long").answers[0].verdict == "solved"


def test_a_reload_changes_the_answers_with_the_reply(rig: Rig) -> None:
    before, wanted = rig.ask(), rig.changed()
    assert rig.ask().model_sha256 == before.model_sha256, "a file that was written is not yet a file that was loaded"
    reply = rig.rover.reload()
    after = rig.ask()
    assert reply.model_sha256 == wanted == after.model_sha256 == rig.rover.info().model_sha256
    assert after.answers[0].q_rad != before.answers[0].q_rad
    assert rig.codes()[-1] == "model_loaded"


def test_a_hangup_signal_reloads_as_well(rig: Rig) -> None:
    wanted = rig.changed()
    rig.daemon.signal(signal.SIGHUP)
    wait_for(lambda: rig.ask().model_sha256 == wanted, "the new model answers")
    assert rig.rover.info().model_sha256 == wanted


BAD = {
    "no TOML": ("lrm/model/1", "lrm/mo", "schema"),
    "another arm": ('arm = "lrm-rover"', 'arm = "lrm-lab"', "this daemon drives lrm-rover"),
    "an unknown effect": ('"compliance"]', '"magic"]', "magic"),
    "an unknown parameter": ("offsets.joint2.alpha_rad", "offsets.joint2.alpha_mm", "alpha_mm"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_file_is_refused_with_the_reason_and_the_old_model_goes_on(rig: Rig, what: str) -> None:
    old, new, says = BAD[what]
    text, before = rig.model.read_text(), rig.ask()
    assert old in text
    rig.model.write_text(text.replace(old, new))
    with pytest.raises(RequestRefused) as caught:
        rig.rover.reload()
    assert caught.value.code == "model"
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert rig.ask().model_sha256 == before.model_sha256 == rig.rover.info().model_sha256
    assert rig.codes()[-1] == "model_refused"


def test_a_missing_file_is_refused(rig: Rig) -> None:
    rig.model.unlink()
    with pytest.raises(RequestRefused) as caught:
        rig.rover.reload()
    assert caught.value.code == "model"
    assert rig.ask().answers[0].verdict == "solved"


def test_a_reload_waits_for_the_ik_process_and_nobody_else_waits_with_it(rig: Rig) -> None:
    wanted = rig.changed()
    ik = rig.daemon.child("ik")
    os.kill(ik, signal.SIGSTOP)
    with ThreadPoolExecutor(1) as pool:
        reloading = pool.submit(rig.rover.reload)
        time.sleep(0.3)
        assert rig.rover.mode().mode == "disarmed"
        assert not reloading.done()
        os.kill(ik, signal.SIGCONT)
        assert reloading.result(5).model_sha256 == wanted
    assert rig.ask().model_sha256 == wanted


def test_after_its_death_it_answers_again_with_the_same_model(rig: Rig) -> None:
    before = rig.ask()
    os.kill(rig.daemon.child("ik"), signal.SIGKILL)
    rig.wait_for_answers()
    assert rig.ask().model_sha256 == before.model_sha256
    assert "ik_died" in rig.codes()


def test_after_its_death_it_takes_no_file_that_the_daemon_has_not_accepted(rig: Rig) -> None:
    wanted = rig.changed()
    os.kill(rig.daemon.child("ik"), signal.SIGKILL)
    seen: list[str] = []

    def refused() -> bool:
        try:
            rig.ask()
        except RequestRefused as error:
            seen.append(error.code)
        except NoAnswer:
            pass
        return bool(seen)

    wait_for(refused, "it refuses to answer", pause=0.05)
    assert seen == ["no_model"]
    assert rig.rover.reload().model_sha256 == wanted
    assert rig.ask().model_sha256 == wanted


def test_a_question_to_several_robots_at_once_is_refused(rig: Rig) -> None:
    with zenoh.open(client([rig.place.endpoint])) as session:
        for tail in ("rpc/ik", "rpc/fk", "rpc/plan", "rpc/cancel", "rpc/reload"):
            replies = list(session.get(f"lrm/*/{tail}", payload=pack(IkRequest(goals=[GOAL])), timeout=5.0))
            errors = [unpack(ErrorReply, reply.err.payload.to_bytes()).code for reply in replies if reply.err]
            assert errors == ["wildcard"]


def test_lrm_reload_says_what_was_loaded(rig: Rig, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = rig.changed()
    assert app.main(["--connect", rig.place.endpoint, "reload"]) == 0
    assert capsys.readouterr().out == f"model {rig.model}, sha256 {wanted[:12]}\n"
    rig.model.write_text("nothing")
    assert app.main(["--connect", rig.place.endpoint, "reload"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
