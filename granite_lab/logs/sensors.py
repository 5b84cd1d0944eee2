"""What a log may hold: sensors, their channels, the quantities that feed these, and the names of columns."""

from __future__ import annotations

from dataclasses import dataclass

from granite_lab.parameters import WHEELS


@dataclass(frozen=True)
class Sensor:
    """What a trial may hold of one kind.

    Attributes:
        name: in messages.
        channels: what columns of a log can feed.
        quantities: of which such a column may be; the first is usual.
        words: in names of columns; "" if its columns are recognised in another way.
        slowest: the lowest plausible sampling rate [Hz]; 0: any.
    """

    name: str
    channels: tuple[str, ...]
    quantities: tuple[str, ...]
    words: str = ""
    slowest: float = 0.0


SENSORS: dict[str, Sensor] = {
    "time": Sensor("clock", ("t", "t_add"), ("time",)),
    "currents": Sensor(
        "motor currents", tuple(f"cur_{wheel}" for wheel in WHEELS), ("current",),
        "current cur amps curr iq amp",
    ),
    "acceleration": Sensor(
        "accelerometer", ("imu_ax", "imu_ay", "imu_az"), ("acceleration",),
        "accelerometer acceleration accel acc a linacc force", slowest=4.0,
    ),
    "rate": Sensor(
        "gyroscope", ("imu_gx", "imu_gy", "imu_gz"), ("angular rate",),
        "gyroscope gyro gyr omega angular w rate g rot", slowest=4.0,
    ),
    "wheels": Sensor(
        "encoders", tuple(f"enc_{wheel}" for wheel in WHEELS), ("angle", "angular rate", "speed", "length"),
        "encoder enc ticks tick wheel odo pos counts count vel speed rpm", slowest=0.5,
    ),
    "command": Sensor("command", ("v_cmd",), ("speed",)),
    "reference_x": Sensor("reference", ("ref_x", "ref_y"), ("length",)),
    "reference_v": Sensor("reference", ("ref_v",), ("speed",)),
    "globe": Sensor("reference", ("ref_lat", "ref_lon"), ("angle",)),
}  # fmt: skip
"""What a log may hold. Of words the more telling ones come first. `t_add` is added to `t`, as nanoseconds
beside seconds. `ref_x` alone is a distance along the path; with `ref_y`, or as latitude and longitude, it is
a place in the plane whose path is followed."""

CHANNELS = {channel: sensor.quantities for sensor in SENSORS.values() for channel in sensor.channels}
"""Channel to the quantities that may feed it."""

ACCELERATION = SENSORS["acceleration"].channels
RATE = SENSORS["rate"].channels
ENCODERS = SENSORS["wheels"].channels
CURRENTS = SENSORS["currents"].channels
