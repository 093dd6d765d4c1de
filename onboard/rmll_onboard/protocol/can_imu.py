"""An IMU on a CAN bus: two frames a sample, a convention of this project, told in docs/can.md.

Big-endian. First the orientation w, x, y, z, base to world; directly after it the angular velocity
x, y, z in the base frame and the sensor's clock in milliseconds, of which 16 bits are sent.
"""

import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTH = 8
"""Bytes of either frame"""

_QUATERNION = struct.Struct(">4h")
_GYRO = struct.Struct(">3hH")
# counts of 1 and of 1 rad/s; i16 then ends at 36 rad/s
_UNIT, _RATE = 32767.0, 900.0


def decode(orientation: bytes, rate: bytes) -> tuple[Array, Array, int]:
    """Quaternion (4,), angular velocity (3,) [rad/s], clock [ms]; both frames have 8 bytes."""
    *gyro, milliseconds = _GYRO.unpack(rate)
    return np.array(_QUATERNION.unpack(orientation)) / _UNIT, np.array(gyro) / _RATE, milliseconds
