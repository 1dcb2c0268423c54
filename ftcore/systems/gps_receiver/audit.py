"""Does a receiver's log keep to what the system assumes of it? Looked at before it is flown, as a whole.

Three assumptions are tested on windows of some epochs, each with a probability of a false alarm of at most
:data:`P_FALSE` a window while the errors are as assumed and independent from epoch to epoch:

    noise    The residuals of the snapshot, weighted by the assumed sigma, are chi-square; here all of a window
             together, and without any one satellite, so that a single wrong satellite is not taken for noise.
    rest     The fixes of a window scatter about their mean, and the means of windows about each other, no more than
             their covariance and the residuals allow (an F test, so that noise is not taken for movement).
    antenna  The fixes lie around the position that errors are counted from.

What is found is said and changes nothing. The receiver's own estimators see none of it: it knows the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ftcore import earth
from ftcore.detection import raim
from ftcore.estimation import least_squares
from ftcore.estimation.first_fix import first_fix
from ftcore.sensors.rinex import ObservationLog
from ftcore.systems.base import Flags, Remark
from ftcore.systems.gps_receiver.forms import Log, Parameters
from ftcore.systems.gps_receiver.satellites import Pseudoranges, measure

Array = NDArray[np.float64]

P_FALSE: Final = 1e-4
"""Probability that a window contradicts an assumption that holds."""
WINDOW: Final = 20
"""Epochs of a window."""
_LEAST: Final = 10
"""Degrees of freedom of the residuals that a window needs to be judged."""
_FIXES: Final = 4
"""Fixes that a window needs for its scatter, and a log for its middle."""
_TOGETHER: Final = 1000
"""Epochs that are solved at a time."""
_TURNS: Final = 4
"""Steps towards each epoch's own position: a hundred kilometres are down to millimetres in three."""


@dataclass(frozen=True)
class _Fixes:
    """Every epoch on its own; E epochs, n satellites.

    ``position`` (E, 3) Earth-fixed and ``covariance`` (E, 3, 3) in the level frame of the start [m, m^2]; ``sound``
    (E,) where there is a fix that its test has passed; ``statistic`` (E,), ``squared`` (E, n) and ``dof`` (E,) of all
    satellites' residuals; ``slanted`` and ``flat`` (E,): the part of the expected statistic that the slant term makes,
    and what a floor of 1 m makes.
    """

    position: Array
    covariance: Array
    sound: Flags
    statistic: Array
    squared: Array
    dof: NDArray[np.int64]
    slanted: Array
    flat: Array


@lru_cache(maxsize=8)
def audit(log: ObservationLog, p: Parameters, antenna: tuple[float, float, float]) -> tuple[Remark, ...]:
    """What a log does not keep to, as remarks with one sentence each.

    Args:
        log: what was recorded.
        p: of the flight; its assumed noise and mask are those that are tested.
        antenna: where errors are counted from, Earth-fixed [m].
    """
    assert p.log is not None
    start = _start(log)
    if start is None:
        return ()
    lla = earth.ecef_to_geodetic(start)
    C_en = earth.enu_to_ecef_matrix(lla[0], lla[1])
    fixes = _fixes(log, p, start, C_en)
    windows = [slice(first, first + WINDOW) for first in range(0, len(log), WINDOW)]
    scale, noise = _noise(fixes, windows, p.log)
    if noise:
        # Movement is judged by the noise that there is, or noise would be taken for it.
        fitting = p.log.model_copy(update={"floor": noise[0].numbers["fitting_floor"]})
        fixes = _fixes(log, p.model_copy(update={"log": fitting}), start, C_en)
        scale, _ = _noise(fixes, windows, fitting)
    local = (fixes.position - start) @ C_en
    moving = _moving(fixes, windows, local, scale, log.interval)
    found = [*noise, *moving]
    if not moving:
        found += _antenna(fixes, local, (np.asarray(antenna) - start) @ C_en, scale, p.log.antenna is None)
    return tuple(found)


