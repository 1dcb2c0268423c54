"""From alarms to decisions: who is used, who is isolated, who may come back.

Each subject (a sensor, a local filter, an instrument) is in one of four conditions.

    healthy --alarm--> suspect --m alarms in n epochs--> isolated --hold-off epochs of passed admission--> healthy
                       suspect --`clear` epochs without alarm--> healthy
    any --switched off--> off --switched on, admission passed--> healthy

A suspect's measurement is withheld from its first alarm on, so that a fault does no harm while it is being confirmed;
nothing else happens to it, so a single false alarm costs the `clear` epochs and no more. Isolation needs m alarms
within the last n epochs. What lets an isolated subject back is another test than the one that put it out: its
measurement against an estimate it had no part in, passed for `hold_off` epochs without a break. The filter's own test
means little once the filter is contaminated, and decisions do not flutter.

Every array is (runs, subjects); nothing is looped over. Epochs count calls of `step`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection.result import Ints, Mask

HEALTHY, SUSPECT, ISOLATED, OFF = 0, 1, 2, 3
"""Values of `State.health` and `Decision.health`."""

Health = NDArray[np.int8]

_LONGEST_WINDOW = 63  # alarms of the window are the bits of one integer
_ISOLATED, _OFF = np.int8(ISOLATED), np.int8(OFF)
_ONE, _NONE = np.uint64(1), np.uint64(0)


@dataclass(frozen=True, slots=True)
class Rules:
    """How a supervisor decides. Raises ValueError, naming the value, for rules that contradict themselves."""

    confirm: int = 2
    """m: alarms within the window that isolate."""
    window: int = 3
    """n: epochs that alarms are counted over, the present one included."""
    clear: int = 1
    """Epochs in a row without an alarm that clear a suspect."""
    hold_off: int = 10
    """Epochs in a row of passed admission before an isolated subject is readmitted."""
    isolate_last: bool = True
    """Whether the last subject that is neither isolated nor off may be isolated or withheld. If not, it is used
    whatever its test says; of several that would go together, the one with the fewest alarms in the window stays."""

    def __post_init__(self) -> None:
        """Refuse rules that could never act, or never end."""
        if not 1 <= self.window <= _LONGEST_WINDOW:
            raise ValueError(f"the confirmation window is 1 to {_LONGEST_WINDOW} epochs, not {self.window}")
        if not 1 <= self.confirm <= self.window:
            raise ValueError(
                f"{self.confirm} alarms in {self.window} epochs cannot be: confirm is 1 at least, the window at most"
            )
        if self.clear < 1:
            raise ValueError(f"a suspect is cleared after at least 1 epoch without an alarm, not {self.clear}")
        if self.hold_off < 1:
            raise ValueError(f"re-admission needs at least 1 epoch of passed admission, not {self.hold_off}")


@dataclass(frozen=True, slots=True)
class State:
    """What a supervisor remembers between epochs."""

    health: Health
    """(runs, S)."""
    history: NDArray[np.uint64]
    """Alarms of the window as bits, the latest lowest, (runs, S)."""
    streak: Ints
    """Good epochs in a row, (runs, S): without an alarm, or of passed admission for one that is out."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What follows for this epoch; all (runs, S)."""

    use: Mask
    """Its measurement is taken in and fused in this epoch."""
    health: Health
    """HEALTHY, SUSPECT, ISOLATED or OFF."""
    members: Mask
    """Neither isolated nor off after this epoch: those who share the process noise of the next step."""
    just_suspected: Mask
    just_isolated: Mask
    just_readmitted: Mask
    """Comes back: to be re-initialised from the fused estimate after this epoch's fusion, and used from the next on."""
    alarms_in_window: NDArray[np.uint8]
    """How many of the last n epochs alarmed, of those alarms that count."""

    @property
    def suspect(self) -> Mask:
        """Withheld, not yet judged."""
        return np.equal(self.health, SUSPECT)

    @property
    def isolated(self) -> Mask:
        """Judged faulty."""
        return np.equal(self.health, ISOLATED)


def start(runs: int, subjects: int) -> State:
    """All healthy; one that is switched off is so from the first `step` on."""
    shape = (runs, subjects)
    return State(np.zeros(shape, np.int8), np.zeros(shape, np.uint64), np.zeros(shape, np.int64))


def step(
    state: State, alarms: Mask, admission_ok: Mask, enabled: Mask, rules: Rules, counted: Mask | None = None
) -> tuple[State, Decision]:
    """Judge one epoch.

    Shapes: alarms (runs, S), of the test that drives exclusion; admission_ok (runs, S), whether the measurement would
    pass against an estimate it had no part in (read only for subjects that are out); enabled (runs or 1, S), what the
    operator has switched on; counted (runs, S), alarms that count towards isolation, all by default: the others only
    withhold. Returns the new state and the decision for this epoch.
    """
    was_suspect = state.health == SUSPECT
    returning = enabled & (state.health == OFF)  # has nothing to answer for: one passed admission is enough
    out = enabled & (state.health == ISOLATED) | returning
    inside = enabled & ~out

    alarm = alarms & inside
    good = np.where(out, admission_ok, inside & ~alarm)
    streak = np.where(good, np.where(returning, rules.hold_off - 1, state.streak) + 1, 0)
    # One that is out leaves its history behind: alarms from before its isolation do not count when it is back.
    window = np.uint64(2**rules.window - 1)
    counts = alarm if counted is None else alarm & counted
    history = np.where(inside, (state.history << _ONE | counts) & window, _NONE)
    count = np.bitwise_count(history)

    readmitted = out & (streak >= rules.hold_off)
    confirmed = counts & (count >= rules.confirm)
    suspect = alarm | was_suspect & inside & (streak < rules.clear)
    protected = None
    if not rules.isolate_last:
        protected = _last_standing(inside, confirmed, count)
        confirmed = confirmed & ~protected
    suspect = suspect & ~confirmed
    isolated = confirmed | out & ~readmitted
    use = inside & ~suspect & ~confirmed
    if protected is not None:
        use = use | protected

    health = suspect + _ISOLATED * isolated + _OFF * ~enabled
    decision = Decision(
        use=use,
        health=health,
        members=enabled & ~isolated,
        just_suspected=suspect & ~was_suspect,
        just_isolated=confirmed,
        just_readmitted=readmitted,
        alarms_in_window=count,
    )
    return State(health, history, streak), decision


def _last_standing(inside: Mask, confirmed: Mask, count: NDArray[np.uint8]) -> Mask:
    """The one subject of a run that must stay in use, where isolation would leave none or just it, (runs, S)."""
    left = inside & ~confirmed
    standing = left.sum(axis=1, keepdims=True)
    candidates = np.where(standing == 0, inside, left & (standing == 1))
    fewest = np.where(candidates, count, np.uint8(255)).argmin(axis=1)
    return np.asarray(candidates & (np.arange(inside.shape[1]) == fewest[:, None]))
