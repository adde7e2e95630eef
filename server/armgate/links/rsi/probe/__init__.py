"""Probe of a KRC: small motions that prove its mode, the order of its axes and their scales.

A correction w_k is the whole offset in absolute mode and is added up in relative mode. The first round sends
a wave whose sum is zero and which ends at zero. A KRC of either mode therefore ends where it began, whether
its feedback works or not, and zeros hold it afterwards. The two modes differ in the area below the measured
offset y, which no lag changes:

    relative: Σ y = g · Σ_k Σ_{i≤k} w_i        absolute: Σ y = 0, and y is not zero

The later rounds prove order, direction and scale. In round r, axis number j moves by digit r of j + 1 in
balanced ternary (-1, 0 or 1). No two axes have the same digits, and no axis has the negated digits of
another, so that swapped axes and axes with a wrong sign are distinguished. The gain g is the measured area
divided by the commanded one.

``size`` chooses amplitude and length, ``rounds`` sends the corrections, ``finding`` evaluates the areas.
"""

from armgate.links.rsi.probe.rounds import Probe, Stage, digits_of
from armgate.links.rsi.probe.size import ProbeSize, probe_size

__all__ = ["Probe", "ProbeSize", "Stage", "digits_of", "probe_size"]