def _start(log: ObservationLog) -> Array | None:
    """A first position (3,) that the satellites agree on."""
    for row in np.flatnonzero(np.isfinite(log.pseudorange).sum(axis=1) > least_squares.UNKNOWNS)[:50].tolist():
        seen = np.flatnonzero(np.isfinite(log.pseudorange[row]))
        fix = first_fix(
            (log.pseudorange[row] + log.clock[row])[None, seen],
            log.satellites[row, seen],
            np.ones((1, len(seen)), bool),
        )
        if fix.checked[0]:
            return np.asarray(fix.position[0])
    return None


def _fixes(log: ObservationLog, p: Parameters, start: Array, C_en: Array) -> _Fixes:
    """Solve all epochs side by side."""
    assert p.log is not None
    columns = np.flatnonzero(np.isfinite(log.pseudorange).any(axis=0))
    parts: list[_Fixes] = []
    for first in range(0, len(log), _TOGETHER):
        rows = slice(first, first + _TOGETHER)
        ranges = log.pseudorange[rows][:, columns]
        valid = np.isfinite(ranges)
        measured = Pseudoranges(
            columns=columns,
            satellites=np.where(valid[..., None], log.satellites[rows][:, columns], 2.0 * start),
            values=np.where(valid, ranges + log.clock[rows][:, columns], 0.0),
            valid=valid,
            time=log.week_seconds[rows, None],
            ionosphere=log.ionosphere,
        )
        epochs = len(ranges)
        position = np.broadcast_to(start, (epochs, 3)).copy()
        frame = np.broadcast_to(C_en, (epochs, 3, 3))
        for turn in range(_TURNS):
            m = measure(p, measured, position, frame, np.ones(epochs, bool))
            everyone = least_squares.solve(m.H, m.y, m.sigma, m.valid)
            form = raim.from_projector(
                everyone.projector, m.y / m.sigma, everyone.residual, everyone.dof, everyone.valid
            )
            verdict = raim.isolate(form, 1e-3)
            fix = least_squares.solve(m.H, m.y, m.sigma, m.valid & ~verdict.excluded)
            if turn < _TURNS - 1:
                step = np.where(fix.solved[:, None], fix.x[:, :3], 0.0)
                position += np.matvec(frame, np.clip(step, -1e6, 1e6))
        diagonal = np.diagonal(everyone.projector, axis1=-2, axis2=-1) / m.sigma**2
        slanted = m.sigma**2 - p.log.floor**2
        parts.append(
            _Fixes(
                position=position + np.matvec(frame, np.where(fix.solved[:, None], fix.x[:, :3], np.nan)),
                covariance=fix.covariance[:, :3, :3],
                sound=np.asarray(fix.solved & (everyone.dof > 0) & (verdict.state <= raim.EXCLUDED)),
                statistic=np.where(everyone.solved, form.statistic, 0.0),
                squared=form.squared,
                dof=everyone.dof,
                slanted=(diagonal * slanted).sum(axis=-1),
                flat=diagonal.sum(axis=-1),
            )
        )
    names = _Fixes.__dataclass_fields__
    return _Fixes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _noise(fixes: _Fixes, windows: list[slice], assumed: Log) -> tuple[Array, list[Remark]]:
    """How large the residuals' variance is in each window against the assumed one, at least 1; what to say of it."""
    scale = np.ones(len(windows))
    floors, ratios, judged = [], [], 0
    for k, window in enumerate(windows):
        dof, squared = fixes.dof[window], fixes.squared[window]
        total = fixes.statistic[window].sum()
        checked = (squared > 0.0).sum(axis=0)
        # All satellites, then all but one, each of them in turn.
        sums = np.concatenate([[total], total - squared.sum(axis=0)])
        degrees = np.concatenate([[dof.sum()], dof.sum() - checked])
        if degrees.min() < _LEAST:
            continue
        judged += 1
        excess = sums / stats.chi2.isf(P_FALSE, degrees)
        best = int(excess.argmin())
        spread = sums / degrees
        # One satellite that is wrong stands out; where none does, the residuals of all are the better estimate.
        scale[k] = max(spread[best] if spread[best] < 0.5 * spread[0] else spread[0], 1.0)
        if excess[best] < 1.0:
            continue
        ratios.append(float(np.sqrt(scale[k])))
        variance = scale[k] * dof.sum() - fixes.slanted[window].sum()
        floors.append(float(np.sqrt(max(variance / fixes.flat[window].sum(), assumed.floor**2))))
    if not floors:
        return scale, []
    ratio, fits = float(np.median(ratios)), _rounded(float(np.median(floors)))
    text = (
        f"the residuals contradict the assumed noise: in {len(floors)} of {judged} windows of {WINDOW} epochs they are "
        f"{ratio:.2g} times as large as with a noise floor of {assumed.floor:g} m, which a window is by chance with a "
        f"probability of at most {P_FALSE:g}; a floor of {fits:g} m would fit"
    )
    numbers = {
        "windows": float(judged),
        "contradicted": float(len(floors)),
        "probability": P_FALSE,
        "ratio": ratio,
        "floor": assumed.floor,
        "fitting_floor": fits,
    }
    return scale, [Remark("log.noise", "gps", text, numbers)]


