"""Names that a person types: patterns of them, and near misses where there is no such name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

SHOWN = 6
"""Names that an error has room for."""


def choose(names: Sequence[str], wanted: Iterable[str] | None, what: str = "signal") -> list[int]:
    """Places of the wanted names, in the order of ``names``.

    Args:
        names: all there are.
        wanted: names, or patterns with ``*`` and ``?``, in any order; None: all.
        what: what they name, for the message.

    Raises:
        ValueError: a name or pattern that fits nothing, with near misses; or a text in place of a list.

    >>> choose(["fused.error.up", "fused.sigma.up", "time"], ["fused.*.up"])
    [0, 1]
    """
    if wanted is None:
        return list(range(len(names)))
    if isinstance(wanted, str):
        raise ValueError(f"a list of {what} names or patterns is needed, for instance [{wanted!r}]")
    place = {name: i for i, name in enumerate(names)}
    found: set[int] = set()
    for pattern in wanted:
        hits = [place[pattern]] if pattern in place else [i for i, n in enumerate(names) if fnmatchcase(n, pattern)]
        if not hits:
            raise ValueError(unknown(what, pattern, names))
        found.update(hits)
    return sorted(found)


def unknown(what: str, name: str, names: Iterable[str]) -> str:
    """A sentence for a name that is not there: those that begin alike, or any, the most alike first.

    >>> unknown("signal", "fused.error.upp", ["fused.error.up", "fused.error.east", "gps.x"])
    "no signal 'fused.error.upp'; for instance fused.error.up, fused.error.east"
    """
    known = list(names)
    alike = [n for n in known if n.split(".")[0] == name.split(".")[0]] or known
    near = difflib.get_close_matches(name, alike, n=SHOWN, cutoff=0.5)
    shown = list(dict.fromkeys([*near, *alike]))[:SHOWN]
    return f"no {what} {name!r}; {'for instance ' + ', '.join(shown) if shown else 'there are none'}"
