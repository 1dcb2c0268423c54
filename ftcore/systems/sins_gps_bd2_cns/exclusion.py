"""Who is left out, who comes back, and what the filter forgets of one that is left out: the supervisor's part.

An aid that is out must pass two tests of its measurement, both in the innovation form, whatever test drives: against
the reference propagator, and against the filter's prediction. Neither suffices. The reference knows nothing of the
filter since its reset, but a propagator may have been reset from what the aid had contaminated; from then on the aid
agrees with it. The filter has taken nothing from the aid since it is out, but is slow to forget what it took before.
And the state form is no test for coming back at all: its x_KF is the filter's prediction moved by the gain, so an aid
whose gain is small passes it with an error of twenty sigma. A star tracker that has jumped away does not come back
whatever a reference that has grown wide says of it (:func:`ftcore.detection.coasting.moved`).

For the same reason the state form *begins* to see a fault when the filter has taken it in. An isolation by it therefore
says that the estimate is wrong, and not only what comes: the filter goes on from the reference, which had no part in
it, and so does the newer propagator, which may have started from the estimate that was wrong. Otherwise the sound aids
disagree with that estimate, and later with the propagator, and are accused in turn. The innovation form withholds a
measurement from the first alarm on; then there is nothing to forget.

Source: FTLab's own, for what Yang 2016 does not say. To restart a filter from the propagator after a detection is in R.
Da, Failure detection of dynamical systems with the state chi-square test, J. Guidance 17 (1994).
"""

from __future__ import annotations

import numpy as np

from ftcore.detection import chi_square, supervisor
from ftcore.estimation import imm, kalman
from ftcore.systems.base import Controls, Flags
from ftcore.systems.sins_gps_bd2_cns.branch import Examined, Measured
from ftcore.systems.sins_gps_bd2_cns.forms import Settings
from ftcore.systems.sins_gps_bd2_cns.names import AIDS


def decide(
    state: supervisor.State, examined: Examined, m: Measured, controls: Controls, rules: supervisor.Rules
) -> tuple[supervisor.State, supervisor.Decision]:
    """Who is suspected and isolated by the driving test, and who is readmitted."""
    settings: Settings = controls.settings
    driving = examined.driving
    trusting = settings.driving_test == "none"
    alarm = driving.alarm & ~examined.believed & (not trusting)
    admitted = driving.present & ~examined.moved
    if not trusting and (state.health >= supervisor.ISOLATED).any():
        admitted = admitted & (agrees(examined, m, settings.false_alarm_probability) | examined.believed)
    enabled = np.array([[controls.enabled[name] for name in AIDS]])
    return supervisor.step(state, alarm, admitted, enabled, rules)


def agrees(examined: Examined, m: Measured, p_fa: float) -> Flags:
    """Whether each aid's measurement agrees with the reference and with the filter's prediction, ``(runs, 3)``."""
    x, P = imm.combine(examined.updates.prior)
    runs, n = x.shape
    rows = (runs, len(AIDS), m.y.shape[-1] // len(AIDS))
    y, H, valid = m.y.reshape(rows), m.H.reshape(*rows, n), m.valid.reshape(rows)
    found = kalman.innovation(x[:, None], P[:, None], y, H, m.R.reshape(rows[1:]), valid)
    return ~examined.innovation.alarm & (found.statistic <= chi_square.threshold(p_fa, found.dof))


def forgets(decision: supervisor.Decision, settings: Settings) -> Flags:
    """Runs ``(runs,)`` whose filter goes on from the reference: the state form has isolated an aid that is left out."""
    leaves_out = settings.master == "federated" or settings.exclusion == "isolation"
    late = settings.driving_test == "two-propagator-state"
    return np.asarray(decision.just_isolated.any(axis=-1) & (leaves_out and late))
