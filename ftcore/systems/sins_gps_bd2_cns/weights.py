"""What the fusion makes of the tests: validities, weights of the subsets, models, and the propagators' ages."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Trace
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS

Array = NDArray[np.float64]

SUBSETS: Final = ("sins", "gps", "bd2", "gps-bd2", "cns", "gps-cns", "bd2-cns", "gps-bd2-cns")
"""Which aids a weight stands for: bit 0 GPS, bit 1 BD2, bit 2 CNS."""
LABELS: Final = {s: "SINS alone" if s == "sins" else " + ".join(AIDS[a] for a in s.split("-")) for s in SUBSETS}
MODELS: Final = ("small", "large")
_WHICH: Final = {"1": "propagator 1", "2": "propagator 2", "reference": "the reference propagator"}
DECLARED: Final = Declared(
    members={"subset": LABELS, "model": {model: model for model in MODELS}, "propagator": _WHICH},
    signals=(
        Signals("validity.{aid}", "validity of {aid}", "1", "weight"),
        Signals("weight.{subset}", "weight of {subset}", "1", "weight"),
        Signals("probability.{model}", "probability of Q {model}", "1", "weight"),
        Signals("propagator.reference", "which propagator is the reference", "1", "test"),
        Signals("propagator.{propagator}.age", "age of {propagator}", "s", "test"),
    ),
    charts=(
        Chart(
            id="weights",
            title="Weights of the eight subsets of aids",
            unit="1",
            group="weights",
            stacked=True,
            traces=tuple(
                Trace(signal=f"weight.{name}", label=LABELS[name], role="weight") for name in reversed(SUBSETS)
            ),
        ),
        Chart(
            id="models",
            title="Model probabilities",
            unit="1",
            group="weights",
            stacked=True,
            traces=(
                Trace(signal="probability.small", label="Q small: quiet flight"),
                Trace(signal="probability.large", label="Q large: manoeuvre"),
            ),
        ),
        Chart(
            id="propagators",
            title="Propagators: seconds since each was reset, and which is the reference",
            unit="s",
            group="tests",
            traces=(
                Trace(signal="propagator.1.age", label="propagator 1"),
                Trace(signal="propagator.2.age", label="propagator 2"),
                Trace(signal="propagator.reference.age", label="the reference", role="protected"),
            ),
        ),
        Chart(
            id="validity",
            title="Validity of each aid",
            unit="1",
            group="weights",
            traces=(Trace(signal="validity.{aid}", label="{aid}"),),
        ),
    ),
)


def report(say: Ledger, alpha: Array, beta: Array, mu: Array, reference: NDArray[np.int64], age: Array) -> None:
    """What came of an epoch.

    Args:
        alpha: weights of the subsets ``(runs, 8)``. beta: validities ``(runs, 3)``. mu: of the models ``(runs, 2)``.
        reference: which propagator is the reference, 0 or 1 ``(runs,)``.
        age: seconds since the propagators' resets ``(runs, 2)``.
    """
    say["validity.{aid}"], say["weight.{subset}"], say["probability.{model}"] = beta, alpha, mu
    say["propagator.reference"] = reference + 1.0
    of_reference = np.take_along_axis(age, reference[:, None], axis=1)
    say["propagator.{propagator}.age"] = np.concatenate([age, of_reference], axis=1)
