"""Clients that flood a daemon from their own processes: `python -m tests.soak.hostile.flood ENDPOINT KIND SECONDS`."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import msgpack
import zenoh

from tests.soak.hostile.estop_client import foreign
from tests.soak.hostile.stuffing import CONTENTS, TEXTS, deployed

ROOT = Path(__file__).resolve().parents[3]
KEYS = (
    "cmd/target", "cmd/jog", "rpc/lease", "rpc/arm", "rpc/move", "rpc/hold", "rpc/relax", "rpc/disarm",
    "rpc/reset_fault", "rpc/events", "rpc/ik", "rpc/fk", "rpc/plan", "rpc/cancel", "state/joints", "state/mode",
    "state/faults", "state/thermal", "state/metrics", "info", "event/mode", "alive/lrmd", "nothing/like/this",
)  # fmt: skip
"""Without those of the emergency stop, where also nonsense stops the arm, and without `rpc/reload`."""
PATTERNS = ("lrm/**", "lrm/*/rpc/*", "lrm/*/cmd/*", "**", "lrm/*/state/*")
HARMLESS = frozenset({"rpc/hold"})
"""Keys on which an empty message is a valid one that needs no lease."""


def nonsense(rng: random.Random) -> bytes:
    """A payload that is no message of anybody: noise, a wrong type, wrong fields, too long, too deep."""
    match rng.randrange(7):
        case 0:
            return rng.randbytes(rng.randrange(1, 300))
        case 1:
            return bytes(msgpack.packb(rng.choice([[], 7, None, "arm", [[[]]] * 50])))
        case 2:
            return bytes(msgpack.packb({"v": rng.choice([0, 2, "1", None]), "lease": "x"}))
        case 3:
            return bytes(msgpack.packb({"v": 1, "lease": "x", "waypoints": [{"joint1": float("nan")}]}))
        case 4:
            return bytes(msgpack.packb({"v": 1, "lease": "x", "rate_rad_per_s": {f"j{i}": 1.0 for i in range(900)}}))
        case 5:
            return b"\x91" * 5000 + b"\x90"
    return bytes(msgpack.packb({"v": 1, "surprise": "x" * rng.choice([10, 100_000])}))


def malformed(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """One bad put, and now and then a bad query, on any key, or on several at once."""
    tail = rng.choice(KEYS)
    where = f"lrm/{robot}/{tail}" if rng.random() < 0.9 else rng.choice(PATTERNS)
    session.put(where, nonsense(rng))
    if rng.random() < 0.2 and tail not in HARMLESS:
        session.get(f"lrm/{robot}/{tail}", lambda _: None, payload=nonsense(rng), timeout=1.0)


def fight(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """A stranger without a valid lease tries to renew, to move, to disarm, as fast as it can."""
    for tail, fields in (
        ("rpc/lease", {"action": "acquire", "holder": "fighter"}),
        ("rpc/lease", {"action": "renew", "lease": "x" * 16}),
        ("rpc/move", {"lease": "x" * 16, "waypoints": [{"joint1": rng.uniform(-1, 1)}]}),
        ("rpc/disarm", {"lease": "x" * 16}),
    ):
        list(session.get(f"lrm/{robot}/{tail}", payload=msgpack.packb({"v": 1, **fields}), timeout=1.0))


def curious(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """Everything there is to be read, again and again."""
    list(session.get(f"lrm/{robot}/{rng.choice(['state/*', 'info', 'rpc/events'])}", timeout=1.0))


def hog(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """A thousand goals, and one plan, as often as they are taken."""
    goals = [{"position_m": [rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), rng.uniform(0, 0.5)]} for _ in range(1000)]
    ik = msgpack.packb({"v": 1, "goals": goals, "deadline_ms": 2000.0})
    plan = msgpack.packb({"v": 1, "from_rad": [-1.5, 1.2, 0, 0, 0, 0], "to_rad": [1.5, 1.2, 0, 0, 0, 0]})
    session.get(f"lrm/{robot}/rpc/plan", lambda _: None, payload=plan, timeout=5.0)
    list(session.get(f"lrm/{robot}/rpc/ik", payload=ik, timeout=5.0))


def large(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """Two megabytes on a key of commands."""
    session.put(f"lrm/{robot}/{rng.choice(['cmd/target', 'rpc/ik', 'state/joints'])}", rng.randbytes(2_000_000))


def small(session: zenoh.Session, _: str, __: random.Random) -> None:
    """A few bytes on every key at once, the emergency stop's among them, as fast as they are taken."""
    for ___ in range(100):
        session.put("lrm/**", b"x")


