"""What the API takes and gives: the schemas of the OpenAPI document.

Requests are strict: no unknown field, no number sent as text, no NaN. Values of signals are SI.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from ftcore import Fault, Scenario
from ftcore.documents import Seconds
from ftcore.faults import Kind
from ftcore.identifiers import Line


def whole(value: Any) -> Any:
    """JSON knows one kind of number: 7.0 is as whole as 7."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Speed = Annotated[float, Field(ge=0.5, le=100.0)] | Literal["max"]
Seed = Annotated[int, Field(ge=0, le=2**53 - 1), BeforeValidator(whole)]
Epochs = Annotated[int, Field(ge=0, le=10_000_000), BeforeValidator(whole)]
State = Literal["paused", "running", "advancing", "finished", "failed"]


class Request(BaseModel):
    """Base of request bodies."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Answer(BaseModel):
    """Base of answers."""


# ---- systems ----------------------------------------------------------------------------------------------------


class Choices(Request):
    """Parameters and settings as a scenario has them; what is absent is as by default."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"parameters": {"gyros": {"mounting": [30, 60, 45]}}}]})

    parameters: dict[str, Any] = Field(default_factory=dict, description="by the system's parameters_schema")
    settings: dict[str, Any] = Field(default_factory=dict, description="by the system's settings_schema")


# ---- experiments ------------------------------------------------------------------------------------------------


class _ScenarioOrId:
    """Any id or document in, the scenario's schema in the OpenAPI document; parsed by the service."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.union_schema(
            [core_schema.str_schema(strict=True, max_length=60), core_schema.dict_schema(core_schema.str_schema())]
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [{"type": "string", "maxLength": 60}, handler(Scenario.__pydantic_core_schema__)]}


class NewExperiment(Request):
    """A scenario to fly."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"scenario": "zhang-1992", "seed": 7}]})

    scenario: Annotated[str | dict[str, Any], _ScenarioOrId()] = Field(
        description="id of a ready scenario, or a scenario document"
    )
    seed: Seed | None = Field(default=None, description="instead of the scenario's")
    title: Line | None = Field(default=None, min_length=1, max_length=120, description="the scenario's if absent")
    spare: bool = Field(
        default=False,
        description="whether a page may take it over, or delete it for want of room, while nobody has touched it",
    )


class ClockState(Answer):
    """Where an experiment's clock stands."""

    state: State = Field(description="advancing: flown by an advance, which a paused clock or a rewind stops")
    time: float = Field(description="time of the last epoch [s]", json_schema_extra={"unit": "s"})
    epoch: int
    period: float = Field(description="seconds between epochs", json_schema_extra={"unit": "s"})
    speed: float | Literal["max"] = Field(description="simulated seconds per second, or as fast as it goes")
    duration: float = Field(json_schema_extra={"unit": "s"})
    reason: str | None = Field(default=None, description="why it failed, or was paused unasked")


class FaultState(Answer):
    """One fault of an experiment."""

    id: str
    channel: str
    kind: str
    magnitude: float
    unit: str | None = Field(description="unit of the magnitude; none where the kind has no magnitude")
    start: float = Field(json_schema_extra={"unit": "s"})
    end: float | None = Field(json_schema_extra={"unit": "s"})
    angular_frequency: float = Field(description="of a sine", json_schema_extra={"unit": "rad/s"})
    rate: float = Field(description="of outliers: probability of a spike in each sample")
    state: Literal["armed", "active", "ended"]
    acting: bool = Field(description="whether it changed what the navigator was given in the last epoch")
    acted_epochs: int = Field(description="in how many epochs it has done so")
    silent_because: str | None = Field(description="why it is not acting; null while it is")


class SubsystemStatus(Answer):
    """One subsystem of an experiment."""

    enabled: bool = Field(description="the operator's switch")
    used: bool = Field(description="whether the master uses it in this epoch")
    health: Literal["ok", "suspect", "isolated", "off", "faulted"]


class ScenarioLabel(Answer):
    """Which scenario flies."""

    id: str
    title: str
    hint: str


class ExperimentState(Answer):
    """An experiment as it stands."""

    id: str
    title: str
    system: str
    seed: int
    scenario: ScenarioLabel
    clock: ClockState
    faults: list[FaultState]
    subsystems: dict[str, SubsystemStatus]
    settings: dict[str, Any]
    idle_settings: dict[str, str] = Field(
        description="settings that change nothing with these parameters and the other settings, and why"
    )
    unavailable: dict[str, str] = Field(description="channels that this experiment has not, and what would bring them")
    not_in_view: list[str] = Field(description="channels without a reading in the last epoch; no fault acts there now")
    parent: str | None = Field(description="the experiment this one was forked from")
    ghost_of: str | None = Field(description="the experiment this one is the fault-free twin of")
    spare: bool = Field(description="whether a page may take it over, or delete it, while nobody has touched it")
    watchers: int = Field(description="open streams; for its first ten seconds or its first stream, its maker too")


