"""A flight at a glance: in one line, and as a card."""

from __future__ import annotations

from collections import Counter

from ftcore import display
from ftcore.display import counted, quantity
from ftcore.notebook.flown import Flown


def line(flight: Flown) -> str:
    """Scenario, time, runs and faults in one line."""
    states = Counter(live.state for live in flight.faults)
    faults = ", ".join(f"{states[state]} {state}" for state in ("armed", "active", "ended") if states[state])
    return (
        f"<Simulation {flight.scenario.id}: {flight.now:g} of {flight.duration:g} s, {counted(flight.runs, 'run')}, "
        f"seed {flight.seed}; faults: {faults or 'none'}; {counted(len(flight.signals), 'signal')} recorded>"
    )


def card(flight: Flown) -> str:
    """Title, time, faults and how the subjects fare, as HTML."""
    description = flight.description
    about = f"{description.title}; seed {flight.seed}, {counted(flight.runs, 'run')}"
    flown = f"{flight.now:g} of {flight.duration:g} s flown, {counted(len(flight.signals), 'signal')} recorded"
    faults = [
        (
            live.fault.channel,
            live.fault.words(live.unit),
            live.state,
            "acting" if live.acting else live.silent_because or "",
        )
        for live in flight.faults
    ]
    isolated = Counter(event.subject for event in flight.events if event.kind == "subsystem.isolated")
    alarmed = Counter(event.subject for event in flight.events if event.kind == "test.alarmed")
    subjects = [
        (subject, str(alarmed[subject]), str(isolated[subject])) for subject in sorted(alarmed | isolated, key=str)
    ]
    runs = "" if flight.runs == 1 else f" (of {flight.runs} runs together)"
    return display.card(
        flight.scenario.title,
        about,
        display.line(flown),
        display.table("Faults", ("channel", "fault", "state", "in the first run"), faults),
        display.table(f"Alarms and isolations{runs}", ("subject", "alarms", "isolations"), subjects),
        display.line(f"Latest event at {quantity(flight.events[-1].time, 's')}" if flight.events else ""),
        display.line("plot() draws the charts; score() judges the flight."),
    )
