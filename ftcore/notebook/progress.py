"""How far a long advance has come, where somebody wants to know."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ftcore.frames import needed

Progress = bool | Callable[[float, float], object] | None
"""True: a bar (tqdm). A function: called after each epoch with the time flown to and the time to fly to [s]."""


@contextmanager
def progressing(progress: Progress, title: str, start: float, end: float) -> Iterator[Callable[[float], object]]:
    """A function that is to be called with the time flown to [s], after each epoch.

    Args:
        progress: what is wanted.
        title: what the bar is called.
        start, end: from when to when is flown [s].

    Raises:
        ImportError: a bar is wanted and tqdm is not installed.
    """
    if progress is None or progress is False:
        yield lambda now: None
    elif callable(progress):
        told = progress
        yield lambda now: told(now, end)
    else:
        bars = needed("tqdm.auto", "a progress bar")
        form = "{desc}: {percentage:3.0f} % |{bar}| {n:.6g} of {total:.6g} s, {remaining} left"
        with bars.tqdm(total=end, initial=start, desc=title, bar_format=form) as bar:
            yield lambda now: bar.update(now - bar.n)
