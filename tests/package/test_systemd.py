"""The units, the udev rule and the installer, by the programs that will read them and without a running systemd."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import ROOT

SYSTEMD = ROOT / "systemd"
UNITS = ["lrmd.service", "lrmd-sim.service"]
EXPOSURE_AT_MOST = 1.5


def need(program: str) -> str:
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


def run(*command: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, env={**os.environ, **environment}, check=False
    )


def settings(unit: str) -> dict[str, list[str]]:
    """Every key of a unit file with all its values; sections do not matter, for keys are not shared between them."""
    values = defaultdict(list)
    for line in (SYSTEMD / unit).read_text(encoding="utf-8").splitlines():
        if "=" in line and not line.startswith("#"):
            key, value = line.split("=", 1)
            values[key].append(value)
    return values


def install(destination: Path, *command: str) -> subprocess.CompletedProcess[str]:
    done = run(SYSTEMD / "install.sh", *command, DESTDIR=str(destination))
    assert done.returncode == 0, done.stderr
    return done


def tree(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Mode and content of every file."""
    return {
        str(path.relative_to(folder)): (path.stat().st_mode & 0o777, path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    """A root as an installation leaves it, with a stand-in for the program and the host's own units."""
    install(tmp_path)
    for program in ("opt/lrm/current/bin/lrmd", "bin/kill"):
        path = tmp_path / program
        path.parent.mkdir(parents=True)
        path.write_text("#!/bin/sh\n", encoding="utf-8")
        path.chmod(0o755)
    return tmp_path


@pytest.mark.parametrize("unit", UNITS)
def test_unit_is_understood_completely(unit: str, rover: Path) -> None:
    analyze = need("systemd-analyze")
    for folder in (Path("/lib/systemd/system"), Path("/usr/lib/systemd/system")):
        if folder.is_dir():
            shutil.copytree(folder, rover / "usr/lib/systemd/system", symlinks=True, dirs_exist_ok=True)
            break
    done = run(analyze, "verify", "--man=no", f"--root={rover}", unit)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@pytest.mark.parametrize("unit", UNITS)
def test_verify_notices_a_fault(unit: str, tmp_path: Path) -> None:
    """The test above can fail: without its program, and with a key that systemd does not know."""
    broken = tmp_path / unit
    broken.write_text((SYSTEMD / unit).read_text(encoding="utf-8") + "\nNoSuchKey=1\n", encoding="utf-8")
    done = run(need("systemd-analyze"), "verify", "--man=no", broken)
    assert "NoSuchKey" in done.stderr
    assert "/opt/lrm/current/bin/lrmd is not executable" in done.stderr


@pytest.mark.parametrize("unit", UNITS)
def test_unit_is_locked_in(unit: str) -> None:
    done = run(need("systemd-analyze"), "security", "--no-pager", "--offline=true", SYSTEMD / unit)
    level = re.search(r"exposure level for \S+: ([0-9.]+)", done.stdout)
    assert level, done.stdout + done.stderr
    assert float(level[1]) <= EXPOSURE_AT_MOST


@pytest.mark.parametrize("unit", UNITS)
def test_unit_keeps_its_promises(unit: str) -> None:
    values = settings(unit)
    assert values["Type"] == ["notify"]
    assert values["NotifyAccess"] == ["main"]
    assert values["WatchdogSec"] == ["2"]
    assert values["Restart"] == ["on-failure"]
    assert values["RestartPreventExitStatus"] == ["2"]  # a wrong configuration
    assert float(values["RestartSec"][0]) * int(values["StartLimitBurst"][0]) < float(
        values["StartLimitIntervalSec"][0]
    )
    assert values["MemoryDenyWriteExecute"] == ["yes"]
    assert values["CapabilityBoundingSet"] == [""]


def test_a_child_that_is_killed_for_memory_does_not_let_the_arm_fall() -> None:
    assert settings("lrmd.service")["OOMPolicy"] == ["continue"]


def test_only_the_real_daemon_has_real_time_and_the_serial_port() -> None:
    real, simulated = settings("lrmd.service"), settings("lrmd-sim.service")
    assert real["LimitRTPRIO"] == ["50"]
    assert real["LimitNICE"] == ["-10"]
    assert real["LimitMEMLOCK"] == ["infinity"]
    assert all(re.fullmatch(r"char-tty[A-Z]+ rw", device) for device in real["DeviceAllow"])
    assert (real["DevicePolicy"], real["User"], real["Group"]) == (["closed"], ["lrm"], ["lrm"])
    assert (simulated["RestrictRealtime"], simulated["PrivateDevices"], simulated["DynamicUser"]) == (["yes"],) * 3
    assert not simulated["DeviceAllow"]


@cache
def system_calls(name: str) -> set[str]:
    """Those of a set of systemd's, or the one of this name."""
    if not name.startswith("@"):
        return {name}
    listed = run(need("systemd-analyze"), "syscall-filter", name).stdout.splitlines()[1:]
    words = [line.strip() for line in listed]
    return set().union(*(system_calls(word) for word in words if word and not word.startswith("#")))


def system_calls_denied(unit: str, names: list[str]) -> list[str]:
    """Which of the system calls a unit's filter refuses, by systemd's own sets."""
    allowed = system_calls("@default")
    for line in settings(unit)["SystemCallFilter"]:
        named = set().union(*(system_calls(name) for name in line.removeprefix("~").split()))
        allowed = allowed - named if line.startswith("~") else allowed | named
    return [name for name in names if name not in allowed]


def test_filter_lets_the_daemon_work() -> None:
    """System calls that the three processes need, in real time or not; and those that none of them needs."""
    needed = ["mlockall", "memfd_create", "clone3", "execve", "epoll_wait", "eventfd2", "prlimit64", "ioctl", "prctl"]
    needed += ["sched_getaffinity", "fdatasync", "rename", "pidfd_open", "futex", "accept4", "clock_nanosleep"]
    forbidden = ["mount", "ptrace", "init_module", "reboot", "bpf", "clock_settime", "kexec_load"]
    for unit in UNITS:
        assert system_calls_denied(unit, needed) == []
        assert system_calls_denied(unit, forbidden) == forbidden
    for call in ("sched_setscheduler", "setpriority"):
        assert system_calls_denied("lrmd.service", [call]) == []
        assert system_calls_denied("lrmd-sim.service", [call]) == [call]


def test_udev_rule_is_understood() -> None:
    done = run(need("udevadm"), "verify", SYSTEMD / "70-lrm-arm.rules")
    if "Unknown command verb" in done.stderr:
        pytest.skip("this udevadm is too old to verify rules")
    assert done.returncode == 0, done.stdout + done.stderr


def test_udev_rule_names_the_port_for_the_daemons_group() -> None:
    """Every line is comparisons and assignments, as far as a pattern can tell; only the boards' lines mark a port."""
    text = (SYSTEMD / "70-lrm-arm.rules").read_text(encoding="utf-8")
    rules = [line for line in text.splitlines() if line and not line.startswith("#")]
    term = r'[A-Z_]+(\{[\w/]+\})?(==|!=|\+=|=)"[^"]*"'
    assert [rule for rule in rules if not re.fullmatch(rf"{term}(, {term})*", rule)] == []
    labels = set(re.findall(r'LABEL="(\w+)"', text))
    assert labels == set(re.findall(r'GOTO="(\w+)"', text))
    marking = [rule for rule in rules if rule.endswith('ENV{LRM_ARM}="1"')]
    assert all('ATTRS{idVendor}=="' in rule and 'ATTRS{idProduct}=="' in rule for rule in marking)
    giving = [rule for rule in rules if 'SYMLINK+="lrm-arm"' in rule]
    assert len(giving) == 1
    assert giving[0].startswith('ENV{LRM_ARM}=="1"')
    group = settings("lrmd.service")["Group"][0]
    assert f'GROUP="{group}", MODE="0660"' in giving[0]


def test_user_and_folders_come_to_be(rover: Path) -> None:
    """On a new root: the user that the unit names, its folders, and secrets that only its group reads."""
    sysusers, tmpfiles = need("systemd-sysusers"), need("systemd-tmpfiles")
    if os.geteuid() != 0:
        pytest.skip("making users takes root")
    (rover / "etc/lrm/zenoh/credentials").write_text("operator:secret\n", encoding="utf-8")
    (rover / "etc/lrm/zenoh/tls").mkdir()
    (rover / "etc/lrm/zenoh/tls/host.key").write_text("secret\n", encoding="utf-8")
    made = run(sysusers, f"--root={rover}", "lrm.conf")
    assert made.returncode == 0, made.stderr
    user = re.search(r"^lrm:x:(\d+):(\d+):", (rover / "etc/passwd").read_text(encoding="utf-8"), re.M)
    assert user
    laid = run(tmpfiles, "--create", f"--root={rover}", "lrm.conf")
    assert laid.returncode == 0, laid.stderr
    state = (rover / "var/lib/lrmd").stat()
    assert (state.st_uid, state.st_gid, state.st_mode & 0o777) == (int(user[1]), int(user[2]), 0o750)
    for secret in ("credentials", "tls/host.key", "acl.json5", "password.json5"):
        found = (rover / "etc/lrm/zenoh" / secret).stat()
        assert (found.st_uid, found.st_gid, found.st_mode & 0o777) == (0, int(user[2]), 0o640), secret


def test_installing_twice_changes_nothing(tmp_path: Path) -> None:
    install(tmp_path)
    once = tree(tmp_path)
    again = install(tmp_path)
    assert tree(tmp_path) == once
    assert not re.search(r"^(put|kept)", again.stdout, re.M)
    assert {"etc/lrm/lrmd.toml", "usr/local/lib/systemd/system/lrmd.service", "etc/lrm/zenoh/acl.json5"} <= set(once)


def test_uninstalling_leaves_nothing(tmp_path: Path) -> None:
    install(tmp_path)
    install(tmp_path, "uninstall")
    assert tree(tmp_path) == {}
    assert not (tmp_path / "etc/lrm").exists()
    install(tmp_path, "uninstall")


def test_changed_configuration_is_never_lost(tmp_path: Path) -> None:
    install(tmp_path)
    own = tmp_path / "etc/lrm/lrmd.toml"
    own.write_text("# mine\n", encoding="utf-8")
    said = install(tmp_path)
    assert "/etc/lrm/lrmd.toml.new" in said.stdout
    assert own.read_text(encoding="utf-8") == "# mine\n"
    assert (own.parent / "lrmd.toml.new").read_bytes() == (ROOT / "config" / "lrmd.toml").read_bytes()
    install(tmp_path, "uninstall")
    assert set(tree(tmp_path)) == {"etc/lrm/lrmd.toml"}
    install(tmp_path, "purge")
    assert tree(tmp_path) == {}


def test_upgrade_replaces_configuration_that_nobody_changed(tmp_path: Path) -> None:
    """From an older version of the project to this one: only what a person wrote is a person's."""
    older = tmp_path / "older"
    for folder in ("systemd", "config", "docs"):
        shutil.copytree(ROOT / folder, older / folder)
    config = older / "config" / "lrmd.toml"
    config.write_text("# an older version\n", encoding="utf-8")
    root = tmp_path / "root"
    assert run(older / "systemd" / "install.sh", DESTDIR=str(root)).returncode == 0
    (root / "etc/lrm/zenoh/acl.json5").write_text("// mine\n", encoding="utf-8")
    install(root)
    assert (root / "etc/lrm/lrmd.toml").read_bytes() == (ROOT / "config" / "lrmd.toml").read_bytes()
    assert (root / "etc/lrm/zenoh/acl.json5").read_text(encoding="utf-8") == "// mine\n"


def test_a_changed_unit_is_replaced(tmp_path: Path) -> None:
    """Units are ours: changes belong into `systemctl edit`."""
    install(tmp_path)
    unit = tmp_path / "usr/local/lib/systemd/system/lrmd.service"
    unit.write_text("[Service]\n", encoding="utf-8")
    install(tmp_path)
    assert unit.read_bytes() == (SYSTEMD / "lrmd.service").read_bytes()


def test_incomplete_copy_of_the_project_installs_nothing(tmp_path: Path) -> None:
    copy, destination = tmp_path / "copy", tmp_path / "root"
    shutil.copytree(SYSTEMD, copy / "systemd")
    done = run(copy / "systemd" / "install.sh", DESTDIR=str(destination))
    assert done.returncode == 2
    assert "is missing in" in done.stderr
    assert not destination.exists()


def test_unknown_command_is_refused(tmp_path: Path) -> None:
    done = run(SYSTEMD / "install.sh", "instal", DESTDIR=str(tmp_path))
    assert (done.returncode, tree(tmp_path)) == (2, {})
    assert "usage" in done.stderr


PYTHON_STUB = """\
#!/bin/sh
# python -m venv FOLDER: a folder whose own python installs a program that is as old as this build
[ "$2" = venv ] || exit 0
mkdir -p "$3/bin" "$3/lib"
cp "$0" "$3/bin/python"
echo "$BUILD" > "$3/lib/module"
printf '#!/bin/sh\\necho %s\\n' "$BUILD" > "$3/bin/lrmd"
[ "$BUILD" != broken ] || exit 1
chmod 755 "$3/bin/lrmd"
"""


def build(folder: Path, name: str, umask: int = 0o022) -> subprocess.CompletedProcess[str]:
    """Installs the program alone below a folder, with a stand-in for Python and pip."""
    python = folder / "python"
    python.write_text(PYTHON_STUB, encoding="utf-8")
    python.chmod(0o755)
    before = os.umask(umask)
    try:
        program, stub = str(folder / "lrm"), str(python)
        return run(SYSTEMD / "install.sh", "program", PROGRAM=program, PYTHON=stub, BUILD=name, DESTDIR="")
    finally:
        os.umask(before)


def versions(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / "lrm").iterdir() if path.is_dir() and not path.is_symlink())


def test_an_upgrade_leaves_alone_what_a_running_daemon_was_started_from(tmp_path: Path) -> None:
    """Its child processes begin by importing: of its own version, whatever was installed meanwhile."""
    assert build(tmp_path, "one").returncode == 0
    current = tmp_path / "lrm" / "current"
    first = current.resolve()
    assert run(current / "bin" / "lrmd").stdout == "one\n"
    mapping = (
        "import mmap, sys; f = open(sys.argv[1], 'r+b'); m = mmap.mmap(f.fileno(), 0); print(1, flush=True); input()"
    )
    command = ["python3", "-c", mapping, str(first / "lib" / "module")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as daemon:
        daemon.stdout.readline()
        said = [build(tmp_path, name).stdout for name in ("two", "three")]
        assert run(first / "bin" / "lrmd").stdout == "one\n"
        assert run(current / "bin" / "lrmd").stdout == "three\n"
        assert versions(tmp_path) == [first.name, current.resolve().name]
        assert all("a running process uses" in one for one in said)
        daemon.communicate(b"\n")
    assert build(tmp_path, "four").returncode == 0
    assert versions(tmp_path) == [current.resolve().name]


def test_an_installation_that_fails_changes_nothing(tmp_path: Path) -> None:
    build(tmp_path, "one")
    before = versions(tmp_path)
    assert build(tmp_path, "broken").returncode != 0
    assert versions(tmp_path) == before
    assert run(tmp_path / "lrm" / "current" / "bin" / "lrmd").stdout == "one\n"


def test_an_older_release_without_folders_of_versions_is_removed(tmp_path: Path) -> None:
    for name in ("bin", "lib", "include"):
        (tmp_path / "lrm" / name).mkdir(parents=True)
    (tmp_path / "lrm" / "lib64").symlink_to("lib")
    (tmp_path / "lrm" / "pyvenv.cfg").touch()
    assert build(tmp_path, "one").returncode == 0
    left = {path.name for path in (tmp_path / "lrm").iterdir()}
    assert left == {"current", (tmp_path / "lrm" / "current").resolve().name}


def test_whoever_installs_with_whatever_umask_all_may_read_the_program(tmp_path: Path) -> None:
    assert build(tmp_path, "one", umask=0o077).returncode == 0
    for path in (tmp_path / "lrm").rglob("*"):
        assert path.stat().st_mode & 0o444 == 0o444, path


def test_whoever_stages_with_whatever_umask_all_may_enter_the_folders(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        install(tmp_path / "root")
    finally:
        os.umask(before)
    closed = [path for path in (tmp_path / "root").rglob("*") if path.is_dir() and path.stat().st_mode & 0o055 != 0o055]
    assert closed == []


def pinned(path: Path) -> dict[str, str]:
    """Versions by package."""
    found = re.findall(r"^([\w.-]+)==([^\s;]+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in found}


def test_pip_as_root_fetches_nothing_without_a_known_hash() -> None:
    """Each call of pip checks hashes, or fetches nothing; the files have all that the daemon needs, as it is tested."""
    text = (SYSTEMD / "install.sh").read_text(encoding="utf-8")
    calls = re.findall(r"^ +pip (.*)$", text, re.MULTILINE)
    hashed = [call for call in calls if call.startswith("--require-hashes -r ")]
    assert [call for call in calls if call not in hashed] == ['--no-deps --no-build-isolation "$SOURCE"']
    assert text.count("pip install") == 1, "in the function that all calls go through"
    tested, found = pinned(ROOT / "constraints.txt"), dict[str, str]()
    for name in ("requirements.txt", "compiler.txt"):
        lines = (SYSTEMD / name).read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
        assert all("--hash=sha256:" in line for line in lines if line and not line.startswith("#"))
        found |= pinned(SYSTEMD / name)
    assert found == {name: tested[name] for name in found}
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)
    needed = [*project["project"]["dependencies"], *project["build-system"]["requires"]]
    assert {re.split(r"[^\w-]", one)[0] for one in needed} <= found.keys()


def test_the_program_is_checked_as_the_daemons_user() -> None:
    """Root reads what the service does not."""
    text = (SYSTEMD / "install.sh").read_text(encoding="utf-8")
    assert [line.strip().split()[:3] for line in text.splitlines() if line.strip().endswith("--check")] == [
        ["runuser", "-u", settings("lrmd.service")["User"][0]]
    ]
