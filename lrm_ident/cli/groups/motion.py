"""The group `motion`: how an arm moves between a command and a reading, and what a model of it misses."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import SO101, ArmAccess, load_changer, resumable
from lrm_ident.cli.command import command_group, command_of, stated_reading, with_options
from lrm_ident.cli.common import bars, notice, publish, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.campaign.plan import load_plan
from lrm_ident.measuring.motion.motion_files import MotionSource, open_motion, write_motion
from lrm_ident.measuring.motion.motion_picture import draw_motion
from lrm_ident.measuring.motion.motion_report import (
    auto_document,
    comparison_document,
    diagnosis_document,
    motion_document,
)
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.settling_times import longest, settling_times
from lrm_ident.measuring.recordings.command_log import read_command_log
from lrm_ident.measuring.recordings.readers import FORMATS
from lrm_ident.report.document import Block, Document, ResultTable
from lrm_ident.report.effects import listed
from lrm_ident.report.plain_names import WORDS
from lrm_ident.study.inputs import arm_from
from lrm_ident.workbench.motion_page import motion_page
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.errors import UnknownName
from lrm_math.model.reading import AS_NAMED
from lrm_math.motion.effects import MOTION_EFFECTS
from lrm_math.motion.motion_model import MotionFile, effect_of, load_motion

group = command_group(
    "motion",
    "Find what makes an arm lag, overshoot, stick or swing, from a recording of its moves.\n\n"
    "RECORDING is a LeRobot dataset (v2.1 or v3) of about two minutes of teleoperation: quick and slow moves of every "
    "joint, and a stop now and then. The model predicts the encoders (observation.state) from the commands (action) "
    "alone. All errors are of moves that the fit did not use. An arm without encoders: RECORDING is a log of commands "
    "(lrm record, or MCAP), and --tip what a tracker recorded meanwhile.\n\n"
    "\b\n"
    "  lrm-ident motion fit      RECORDING -o motion.toml          servo response of every joint\n"
    "  lrm-ident motion compare  motion.toml RECORDING             where the model fails\n"
    "  lrm-ident motion diagnose motion.toml RECORDING             which effect is missing\n"
    "  lrm-ident motion add      motion.toml RECORDING dead_time@joint2 -o better.toml\n"
    "  lrm-ident motion auto     motion.toml RECORDING -o best.toml\n"
    "  lrm-ident motion report   best.toml RECORDING -o motion.html\n\n"
    "lrm-ident motion effects lists what it can find. docs/motion.md explains the words.",
)
Recording = Annotated[
    Path,
    Argument(
        metavar="RECORDING",
        help="Folder of a LeRobot dataset (v2.1, v3; extra: lerobot), or a log of commands: a CSV of lrm record, or an "
        "MCAP file with joint states (extra: mcap).",
    ),
]
MotionPath = Annotated[Path, Argument(metavar="MODEL", help="A motion model written by motion fit.")]
NewMotion = Annotated[Path, Option("-o", "--output", metavar="MODEL2", help="Where to write the motion model.")]
TIP_HELP = f"What a tracker recorded while the commands were logged: {FORMATS}."
SOURCE_OPTIONS: Mapping[str, Any] = {
    name: Annotated[kind | None, option]
    for name, (kind, option) in {
        "tip": (Path, Option(metavar="FILE", help=TIP_HELP)),
        "tool": (str, Option(metavar="BODY", help="Of the tracker's file: the body at the tip.")),
        "base": (str, Option(metavar="BODY", help="Of the tracker's file: the body at the base, if there is one.")),
        "topic": (str, Option(metavar="TOPIC", help="Of an MCAP file: the joint states that are the commands.")),
        "encoders": (str, Option(metavar="TOPIC", help="Of an MCAP file: the joint states that the encoders read.")),
        "rotation": (str, Option(help="Of a Vicon export: helical or euler-xyz.")),
        "rest": (Path, Option(metavar="MODEL", help="Fitted model of poses (default: the nominal arm).")),
        "angle_unit": (str, Option(help="Unit of the recording's angles: deg (default) or rad.")),
        "prefix": (str, Option(metavar="WORD", help="Of a dataset of two arms: before the joints' names, left_.")),
    }.items()
}
"""Options that a parameter `source` of a command stands for, beside RECORDING."""


def _source(stated: dict[str, Any]) -> MotionSource:
    angles = stated_reading({"angle_unit": stated["angle_unit"]})
    return MotionSource(**stated | {"angle_unit": angles.angle_unit})


def _sourced(function: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter `source` is typed as RECORDING and its options."""
    return with_options(function, "source", {"recording": Recording, **SOURCE_OPTIONS}, _source)


