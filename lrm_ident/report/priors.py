"""Maximum a posteriori beside elimination: the same data, all parameters with a prior, or only those they can tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.fit.error_breakdown import HeldOut
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_ident.fit.priors import Prior
from lrm_ident.report.fit import screen_unit, table


@dataclass(frozen=True, eq=False)
class Elimination:
    """A fit with a prior beside one without it.

    Attributes:
        alone: the fit of what the data alone can tell, or the reason why there is none.
        held_out, alone_held_out: held-out errors of both.
    """

    prior: Prior
    fit: Fit
    held_out: HeldOut
    alone: Fit | str
    alone_held_out: HeldOut

    def told(self, key: str) -> float | None:
        """Part (0 to 1) of what was unknown of a parameter that the data told: 1 − variance after / before.

        None for a parameter at its bound.
        """
        if key in self.fit.at_bound:
            return None
        after = self.fit.standard_error[self.fit.model.free.index(key)]
        return max(0.0, float(1.0 - (after / self.prior.sd_of([key])[0]) ** 2))

    def as_json(self) -> dict[str, Any]:
        """The same for machines, in the units of the keys."""
        free = self.fit.model.free
        units = [self.fit.model.parameters[self.fit.model.position(key)].si for key in free]
        mean, sd = self.prior.mean_of(free), self.prior.sd_of(free)
        return {
            "name": self.prior.name,
            "parameters_decided_by_data": self.fit.decided,
            "parameters": {
                key: {"mean": m / unit, "sd": s / unit, "told_by_data": self.told(key)}
                for key, unit, m, s in zip(free, units, mean.tolist(), sd.tolist(), strict=True)
            },
            "elimination": self._alone_json(),
        }

    def _alone_json(self) -> dict[str, Any]:
        if isinstance(self.alone, str):
            return {"reason": self.alone}
        return {
            "parameters": len(self.alone.model.free),
            "fit": figures(self.alone.residual).as_json(),
            "held_out": None if self.alone_held_out.error is None else self.alone_held_out.error.as_json(),
        }


def print_beside_elimination(console: Console, both: Elimination) -> None:
    """Every parameter with prior, posterior and elimination; then the errors of both."""
    console.print(_parameters(both))
    console.print(_errors(both))
    alone = both.alone
    kept = f"there is none: {alone}" if isinstance(alone, str) else f"{len(alone.model.free)} kept, the rest zero"
    console.print(
        f"The data decide {both.fit.decided:.1f} of {len(both.fit.model.free)} parameters; the prior "
        f"'{both.prior.name}' decides the rest. Elimination: {kept}."
    )


def _parameters(both: Elimination) -> Table:
    out = table(
        "With the prior, and by elimination",
        "parameter",
        ">prior",
        ">with prior",
        ">told by data",
        ">elimination",
        "unit",
    )
    model, alone = both.fit.model, both.alone
    for key, error in zip(model.free, both.fit.standard_error, strict=True):
        scale, unit = screen_unit(model, key)
        mean, sd = both.prior.mean_of([key])[0] * scale, both.prior.sd_of([key])[0] * scale
        name = key.removesuffix("_" + model.parameters[model.position(key)].unit)
        part = both.told(key)
        posterior = f"{model.value(key) * scale:.4g} " + ("at its bound" if part is None else f"± {error * scale:.2g}")
        told = "" if part is None else f"{100 * part:.0f} %"
        out.add_row(name, f"{mean:.3g} ± {sd:.3g}", posterior, told, _eliminated(alone, key, scale), unit)
    return out


def _eliminated(alone: Fit | str, key: str, scale: float) -> str:
    if isinstance(alone, str):
        return "–"
    if key not in alone.model.free:
        return "held at 0"
    if key in alone.at_bound:
        return f"{alone.model.value(key) * scale:.4g} at its bound"
    error = float(np.asarray(alone.standard_error)[alone.model.free.index(key)])
    return f"{alone.model.value(key) * scale:.4g} ± {error * scale:.2g}"


def _errors(both: Elimination) -> Table:
    out = table("TCP error, mm", "", ">parameters", ">fit mean", ">fit RMS", ">held-out mean", ">held-out RMS")
    for name, fit, left in (
        ("with prior", both.fit, both.held_out),
        ("elimination", both.alone, both.alone_held_out),
    ):
        if not isinstance(fit, str):
            inside = figures(fit.residual)
            out.add_row(name, str(len(fit.model.free)), *_mean_and_rms(inside), *_mean_and_rms(left.error))
    return out


def _mean_and_rms(error: ErrorFigures | None) -> tuple[str, str]:
    return ("none", "none") if error is None else (f"{error.mean * 1e3:.2f}", f"{error.rms * 1e3:.2f}")
