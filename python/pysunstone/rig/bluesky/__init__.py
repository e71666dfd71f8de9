"""Bridge to bluesky and ophyd-async: uses their devices as instruments of a session, and instruments as devices of bluesky.

Devices are recognized by bluesky's protocols, so that neither library is required: `Movable` (``set`` returns a status),
`Readable`, `Locatable`, `Triggerable`, `Stoppable`. The protocols of ophyd-async, whose methods are coroutines, are also
supported.
"""

from pysunstone.rig.bluesky.devices import CameraOfDevice, StageOfDevice, event_loop
from pysunstone.rig.bluesky.plans import MovableProjector, MovableStage, ReadableCamera, Status
from pysunstone.rig.bluesky.scan_devices import CounterOfDevice, GalvoOfDevices, LaserOfDevices

__all__ = [
    "CameraOfDevice",
    "CounterOfDevice",
    "GalvoOfDevices",
    "LaserOfDevices",
    "MovableProjector",
    "MovableStage",
    "ReadableCamera",
    "StageOfDevice",
    "Status",
    "event_loop",
]
