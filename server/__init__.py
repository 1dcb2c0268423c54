"""The only room that knows HTTP: FastAPI routes over services over :mod:`ftcore`."""
