"""Messages: round trip through msgpack, schemas; everything else is one printable line that names the field."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.api.zenoh_server import REQUESTS
from lrmd.config import load_config
from lrmd.messages.bounds import bounds_of
from lrmd.messages.codec import ErrorReply, Header, HeaderSource, Message, MessageError, pack, unpack, unpack_shown
from lrmd.messages.control import ArmRequest, Event, HoldRequest, JogRequest, LeaseRequest, MoveRequest
from lrmd.messages.json_schemas import FILE, schemas, text
from lrmd.messages.kinematics import IkAnswer, IkReply
from lrmd.messages.shown_text import shown
from tests.soak import fuzz_messages
from tests.soak.fuzz_messages import check, fuzz
from tests.soak.fuzz_result import FuzzResult
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon
from tests.support.message_schemas import contents, every_message
from tests.support.sweep import examples

MESSAGES = every_message()
REQUEST_NAMES = sorted({kind.__name__ for kind in REQUESTS.values()})
FULL: dict[str, dict[str, Any]] = {
    "LeaseRequest": {"action": "acquire", "holder": "me", "lease": "t", "take": True},
    "ArmRequest": {"lease": "t", "where": "given", "q_rad": {"joint1": 0.5}},
    "MoveRequest": {"lease": "t", "waypoints": [{"joint1": 0.5}], "pace": "each", "speed": 0.5, "payload_kg": 0.1},
    "PayloadRequest": {"lease": "t", "payload_kg": 0.1},
    "SkillRequest": {"lease": "t", "skill": "grasp", "gripper_rad": 0.1, "payload_kg": 0.1, "listen_s": 0.5},
    "RelaxRequest": {"lease": "t", "servos": ["joint1"]},
    "HoldRequest": {},
    "DisarmRequest": {"lease": "t"},
    "ResetRequest": {"lease": "t"},
    "ReloadRequest": {},
    "DeployRequest": {"text": "schema = 1"},
    "UndeployRequest": {},
}


def refusal(kind: type[Message], content: object) -> str:
    """The one line that a content is refused with."""
    with pytest.raises(MessageError) as caught:
        unpack(kind, msgpack.packb(content))
    line = str(caught.value)
    assert line.isprintable(), line
    assert len(line) < 300
    return line


def fields(kinds: list[str]) -> list[tuple[str, str]]:
    return [(kind, field) for kind in kinds for field in FULL[kind]]


def test_every_request_has_a_full_example_here() -> None:
    assert set(REQUEST_NAMES) == set(FULL)
    for name, content in FULL.items():
        unpack(MESSAGES[name], msgpack.packb(content))


@pytest.mark.slow
@pytest.mark.parametrize("name", MESSAGES)
def test_content_that_the_schema_allows_survives_a_round_trip(name: str) -> None:
    kind = MESSAGES[name]

    @examples(12, 25)
    @given(contents(kind))
    def law(content: dict[str, Any]) -> None:
        message = unpack(kind, msgpack.packb(content))
        assert unpack(kind, pack(message)) == message
        sent = msgpack.unpackb(pack(message))
        assert ("v" in sent) is issubclass(kind, Message)
        for key, value in content.items():
            if not isinstance(value, list | dict):
                assert sent[key] == value

    law()


@pytest.mark.slow
@pytest.mark.parametrize("name", MESSAGES)
@given(unknown=st.text(st.characters(codec="utf-8")))
def test_an_unknown_field_is_named(name: str, unknown: str) -> None:
    kind = MESSAGES[name]
    if unknown not in kind.model_fields:
        content = {**FULL.get(name, {}), unknown: 1}
        line = refusal(kind, content)
        if name in FULL and unknown and unknown.isprintable() and len(unknown) <= 64:
            assert line == f"{unknown}: extra inputs are not permitted"


@pytest.mark.parametrize("name", MESSAGES)
def test_a_missing_field_is_named(name: str) -> None:
    kind = MESSAGES[name]
    needed = [key for key, field in kind.model_fields.items() if field.is_required()]
    if needed:
        assert refusal(kind, {}).startswith(f"{needed[0]}: field required")


@pytest.mark.parametrize(("name", "field"), fields(REQUEST_NAMES))
@pytest.mark.parametrize("wrong", [b"bytes", [[1]], {"a": {"b": 1}}, "no such word" * 10, True, -1e9, 10**30 % 2**63])
def test_a_wrong_type_or_value_is_named(name: str, field: str, wrong: object) -> None:
    if (field, wrong) in (("take", True), ("text", "no such word" * 10)):  # a model file's text is read later
        return
    assert refusal(MESSAGES[name], {**FULL[name], field: wrong}).startswith(field)


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of the floats in a content."""
    if isinstance(value, float):
        yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from leaves(item, (*path, key))


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", [name for name in REQUEST_NAMES if any(leaves(FULL[name]))])
def test_a_number_that_is_not_finite_is_named(name: str, number: float) -> None:
    for path in leaves(FULL[name]):
        content = copy.deepcopy(FULL[name])
        place = content
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = number
        assert refusal(MESSAGES[name], content).startswith(".".join(map(str, path)) + ": ")


