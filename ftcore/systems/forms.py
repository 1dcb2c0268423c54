"""Fields that the forms of several systems have in common, so that one number is called and bounded alike in all."""

from __future__ import annotations

from typing import Any

from pydantic import Field, model_validator

from ftcore.systems.base import Form

CONFIRM: Any = Field(default=2, ge=1, le=20, title="Confirm, m", description="alarms that confirm a fault ...")
WITHIN: Any = Field(default=3, ge=1, le=20, title="of n epochs", description="... within so many epochs")


def quantity(
    default: float, unit: str, description: str, low: float, high: float, source: str = "FTLab default"
) -> Any:
    """A number with unit, bounds and source: the paper's, or FTLab's default where the paper is silent."""
    extra: dict[str, Any] = {"unit": unit, "source": source}
    return Field(default=default, ge=low, le=high, description=description, json_schema_extra=extra)


def mounting() -> Any:
    """Mounting angles of three 2-DOF instruments."""
    return Field(
        default=(45.0, 45.0, 45.0),
        description="mounting angles phi, theta, psi of Kim 2005 (27)",
        json_schema_extra={"unit": "deg", "source": "paper"},
    )


def false_alarm_probability(source: str = "FTLab default", most: float = 0.2) -> Any:
    """P_fa of each test at each epoch, up to the ``most`` that all tests of the system are made for."""
    return Field(
        default=1e-3,
        ge=1e-9,
        le=most,
        title="False alarm",
        description="per test and epoch",
        json_schema_extra={"unit": "1", "source": source},
    )


def hold_off(default: int, description: str) -> Any:
    """How many epochs an excluded subject must pass before it is trusted again."""
    return Field(default=default, ge=1, le=1000, title="Hold-off", description=description)


class Supervised(Form):
    """Base of settings with an m-of-n confirmation: they are refused where m exceeds n."""

    @model_validator(mode="after")
    def _m_of_n(self) -> Any:
        confirm, within = getattr(self, "confirm", 1), getattr(self, "within", 1)
        if confirm > within:
            raise ValueError(f"confirm {confirm} of {within} cannot be; confirm may be at most the number of epochs")
        return self
