"""The shipped `config/zenoh` files with real sessions on loopback: who gets in, and who may do what."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
import zenoh
import zenoh.ext

from lrmd.api.presence import Presence
from lrmd.config import ZenohTable
from lrmd.messages.zenoh_session import client, own_endpoints
from tests.conftest import ROOT
from tests.support.daemon.daemon_process import free_port

SHIPPED = ROOT / "config" / "zenoh"
TIMEOUT = 5.0
"""How long (s) a message on loopback may take; only a failing test waits this long."""


def changed(name: str, changes: dict[str, str]) -> str:
    """A shipped file with other endpoints and paths; every change must have something to change."""
    text = (SHIPPED / name).read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text, f"{name} has no {old}"
        text = text.replace(old, new)
    return text


def config(name: str, changes: dict[str, str]) -> zenoh.Config:
    return zenoh.Config.from_json5(changed(name, changes))


def until(condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + TIMEOUT
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


class Robot:
    """Stand-in for a daemon on zenoh: remembers commands, answers questions, says that it is alive."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.session, self.name = session, name
        self.commands: list[tuple[str, str]] = []
        self.asked: list[str] = []
        self._declared = (
            session.declare_subscriber(f"lrm/{name}/cmd/**", self._command),
            session.declare_queryable(f"lrm/{name}/rpc/*", self._answer),
            session.declare_queryable(f"lrm/{name}/info", self._answer),
            session.liveliness().declare_token(f"lrm/{name}/alive/lrmd"),
        )

    def _command(self, sample: zenoh.Sample) -> None:
        self.commands.append((str(sample.key_expr), sample.payload.to_string()))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            self.asked.append(str(query.key_expr))
            query.reply(query.key_expr, self.name)

    def publish(self) -> None:
        self.session.put(f"lrm/{self.name}/state/joints", self.name)

    def heard(self, key: str, payload: str) -> bool:
        return until(lambda: (f"lrm/{self.name}/{key}", payload) in self.commands)


class Person:
    """A client and all that it was shown of a robot."""

    def __init__(self, session: zenoh.Session, robot: str = "rover1") -> None:
        self.session, self.robot = session, robot
        self.shown: list[str] = []
        self._declared = session.declare_subscriber(f"lrm/{robot}/state/**", self._see)

    def _see(self, sample: zenoh.Sample) -> None:
        self.shown.append(sample.payload.to_string())

    def ask(self, key: str) -> list[str]:
        """Every answer; consolidated, that of one of two who answer on a key would be dropped."""
        each = zenoh.ConsolidationMode.NONE
        replies = self.session.get(f"lrm/{self.robot}/{key}", timeout=TIMEOUT, consolidation=each)
        return [reply.ok.payload.to_string() for reply in replies if reply.ok is not None]

    def send(self, key: str, payload: str) -> None:
        self.session.put(f"lrm/{self.robot}/{key}", payload)

    def sees(self, robot: Robot) -> bool:
        """Publishes until something arrives, as a state that comes at 50 Hz does."""

        def arrived() -> bool:
            robot.publish()
            return robot.name in self.shown

        return until(arrived)

    def alive(self) -> list[str]:
        found = self.session.liveliness().get("lrm/*/alive/**", timeout=TIMEOUT)
        return sorted(str(reply.ok.key_expr) for reply in found if reply.ok is not None)


@contextmanager
def person(settings: zenoh.Config, robot: str = "rover1") -> Iterator[Person]:
    with zenoh.open(settings) as session:
        yield Person(session, robot)