@pytest.mark.parametrize(
    ("kind", "content", "field"),
    [
        (LeaseRequest, {"action": "acquire", "holder": "x" * 65}, "holder"),
        (LeaseRequest, {"action": "renew", "lease": ""}, "lease"),
        (MoveRequest, {"lease": "t", "waypoints": []}, "waypoints"),
        (MoveRequest, {"lease": "t", "waypoints": [{}] * 1001}, "waypoints"),
        (JogRequest, {"lease": "t", "rate_rad_per_s": {f"s{i}": 0.0 for i in range(17)}}, "rate_rad_per_s"),
        (JogRequest, {"lease": "t" * 65, "rate_rad_per_s": {}}, "lease"),
        (LeaseRequest, {"action": "acquire", "holder": "red \033[31m"}, "holder"),
        (LeaseRequest, {"action": "acquire", "holder": "two\nlines"}, "holder"),
        (LeaseRequest, {"action": "acquire", "holder": "me\n"}, "holder"),
        (JogRequest, {"lease": "t", "rate_rad_per_s": {"a\nb": 0.1}}, "rate_rad_per_s"),
        (JogRequest, {"v": 2, "lease": "t", "rate_rad_per_s": {}}, "v"),
    ],
)
def test_too_long_too_short_unprintable_or_of_another_version(kind, content, field) -> None:
    assert refusal(kind, content).startswith(field)


def test_arming_refuses_fields_that_it_would_ignore() -> None:
    """`servos` beside where = "board" would arm every servo; angles beside "stored" would be thrown away."""
    assert '"where": "stored"' in refusal(ArmRequest, {"lease": "t", "where": "board", "servos": ["joint1"]})
    assert '"where": "given"' in refusal(ArmRequest, {"lease": "t", "where": "stored", "q_rad": {"joint1": 0.0}})


@given(data=st.binary(max_size=200), name=st.sampled_from(sorted(MESSAGES)))
def test_any_bytes_are_a_message_or_a_message_error(data: bytes, name: str) -> None:
    with suppress(MessageError):
        assert isinstance(unpack(MESSAGES[name], data), MESSAGES[name])


@given(cut=st.integers(1, 200), name=st.sampled_from(REQUEST_NAMES))
def test_a_message_cut_short_is_refused(cut: int, name: str) -> None:
    data = msgpack.packb({"v": 1, **FULL[name]})
    with pytest.raises(MessageError, match="not msgpack"):
        unpack(MESSAGES[name], data[: -min(cut, len(data) - 1)])


@pytest.mark.parametrize("content", [1, "text", [1, 2], None, {1: 2}, msgpack.ExtType(5, b"x"), b"x" * 10])
def test_content_that_is_not_a_map_is_refused(content: object) -> None:
    refusal(MoveRequest, content)


def test_a_message_too_long_is_refused_unparsed() -> None:
    most = bounds_of(MoveRequest).size
    with pytest.raises(MessageError, match=str(most)):
        unpack(MoveRequest, b"\xc1" * (most + 1))
    with pytest.raises(MessageError):
        unpack(MoveRequest, b"\x91" * most)


def test_the_longest_message_that_the_limits_allow_is_read() -> None:
    way = [{f"a servo of a long name {i:02}": -1.234567890123 * i for i in range(16)}] * 1000
    message = MoveRequest(lease="t" * 64, waypoints=way)
    assert unpack(MoveRequest, pack(message)) == message
    q = [0.123456789] * 6
    answer = IkAnswer(
        verdict="solved", text="x" * 200, q_rad=q, branches_rad=[q] * 8, free_joints=[6] * 8, tcp_m=q[:3],
        predicted_error_m=1e-9, predicted_turn_rad=0.1, sd_m=0.1, counts=[4000] * 6, rounded_q_rad=q,
        rounded_error_m=0.1, rounded_turn_rad=0.1, direction=[1] * 6, detours=[1] * 6, cube_error_m=0.1, elapsed_ms=0.1,
    )  # fmt: skip
    reply = IkReply(
        boot_id="b" * 16, seq=1, t_mono_ns=2**60, t_wall_ns=2**60, model="m" * 99, model_sha256="0" * 64, left_out=[],
        answers=[answer] * 1000, elapsed_ms=0.1,
    )  # fmt: skip
    assert unpack(IkReply, pack(reply)) == reply


@pytest.fixture(scope="module")
def daemon() -> InMemoryDaemon:
    sim = SimulatedDaemon(load_config(CONFIG))
    sim.run(30)
    return InMemoryDaemon(sim)


def error_of(daemon: InMemoryDaemon, key: str, payload: bytes) -> ErrorReply:
    """The one error that a query is answered with."""
    answers = daemon.session.get(key, payload)
    assert len(answers) == 1
    return unpack(ErrorReply, answers[0].err.payload.to_bytes())


@pytest.mark.parametrize("tail", REQUESTS)
def test_a_bad_request_gets_an_error_reply_that_names_the_field(daemon: InMemoryDaemon, tail: str) -> None:
    reply = error_of(daemon, f"lrm/rover/{tail}", msgpack.packb({"surprise": 1, **FULL[REQUESTS[tail].__name__]}))
    assert reply.code == "bad_message"
    assert "surprise" in reply.msg
    assert not reply.retryable


