"""Who was wrong, since when: the generalised likelihood ratio over the epochs that are remembered.

It is asked only when there is reason to, and then looks back: one Kalman filter is flown again from the oldest bank,
which takes in every reading, and the ratio is taken for a step on any row of any aid, beginning in any of the epochs.
Its process noise is that of the models as they were believed then, and what scale factors of the gyros may turn the
attitude by in an epoch, which no other filter models.

Source: :mod:`ftcore.detection.likelihood_ratio`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import likelihood_ratio
from ftcore.estimation import imm, ins_error, kalman
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.branch import LAYOUT
from ftcore.systems.sins_gps_bd2_cns.error_model import ErrorModel
from ftcore.systems.sins_gps_bd2_cns.protected import Epoch, Protected

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
P_NAMED = 1e-5
"""Tail probability, over all onsets and rows together, of the ratio that names somebody."""


def weigh(
    origin: Protected, epochs: Sequence[Epoch], masked: Flags, model: ErrorModel, R: Array
) -> tuple[Array, Ints, float]:
    """The likelihood ratios of the three aids ``(runs, 3)``, the epochs since the onset of each ``(runs, 3)``, 0 for
    the latest epoch, and the ratio from which on it is no chance.

    ``origin``: the filters before the epochs. ``masked (runs, epochs, 3)``: readings that are known to be wrong.
    """
    x, P = imm.combine(origin.main.mixture)
    columns = np.arange(LAYOUT.rows)
    ratio = likelihood_ratio.start(ins_error.CORE_STATES, len(epochs))
    for i, e in enumerate(epochs):
        Phi, Q = (a[:, 0] for a in model.matrices(e.flown))
        x, P = kalman.predict(x, P, Phi, (e.mu[:, :, None, None] * Q).sum(axis=1))
        if e.jump is not None:
            P = P + e.jump
        P[:, ins_error.ATTITUDE, ins_error.ATTITUDE] += e.turning @ e.turning.swapaxes(-1, -2)
        left_out = np.repeat(e.out | masked[:, i], LAYOUT.rows // len(AIDS), axis=-1)
        valid = e.valid & ~left_out
        update = kalman.update(x, kalman.sound(P), e.y, e.H, R, valid)
        ratio = likelihood_ratio.step(ratio, update, Phi, e.H, columns, valid)
        x, P = update.x, update.P
        if e.correction is not None:
            x = x - e.correction
    by_column, age = likelihood_ratio.by_column(ratio)
    rows = (len(x), len(AIDS), -1)
    by_row, age = by_column.reshape(rows), age.reshape(rows)
    worst = by_row.argmax(axis=-1)[..., None]
    limit = likelihood_ratio.sidak_threshold(P_NAMED, np.array(LAYOUT.rows * len(epochs)))
    return (
        np.take_along_axis(by_row, worst, axis=-1)[..., 0],
        np.take_along_axis(age, worst, axis=-1)[..., 0],
        float(limit),
    )
