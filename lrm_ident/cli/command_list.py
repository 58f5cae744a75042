"""Every command of `lrm-ident` by what it is for; a command's module is loaded when the command is called for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ListedCommand:
    """A command or group of commands: its module below `lrm_ident.cli`, and its line in the help."""

    name: str
    module: str
    summary: str


SECTIONS = {
    "Measure": (
        ListedCommand("arm", "groups.arm", "Describe an arm: from a URDF, to one, or by hand."),
        ListedCommand("measure", "campaign", "Drive the arm through poses, measure its tip at each."),
        ListedCommand("camera", "groups.camera", "Measure with a webcam and a printed board."),
        ListedCommand("import", "groups.recordings", "Turn a tracker's recording into measurements."),
        ListedCommand("align", "component_tests", "Find how far the tracker's targets read wrong."),
        ListedCommand("stiffness", "component_tests", "Test one servo under load."),
    ),
    "Identify": (
        ListedCommand("fit", "fit", "Fit the model of an arm to measurements."),
        ListedCommand("diagnose", "diagnosis", "Find out which physical effect a model misses."),
        ListedCommand("add", "diagnosis", "Add an effect and refit everything."),
        ListedCommand("undo", "diagnosis", "Take the last step of a model back, exactly."),
        ListedCommand("auto", "diagnosis", "Add effects as diagnose advises, until none is missing."),
        ListedCommand("propose", "diagnosis", "Propose a law where no known effect fits."),
        ListedCommand("checkup", "groups.checkup", "Name what a LeRobot recording tells of an arm."),
        ListedCommand("fleet", "groups.fleet", "Identify many arms of one kind, see them together."),
    ),
    "Look": (
        ListedCommand("compare", "fit", "Show where a model fails on measurements."),
        ListedCommand("report", "page.report", "Write one HTML file with everything."),
        ListedCommand("workbench", "page.workbench", "All of it on a page in the browser (extra: page)."),
        ListedCommand("predict", "fit", "Predict the TCP and the joints' torques at poses."),
        ListedCommand("effects", "diagnosis", "Explain the effects that the tool knows."),
    ),
    "Design": (
        ListedCommand("design", "design", "Choose the poses to measure next."),
        ListedCommand("choose-poses", "design", "Choose the best poses among measured ones."),
        ListedCommand("identify-parameters", "design", "Find out which parameters poses can tell."),
        ListedCommand("selftest", "diagnosis", "Tell before measuring what poses would show."),
        ListedCommand("reach", "workspace", "Map what an arm can reach; compare variants of it."),
    ),
    "Drive": (
        ListedCommand("verify", "verification", "Send the tip to goals and measure where it lands."),
    ),
}  # fmt: skip
COMMANDS = {command.name: command for section in SECTIONS.values() for command in section}
