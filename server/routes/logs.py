"""A receiver's log of one's own, uploaded and flown."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from typing import Any

from fastapi import APIRouter, Request, Response
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from ftcore import CommandError
from ftcore.sensors.rinex import LogError
from ftcore.systems.base import NOISE_FLOOR
from server.dependencies import Registry, SettingsOf, kept_for
from server.models import ExperimentState, LogLimits
from server.problems import FieldError, Refused, at, documented
from server.registry import ReceiverLog
from server.settings import Settings

router = APIRouter(tags=["experiments"])
logging.getLogger("python_multipart").setLevel(logging.ERROR)  # who sent a bad form is told; the server's log is not

_NUMBER = r" *[-+]?[0-9]{1,8}([.][0-9]{0,9})? *"
_PLACE = f"{_NUMBER},{_NUMBER},{_NUMBER}"
FORM: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["observation", "navigation"],
    "properties": {
        "observation": {
            "type": "string",
            "format": "binary",
            "description": "RINEX 2 or 3 observation file, GPS, code on L1; plain, .gz, .Z, .bz2 or .crx; `GET /logs` "
            "says how large, unpacked too",
        },
        "navigation": {
            "type": "string",
            "format": "binary",
            "description": "RINEX 2 or 3 GPS navigation file of the same day, plain or packed",
        },
        "antenna": {
            "type": "string",
            "pattern": f"^{_PLACE}$",
            "description": "true position of the antenna: x, y, z, Earth-fixed; the observation file's if absent",
            "unit": "m",
            "example": "-3978241.958, 3382840.234, 3649900.853",
        },
        "noise_floor": {
            "type": "string",
            "pattern": f"^{_NUMBER}$",
            "description": "pseudorange 1-sigma to assume at every elevation; `GET /logs` says the usual one and its "
            "bounds. An event `log.noise` says which would fit where the residuals contradict it",
            "unit": "m",
            "example": "5",
        },
        "title": {"type": "string", "minLength": 1, "maxLength": 120, "description": "the log's if absent"},
    },
}
FILES = ("observation", "navigation")


@router.get("/logs", operation_id="getLogLimits", summary="How large a log may be", responses=documented())
def get_log_limits(settings: SettingsOf) -> LogLimits:
    """Limits of this server for `POST /logs`."""
    return LogLimits(
        observation_bytes=settings.max_observation_bytes,
        navigation_bytes=settings.max_navigation_bytes,
        epochs=settings.max_log_epochs,
        noise_floor=NOISE_FLOOR[1],
        least_noise_floor=NOISE_FLOOR[0],
        largest_noise_floor=NOISE_FLOOR[2],
    )


@router.post(
    "/logs",
    operation_id="flyLog",
    summary="Fly a receiver's log of your own",
    status_code=201,
    responses=documented(400, 409, 413, 415, 422, 429),
    openapi_extra={"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": FORM}}}},
)
async def fly_log(request: Request, registry: Registry, settings: SettingsOf, response: Response) -> ExperimentState:
    """Takes two files as a form, and answers as `POST /experiments` does: an experiment, paused at t = 0.

    Its epochs are the log's own, its errors are against the antenna's position, and faults lie over the receiver's own
    pseudoranges. The server keeps the files for as long as an experiment flies them; its scenario names them.
    """
    log, title = await _received(request, settings)
    try:
        experiment = await registry.create_from_log(log, title)
    except (LogError, CommandError) as error:
        part = error.field.removeprefix("parameters.log").removeprefix(".")
        places = {"antenna": ["antenna"], "floor": ["noise_floor"]}.get(part, [part] if part in FILES else FILES)
        raise Refused(409, str(error), [at([place], str(error)) for place in places]) from None
    await kept_for(request, experiment)
    response.headers["location"] = f"/api/v1/experiments/{experiment.id}"
    return await experiment.state()


async def _received(request: Request, settings: Settings) -> tuple[ReceiverLog, str | None]:
    """The form that came, checked.

    Raises:
        Refused: 400 no form, 413 a file that is too large, 422 a form with something wrong in it.
    """
    try:
        async with request.form(max_files=8, max_fields=8, max_part_size=settings.max_body_bytes) as form:
            errors = list(_misfits(form))
            if errors:
                more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
                raise Refused(422, f"{errors[0].field}: {errors[0].detail}{more}", errors)
            contents = {}
            for name, most in zip(FILES, (settings.max_observation_bytes, settings.max_navigation_bytes), strict=True):
                given = form[name]
                content = await given.read() if isinstance(given, UploadFile) else given.encode()
                if len(content) > most:
                    detail = f"the {name} file has {len(content) / 1e6:.1f} MB; at most {most / 1e6:g} MB are taken"
                    raise Refused(413, detail, [at([name], detail)])
                contents[name] = content
            antenna, title, floor = (form.get(name) for name in ("antenna", "title", "noise_floor"))
    except HTTPException as error:
        if error.status_code != 400:
            raise
        raise Refused(400, f"the body is not a form that can be read: {error.detail}") from None
    except ClientDisconnect:
        raise Refused(400, "the upload was broken off") from None
    place = None
    if isinstance(antenna, str):
        x, y, z = (float(part) for part in antenna.split(","))
        place = (x, y, z)
    log = ReceiverLog(
        contents["observation"], contents["navigation"], place, float(floor) if isinstance(floor, str) else None
    )
    return log, title if isinstance(title, str) else None


def _misfits(form: FormData) -> Iterator[FieldError]:
    """What is wrong with a form, whatever its files hold."""
    properties = FORM["properties"]
    for name in dict.fromkeys(form):
        if name not in properties:
            yield at([name], f"there is no field {name!r}; accepted are {', '.join(properties)}", list(properties))
        elif len(form.getlist(name)) > 1:
            yield at([name], f"{name!r} is given more than once")
    for name in FILES:
        given = form.get(name)
        if given is None or (isinstance(given, UploadFile) and not given.filename and not given.size):
            yield at([name], f"{name!r} is needed: a RINEX file")
    antenna, title = form.get("antenna"), form.get("title")
    if antenna is not None and not (isinstance(antenna, str) and re.fullmatch(_PLACE, antenna)):
        yield at(["antenna"], "three numbers are needed, separated by commas: x, y, z in metres, Earth-fixed")
    floor = form.get("noise_floor")
    if floor is not None and not (isinstance(floor, str) and re.fullmatch(_NUMBER, floor)):
        yield at(["noise_floor"], "a number of metres is needed")
    if title is not None and not (isinstance(title, str) and 1 <= len(title) <= 120):
        yield at(["title"], "a title has 1 to 120 characters")
