"""Charts that the parts of several systems declare alike."""

from __future__ import annotations

from ftcore.description import Chart, Trace


def chart_of_test(id: str, title: str, stem: str) -> Chart:
    """A test's statistic and its threshold; ``stem``: ``test.<test>.<subject>``."""
    return Chart(
        id=id,
        title=title,
        unit="1",
        group="tests",
        scale="log",
        traces=(
            Trace(signal=f"{stem}.statistic", label="statistic", role="statistic"),
            Trace(signal=f"{stem}.threshold", label="threshold", role="threshold"),
        ),
    )
