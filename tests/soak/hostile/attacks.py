"""The attacks: on the link, by floods of clients, by killing and stopping processes, on the folder of the state."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tests.soak.hostile.approach import renewed_jog, short_moves, waiting_client
from tests.soak.hostile.flood import FLOODS, flooded
from tests.soak.hostile.link_attacks import ATTACKS, Hidden, Mute, OldHandshake
from tests.soak.hostile.link_proxy import LinkProxy
from tests.soak.hostile.trial import AttackResult, Trial, link_trial, trial
from tests.support.daemon.daemon_process import wait_for
from tests.support.motion_models import motion_table

Attack = Callable[[Trial, float], None]
"""Attacks a moving arm for some seconds."""
AttackOnLink = Callable[[Trial, LinkProxy, float], None]


def on_link(name: str) -> AttackOnLink:
    """The man in the middle does the same for the whole time; silences last less than a second each."""

    def attack(t: Trial, proxy: LinkProxy, seconds: float) -> None:
        rng, end = random.Random(name), time.monotonic() + seconds
        while time.monotonic() < end:
            proxy.attack = ATTACKS[name]
            time.sleep(rng.uniform(0.1, 0.8) if "mute" in name or "deaf" in name else min(seconds, 5.0))
            proxy.attack = None
            time.sleep(0.3)
        t.estop()

    return attack


def hidden(t: Trial, proxy: LinkProxy, seconds: float) -> None:
    """The board is silent behind one old acknowledgement, again and again: each time the link is lost."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        t.wait_until_it_moves()
        before = t.daemon.codes().count("link_lost")
        proxy.attack = Hidden()
        wait_for(lambda: t.daemon.codes().count("link_lost") > before, "the link is lost", seconds=3.0)  # noqa: B023
        proxy.attack = None


def old_handshakes(t: Trial, proxy: LinkProxy, seconds: float) -> None:
    """The link is lost while the arm moves, and what the board says then is preceded by what it said the first time."""
    end = time.monotonic() + seconds
    attack, away = OldHandshake(), Mute()
    while time.monotonic() < end:
        t.wait_until_it_moves()
        proxy.attack = away
        time.sleep(0.6)  # longer than the timeout, shorter than the board's silence
        proxy.attack = attack
        time.sleep(0.5)
        proxy.attack = None


def yanked(_: Trial, proxy: LinkProxy, seconds: float) -> None:
    """The cable is pulled and put back, again and again."""
    rng, end = random.Random(0), time.monotonic() + seconds
    while time.monotonic() < end:
        proxy.unplugged.set()
        time.sleep(rng.uniform(0.05, 1.5))
        proxy.unplugged.clear()
        time.sleep(rng.uniform(0.3, 1.0))


def nothing(t: Trial, seconds: float) -> None:
    """Emergency stops only, for comparison."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(0.5)
        t.estop()


def by_flood(*kinds: str) -> Attack:
    """Clients flood the daemon, each from a process of its own; emergency stops meanwhile."""

    def attack(t: Trial, seconds: float) -> None:
        with flooded(t.setup.endpoint, kinds):
            nothing(t, seconds)

    return attack


def stopped_api(t: Trial, seconds: float) -> None:
    """Emergency stops while the api process is stopped (SIGSTOP)."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        t.wait_until_it_moves()
        t.daemon.signal(signal.SIGSTOP)
        try:
            t.estop()
        finally:
            t.daemon.signal(signal.SIGCONT)


def kills(t: Trial, seconds: float) -> None:
    """kill -9 and SIGSTOP of the daemon's processes; when the main one goes, the next daemon is started."""
    rng, end = random.Random(0), time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(rng.uniform(0.3, 1.0))
        name, number = rng.choice(("ramp", "ik", "router", "api")), rng.choice((signal.SIGKILL, signal.SIGSTOP))
        if name == "api":
            t.daemon.signal(number)
            time.sleep(rng.uniform(0.1, 1.5))
            if number == signal.SIGSTOP:
                t.estop()
                t.daemon.signal(signal.SIGCONT)
        else:
            with suppress(ProcessLookupError):
                os.kill(t.daemon.child(name), number)
        if t.daemon.process.poll() is not None:
            t.start_daemon()


def _mounted(t: Trial, seconds: float, spoil: Callable[[Path], None], mend: Callable[[Path], None]) -> None:
    """Another file system over the folder of the state, spoilt for a while."""
    command = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(t.setup.state)]
    mounted = subprocess.run(command, capture_output=True)
    if mounted.returncode:
        print("mounting a file system is not allowed here: this attack is left out")
        return
    try:
        spoil(t.setup.state)
        time.sleep(seconds)
        wait_for(lambda: "state_not_saved" in t.daemon.codes(), "the daemon says that it cannot save")
        mend(t.setup.state)
        wait_for(lambda: "state_saved" in t.daemon.codes(), "the daemon says that it can save again")
    finally:
        subprocess.run(["umount", "-l", str(t.setup.state)], check=True)


def full_folder(t: Trial, seconds: float) -> None:
    """No room left for the state file."""

    def fill(folder: Path) -> None:
        with suppress(OSError), (folder / "filler").open("wb", buffering=0) as file:
            while file.write(bytes(1024)):
                pass

    _mounted(t, seconds, fill, lambda folder: (folder / "filler").unlink())


def read_only_folder(t: Trial, seconds: float) -> None:
    """The folder of the state cannot be written."""

    def remount(how: str) -> Callable[[Path], None]:
        return lambda folder: subprocess.run(["mount", "-o", f"remount,{how}", str(folder)], check=True) and None

    _mounted(t, seconds, remount("ro"), remount("rw"))


ON_LINK: dict[str, AttackOnLink] = {f"link: {name}": on_link(name) for name in ATTACKS} | {
    "link: yanked": yanked,
    "link: hidden board": hidden,
    "link: old handshakes": old_handshakes,
}
ON_DAEMON: dict[str, Attack] = {
    "none": nothing, **{f"flood: {name}": by_flood(*kinds) for name, kinds in FLOODS.items()},
    "api stopped": stopped_api, "kills and stops": kills, "state folder full": full_folder,
    "state folder read-only": read_only_folder, "renewed jog": renewed_jog, "short moves": short_moves,
    "waiting client": waiting_client,
}  # fmt: skip
ALL = (*ON_LINK, *ON_DAEMON)


def carry_out(name: str, seconds: float, shaping: str = "off") -> AttackResult:
    """One attack on a daemon of its own, which shapes its moves as said.

    Raises `AssertionError` if a law is broken, or if the arm is not to be moved any more when the attack is over.
    """
    with tempfile.TemporaryDirectory() as folder:
        changes = {} if shaping == "off" else motion_table(Path(folder), shaping)
        if name in ON_LINK:
            with link_trial(Path(folder), changes) as (t, proxy):
                ON_LINK[name](t, proxy, seconds)
                return _concluded(t, name)
        with trial(Path(folder), changes) as t:
            ON_DAEMON[name](t, seconds)
            return _concluded(t, name)


def _concluded(t: Trial, name: str) -> AttackResult:
    t.wait_until_it_moves()
    t.estop()
    return t.result(name)
