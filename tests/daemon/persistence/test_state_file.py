"""The state file is written atomically; one daemon per state directory, one lease at a time."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.errors import FileError
from lrmd.config import Config, load_config
from lrmd.control.lease import Lease, LeaseError, LeaseState
from lrmd.errors import RequestError
from lrmd.messages.control import ArmRequest, LeaseRequest
from lrmd.persistence import state_file
from lrmd.persistence.sole_user import sole_user
from lrmd.persistence.state_file import BackgroundWriter, StoredState, arm_identity, of_this_arm
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon

MS = 1_000_000
NAMES = st.text(min_size=1, max_size=12)


def saved(pulse: int = 1_500_000, mode: str = "armed") -> StoredState:
    return StoredState(
        saved_wall_ns=1,
        boots=3,
        mode=mode,
        still=True,
        pulse_ns={"joint1": pulse},
        fallen=[],
        temperature_c={"joint1": 40.0},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("state")


@pytest.mark.slow
@given(
    state=st.builds(
        StoredState, saved_wall_ns=st.integers(0, 2**62), boots=st.integers(0, 10**9), mode=NAMES, still=st.booleans(),
        pulse_ns=st.dictionaries(NAMES, st.integers(0, 20_000_000), max_size=16),
        temperature_c=st.dictionaries(NAMES, st.floats(-50, 300), max_size=16),
    )
)  # fmt: skip
def test_a_saved_state_is_loaded_again(folder: Path, state: StoredState) -> None:
    state_file.save(folder, state)
    assert state_file.load(folder) == state
    assert [p.name for p in folder.iterdir()] == [state_file.NAME]


def test_no_file_is_no_state(tmp_path: Path) -> None:
    assert state_file.load(tmp_path) is None


class KilledWhileWriting(BaseException):
    """kill -9 as a test can have it: nothing is caught, nothing is cleaned up."""


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_kill_before_the_rename_keeps_the_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    state_file.save(tmp_path, saved(1_500_000))
    with monkeypatch.context() as patch:
        patch.setattr(state_file.os, step, lambda *_: (_ for _ in ()).throw(KilledWhileWriting))
        with pytest.raises(KilledWhileWriting):
            state_file.save(tmp_path, saved(1_700_000))
    assert state_file.load(tmp_path) == saved(1_500_000)
    state_file.save(tmp_path, saved(1_700_000))
    assert state_file.load(tmp_path) == saved(1_700_000)


def test_the_new_file_is_on_the_disk_before_it_has_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Power loss: a rename may reach the disk before the data does, unless the data was synced first."""
    order: list[str] = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(
        state_file.os, "fsync", lambda fd: (order.append(os.readlink(f"/proc/self/fd/{fd}")), fsync(fd))
    )
    monkeypatch.setattr(state_file.os, "replace", lambda a, b: (order.append("rename"), replace(a, b)))
    state_file.save(tmp_path, saved())
    data, rename, directory = order
    assert Path(data).parent == tmp_path.resolve()
    assert rename == "rename"
    assert Path(directory) == tmp_path.resolve()


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    state_file.save(tmp_path, saved(1_500_000))
    with monkeypatch.context() as patch:
        patch.setattr(state_file.os, step, lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(FileError, match=r"state\.json: cannot be written \(No space left on device\)"):
            state_file.save(tmp_path, saved(1_700_000))
    assert state_file.load(tmp_path) == saved(1_500_000)
    assert [p.name for p in tmp_path.iterdir()] == [state_file.NAME]


def test_after_a_full_disk_the_pose_of_before_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The arm has moved since; armed where it stood then, its servos would jump there."""
    told: list[FileError | None] = []
    state_file.save(tmp_path, saved(1_500_000))
    with monkeypatch.context() as patch:
        patch.setattr(state_file.os, "fsync", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        writer = BackgroundWriter(tmp_path, told.append)
        writer.put(saved(1_700_000))
        writer.close()
    assert len(told) == 1
    found = state_file.load(tmp_path)
    assert found == saved(1_500_000).model_copy(update={"still": False, "fallen": None})
    writer = BackgroundWriter(tmp_path, told.append)
    writer.put(saved(1_700_000))
    writer.close()
    assert state_file.load(tmp_path) == saved(1_700_000)
    assert [path.name for path in tmp_path.iterdir()] == [state_file.NAME]


def test_a_pose_that_the_arm_leaves_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The writer knows whether there is one, so that a motion under way asks nothing of the disk."""
    writer = BackgroundWriter(tmp_path, lambda _: None)
    assert not writer.leave_pose()
    for still in (True, False):
        writer.put(saved(1_500_000).model_copy(update={"still": still}))
        wait_until(lambda still=still: (found := state_file.load(tmp_path)) is not None and found.still is still)
        assert writer.leave_pose() is still
        found = state_file.load(tmp_path)
        assert not found.still
    writer.put(saved(1_600_000))
    writer.close()
    with monkeypatch.context() as patch:
        patch.setattr(state_file.os, "replace", lambda *_: (_ for _ in ()).throw(OSError(30, "Read-only file system")))
        with pytest.raises(FileError, match=r"state\.json: cannot be renamed \(Read-only file system\)"):
            writer.leave_pose()
    assert BackgroundWriter(tmp_path, lambda _: None).leave_pose()


def wait_until(met: Callable[[], bool]) -> None:
    end = time.monotonic() + 10.0
    while not met():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_no_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        state_file.save(tmp_path / "none", saved())


@given(cut=st.integers(0, 1000), flip=st.integers(0, 1000), byte=st.integers(0, 255))
def test_a_damaged_file_is_an_error_or_still_a_state(folder: Path, cut: int, flip: int, byte: int) -> None:
    whole = bytearray(saved().model_dump_json(by_alias=True, indent=1).encode())
    whole[flip % len(whole)] = byte
    (folder / state_file.NAME).write_bytes(whole[: cut % (len(whole) + 1)])
    try:
        state = state_file.load(folder)
    except FileError as error:
        damaged = str(error)
    else:
        assert isinstance(state, StoredState)
        assert all(0 <= pulse <= 20_000_000 for pulse in state.pulse_ns.values())
        return
    assert "is damaged" in damaged
    assert state_file.NAME in damaged
    assert "\n" not in damaged


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"pulse_ns": {"joint1": -1}}, "pulse_ns.joint1"),
        ({"pulse_ns": {"joint1": 1.5}}, "pulse_ns.joint1"),
        ({"temperature_c": {"joint1": 1e9}}, "temperature_c.joint1"),
        ({"surprise": 1}, "surprise"),
        ({"schema": "lrm/state/2"}, "schema"),
        ({"still": "yes"}, "still"),
    ],
)
def test_the_error_names_the_damaged_field(tmp_path: Path, change: dict[str, object], where: str) -> None:
    content = {**saved().model_dump(by_alias=True), **change}
    (tmp_path / state_file.NAME).write_text(str(content).replace("'", '"').replace("True", "true"))
    with pytest.raises(FileError) as caught:
        state_file.load(tmp_path)
    assert caught.value.where == where