@pytest.mark.parametrize("pattern", ["lrm/*/{}", "lrm/rover/**", "lrm/**/{}"])
@pytest.mark.parametrize("tail", [*REQUESTS, "rpc/estop"])
def test_a_request_to_several_at_once_is_not_carried_out(daemon: InMemoryDaemon, tail: str, pattern: str) -> None:
    content = msgpack.packb(FULL.get(REQUESTS.get(tail, Message).__name__, {}))
    before = daemon.sim.core.mode, daemon.sim.core.lease
    answers = daemon.session.get(pattern.format(tail), content)
    errors = [unpack(ErrorReply, a.err.payload.to_bytes()) for a in answers if a.err is not None]
    assert {e.code for e in errors} == {"wildcard"}
    assert any(tail in e.msg for e in errors)
    assert (daemon.sim.core.mode, daemon.sim.core.lease) == before


def test_states_may_be_queried_together(daemon: InMemoryDaemon) -> None:
    keys = {a.ok.key_expr for a in daemon.session.get("lrm/*/state/*") if a.ok is not None}
    assert keys == {
        f"lrm/rover/state/{name}"
        for name in ("joints", "mode", "faults", "thermal", "gravity", "scene", "skill", "metrics")
    }


def test_a_command_that_cannot_be_read_is_an_event(daemon: InMemoryDaemon) -> None:
    heard: list[bytes] = []
    daemon.session.declare_subscriber("lrm/rover/event/refused", lambda sample: heard.append(sample.payload.to_bytes()))
    daemon.session.put("lrm/rover/cmd/jog", b"\xc1")
    assert len(heard) == 1
    assert b"bad_message" in heard[0]
    assert b"cmd/jog" in heard[0]


def test_a_fault_of_the_software_is_an_error_reply(daemon: InMemoryDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(daemon, "handle", lambda *_: 1 / 0)
    reply = error_of(daemon, "lrm/rover/rpc/hold", b"")
    assert (reply.code, reply.retryable) == ("internal", False)


@pytest.mark.slow
def test_twenty_thousand_strings_are_messages_or_message_errors() -> None:
    result = fuzz(20_000, seed=1)
    assert result.violations == []
    assert result.counts["accepted"] > 2_000


def test_a_crash_and_a_lie_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    data, result = pack(LeaseRequest(action="acquire", holder="me")), FuzzResult()
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: 1 / 0)
    check(LeaseRequest, data, result)
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: HoldRequest())
    check(LeaseRequest, data, result)
    assert len(result.violations) == 2


HOSTILE = "held\x1b]0;own\x07\x1b[2J\u202eevil\u2066\r\nlrm: armed"


@given(st.text())
def test_what_is_shown_is_one_printable_line(text: str) -> None:
    assert shown(text).isprintable()
    assert shown(text) == text or not text.isprintable()


def test_no_text_of_a_message_has_an_escape_in_it() -> None:
    content = {"v": 1, "code": HOSTILE, "level": "info", "text": HOSTILE, "detail": {HOSTILE: [HOSTILE]}}
    event = unpack_shown(Event, msgpack.packb({**HeaderSource("b").next("event"), **content}))
    assert event.text == shown(HOSTILE) == "held\\x1b]0;own\\x07\\x1b[2J\\u202eevil\\u2066\\r\\nlrm: armed"
    assert event.detail == {shown(HOSTILE): [shown(HOSTILE)]}
    assert event.code.isprintable()


REQUEST_SCHEMAS = {
    name for name, kind in every_message().items()
    if issubclass(kind, Message) and not issubclass(kind, Header) and name != "ErrorReply"
} | {"GoalEntry", "ContactEntry", "ObstacleEntry"}  # fmt: skip


def test_the_shipped_file_is_in_step_with_the_code() -> None:
    assert FILE.read_text(encoding="utf-8") == text(), "run `make schemas`"


def test_every_message_is_in_it_with_all_its_fields() -> None:
    definitions = schemas()["$defs"]
    for name, kind in every_message().items():
        assert set(definitions[name]["properties"]) == set(kind.model_fields)
    assert set(definitions) - set(every_message()) <= {"JsonValue"}


def test_requests_are_strict_and_replies_may_grow() -> None:
    """An unknown field of a request is an error; a client must not make one of an unknown field of the daemon's."""
    for name, definition in schemas()["$defs"].items():
        if name in REQUEST_SCHEMAS:
            assert definition["additionalProperties"] is False, name
            assert "v" not in definition.get("required", []), "a request without v is of version 1"
        elif name != "JsonValue":
            assert "additionalProperties" not in definition, name
            assert set(definition["required"]) == set(definition["properties"]), "the daemon sends every field"


def test_all_references_lead_somewhere() -> None:
    document = schemas()
    found = json.dumps(document).split('"$ref": "#/$defs/')[1:]
    assert found
    assert {part.partition('"')[0] for part in found} <= set(document["$defs"])