class LogLimits(Answer):
    """What an uploaded receiver's log may have."""

    observation_bytes: int = Field(description="of the observation file")
    navigation_bytes: int = Field(description="of the navigation file")
    epochs: int
    noise_floor: float = Field(description="that is assumed where none is given", json_schema_extra={"unit": "m"})
    least_noise_floor: float = Field(json_schema_extra={"unit": "m"})
    largest_noise_floor: float = Field(json_schema_extra={"unit": "m"})


# ---- time -------------------------------------------------------------------------------------------------------


class ClockChange(Request):
    """Run, pause, or change the speed."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"state": "running", "speed": 10}], "minProperties": 1})

    state: Literal["running", "paused"] = Field(default="paused")
    speed: Speed = Field(default=1.0, description="simulated seconds per second, 0.5 to 100, or as fast as it goes")

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if not self.model_fields_set:
            raise ValueError("give a state (running or paused), a speed (0.5 to 100, or max), or both")
        return self


class Advance(Request):
    """How far to fly: a number of epochs or a time; to the end if neither is given."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"until": 100.0}, {"epochs": 10}]})

    epochs: Epochs | None = Field(default=None)
    until: Seconds | None = Field(default=None)

    @model_validator(mode="after")
    def _not_both(self) -> Self:
        if self.epochs is not None and self.until is not None:
            raise ValueError("give either epochs or until, not both")
        return self


class EventState(Answer):
    """One thing that happened. ``run`` is -1 for what the operator did."""

    index: int
    time: float = Field(json_schema_extra={"unit": "s"})
    run: int
    kind: str
    subject: str
    detail: dict[str, Any]


class Advanced(Answer):
    """Where the experiment stands after an advance."""

    experiment: ExperimentState
    events: list[EventState] = Field(description="what happened on the way")
    latest: dict[str, float | None] = Field(description="last value of every signal, SI; null where it has none")


class Rewind(Request):
    """The moment to go back to."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"to": 45.0}]})

    to: Seconds


class Fork(Request):
    """Where to branch off; now if absent."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"at": 45.0, "title": "without doppler"}]})

    at: Seconds | None = Field(default=None)
    title: Line | None = Field(default=None, min_length=1, max_length=120)


class Cursor(Request):
    """The moment that the 3-D scene shows."""

    time: Seconds | None = Field(description="null: live")
    picture: str | None = Field(
        default=None, max_length=40, description="which of the scene's pictures is shown; absent: the one that is"
    )


# ---- what the operator does ---------------------------------------------------------------------------------------


class NewFault(Fault):
    """A fault to inject; start defaults to now. A field that its kind has no use for is refused, whatever its value."""

    model_config = ConfigDict(
        strict=True,
        json_schema_extra={
            "examples": [{"channel": "gps.pseudorange.C1", "kind": "bias", "magnitude": 100.0, "start": 50.0}]
        },
    )
    defaults_say_nothing = False


class FaultChange(Request):
    """What to change of a fault; the rest stays."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"magnitude": 50.0}], "minProperties": 1})

    kind: Kind = Field(default="bias")
    magnitude: float = Field(default=0.0, ge=-1e9, le=1e9)
    unit: str | None = Field(default=None, max_length=20)
    start: Seconds = Field(default=0.0)
    end: Seconds | None = Field(default=None, description="null: never")
    angular_frequency: float = Field(default=0.05, gt=0.0, le=1e3, json_schema_extra={"unit": "rad/s"})
    rate: float = Field(default=0.1, gt=0.0, le=1.0)

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if not self.model_fields_set:
            raise ValueError(f"give at least one of {', '.join(type(self).model_fields)}")
        return self


class SubsystemSwitch(Request):
    """Switch a subsystem on or off."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"enabled": False}]})

    enabled: bool


# ---- what comes out -----------------------------------------------------------------------------------------------


class Resolution(Answer):
    """Until when the recorded history is how coarse."""

    until: float
    every: float


class Series(Answer):
    """Columns, SI. ``null`` stands for no value."""

    time: list[float]
    signals: dict[str, list[float | None]]
    decimation: Literal["none", "samples", "envelope"] = Field(
        description="none: every recorded epoch. samples: the epochs where a signal has its extremes. envelope: two "
        "rows per span of time, each signal's least and greatest value in the order they came"
    )
    resolution: list[Resolution] = Field(description="where old history was thinned; empty if nowhere")


class Health(Answer):
    """The server is alive."""

    status: Literal["ok"]
    experiments: int


class Version(Answer):
    """What runs here."""

    ftlab: str
    python: str
    numpy: str