def _moving(fixes: _Fixes, windows: list[slice], local: Array, scale: Array, interval: float) -> list[Remark]:
    """Whether the fixes move more than noise makes them."""
    means, spreads, moved, judged = [], [], 0, 0
    for k, window in enumerate(windows):
        own = fixes.sound[window]
        epochs = int(own.sum())
        if epochs < _FIXES:
            continue
        judged += 1
        points, covariance = local[window][own], fixes.covariance[window][own].mean(axis=0) * scale[k]
        mean = points.mean(axis=0)
        weight = np.linalg.inv(covariance)
        scatter = np.einsum("ei,ij,ej->", points - mean, weight, points - mean) / (3.0 * (epochs - 1.0))
        # The scale is an estimate on so many degrees of freedom: the F test allows for it.
        degrees = max(int(fixes.dof[window].sum()), 1)
        beyond = scatter > stats.f.isf(P_FALSE, 3 * (epochs - 1), degrees)
        means.append(mean)
        spreads.append(covariance)
        away = mean - means[0]
        # Errors of hours, of the atmosphere for one, do not average out: the mean counts as good as one fix.
        apart = away @ np.linalg.inv(covariance + spreads[0]) @ away / 3.0
        moved += bool(beyond or apart > stats.f.isf(P_FALSE, 3, degrees))
    if not moved:
        return []
    points = local[fixes.sound]
    span = float(np.linalg.norm(points - np.median(points, axis=0), axis=1).max())
    text = (
        f"the receiver does not stand still: in {moved} of {judged} windows of {WINDOW} epochs its fixes move more "
        f"than their sigmas allow (by chance with a probability of at most {2.0 * P_FALSE:g} a window), up to "
        f"{span:.0f} m from their middle; errors against one position say little"
    )
    numbers = {"windows": float(judged), "contradicted": float(moved), "probability": 2.0 * P_FALSE, "distance": span}
    return [Remark("log.moving", "gps", text, numbers)]


def _antenna(fixes: _Fixes, local: Array, antenna: Array, scale: Array, from_header: bool) -> list[Remark]:
    """Whether the fixes lie around the position that errors are counted from, (3,) in the level frame [m]."""
    if fixes.sound.sum() < _FIXES:
        return []
    points = local[fixes.sound]
    covariance = fixes.covariance[fixes.sound].mean(axis=0) * float(np.median(scale))
    away = np.median(points, axis=0) - antenna
    # As in the scatter of windows: the middle of all counts as good as one fix, since errors of hours stay in it.
    statistic = float(away @ np.linalg.inv(covariance) @ away)
    if statistic <= stats.chi2.isf(P_FALSE, 3):
        return []
    east, north, up = (float(part) for part in away)
    whose = "the observation file's header" if from_header else "what was given"
    text = (
        f"the antenna is not where {whose} puts it: the fixes lie {float(np.linalg.norm(away)):.4g} m from there on "
        f"the average (east {east:.4g}, north {north:.4g}, up {up:.4g} m), {np.sqrt(statistic):.3g} sigma of one fix; "
        "all errors contain that"
    )
    numbers = {"distance": float(np.linalg.norm(away)), "sigmas": float(np.sqrt(statistic)), "probability": P_FALSE}
    return [Remark("log.antenna", "gps", text, numbers)]


def _rounded(value: float) -> float:
    """Two digits."""
    return float(f"{value:.2g}")
