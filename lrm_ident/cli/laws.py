"""Command `propose`: a law where no known effect fits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import identifiable, opened, publish, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.diagnosis.symbolic_regression.law_file import law_id
from lrm_ident.report.laws import proposal_document
from lrm_math.model.reading import AS_NAMED, Reading


@command
def propose(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: Annotated[Path | None, Option("-o", "--output", metavar="LAW.py", help="Where to write the law.")] = None,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Propose a law where no known effect fits: a small grammar searched at every joint, judged by held-out error.

    Writes the best as an effect of your own (docs/effects.md): read it, then add it with --effects-file.
    """
    with opened(model, data, effects_file, reading) as study:
        found = identifiable(study).propose()
    publish(proposal_document(found), json)
    if found.best is None:
        return
    law = found.best.law
    if output is None:
        show("Not saved; give -o LAW.py to keep it.")
    else:
        write_text(output, found.best.source)
        show(
            f"Law written to {output}",
            f"Add it with: lrm-ident add {model} {data} {law_id(law)}@joint{law.joint + 1} "
            f"--effects-file {output} -o MODEL2",
        )
