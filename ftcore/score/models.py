"""What a score consists of. Times are seconds, lengths and angles SI; shares are between 0 and 1."""

from __future__ import annotations

from pydantic import BaseModel, Field, PrivateAttr

from ftcore.score import picture
from ftcore.score.rows import Rows


class Share(BaseModel):
    """So many of so many, with the exact (Clopper-Pearson) 95 % interval; null where there are none to count."""

    count: int
    of: int
    share: float | None
    low: float | None
    high: float | None
    words: str = Field(description="the same as a sentence's part, with the denominator by name")


class Outcome(BaseModel):
    """How the runs in which a fault acted divide: the three counts add up to them."""

    after_onset: Share = Field(description="it happened while the fault acted, and was not so before")
    already: Share = Field(description="it was so already when the fault first acted: neither found nor missed")
    missed: Share
    delay: float | None = Field(
        description="median over the runs of after_onset, from the first epoch in which the fault acted"
    )


class FaultScore(BaseModel):
    """What one fault did. A fault that never acted is neither found nor missed: all that follows is empty then."""

    id: str
    label: str
    channel: str
    sensor: str
    start: float
    end: float | None
    acted: Share = Field(description="runs in which the fault changed what the navigator was given, of all runs")
    first_acted: float | None = Field(default=None, description="median time of the first epoch in which it acted")
    silent_because: str | None = Field(default=None, description="why it never acted, where it did not")
    time_to_alarm: dict[str, float | None] = Field(
        default={}, description="test -> median delay; null where it did not happen"
    )
    alarmed_share: dict[str, float] = Field(
        default={}, description="test -> share of the runs in which the fault acted"
    )
    alarms: dict[str, Outcome] = Field(default={}, description="test -> noticed, already in alarm, missed")
    time_to_isolate: float | None = None
    isolated_share: float | None = Field(
        default=None, description="of the runs in which it acted; 1 minus those missed"
    )
    isolation: Outcome | None = Field(default=None, description="isolated, isolated already, not isolated")
    isolated: list[str] = Field(
        default=[], description="subjects that this fault's channel explains and that were isolated"
    )
    wrong_isolations: list[str] = Field(
        default=[], description="subjects isolated with nothing wrong about them at that moment"
    )
    wrong_share: float | None = None
    wrong: Share | None = None
    time_to_readmit: float | None = None
    readmission: Share | None = Field(
        default=None, description="of the runs in which it was isolated when the fault ended"
    )
    worst: dict[str, float] = Field(
        default={}, description="signal -> largest absolute value from its start to its end"
    )
    words: str = Field(default="", description="the whole in one line")


class TestScore(BaseModel):
    """Alarms of one test on one subject while nothing that concerns it was wrong: before, between and after faults."""

    name: str
    subject: str
    alarms: int
    epochs: int = Field(description="tests that could have given a false alarm, over all runs")
    false_alarm_rate: float | None
    low: float | None = Field(description="exact 95 % interval of the rate, tests taken as independent")
    high: float | None
    stretches: int = Field(description="unbroken stretches that these alarms came in")
    clustered: bool = Field(description="alarms follow each other more often than independent epochs do (at 1 %)")
    runs: Share = Field(description="runs with at least one such alarm: runs are independent, whatever epochs are")
    reached_alarms: int = Field(
        description="alarms on this subject, itself sound, while another fault entered the test: no false alarms"
    )
    reached_epochs: int
    words: str


class WrongIsolation(BaseModel):
    """One isolation of a subject about which nothing was wrong at that moment."""

    time: float
    run: int
    calm: bool = Field(description="nothing at all was wrong; false: something else was")


class IsolationScore(BaseModel):
    """Isolations of one subject while nothing that concerns it was wrong."""

    subject: str
    label: str
    count: int
    calm: int = Field(description="how many of them came when nothing at all was wrong")
    runs: Share = Field(description="runs with at least one, of the runs in which the subject was in use")
    hours: float = Field(description="hours, over all runs, in which it was in use and nothing about it was wrong")
    per_hour: float | None
    low: float | None = Field(description="exact 95 % interval of the rate per hour, isolations taken as independent")
    high: float | None
    first: list[WrongIsolation] = Field(description="the earliest of them, at most 20")
    words: str


class ErrorScore(BaseModel):
    """Root mean square and worst absolute error [SI], after settling."""

    rms: float | None
    worst: float | None


class EstimatorScore(BaseModel):
    """One estimator: position, velocity, attitude, and the mean normalised error squared."""

    position: ErrorScore
    velocity: ErrorScore
    attitude: ErrorScore
    nees: float | None
    nees_dof: int | None


class Headline(BaseModel):
    """One item of the score strip. ``note`` fits beside the number, ``detail`` says it in full."""

    label: str
    value: float | None
    unit: str
    note: str = ""
    detail: str = ""
    compare_label: str | None = None
    compare: float | None = None


class Score(BaseModel):
    """A flight so far against the truth."""

    runs: int
    time: float
    recovery: float = Field(
        description="seconds after a fault's end in which what it explained is still no false alarm and no wrong "
        "isolation; where the subject is isolated when the fault ends, they count from its re-admission"
    )
    faults: list[FaultScore]
    tests: list[TestScore]
    isolations: list[IsolationScore]
    estimators: dict[str, EstimatorScore]
    headline: list[Headline]
    _rows: Rows | None = PrivateAttr(default=None)

    @property
    def rows(self) -> Rows:
        """The rows that all this is computed from; see :mod:`ftcore.score.rows`.

        Raises:
            ValueError: the score was read from a document, which has none.
        """
        if self._rows is None:
            raise ValueError(
                "this score was read from a document, which does not hold its rows; score the flight itself"
            )
        return self._rows

    def __repr__(self) -> str:
        """The strip: an item a line."""
        return "\n".join(picture.lines(self))

    __str__ = __repr__

    def _repr_html_(self) -> str:
        return picture.html(self)