@pytest.fixture(scope="module")
def credentials(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The shipped example, as somebody would fill it in."""
    text = (SHIPPED / "credentials.example").read_text(encoding="utf-8").partition("\n")[2]
    path = tmp_path_factory.mktemp("secret") / "credentials"
    path.write_text(text.replace("choose-a-long-one", "long").replace("choose-another", "other"), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made by the shipped script: `good` by the rover's authority, `foreign` by another one."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    folder = tmp_path_factory.mktemp("certificates")
    script = str(SHIPPED / "make-certificates.sh")
    names = ["operator", "viewer", "guest", "rover1", "rover2"]
    subprocess.run([script, str(folder / "good"), "host=localhost,127.0.0.1", *names], check=True, capture_output=True)
    subprocess.run([script, str(folder / "foreign"), "operator"], check=True, capture_output=True)
    return folder


def by_password(port: int, user: str, password: str) -> zenoh.Config:
    return config(
        "client-password.json5",
        {
            "tcp/rover1.local:7447": f"tcp/127.0.0.1:{port}",
            "viewer": user,
            "choose-another": password,
            "timeout_ms: 3000": "timeout_ms: 500",
        },
    )


def by_certificate(port: int, folder: Path, user: str) -> zenoh.Config:
    return config(
        "client-mtls.json5",
        {
            "tls/rover1.local:7448": f"tls/localhost:{port}",
            "authority.crt": str(folder.parent / "good" / "authority.crt"),
            "viewer.": f"{folder}/{user}.",
            "timeout_ms: 3000": "timeout_ms: 500",
        },
    )


def nobody(endpoint: str) -> zenoh.Config:
    """A client without any secret."""
    text = f'{{mode: "client", connect: {{endpoints: ["{endpoint}"], timeout_ms: 500, exit_on_failure: true}}}}'
    return zenoh.Config.from_json5(text)


@contextmanager
def wire_tap(port: int, target: int) -> Iterator[bytearray]:
    """Forwards one connection from `port` to `target`, and gives every byte of it."""
    recorded = bytearray()

    def forward(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while chunk := source.recv(65536):
                recorded.extend(chunk)
                sink.sendall(chunk)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def accept() -> None:
        near, _ = listener.accept()
        far = socket.create_connection(("127.0.0.1", target))
        back = threading.Thread(target=forward, args=(far, near))
        back.start()
        forward(near, far)
        back.join()
        near.close()
        far.close()

    with socket.create_server(("127.0.0.1", port)) as listener:
        tapping = threading.Thread(target=accept)
        tapping.start()
        yield recorded
        tapping.join(TIMEOUT)


Enter = Callable[[str], zenoh.Config]


@dataclass(frozen=True)
class Guarded:
    """A shipped file with roles: its text as it is used here, where it listens, and the way in for a user's name."""

    text: str
    listen: list[str]
    enter: Enter


def by_tls(port: int, folder: Path, local: int | None = None) -> dict[str, str]:
    """Changes for mtls.json5 that listens at `port`, and without certificates at `local`."""
    loopback = {"tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{local or free_port()}"}
    return loopback | {"tls/[::]:7448": f"tls/127.0.0.1:{port}", "/etc/lrm/zenoh/tls": str(folder)}


@pytest.fixture(params=["acl.json5", "mtls.json5"])
def guarded(request: pytest.FixtureRequest, credentials: str) -> Guarded:
    port, local = free_port(), free_port()
    if request.param == "acl.json5":
        secrets = {"operator": "long", "viewer": "other", "guest": "guest"}
        changes = {"tcp/[::]:7447": f"tcp/127.0.0.1:{port}", "/etc/lrm/zenoh/credentials": credentials}
        listen = [f"tcp/127.0.0.1:{port}"]

        def enter(user: str) -> zenoh.Config:
            return by_password(port, user, secrets[user])
    else:
        folder = request.getfixturevalue("certificates") / "good"
        changes = by_tls(port, folder, local)
        listen = [f"tcp/127.0.0.1:{local}", f"tls/127.0.0.1:{port}"]

        def enter(user: str) -> zenoh.Config:
            return by_certificate(port, folder, user)

    return Guarded(changed(request.param, changes), listen, enter)


@pytest.fixture
def robot(guarded: Guarded) -> Iterator[Robot]:
    with zenoh.open(zenoh.Config.from_json5(guarded.text)) as session:
        yield Robot(session, "rover1")


def test_operator_sees_and_commands(robot: Robot, guarded: Guarded) -> None:
    with person(guarded.enter("operator")) as operator:
        assert operator.sees(robot)
        assert operator.alive() == ["lrm/rover1/alive/lrmd"]
        assert operator.ask("rpc/arm") == ["rover1"]
        assert operator.ask("info") == ["rover1"]
        operator.send("cmd/target", "go")
        assert robot.heard("cmd/target", "go")


def test_viewer_sees_but_cannot_command(robot: Robot, guarded: Guarded) -> None:
    with person(guarded.enter("viewer")) as viewer:
        assert viewer.sees(robot)
        assert viewer.alive() == ["lrm/rover1/alive/lrmd"]
        assert viewer.ask("info") == ["rover1"]
        assert viewer.ask("rpc/events") == ["rover1"]
        assert viewer.ask("rpc/arm") == []
        viewer.send("cmd/target", "go")
        viewer.send("cmd/jog", "go")
        viewer.send("cmd/estop", "stop")  # the last one sent is the first to arrive
        assert robot.heard("cmd/estop", "stop")
        assert robot.commands == [("lrm/rover1/cmd/estop", "stop")]
        assert robot.asked == ["lrm/rover1/info", "lrm/rover1/rpc/events"]


def test_anyone_let_in_may_stop_the_arm_and_nothing_else(robot: Robot, guarded: Guarded) -> None:
    with person(guarded.enter("guest")) as guest:
        guest.send("cmd/target", "go")
        guest.send("cmd/estop", "stop")
        assert robot.heard("cmd/estop", "stop")
        assert robot.commands == [("lrm/rover1/cmd/estop", "stop")]
        robot.publish()
        assert guest.ask("rpc/estop") == ["rover1"]
        assert guest.ask("rpc/arm") == guest.ask("rpc/events") == guest.ask("info") == guest.alive() == []
        assert (guest.shown, robot.asked) == ([], ["lrm/rover1/rpc/estop"])


@pytest.mark.parametrize("user", ["operator", "viewer"])
def test_nobody_speaks_for_the_robot(robot: Robot, guarded: Guarded, user: str) -> None:
    lies: list[str] = []
    listener = robot.session.declare_subscriber("lrm/**", lambda sample: lies.append(str(sample.key_expr)))
    with person(guarded.enter(user)) as liar, person(guarded.enter("viewer")) as viewer:
        token = liar.session.liveliness().declare_token("lrm/rover1/alive/liar")
        answers = liar.session.declare_queryable("lrm/rover1/info", lambda query: query.reply(query.key_expr, "a lie"))
        for key in ("state/joints", "event/fault", "info", "cmd/estop"):
            liar.send(key, "a lie")
        assert robot.heard("cmd/estop", "a lie")
        assert until(lambda: bool(lies))  # another subscriber, which hears a moment later
        assert lies == ["lrm/rover1/cmd/estop"]
        assert viewer.alive() == ["lrm/rover1/alive/lrmd"]
        assert viewer.ask("info") == ["rover1"]
        assert viewer.sees(robot)
        assert set(viewer.shown) == {"rover1"}
        answers.undeclare()
        token.undeclare()
    listener.undeclare()


@pytest.mark.parametrize("role", ["operator", "viewer"])
def test_late_joiner_is_told_the_last_state(robot: Robot, guarded: Guarded, role: str) -> None:
    """An advanced publisher's cache lives under keys of its own, which `**` does not reach."""
    publisher = zenoh.ext.declare_advanced_publisher(
        robot.session, "lrm/rover1/state/mode", cache=zenoh.ext.CacheConfig(1), publisher_detection=True
    )
    publisher.put("disarmed")
    told: list[str] = []
    with zenoh.open(guarded.enter(role)) as session:
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        subscriber = zenoh.ext.declare_advanced_subscriber(
            session, "lrm/rover1/state/mode", lambda sample: told.append(sample.payload.to_string()), history=history
        )
        assert until(lambda: told == ["disarmed"])
        subscriber.undeclare()
    publisher.undeclare()


@pytest.mark.usefixtures("robot")
def test_daemons_own_process_answers_whoever_may_ask(guarded: Guarded, tmp_path: Path) -> None:
    """Inverse kinematics is answered by a client of the daemon's own, made from the daemon's own file."""
    file = tmp_path / "zenoh.json5"
    file.write_text(guarded.text, encoding="utf-8")
    endpoints = own_endpoints(ZenohTable(listen=guarded.listen, config=str(file)))
    settings = client(endpoints, str(file))
    with zenoh.open(settings) as own, person(guarded.enter("operator")) as operator:

        def solve(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, "solved")

        queryable = own.declare_queryable("lrm/rover1/rpc/ik", solve)
        assert until(lambda: "solved" in operator.ask("rpc/ik"))
        with person(guarded.enter("viewer")) as viewer:
            assert viewer.ask("rpc/ik") == []
        queryable.undeclare()


@pytest.mark.parametrize("name", ["password.json5", "acl.json5"])
def test_wrong_password_is_refused(name: str, credentials: str) -> None:
    port = free_port()
    changes = {"tcp/[::]:7447": f"tcp/127.0.0.1:{port}", "/etc/lrm/zenoh/credentials": credentials}
    with zenoh.open(config(name, changes)) as session:
        robot = Robot(session, "rover1")
        strangers = (
            by_password(port, "operator", "other"),
            by_password(port, "intruder", "long"),
            nobody(f"tcp/127.0.0.1:{port}"),
        )
        for stranger in strangers:
            with pytest.raises(zenoh.ZError), zenoh.open(stranger):
                pass
        with person(by_password(port, "operator", "long")) as operator:
            assert operator.ask("rpc/arm") == ["rover1"]
        assert robot.asked == ["lrm/rover1/rpc/arm"]


def test_password_is_not_sent(credentials: str) -> None:
    """Through a wire-tap: the password itself never crosses the network."""
    port, tap = free_port(), free_port()
    changes = {"tcp/[::]:7447": f"tcp/127.0.0.1:{port}", "/etc/lrm/zenoh/credentials": credentials}
    with zenoh.open(config("password.json5", changes)) as session, wire_tap(tap, port) as recorded:
        Robot(session, "rover1")
        with person(by_password(tap, "operator", "long")) as operator:
            assert operator.ask("rpc/arm") == ["rover1"]
        assert b"operator" in recorded
        assert b"long" not in recorded


@pytest.mark.parametrize("credentials", ["no-such-file", str(SHIPPED / "credentials.example")])
def test_no_credentials_no_start(credentials: str) -> None:
    """Neither without the file, nor with the passwords that everybody can read here."""
    with pytest.raises(zenoh.ZError, match="password dictionary"):
        zenoh.open(config("acl.json5", {"/etc/lrm/zenoh/credentials": credentials, "[::]:7447": "127.0.0.1:0"}))


def test_wrong_certificate_is_refused(certificates: Path) -> None:
    port = free_port()
    with zenoh.open(config("mtls.json5", by_tls(port, certificates / "good"))) as session:
        robot = Robot(session, "rover1")
        bare = nobody(f"tls/localhost:{port}")
        bare.insert_json5("transport/link/tls/root_ca_certificate", f'"{certificates}/good/authority.crt"')
        strangers = (by_certificate(port, certificates / "foreign", "operator"), bare, nobody(f"tcp/127.0.0.1:{port}"))
        for stranger in strangers:
            with pytest.raises(zenoh.ZError), zenoh.open(stranger):
                pass
        with person(by_certificate(port, certificates / "good", "operator")) as operator:
            assert operator.ask("rpc/arm") == ["rover1"]
        assert robot.asked == ["lrm/rover1/rpc/arm"]


def test_client_does_not_talk_to_a_false_rover(certificates: Path) -> None:
    """One who only holds a client's certificate cannot pose as a rover."""
    port, folder = free_port(), certificates / "good"
    changes = {"/etc/lrm/zenoh/tls/host": str(folder / "viewer")} | by_tls(port, folder)
    with (
        zenoh.open(config("mtls.json5", changes)),
        pytest.raises(zenoh.ZError),
        zenoh.open(by_certificate(port, folder, "operator")),
    ):
        pass


@pytest.mark.parametrize("name", ["open-loopback.json5", "lan.json5"])
def test_open_files_let_everybody_command(name: str) -> None:
    port = free_port()
    listen = {"open-loopback.json5": "tcp/127.0.0.1:7447", "lan.json5": "tcp/[::]:7447"}[name]
    with zenoh.open(config(name, {listen: f"tcp/127.0.0.1:{port}"})) as session:
        robot = Robot(session, "rover1")
        with person(nobody(f"tcp/127.0.0.1:{port}")) as somebody:
            assert somebody.sees(robot)
            assert somebody.ask("rpc/arm") == ["rover1"]


def central_router(folder: Path, port: int) -> zenoh.Config:
    return config("router.json5", {"tls/[::]:7448": f"tls/127.0.0.1:{port}", "/etc/lrm/zenoh/tls": str(folder)})


def rover_under(port: int, folder: Path, name: str, own: int) -> zenoh.Config:
    """A rover that listens on `own`, under the router on `port`."""
    changes = {"tls/router.local:7448": f"tls/localhost:{port}", "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{own}"}
    changes |= {"/etc/lrm/zenoh/tls/host": str(folder / name), "/etc/lrm/zenoh/tls": str(folder)}
    return config("rover.json5", changes)


@contextmanager
def fleet(folder: Path) -> Iterator[tuple[int, int, Robot, Robot]]:
    """A router, and two rovers under it. Gives the router's port, the first rover's own port, and both rovers."""
    port, local, other = free_port(), free_port(), free_port()
    with (
        zenoh.open(central_router(folder, port)),
        zenoh.open(rover_under(port, folder, "rover1", local)) as first,
        zenoh.open(rover_under(port, folder, "rover2", other)) as second,
    ):
        yield port, local, Robot(first, "rover1"), Robot(second, "rover2")


def test_two_rovers_under_one_router_do_not_mix(certificates: Path) -> None:
    folder = certificates / "good"
    with fleet(folder) as (port, _, first, second), person(by_certificate(port, folder, "operator"), "rover2") as boss:
        assert until(lambda: boss.alive() == ["lrm/rover1/alive/lrmd", "lrm/rover2/alive/lrmd"])
        first.publish()
        assert boss.sees(second)
        assert set(boss.shown) == {"rover2"}
        assert boss.ask("rpc/arm") == ["rover2"]
        boss.send("cmd/target", "go")
        assert second.heard("cmd/target", "go")
        with person(by_certificate(port, folder, "operator"), "rover1") as other:
            assert other.ask("rpc/arm") == ["rover1"]
        with person(by_certificate(port, folder, "guest"), "rover1") as guest:
            guest.send("cmd/target", "go")
            guest.send("cmd/estop", "stop")
            assert first.heard("cmd/estop", "stop")
        assert (first.commands, second.commands) == (
            [("lrm/rover1/cmd/estop", "stop")],
            [("lrm/rover2/cmd/target", "go")],
        )
        assert (first.asked, second.asked) == (["lrm/rover1/rpc/arm"], ["lrm/rover2/rpc/arm"])


def test_a_rover_cannot_reach_or_imitate_another(certificates: Path) -> None:
    folder = certificates / "good"
    with (
        fleet(folder) as (port, local, first, second),
        person(by_certificate(port, folder, "viewer"), "rover2") as viewer,
    ):
        assert viewer.sees(second)
        with person(nobody(f"tcp/127.0.0.1:{local}"), "rover2") as on_first:
            on_first.send("cmd/target", "go")
            on_first.send("state/joints", "a lie")
            assert on_first.ask("rpc/arm") == on_first.ask("info") == []
            second.publish()
            assert until(lambda: bool(on_first.shown))
            assert on_first.shown == ["a lie"]  # its own words, and none of the other rover's
        with person(nobody(f"tcp/127.0.0.1:{local}"), "rover1") as at_home:
            assert at_home.sees(first)
            assert at_home.ask("rpc/arm") == ["rover1"]
        assert viewer.sees(second)
        assert set(viewer.shown) == {"rover2"}
        assert (second.commands, second.asked) == ([], [])


def test_two_rovers_of_one_name_under_one_router_see_each_other(certificates: Path) -> None:
    folder, port = certificates / "good", free_port()
    with (
        zenoh.open(central_router(folder, port)),
        zenoh.open(rover_under(port, folder, "rover1", free_port())) as session,
        zenoh.open(rover_under(port, folder, "rover2", free_port())) as another,
    ):
        first, stranger = Presence(session, "rover1", "1"), Presence(another, "rover2", "9")
        with zenoh.open(rover_under(port, folder, "rover1", free_port())) as twin:
            second = Presence(twin, "rover1", "2")
            assert until(lambda: (first.others, second.others) == ({"2"}, {"1"}))
        assert until(lambda: not first.others)
        assert not stranger.others


def test_rover_works_without_its_router(certificates: Path) -> None:
    folder, local = certificates / "good", free_port()
    changes = {"tls/router.local:7448": f"tls/localhost:{free_port()}", "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{local}"}
    with zenoh.open(
        config(
            "rover.json5",
            changes | {"/etc/lrm/zenoh/tls/host": str(folder / "rover1"), "/etc/lrm/zenoh/tls": str(folder)},
        )
    ) as session:
        robot = Robot(session, "rover1")
        with person(nobody(f"tcp/127.0.0.1:{local}")) as somebody:
            assert somebody.sees(robot)


def test_roles_are_the_same_in_every_file() -> None:
    """The rules of operator, viewer and anyone, and which of them each role has."""
    rules, roles = [], []
    for name in ("acl.json5", "mtls.json5", "router.json5"):
        access = json.loads(zenoh.Config.from_file(str(SHIPPED / name)).get_json("access_control"))
        of_roles = {"watch", "be_shown", "stop", "command", "ask", "be_answered"}
        rules.append([rule for rule in access["rules"] if rule["id"] in of_roles])
        roles.append([p for p in access["policies"] if p["subjects"][0] in ("anyone", "viewers", "operators")])
    assert rules[0] == rules[1] == rules[2]
    assert roles[0] == roles[1] == roles[2]
    assert (len(rules[0]), len(roles[0])) == (6, 3)


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.json5")), ids=lambda path: path.name)
def test_nothing_announces_itself(path: Path) -> None:
    """Multicast scouting is off, and everything denied that a file with roles does not allow."""
    settings = zenoh.Config.from_file(str(path))
    assert settings.get_json("scouting/multicast/enabled") == "false"
    if settings.get_json("access_control/enabled") == "true":
        assert settings.get_json("access_control/default_permission") == '"deny"'


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.json5")), ids=lambda path: path.name)
def test_nothing_uses_shared_memory(path: Path) -> None:
    settings = zenoh.Config.from_file(str(path))
    assert settings.get_json("transport/shared_memory/enabled") == "false"
