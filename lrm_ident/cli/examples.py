"""Examples of every command, for the end of its help."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("lrm-ident demo", "lrm-ident demo -o my-folder"),
    "example": ("lrm-ident example -o data.csv", "lrm-ident example -o folder/data.csv"),
    "show": ("lrm-ident show best.toml", "lrm-ident show best.toml --all"),
    "fit": (
        "lrm-ident fit DATA.csv --arm lrm-lab -o model.toml",
        "lrm-ident fit DATA.csv --arm my-arm.toml --loss huber -o model.toml",
    ),
    "diagnose": (
        "lrm-ident diagnose model.toml DATA.csv",
        "lrm-ident diagnose model.toml DATA.csv --all --figure why.png",
    ),
    "add": (
        "lrm-ident add model.toml DATA.csv backlash@joint2 -o better.toml",
        "lrm-ident add model.toml DATA.csv residual_field -o better.toml",
    ),
    "undo": ("lrm-ident undo better.toml -o back.toml", "lrm-ident undo best.toml -o before.toml"),
    "auto": (
        "lrm-ident auto model.toml DATA.csv -o best.toml",
        "lrm-ident auto model.toml DATA.csv -o best.toml --nested",
    ),
    "propose": (
        "lrm-ident propose model.toml DATA.csv -o law.py",
        "lrm-ident propose model.toml DATA.csv --json found.json",
    ),
    "selftest": (
        "lrm-ident selftest lrm-lab poses.csv",
        "lrm-ident selftest lrm-lab poses.csv --only 'backlash@*' --noise-mm 0.5",
    ),
    "compare": (
        "lrm-ident compare model.toml DATA.csv --figure where.png",
        "lrm-ident compare model.toml OTHER.csv --all",
    ),
    "predict": (
        "lrm-ident predict model.toml poses.csv -o predicted.csv",
        "lrm-ident predict model.toml poses.csv -o predicted.csv --json predicted.json",
    ),
    "effects": ("lrm-ident effects", "lrm-ident effects backlash"),
    "report": (
        "lrm-ident report model.toml DATA.csv -o report.html",
        "lrm-ident report best.toml DATA.csv -o report.html --json report.json",
    ),
    "workbench": ("lrm-ident workbench model.toml DATA.csv", "lrm-ident workbench DATA.csv"),
    "design": (
        "lrm-ident design lrm-lab -n 50 -o poses.csv",
        "lrm-ident design lrm-lab --separate backlash@joint2,drift@joint2 -o next.csv",
    ),
    "choose-poses": (
        "lrm-ident choose-poses DATA.csv -n 50 -o best-50.csv",
        "lrm-ident choose-poses DATA.csv -n 30 --index O3 --figure chosen.png",
    ),
    "identify-parameters": (
        "lrm-ident identify-parameters lrm-lab poses.csv",
        "lrm-ident identify-parameters so101 poses.csv --units scaled --all",
    ),
    "reach": ("lrm-ident reach lrm-rover", "lrm-ident reach lrm-rover --figure reach.png"),
    "measure": (
        "lrm-ident measure poses.csv --tracker dtrack:5000 -o DATA.csv",
        "lrm-ident measure poses.csv --robot feetech:/dev/ttyACM0,ids=1-5 --tracker zenoh:tip -o DATA.csv",
    ),
    "verify": (
        "lrm-ident verify --tracker dtrack:5000 --goals 50 --json before.json",
        "lrm-ident verify --tracker dtrack:5000 --goals 50 --before before.json",
    ),
    "align": (
        "lrm-ident align fixture.csv --known-mm 245,0,40",
        "lrm-ident align fixture.csv --known-mm 245,0,40 --raw raw.csv -o DATA.csv",
    ),
    "stiffness": ("lrm-ident stiffness servo.csv", "lrm-ident stiffness servo.csv --figure servo.png"),
    "transfer": (
        "lrm-ident transfer lab.toml --to lrm-rover -o rover.toml",
        "lrm-ident transfer lab.toml few.csv --to lrm-rover -o rover.toml",
    ),
    "checkup": ("lrm-ident checkup DATASET", "lrm-ident checkup DATASET --arm so101 --json checkup.json"),
    "import": (
        "lrm-ident import take.csv poses.csv --arm lrm-lab --tool Tool --base Base -o DATA.csv",
        "lrm-ident import lerobot DATASET --arm so101 -o poses.csv",
    ),
    "fleet": ("lrm-ident fleet arms.csv -o fleet", "lrm-ident fleet arms.csv -o fleet --cluster tcp://scheduler:8786"),
}
"""By name of the command."""


def examples_of(name: str) -> str | None:
    """The examples as an epilogue of the help, which stays as it is broken (`\\b`); None where there are none."""
    lines = EXAMPLES.get(name)
    return None if lines is None else "\n".join(("\b", "Examples:", *(f"  {line}" for line in lines)))
