"""Report of `fit --prior`: the fit with a stated prior beside the one with typical sizes, which is the default."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import in_percent, quantity
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.priors import Prior
from lrm_ident.report.document import Block, ResultTable
from lrm_ident.report.fit import screen_unit, stats_in_mm
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.parameter_estimates import parameter_estimates


@dataclass(frozen=True, eq=False)
class PriorComparison:
    """A fit with a stated prior beside the default one.

    Attributes:
        default: the fit with typical sizes, or the reason why there is none.
        held_out, default_held_out: held-out errors of both.
    """

    prior: Prior
    fit: Fit
    held_out: HeldOutResidual
    default: Fit | str
    default_held_out: HeldOutResidual

    def as_json(self) -> dict[str, object]:
        """The table `prior` of `lrm/fit/1`, in the units of the keys."""
        parameters: dict[str, object] = {}
        for key, estimate in parameter_estimates(self.fit).items():
            unit = self.fit.model.parameter(key).si
            mean, sd = self._mean_sd(key, 1.0 / unit)
            parameters[key] = {"mean": mean, "sd": sd, "told_by_data": estimate.from_data}
        default: dict[str, object] = {"reason": self.default}
        if not isinstance(self.default, str):
            fitted, free = error_stats(self.default.residual), len(self.default.model.free)
            default = {"parameters": free, "fit": fitted, "held_out": self.default_held_out.error}
        return {
            "name": self.prior.name,
            "parameters_decided_by_data": self.fit.effective_parameters,
            "parameters": parameters,
            "typical_sizes": default,
        }

    def _mean_sd(self, key: str, scale: float) -> tuple[float, float] | tuple[None, None]:
        """Mean and sd of a parameter's prior, times `scale`; none of each where it has none."""
        if key not in self.prior.keys:
            return None, None
        return float(self.prior.mean_of([key])[0] * scale), float(self.prior.sd_of([key])[0] * scale)

    def blocks(self) -> list[Block]:
        """Every parameter with prior, posterior and its default estimate; then the errors of both."""
        none = [f"With typical sizes there is no fit: {self.default}"] if isinstance(self.default, str) else []
        return [
            self._parameters(),
            self._errors(),
            f"The data decide {self.fit.effective_parameters:.1f} of {len(self.fit.model.free)} parameters; the prior "
            f"'{self.prior.name}' decides the rest.",
            *none,
        ]

    def _parameters(self) -> ResultTable:
        rows = []
        for key, estimate in parameter_estimates(self.fit).items():
            name, scale, unit = screen_unit(self.fit.model, key)
            mean, sd = self._mean_sd(key, scale)
            prior = "none" if mean is None or sd is None else quantity(mean, sd)
            from_data = None if estimate.from_data is None else f"{in_percent(estimate.from_data)} %"
            estimates = _estimate(self.fit, key, scale), from_data, _estimate(self.default, key, scale)
            rows.append((name, prior, *estimates, unit))
        columns = ("parameter", "prior|", "with prior|", "from data|", "typical sizes|", "unit")
        return ResultTable(columns, rows, "With the prior, and with typical sizes")

    def _errors(self) -> ResultTable:
        rows: list[tuple[object, ...]] = []
        both = ("with prior", self.fit, self.held_out), ("typical sizes", self.default, self.default_held_out)
        for name, fit, held_out in both:
            if not isinstance(fit, str):
                held_out_cells = ("none", "none") if held_out.error is None else stats_in_mm(held_out.error)[:2]
                rows.append((name, len(fit.model.free), *stats_in_mm(error_stats(fit.residual))[:2], *held_out_cells))
        columns = ("", "parameters|", "fit mean|.2f", "fit RMS|.2f", "held-out mean|.2f", "held-out RMS|.2f")
        return ResultTable(columns, rows, "TCP error, mm")


def _estimate(fit: Fit | str, key: str, scale: float) -> str:
    if isinstance(fit, str):
        return "–"
    if key not in fit.model.free:
        return "held at 0"
    value, error = fit.model.value(key) * scale, fit.standard_error[fit.model.free.index(key)] * scale
    return f"{value:.4g} at its bound" if key in fit.at_bound else quantity(value, error)