def test_a_damaged_file_is_kept_for_inspection(tmp_path: Path) -> None:
    (tmp_path / state_file.NAME).write_bytes(b"half a fi")
    aside = state_file.set_aside(tmp_path)
    assert aside.read_bytes() == b"half a fi"
    assert state_file.load(tmp_path) is None


LIFETIME = 400 * MS
TIME = st.integers(0, 10**15)


@given(now=TIME, later=st.integers(0, 2 * LIFETIME))
def test_a_lease_lives_exactly_its_lifetime(now: int, later: int) -> None:
    mine = Lease().acquired("me", now, LIFETIME, take=False, proof=None)
    then = mine.at(now + later)
    if later < LIFETIME:
        assert then is mine
        then.check(mine.token)
        renewed = then.renewed(mine.token, now + later, LIFETIME)
        assert renewed.until == now + later + LIFETIME
        assert (renewed.holder, renewed.token) == (mine.holder, mine.token)
    else:
        with pytest.raises(LeaseError, match="has run out"):
            then.check(mine.token)
        with pytest.raises(LeaseError, match="has run out"):
            then.renewed(mine.token, now + later, LIFETIME)


@given(now=TIME, later=st.integers(0, 2 * LIFETIME), take=st.booleans())
def test_there_is_one_holder_at_a_time(now: int, later: int, take: bool) -> None:
    mine = Lease().acquired("me", now, LIFETIME, take=False, proof=None)
    then = mine.at(now + later)
    if later < LIFETIME and not take:
        with pytest.raises(LeaseError, match="me holds the lease"):
            then.acquired("you", now + later, LIFETIME, take, None)
        return
    yours = then.acquired("you", now + later, LIFETIME, take, None)
    assert yours.token != mine.token
    with pytest.raises(LeaseError, match="you's now"):
        yours.check(mine.token)


@pytest.mark.parametrize("present", [Lease(), Lease(LeaseState.HELD, "you", "t", 10**18)])
def test_commands_without_a_lease_are_refused_with_a_hint(present: Lease) -> None:
    with pytest.raises(LeaseError, match="rpc/lease"):
        present.check(None)
    with pytest.raises(LeaseError, match="rpc/lease"):
        present.renewed(None, 0, LIFETIME)


