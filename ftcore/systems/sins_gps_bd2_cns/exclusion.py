"""Who is left out and who comes back: the supervisor's part.

An aid that is out must pass two tests of its measurement, both in the innovation form, whatever test drives: against
the reference propagator, and against the filter's prediction. Neither suffices. The reference knows nothing of the
filter since its reset, but a propagator may have been reset from what the aid had contaminated; from then on the aid
agrees with it. The filter has taken nothing from the aid since it is out, but is slow to forget what it took before.
An alarm isolates only if both agree on it too, for the same reason (`convicts`): most alarms of a healthy aid are the
reference's own error, which comes in clusters that m of n epochs do not thin out. The state form is excepted; when it
alarms, the filter has taken the fault in, and who is to blame is found by looking back (:mod:`.hindsight`). What alarms
is withheld in any case.

And the state form is no test for coming back at all: its x_KF is the filter's prediction moved by the gain, so an aid
whose gain is small passes it with an error of twenty sigma. A star tracker that has jumped away does not come back
whatever a reference that has grown wide says of it (:func:`ftcore.detection.coasting.moved`).

Source: FTLab's own, for what Yang 2016 does not say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, supervisor
from ftcore.estimation import imm, ins_error, kalman
from ftcore.estimation.kalman import Innovation
from ftcore.systems.base import Controls, Flags
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.branch import LAYOUT, STARS, Examined, Measured
from ftcore.systems.sins_gps_bd2_cns.forms import Settings

Array = NDArray[np.float64]


def decide(
    state: supervisor.State,
    examined: Examined,
    m: Measured,
    turned: Array,
    controls: Controls,
    rules: supervisor.Rules,
) -> tuple[supervisor.State, supervisor.Decision]:
    """Who is suspected and isolated by the driving test, and who is readmitted.

    ``turned (runs, 3, k)``: what errors of the gyros that no filter models have turned the attitude by, each of them by
    1-sigma, as far as star fixes have not taken it away again [rad].
    """
    settings: Settings = controls.settings
    driving = examined.driving
    trusting = settings.driving_test == "none"
    alarm = driving.alarm & ~examined.believed & (not trusting)
    admitted = driving.present & ~examined.moved
    counted = None
    if not trusting and (alarm.any() or (state.health >= supervisor.ISOLATED).any()):
        p_fa = settings.false_alarm_probability
        admitted = admitted & (agrees(examined, m, p_fa) | examined.believed)
        if driving is examined.innovation:
            counted = convicts(examined, m, p_fa, turned)
    enabled = np.array([[controls.enabled[name] for name in AIDS]])
    return supervisor.step(state, alarm, admitted, enabled, rules, counted)


def agrees(examined: Examined, m: Measured, p_fa: float) -> Flags:
    """Whether each aid's measurement agrees with the reference and with the filter's prediction, ``(runs, 3)``."""
    found = _against_filter(examined, m, m.R.reshape(len(AIDS), -1))
    return ~examined.innovation.alarm & (found.statistic <= chi_square.threshold(p_fa, found.dof))


def convicts(examined: Examined, m: Measured, p_fa: float, turned: Array) -> Flags:
    """Aids ``(runs, 3)`` whose alarm counts towards isolation: they disagree with the filter's prediction too.

    The filter has the newer estimate. It knows better than a reference that has kept the errors of the alignment, or
    of what a turn made of scale factors. ``turned``, as in `decide`, is considered as part of the star tracker's noise.
    Where the prediction is vaguer than the reading, what is drawn is its error and not the sensor's, and stays from one
    epoch to the next: the alarms of m epochs are one, so each has to be as improbable as two of them.
    """
    R = m.R.reshape(len(AIDS), -1)
    G = m.H[:, LAYOUT.slices[STARS], ins_error.ATTITUDE] @ turned
    noise = np.broadcast_to(R[..., None] * np.eye(R.shape[-1]), (len(G), *R.shape, R.shape[-1])).copy()
    noise[:, STARS] += G @ G.swapaxes(-1, -2)
    found = _against_filter(examined, m, noise)
    vague = np.trace(found.covariance, axis1=-2, axis2=-1) > 2.0 * R.sum(axis=-1)
    once, twice = (chi_square.threshold(p, found.dof) for p in (p_fa, p_fa**2))
    return np.asarray(found.statistic > np.where(vague, twice, once))


def kept(turned: Array, examined: Examined, m: Measured) -> Array:
    """What is left of ``turned`` after this epoch's star fix: all but the filter's gain times the weight of the fix.

    That is how the error of a filter answers to parameters that are considered and not estimated: (I - K H) times what
    it was. The gain is taken as alike for all angles. Source: S.F. Schmidt (1966).
    """
    prior = examined.updates.prior
    predicted = np.vecdot(prior.mu, np.trace(prior.P[..., ins_error.ATTITUDE, ins_error.ATTITUDE], axis1=-2, axis2=-1))
    gain = predicted / (predicted + m.R[LAYOUT.slices[STARS]].sum())
    return np.asarray((1.0 - examined.beta[:, STARS] * gain)[:, None, None] * turned)


def _against_filter(examined: Examined, m: Measured, R: Array) -> Innovation:
    """Each aid's measurement with noise R against the filter's prediction, leading axes ``(runs, 3)``."""
    x, P = imm.combine(examined.updates.prior)
    runs, n = x.shape
    rows = (runs, len(AIDS), m.y.shape[-1] // len(AIDS))
    y, H, valid = m.y.reshape(rows), m.H.reshape(*rows, n), m.valid.reshape(rows)
    return kalman.innovation(x[:, None], P[:, None], y, H, R, valid)