@contextmanager
def _opened(model: Path, source: MotionSource) -> Iterator[tuple[MotionFile, MotionStudy]]:
    """A study from its files, with bars on stderr."""
    with bars() as tick:
        file, study = open_motion(model, source, tick)
        notice(*study.moves.notices)
        yield file, study


def words_of(source: MotionSource) -> str:
    """RECORDING and its options as typed."""
    typed = {name: getattr(source, name) for name in SOURCE_OPTIONS}
    options = [f"--{name.replace('_', '-')} {shlex.quote(str(v))}" for name, v in typed.items() if v is not None]
    return " ".join([shlex.quote(str(source.recording)), *options])


@command_of(group)
@_sourced
def fit(
    source: MotionSource,
    output: Annotated[Path, Option("-o", "--output", metavar="MODEL", help="Where to write the motion model.")],
    arm: arg.ServoArm = SO101,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Fit the response of every servo: frequency, damping, zero."""
    with bars() as tick:
        moves = source.moves(load_arm(arm))
        notice(*moves.notices)
        study = MotionStudy.of(moves, progress=tick).fit()
    write_motion(study, arm, output)
    document = motion_document(study, f"{moves.name}: reading less prediction, {len(moves)} moves")
    publish(document, json, in_full=show_all)
    show(f"Model written to {output}", f"Next: lrm-ident motion diagnose {output} {words_of(source)}")


@command_of(group)
@_sourced
def compare(
    model: MotionPath,
    source: MotionSource,
    figure: arg.FigureFile = None,
    json: arg.JsonFile = None,
) -> None:
    """Show where a motion model fails: at rest, in quick moves, after reversals, under load, early or late."""
    with _opened(model, source) as (_, study):
        document = comparison_document(study)
        publish(document, json)
        if figure:
            draw_motion(MotionStudy.of(study.moves).fit(), study, figure)
            show(f"Figure written to {figure}")


@command_of(group)
@_sourced
def diagnose(
    model: MotionPath,
    source: MotionSource,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Find the effect of motion that a model is missing."""
    with _opened(model, source) as (_, study):
        screenings = study.screen()
    publish(diagnosis_document(study, screenings, str(model), words_of(source)), json, in_full=show_all)


@command_of(group)
@_sourced
def add(
    model: MotionPath,
    source: MotionSource,
    effect: Annotated[str, Argument(metavar="EFFECT@JOINT", help="For instance dead_time@joint2.")],
    output: NewMotion,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Add an effect of motion at a joint and refit that joint."""
    with _opened(model, source) as (file, before):
        study = before.add(effect)
    write_motion(study, arm_from(model, file.arm), output)
    document = motion_document(study, f"with {effect}: reading less prediction", effect)
    publish(document, json, in_full=show_all)
    show(f"Model written to {output}")


@command_of(group)
@_sourced
def auto(
    model: MotionPath,
    source: MotionSource,
    output: NewMotion,
    figure: arg.FigureFile = None,
    json: arg.JsonFile = None,
) -> None:
    """Add missing effects of motion joint by joint, until none is found; a few minutes."""
    with _opened(model, source) as (file, before):
        study = before.auto()
        judged = study.judged()
    write_motion(study, arm_from(model, file.arm), output)
    publish(auto_document(study, judged, str(output)), json)
    if figure:
        draw_motion(before, study, figure)
        show(f"Figure written to {figure}")
    show(f"Model written to {output}")


@command_of(group)
@_sourced
def report(
    model: MotionPath,
    source: MotionSource,
    output: Annotated[Path, Option("-o", "--output", metavar="HTML", help="Where to write the page.")],
) -> None:
    """Write errors, effects, verdicts and every move as one HTML page that needs no network."""
    with _opened(model, source) as (_, study):
        page = motion_page(MotionStudy.of(study.moves).fit(), study, str(model))
    write_text(output, page)
    show(f"Page written to {output}")


@command_of(group)
def design(
    model: MotionPath,
    separate: Annotated[
        str,
        Option(
            metavar="EFFECTS",
            help="Effects to distinguish, by commas: coulomb_friction@joint2,motion_play@joint2.",
        ),
    ],
    output: Annotated[Path, Option("-o", "--output", metavar="MOVES", help="Where to write the moves, a CSV.")],
    count: Annotated[int, Option("-n", "--count", min=10, max=60, help="How many moves for a joint.")] = 12,
    speed: Annotated[
        float | None,
        Option(
            min=1.0,
            max=180.0,
            metavar="DEG_PER_S",
            help="Of a joint at most. Default: the daemon's ramp; 30 for an arm without pulses.",
        ),
    ] = None,
    noise_deg: Annotated[float, Option(min=0.001, help="Noise of an encoder.")] = 0.045,
    noise_mm: Annotated[
        float, Option(min=0.001, help="Noise of a tracker per axis; for an arm without encoders.")
    ] = 0.3,
    seed: arg.Seed = 0,
    json: arg.JsonFile = None,
) -> None:
    """Choose safe moves that distinguish effects of motion: ramps, steps, stairs and chirps of one joint at a time.

    All stay inside the limits and clear of the arm's own bodies and table. Tries the moves in simulation before it
    proposes them, and reports which effects none of them distinguishes.
    """
    from lrm_ident.measuring.excitation.design_report import motion_design_document
    from lrm_ident.measuring.excitation.motion_design import MotionDesignTask, motion_design

    motion_model = load_motion(model)[1]
    rivals = tuple(effect_of(motion_model.arm, name.strip()) for name in separate.split(",") if name.strip())
    by_tip = motion_model.arm.joints[0].servo is not None
    noise = 1e-3 * noise_mm if by_tip else math.radians(noise_deg)
    rate = None if speed is None else math.radians(speed)
    task = MotionDesignTask(motion_model, rivals, count, noise, by_tip, rate, seed)
    with bars() as tick:
        designed = motion_design(task, tick)
    document = motion_design_document(task, designed, str(output))
    write_text(output, designed.sequence.csv())
    publish(document, json)
    show(f"Moves written to {output}")


@command_of(group)
def play(
    moves: Annotated[Path, Argument(metavar="MOVES", help="Moves that motion design wrote, or a log of lrm record.")],
    robot: arg.AnyRobot = "rover",
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="CSV", help="Where to write commands and encoders; not with a daemon."),
    ] = None,
    connect: arg.Connect = None,
    arm: arg.DrivenArm = None,
    take: arg.Take = False,
    speed: arg.Speed = None,
    release: arg.Release = False,
) -> None:
    """Drive an arm along MOVES, and record its encoders for motion fit and motion diagnose.

    A daemon checks every way for collisions; its arm has no encoders, so let lrm record and a tracker run meanwhile.
    With LeRobot or bare servos keep the way free; the arm first goes to the first pose in a straight line, and has to
    stand within 30 deg of it. Ctrl-C holds, and what was recorded is kept.
    """
    from lrm_ident.measuring.campaign.move_player import keeps_rows, play, played_csv, played_toml, sequence_of
    from lrm_ident.measuring.campaign.real_clock import RealClock
    from lrm_ident.measuring.excitation.sequence import PlayedRow

    rows: list[PlayedRow] = []
    settings: ServoSettings | None = None
    with ArmAccess(robot, connect, speed, take, release).connection(arm, "lrm-ident motion play") as link:
        keeps_rows(output, link.daemon is not None)
        log = read_command_log(moves, link.arm, AS_NAMED)
        notice(*log.notices)
        sequence = sequence_of(log)
        try:
            with resumable("What was played is kept"), link.drive(RealClock(), load_changer(None)) as driven:
                settings = driven.settings
                play(driven.arm, sequence, rows, show)
            if link.daemon is not None and link.daemon.unchecked:
                notice(f"not checked for collisions: {link.daemon.unchecked}")
        finally:
            if output is not None and rows:
                write_text(output, played_csv(rows))
                write_text(output.with_suffix(".toml"), played_toml(settings))
                show(f"{len(rows)} rows written to {output}", f"Next: lrm-ident motion fit {output} -o motion.toml")


@command_of(group)
def settle(
    model: MotionPath,
    poses: arg.PosesFile,
    speed: Annotated[float, Option(min=1.0, max=180.0, help="Of the fastest joint between poses, deg/s.")] = 30.0,
    within_mm: Annotated[float, Option(min=0.001, help="Distance from its rest within which the tip must stay.")] = 0.1,
    json: arg.JsonFile = None,
) -> None:
    """Predict how long the tip swings after each move of a list of poses, driven in order."""
    moves = load_motion(model)[1]
    plan, labels = load_plan(poses, moves.arm), joint_labels(moves.arm)
    notice(*plan.notices)
    settled = settling_times(moves, [pose.q for pose in plan.poses], speed, 1e-3 * within_mm)
    rows = [
        (pose.number, settling.seconds, labels[settling.joint])
        for pose, settling in zip(plan.poses[1:], settled, strict=True)
    ]
    title = f"Time after a move until the tip stays within {within_mm:g} mm of its rest"
    table = ResultTable(("pose|d", "settle_s|.2f", "joint"), rows, title)
    most = longest(settled).seconds
    last = f"At most {most:.2f} s. lrm-ident measure --motion {model} waits so long at every pose."
    publish(Document([table, last], "lrm/motion-settling/1", {"moves": table.records(), "longest_s": most}), json)


@command_of(group)
def effects(
    name: Annotated[str | None, Argument(metavar="EFFECT", help="One of them; default: all.")] = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Explain the effects of motion: cause, formula, parameters, and what shows them."""
    by_id = {kind.id: kind for kind in MOTION_EFFECTS}
    if name is not None and name not in by_id:
        raise UnknownName("effect of motion", name, list(by_id))
    if name is None:
        rows = [(kind.id, WORDS[kind.id]["name"].format(place="a joint"), kind.about.cause) for kind in by_id.values()]
        table = ResultTable(("effect", "name", "cause"), rows, "Effects of motion")
        names = list(listed("lrm-ident motion effects EFFECT", "Effects of motion", list(by_id)))
        document = Document(names, "lrm/motion-effects/1", {"effects": table.records()}, None, [table], "their causes")
        publish(document, json, in_full=show_all)
        return
    kind = by_id[name]
    sizes = [(p.name, p.meaning, p.typical / p.si, p.lower / p.si, p.upper / p.si) for p in kind.parameters]
    table = ResultTable(("parameter", "meaning", "typical|g", "least|g", "most|g"), sizes, "Parameters")
    about = kind.about
    blocks: list[Block] = [about.cause, f"Formula: {about.formula}", f"Source: {about.source}"]
    blocks += [f"Needs: {about.needs}"] if about.needs else []
    blocks += [f"Cannot be told from recordings of command and encoder: {kind.alike}"] if kind.alike else []
    publish(Document([*blocks, table], "lrm/motion-effects/1", {"effect": name, "parameters": table.records()}), json)
