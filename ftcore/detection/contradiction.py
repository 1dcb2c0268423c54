"""How wrong instruments are believed to be that contradict each other, when nobody can tell which of them is wrong.

Two instruments with one parity equation between them say that something is wrong, but not who; three may say so too,
when two of them fail at once. Somebody has to be flown with. A filter that goes on believing the data sheet of such
instruments takes their errors for its own states, and then throws out sound aids that contradict it.

So the noise follows the evidence. All axes in use are thought of as wrong by one common unknown variance. The parity
vector is the only thing that is seen of it, chi-square in units of that variance. It is believed as large as the
evidence allows: a parity vector as short as this one would come with a probability of `P_SHORT` only. With one parity
equation that is a wide margin, as it must be: most of a fault may lie where the equation does not look.

Nothing says that such errors are white. They are thought to add up: after n epochs of contradiction without a break the
sum has n^2 variances, so the n-th epoch brings 2 n - 1.

Only what healthy instruments show with a probability below `P_CONTRADICTION` counts, so healthy flights, and flights
whose culprit was put out, do not change.

Source: FTLab's own. The a-posteriori variance of unit weight: P.J.G. Teunissen, Adjustment Theory (2000), chapter 5.
"""

from __future__ import annotations

import numpy as np

from ftcore.detection import chi_square
from ftcore.detection.parity import Sight
from ftcore.detection.result import Array, Ints, Mask

P_CONTRADICTION = 1e-6
"""Tail probability of what healthy instruments show; per cluster and epoch."""
P_SHORT = 0.1
"""Probability of a parity vector as short as the one that is seen, or shorter, if the axes are as wrong as believed."""


def contradictory(sight: Sight) -> Mask:
    """Where the instruments in use contradict each other for certain, ``(runs,)``."""
    return chi_square.decide(sight.FD, sight.dof, P_CONTRADICTION)[2]


def extra_variance(sight: Sight, series: Ints) -> tuple[Array, Ints]:
    """By how much more the axes in use may be wrong than their noise says.

    ``sight``: of the instruments in use, and no others; ``series (runs,)``: epochs for which they have contradicted
    each other until now. Returns the variance that each axis' mean over the epoch is given besides its noise
    ``(runs,)``, in the readings' unit squared, 0 without a contradiction; and the new ``series``.
    """
    found = contradictory(sight)
    series = np.where(found, series + 1, 0)
    variance = np.zeros(sight.FD.shape)
    if found.any():
        C = sight.reference.covariance
        axis = np.trace(C, axis1=-2, axis2=-1) / C.shape[-1]
        # The lower tail at P_SHORT is the upper one at 1 - P_SHORT.
        shortest = chi_square.threshold(1.0 - P_SHORT, np.maximum(sight.dof, 1))
        variance = np.where(found, (2 * series - 1) * axis * sight.FD / shortest, 0.0)
    return variance, series