def small_patterns(session: zenoh.Session, robot: str, _: random.Random) -> None:
    """The same on patterns of all kinds that match the keys of the emergency stop."""
    for pattern in ("**", f"lrm/{robot}/**", "lrm/*/cmd/*", "lrm/**/estop", f"lrm/{robot}/cmd/e$*p", "lrm/*/*/estop"):
        session.put(pattern, b"x")


def small_commands(session: zenoh.Session, robot: str, _: random.Random) -> None:
    """The same on a key of commands, exactly."""
    for __ in range(100):
        session.put(f"lrm/{robot}/cmd/target", b"x")


def asking(session: zenoh.Session, _: str, __: random.Random) -> None:
    """Queries to every key at once, the emergency stop's among them, without waiting for the replies."""
    session.get("lrm/**", lambda _: None, timeout=0.1)


def deploy(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """A text that is no model, and waits for what is said of it."""
    list(session.get(f"lrm/{robot}/rpc/deploy", payload=deployed(rng.choice([*TEXTS.values()])()), timeout=20.0))


def stuff(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """Queries that are no message, of many parts, eight at once, where even an empty message would be harmless."""
    content = rng.choice([*CONTENTS.values()])()
    for _ in range(8 if len(content) < 10_000_000 else 1):
        tail = rng.choice(["rpc/hold", "rpc/move", "rpc/ik", "rpc/lease", "state/joints", "rpc/events", "rpc/cancel"])
        session.get(f"lrm/{robot}/{tail}", lambda _: None, payload=content, timeout=5.0)
        session.put(f"lrm/{robot}/{rng.choice(['cmd/target', 'cmd/jog'])}", content)
    time.sleep(0.1)


def starve(session: zenoh.Session, robot: str, rng: random.Random) -> None:
    """64 questions of 1000 goals at once, in the session's own name; then it waits a while."""
    goals = [{"position_m": [rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), rng.uniform(0, 0.5)]} for _ in range(1000)]
    ik = msgpack.packb({"v": 1, "goals": goals, "deadline_ms": 60_000.0})
    querier = session.declare_querier(f"lrm/{robot}/rpc/ik")
    for _ in range(64):
        source = zenoh.SourceInfo(querier.id, 0)
        session.get(f"lrm/{robot}/rpc/ik", lambda _: None, payload=ik, timeout=60.0, source_info=source)
    time.sleep(1.0)


KINDS: dict[str, Callable[[zenoh.Session, str, random.Random], None]] = {
    "malformed": malformed, "fight": fight, "curious": curious, "hog": hog, "large": large, "small": small,
    "small patterns": small_patterns, "small commands": small_commands, "asking": asking,
    "deploy": deploy, "stuff": stuff, "starve": starve,
}  # fmt: skip
MIXED = ("malformed", "fight", "curious", "hog", "large")
FLOODS: dict[str, tuple[str, ...]] = {
    **{kind: (kind,) for kind in KINDS}, "five kinds at once": MIXED,
    **{f"{kind}, {n} clients": (kind,) * n for kind in ("small", "small patterns", "small commands") for n in (2, 4)},
    "asking, 4 clients": ("asking",) * 4,
}  # fmt: skip
"""Floods by name: the kind of each client."""


def flood(endpoint: str, kind: str, seconds: float, robot: str = "rover") -> int:
    """Floods for a time with the settings that a foreign client has; how many rounds it came to."""
    rng, end, rounds = random.Random(kind), time.monotonic() + seconds, 0
    with zenoh.open(foreign(endpoint)) as session:
        act = partial(KINDS[kind], session, robot, rng)
        while time.monotonic() < end:
            act()
            rounds += 1
    return rounds


@contextmanager
def flooded(endpoint: str, kinds: tuple[str, ...] = MIXED, seconds: float = 600.0) -> Iterator[None]:
    """Floods of these kinds while the block runs, each from a process of its own."""
    command = [sys.executable, "-m", "tests.soak.hostile.flood", endpoint]
    running = [
        subprocess.Popen([*command, kind, str(seconds)], cwd=ROOT, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        for kind in kinds
    ]
    try:
        time.sleep(1.0)
        yield
        assert all(process.poll() is None for process in running), "a flood ended by itself"
    finally:
        for process in running:
            process.kill()
            process.wait()


if __name__ == "__main__":
    print(flood(sys.argv[1], sys.argv[2], float(sys.argv[3])), "rounds")
