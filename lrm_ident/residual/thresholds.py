"""Thresholds of the verdicts on a residual, of what poses lack and of hints in the estimates, and what set each.

Shares are of the held-out RMS of the 3-D distance; of mean squares those that correspond (`falls_by_share`).
"""

from __future__ import annotations

SIGNIFICANCE = 0.01
"""False discovery rate among all that were tried (Benjamini & Yekutieli 2001), likewise of structure, regimes and laws:
a convention, chosen before the hidden effects were tried (decision 6)."""
Z_THRESHOLD = 2.0
"""Standard errors of a paired difference by which one prediction must beat another (Vuong 1989): the usual two,
chosen before the hidden effects were tried (decision 6)."""
ONE_DEVIATION = 1.0
"""Standard errors by which the deployed error must rise for an effect to be refused: the usual one-standard-error rule
(Breiman et al. 1984)."""
MAX_WALD_P = 0.0455
"""p value of the Wald test that an effect's own parameters are all zero, above which it is not named: that of two
standard deviations for one parameter, kept for effects of several."""
MIN_GAIN = 0.02
"""Share that an effect or a law must save to be worth naming: a judgement, made before the hidden effects were tried
(decision 6). No data set it: with hundreds of poses less is significant, too, but changes nothing for a user."""
MIN_FREE_GAIN, MAX_FREE_FUNCTIONS = 0.10, 3
"""Share that a free function must save to be unexplained structure, chosen before too; how many are taken together
before an effect is called spurious, changed once because of the hidden effects (decision 6)."""
PROMISING = 0.5
"""Part of what a free function must save of held-out squares that it must save in the sample to be cross-validated: it
saves more there, since it was fitted to it. A bound on time."""
MIN_NAMELESS_GAIN = 0.05
"""Share that a model without names must save for more to be left to find: between the two above."""
MOST_SELECTED, MAX_EFFECTS = 8, 20
"""Effects that are selected before everything is fitted anew, and that `auto` adds: bounds on time, hardly ever met."""

EQUIVALENCE_COSINE = 0.95
"""Smallest principal cosine (Björck & Golub 1973) above which two effects move the TCP alike (decision 6)."""
EQUIVALENT_GAIN, SIMILAR_GAIN = 0.5, 0.8
"""Share of an effect's gain that one of its class must have (decision 6), and a simpler one to be taken instead
(decision 10, set on the half for tuning of the second catalogue)."""
SMALL_SHARE = 0.15
"""Share of the mean square above the noise below which a step, while much stays, describes and names no cause: local
effects that spell one common cause took 3 to 8 % each; of the findings on the half for tuning of the third catalogue
two of less were false and none was right."""
MAX_UNEXPLAINED_RATIO = 1 / 3
"""Mean square that stays unexplained after a step of `auto`, per mean square that it took, above which the step shows
no cause: on the half for tuning of the third catalogue 9 of 19 such findings were false, 2 of the other 66."""
NEGLIGIBLE = 1e-3
"""Part of the mean square that is no excess over the noise: a guard against dividing by almost nothing."""
VERY_STRONG = 10.0
"""Difference of Schwarz's criterion that is very strong evidence (Kass & Raftery 1995)."""
MIN_DETECTABLE = 3.0
"""Times the noise that a typical size must move all TCPs together for an effect to be testable: a convention."""

FLOOR_RATIO, MORAN_THRESHOLD = 1.15, 0.1
"""Residual over the noise floor, and where that is unknown Moran's I of neighbours, above which structure matters: by
so much a stated noise may be wrong, and so little is seldom worth a search."""
NOT_NOISE = 1e-3
"""p value of the lack-of-fit test below which the residual exceeds a known floor, by however little: a tenth of
`SIGNIFICANCE`. Of the verdict *nothing is missing* it is the level."""
MIN_REGIME_RATIO = 1.5
"""RMS inside a regime over RMS outside that is worth saying: a convention."""
LARGEST_REGIME, FEWEST_IN_REGIME = 0.5, 8
"""Share of the poses that a regime may hold, and its poses in either half of the data: conventions."""
MISSED = 0.05
"""Probability that a known effect moves the TCP by more than the stated bound: the usual one."""

FEW_LEVELS = 4
"""Different angles of a joint up to which its errors look alike: a convention."""
STRONG_CORRELATION = 0.8
"""Correlation of a joint's angle with the order above which a drift looks like an error of the joint: a convention."""
MOST_OF_RANGE = 2 / 3
"""Share of a joint's range from which a verdict speaks for the whole of it: a convention."""
LIKENESS, SURELY = 0.98, 5.0
"""Cosine between motions of the TCP above which several estimates are one motion; its standard errors from zero."""
