"""Where in a document something is wrong, and which field names the form accepts there."""

from __future__ import annotations

import types
from collections.abc import Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel


def accepted_fields(form: Any, location: Sequence[Any]) -> list[str] | None:
    """Field names of the model found at ``location`` below the annotation ``form``; None where there is none."""
    found = [form]
    for part in location:
        found = [inner for one in found for inner in _inside(one, part)]
    models = [model for one in found for model in _models(one)]
    return sorted({name for model in models for name in model.model_fields}) or None


def place(location: Sequence[Any], given: Any) -> tuple[Any, ...]:
    """Where an error is in the document, without the tags that pydantic puts in for the options of a union."""
    found: list[Any] = []
    here = given
    for i, part in enumerate(location):
        if (isinstance(here, dict) and part in here) or (isinstance(here, list) and isinstance(part, int)):
            found.append(part)
            here = here[part] if isinstance(here, dict) or part < len(here) else None
        elif isinstance(here, dict) and i == len(location) - 1:
            found.append(part)
    return tuple(found)


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Models an annotation may stand for."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    origin = get_origin(annotation)
    if origin is Annotated:
        return _models(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return [model for option in get_args(annotation) for model in _models(option)]
    return []


def _inside(annotation: Any, part: Any) -> list[Any]:
    """Annotations of what is found under ``part`` (a field name or an index); a union's tag leads nowhere new."""
    if get_origin(annotation) is Annotated:
        return _inside(get_args(annotation)[0], part)
    if isinstance(part, int) and get_origin(annotation) in (list, tuple):
        return [get_args(annotation)[0]]
    inner = [model.model_fields[part].annotation for model in _models(annotation) if part in model.model_fields]
    return inner or [annotation]