def test_tokens_are_not_guessed() -> None:
    tokens = {Lease().acquired("me", 0, LIFETIME, take=False, proof=None).token for _ in range(1000)}
    assert len(tokens) == 1000
    assert all(len(token) >= 16 for token in tokens)


CONFIGURED = load_config(CONFIG)
OTHER_TABLE = replace(CONFIGURED, servos=(replace(CONFIGURED.servos[0], channel=15), *CONFIGURED.servos[1:]))
OTHER_CLOCK = replace(CONFIGURED, link=CONFIGURED.link.model_copy(update={"oscillator_hz": 27e6}))
OTHER_ARM = replace(CONFIGURED, arm=replace(CONFIGURED.arm, name="lrm-lab"))


def saved_by(config: Config) -> StoredState:
    """State that a controller of that configuration stores."""
    sim = SimulatedDaemon(config)
    sim.core.payload = 0.2
    state = sim.core.saved(1)
    return state.model_copy(
        update={"pulse_ns": {"joint1": 1_500_000}, "still": False, "temperature_c": {"joint2": 90.0}}
    )


def test_the_state_of_the_same_arm_is_used_as_it_is() -> None:
    stored = saved_by(CONFIGURED)
    assert of_this_arm(stored, load_config(CONFIG)) == (stored, "")
    sim = SimulatedDaemon(CONFIGURED, stored=stored)
    assert sim.core.payload == 0.2
    assert sim.core.saved(2).payload_kg == 0.2


@pytest.mark.parametrize(
    ("stored", "words", "temperatures"),
    [
        (saved_by(OTHER_ARM), "the state of lrm-lab, and this daemon drives lrm-rover", {}),
        (saved_by(OTHER_TABLE), "servo tables of lrm-rover were changed", {"joint2": 90.0}),
        (saved_by(OTHER_CLOCK), "clock or servo tables of lrm-rover were changed", {"joint2": 90.0}),
        (saved(), "an older release wrote it", {"joint1": 40.0}),
    ],
)
def test_pulses_of_another_arm_or_of_nobody_knows_which_are_no_pose(stored, words, temperatures) -> None:
    used, why = of_this_arm(stored, CONFIGURED)
    assert words in why
    assert used.pulse_ns == {}
    assert used.temperature_c == temperatures
    assert used.boots == stored.boots
    sim = SimulatedDaemon(CONFIGURED, stored=used)
    sim.run(30)
    token = sim.core.handle(LeaseRequest(action="acquire", holder="test"), sim.now).lease
    with pytest.raises(RequestError, match="no pose was stored"):
        sim.core.handle(ArmRequest(lease=token.token, where="stored"), sim.now)


def test_the_identity_is_of_everything_that_gives_a_pulse_its_meaning_and_of_nothing_else() -> None:
    first, *others = CONFIGURED.servos
    shifted = replace(first.table, pulse=tuple(p + 1e-6 for p in first.table.pulse))
    bent = replace(CONFIGURED.arm, joints=(replace(CONFIGURED.arm.joints[0], d=0.2), *CONFIGURED.arm.joints[1:]))
    meaning = [
        OTHER_TABLE, OTHER_ARM, replace(CONFIGURED, servos=(replace(first, table=shifted), *others)),
        replace(CONFIGURED, servos=tuple(others)), replace(CONFIGURED, arm=bent),
    ]  # fmt: skip
    assert len({arm_identity(config) for config in (CONFIGURED, *meaning)}) == 6
    assert arm_identity(replace(CONFIGURED, save=1, rest=None, robot="other")) == arm_identity(CONFIGURED)


HOLDER = """
import sys, time
from pathlib import Path
from lrmd.persistence.sole_user import sole_user
with sole_user(Path(sys.argv[1])):
    print("there", flush=True)
    time.sleep(60)
"""


def test_a_second_one_is_refused_until_the_first_is_gone_however_it_ends(tmp_path: Path) -> None:
    folder = tmp_path / "state" / "of" / "mine"
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout.readline() == "there\n"
        with pytest.raises(FileError, match="another lrmd") as refused, sole_user(folder):
            pass
        assert str(refused.value).startswith(f"{folder}: ")
        first.kill()
    for _ in range(2):
        with sole_user(folder):
            assert list(folder.iterdir()) == []


def test_what_is_raised_inside_is_not_taken_for_another_user(tmp_path: Path) -> None:
    with pytest.raises(BlockingIOError), sole_user(tmp_path):
        raise BlockingIOError


def test_a_folder_that_cannot_be_made_is_no_reason_not_to_start(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with sole_user(tmp_path / "file" / "state"):
        pass
