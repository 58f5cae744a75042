"""Python file that defines a law as an effect, for `--effects-file`."""

from __future__ import annotations

from lrm_ident.data.wording import in_mm, p_words
from lrm_ident.diagnosis.symbolic_regression.grammar import LETTERS, Law, Quantity

TEMPLATE = '''"""{title}

{facts}

Read it, rename it, say what causes it. To use it: lrm-ident add MODEL DATA {id}@joint{joint} --effects-file THIS_FILE
"""

import numpy as np

from lrm_math.effects import Description, Effect, Parameter


class ProposedLaw(Effect):
    id = "{id}"
    about = Description(
        cause="Not known: a law proposed from measurements.",
        formula="{formula}",
        source="{source}",
        claim="{{place}} follows {follows}: {claims}",
    )
    targets = ("{target}",)
    load_slots = {load_slots}
    depends_on = {depends_on}
    parameters = (
{parameters}    )

    @classmethod
    def places(cls, arm):
        return ("joint{joint}",)

    def amounts(self, poses, tau, p):
{quantities}        return ({amount},)
'''


def law_id(law: Law) -> str:
    """Id of the law, for instance `law_q1_q4`, or `law_d_time` where a length grows."""
    return "_".join(["law", *([] if law.rotates else [law.slot]), *(quantity.name for quantity in law.quantities)])


def law_source(law: Law, typical: tuple[float, ...], data: str, facts: str) -> str:
    """Text of the file.

    Args:
        typical: typical size of each coefficient (rad, m). facts: how it was found, for the file's docstring.
    """
    unit = "rad" if law.rotates else "mm"
    names = [f"{letter}_{unit}" for letter in LETTERS[: len(law.terms)]]
    needs_time = any(quantity.name == "time" for quantity in law.quantities)
    return TEMPLATE.format(
        title=f"A law that lrm-ident propose found in {data}: {law.formula}",
        facts=facts,
        id=law_id(law),
        joint=law.joint + 1,
        formula=law.formula,
        source=f"lrm-ident propose, {data}",
        follows=" and ".join(map(_followed, law.quantities)),
        claims=", ".join(f"{{{name}}}" for name in names),
        target=law.key,
        load_slots=repr(tuple(f"joint{k + 1}.theta" for k in law.torques_of)).replace("'", '"'),
        depends_on=("angle", "direction", *(("time",) if needs_time else ())),
        parameters="".join(
            f'        Parameter("{name}", "of {term.replace("np.", "")}", {size:.3g}),\n'
            for name, term, size in zip(names, law.terms, typical, strict=True)
        ),
        quantities="".join(_assignment(quantity.name, law.code_of(quantity)) for quantity in law.quantities),
        amount=" + ".join(f"p[{i}] * {term}" for i, term in enumerate(law.terms)),
    )


def how_found(tried: int, beside: Law | None, before: float, nested: float, p_value: float) -> str:
    """How a law was found, for the file's docstring.

    Args:
        beside: the law that it was added to. before: held-out RMS without it. nested: with one chosen anew (m).
    """
    which = "alone" if beside is None else f"with {beside.formula}"
    return (
        f"{tried} laws were tried. Held out, the model {which}\nhas {in_mm(before)} mm; with a law "
        f"chosen anew in every block about {in_mm(nested)} mm.\nAgainst pure noise: p {p_words(p_value)}."
    )


def _followed(quantity: Quantity) -> str:
    """A quantity in words: `the angle of joint 2`; one that is of no other joint by its name in formulas."""
    if quantity.angle_of is not None:
        return f"the angle of joint {quantity.angle_of + 1}"
    if quantity.torque_of is not None and quantity.foreign:
        return f"the torque of joint {quantity.torque_of + 1}"
    return quantity.name


def _assignment(name: str, code: str) -> str:
    """Line of code that assigns a quantity; without times the time is zero."""
    return f"        {name} = {f'0.0 if poses.t is None else {code}' if name == 'time' else code}\n"
