"""Short flights of the redundant IMU with faults of its gyros, for its tests."""

from ftcore import Scenario


def bias(axis, magnitude=0.1, start=1.0, end=None):
    return {"channel": f"imu.gyro.{axis}", "kind": "bias", "magnitude": magnitude, "start": start, "end": end}


def pair(instrument, second=1.0, start=1.0, size=0.1, end=None):
    return [bias(f"{instrument}x", size, start, end), bias(f"{instrument}y", second * size, start, end)]


def scenario(faults=(), duration=2.0, seed=2, parameters=None, **settings):
    return Scenario.model_validate(
        {
            "system": "redundant-imu",
            "duration": duration,
            "seed": seed,
            "faults": list(faults),
            "parameters": parameters or {},
            "settings": settings,
        }
    )
