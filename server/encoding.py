"""JSON as the server writes it: arrays of numpy become lists, NaN and infinity become null."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np


def _plain(value: Any) -> Any:
    """What JSON can hold in place of numpy's arrays and numbers. Raises TypeError for anything else."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} has no form in JSON")


_encoder = msgspec.json.Encoder(enc_hook=_plain)


def to_json(document: Any) -> bytes:
    """A document of dicts, lists, texts, numbers and numpy arrays, as JSON in UTF-8.

    Raises:
        TypeError: something in it has no form in JSON.
    """
    return _encoder.encode(document)
